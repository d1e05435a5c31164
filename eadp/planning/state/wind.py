"""Gate of headings: a heading that contradicts the ground velocity is not used for the wind.

With heading θ and airspeed s each ground velocity v implies a wind w = v − s(cos θ, sin θ). The wind of a right heading
scatters by gusts alone. That of a wrong one turns with the course, by up to 2s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight import WindFilter, WindReadings
from eadp.core.geometry.curves import Point
from eadp.planning.state.known import WindKnown

HEADING_DISBELIEVED = "heading-disbelieved"
"""Code of a warning: the heading contradicts the ground velocity, and is not used."""

WINDOW_S, MIN_WINDOW_S, RESTORE_S = 60.0, 15.0, 180.0
"""Averaging time of the moments; least time before a judgement; time that a disbelieved heading has to fit [s]."""

JUDGE_EVERY_S = 5.0
"""Time between judgements [s]."""

MAX_SCATTER, MAX_GUSTS, MAX_WIND = 0.6, 6.0, 1.5
"""A heading is disbelieved if the variance of the implied wind exceeds this share of s², and so many times that of a
wind without headings; or if its mean exceeds so many airspeeds. An offset of 15° and gusts of 3 m/s give a share of 0.3
at 10 m/s; a heading off by 90° on two opposite courses gives 2."""

RESTORE_SHARE, TURNED_SHARE = 0.5, 0.5
"""Share of these limits below which a heading fits; and least variance of the ground velocity that can show it, as a
share of s²."""

WIND_STD_MPS = 3.0
"""Standard deviation of the wind that the estimate without headings starts from [m/s]."""

RIDGE_M2PS2 = 0.1
"""Added to the variances of the ground velocity [m²/s²]: without a turn the circle is not determined."""

_Moments = tuple[FloatArray, FloatArray]
"""Weighted sums [s] of (1, vx, vy, |v|²/2) times one another, shape (4, 4), and of (1, ux, uy, |u|²), shape (4,)."""


class _Fit(NamedTuple):
    """Two estimates of the wind, with and without the headings, and how well each fits the readings.

    Attributes
    ----------
    implied_mps, circle_mps : (float, float)
        Mean wind that the headings imply, and the centre of the circle of ground velocities [m/s].
    scatter, residual : float
        Variance of the implied wind about its mean, and of the wind by the circle's fit [m²/s²].
    velocity : float
        Variance of the ground velocity: large once the aircraft has turned [m²/s²].
    """

    scatter: float
    velocity: float
    residual: float
    implied_mps: tuple[float, float]
    circle_mps: tuple[float, float]


class HeadingGate:
    """Whether headings are believed, by the scatter of the wind that they imply.

    Two estimates of the wind compete over the same time: the mean of v − s(cos θ, sin θ), and without headings the
    centre of the circle of radius s on which the ground velocities lie. A heading is disbelieved if the first leaves
    much more than the second, and more than gusts and a constant offset can explain. That takes a turn. It is believed
    again after `RESTORE_S` in which it fits, turns included.

    Attributes
    ----------
    disbelieved : bool
        Whether the headings are not to be used.

    Source: weighted least squares; the circle by Kåsa's linear fit.
    """

    def __init__(self) -> None:
        self.disbelieved = False
        self._sums: _Moments = np.zeros((4, 4)), np.zeros(4)
        self._fits_s = 0.0
        """How long a disbelieved heading has fit, turns included [s]."""
        self._unjudged_s = 0.0
        """Time of readings since the last judgement [s]."""

    def ingest(self, readings: WindReadings, wind: WindFilter) -> WindReadings:
        """Judge headings by a batch of readings; return it as it is used for the wind.

        Its headings are all NaN where they are disbelieved after this batch. `wind` starts again from the wind without
        headings when they become disbelieved.
        """
        vx, vy, theta, steps, airspeeds = (np.asarray(column, dtype=float) for column in readings)
        v = vx + 1j * vy  # vectors as complex numbers
        used = ~np.isnan(v.real + v.imag + theta)
        if used.any():
            # the implied wind u = v − s(cos θ, sin θ)
            total_s = self._add(v, v - airspeeds * np.exp(1j * theta), steps, used)
            self._unjudged_s += float(steps[used].sum())
            if total_s >= MIN_WINDOW_S and self._unjudged_s >= JUDGE_EVERY_S:
                self._judge(_fit(self._sums), self._unjudged_s, float(airspeeds[-1]), wind)
                self._unjudged_s = 0.0
        return readings._replace(headings_rad=np.full(len(theta), math.nan)) if self.disbelieved else readings

    def _add(self, v: np.ndarray, u: np.ndarray, steps: FloatArray, used: np.ndarray) -> float:
        """Add ground velocities v and implied winds u to the moments; return the time that these cover, faded, [s]."""
        # the weight of each is its step times e^(−age/window), with its age at the end of the batch
        age_s = np.sum(steps) - np.cumsum(steps)
        weights = (steps * np.exp(-age_s / WINDOW_S))[used]
        v, u = v[used], u[used]
        fade = math.exp(-float(np.sum(steps)) / WINDOW_S)
        columns = np.stack([np.ones(len(v)), v.real, v.imag, np.abs(v) ** 2 / 2])
        implied = np.stack([np.ones(len(v)), u.real, u.imag, np.abs(u) ** 2])
        moments, of_wind = self._sums
        self._sums = fade * moments + (weights * columns) @ columns.T, fade * of_wind + implied @ weights
        return float(self._sums[1][0])

    def _judge(self, fit: _Fit, passed_s: float, airspeed_mps: float, wind: WindFilter) -> None:
        """Set `disbelieved` by a fit, `passed_s` [s] after the last judgement; restart `wind` where it becomes so."""
        square = airspeed_mps**2
        # scatter and mean of the implied wind, as multiples of their limits
        scatter = fit.scatter / max(MAX_SCATTER * square, MAX_GUSTS * fit.residual)
        speed = math.hypot(*fit.implied_mps) / (MAX_WIND * airspeed_mps)
        if not self.disbelieved:
            if scatter > 1 or speed > 1:
                self.disbelieved, self._fits_s = True, 0.0
                wind.restart(fit.circle_mps, WIND_STD_MPS)
            return
        # disbelieved: believed again once it has fit for RESTORE_S; time without a turn shows nothing
        fits = scatter < RESTORE_SHARE and speed < RESTORE_SHARE
        if not fits:
            self._fits_s = 0.0
        elif fit.velocity > TURNED_SHARE * square:
            self._fits_s += passed_s
        self.disbelieved = self._fits_s < RESTORE_S


def _fit(sums: _Moments) -> _Fit:
    """Both estimates of the wind, and how well they fit, by the moments."""
    moments, of_wind = sums
    total = moments[0, 0]
    mean = moments[0] / total
    # covariance of (1, vx, vy, |v|²/2)
    covariance = moments / total - np.outer(mean, mean)
    _, ux, uy, squared = of_wind / of_wind[0]
    # |v|²/2 = w·v + ½(s² − |w|²): a line in v, whose slope is w
    w = np.linalg.solve(covariance[1:3, 1:3] + RIDGE_M2PS2 * np.eye(2), covariance[1:3, 3])
    velocity_var = covariance[1, 1] + covariance[2, 2]
    # s² = E |v − w|²
    radius_squared = max(velocity_var + float(np.sum((mean[1:3] - w) ** 2)), 1e-9)
    # var (|v|²/2 − w·v), what the line leaves
    line_var = max(covariance[3, 3] - float(w @ covariance[1:3, 3]), 0.0)
    # ½(|v − w|² − s²) is about s times a gust's component along v − w, so that line_var/s² is the variance of one of
    # the two components of gusts
    residual = 2 * line_var / radius_squared
    return _Fit(
        scatter=squared - ux * ux - uy * uy,  # E |u|² − |E u|²
        velocity=velocity_var,
        residual=residual,
        implied_mps=(ux, uy),
        circle_mps=(float(w[0]), float(w[1])),
    )


MEASURED_WIND_S = 60.0
"""How long a measured wind is used [s]."""


class FlightWind:
    """The wind of a flight; see the module.

    Attributes
    ----------
    headings : HeadingGate
        Whether headings are believed.
    """

    def __init__(self, gust_time_s: float) -> None:
        self.headings = HeadingGate()
        self._filter = WindFilter(gust_time_s)
        self._measured: tuple[Point, float] | None = None  # [m/s], and until when it is used [s]

    def forecast(self, wind_mps: Point) -> None:
        """Plan with the wind of a weather forecast [m/s], until another one is measured."""
        self._measured = wind_mps, math.inf

    def measure(self, wind_mps: Point, time_s: float) -> None:
        """Plan with a measured wind [m/s], for `MEASURED_WIND_S` from a time on [s]."""
        self._measured = wind_mps, time_s + MEASURED_WIND_S

    def ingest(self, readings: WindReadings, time_s: float) -> None:
        """Update the estimate with readings, columns that are arrays; also while another wind is used.

        `time_s` is the time of the last one [s].
        """
        believed = self.headings.ingest(readings, self._filter)
        if self._measured is not None and time_s > self._measured[1]:
            self._measured = None
        moving = np.asarray(readings.steps_s) > 0
        self._filter.ingest(WindReadings(*(np.asarray(column)[moving] for column in believed)))

    @property
    def mps(self) -> Point:
        """The wind to plan with [m/s]."""
        return self._filter.wind_mps if self._measured is None else self._measured[0]

    @property
    def gust_std_mps(self) -> float:
        """Standard deviation of gusts, of each component [m/s]."""
        return self._filter.gust_std_mps

    @property
    def known(self) -> WindKnown:
        """The wind, and how well it is known."""
        covariance = self._filter.covariance if self._measured is None else (0.0, 0.0, 0.0)
        return WindKnown(self.mps, covariance, self.gust_std_mps)

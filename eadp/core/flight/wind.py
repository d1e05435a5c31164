"""Wind triangle: ground speed and bank in wind; wind estimation from ground velocity.

Directions are of motion over ground, wind is the motion of the air: a wind along the direction of flight is a tailwind.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import jitted
from eadp.core.flight.guidance import GRAVITY_MPS2
from eadp.core.geometry.curves import Point

INITIAL_STD_MPS = 10.0
"""Initial standard deviation of each wind component."""

DRIFT_M2PS3 = 0.5**2 / 300
"""Random-walk intensity of the mean wind: half a metre per second in five minutes."""

GUST_TIME_S = 5.0
"""Correlation time of gusts, unless it is known [s]."""

INITIAL_GUST_MPS, MIN_GUST_MPS = 1.0, 0.02
BEND = 10.0
"""Weight of the linearisation error of a reading without a heading as noise: it does not average out."""

FORGET_S = 60.0
"""Averaging time of the gusts' variance."""


def ground_speeds_mps(
    cosine: FloatArray, sine: FloatArray, airspeed_mps: float | FloatArray, wind_mps: tuple[Any, Any]
) -> tuple[FloatArray, FloatArray]:
    """Speed over ground of an aircraft that holds courses in a wind by crabbing.

    Parameters
    ----------
    cosine, sine : array, shape (n,)
        Directions of the courses.
    airspeed_mps : float, or array of shape (n,)
        Airspeed s [m/s].
    wind_mps : (float, float)
        Wind w [m/s].

    Returns
    -------
    speeds, along : array, shape (n,)
        Ground speed w∥ + √(s² − w⊥²) [m/s], 0 or less where the course cannot be held or does not lead forward; and the
        airspeed's part along the course [m/s].

    Source: wind triangle.
    """
    # w∥ = w·t, w⊥ = w × t
    tail = wind_mps[0] * cosine + wind_mps[1] * sine
    cross = wind_mps[0] * sine - wind_mps[1] * cosine
    along = np.sqrt(np.maximum(airspeed_mps**2 - cross**2, 0.0))
    speeds: FloatArray = np.where(np.abs(cross) < airspeed_mps, tail + along, 0.0)
    return speeds, along


def squared_bank_slopes(
    curvature_per_m: FloatArray, speeds_mps: FloatArray, along_mps: FloatArray, airspeed_mps: float | FloatArray
) -> FloatArray:
    """tan² φ = n² − 1 of the bank that holds a curved course in wind.

    Parameters
    ----------
    curvature_per_m : array, shape (n,)
        Curvature κ of the course [1/m], 0 for a line.
    speeds_mps, along_mps : array, shape (n,)
        As `ground_speeds_mps` returns.
    airspeed_mps : float, or array of shape (n,)
        s [m/s].

    Source: coordinated turn, tan φ = s θ̇/g; the heading turns ‖ṗ‖/(s cos(θ − χ)) times as fast as the course.
    """
    # χ̇ = κ v,  θ̇ = χ̇ v / (s cos(θ − χ)),  tan φ = s θ̇ / g
    turn = curvature_per_m * speeds_mps * speeds_mps / np.maximum(along_mps, 1e-3 * airspeed_mps)
    slopes: FloatArray = (airspeed_mps * turn / GRAVITY_MPS2) ** 2
    return slopes


class WindEstimate(NamedTuple):
    """Mean wind [m/s], variances of its components and their covariance [m²/s²]."""

    x_mps: float
    y_mps: float
    var_x: float
    var_y: float
    cov_xy: float


class Gusts(NamedTuple):
    """Variance of the gusts [m²/s²], and for how long they have been observed [s]."""

    variance: float
    seen_s: float


class WindState(NamedTuple):
    """State of `WindFilter`."""

    wind: WindEstimate
    gusts: Gusts


class WindFilter:
    """Kalman filter of the mean wind from velocity over ground, and heading where it is known.

    With a heading, v − s(cos θ, sin θ) measures the wind. Without one, ‖v − w‖ = s, linearised, measures its component
    along the air velocity: courses in several directions determine both components. Gusts are noise with a correlation
    time, so that the weight of a reading is its share of that time.

    Parameters
    ----------
    gust_time_s : float
        Correlation time of gusts [s].

    Source: Kalman filter of a random walk; wind triangle.
    """

    def __init__(self, gust_time_s: float = GUST_TIME_S) -> None:
        self._gust_time_s = gust_time_s
        self.restart((0.0, 0.0), INITIAL_STD_MPS)

    def restart(self, wind_mps: Point, std_mps: float) -> None:
        """Start again from a wind [m/s] and the standard deviation of its components [m/s]."""
        wind = WindEstimate(*wind_mps, std_mps**2, std_mps**2, 0.0)
        self._state = WindState(wind, Gusts(INITIAL_GUST_MPS**2, 0.0))

    @property
    def wind_mps(self) -> Point:
        """Estimate [m/s]."""
        return self._state.wind.x_mps, self._state.wind.y_mps

    @property
    def gust_std_mps(self) -> float:
        """Standard deviation of the gusts [m/s]."""
        return math.sqrt(self._state.gusts.variance)

    @property
    def covariance(self) -> tuple[float, float, float]:
        """Variances of both components and their covariance [m²/s²]."""
        wind = self._state.wind
        return wind.var_x, wind.var_y, wind.cov_xy

    def ingest(
        self, vx_mps: Column, vy_mps: Column, headings_rad: Column, steps_s: Column, airspeeds_mps: Column
    ) -> None:
        """Take readings in order.

        Parameters
        ----------
        vx_mps, vy_mps : sequence of float or array, shape (n,)
            Velocities over ground [m/s]; NaN is no reading.
        headings_rad : sequence of float or array, shape (n,)
            Headings [rad]; NaN where it is not known.
        steps_s : sequence of float or array, shape (n,)
            Times since the last reading [s].
        airspeeds_mps : sequence of float or array, shape (n,)
            s [m/s].
        """
        ingested = jitted(_ingested)
        readings = columns(vx_mps, vy_mps, headings_rad, steps_s, airspeeds_mps)
        self._state = ingested(self._state, self._gust_time_s, *readings)


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(
    state: WindState,
    gust_time_s: float,
    vx_mps: Column,
    vy_mps: Column,
    headings_rad: Column,
    steps_s: Column,
    airspeeds_mps: Column,
) -> WindState:
    """See `WindFilter.ingest`."""
    for i in range(len(steps_s)):
        vx, vy, heading_rad, step_s = vx_mps[i], vy_mps[i], headings_rad[i], max(steps_s[i], 1e-3)
        airspeed_mps = airspeeds_mps[i]
        if math.isnan(vx + vy):
            continue
        wind, gusts = state
        drift = DRIFT_M2PS3 * step_s
        wind = WindEstimate(wind.x_mps, wind.y_mps, wind.var_x + drift, wind.var_y + drift, wind.cov_xy)
        if math.isnan(heading_rad):
            wind, gusts = _without_heading(wind, gusts, vx, vy, airspeed_mps, step_s, gust_time_s)
        else:
            # v − s (cos θ, sin θ) measures w
            ex = vx - airspeed_mps * math.cos(heading_rad) - wind.x_mps
            ey = vy - airspeed_mps * math.sin(heading_rad) - wind.y_mps
            wind, gusts = _with_heading(wind, gusts, ex, ey, step_s, gust_time_s)
        state = WindState(wind, gusts)
    return state


def _with_heading(
    wind: WindEstimate, gusts: Gusts, ex: float, ey: float, step_s: float, gust_time_s: float
) -> tuple[WindEstimate, Gusts]:
    """Wind and gusts after a reading with a heading, which shows both components with errors [m/s]."""
    noise = gusts.variance * max(1.0, 2 * gust_time_s / step_s)
    before = wind.y_mps
    wind = _corrected(wind, 1.0, 0.0, ex, noise)
    # the second component's error, after the first one's correction
    wind = _corrected(wind, 0.0, 1.0, ey - (wind.y_mps - before), noise)
    squared = (ex * ex + ey * ey) / 2
    return wind, _gusts_after(gusts, squared, wind.var_x + wind.var_y, step_s, step_s, gust_time_s)


def _without_heading(
    wind: WindEstimate, gusts: Gusts, vx: float, vy: float, airspeed_mps: float, step_s: float, gust_time_s: float
) -> tuple[WindEstimate, Gusts]:
    """Wind and gusts after a reading without a heading."""
    ax, ay = vx - wind.x_mps, vy - wind.y_mps
    air = math.sqrt(ax * ax + ay * ay)
    if air < 0.1 * airspeed_mps:
        return wind, gusts
    # h(w) = ‖v − w‖, ∂h/∂w = −(v − w)/‖v − w‖; second order across it: ½ d⊥²/‖v − w‖ of the error's component across
    hx, hy = -ax / air, -ay / air
    along = hx * hx * wind.var_x + 2 * hx * hy * wind.cov_xy + hy * hy * wind.var_y
    across = hy * hy * wind.var_x - 2 * hx * hy * wind.cov_xy + hx * hx * wind.var_y
    error = airspeed_mps - air - across / (2 * air)
    bent = across * across / (2 * air * air)  # the bend's variance, the same in every reading
    repeats = max(1.0, 2 * gust_time_s / step_s)
    wind = _corrected(wind, hx, hy, error, gusts.variance * repeats + BEND * bent * repeats)
    independent_s = gusts.variance / (gusts.variance + along + bent) * step_s
    return wind, _gusts_after(gusts, error * error, along + bent, independent_s, step_s, gust_time_s)


def _corrected(wind: WindEstimate, hx: float, hy: float, error: float, noise: float) -> WindEstimate:
    """Wind after a reading of its part along h that is off by `error` [m/s], of variance `noise` [m²/s²]."""
    # S = h P hᵀ + R,  K = P hᵀ/S,  w ← w + K e,  P ← P − K h P
    gx, gy = wind.var_x * hx + wind.cov_xy * hy, wind.cov_xy * hx + wind.var_y * hy
    innovation = hx * gx + hy * gy + noise
    kx, ky = gx / innovation, gy / innovation
    return WindEstimate(
        wind.x_mps + kx * error,
        wind.y_mps + ky * error,
        max(wind.var_x - kx * gx, 1e-12),
        max(wind.var_y - ky * gy, 1e-12),
        wind.cov_xy - kx * gy,
    )


def _gusts_after(
    gusts: Gusts, squared: float, of_wind: float, counted_s: float, step_s: float, gust_time_s: float
) -> Gusts:
    """Gusts after an innovation squared, which has the variance of the wind estimate in it [m²/s²].

    The initial estimate of the variance fades as readings come in.
    """
    seen_s = gusts.seen_s + step_s
    share = min(1.0, counted_s / min(FORGET_S, seen_s + 2 * gust_time_s))
    variance = gusts.variance + share * (max(squared - of_wind, 0.0) - gusts.variance)
    return Gusts(max(variance, MIN_GUST_MPS**2), seen_s)

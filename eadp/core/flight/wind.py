"""Wind triangle: ground speed and bank in wind; wind estimation from ground velocity.

Directions are of motion over ground, wind is the motion of the air: a wind along the direction of flight is a tailwind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.compiled import enabled, jitted
from eadp.core.flight.aerodynamics import GRAVITY_MPS2
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
    cosine: FloatArray, sine: FloatArray, airspeed_mps: float | FloatArray, wind_mps: Point
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


class WindFilter:
    """Kalman filter of the mean wind from velocity over ground, and heading where it is known.

    With a heading, v − s(cos θ, sin θ) measures the wind. Without one, ‖v − w‖ = s, linearised, measures its component
    along the air velocity: courses in several directions determine both components. Gusts are noise with a correlation
    time, so that the weight of a reading is its share of that time.

    Parameters
    ----------
    airspeed_mps : float
        s [m/s]; may be changed.
    gust_time_s : float
        Correlation time of gusts [s].

    Source: Kalman filter of a random walk; wind triangle.
    """

    def __init__(self, airspeed_mps: float, gust_time_s: float = GUST_TIME_S) -> None:
        self.airspeed_mps, self._gust_time_s = airspeed_mps, gust_time_s
        self._state: _WindState = (0.0, 0.0, INITIAL_STD_MPS**2, INITIAL_STD_MPS**2, 0.0, INITIAL_GUST_MPS**2, 0.0)

    def restart(self, wind_mps: Point, std_mps: float) -> None:
        """Start again from a wind [m/s] and the standard deviation of its components [m/s]."""
        self._state = (*wind_mps, std_mps**2, std_mps**2, 0.0, INITIAL_GUST_MPS**2, 0.0)

    @property
    def wind_mps(self) -> Point:
        """Estimate [m/s]."""
        return self._state[:2]

    @property
    def gust_std_mps(self) -> float:
        """Standard deviation of the gusts [m/s]."""
        return math.sqrt(self._state[5])

    @property
    def covariance(self) -> tuple[float, float, float]:
        """Variances of both components and their covariance [m²/s²]."""
        return self._state[2:5]

    def observe(self, velocity_mps: Point, heading_rad: float | None, step_s: float) -> None:
        """Take a reading, `step_s` [s] after the last one."""
        heading = math.nan if heading_rad is None else heading_rad
        self._state = jitted(_updated, _corrected, _gust_variance)(
            self._state, self.airspeed_mps, self._gust_time_s, *velocity_mps, heading, step_s
        )

    def observe_batch(
        self, vx_mps: Sequence[float], vy_mps: Sequence[float], headings_rad: Sequence[float], steps_s: Sequence[float]
    ) -> None:
        """Take readings in order, each `steps_s` [s] after the one before; NaN is no reading."""
        columns: list[Sequence[float] | FloatArray] = [vx_mps, vy_mps, headings_rad, steps_s]
        if enabled():
            columns = [np.asarray(values) for values in columns]
        self._state = jitted(_batch_updated, _updated, _corrected, _gust_variance)(
            self._state, self.airspeed_mps, self._gust_time_s, *columns
        )


_WindState = tuple[float, float, float, float, float, float, float]
"""Wind [m/s]; variances of both components and their covariance, and the gusts' variance [m²/s²]; time observed [s]."""


# The functions below may be compiled, see `eadp.core.compiled`.


def _batch_updated(
    state: _WindState,
    airspeed_mps: float,
    gust_time_s: float,
    vx_mps: Sequence[float] | FloatArray,
    vy_mps: Sequence[float] | FloatArray,
    headings_rad: Sequence[float] | FloatArray,
    steps_s: Sequence[float] | FloatArray,
) -> _WindState:
    for i in range(len(steps_s)):
        state = _updated(state, airspeed_mps, gust_time_s, vx_mps[i], vy_mps[i], headings_rad[i], steps_s[i])
    return state


def _updated(
    state: _WindState,
    airspeed_mps: float,
    gust_time_s: float,
    vx: float,
    vy: float,
    heading_rad: float,
    step_s: float,
) -> _WindState:
    """The state after a reading; without a velocity unchanged. The heading may be NaN."""
    if math.isnan(vx + vy):
        return state
    wx, wy, pxx, pyy, pxy, gusts, seen_s = state
    step_s = max(step_s, 1e-3)
    pxx += DRIFT_M2PS3 * step_s
    pyy += DRIFT_M2PS3 * step_s
    noise = gusts * max(1.0, 2 * gust_time_s / step_s)
    if not math.isnan(heading_rad):
        ex = vx - airspeed_mps * math.cos(heading_rad) - wx
        ey = vy - airspeed_mps * math.sin(heading_rad) - wy
        before = wy
        wx, wy, pxx, pyy, pxy = _corrected(wx, wy, pxx, pyy, pxy, 1.0, 0.0, ex, noise)
        # the second component's error, after the first one's correction
        wx, wy, pxx, pyy, pxy = _corrected(wx, wy, pxx, pyy, pxy, 0.0, 1.0, ey - (wy - before), noise)
        gusts, seen_s = _gust_variance(gusts, seen_s, (ex * ex + ey * ey) / 2, pxx + pyy, step_s, step_s, gust_time_s)
        return wx, wy, pxx, pyy, pxy, gusts, seen_s
    ax, ay = vx - wx, vy - wy
    air = math.sqrt(ax * ax + ay * ay)
    if air < 0.1 * airspeed_mps:
        return wx, wy, pxx, pyy, pxy, gusts, seen_s
    # h(w) = ‖v − w‖, ∂h/∂w = −(v − w)/‖v − w‖; second order across it: ½ d⊥²/‖v − w‖ of the error's component across
    hx, hy = -ax / air, -ay / air
    along = hx * hx * pxx + 2 * hx * hy * pxy + hy * hy * pyy
    across = hy * hy * pxx - 2 * hx * hy * pxy + hx * hx * pyy
    error = airspeed_mps - air - across / (2 * air)
    bent = across * across / (2 * air * air)  # the bend's variance, the same in every reading
    bend = BEND * bent * max(1.0, 2 * gust_time_s / step_s)
    wx, wy, pxx, pyy, pxy = _corrected(wx, wy, pxx, pyy, pxy, hx, hy, error, noise + bend)
    independent_s = gusts / (gusts + along + bent) * step_s
    gusts, seen_s = _gust_variance(gusts, seen_s, error * error, along + bent, independent_s, step_s, gust_time_s)
    return wx, wy, pxx, pyy, pxy, gusts, seen_s


def _corrected(
    wx: float, wy: float, pxx: float, pyy: float, pxy: float, hx: float, hy: float, error: float, noise: float
) -> tuple[float, float, float, float, float]:
    """Wind and its covariance after a reading of its part along h that is off by `error`."""
    gx, gy = pxx * hx + pxy * hy, pxy * hx + pyy * hy
    innovation = hx * gx + hy * gy + noise
    kx, ky = gx / innovation, gy / innovation
    return wx + kx * error, wy + ky * error, max(pxx - kx * gx, 1e-12), max(pyy - ky * gy, 1e-12), pxy - kx * gy


def _gust_variance(
    gusts: float, seen_s: float, squared: float, state: float, counted_s: float, step_s: float, gust_time_s: float
) -> tuple[float, float]:
    """The gusts' variance and the time observed after an innovation, less the variance of the wind estimate.

    The initial estimate of the variance fades as readings come in.
    """
    seen_s += step_s
    share = min(1.0, counted_s / min(FORGET_S, seen_s + 2 * gust_time_s))
    gusts += share * (max(squared - state, 0.0) - gusts)
    return max(gusts, MIN_GUST_MPS**2), seen_s

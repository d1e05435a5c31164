"""Wind: how fast a path is flown in it, and what flight itself tells of it.

Directions are of motion over ground, wind is the motion of the air: a wind along the direction of flight is a tailwind.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from eadp.core.aerodynamics import GRAVITY_MPS2
from eadp.core.geometry import Point

FloatArray = NDArray[np.float64]

FIRST_STD_MPS = 10.0
"""Standard deviation of each component of a wind that nothing is known of."""

DRIFT_M2PS3 = 0.5**2 / 300
"""How fast a mean wind changes: by half a metre per second in five minutes."""

GUST_TIME_S = 5.0
"""How long a gust stays: readings within this time tell the same."""

FIRST_GUST_MPS, LEAST_GUST_MPS = 1.0, 0.02
BEND = 10.0
"""How much more than its variance the bend of a reading without a heading counts as noise: it does not average out."""

FORGET_S = 60.0
"""Over how long the spread of the gusts is taken."""


def ground_speeds_mps(
    cosine: FloatArray, sine: FloatArray, airspeed_mps: float, wind_mps: Point
) -> tuple[FloatArray, FloatArray]:
    """Speed over ground of an aircraft that holds courses in a wind by crabbing.

    Parameters
    ----------
    cosine, sine : array, shape (n,)
        Directions of the courses.
    airspeed_mps : float
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
    curvature_per_m: FloatArray, speeds_mps: FloatArray, along_mps: FloatArray, airspeed_mps: float
) -> FloatArray:
    """tan² φ = n² − 1 of the bank that holds a curved course in wind.

    Parameters
    ----------
    curvature_per_m : array, shape (n,)
        Curvature κ of the course [1/m], 0 for a line.
    speeds_mps, along_mps : array, shape (n,)
        As `ground_speeds_mps` returns.
    airspeed_mps : float
        s [m/s].

    Source: coordinated turn, tan φ = s θ̇/g; the heading turns ‖ṗ‖/(s cos(θ − χ)) times as fast as the course.
    """
    # χ̇ = κ v,  θ̇ = χ̇ v / (s cos(θ − χ)),  tan φ = s θ̇ / g
    turn = curvature_per_m * speeds_mps * speeds_mps / np.maximum(along_mps, 1e-3 * airspeed_mps)
    slopes: FloatArray = (airspeed_mps * turn / GRAVITY_MPS2) ** 2
    return slopes


class WindFilter:
    """Mean wind from velocity over ground, and heading where it is known.

    With a heading, v − s(cos θ, sin θ) is a reading of the wind. Without one, that ‖v − w‖ = s is, of its part along
    the air velocity, linearised: courses in several directions tell both parts. Gusts are noise that stays for
    `GUST_TIME_S`, so that a reading counts for as little as its share of that time.

    Parameters
    ----------
    airspeed_mps : float
        s [m/s].

    Attributes
    ----------
    wind_mps : (float, float)
        Estimate [m/s].
    gust_std_mps : float
        Spread of the readings about it [m/s].

    Source: Kalman filter of a random walk; wind triangle.
    """

    def __init__(self, airspeed_mps: float) -> None:
        self._s = airspeed_mps
        self.wind_mps: Point = (0.0, 0.0)
        self._pxx = self._pyy = FIRST_STD_MPS**2
        self._pxy = 0.0
        self._gust_var = FIRST_GUST_MPS**2
        self._seen_s = 0.0

    @property
    def gust_std_mps(self) -> float:
        """Spread of the readings [m/s]."""
        return math.sqrt(self._gust_var)

    @property
    def covariance(self) -> tuple[float, float, float]:
        """Variances of both components and their covariance [m²/s²]."""
        return self._pxx, self._pyy, self._pxy

    def observe(self, velocity_mps: Point, heading_rad: float | None, step_s: float) -> None:
        """Take a reading, `step_s` [s] after the last one."""
        step_s = max(step_s, 1e-3)
        drift = DRIFT_M2PS3 * step_s
        self._pxx += drift
        self._pyy += drift
        noise = self._gust_var * max(1.0, 2 * GUST_TIME_S / step_s)
        vx, vy = velocity_mps
        wx, wy = self.wind_mps
        if heading_rad is not None:
            ex = vx - self._s * math.cos(heading_rad) - wx
            ey = vy - self._s * math.sin(heading_rad) - wy
            self._correct(1.0, 0.0, ex, noise)
            # the second component's error, after the first one's correction
            self._correct(0.0, 1.0, ey - (self.wind_mps[1] - wy), noise)
            self._spread((ex * ex + ey * ey) / 2, self._pxx + self._pyy, step_s, step_s)
            return
        ax, ay = vx - wx, vy - wy
        air = math.hypot(ax, ay)
        if air < 0.1 * self._s:
            return
        # h(w) = ‖v − w‖, ∂h/∂w = −(v − w)/‖v − w‖; across it h bends: ½ d⊥²/‖v − w‖ of the error's part across
        hx, hy = -ax / air, -ay / air
        along = hx * hx * self._pxx + 2 * hx * hy * self._pxy + hy * hy * self._pyy
        across = hy * hy * self._pxx - 2 * hx * hy * self._pxy + hx * hx * self._pyy
        error = self._s - air - across / (2 * air)
        bent = across * across / (2 * air * air)  # the bend's variance, the same in every reading
        self._correct(hx, hy, error, noise + BEND * bent * max(1.0, 2 * GUST_TIME_S / step_s))
        told = self._gust_var / (self._gust_var + along + bent)
        self._spread(error * error, along + bent, told * step_s, step_s)

    def _correct(self, hx: float, hy: float, error: float, noise: float) -> None:
        gx, gy = self._pxx * hx + self._pxy * hy, self._pxy * hx + self._pyy * hy
        innovation = hx * gx + hy * gy + noise
        kx, ky = gx / innovation, gy / innovation
        self.wind_mps = (self.wind_mps[0] + kx * error, self.wind_mps[1] + ky * error)
        self._pxx = max(self._pxx - kx * gx, 1e-12)
        self._pyy = max(self._pyy - ky * gy, 1e-12)
        self._pxy -= kx * gy

    def _spread(self, squared: float, known: float, counted_s: float, step_s: float) -> None:
        """Forget the first estimate of the spread as readings come, less what the wind itself is not known by."""
        self._seen_s += step_s
        share = min(1.0, counted_s / min(FORGET_S, self._seen_s + 2 * GUST_TIME_S))
        self._gust_var += share * (max(squared - known, 0.0) - self._gust_var)
        self._gust_var = max(self._gust_var, LEAST_GUST_MPS**2)

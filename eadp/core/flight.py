"""Wind and battery as pure functions: the wind triangle and filter, the drain of the charge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import jitted
from eadp.core.geometry.curves import Point
from eadp.core.guidance import GRAVITY_MPS2

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


class WindReadings(NamedTuple):
    """Readings in order that show the wind, each a column of shape (n,).

    Attributes
    ----------
    vx_mps, vy_mps : sequence of float or array
        Velocities over ground [m/s]; NaN is no reading.
    headings_rad : sequence of float or array
        Directions of the nose, 0 east, counter-clockwise [rad]; NaN where it is not known.
    steps_s, airspeeds_mps : sequence of float or array
        Times since the last reading [s]; airspeeds s [m/s].
    """

    vx_mps: Column
    vy_mps: Column
    headings_rad: Column
    steps_s: Column
    airspeeds_mps: Column


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

    def ingest(self, readings: WindReadings) -> None:
        """Take readings in order."""
        self._state = jitted(_ingested)(self._state, self._gust_time_s, WindReadings(*columns(*readings)))


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(state: WindState, gust_time_s: float, readings: WindReadings) -> WindState:
    """See `WindFilter.ingest`."""
    vx_mps, vy_mps, headings_rad, steps_s, airspeeds_mps = readings
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
    noise = gusts.variance * repeats + BEND * bent * repeats
    wind = _corrected(wind, hx, hy, error, noise)
    squared, of_wind = error * error, along + bent
    counted_s = gusts.variance / (gusts.variance + along + bent) * step_s
    return wind, _gusts_after(gusts, squared, of_wind, counted_s, step_s, gust_time_s)


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


def drain_per_s(power_w: Any, voltage_v: Any, resistance_ohm: float, per_as: float) -> Any:
    """Rate of discharge under powers, without an error beyond the deliverable power: for forecasts.

    It may be compiled for numbers. On numbers in plain Python numpy's functions take 0.9 µs, those of `math` 0.2.

    Parameters
    ----------
    power_w, voltage_v : float or array
        Power at the terminals [W], open-circuit voltage [V], of shapes that go together.
    resistance_ohm : float
        Inner resistance [Ω].
    per_as : float
        State of charge that an ampere takes in a second, k_b / Q_c [1/(A s)]; 1 for the current [A].

    Returns
    -------
    float or array
        −ḃ [1/s]; beyond what can be delivered it is large.

    Source: letter, Eq. 22 and Lem. III.3, ḃ = −k_b I(y)/Q_c; a perfect battery has k_b = 1/3600 per second.
    """
    # I = (V − √(V² − 4 R y)) / 2R, multiplied out so that R → 0 gives y/V;  −ḃ = k_b I / Q_c
    return per_as * 2 * power_w / (voltage_v + _root_v(power_w, voltage_v, resistance_ohm))


def current_slope_a_per_w(power_w: Any, voltage_v: Any, resistance_ohm: float) -> Any:
    """dI/dy of the current [A/W] at a power [W] and an open-circuit voltage [V], numbers or arrays: 1/√(V² − 4 R y).

    At most 10/V, for forecasts: it is infinite at the largest power that can be delivered.

    Source: derivative of letter, Eq. 22.
    """
    return 1.0 / np.maximum(_root_v(power_w, voltage_v, resistance_ohm), 0.1 * voltage_v)


def _root_v(power_w: Any, voltage_v: Any, resistance_ohm: float) -> Any:
    """√(V² − 4 R y) [V]; 0 beyond what can be delivered."""
    return np.sqrt(np.maximum(voltage_v * voltage_v - 4 * resistance_ohm * power_w, 0.0))


def interpolated(soc: Any, values: Sequence[float]) -> Any:
    """Values of states of charge, a number or an array, among those at even steps of it; held at its ends."""
    return np.interp(soc, np.linspace(0.0, 1.0, len(values)), values)


def level(soc: float, curve: Column) -> float:
    """Place of the open-circuit voltage between that of the empty battery, 0, and that of the full one, 1.

    It may be compiled.

    Parameters
    ----------
    soc : float
        State of charge, 0 to 1.
    curve : sequence of float
        Places at even steps of the charge, straight between them; empty where the voltage is linear in the charge.
    """
    if len(curve) == 0:
        return soc
    last = len(curve) - 2
    i = min(int(soc * (last + 1)), last)
    return curve[i] + (curve[i + 1] - curve[i]) * (soc * (last + 1) - i)


def max_power_w(voltage_v: Any, resistance_ohm: float, max_current_a: float, cutoff_v: float) -> Any:
    """Largest power that a battery delivers at the terminals.

    Parameters
    ----------
    voltage_v : float or array
        Open-circuit voltage [V].
    resistance_ohm : float
        Inner resistance [Ω].
    max_current_a : float
        Largest discharge current [A]; infinite for none.
    cutoff_v : float
        Least voltage at the terminals [V]; 0 for none.

    Returns
    -------
    float or array
        V I − R I² at the largest current [W]: `max_current_a`, the one of the cut-off voltage (V − V_cut)/R, or V/(2R),
        where the power is greatest.
    """
    drop_v = np.maximum(np.minimum(voltage_v / 2, voltage_v - cutoff_v), 0.0)
    if resistance_ohm == 0:
        return np.where(drop_v > 0, voltage_v * max_current_a, 0.0)
    current = np.minimum(drop_v / resistance_ohm, max_current_a)
    return current * (voltage_v - resistance_ohm * current)


def min_voltage_v(power_w: Any, resistance_ohm: float, max_current_a: float, cutoff_v: float) -> Any:
    """Open-circuit voltage below which a power above 0 [W] is not delivered [V]: the inverse of `max_power_w`."""
    # V = U + R I at I = y/U, where U is at least V_cut, y/I_max and V/2, which is √(R y)
    terminal_v = np.maximum(np.maximum(power_w / max_current_a, cutoff_v), np.sqrt(resistance_ohm * power_w))
    return terminal_v + resistance_ohm * power_w / np.maximum(terminal_v, 1e-12)


def replayed_soc(trace: Sequence[float], time_s: float) -> float:
    """State of charge of a trace at a time [s]: linear between its points, held beyond them.

    Parameters
    ----------
    trace : sequence of float
        Time [s] and charge of each point in turn, times in order; of two at one time the last counts from there on.
    """
    low, high = 0, len(trace) // 2
    while low < high:  # after the last point that is not later
        middle = (low + high) // 2
        if trace[2 * middle] <= time_s:
            low = middle + 1
        else:
            high = middle
    if low == 0:
        return trace[1]
    t0, b0 = trace[2 * low - 2], trace[2 * low - 1]
    if 2 * low == len(trace):
        return b0
    return b0 + (trace[2 * low + 1] - b0) * (time_s - t0) / (trace[2 * low] - t0)

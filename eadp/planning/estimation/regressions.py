"""Online regressions in flight: time against forecast, power in turns, state of charge, parameters flown."""

from __future__ import annotations

import math
from collections.abc import MutableSequence, Sequence

from eadp.core.compiled import jitted, on_numbers
from eadp.core.flight.battery import drain_per_s
from eadp.models.plan.cursor import Vector
from eadp.models.plan.stage import Box

Floats = Sequence[float]
State = MutableSequence[float]

RATIO_STD = 0.02
"""Prior standard deviation of the ratio of flown to forecast time, common to all legs."""

TIME_NOISE_S, TIME_NOISE_LEGS = 0.002, 4
"""Prior variance of a leg's time per second of it [s²/s] without gusts, and its weight in legs."""

TURN_SHARE = 0.3
"""Prior mean and standard deviation of the power per tan² φ, as a share of level flight's: induced drag is about a
third of the drag at cruise."""

LEVEL_SHARE = 0.05
"""Relative prior standard deviation of level flight's power."""

UNKNOWN_W = (1000.0, 30.0)
"""Standard deviations of level flight's power and of a bank's without prior values [W]."""

WINDOW_S, FADE_S = 5.0, 900.0
POWER_SHARE, MIN_POWER_STD_W, PRIOR_WINDOWS = 0.03, 0.2, 3
"""Prior standard deviation of a window's mean power, as a share of the level's and at least [W]; and its weight in
windows."""

JUMP, JUMP_STDS, MIN_JUMP = 0.01, 6.0, 1e-3
"""Innovation, absolute and in standard deviations, beyond which a reading is an outlier; and that of an exact gauge."""

SMALL_JUMP_STDS = 3.0
"""Innovation, in standard deviations, whose excess is charge that was lost."""

SAME_STEPS = 1e-3
"""Part of a step by which the changes of a gauge of steps are off its multiples."""

EXACT_GAUGE, NOISE_SHARE, FIRST_READINGS, FIRST_CHANGES = 1e-8, 0.02, 60, 5
"""Variance below which a gauge is exact; gain of its noise estimate; readings before the variance may shrink freely,
and before a gauge may count as exact."""

RATIO_OF_USE_STD, SLOPE_OF_USE_STD, MAX_USE = 0.03, 0.1, 2.0
"""Prior standard deviations of the ratio of charge used to charge predicted, and of its change with the charge; and
the ratio's greatest value, and its least one's inverse."""

USE_DRIFT, USE_NOISE, UNMEASURED = 0.015, 5e-4, 0.3
"""Standard deviations per √charge: of the ratio's random walk, and of the charge used; and of a drain whose power was
not measured, as a share of it."""

GAUGE_QUANTUM, MAX_QUANTUM, CHECKED_DRAIN, CHECKED_QUANTA, CHECKED_STDS, MIN_FALL = 0.01, 0.1, 0.02, 2.5, 10.0, 0.25
"""Resolution of a gauge until it is seen, and at most; drain over which a gauge is checked, at least, in resolutions
and in standard deviations of its noise; and the least share of it by which it has to fall."""

GAUGE_GAIN_STD = 0.01
"""Standard deviation of a gauge's gain: what it counts of the charge used, less 1. No reading shows it."""


class TimeRatio:
    """Ratio of flown to forecast leg times, and the noise of each.

    A regression through the origin: flown − forecast = β · forecast + noise, whose variance grows with the time.

    Attributes
    ----------
    ratio : float
        1 + β.
    noise_s : float
        Variance of the noise per second [s²/s].

    Source: Bayesian linear regression with a normal prior.
    """

    def __init__(self) -> None:
        self.noise_s = TIME_NOISE_S
        self.ratio = 1.0
        self._forecast_s = self._excess_s = 0.0
        self._legs: list[tuple[float, float]] = []

    def learn(self, forecast_s: float, flown_s: float, gust_std_mps: float, airspeed_mps: float, stay_s: float) -> None:
        """Update with a flown leg.

        Parameters
        ----------
        forecast_s, flown_s : float
            Its forecast and its flown time [s].
        gust_std_mps, airspeed_mps, stay_s : float
            Standard deviation of the gusts, airspeed [m/s] and correlation time of the gusts [s], for the prior noise.
        """
        if not (forecast_s > 0 and math.isfinite(forecast_s)):
            return
        self._legs.append((forecast_s, flown_s))
        self._forecast_s += forecast_s
        self._excess_s += flown_s - forecast_s
        expected = _expected_noise_s(gust_std_mps, airspeed_mps, stay_s)
        beta = self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)
        squares = sum((flown - (1 + beta) * expected_s) ** 2 / expected_s for expected_s, flown in self._legs)
        self.noise_s = (TIME_NOISE_LEGS * expected + squares) / (TIME_NOISE_LEGS + len(self._legs))
        self.ratio = 1.0 + self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def expect(self, gust_std_mps: float, airspeed_mps: float, stay_s: float) -> None:
        """Set the prior noise from forecast gusts, before any leg is flown."""
        self.noise_s = _expected_noise_s(gust_std_mps, airspeed_mps, stay_s)

    @property
    def variance(self) -> float:
        """Variance of the ratio."""
        return self.noise_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def variance_s2(self, remaining_s: float) -> float:
        """Variance of a forecast time [s²]."""
        return remaining_s**2 * self.variance + self.noise_s * remaining_s


def _expected_noise_s(gust_std_mps: float, airspeed_mps: float, stay_s: float) -> float:
    """Variance of a leg's time per second of it [s]."""
    # a gust of σ and correlation time τ moves an aircraft by √(2 τ t) σ metres in t seconds
    return TIME_NOISE_S + 2 * stay_s * (gust_std_mps / airspeed_mps) ** 2


class MotionPower:
    """Regression of the motion power, a + b tan² φ, on means over short windows.

    Windows count as independent, which holds for gusts shorter than one; the noise is estimated from the residuals.
    Information fades over `FADE_S`, so that slow changes are followed.

    Parameters
    ----------
    level_w : float or None
        Prior power of level flight [W].
    level_share : float
        Its standard deviation, as a share of it.

    Source: induced drag grows with the square of the load factor (Anderson 1999); Bayesian linear regression.
    """

    def __init__(self, level_w: float | None, level_share: float = LEVEL_SHARE) -> None:
        level = level_w or 0.0
        stds = (level_share * level, TURN_SHARE * level) if level_w else UNKNOWN_W
        first_noise = WINDOW_S * max(POWER_SHARE * level, MIN_POWER_STD_W) ** 2
        self._prior = (level, TURN_SHARE * level, 1 / stds[0] ** 2, 1 / stds[1] ** 2, first_noise)
        mean, covariance = self._prior[:2], (stds[0] ** 2, 0.0, stds[1] ** 2)
        self._state: list[float] = [0.0, 0.0, *[0.0] * 6, 0.0, first_noise, *mean, *covariance]

    def observe(self, power_w: float, step_s: float, slope: float) -> None:
        """Take a reading of the motion's power [W] over a step [s] on a leg of mean tan² φ `slope`."""
        _observe_motion(self._state, self._prior, power_w, step_s, slope)

    def observe_batch(self, powers_w: Floats, beside_w: Floats, steps_s: Floats, slope: float) -> None:
        """Take readings of power in order, less what is beside the motion's [W], see `observe`; NaN is no reading."""
        observe = jitted(_observe_motions, _observe_motion, _end_window)
        self._state = on_numbers(observe, self._state, self._prior, powers_w, beside_w, steps_s, slope)[1]

    def end_window(self, slope: float) -> None:
        """End a window and update the regression."""
        _end_window(self._state, self._prior, slope)

    @property
    def level_w(self) -> float:
        """a [W]."""
        return self._state[LEVEL_W]

    @property
    def slope_w(self) -> float:
        """b [W], 0 or more."""
        return max(self._state[SLOPE_W], 0.0)

    def energy_variance_j2(self, seconds: float, bank_s: float) -> float:
        """Predictive variance of the energy over a time [s] with ∫ tan² φ dt [s]."""
        aa, ab, bb, noise = self.variances
        return seconds * seconds * aa + 2 * seconds * bank_s * ab + bank_s * bank_s * bb + noise * seconds

    @property
    def variances(self) -> tuple[float, float, float, float]:
        """Covariance of a and b: aa, ab, bb; and the variance of the energy per second beside [J²/s]."""
        aa, ab, bb = self._state[LEVEL_W + 2 :]
        return aa, ab, bb, self._state[WINDOW_NOISE]


ENERGY_J, SECONDS, SUMS, WINDOWS, WINDOW_NOISE, LEVEL_W, SLOPE_W = 0, 1, 2, 8, 9, 10, 11
"""State of `MotionPower`: energy and time of the window; sums over windows, weighted by their time, of 1, x, x², y, xy
and y²; weight of the windows; noise; mean of a and b. Their covariance follows: aa, ab, bb."""

_MotionPrior = tuple[float, float, float, float, float]
"""Means of a and b, their inverse variances, and the noise."""


class ChargeFilter:
    """Kalman filter of the state of charge b: gauge readings against the charge drained by the power.

    The battery uses κ of the drain predicted, and κ changes by s for each charge: an inaccurate capacity, and a voltage
    that falls. Over a predicted drain d

        b ← b − κ d − ½ s d²,  κ ← κ + s d

    and κ drifts. A reading that repeats the last one says nothing: a coarse gauge is read where it changes. There b is
    above the reading by an offset o, up to a step of the gauge: 0 where it rounds up, half where it rounds to the
    nearest. It is a constant state; a battery that starts full shows it. The noise is estimated from differences. Two
    outliers in a row are accepted as a loss, or as the end of a false one. A gauge that falls by less than `MIN_FALL`
    of the drain, over more of it than the gauge resolves, is disbelieved until it agrees with the integral.

    Parameters
    ----------
    voltage_fall : float, optional
        By how much the voltage that predicts the drain falls from full to empty, as a share of its mean.

    Source: Kalman filter.
    """

    def __init__(self, voltage_fall: float = 0.0) -> None:
        self._min_slope = -voltage_fall
        # κ is what is stated at half of the charge: when full, it is less by half of s
        slope = SLOPE_OF_USE_STD**2
        of_ratio = RATIO_OF_USE_STD**2 + slope / 4
        charge = [math.nan, 1.0, 0.0, 0.0, 0.0, 0.0, of_ratio, -slope / 2, slope, 0.0, 0.0, 0.0, 0.0, 0.0]
        gauge = [math.nan, math.nan, 0.0, 1.0, 1.0, GAUGE_QUANTUM, 0.0, 1.0, 0.0, math.nan, 0.0]
        self._state: list[float] = [*charge, 0.0, 0.0, 0.0, 0.0, *gauge, math.nan, 0.0, *charge]
        self._known: Charge | None = None

    @property
    def soc(self) -> float:
        """b."""
        return self._now[0]

    @property
    def variance(self) -> float:
        """Variance of b."""
        return self._now[3]

    @property
    def _now(self) -> Charge:
        """The charge after the drain since the last reading that said something."""
        if self._known is None:
            self._known = after_drain(_charge_of(self._state, 0), self._state[DRAINED])
        return self._known

    @property
    def believed(self) -> bool:
        """Whether the gauge is believed."""
        return self._state[BELIEVED] > 0

    @property
    def rises(self) -> bool:
        """Whether the gauge rose where it was disbelieved."""
        return self._state[RISES] > 0

    def use(self, drain: float) -> tuple[float, float]:
        """Charge that the battery uses for a predicted drain from now on, and the variance of b thereafter.

        The slope has a least value: no voltage rises while the charge falls.

        Source: b ← b − κ d − ½ s d².
        """
        now = self.ahead
        then = after_drain(now, drain)
        return now[0] - then[0], then[3]

    @property
    def ahead(self) -> Charge:
        """The state that `use` starts from."""
        now = self._now
        return (*now[:2], max(now[2], self._min_slope), *now[3:])

    def gain_std(self, soc: float) -> float:
        """Standard deviation of b at a reading, as a gauge that is not exact counts too much or too little."""
        gain_std, first_soc = self.gauge_gain
        return gain_std * max(first_soc - soc, 0.0)

    @property
    def gauge_gain(self) -> tuple[float, float]:
        """Standard deviation of the gauge's gain, and the charge from which on it counts; 0 for an exact gauge."""
        state = self._state
        return (0.0, 0.0) if state[NOISE] < EXACT_GAUGE else (GAUGE_GAIN_STD, state[FIRST])

    def observe(self, reading: float, drained: float, *, measured: bool = True) -> bool:
        """Take a reading, with the charge drained since the last by prediction; return whether some was lost.

        Where its power was not measured, a drain says little of κ.
        """
        self._known = None
        return _observe_charge(self._state, reading, drained, measured)

    def observe_batch(
        self, power_w: float, powers_w: Floats, charges: Floats, steps_s: Floats, longest_s: float, cell: Cell
    ) -> tuple[bool, float]:
        """Take readings in order, with the drain by the power that each comes with; return whether charge was lost.

        Parameters
        ----------
        power_w : float
            The last power known [W].
        powers_w, charges, steps_s : sequence of float, shape (n,)
            Readings of power [W], NaN for none, and of the gauge, and times since the last reading [s].
        longest_s : float
            Time above which a reading's power says little of the drain [s].
        cell : tuple of float
            Voltage when empty and its rise to full [V], resistance [Ω] and k_b/Q_c [1/(A s)].

        Returns
        -------
        jumped : bool
        power_w : float
            The last power known now [W].
        """
        observe = jitted(
            _observe_charges,
            drain_per_s,
            *(_observe_charge, _taken, _see_steps, _check, _charge_of, _put_charge, after_drain, _corrected),
        )
        found: tuple[bool, float]
        self._known = None
        found, self._state = on_numbers(observe, self._state, power_w, powers_w, charges, steps_s, longest_s, cell)
        return found

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the last reading, or a charge not yet taken, may be an outlier: the next reading decides."""
        return self._state[OUTLIERS] > 0 or abs(soc - self.soc) > MIN_JUMP


CHARGES, OFFSET = 14, 9
DRAINED, UNMEASURED_DRAIN, TOTAL_DRAIN, NOISE, LAST, FIRST, OUTLIERS, COUNT, READINGS = range(CHARGES, 23)
QUANTUM, LOST, BELIEVED, RISES, STEP, FULL, CHECKED_READING, CHECKED_TOTAL, CHECKED = range(23, 32)
"""State of `ChargeFilter` after its `CHARGES` numbers of `Charge`, o the first at `OFFSET`: drain since they hold, the
part of it whose power was not measured, and that of the flight; variance of the gauge; last and first reading; outliers
in a row; readings that were another than the last, and all; resolution, at least; charge lost; whether the gauge is
believed, and rose; its step, 0 for none; whether a full battery was its start; reading, drain and charge at the last
check."""

Cell = tuple[float, float, float, float]
Charge = tuple[float, ...]
"""b, κ, s; their covariances bb, bκ, bs, κκ, κs, ss; o, and its covariances bo, κo, so, oo."""


class ParameterAverages:
    """Time integrals of the parameters flown, as shares of their sets, over the time in which each was free."""

    def __init__(self, count: int) -> None:
        self.areas_s = [0.0] * count
        self.times_s = [0.0] * count
        self._since_s = 0.0
        self._held: tuple[Vector, Sequence[Box]] | None = None

    def hold(self, time_s: float, parameters: Vector, sets: Sequence[Box]) -> None:
        """Parameters and sets in force from a time on [s]."""
        if self._held is not None:
            self.times_s, self.areas_s = self.until(time_s)
        self._since_s, self._held = time_s, (parameters, sets)

    def until(self, time_s: float) -> tuple[list[float], list[float]]:
        """Times and areas of shares up to a time [s], the parameters in force included."""
        times, areas = list(self.times_s), list(self.areas_s)
        if self._held is not None and self._held[1]:
            duration = time_s - self._since_s
            for i, (value, box) in enumerate(zip(*self._held, strict=True)):
                share = box.share(value)
                if share is not None:
                    areas[i] += share * duration
                    times[i] += duration
        return times, areas


# The functions below keep to what numba compiles, see `eadp.core.compiled`.


def _observe_motions(
    s: State, prior: _MotionPrior, powers_w: Floats, beside_w: Floats, steps_s: Floats, slope: float
) -> bool:
    for i in range(len(powers_w)):
        if steps_s[i] > 0.0 and not math.isnan(powers_w[i]):
            _observe_motion(s, prior, powers_w[i] - beside_w[i], steps_s[i], slope)
    return True


def _observe_motion(s: State, prior: _MotionPrior, power_w: float, step_s: float, slope: float) -> None:
    s[ENERGY_J] += power_w * step_s
    s[SECONDS] += step_s
    if s[SECONDS] >= WINDOW_S - 1e-9:
        _end_window(s, prior, slope)


def _end_window(s: State, prior: _MotionPrior, slope: float) -> None:
    """End a window of `MotionPower`: the posterior of two unknowns, in closed form."""
    seconds, energy_j = s[SECONDS], s[ENERGY_J]
    s[ENERGY_J] = s[SECONDS] = 0.0
    if seconds < WINDOW_S / 2:
        return
    mean = energy_j / seconds
    kept = math.exp(-seconds / FADE_S)
    new = (1.0, slope, slope * slope, mean, slope * mean, mean * mean)
    for i in range(6):
        s[SUMS + i] = kept * s[SUMS + i] + seconds * new[i]
    s[WINDOWS] = kept * s[WINDOWS] + 1
    n, x, xx, y, xy, yy = s[SUMS], s[SUMS + 1], s[SUMS + 2], s[SUMS + 3], s[SUMS + 4], s[SUMS + 5]
    level, per_slope, of_level, of_slope, first_noise = prior
    noise = s[WINDOW_NOISE]
    a = b = 0.0
    for _ in range(2):
        # (P⁻¹ + X'X/v) (a, b) = P⁻¹ prior + X'y/v
        aa, ab, bb = of_level + n / noise, x / noise, of_slope + xx / noise
        first, second = of_level * level + y / noise, of_slope * per_slope + xy / noise
        determinant = aa * bb - ab * ab
        a, b = (bb * first - ab * second) / determinant, (aa * second - ab * first) / determinant
        # Σ t (y − a − b x)²
        squares = max(yy - 2 * (a * y + b * xy) + a * a * n + 2 * a * b * x + b * b * xx, 0.0)
        noise = (PRIOR_WINDOWS * first_noise + squares) / (PRIOR_WINDOWS + s[WINDOWS])
    aa, ab, bb = of_level + n / noise, x / noise, of_slope + xx / noise
    determinant = aa * bb - ab * ab
    s[WINDOW_NOISE], s[LEVEL_W], s[SLOPE_W] = noise, a, b
    s[LEVEL_W + 2], s[LEVEL_W + 3], s[LEVEL_W + 4] = bb / determinant, -ab / determinant, aa / determinant


def _observe_charges(
    s: State, power_w: float, powers_w: Floats, charges: Floats, steps_s: Floats, longest_s: float, cell: Cell
) -> tuple[bool, float]:
    """See `ChargeFilter.observe_batch`."""
    empty_v, rise_v, resistance_ohm, per_as = cell
    jumped = False
    for i in range(len(charges)):
        measured = not math.isnan(powers_w[i])
        if measured:
            power_w = powers_w[i]
        drained = 0.0
        if not math.isnan(s[LAST]):
            soc = after_drain(_charge_of(s, 0), s[DRAINED])[0]
            volts = empty_v + rise_v * min(max(soc, 0.0), 1.0)
            drained = drain_per_s(power_w, volts, resistance_ohm, per_as) * steps_s[i]
        if _observe_charge(s, charges[i], drained, measured and steps_s[i] <= longest_s):
            jumped = True
    return jumped, power_w


def _observe_charge(s: State, reading: float, drained: float, measured: bool) -> bool:
    """See `ChargeFilter.observe`."""
    if math.isnan(s[LAST]):
        s[LAST] = s[FIRST] = s[0] = s[CHECKED_READING] = s[CHECKED] = reading
        s[FULL] = 1.0 if reading == 1.0 else 0.0
        return False
    s[DRAINED] += drained
    if not measured:
        s[UNMEASURED_DRAIN] += drained
    s[TOTAL_DRAIN] += drained
    s[READINGS] += 1
    fell = s[LAST] - reading
    s[LAST] = reading
    jumped = False
    if fell != 0.0 or s[OUTLIERS] > 0.0 or drained == 0.0:
        jumped = _taken(s, reading, fell, drained)
    _check(s, reading)
    return jumped


def _taken(s: State, reading: float, fell: float, drained: float) -> bool:
    """Update with a reading that is another than the last; return whether charge was lost."""
    s[COUNT] += 1
    since, exact = s[DRAINED], s[NOISE] < EXACT_GAUGE
    if fell != 0.0:
        _see_steps(s, fell, drained)
    b, ratio, slope, bb, bk, bs, kk, ks, ss, offset, bo, ko, so, oo = after_drain(_charge_of(s, 0), since)
    bb += (UNMEASURED * s[UNMEASURED_DRAIN]) ** 2
    # a variance of b is at or above that of the mean of the first readings
    if s[COUNT] <= FIRST_READINGS and s[FULL] == 0.0:
        bb = max(bb, s[NOISE] / (s[COUNT] - 1))
    # a gauge that rises by a step is where it falls to the last reading
    error, variance = reading + offset - (s[STEP] if fell < 0.0 else 0.0) - b, bb - 2 * bo + oo
    size = abs(error)
    if exact and s[READINGS] > 2:
        outlier = size > MIN_JUMP + 10 * since
    else:
        outlier = s[READINGS] > 4 and size > JUMP and size > JUMP_STDS * math.sqrt(variance + s[NOISE])
    if outlier:
        s[OUTLIERS] += 1
        back = s[BELIEVED] > 0 and error <= s[LOST] + MIN_JUMP
        if not ((s[OUTLIERS] > 1 or exact) and (error < 0 or back)):
            return False
        s[BELIEVED], s[FULL] = 1.0, 0.0
        s[LOST] = max(s[LOST] - error, 0.0)
        _put_charge(s, 0, (reading, ratio, slope, s[NOISE], 0.0, 0.0, kk, ks, ss, offset, 0.0, ko, so, oo))
        _put_charge(s, CHECKED, _charge_of(s, 0))
        s[DRAINED] = s[UNMEASURED_DRAIN] = s[OUTLIERS] = 0.0
        s[COUNT] = s[READINGS] = 2.0
        s[CHECKED_READING], s[CHECKED_TOTAL] = reading, s[TOTAL_DRAIN]
        return True
    s[OUTLIERS] = 0.0
    if s[BELIEVED] == 0.0:
        return False
    # a small loss is one of charge, not of capacity; a coarse gauge looks exact before it has changed a few times
    if not exact or s[COUNT] <= FIRST_CHANGES:
        bb += max(0.0, error * error - SMALL_JUMP_STDS**2 * (variance + s[NOISE]))
    if s[UNMEASURED_DRAIN] == 0.0:
        change = ratio * since - fell
        s[NOISE] += max(NOISE_SHARE, 1 / (s[COUNT] - 1)) * (change * change / 2 - s[NOISE])
    s[QUANTUM] = min(max(s[QUANTUM], fell), MAX_QUANTUM)
    state = (b, ratio, slope, bb, bk, bs, kk, ks, ss, offset, bo, ko, so, oo)
    _put_charge(s, 0, _corrected(state, error, s[NOISE]))
    s[DRAINED] = s[UNMEASURED_DRAIN] = 0.0
    return False


def _see_steps(s: State, fell: float, drained: float) -> None:
    """See whether the gauge has steps: its first change is more than the last drain, and the others multiples of it."""
    size, step = abs(fell), s[STEP]
    if math.isnan(step):
        s[STEP] = step = min(size, MAX_QUANTUM) if size > s[1] * drained + MIN_JUMP else 0.0
        s[OFFSET], s[OFFSET + 4] = step / 2, step * step / 12
        if s[FULL] == 0.0:  # the first reading was somewhere on a step: b = reading + o − u, u as uncertain as o
            s[3] += step * step / 6
            s[OFFSET + 1] = step * step / 12
    elif step > 0.0 and abs(size / step - round(size / step)) > SAME_STEPS:
        for i in range(5):
            s[OFFSET + i] = 0.0
        s[STEP] = 0.0


def _check(s: State, reading: float) -> None:
    """Compare what the gauge has fallen by with the drain, now and then; once disbelieved, with the integral."""
    drain = s[TOTAL_DRAIN] - s[CHECKED_TOTAL]
    if drain < max(CHECKED_DRAIN, CHECKED_QUANTA * s[QUANTUM], CHECKED_STDS * math.sqrt(s[NOISE])):
        return
    fell, expected = s[CHECKED_READING] - reading, s[CHECKED + 1] * drain
    falls = MIN_FALL * expected <= fell
    if s[BELIEVED] > 0 and not falls:
        s[BELIEVED], s[RISES] = 0.0, 1.0 if fell < 0 else 0.0
        _put_charge(s, 0, after_drain(_charge_of(s, CHECKED), drain))
        s[DRAINED] = 0.0
    elif falls and fell <= expected / MIN_FALL:
        now = after_drain(_charge_of(s, 0), s[DRAINED])
        far = max(CHECKED_QUANTA * s[QUANTUM], JUMP_STDS * math.sqrt(now[3]))
        if reading <= now[0] + far:
            s[BELIEVED] = 1.0
    _put_charge(s, CHECKED, after_drain(_charge_of(s, 0), s[DRAINED]))
    s[CHECKED_READING], s[CHECKED_TOTAL] = reading, s[TOTAL_DRAIN]


def _charge_of(s: State, at: int) -> Charge:
    b, ratio, slope, bb, bk, bs, kk = s[at], s[at + 1], s[at + 2], s[at + 3], s[at + 4], s[at + 5], s[at + 6]
    ks, ss, offset, bo, ko, so, oo = s[at + 7], s[at + 8], s[at + 9], s[at + 10], s[at + 11], s[at + 12], s[at + 13]
    return b, ratio, slope, bb, bk, bs, kk, ks, ss, offset, bo, ko, so, oo


def _put_charge(s: State, at: int, charge: Charge) -> None:
    for i in range(CHARGES):
        s[at + i] = charge[i]


def after_drain(state: Charge, d: float) -> Charge:
    """The state after a predicted drain d."""
    b, ratio, slope, bb, bk, bs, kk, ks, ss, offset, bo, ko, so, oo = state
    h = d * d / 2
    # F P Fᵀ + Q with F = [[1, −d, −d²/2], [0, 1, d], [0, 0, 1]]
    row_b, row_k, row_s = bb - d * bk - h * bs, bk - d * kk - h * ks, bs - d * ks - h * ss
    drift = USE_DRIFT**2 * d
    return (
        b - ratio * d - slope * h,
        ratio + slope * d,
        slope,
        row_b - d * row_k - h * row_s + USE_NOISE**2 * d + drift * d * d / 3,
        row_k + d * row_s - drift * d / 2,
        row_s,
        kk + 2 * d * ks + d * d * ss + drift,
        ks + d * ss,
        ss,
        offset,
        bo - d * ko - h * so,
        ko + d * so,
        so,
        oo,
    )


def _corrected(state: Charge, error: float, noise: float) -> Charge:
    """The state after a reading of b − o that is off by `error`, of variance `noise`."""
    b, ratio, slope, bb, bk, bs, kk, ks, ss, offset, bo, ko, so, oo = state
    # H P with H = [1, 0, 0, −1]
    of_b, of_k, of_s, of_o = bb - bo, bk - ko, bs - so, bo - oo
    total = max(of_b - of_o + noise, 1e-18)
    gain = 1.0 if noise <= 1e-12 and oo == 0.0 else of_b / total
    k, s, o = of_k / total, of_s / total, of_o / total
    ratio = min(max(ratio + k * error, 1 / MAX_USE), MAX_USE)
    return (
        b + gain * error,
        ratio,
        slope + s * error,
        bb - gain * of_b,
        bk - gain * of_k,
        bs - gain * of_s,
        kk - k * of_k,
        ks - k * of_s,
        ss - s * of_s,
        offset + o * error,
        bo - gain * of_o,
        ko - k * of_o,
        so - s * of_o,
        oo - o * of_o,
    )

"""State of charge in flight: a Kalman filter of gauge readings and of the charge drained by the power."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import jitted
from eadp.core.flight import drain_per_s, level

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

MAX_STEP_S = 10.0
"""Time between readings above which the power in it is not measured [s]."""


class DrainModel(NamedTuple):
    """Battery that predicts the drain: a voltage source, which falls with the charge, behind a resistance.

    Attributes
    ----------
    empty_v, rise_v : float
        Voltage when empty, and its rise to full [V].
    resistance_ohm : float
        Inner resistance [Ω].
    per_as : float
        State of charge that an ampere takes in a second, k_b / Q_c [1/(A s)]; 0 where nothing is drained.
    curve : array
        Places of the voltage between empty and full, see `level`.
    """

    empty_v: float
    rise_v: float
    resistance_ohm: float
    per_as: float
    curve: FloatArray = np.zeros(0)


class Charge(NamedTuple):
    """State and covariance of the Kalman filter: x = (b, κ, s, o) and P, symmetric.

    Attributes
    ----------
    soc : float
        State of charge b.
    use_ratio, use_slope : float
        Charge used per charge predicted, κ, and its change per charge predicted, s.
    offset : float
        Charge above what the gauge reads, o.
    var_soc, ..., var_offset : float
        Their variances and covariances.
    """

    soc: float
    use_ratio: float
    use_slope: float
    var_soc: float
    cov_soc_ratio: float
    cov_soc_slope: float
    var_ratio: float
    cov_ratio_slope: float
    var_slope: float
    offset: float
    cov_soc_offset: float
    cov_ratio_offset: float
    cov_slope_offset: float
    var_offset: float


class Drain(NamedTuple):
    """Charge drained by prediction: since `Charge` holds, the part of it without a measured power, and in all.

    Attributes
    ----------
    since, unmeasured, total : float
    power_w : float
        The last power known [W].
    """

    since: float
    unmeasured: float
    total: float
    power_w: float


class GaugeReadings(NamedTuple):
    """What the filter keeps of the gauge's readings.

    Attributes
    ----------
    first, last : float
        First and last reading; NaN before the first.
    taken, changes : int
        Readings, and those that were another than the one before; both count the first one, and are 2 again after a
        loss.
    outliers : int
        Outliers in a row up to the last reading.
    """

    first: float
    last: float
    taken: int
    changes: int
    outliers: int


class Gauge(NamedTuple):
    """What the readings show of the gauge.

    Attributes
    ----------
    noise_variance : float
    quantum : float
        Resolution, at least.
    step : float
        Its step; 0 where it has none, NaN before its first change.
    from_full : bool
        Whether it started at a full battery and lost nothing.
    """

    noise_variance: float
    quantum: float
    step: float
    from_full: bool


class Belief(NamedTuple):
    """Whether the gauge is believed, and whether it rose when disbelieved last; charge lost in all, and how often."""

    believed: bool
    rises: bool
    lost: float
    losses: int


class Checkpoint(NamedTuple):
    """Reading, drain in all and charge when the gauge was compared with the drain last."""

    reading: float
    total_drain: float
    charge: Charge


class ChargeState(NamedTuple):
    """State of `ChargeFilter`."""

    charge: Charge
    drain: Drain
    readings: GaugeReadings
    gauge: Gauge
    belief: Belief
    checkpoint: Checkpoint


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
    model : DrainModel
        What predicts the drain.
    voltage_fall : float, optional
        By how much the voltage that predicts the drain falls from full to empty, as a share of its mean.
    start_soc : float, optional
        State of charge before the first reading of the gauge; NaN where it is not known.

    Source: Kalman filter.
    """

    def __init__(self, model: DrainModel, voltage_fall: float = 0.0, start_soc: float = math.nan) -> None:
        self._model, self._min_slope = model, -voltage_fall
        # what is assumed of κ holds at half of the charge, and the filter starts full: κ(full) = κ(half) − s/2, so that
        # var κ = σ_κ² + σ_s²/4, cov(κ, s) = −σ_s²/2
        var_slope = SLOPE_OF_USE_STD**2
        var_ratio = RATIO_OF_USE_STD**2 + var_slope / 4
        nothing = Charge(*(0.0,) * len(Charge._fields))
        charge = nothing._replace(
            soc=start_soc, use_ratio=1.0, var_ratio=var_ratio, cov_ratio_slope=-var_slope / 2, var_slope=var_slope
        )
        self._state = ChargeState(
            charge,
            Drain(since=0.0, unmeasured=0.0, total=0.0, power_w=0.0),
            GaugeReadings(first=math.nan, last=math.nan, taken=1, changes=1, outliers=0),
            Gauge(noise_variance=0.0, quantum=GAUGE_QUANTUM, step=math.nan, from_full=False),
            Belief(believed=True, rises=False, lost=0.0, losses=0),
            Checkpoint(math.nan, 0.0, charge),
        )
        self._now = charge  # after the drain since the last correction

    def ingest(self, charges: Column, powers_w: Column, steps_s: Column, *, measured: bool = True) -> None:
        """Drain the charge by readings of the power, and correct it by those of the gauge, in their order.

        Parameters
        ----------
        charges : sequence of float or array, shape (n,)
            Readings of the gauge; NaN for none: the power alone drains the battery then.
        powers_w : sequence of float or array, shape (n,)
            Readings of the power [W]; NaN for none: the last one holds. It says little of κ then, and where the time
            since the last reading is above `MAX_STEP_S`.
        steps_s : sequence of float or array, shape (n,)
            Times since the last reading [s].
        measured : bool
            Whether readings of the power show the drain between them; in a take-off it changes faster.
        """
        charges, powers_w, steps_s = columns(charges, powers_w, steps_s)
        self._state = jitted(_ingested)(self._state, self._model, charges, powers_w, steps_s, measured)
        self._now = after_drain(self._state.charge, self._state.drain.since)

    @property
    def soc(self) -> float:
        """b; NaN before anything is known."""
        return self._now.soc

    @property
    def belief(self) -> Belief:
        """Whether the gauge is believed, and the charge lost."""
        return self._state.belief

    @property
    def ahead(self) -> Charge:
        """The state now, to predict from: its slope s has a least value, as no voltage rises while the charge falls."""
        return self._now._replace(use_slope=max(self._now.use_slope, self._min_slope))

    @property
    def gauge_gain(self) -> tuple[float, float]:
        """Standard deviation of the gauge's gain, and the charge from which on it counts; 0 for an exact gauge."""
        exact = self._state.gauge.noise_variance < EXACT_GAUGE
        return (0.0, 0.0) if exact else (GAUGE_GAIN_STD, self._state.readings.first)

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the last reading, or a charge not yet taken, may be an outlier: the next reading decides."""
        return self._state.readings.outliers > 0 or abs(soc - self.soc) > MIN_JUMP


# The functions below may be compiled, see `eadp.core.compiled`: states are built anew, for there is no `_replace`.


def after_drain(charge: Charge, drain: float) -> Charge:
    """The state after a predicted drain d, a state of charge: x ← F x, P ← F P Fᵀ + Q.

        F = [[1, −d, −d²/2, 0], [0, 1, d, 0], [0, 0, 1, 0], [0, 0, 0, 1]]

    Q: κ is a random walk of variance σ² d, so that b gains σ² d³/3, and both covary by −σ² d²/2; and b gains the noise
    of the charge used. The extra variance of a drain without a measured power is the caller's.

    Source: prediction of a Kalman filter.
    """
    # fmt: off
    (soc, ratio, slope,
     var_soc, soc_ratio, soc_slope, var_ratio, ratio_slope, var_slope,
     offset, soc_offset, ratio_offset, slope_offset, var_offset) = charge
    # fmt: on
    d, h, drift = drain, drain * drain / 2, USE_DRIFT**2 * drain  # h = d²/2, drift = σ² d
    # the first row of F P: P_b − d P_κ − d²/2 P_s
    row_soc = var_soc - d * soc_ratio - h * soc_slope
    row_ratio = soc_ratio - d * var_ratio - h * ratio_slope
    row_slope = soc_slope - d * ratio_slope - h * var_slope
    # fmt: off
    return Charge(
        # b ← b − κ d − s d²/2,  κ ← κ + s d
        soc - ratio * d - slope * h, ratio + slope * d, slope,
        # the first row of F P times Fᵀ, plus Q
        row_soc - d * row_ratio - h * row_slope + USE_NOISE**2 * d + drift * d * d / 3,
        row_ratio + d * row_slope - drift * d / 2,
        row_slope,
        # the second row, P_κ + d P_s, times Fᵀ, plus Q; and the third
        var_ratio + 2 * d * ratio_slope + d * d * var_slope + drift,
        ratio_slope + d * var_slope,
        var_slope,
        # o is constant: the last column of F P
        offset,
        soc_offset - d * ratio_offset - h * slope_offset,
        ratio_offset + d * slope_offset,
        slope_offset,
        var_offset,
    )
    # fmt: on


def charge_at_end(charge: Charge, drain: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Charge and its variance after predicted drains of a mission, each of shape (n,).

    Where a drain is more than the battery holds, the charge is below 0: what is short. Beyond empty, κ stays as it is
    there: it is known of a battery from full to empty, and would else grow without end.
    """
    inside: Any = np.minimum(drain, max(charge.soc, 0.0))
    at, beyond = after_drain(charge, inside), drain - inside
    variance = at.var_soc - 2 * beyond * at.cov_soc_ratio + beyond * beyond * at.var_ratio
    return at.soc - at.use_ratio * beyond, variance


def corrected(charge: Charge, error: float, noise: float) -> Charge:
    """The state after a reading of b − o that is above the state's by e, `error`, of variance R, `noise`.

        H = [1, 0, 0, −1],  S = H P Hᵀ + R,  K = P Hᵀ/S,  x ← x + K e,  P ← P − K H P

    Source: correction of a Kalman filter.
    """
    c = charge
    # H P
    of_soc, of_ratio = c.var_soc - c.cov_soc_offset, c.cov_soc_ratio - c.cov_ratio_offset
    of_slope, of_offset = c.cov_soc_slope - c.cov_slope_offset, c.cov_soc_offset - c.var_offset
    # S = H P Hᵀ + R
    innovation = max(of_soc - of_offset + noise, 1e-18)
    # K = P Hᵀ/S; an exact reading is the charge
    by_soc = 1.0 if noise <= 1e-12 and c.var_offset == 0.0 else of_soc / innovation
    by_ratio, by_slope, by_offset = of_ratio / innovation, of_slope / innovation, of_offset / innovation
    # x ← x + K e
    soc = c.soc + by_soc * error
    ratio = min(max(c.use_ratio + by_ratio * error, 1 / MAX_USE), MAX_USE)
    slope = c.use_slope + by_slope * error
    offset = c.offset + by_offset * error
    # P ← P − K H P, its upper triangle
    var_soc = c.var_soc - by_soc * of_soc
    soc_ratio = c.cov_soc_ratio - by_soc * of_ratio
    soc_slope = c.cov_soc_slope - by_soc * of_slope
    soc_offset = c.cov_soc_offset - by_soc * of_offset
    var_ratio = c.var_ratio - by_ratio * of_ratio
    ratio_slope = c.cov_ratio_slope - by_ratio * of_slope
    ratio_offset = c.cov_ratio_offset - by_ratio * of_offset
    var_slope = c.var_slope - by_slope * of_slope
    slope_offset = c.cov_slope_offset - by_slope * of_offset
    var_offset = c.var_offset - by_offset * of_offset
    # fmt: off
    return Charge(
        soc, ratio, slope,
        var_soc, soc_ratio, soc_slope, var_ratio, ratio_slope, var_slope,
        offset, soc_offset, ratio_offset, slope_offset, var_offset,
    )
    # fmt: on


def _with_soc(charge: Charge, soc: float, var_soc: float, related: float = 1.0) -> Charge:
    """The state with another b and variance of it; covariances stay, or with `related` 0 it covaries with nothing."""
    c = charge
    # fmt: off
    return Charge(
        soc, c.use_ratio, c.use_slope,
        var_soc, related * c.cov_soc_ratio, related * c.cov_soc_slope, c.var_ratio, c.cov_ratio_slope, c.var_slope,
        c.offset, related * c.cov_soc_offset, c.cov_ratio_offset, c.cov_slope_offset, c.var_offset,
    )
    # fmt: on


def _with_new_offset(charge: Charge, offset: float, var_soc: float, cov_soc_offset: float, var_offset: float) -> Charge:
    """The state with a new o, independent of the state before: it covaries with b alone."""
    c = charge
    # fmt: off
    return Charge(
        c.soc, c.use_ratio, c.use_slope,
        var_soc, c.cov_soc_ratio, c.cov_soc_slope, c.var_ratio, c.cov_ratio_slope, c.var_slope,
        offset, cov_soc_offset, 0.0, 0.0, var_offset,
    )
    # fmt: on


def _ingested(
    state: ChargeState, model: DrainModel, charges: Column, powers_w: Column, steps_s: Column, measured: bool
) -> ChargeState:
    """The state after readings, see `ChargeFilter.ingest`: powers add to the drain, gauge readings correct."""
    for i in range(len(charges)):
        drain = state.drain
        known = not math.isnan(powers_w[i])
        power_w = powers_w[i] if known else drain.power_w
        # what this reading's power has drained since the reading before; 0 as long as no charge is known
        drained = 0.0
        if not math.isnan(state.charge.soc):
            soc = after_drain(state.charge, drain.since).soc
            volts = model.empty_v + model.rise_v * level(min(max(soc, 0.0), 1.0), model.curve)
            drained = drain_per_s(power_w, volts, model.resistance_ohm, model.per_as) * steps_s[i]
        unmeasured = 0.0 if measured and known and steps_s[i] <= MAX_STEP_S else drained
        drain = Drain(drain.since + drained, drain.unmeasured + unmeasured, drain.total + drained, power_w)
        state = ChargeState(state.charge, drain, state.readings, state.gauge, state.belief, state.checkpoint)
        if not math.isnan(charges[i]):
            state = _with_reading(state, charges[i], drained)
    return state


def _with_reading(state: ChargeState, reading: float, drained: float) -> ChargeState:
    """The state after a reading of the gauge; `drained` is the drain since the reading before, already in the state."""
    readings = state.readings
    if math.isnan(readings.last):
        return _with_first_reading(state, reading)
    fell = readings.last - reading
    readings = GaugeReadings(readings.first, reading, readings.taken + 1, readings.changes, readings.outliers)
    state = ChargeState(state.charge, state.drain, readings, state.gauge, state.belief, state.checkpoint)
    # a repetition says nothing, unless it confirms an outlier, or nothing has been drained that it should show
    if fell != 0.0 or readings.outliers > 0 or drained == 0.0:
        state = _with_change(state, fell, drained)
    return _checked(state)


def _with_first_reading(state: ChargeState, reading: float) -> ChargeState:
    """The state after the first reading, which is the charge."""
    readings, gauge = state.readings, state.gauge
    charge = _with_soc(state.charge, reading, state.charge.var_soc)
    return ChargeState(
        charge,
        _none_since(state.drain),
        GaugeReadings(reading, reading, readings.taken, readings.changes, readings.outliers),
        Gauge(gauge.noise_variance, gauge.quantum, gauge.step, from_full=reading == 1.0),
        state.belief,
        Checkpoint(reading, state.drain.total, charge),
    )


def _none_since(drain: Drain) -> Drain:
    """The drain with its parts since the last correction reset to 0."""
    return Drain(since=0.0, unmeasured=0.0, total=drain.total, power_w=drain.power_w)


def _with_change(state: ChargeState, fell: float, drained: float) -> ChargeState:
    """The state after a reading that is not only a repetition: it is an outlier, or corrects the state.

    The reading is `state.readings.last`; `fell` is by how much it is below the reading before, `drained` the drain
    predicted between the two. `readings.changes` becomes 2 or more, so that divisors `changes - 1` are not 0.
    """
    drain, belief, known = state.drain, state.belief, state.readings
    readings = GaugeReadings(known.first, known.last, known.taken, known.changes + 1, known.outliers)
    charge, gauge = state.charge, state.gauge
    if fell != 0.0:
        charge, gauge = _with_step(charge, gauge, fell, drained)
    # the state predicted at this reading
    now = after_drain(charge, drain.since)
    var_soc = now.var_soc + (UNMEASURED * drain.unmeasured) ** 2
    if readings.changes <= FIRST_READINGS and not gauge.from_full:  # not below that of the mean of the first readings
        var_soc = max(var_soc, gauge.noise_variance / (readings.changes - 1))
    # e = z + o − b, and its variance. Where a gauge of steps falls to z, b is z + o; where it rises to z, b is where it
    # falls to the reading before: one step lower
    error = readings.last + now.offset - (gauge.step if fell < 0 else 0.0) - now.soc
    variance = var_soc - 2 * now.cov_soc_offset + now.var_offset

    if _is_outlier(abs(error), variance, gauge.noise_variance, readings.taken, drain.since):
        return _with_outlier(ChargeState(charge, drain, readings, gauge, belief, state.checkpoint), now, error)
    # no outlier: the state is corrected, and the noise learned, unless the gauge is disbelieved
    readings = GaugeReadings(readings.first, readings.last, readings.taken, readings.changes, outliers=0)
    if not belief.believed:
        return ChargeState(charge, drain, readings, gauge, belief, state.checkpoint)
    # a small loss is a loss of charge, not of capacity: by how much e² exceeds the usual is added to var b alone, so
    # that b is corrected and not κ. A coarse gauge looks exact until it has changed a few times
    if gauge.noise_variance >= EXACT_GAUGE or readings.changes <= FIRST_CHANGES:
        var_soc += max(0.0, error * error - SMALL_JUMP_STDS**2 * (variance + gauge.noise_variance))
    # a drain without a measured power says nothing of the gauge's noise
    unexplained = now.use_ratio * drain.since - fell
    noise = gauge.noise_variance if drain.unmeasured > 0.0 else _noise(gauge, readings, unexplained)
    # the greatest fall between two readings may be one step of the gauge
    gauge = Gauge(noise, min(max(gauge.quantum, fell), MAX_QUANTUM), gauge.step, gauge.from_full)
    charge = corrected(_with_soc(now, now.soc, var_soc), error, noise)
    return ChargeState(charge, _none_since(drain), readings, gauge, belief, state.checkpoint)


def _noise(gauge: Gauge, readings: GaugeReadings, change: float) -> float:
    """The gauge's variance R after one more `change`, δ: a difference of readings less the drain. R ← R + g (δ²/2 − R).

    The difference of two readings has twice the variance of one.
    """
    noise = gauge.noise_variance
    # the gain g makes R the mean over all differences at first, and over the last ones later
    return noise + max(NOISE_SHARE, 1 / (readings.changes - 1)) * (change * change / 2 - noise)


def _is_outlier(size: float, variance: float, noise: float, taken: int, drain: float) -> bool:
    """Whether a reading is an outlier by the size of its innovation; the first readings are none.

    `variance` is that of the predicted reading, `noise` that of the gauge; `taken` counts the readings so far.
    """
    # an exact gauge differs from the prediction by the error of the drain alone, less than ten times the drain
    if noise < EXACT_GAUGE and taken > 2:
        return size > MIN_JUMP + 10 * drain
    return taken > 4 and size > JUMP and size > JUMP_STDS * math.sqrt(variance + noise)


def _with_outlier(state: ChargeState, now: Charge, error: float) -> ChargeState:
    """The state after an outlier: it is not corrected, unless the reading is a loss, or the end of a false loss.

    `now` is the state predicted at the reading, and `error` by how much the reading is above it.
    """
    readings, belief = state.readings, state.belief
    # the second in a row confirms; an exact gauge needs none
    confirmed = readings.outliers > 0 or state.gauge.noise_variance < EXACT_GAUGE
    # a charge that rises by no more than was lost is the end of a false loss
    is_back = belief.believed and error <= belief.lost + MIN_JUMP
    if confirmed and (error < 0 or is_back):
        return _with_loss(state, now, error)
    readings = GaugeReadings(readings.first, readings.last, readings.taken, readings.changes, readings.outliers + 1)
    return ChargeState(state.charge, state.drain, readings, state.gauge, belief, state.checkpoint)


def _with_loss(state: ChargeState, now: Charge, error: float) -> ChargeState:
    """The state after a loss of charge, or the end of a false one: b is the reading; the counts start again."""
    readings, gauge, belief = state.readings, state.gauge, state.belief
    charge = _with_soc(now, readings.last, gauge.noise_variance, 0.0)
    return ChargeState(
        charge,
        _none_since(state.drain),
        GaugeReadings(readings.first, readings.last, taken=2, changes=2, outliers=0),
        Gauge(gauge.noise_variance, gauge.quantum, gauge.step, from_full=False),
        Belief(True, belief.rises, max(belief.lost - error, 0.0), belief.losses + 1),
        Checkpoint(readings.last, state.drain.total, charge),
    )


def _with_step(charge: Charge, gauge: Gauge, fell: float, drained: float) -> tuple[Charge, Gauge]:
    """State and gauge after the reading has changed: it `fell`; this shows whether the gauge has steps, of a size q.

    It has steps if its first change is more than the drain since the reading before, `drained`, and none any more once
    another change is no multiple of q. With steps, o is uniform in 0 to q: of mean q/2 and variance q²/12; else o is
    0.
    """
    step, size = gauge.step, abs(fell)
    if math.isnan(step):  # the first change
        step = min(size, MAX_QUANTUM) if size > charge.use_ratio * drained + MIN_JUMP else 0.0
        uniform = step * step / 12
        if gauge.from_full:  # b is 1 whatever o is
            charge = _with_new_offset(charge, step / 2, charge.var_soc, 0.0, uniform)
        # u, how far b was below the top of its step at the first reading, is uniform as o is:
        # b = reading + o − u, so that var b grows by var o + var u, and cov(b, o) = var o
        else:
            charge = _with_new_offset(charge, step / 2, charge.var_soc + step * step / 6, uniform, uniform)
    elif step > 0.0 and abs(size / step - round(size / step)) > SAME_STEPS:
        charge, step = _with_new_offset(charge, 0.0, charge.var_soc, 0.0, 0.0), 0.0
    return charge, Gauge(gauge.noise_variance, gauge.quantum, step, gauge.from_full)


def _checked(state: ChargeState) -> ChargeState:
    """The state after comparing the gauge's fall with the drain since the checkpoint, if enough has been drained.

    The gauge is disbelieved where it falls by much less than the drain, and the charge is the integral of the power
    then; it is believed again where it falls with the drain and is not far above that integral.
    """
    charge, drain, gauge, belief, checkpoint = state.charge, state.drain, state.gauge, state.belief, state.checkpoint
    reading, drained = state.readings.last, drain.total - checkpoint.total_drain
    # too little has been drained to show in the gauge
    if drained < max(CHECKED_DRAIN, CHECKED_QUANTA * gauge.quantum, CHECKED_STDS * math.sqrt(gauge.noise_variance)):
        return state
    fell, expected = checkpoint.reading - reading, checkpoint.charge.use_ratio * drained
    falls = MIN_FALL * expected <= fell
    now = after_drain(charge, drain.since)
    if belief.believed and not falls:  # disbelieved: the charge is the integral since the last comparison
        belief = Belief(False, fell < 0, belief.lost, belief.losses)
        charge = now = after_drain(checkpoint.charge, drained)
        drain = Drain(0.0, drain.unmeasured, drain.total, drain.power_w)
    elif falls and fell <= expected / MIN_FALL:
        far = max(CHECKED_QUANTA * gauge.quantum, JUMP_STDS * math.sqrt(now.var_soc))
        if reading <= now.soc + far:
            belief = Belief(True, belief.rises, belief.lost, belief.losses)
    return ChargeState(charge, drain, state.readings, gauge, belief, Checkpoint(reading, drain.total, now))

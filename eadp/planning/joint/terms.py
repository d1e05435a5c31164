"""Terms of the mission program: time, use of charge and value of each leg of a route, for the knapsack."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.flight.battery import drains_per_s, max_power_w, min_voltage_v
from eadp.errors import Infeasible
from eadp.models.plan.cursor import Vector
from eadp.models.plan.leg_table import LegTable, grown
from eadp.models.plan.route import Route
from eadp.models.plan.stage import Box
from eadp.planning.base import Mission, PlannerSettings, allowed_levels, thinned
from eadp.planning.joint.knapsack import ConcaveEnvelope, Increments, concave_envelope
from eadp.planning.joint.settings import JointSettings

QUALITY, TOTAL = "quality", "total"
MAX_CONFIGURATIONS = 50_000

DELIVERABLE = 0.98
"""Maximum planned power as a share of the battery's maximum power."""

Cell = tuple[float, float, float, float, float, float, float]
"""Voltage when empty and its rise to full [V], resistance [Ω], k_b/Q_c [1/(A s)], Q_c V crate [W], largest current [A],
cut-off voltage [V]."""

AllIncrements = tuple[IntArray, IntArray, FloatArray, FloatArray, float, float]
Limits = tuple[FloatArray, FloatArray, BoolArray, BoolArray, float, float, float]


class RouteLoad(NamedTuple):
    """Time and motion power of the legs of a route.

    Attributes
    ----------
    times_s : array, shape (segments,)
        Duration [s].
    motion_w, peak_w : array, shape (segments,)
        Mean and maximum power of the motion within the segment [W].
    time_std_s, energy_std_j : float
        Standard deviations of the total time [s] and of the motion's energy over it [J].
    use_ratio, charge_std : float
        Ratio of charge used to charge predicted, and the standard deviation of the final state of charge due to it and
        to that of now.
    ends : tuple of (float, array of shape (segments,))
        Ends before the last segment's: their probability, and the share of each segment that is not flown then.
    """

    times_s: FloatArray
    motion_w: FloatArray
    peak_w: FloatArray
    time_std_s: float
    energy_std_j: float
    use_ratio: float = 1.0
    charge_std: float = 0.0
    ends: tuple[tuple[float, FloatArray], ...] = ()

    @property
    def expected_s(self) -> FloatArray:
        """Duration of each segment times the probability that it is flown [s], shape (segments,)."""
        expected_s = self.times_s
        for probability, unflown in self.ends:
            expected_s = expected_s - probability * unflown * self.times_s
        return expected_s


class FlownShares(NamedTuple):
    """For each parameter, the time flown with a free set [s], and the time integral of its share of the set [s]."""

    times_s: Sequence[float]
    areas_s: Sequence[float]


class Envelopes(NamedTuple):
    """Envelopes of groups of configurations.

    The envelopes; least and greatest power of each group [W], shape (groups, 2); where the envelope of each ends; and
    powers [W] and relative values of all one after the other.
    """

    kinds: tuple[ConcaveEnvelope, ...]
    extremes_w: FloatArray
    ends: IntArray
    powers_w: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class KnapsackTerms:
    """The rest of a mission as a multiple-choice knapsack.

    Attributes
    ----------
    increments : Increments
    relative : tuple of ConcaveEnvelope
        The distinct envelopes, with values relative to `scale`.
    scale : float
        Greatest value of a computation's share per second.
    kind_of : array of int, shape (segments,)
        Index of each segment's envelope in `relative`.
    soc_per_j : float
        Derivative of the final state of charge by energy, dI/dP k_b/Q_c at the mean power [1/J].
    mean_w : float
        Mean power with the computations half way between minimum and maximum [W].
    beyond_w : float
        Excess of the minimum power over what the battery can deliver [W]; 0 where there is none.
    letter_soc, delivered_soc : float
        Final states of charge below which the minimum power exceeds b Q_c V crate, or what the battery can deliver,
        somewhere on the route.
    volts : array, shape (segments,)
        Open-circuit voltage [V].
    truncated, by_letter : array of bool, shape (segments,)
        Where the battery excludes configurations, and where b Q_c V crate is its least limit.
    """

    increments: Increments
    relative: tuple[ConcaveEnvelope, ...]
    scale: float
    kind_of: IntArray
    soc_per_j: float
    mean_w: float
    beyond_w: float
    letter_soc: float
    delivered_soc: float
    volts: FloatArray
    truncated: BoolArray
    by_letter: BoolArray

    @property
    def min_soc(self) -> float:
        """Final state of charge that the limits of power require."""
        return max(self.letter_soc, self.delivered_soc)

    @cached_property
    def kinds(self) -> tuple[ConcaveEnvelope, ...]:
        """The distinct envelopes, see `kind_of`."""
        return tuple([envelope.scaled(self.scale) for envelope in self.relative])

    @property
    def envelopes(self) -> tuple[ConcaveEnvelope, ...]:
        """Envelope of each segment."""
        return tuple(self.kinds[kind] for kind in self.kind_of.tolist())

    @property
    def rises_w(self) -> FloatArray:
        """Rise of the computations' power by each increment [W], shape (increments,)."""
        rises, kind_of = np.zeros(len(self.increments.use)), self.kind_of[self.increments.segment]
        for kind, envelope in enumerate(self.relative):
            chosen = kind_of == kind
            rises[chosen] = envelope.rises_w[self.increments.level[chosen]]
        return rises

    @property
    def base_w(self) -> FloatArray:
        """Minimum power of the computations on each segment [W], shape (segments,)."""
        return np.array([envelope.powers_w[0] for envelope in self.relative])[self.kind_of]


class TermBuilder:
    """Builds the terms of routes; envelopes are built once for each kind of segment.

    Parameters
    ----------
    mission : Mission
    settings : PlannerSettings
        Weights and levels are used here.
    own : JointSettings
        Trade-offs and objective: `quality`, U averaged over the flight; or `total`, the weighted sum of the
        computations over time.

    Attributes
    ----------
    weights : array, shape (parameters,)
        Weight of each parameter in the objective.
    cell : Cell
        The battery.
    """

    def __init__(self, mission: Mission, settings: PlannerSettings, own: JointSettings) -> None:
        self._mission, self._settings = mission, settings
        self._plan, self._battery = mission.plan, mission.battery
        self._trade_offs, self._objective = own.trade_offs, own.objective
        self._rho = mission.plan.path_count
        weights = settings.weights
        self.weights = np.array([weights.get(name, 0.0) if weights else 1.0 for name in mission.plan.names])
        self._lists: dict[object, tuple[FloatArray, FloatArray]] = {}
        self._envelopes: dict[object, ConcaveEnvelope] = {}
        self._rates: dict[tuple[float, ...], tuple[float, ...]] = {}
        self._all_of: dict[object, Envelopes] = {}
        self._scale_s = 0.0
        self._table: LegTable | None = None
        b = mission.battery
        empty_v = b.voltage_at(0.0)
        limits = b.power_per_soc_w, b.max_current_a, b.cutoff_voltage_v or 0.0
        self.cell: Cell = (empty_v, b.voltage_at(1.0) - empty_v, b.resistance_ohm, b.drain_per_as, *limits)

    def terms(self, route: Route, load: RouteLoad, past: FlownShares, soc: float, reserve_soc: float) -> KnapsackTerms:
        """The terms of a route.

        Parameters
        ----------
        route : Route
        load : RouteLoad
        past : FlownShares
        soc, reserve_soc : float
            State of charge now, and the one to keep at the end.
        """
        rates, base_value = self._value_rates(route, load.expected_s, past)
        group_of, groups = self._groups(route)
        relative, scale = self._relative(rates)
        kinds, extremes_w, ends, powers_w, values = self._all(groups, relative)
        per_as = self._battery.drain_per_as * load.use_ratio
        cell = (*self.cell[:3], per_as, *self.cell[4:])
        # the reserve bounds the state of charge from below on the whole route
        limits, found, truncates, mean_w, mean_v = _limits_and_increments(
            *(load.times_s, load.expected_s, load.motion_w, load.peak_w, extremes_w, group_of),
            soc,
            min(reserve_soc, soc),
            cell,
            ends,
            powers_w,
            values,
            scale,
        )
        kind_of = group_of
        volts, room, truncated, by_letter, beyond, letter_soc, delivered_soc = limits
        if truncates:
            kinds, kind_of = self._truncated(groups, group_of, room, relative)
            found, mean_w = _all_increments(
                *(kind_of, *_one_after_another(kinds), load.times_s, load.expected_s, load.motion_w, volts, cell, scale)
            )
        segment, level, use, gain, base_use, own_value = found
        discriminant = max(mean_v**2 - 4 * self._battery.resistance_ohm * mean_w, (0.1 * mean_v) ** 2)
        increments = Increments(segment, level, use, gain, base_use, base_value + own_value)
        return KnapsackTerms(
            *(increments, kinds, scale, kind_of, per_as / math.sqrt(discriminant), mean_w, beyond),
            *(letter_soc, delivered_soc, volts, truncated, by_letter),
        )

    # --- kinds of segments

    def _groups(self, route: Route) -> tuple[IntArray, list[_Group]]:
        """Which group of configurations each leg of a route has, and the groups."""
        table = route.table
        if table is not self._table:
            self._table, self._known = table, list[_Group]()
            self._of_stage, self._index = dict[object, int](), dict[object, int]()
            self._all_of.clear()
            self._of_row, self._rows = np.zeros(0, dtype=np.intp), 0
        rows = len(table.stages)
        if self._rows < rows:
            self._of_row = grown(self._of_row, self._rows, rows)
            for row in range(self._rows, rows):
                stage, own = table.stages[row], table.parameters[row]
                key = stage.index, own[: self._rho] if self._trade_offs else ()
                if key not in self._of_stage:
                    self._of_stage[key] = self._group(stage.sets, own)
                self._of_row[row] = self._of_stage[key]
            self._rows = rows
        group_of = self._of_row[route.order]
        if not self._trade_offs:
            return group_of, self._known
        # with trade-offs, each value of a path parameter has its own
        used, group_of = np.unique(group_of, return_inverse=True)
        return group_of, [self._known[number] for number in used.tolist()]

    def _group(self, sets: Sequence[Box], own: Vector) -> int:
        """The number of the group of a stage."""
        number = self._index.setdefault(self._key(sets, own), len(self._known))
        if number == len(self._known):
            self._known.append(_Group(sets, own, self.configurations(sets, own)[1]))
        return number

    def _relative(self, rates: FloatArray) -> tuple[tuple[float, ...], float]:
        """Value of each computation's share per second, relative to the greatest, and that."""
        own = rates.tolist()[self._rho :]
        scale = max(own, default=0.0)
        relative = tuple([rate / scale for rate in own] if scale > 0 else own)
        # rates that differ by less share their envelopes
        return self._rates.setdefault(tuple([round(rate, 4) for rate in relative]), relative), max(scale, 0.0)

    def _all(self, groups: Sequence[_Group], relative: tuple[float, ...]) -> Envelopes:
        """Envelopes of all configurations of groups."""
        key = (
            relative,
            tuple([self._key(group.sets, group.own) for group in groups]) if self._trade_offs else len(groups),
        )
        if key not in self._all_of:
            kinds = tuple([self._envelope(*group, len(group.powers_w), relative) for group in groups])
            extremes_w = np.array([(group.powers_w[0], group.powers_w[-1]) for group in groups])
            self._all_of[key] = Envelopes(kinds, extremes_w, *_one_after_another(kinds))
        return self._all_of[key]

    def _truncated(
        self, groups: Sequence[_Group], group_of: IntArray, room: FloatArray, relative: tuple[float, ...]
    ) -> tuple[tuple[ConcaveEnvelope, ...], IntArray]:
        """Envelopes of the configurations for which there is room [W], and which each segment has."""
        kinds: list[ConcaveEnvelope] = []
        kind_of = np.zeros(len(group_of), dtype=np.intp)
        for number, group in enumerate(groups):
            members = np.nonzero(group_of == number)[0]
            allowed = np.maximum(np.searchsorted(group.powers_w, room[members], side="right"), 1)
            for count in sorted({*allowed.tolist()}):
                kind_of[members[allowed == count]] = len(kinds)
                kinds.append(self._envelope(*group, count, relative))
        return tuple(kinds), kind_of

    # --- values

    def _value_rates(self, route: Route, times: FloatArray, past: FlownShares) -> tuple[FloatArray, float]:
        """Value of each parameter's share per second, and the value of what is flown and of the path."""
        count, rho = len(self._plan.names), self._rho
        times_s, areas_s = np.array(past.times_s), np.array(past.areas_s)
        if self._objective == TOTAL:
            # Σ w c dt, relative to the maximum on the first route, so that it too lies in about 0..1
            maxima = np.array([self._plan.hull(j).hi if j >= rho else 0.0 for j in range(count)])
            if not self._scale_s:
                self._scale_s = float((times_s + times @ route.free).max(initial=1.0))
            rates = self.weights * np.where(np.arange(count) >= rho, 1.0, 0.0)
            rates /= max(float((rates * maxima).sum()), 1e-12) * max(self._scale_s, 1e-9)
            return rates, 0.0
        rows = route.table.rows
        return _quality(rows.free, rows.shares, route.order, times, times_s, areas_s, self.weights, rho)

    # --- envelopes

    def _envelope(
        self, sets: Sequence[Box], own: Vector, powers_w: FloatArray, allowed: int, relative: tuple[float, ...]
    ) -> ConcaveEnvelope:
        """Envelope of the first `allowed` configurations of a stage, of powers [W] in ascending order."""
        key = self._key(sets, own), allowed, relative
        if key not in self._envelopes:
            configurations = self.configurations(sets, own)[0]
            values = self._values_of(configurations[:allowed], sets, relative)
            self._envelopes[key] = concave_envelope(powers_w[:allowed], values, configurations[:allowed])
        return self._envelopes[key]

    def _values_of(self, configurations: FloatArray, sets: Sequence[Box], rates: Sequence[float]) -> FloatArray:
        """Value of configurations per second in a stage, from the rate of each computation's share."""
        values = np.zeros(len(configurations))
        for k, box in enumerate(sets[self._rho :]):
            column = configurations[:, k]
            if self._objective == TOTAL:
                values += rates[k] * column
            elif not box.fixed:
                values += rates[k] * (column - box.lo) / (box.hi - box.lo)
        return values

    def configurations(self, sets: Sequence[Box], own: Vector) -> tuple[FloatArray, FloatArray]:
        """Configurations of a stage within the trade-offs, and their powers [W], in ascending order of power."""
        key = self._key(sets, own)
        if key not in self._lists:
            self._lists[key] = self._listed(sets, own)
        return self._lists[key]

    def _key(self, sets: Sequence[Box], own: Vector) -> tuple[object, ...]:
        path = own[: self._rho] if self._trade_offs else ()
        return (*((box.lo, box.hi) for box in sets[self._rho :]), path)

    def _listed(self, sets: Sequence[Box], own: Vector) -> tuple[FloatArray, FloatArray]:
        rho, names, computing = self._rho, self._plan.names, self._mission.computing
        own_levels = [
            allowed_levels(self._settings, self._mission, rho + k, box, measured=True)
            for k, box in enumerate(sets[rho:])
        ]
        levels = thinned(own_levels, MAX_CONFIGURATIONS)
        rows, powers = [], []
        for choice in itertools.islice(itertools.product(*levels), MAX_CONFIGURATIONS):
            values = (*own[:rho], *choice)
            if any(
                sum(row.coefficients.get(name, 0.0) * value for name, value in zip(names, values, strict=True))
                < row.at_least - 1e-9
                for row in self._trade_offs
            ):
                continue
            try:
                powers.append(computing.power_w(values, sets))
            except Infeasible:
                continue
            rows.append(choice)
        if not rows:  # no configuration satisfies the trade-offs: the lowest levels, as where nothing is feasible
            rows = [tuple(values[0] for values in levels)]
            powers = [computing.power_w((*own[:rho], *rows[0]), sets)]
        order = np.argsort(powers, kind="stable")
        return np.array(rows, dtype=float).reshape(len(rows), len(levels))[order], np.array(powers)[order]


class _Group(NamedTuple):
    """Segments of the same configurations: sets and parameters in force of one, and powers [W] in ascending order."""

    sets: Sequence[Box]
    own: Vector
    powers_w: FloatArray


def _one_after_another(kinds: Sequence[ConcaveEnvelope]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where each envelope ends among the powers [W] and values of all, and those."""
    ends = np.cumsum(np.array([len(envelope.powers_w) for envelope in kinds]))
    powers_w, values = (np.concatenate(arrays) for arrays in zip(*((k.powers_w, k.values) for k in kinds), strict=True))
    return ends, powers_w, values


_EnvelopeIncrements = tuple[float, float, float, IntArray, IntArray, FloatArray, FloatArray]


def _quality(
    free: FloatArray,
    shares: FloatArray,
    order: IntArray,
    times_s: FloatArray,
    past_s: FloatArray,
    past_areas_s: FloatArray,
    weights: FloatArray,
    path: int,
) -> tuple[FloatArray, float]:
    """Value of each parameter's share per second in U, and of the flown shares and the first `path` parameters."""
    # of each parameter: time with a free set, and time integral of its share, flown and, of the path, ahead
    free_s = past_s + times_s @ free[order]
    areas_s = past_areas_s.copy()
    areas_s[:path] += times_s @ shares[order, :path]
    live = (free_s > 0.0) & (weights > 0.0)
    weight = np.where(live, weights, 0.0).sum()
    value_rates: FloatArray = np.where(live, weights / (max(weight, 1e-12) * np.maximum(free_s, 1e-9)), 0.0)
    return value_rates, (value_rates * areas_s).sum()


def _power_limits(
    times_s: FloatArray,
    motion_w: FloatArray,
    peak_w: FloatArray,
    extremes_w: FloatArray,
    group_of: IntArray,
    soc: float,
    floor: float,
    cell: Cell,
) -> Limits:
    """Voltage of each segment, limit of its computations [W], and attributes of `KnapsackTerms` from `truncated` on.

    `extremes_w` holds the least and the greatest power of each group of configurations.

    The state of charge falls as computations of maximum power drain it, but not below `floor`, nor below what the
    minimum power requires at the end of the route.
    """
    empty_v, rise_v, resistance_ohm, per_as, per_soc_w, max_current_a, cutoff_v = cell
    base_w, max_w = extremes_w[:, 0][group_of], extremes_w[:, 1][group_of]
    required = np.zeros(len(times_s))
    if rise_v > 0.0:
        required = (min_voltage_v(peak_w + base_w, resistance_ohm, max_current_a, cutoff_v) - empty_v) / rise_v
        floor = max(floor, min(soc, required[-1]))
    volts = np.full(len(times_s), empty_v + rise_v * max(floor, 0.0))
    charge_end = volts
    for _ in range(3 if rise_v != 0.0 else 1):
        taken = times_s * drains_per_s(motion_w + max_w, volts, resistance_ohm, per_as)
        taken = taken * min(1.0, (soc - floor) / max(taken.sum(), 1e-12))
        charge_end = soc - np.cumsum(taken)
        volts = empty_v + rise_v * np.maximum(charge_end + taken / 2, 0.0)
    deliverable = DELIVERABLE * max_power_w(volts, resistance_ohm, max_current_a, cutoff_v)
    allowed = deliverable
    if per_soc_w < np.inf:
        allowed = np.minimum(deliverable, np.maximum(charge_end, 0.0) * per_soc_w)
    max_v = np.full(len(times_s), empty_v + rise_v * soc)
    beyond = (peak_w + base_w - max_power_w(max_v, resistance_ohm, max_current_a, cutoff_v)).max()
    # at the end of each segment at minimum power, as states of charge at the end of the route
    base_use = times_s * drains_per_s(motion_w + base_w, volts, resistance_ohm, per_as)
    later_use = base_use.sum() - np.cumsum(base_use)
    letter_soc, delivered_soc = ((peak_w + base_w) / per_soc_w - later_use).max(), (required - later_use).max()
    room = allowed - peak_w
    return volts, room, max_w > room, allowed < deliverable, max(beyond, 0.0), letter_soc, delivered_soc


def _limits_and_increments(
    times_s: FloatArray,
    expected_s: FloatArray,
    motion_w: FloatArray,
    peak_w: FloatArray,
    extremes_w: FloatArray,
    group_of: IntArray,
    soc: float,
    floor: float,
    cell: Cell,
    ends: IntArray,
    powers_w: FloatArray,
    values: FloatArray,
    scale: float,
) -> tuple[Limits, AllIncrements, bool, float, float]:
    """Limits, increments without them, whether they exclude any configurations; mean power [W] and mean voltage [V]."""
    limits = _power_limits(times_s, motion_w, peak_w, extremes_w, group_of, soc, floor, cell)
    increments, mean_w = _all_increments(
        group_of, ends, powers_w, values, times_s, expected_s, motion_w, limits[0], cell, scale
    )
    return limits, increments, bool(limits[2].any()), mean_w, float(limits[0].mean())


def _all_increments(
    kind_of: IntArray,
    ends: IntArray,
    powers_w: FloatArray,
    values: FloatArray,
    times_s: FloatArray,
    expected_s: FloatArray,
    motion_w: FloatArray,
    volts: FloatArray,
    cell: Cell,
    scale: float,
) -> tuple[AllIncrements, float]:
    """Increments of all segments, one kind of envelope after the other: segment, level, use and gain.

    After them use and value with every segment at minimum power; and the mean power with computations half way [W].
    """
    size = 0
    for k in range(len(ends)):
        size += (kind_of == k).sum() * (ends[k] - (ends[k - 1] if k else 0) - 1)
    segment, level = np.zeros(size, dtype=np.intp), np.zeros(size, dtype=np.intp)
    use, gain = np.zeros(size), np.zeros(size)
    base_use = base_value = 0.0
    energy_j = (motion_w * times_s).sum()
    at = first = 0
    for k in range(len(ends)):
        own_w, own_values = powers_w[first : ends[k]], scale * values[first : ends[k]]
        index = np.nonzero(kind_of == k)[0]
        seconds, expected, least, own_segment, own_level, own_use, own_gain = _increments(
            index, times_s, expected_s, motion_w, volts, own_w, own_values, cell
        )
        end = at + len(own_use)
        segment[at:end], level[at:end], use[at:end], gain[at:end] = own_segment, own_level, own_use, own_gain
        base_use += least
        base_value += expected * own_values[0]
        energy_j += seconds * (own_w[0] + own_w[-1]) / 2
        at, first = end, ends[k]
    return (segment, level, use, gain, base_use, base_value), energy_j / max(times_s.sum(), 1e-9)


def _increments(
    index: IntArray,
    times_s: FloatArray,
    expected_s: FloatArray,
    motion_w: FloatArray,
    volts: FloatArray,
    powers_w: FloatArray,
    values: FloatArray,
    cell: Cell,
) -> _EnvelopeIncrements:
    """Increments of segments that share an envelope.

    Before them their total time [s], the time expected to be flown [s], and their use at minimum power.
    """
    resistance_ohm, per_as = cell[2], cell[3]
    count = len(powers_w) - 1
    seconds = times_s[index]
    column = seconds.reshape(-1, 1)
    use = column * drains_per_s(
        motion_w[index].reshape(-1, 1) + powers_w, volts[index].reshape(-1, 1), resistance_ohm, per_as
    )
    level = np.arange(len(index) * count) % max(count, 1)
    expected = expected_s[index]
    gain = expected.reshape(-1, 1) * (values[1:] - values[:-1])
    return (
        seconds.sum(),
        expected.sum(),
        use[:, 0].sum(),
        np.repeat(index, count),
        level,
        (use[:, 1:] - use[:, :-1]).ravel(),
        gain.ravel(),
    )

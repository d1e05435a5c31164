"""Terms of the mission program: time, use of charge and value of each leg of a route, for the knapsack."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray, IntArray
from eadp.core.compiled import jitted
from eadp.core.flight.battery import drains_per_s, max_power_w, min_voltage_v
from eadp.errors import Infeasible
from eadp.models.plan.cursor import Vector
from eadp.models.plan.route import Route
from eadp.models.plan.stage import Box
from eadp.planning.base import Mission, PlannerSettings, allowed_levels, thinned
from eadp.planning.joint.knapsack import ConcaveEnvelope, Increments, concave_envelope
from eadp.planning.joint.settings import JointSettings

QUALITY, TOTAL = "quality", "total"
MAX_CONFIGURATIONS = 50_000
DELIVERABLE = 0.98
"""Maximum planned power as a share of the battery's maximum power."""


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


@dataclass(frozen=True)
class KnapsackTerms:
    """The rest of a mission as a multiple-choice knapsack.

    Attributes
    ----------
    increments : Increments
    kinds : tuple of ConcaveEnvelope
        The distinct envelopes.
    kind_of : array of int, shape (segments,)
        Index of each segment's envelope in `kinds`.
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
    kinds: tuple[ConcaveEnvelope, ...]
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

    @property
    def envelopes(self) -> tuple[ConcaveEnvelope, ...]:
        """Envelope of each segment."""
        return tuple(self.kinds[kind] for kind in self.kind_of.tolist())

    @property
    def rises_w(self) -> FloatArray:
        """Rise of the computations' power by each increment [W], shape (increments,)."""
        rises, kind_of = np.zeros(len(self.increments.use)), self.kind_of[self.increments.segment]
        for kind, envelope in enumerate(self.kinds):
            chosen = kind_of == kind
            rises[chosen] = np.diff(envelope.powers_w)[self.increments.level[chosen]]
        return rises

    @property
    def base_w(self) -> FloatArray:
        """Minimum power of the computations on each segment [W], shape (segments,)."""
        return np.array([envelope.powers_w[0] for envelope in self.kinds])[self.kind_of]


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
    """

    def __init__(self, mission: Mission, settings: PlannerSettings, own: JointSettings) -> None:
        self._mission, self._settings = mission, settings
        self._plan, self._battery = mission.plan, mission.battery
        self._trade_offs, self._objective = own.trade_offs, own.objective
        self._rho = mission.plan.path_count
        weights = settings.weights
        self._weights = np.array([weights.get(name, 0.0) if weights else 1.0 for name in mission.plan.names])
        self._lists: dict[object, tuple[FloatArray, FloatArray]] = {}
        self._envelopes: dict[object, ConcaveEnvelope] = {}
        self._scale_s = 0.0
        b = mission.battery
        empty_v = b.voltage_at(0.0)
        limits = b.power_per_soc_w, b.max_current_a, b.cutoff_voltage_v or 0.0
        self._cell = (empty_v, b.voltage_at(1.0) - empty_v, b.resistance_ohm, b.drain_per_as, *limits)

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
        times, total_s = load.times_s, float(load.times_s.sum())
        expected_s = load.expected_s
        value_rates, base_value = self._value_rates(route, expected_s, past)
        b = self._battery
        max_w, base_w = np.zeros(len(times)), np.zeros(len(times))
        alike = route.grouped(lambda stage, own: self._key(stage.sets, own))
        for first, members in alike:
            powers = self.configurations(route.of_legs[first].sets, route.parameters[first])[1]
            base_w[members], max_w[members] = powers[0], powers[-1]
        # the reserve bounds the state of charge from below on the whole route
        power_limits = jitted(_power_limits, drains_per_s, max_power_w, min_voltage_v)
        per_as = b.drain_per_as * load.use_ratio
        cell = (*self._cell[:3], per_as, *self._cell[4:])
        volts, room, by_letter, beyond, letter_soc, delivered_soc = power_limits(
            times, load.motion_w, load.peak_w, base_w, max_w, soc, min(reserve_soc, soc), cell
        )
        kinds: list[ConcaveEnvelope] = []
        found: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = []
        kind_of = np.zeros(len(times), dtype=np.intp)
        base_use = energy_j = 0.0
        increments_of = jitted(_increments, drains_per_s)
        for first, members in alike:
            sets, own = route.of_legs[first].sets, route.parameters[first]
            powers = self.configurations(sets, own)[1]
            allowed = np.maximum(np.searchsorted(powers, room[members], side="right"), 1)
            for count in sorted({*allowed.tolist()}):
                index = members[allowed == count]
                envelope = self._envelope(sets, own, count, value_rates)
                seconds, expected, own_use, segment, level, use, gain = increments_of(
                    index, times, expected_s, load.motion_w, volts, envelope.powers_w, envelope.values, cell
                )
                kind_of[index] = len(kinds)
                kinds.append(envelope)
                found.append((segment, level, use, gain))
                energy_j += seconds * float(envelope.powers_w[0] + envelope.powers_w[-1]) / 2
                base_use += own_use
                base_value += expected * float(envelope.values[0])
        segment, level, use, gain = (np.concatenate(arrays) for arrays in zip(*found, strict=True))
        mean_w = (float(load.motion_w @ times) + energy_j) / max(total_s, 1e-9)
        voltage = float(volts.mean())
        discriminant = max(voltage**2 - 4 * b.resistance_ohm * mean_w, (0.1 * voltage) ** 2)
        slope = per_as / math.sqrt(discriminant)
        increments = Increments(segment, level, use, gain, base_use, base_value)
        return KnapsackTerms(
            *(increments, tuple(kinds), kind_of, slope, mean_w, beyond, letter_soc, delivered_soc),
            *(volts, max_w > room, by_letter),
        )

    # --- values

    def _value_rates(self, route: Route, times: FloatArray, past: FlownShares) -> tuple[FloatArray, float]:
        """Value of each parameter's share per second, and the value of what is flown and of the path."""
        count, rho = len(self._plan.names), self._rho
        times_s, areas_s = np.array(past.times_s), np.array(past.areas_s)
        if self._objective == TOTAL:
            # Σ w c dt, relative to the maximum on the first route, so that it too lies in about 0..1
            maxima = np.array([self._plan.hull(j).hi if j >= rho else 0.0 for j in range(count)])
            if not self._scale_s:
                self._scale_s = float((times_s + route.free @ times).max(initial=1.0))
            rates = self._weights * np.where(np.arange(count) >= rho, 1.0, 0.0)
            rates /= max(float((rates * maxima).sum()), 1e-12) * max(self._scale_s, 1e-9)
            return rates, 0.0
        return jitted(_quality)(route.free, route.shares, times, times_s, areas_s, self._weights, rho)

    # --- envelopes

    def _envelope(self, sets: Sequence[Box], own: Vector, allowed: int, value_rates: FloatArray) -> ConcaveEnvelope:
        """Envelope of the first `allowed` configurations of a stage in ascending order of power."""
        rates = value_rates[self._rho :]
        scale = float(rates.max(initial=0.0))
        # cached for a largest rate of 1
        relative = rates / scale if scale > 0 else rates
        key = (self._key(sets, own), allowed, tuple(np.round(relative, 4).tolist()))
        if key not in self._envelopes:
            configurations, powers = self.configurations(sets, own)
            values = self._values_of(configurations[:allowed], sets, relative)
            self._envelopes[key] = concave_envelope(powers[:allowed], values, configurations[:allowed])
        return self._envelopes[key].scaled(scale)

    def _values_of(self, configurations: FloatArray, sets: Sequence[Box], rates: FloatArray) -> FloatArray:
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


_EnvelopeIncrements = tuple[float, float, float, IntArray, IntArray, FloatArray, FloatArray]
_Cell = tuple[float, float, float, float, float, float, float]
"""Voltage when empty and its rise to full [V], resistance [Ω], k_b/Q_c [1/(A s)], Q_c V crate [W], largest current [A],
cut-off voltage [V]."""


# The functions below keep to what numba compiles, see `eadp.core.compiled`.


def _quality(
    free: FloatArray,
    shares: FloatArray,
    times_s: FloatArray,
    past_s: FloatArray,
    past_areas_s: FloatArray,
    weights: FloatArray,
    path: int,
) -> tuple[FloatArray, float]:
    """Value of each parameter's share per second in U, and of the flown shares and the first `path` parameters."""
    # of each parameter: time with a free set, and time integral of its share, flown and, of the path, ahead
    free_s = past_s + free @ times_s
    areas_s = past_areas_s.copy()
    areas_s[:path] += shares[:path] @ times_s
    live = (free_s > 0.0) & (weights > 0.0)
    weight = np.where(live, weights, 0.0).sum()
    value_rates: FloatArray = np.where(live, weights / (max(weight, 1e-12) * np.maximum(free_s, 1e-9)), 0.0)
    return value_rates, (value_rates * areas_s).sum()


def _power_limits(
    times_s: FloatArray,
    motion_w: FloatArray,
    peak_w: FloatArray,
    base_w: FloatArray,
    max_w: FloatArray,
    soc: float,
    floor: float,
    cell: _Cell,
) -> tuple[FloatArray, FloatArray, BoolArray, float, float, float]:
    """Voltage of each segment, limit of its computations [W], and attributes of `KnapsackTerms` from `by_letter` on.

    The state of charge falls as computations of maximum power drain it, but not below `floor`, nor below what the
    minimum power requires at the end of the route.
    """
    empty_v, rise_v, resistance_ohm, per_as, per_soc_w, max_current_a, cutoff_v = cell
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
    return volts, allowed - peak_w, allowed < deliverable, max(beyond, 0.0), letter_soc, delivered_soc


def _increments(
    index: IntArray,
    times_s: FloatArray,
    expected_s: FloatArray,
    motion_w: FloatArray,
    volts: FloatArray,
    powers_w: FloatArray,
    values: FloatArray,
    cell: _Cell,
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

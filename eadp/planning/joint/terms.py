"""From what is left to fly and what is known of it to the mission program's terms: time, power, charge, worth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.compiled import jitted
from eadp.core.flight.battery import drains_per_s
from eadp.errors import Infeasible
from eadp.models.battery import Battery
from eadp.models.computing import Computing
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Box, Plan
from eadp.models.plan.route import Route
from eadp.planning.base import TradeOff
from eadp.planning.joint.knapsack import ConcaveEnvelope, Increments, concave_envelope

QUALITY, TOTAL = "quality", "total"
MOST_CONFIGURATIONS = 50_000
DELIVERABLE = 0.98
"""Share of the largest power a battery could deliver that is planned with at most."""


class RouteLoad(NamedTuple):
    """The rest of the mission leg by leg.

    Attributes
    ----------
    times_s : array, shape (segments,)
        [s]
    motion_w, peak_w : array, shape (segments,)
        Mean power of the motion, and its highest within the segment [W].
    time_std_s, energy_std_j : float
        Standard deviations of the whole time [s] and of the motion's energy over it [J].
    """

    times_s: FloatArray
    motion_w: FloatArray
    peak_w: FloatArray
    time_std_s: float
    energy_std_j: float


class FlownShares(NamedTuple):
    """What has been flown: for each parameter the time in which it had a choice [s], and the area of its share [s]."""

    times_s: Sequence[float]
    areas_s: Sequence[float]


@dataclass(frozen=True)
class KnapsackTerms:
    """A segment list in the program's terms.

    Attributes
    ----------
    steps : Steps
    kinds : tuple of Menu
        The menus that there are.
    kind_of : array of int, shape (segments,)
        Which of them each segment has.
    soc_per_j : float
        How the state of charge at the end moves with energy, dI/dP k_b/Q_c at the mean power [1/J].
    mean_w : float
        Power with the computations half way [W].
    beyond_w : float
        Power by which even the cheapest is more than the battery can deliver [W]; 0 where it is not.
    least_soc : float
        State of charge at the end below which even the cheapest is more, somewhere on the way, than b Q_c V crate.
    worth : array, shape (parameters,)
        What a share of each parameter adds to the objective per second.
    """

    steps: Increments
    kinds: tuple[ConcaveEnvelope, ...]
    kind_of: IntArray
    soc_per_j: float
    mean_w: float
    beyond_w: float
    least_soc: float
    worth: FloatArray

    @property
    def menus(self) -> tuple[ConcaveEnvelope, ...]:
        """Of each segment."""
        return tuple(self.kinds[kind] for kind in self.kind_of.tolist())

    @property
    def rises_w(self) -> FloatArray:
        """By how much each step raises the computations' power [W], shape (steps,)."""
        rises, of_step = np.zeros(len(self.steps.use)), self.kind_of[self.steps.segment]
        for kind, menu in enumerate(self.kinds):
            chosen = of_step == kind
            rises[chosen] = np.diff(menu.powers_w)[self.steps.level[chosen]]
        return rises

    @property
    def lowest_w(self) -> FloatArray:
        """Power of each segment's cheapest configuration [W], shape (segments,)."""
        return np.array([menu.powers_w[0] for menu in self.kinds])[self.kind_of]


class TermBuilder:
    """Turns courses into the program's terms; menus are made once for each kind of segment.

    Parameters
    ----------
    plan, computing, battery
        As the mission has them.
    weights : mapping
        Weight of each parameter by name; equal without any.
    levels : mapping
        Values that computations may take, where the settings restrict them.
    trade_offs : sequence of TradeOff
    objective : str
        `quality`, U averaged over the flight; or `total`, the sum over time of the computations, weighted.
    """

    def __init__(
        self,
        plan: Plan,
        computing: Computing,
        battery: Battery,
        weights: Mapping[str, float],
        levels: Mapping[str, tuple[float, ...]],
        trade_offs: Sequence[TradeOff],
        objective: str,
    ) -> None:
        self._plan, self._computing, self._battery = plan, computing, battery
        self._levels, self._trade_offs, self._objective = levels, trade_offs, objective
        self._rho = plan.path_count
        self._weights = np.array([weights.get(name, 0.0) if weights else 1.0 for name in plan.names])
        self._lists: dict[object, tuple[FloatArray, FloatArray]] = {}
        self._menus: dict[object, ConcaveEnvelope] = {}
        self._scale_s = 0.0
        empty_v = battery.voltage_at(0.0)
        self._cell = (
            empty_v,
            battery.voltage_at(1.0) - empty_v,
            battery.resistance_ohm,
            battery.drain_per_as,
            battery.power_per_soc_w,
        )

    def terms(
        self, course: Route, segments: RouteLoad, past: FlownShares, soc: float, reserve_soc: float
    ) -> KnapsackTerms:
        """The program's terms of a course.

        Parameters
        ----------
        course : Course
        segments : Segments
        past : Past
        soc, reserve_soc : float
            State of charge now, and what it is to be at the end.
        """
        times, total_s = segments.times_s, float(segments.times_s.sum())
        worth, worth_past = self._worth(course, times, past)
        b = self._battery
        highest, lowest = np.zeros(len(times)), np.zeros(len(times))
        alike = course.grouped(lambda stage, own: self._key(stage.sets, own))
        for first, members in alike:
            powers = self.configurations(course.legs[first].stage.sets, course.parameters[first])[1]
            lowest[members], highest[members] = powers[0], powers[-1]
        # not below the reserve on the way
        volts, room, beyond, least_soc = jitted(_on_the_way, drains_per_s)(
            times, segments.motion_w, segments.peak_w, lowest, highest, soc, min(reserve_soc, soc), self._cell
        )
        groups = _Groups(worth_past, len(times))
        steps_of = jitted(_steps, drains_per_s)
        for first, members in alike:
            stage, own = course.legs[first].stage, course.parameters[first]
            powers = self.configurations(stage.sets, own)[1]
            allowed = np.maximum(np.searchsorted(powers, room[members], side="right"), 1)
            for count in sorted({*allowed.tolist()}):
                index = members[allowed == count]
                menu = self._menu(stage.sets, own, count, worth)
                groups.add(
                    menu,
                    index,
                    steps_of(index, times, segments.motion_w, volts, menu.powers_w, menu.values, self._cell),
                )
        mean_w = (float(segments.motion_w @ times) + groups.energy_j) / max(total_s, 1e-9)
        voltage = float(volts.mean())
        discriminant = max(voltage**2 - 4 * b.resistance_ohm * mean_w, (0.1 * voltage) ** 2)
        slope = b.drain_per_as / math.sqrt(discriminant)
        return KnapsackTerms(
            groups.steps(), tuple(groups.kinds), groups.kind_of, slope, mean_w, beyond, least_soc, worth
        )

    # --- worth

    def _worth(self, course: Route, times: FloatArray, past: FlownShares) -> tuple[FloatArray, float]:
        """What a share of each parameter is worth per second, and what the past and the path are worth."""
        count, rho = len(self._plan.names), self._rho
        times_s, areas_s = np.array(past.times_s), np.array(past.areas_s)
        if self._objective == TOTAL:
            # Σ w c dt, over what the first course seen could give at most, so that it too is about 0..1
            most = np.array([self._plan.hull(j).hi if j >= rho else 0.0 for j in range(count)])
            if not self._scale_s:
                self._scale_s = float((times_s + course.free @ times).max(initial=1.0))
            worth = self._weights * np.where(np.arange(count) >= rho, 1.0, 0.0)
            worth /= max(float((worth * most).sum()), 1e-12) * max(self._scale_s, 1e-9)
            return worth, 0.0
        return jitted(_quality)(course.free, course.shares, times, times_s, areas_s, self._weights, rho)

    # --- menus

    def _menu(self, sets: Sequence[Box], own: Vector, allowed: int, worth: FloatArray) -> ConcaveEnvelope:
        """What the computations may do in a stage: the best mixes of its `allowed` cheapest configurations."""
        ours = worth[self._rho :]
        most = float(ours.max(initial=0.0))
        ratio = tuple(np.round(ours / most, 4).tolist()) if most > 0 else ()
        key = (self._key(sets, own), allowed, ratio)
        if key not in self._menus:
            configurations, powers = self.configurations(sets, own)
            self._menus[key] = self._of_envelope(configurations[:allowed], powers[:allowed], sets, ours, most)
        base = self._menus[key]  # for a worth of 1 of the dearest parameter
        return base.worth(most)

    def _of_envelope(
        self, configurations: FloatArray, powers: FloatArray, sets: Sequence[Box], worth: FloatArray, most: float
    ) -> ConcaveEnvelope:
        values = self._worth_of(configurations, sets, worth / most if most > 0 else worth)
        return concave_envelope(powers, values, configurations)

    def _worth_of(self, configurations: FloatArray, sets: Sequence[Box], worth: FloatArray) -> FloatArray:
        """What configurations are worth per second in a stage, `worth` being that of a computation's share each."""
        values = np.zeros(len(configurations))
        for k, box in enumerate(sets[self._rho :]):
            column = configurations[:, k]
            if self._objective == TOTAL:
                values += worth[k] * column
            elif not box.fixed:
                values += worth[k] * (column - box.lo) / (box.hi - box.lo)
        return values

    def configurations(self, sets: Sequence[Box], own: Vector) -> tuple[FloatArray, FloatArray]:
        """All that the computations may do in a stage within the trade-offs, and their powers [W], cheapest first."""
        key = self._key(sets, own)
        if key not in self._lists:
            self._lists[key] = self._listed(sets, own)
        return self._lists[key]

    def _key(self, sets: Sequence[Box], own: Vector) -> tuple[object, ...]:
        path = own[: self._rho] if self._trade_offs else ()
        return (*((box.lo, box.hi) for box in sets[self._rho :]), path)

    def _listed(self, sets: Sequence[Box], own: Vector) -> tuple[FloatArray, FloatArray]:
        rho, names = self._rho, self._plan.names
        levels = [self._values(rho + k, box) for k, box in enumerate(sets[rho:])]
        while math.prod(len(values) for values in levels) > MOST_CONFIGURATIONS:
            longest = max(range(len(levels)), key=lambda k: len(levels[k]))
            if len(levels[longest]) <= 2:
                break
            kept = levels[longest][::2]
            levels[longest] = kept if kept[-1] == levels[longest][-1] else (*kept, levels[longest][-1])
        rows, powers = [], []
        for choice in itertools.islice(itertools.product(*levels), MOST_CONFIGURATIONS):
            values = (*own[:rho], *choice)
            if any(
                sum(row.coefficients.get(name, 0.0) * value for name, value in zip(names, values, strict=True))
                < row.at_least - 1e-9
                for row in self._trade_offs
            ):
                continue
            try:
                powers.append(self._computing.power_w(values, sets))
            except Infeasible:
                continue
            rows.append(choice)
        if not rows:  # the trade-offs leave nothing: the lowest, as where nothing is feasible
            rows = [tuple(values[0] for values in levels)]
            powers = [self._computing.power_w((*own[:rho], *rows[0]), sets)]
        order = np.argsort(powers, kind="stable")
        return np.array(rows, dtype=float).reshape(len(rows), len(levels))[order], np.array(powers)[order]

    def _values(self, index: int, box: Box) -> tuple[float, ...]:
        own = self._levels.get(self._plan.names[index])
        if own is not None:
            inside = tuple(sorted(level for level in own if box.lo <= level <= box.hi))
            return inside or (box.lo,)
        return self._computing.levels(index - self._rho, box)


class _Groups:
    """Steps of segments that share a menu, gathered."""

    def __init__(self, value: float, segments: int) -> None:
        self.kinds: list[ConcaveEnvelope] = []
        self.kind_of = np.zeros(segments, dtype=np.intp)
        self.energy_j = 0.0
        self._value, self._use = value, 0.0
        self._found: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = []

    def add(self, menu: ConcaveEnvelope, index: IntArray, steps: _StepsOfMenu) -> None:
        """Segments of a menu, and their steps."""
        seconds, least_use, segment, level, use, gain = steps
        self.kind_of[index] = len(self.kinds)
        self.kinds.append(menu)
        self.energy_j += seconds * float(menu.powers_w[0] + menu.powers_w[-1]) / 2
        self._use += least_use
        self._value += seconds * float(menu.values[0])
        self._found.append((segment, level, use, gain))

    def steps(self) -> Increments:
        """All of them."""
        if len(self._found) == 1:
            return Increments(*self._found[0], self._use, self._value)
        segment, level, use, gain = (np.concatenate(arrays) for arrays in zip(*self._found, strict=True))
        return Increments(segment, level, use, gain, self._use, self._value)


_StepsOfMenu = tuple[float, float, IntArray, IntArray, FloatArray, FloatArray]
_Cell = tuple[float, float, float, float, float]
"""Voltage when empty and its rise to full [V], resistance [Ω], k_b/Q_c [1/(A s)], Q_c V crate [W]."""


# What follows is written in that part of numpy that may be compiled, see `eadp.core.compiled`.


def _quality(
    free: FloatArray,
    shares: FloatArray,
    times_s: FloatArray,
    past_s: FloatArray,
    past_areas_s: FloatArray,
    weights: FloatArray,
    path: int,
) -> tuple[FloatArray, float]:
    """What a share of each parameter adds to U per second, and what the past and the path, `path` parameters, add."""
    # by parameter: time in which it has a choice, and the area of its share, the past's and the path's to come
    free_s = past_s + free @ times_s
    areas_s = past_areas_s.copy()
    areas_s[:path] += shares[:path] @ times_s
    live = (free_s > 0.0) & (weights > 0.0)
    weight = np.where(live, weights, 0.0).sum()
    worth: FloatArray = np.where(live, weights / (max(weight, 1e-12) * np.maximum(free_s, 1e-9)), 0.0)
    return worth, (worth * areas_s).sum()


def _on_the_way(
    times_s: FloatArray,
    motion_w: FloatArray,
    peak_w: FloatArray,
    lowest_w: FloatArray,
    highest_w: FloatArray,
    soc: float,
    floor: float,
    cell: _Cell,
) -> tuple[FloatArray, FloatArray, float, float]:
    """Voltage of each segment, room for its computations [W], and `beyond_w` and `least_soc` of `KnapsackTerms`.

    The state of charge falls as the highest computations take it, but not below `floor`.
    """
    empty_v, rise_v, resistance_ohm, per_as, most_w = cell
    volts = np.full(len(times_s), empty_v + rise_v * max(floor, 0.0))
    charge_end = volts
    for _ in range(3 if rise_v != 0.0 else 1):
        taken = times_s * drains_per_s(motion_w + highest_w, volts, resistance_ohm, per_as)
        taken = taken * min(1.0, (soc - floor) / max(taken.sum(), 1e-12))
        charge_end = soc - np.cumsum(taken)
        volts = empty_v + rise_v * np.maximum(charge_end + taken / 2, 0.0)
    room = np.maximum(charge_end, 0.0) * most_w - peak_w
    beyond = 0.0
    if resistance_ohm > 0:
        deliverable = volts**2 / (4 * resistance_ohm)
        room = np.minimum(room, DELIVERABLE * deliverable - peak_w)
        beyond = max((peak_w + lowest_w - deliverable).max(), 0.0)
    # y ≤ b Q_c V crate at the end of each segment, at its cheapest, told as a charge at the end of all
    cheapest = times_s * drains_per_s(motion_w + lowest_w, volts, resistance_ohm, per_as)
    least_soc = ((peak_w + lowest_w) / most_w - (cheapest.sum() - np.cumsum(cheapest))).max()
    return volts, room, beyond, least_soc


def _steps(
    index: IntArray,
    times_s: FloatArray,
    motion_w: FloatArray,
    volts: FloatArray,
    powers_w: FloatArray,
    values: FloatArray,
    cell: _Cell,
) -> _StepsOfMenu:
    """Of segments that share a menu: their time [s], what the cheapest takes, and each step as in `Increments`."""
    _, _, resistance_ohm, per_as, _ = cell
    count = len(powers_w) - 1
    seconds = times_s[index]
    column = seconds.reshape(-1, 1)
    use = column * drains_per_s(
        motion_w[index].reshape(-1, 1) + powers_w, volts[index].reshape(-1, 1), resistance_ohm, per_as
    )
    level = np.arange(len(index) * count) % max(count, 1)
    gain = column * (values[1:] - values[:-1])
    return (
        seconds.sum(),
        use[:, 0].sum(),
        np.repeat(index, count),
        level,
        (use[:, 1:] - use[:, :-1]).ravel(),
        gain.ravel(),
    )

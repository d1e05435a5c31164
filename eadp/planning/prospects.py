"""From what is left to fly and what is known of it to the mission program's terms: time, power, charge, worth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eadp.errors import Infeasible
from eadp.models.ahead import Course
from eadp.models.battery import Battery
from eadp.models.computing import Computing
from eadp.models.itinerary import Vector
from eadp.models.plan import Box, Plan
from eadp.planning.allocation import IntArray, Menu, Steps, envelope_menu

FloatArray = NDArray[np.float64]

QUALITY, TOTAL = "quality", "total"
MOST_CONFIGURATIONS = 50_000
DELIVERABLE = 0.98
"""Share of the largest power a battery could deliver that is planned with at most."""


class Segments(NamedTuple):
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


class Past(NamedTuple):
    """What has been flown: for each parameter the time in which it had a choice [s], and the area of its share [s]."""

    times_s: Sequence[float]
    areas_s: Sequence[float]


@dataclass(frozen=True)
class Terms:
    """A segment list in the program's terms.

    Attributes
    ----------
    steps : Steps
    menus : tuple of Menu
        Of each segment.
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

    steps: Steps
    menus: tuple[Menu, ...]
    soc_per_j: float
    mean_w: float
    beyond_w: float
    least_soc: float
    worth: FloatArray


class Terrain:
    """Turns courses into the program's terms; menus are made once for each kind of segment.

    Parameters
    ----------
    plan, computing, battery
        As the mission has them.
    weights : mapping
        Weight of each parameter by name; equal without any.
    levels : mapping
        Values that computations may take, where the settings restrict them.
    trade_offs : rows
        (coefficient per parameter name, least value).
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
        trade_offs: Sequence[tuple[Mapping[str, float], float]],
        objective: str,
    ) -> None:
        self._plan, self._computing, self._battery = plan, computing, battery
        self._levels, self._trade_offs, self._objective = levels, trade_offs, objective
        self._rho = plan.path_count
        self._weights = np.array([weights.get(name, 0.0) if weights else 1.0 for name in plan.names])
        self._lists: dict[object, tuple[FloatArray, FloatArray]] = {}
        self._menus: dict[object, Menu] = {}
        self._scale_s = 0.0

    def terms(self, course: Course, segments: Segments, past: Past, soc: float, reserve_soc: float) -> Terms:
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
        alike = course.alike_in_path if self._trade_offs else course.alike
        for first, members in alike:
            powers = self.configurations(course.legs[first].stage.sets, course.parameters[first])[1]
            lowest[members], highest[members] = powers[0], powers[-1]
        # the state of charge on the way, at least: as the highest computations take it, but not below the reserve
        floor = min(reserve_soc, soc)
        volts = _voltages(b, np.full(len(times), max(floor, 0.0)))
        for _ in range(1 if b.voltage_empty_v is None else 3):
            taken = times * b.drain_per_s(segments.motion_w + highest, volts)
            taken *= min(1.0, (soc - floor) / max(float(taken.sum()), 1e-12))
            charge_end = soc - np.cumsum(taken)
            volts = _voltages(b, np.maximum(charge_end + taken / 2, 0.0))
        room = np.maximum(charge_end, 0.0) * b.power_per_soc_w - segments.peak_w
        beyond = 0.0
        if b.resistance_ohm > 0:
            room = np.minimum(room, DELIVERABLE * volts**2 / (4 * b.resistance_ohm) - segments.peak_w)
            beyond = float((segments.peak_w + lowest - volts**2 / (4 * b.resistance_ohm)).max())
        # y ≤ b Q_c V crate at the end of each segment, at its cheapest, told as a charge at the end of all
        cheapest = times * b.drain_per_s(segments.motion_w + lowest, volts)
        least_soc = float(
            ((segments.peak_w + lowest) / b.power_per_soc_w - (cheapest.sum() - np.cumsum(cheapest))).max()
        )
        groups = _Groups(worth_past, len(times))
        for first, members in alike:
            stage, own = course.legs[first].stage, course.parameters[first]
            powers = self.configurations(stage.sets, own)[1]
            allowed = np.maximum(np.searchsorted(powers, room[members], side="right"), 1)
            for count in np.unique(allowed):
                index = members[allowed == count]
                menu = self._menu(stage.sets, own, int(count), worth)
                powers_w = segments.motion_w[index][:, None] + menu.powers_w
                use = times[index][:, None] * b.drain_per_s(powers_w, volts[index][:, None])
                groups.add(index, menu, use, times[index][:, None] * menu.values)
                groups.energy_j += float(times[index].sum()) * float(menu.powers_w[0] + menu.powers_w[-1]) / 2
        mean_w = (float(segments.motion_w @ times) + groups.energy_j) / max(total_s, 1e-9)
        voltage = float(np.mean(volts))
        discriminant = max(voltage**2 - 4 * b.resistance_ohm * mean_w, (0.1 * voltage) ** 2)
        slope = b.k_b_per_s / b.capacity_ah / math.sqrt(discriminant)
        return Terms(groups.steps(), tuple(groups.menus), slope, mean_w, max(beyond, 0.0), least_soc, worth)

    # --- worth

    def _worth(self, course: Course, times: FloatArray, past: Past) -> tuple[FloatArray, float]:
        """What a share of each parameter is worth per second, and what the past and the path are worth."""
        count, rho = len(self._plan.names), self._rho
        # by parameter: time in which it has a choice, and the area of its share, the past's and the path's to come
        free_s = np.asarray(past.times_s) + course.free @ times
        area_s = np.asarray(past.areas_s, dtype=float).copy()
        area_s[:rho] += course.shares[:rho] @ times
        if self._objective == TOTAL:
            # Σ w c dt, over what the first course seen could give at most, so that it too is about 0..1
            most = np.array([self._plan.hull(j).hi if j >= rho else 0.0 for j in range(count)])
            if not self._scale_s:
                self._scale_s = float(free_s.max(initial=1.0))
            worth = self._weights * np.where(np.arange(count) >= rho, 1.0, 0.0)
            worth /= max(float((worth * most).sum()), 1e-12) * max(self._scale_s, 1e-9)
            return worth, 0.0
        live = (free_s > 0) & (self._weights > 0)
        weight = float(self._weights[live].sum())
        worth = np.where(live, self._weights / (max(weight, 1e-12) * np.maximum(free_s, 1e-9)), 0.0)
        return worth, float(worth @ area_s)

    # --- menus

    def _menu(self, sets: Sequence[Box], own: Vector, allowed: int, worth: FloatArray) -> Menu:
        """What the computations may do in a stage: the best mixes of its `allowed` cheapest configurations."""
        ours = worth[self._rho :]
        most = float(ours.max(initial=0.0))
        ratio = tuple(np.round(ours / most, 4).tolist()) if most > 0 else ()
        key = (self._key(sets, own), allowed, ratio)
        if key not in self._menus:
            configurations, powers = self.configurations(sets, own)
            self._menus[key] = self._of_envelope(configurations[:allowed], powers[:allowed], sets, ours, most)
        base = self._menus[key]  # for a worth of 1 of the dearest parameter
        return Menu(base.powers_w, base.values * most, base.configurations)

    def _of_envelope(
        self, configurations: FloatArray, powers: FloatArray, sets: Sequence[Box], worth: FloatArray, most: float
    ) -> Menu:
        values = self.values(configurations, sets, worth / most if most > 0 else worth)
        return envelope_menu(powers, values, configurations)

    def values(self, configurations: FloatArray, sets: Sequence[Box], worth: FloatArray) -> FloatArray:
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
                sum(row.get(name, 0.0) * value for name, value in zip(names, values, strict=True)) < least - 1e-9
                for row, least in self._trade_offs
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
        self.menus: list[Menu] = [_NOTHING] * segments
        self.energy_j = 0.0
        self._value, self._use = value, 0.0
        self._segments: list[IntArray] = []
        self._levels: list[IntArray] = []
        self._uses: list[FloatArray] = []
        self._gains: list[FloatArray] = []

    def add(self, index: IntArray, menu: Menu, use: FloatArray, value: FloatArray) -> None:
        """Segments with what each configuration of their menu takes and is worth, shape (segments, configurations)."""
        for i in index.tolist():
            self.menus[i] = menu
        self._use += float(use[:, 0].sum())
        self._value += float(value[:, 0].sum())
        count = use.shape[1] - 1
        if count:
            self._segments.append(np.repeat(index, count))
            self._levels.append(np.tile(np.arange(count), len(index)))
            self._uses.append(np.diff(use, axis=1).ravel())
            self._gains.append(np.diff(value, axis=1).ravel())

    def steps(self) -> Steps:
        """All of them."""
        if not self._segments:
            none = np.zeros(0, dtype=np.intp)
            return Steps(none, none, np.zeros(0), np.zeros(0), self._use, self._value)
        return Steps(
            np.concatenate(self._segments),
            np.concatenate(self._levels),
            np.concatenate(self._uses),
            np.concatenate(self._gains),
            self._use,
            self._value,
        )


_NOTHING = Menu(np.zeros(1), np.zeros(1), np.zeros((1, 0)))


def _voltages(battery: Battery, soc: FloatArray) -> FloatArray:
    return np.interp(soc, (0.0, 1.0), (battery.voltage_at(0.0), battery.voltage_at(1.0)))  # it is linear

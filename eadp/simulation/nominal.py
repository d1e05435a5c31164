"""The nominal flight where a path bends tighter than the aircraft can turn: guidance, bank limit, overshoot and all.

Elsewhere the aircraft follows its path, and the path's own length tells the time. Here the simulated aircraft flies,
without gusts and noise, from the tight turn until it is back on its path.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import CIRCLE, Point, tangent
from eadp.core.guidance import GRAVITY_MPS2
from eadp.errors import PathUndefined
from eadp.models.battery import Battery
from eadp.models.plan.cursor import PlanCursor, cursors
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.plan import Finding, Plan
from eadp.models.plan.route import LegTable, Route, RouteArrays, TightLegs, tight_legs
from eadp.models.plan.stage import Leg, Stage, left_m
from eadp.models.plan.trace import nominal_route
from eadp.models.vehicle import FixedWing, Guidance, PowerCurve
from eadp.models.weather import Wind
from eadp.planning.base import FlownLegs
from eadp.simulation.aircraft import HEIGHT_GAIN, VX, VY, X, Y, constants_of, state_of
from eadp.simulation.inner_loop import ENERGY, LOST, InnerLoop

STEP_S = 0.05
"""Time step [s]: a sixth of the default aircraft's time constant of the roll."""
CHECK_S = 1.0
"""Time between two tests whether the aircraft is back on its path [s]."""
BACK_M, BACK_RAD = 1.0, 0.1
"""Back on its path: how far from it [m], and from its direction, at most."""
STUCK_S, STUCK_TIMES = 300.0, 10.0
"""A leg has no end that takes longer than `STUCK_TIMES` the time that its length takes, and `STUCK_S` more [s]."""
SAME_WIND_MPS = 0.5
"""Winds that differ by less share a flight [m/s]."""
MAX_KEPT = 5000
"""Starts of sections of one plan whose flights are kept at most."""
MAX_STEPS = 1 << 40
"""A step that no flight reaches."""
LASTING = Battery(capacity_ah=1e9, resistance_ohm=0.0)
"""A battery that no flight empties: only power and time are of interest."""


class FlownPart(NamedTuple):
    """A section of a route as flown: from a leg that the aircraft cannot follow to the leg on which it is back on path.

    Attributes
    ----------
    rows : tuple of int
        Its legs, see `_rows_alike`.
    wind_mps : (float, float)
        The wind that it was flown in [m/s].
    times_s, turning_s : array, shape (legs,)
        Time of each leg, and the time integral of tan² of a bank that takes as much energy [s].
    off_m : array, shape (legs,)
        How far off each leg the aircraft was at most [m].
    """

    rows: tuple[int, ...]
    wind_mps: Point
    times_s: FloatArray
    turning_s: FloatArray
    off_m: FloatArray

    def tail(self, row: int) -> FlownPart:
        """The end of the section, from the leg of a row on, which is one of `rows`."""
        k = self.rows.index(row)
        return FlownPart(self.rows[k:], self.wind_mps, self.times_s[k:], self.turning_s[k:], self.off_m[k:])


class Overshoot(NamedTuple):
    """A part of a route that is flown off its path: its first and last stage, how much longer it takes [s], and the
    greatest distance from it [m]."""

    first: Stage
    last: Stage
    excess_s: float
    off_m: float


class NominalFlight:
    """Flies what an aircraft cannot follow, and keeps what it has flown.

    Parameters
    ----------
    airframe : FixedWing or PowerCurve
    guidance : Guidance

    Attributes
    ----------
    max_slope : float
        tan² of the airframe's largest bank.
    """

    def __init__(self, airframe: FixedWing | PowerCurve, guidance: Guidance) -> None:
        self._airframe, self._guidance = airframe, guidance
        self.max_slope = math.tan(math.radians(airframe.max_bank_deg)) ** 2
        self._kept: WeakKeyDictionary[LegTable, _KeptSections] = WeakKeyDictionary()

    def __reduce__(self) -> tuple[type[NominalFlight], tuple[FixedWing | PowerCurve, Guidance]]:
        """What is kept is flown again in another process."""
        return NominalFlight, (self._airframe, self._guidance)

    def times_s(self, route: Route, wind_mps: Point) -> tuple[FloatArray, list[Overshoot]]:
        """Time on each leg of a route in a wind [m/s], shape (legs,) [s], and what is flown off the path."""
        followed = FlownLegs(*route.times_s(self._airframe.airspeed_mps, wind_mps))
        tight, times_s = self._tight(RouteArrays.of([route]), wind_mps), followed.times_s.copy()
        overshoots = []
        for first, section in self._sections(route, tight, wind_mps, followed):
            legs = slice(first, first + len(section.rows))
            times_s[legs] = section.times_s
            excess_s = float((section.times_s - followed.times_s[legs]).sum())
            stages = route.of_legs[legs]
            overshoots.append(Overshoot(stages[0], stages[-1], excess_s, float(section.off_m.max())))
        return times_s, overshoots

    def flown(self, routes: Sequence[Route], wind_mps: Point, followed: FlownLegs) -> FlownLegs:
        """Times of routes' legs as flown, see `eadp.planning.base.Nominal`."""
        legs = RouteArrays.of(routes)
        tight = self._tight(legs, wind_mps)
        if not (tight.bends | tight.corners).any():
            return followed
        times_s, turning_s = followed.times_s.copy(), followed.turning_s.copy()
        squares_s2 = np.zeros(len(routes))  # of each route, the sum of the squares of what sections take longer
        for place, (route, first, last) in enumerate(zip(routes, legs.first, legs.last, strict=True)):
            mine = slice(int(first), int(last) + 1)
            alone = FlownLegs(times_s[mine], turning_s[mine])  # views: what is written to them is in the results
            part = TightLegs(tight.bends[mine], tight.corners[mine])
            sections = self._sections(route, part, wind_mps, alone)
            if not sections:
                continue
            # the legs of all sections in one array: where each section starts in it, and each leg's number in the route
            counts = np.array([len(section.rows) for _, section in sections])
            starts = counts.cumsum() - counts
            numbers = np.repeat([start for start, _ in sections] - starts, counts) + np.arange(counts.sum())
            flown_s = np.concatenate([section.times_s for _, section in sections])
            squares_s2[place] = (np.add.reduceat(flown_s - alone.times_s[numbers], starts) ** 2).sum()
            alone.times_s[numbers] = flown_s
            alone.turning_s[numbers] = np.concatenate([section.turning_s for _, section in sections])
        return FlownLegs(times_s, turning_s, np.sqrt(squares_s2))

    def _tight(self, legs: RouteArrays, wind_mps: Point) -> TightLegs:
        """The legs that the aircraft cannot follow: too tight, or with a corner at their start."""
        radius_m, speed = self._airframe.turn_radius_m, self._airframe.airspeed_mps
        return tight_legs(legs.rows, legs.order, legs.first, radius_m, speed, math.hypot(*wind_mps))

    def _sections(
        self, route: Route, tight: TightLegs, wind_mps: Point, followed: FlownLegs
    ) -> list[tuple[int, FlownPart]]:
        """The sections of a route that the aircraft cannot follow, as flown, each with the number of its first leg.

        A section that was flown before, on legs alike and in much the same wind, is not flown again.
        """
        starts = np.flatnonzero(tight.bends | tight.corners).tolist()
        if not starts:
            return []
        rows, kept = _rows_alike(route), self._kept.setdefault(route.table, _KeptSections())
        numbered = enumerate(cursors(route.cursor))  # walked along once: sections are flown in order
        sections = list[tuple[int, FlownPart]]()
        beyond = 0  # the first leg after the last section
        for first in starts:
            if first < beyond or not math.isfinite(followed.times_s[first]):
                continue
            section = kept.find(rows, first, wind_mps)
            if section is None:
                cursor = next(cursor for number, cursor in numbered if number == first)
                section = self._fly(route, cursor, rows, first, tight, wind_mps, followed)
                kept.add(rows, first, section)
            sections.append((first, section))
            beyond = first + len(section.rows)
        return sections

    def _fly(
        self,
        route: Route,
        cursor: PlanCursor,
        rows: Sequence[int],
        first: int,
        tight: TightLegs,
        wind_mps: Point,
        followed: FlownLegs,
    ) -> FlownPart:
        """Fly a section, from the start of the leg `first` until the aircraft is back on its path, or the plan ends.

        `cursor` is at the stage of that leg; `rows` are those of all legs of the route, see `_rows_alike`.
        """
        leg = route.legs[first]
        # the course at the end of the leg before; of the route's first leg, the course at its start
        courses_rad = route.table.rows.courses_rad
        course = courses_rad[route.order[first - 1], 1] if first else courses_rad[route.order[0], 0]
        executor = PlanExecutor(cursor, leg.start_m)
        loop = self._loop(leg, float(course), wind_mps)
        k = 0  # the last step flown
        of_legs: list[tuple[float, float, float]] = []  # time, turning and distance off, see `FlownPart`
        for i in range(first, len(route.legs)):
            leg, leg_s = route.legs[i], float(followed.times_s[i])
            loop.start_stage(executor, 0.0)
            began, began_j = k, loop.variable(ENERGY)
            limit = k + math.ceil((STUCK_TIMES * leg_s + STUCK_S) / STEP_S)
            k, events, back, off_m = _to_end_or_back(loop, leg, k, limit, bends=bool(tight.bends[i]))
            if events & LOST or not (events or back):  # it never gets to the end
                of_legs.append((math.inf, 0.0, off_m))
                break
            flown_s = (k - began) * STEP_S
            turning_s = self._turning_s(leg, flown_s, (loop.variable(ENERGY) - began_j) * STEP_S)
            if back:  # the rest of the leg as its path has it
                left = _share_left(loop, leg, flown_s, leg_s)
                of_legs.append((flown_s + left * leg_s, turning_s + left * float(followed.turning_s[i]), off_m))
                break
            of_legs.append((flown_s, turning_s, off_m))
            executor.handle(events, loop.variable(X), loop.variable(Y))
            if executor.complete:
                break
        return FlownPart(tuple(rows[first : first + len(of_legs)]), wind_mps, *np.array(of_legs).T)

    def _loop(self, leg: Leg, course: float, wind_mps: Point) -> InnerLoop:
        """A simulated aircraft at the start of a leg, on a course [rad], in level flight and a steady wind [m/s]."""
        wind = Wind(math.hypot(*wind_mps), towards_deg=math.degrees(math.atan2(wind_mps[1], wind_mps[0])))
        speed = leg.stage.airspeed_mps or self._airframe.airspeed_mps
        # the heading that holds the course: V sin(θ − χ) is the wind from the left
        cross = wind_mps[0] * math.sin(course) - wind_mps[1] * math.cos(course)
        heading = course + math.asin(min(max(cross / speed, -1.0), 1.0))
        airframe = replace(self._airframe, airspeed_mps=speed)
        state = state_of(airframe, wind_mps, leg.start_m, heading, leg.stage.altitude_m or 0.0)
        constants = constants_of(self._airframe, self._guidance, wind, STEP_S)
        constants[HEIGHT_GAIN] = 0.0  # no climb
        loop = InnerLoop(state, constants, LASTING, wind, np.random.default_rng(0))
        loop.set_records(MAX_STEPS, 0, MAX_STEPS)
        return loop

    def _turning_s(self, leg: Leg, flown_s: float, energy_j: float) -> float:
        """∫ tan² φ dt of a bank φ that takes, in the time of a leg as flown, the energy that the leg took [s]."""
        # E = P(0) t + (P(45°) − P(0)) ∫ tan² φ dt
        airframe, speed = self._airframe, leg.stage.airspeed_mps or self._airframe.airspeed_mps
        level_w = airframe.level_power_w(speed)
        bank_w = airframe.level_power_w(speed, math.pi / 4) - level_w  # tan² 45° = 1
        return max(energy_j - level_w * flown_s, 0.0) / bank_w if bank_w > 0 else 0.0


class _KeptSections:
    """The sections of one plan that were flown, found again on legs alike and in much the same wind.

    They are kept by their start: the leg before them, at whose end their flight begins, None at the start of a route,
    and their first leg, each as of `_rows_alike`.
    """

    def __init__(self) -> None:
        self._of_start: dict[tuple[int | None, int], list[FlownPart]] = {}

    def find(self, rows: Sequence[int], first: int, wind_mps: Point) -> FlownPart | None:
        """The section from the leg `first` of a route of `rows` on, None where it was not flown.

        A route that starts in the middle of a section, as the aircraft is on its way, has the tail of that: it was
        flown from an earlier leg on.
        """
        known: Iterable[FlownPart] = self._of_start.get(_start(rows, first), ())
        if first == 0:
            every = chain.from_iterable(self._of_start.values())
            known = chain(known, (section.tail(rows[0]) for section in every if rows[0] in section.rows))
        for section in known:
            same_wind = math.dist(section.wind_mps, wind_mps) <= SAME_WIND_MPS
            if same_wind and section.rows == tuple(rows[first : first + len(section.rows)]):
                return section
        return None

    def add(self, rows: Sequence[int], first: int, section: FlownPart) -> None:
        """Keep a section that was flown from the leg `first` on; all others are dropped where they are too many."""
        if len(self._of_start) > MAX_KEPT:
            self._of_start.clear()
        self._of_start.setdefault(_start(rows, first), []).append(section)


def _start(rows: Sequence[int], first: int) -> tuple[int | None, int]:
    """The leg before `first`, None where there is none, and `first`, by their rows."""
    return rows[first - 1] if first else None, rows[first]


def _rows_alike(route: Route) -> list[int]:
    """For each leg of a route the row of the first leg of its table that is flown the same, as of an earlier lap.

    The last leg is −1 − its own row, which no other leg is: the plan ends on it, and with the plan what is flown.
    """
    return [*route.table.alike[route.order[:-1]].tolist(), -1 - int(route.order[-1])]


def _to_end_or_back(loop: InnerLoop, leg: Leg, k: int, limit: int, *, bends: bool) -> tuple[int, int, bool, float]:
    """Fly on from step `k` to the end of a leg, until back on its path, or to the step `limit`.

    A leg that `bends` too tight is flown to its end. Returns the last step; the events that ended the leg, 0 for none;
    whether the aircraft is back; and how far off the path it was at most [m].
    """
    check, events, back, off_m = round(CHECK_S / STEP_S), 0, False, 0.0
    while not events and not back and k < limit:
        k, events = loop.run(k, min(k + check, limit))
        away_m, turned = _off(loop, leg)
        off_m = max(off_m, away_m)
        back = not events and not bends and away_m < BACK_M and turned < BACK_RAD
    return k, events, back, off_m


def _off(loop: InnerLoop, leg: Leg) -> tuple[float, float]:
    """How far the aircraft is from a leg's path [m], and the angle between its course and the path's direction [rad].

    Where the path has no direction, 0 and π: neither far off nor back.
    """
    here = loop.variable(X) - leg.offset_m[0], loop.variable(Y) - leg.offset_m[1]
    try:
        off_m = math.dist(here, leg.track.nearest(here))
        along_x, along_y = tangent(leg.path, here, leg.stage.sense)
    except PathUndefined:
        return 0.0, math.pi
    turned = math.atan2(loop.variable(VY), loop.variable(VX)) - math.atan2(along_y, along_x)
    return off_m, abs(math.remainder(turned, 2 * math.pi))


def _share_left(loop: InnerLoop, leg: Leg, flown_s: float, leg_s: float) -> float:
    """Share of a leg's length that is left where the aircraft is, `flown_s` after its start; all takes `leg_s`."""
    if leg.distance_m <= 0:
        return 0.0
    position = loop.variable(X), loop.variable(Y)
    along_m = min(flown_s / max(leg_s, 1e-9), 1.0) * leg.distance_m  # by the time: roughly where on the leg
    return left_m(leg, position, along_m) / leg.distance_m


# --- turns that an aircraft cannot follow, by what is flown instead

NAMED_M = 10.0
"""Distance from the path beyond which a turn is named [m]: how near to a waypoint PX4 has to be, by default."""
MOST = 3
"""How many turns of a plan are named where a flight in wind leaves all of them: what mends one mends the others."""
NEAR = 0.95
"""Turns of so much of the least radius stay within `NAMED_M` of their paths without wind."""


def is_tight(plan: Plan, turn_radius_m: float) -> bool:
    """Whether a mission's plan has a turn that is clearly tighter than a radius [m], as one without room for it has."""
    circles = [stage for stage in plan.stages if stage.kind == CIRCLE]
    tracks = [stage.track(stage.path_at(()), stage.trigger_at(())) for stage in circles]
    return any(track.radius_m() < NEAR * turn_radius_m for track in tracks)


def calm_findings(plan: Plan, turn_radius_m: float) -> list[Finding]:
    """As `overshoot_findings`, of the default aircraft with turns of a radius [m], without wind."""
    speed, route = FixedWing.airspeed_mps, nominal_route(plan, ())
    bank_deg = math.degrees(math.atan(speed**2 / (GRAVITY_MPS2 * turn_radius_m)))
    airframe = replace(FixedWing(), max_bank_deg=bank_deg)
    return overshoot_findings(NominalFlight(airframe, Guidance()).times_s(route, (0.0, 0.0))[1])


def overshoot_findings(overshoots: Sequence[Overshoot], most: int | None = None) -> list[Finding]:
    """Warnings of the turns that are flown far off their paths, each item once; of more than `most`, the worst are
    named, and the others counted."""
    found: dict[str, Finding] = {}
    worst_first = sorted(overshoots, key=lambda one: -one.excess_s)
    for first, last, excess_s, off_m in worst_first:
        if math.isinf(excess_s):
            flown = "it circles, and never gets past it"
        elif off_m > NAMED_M:
            back = "" if last.label == first.label else f", back on it before {last.label}"
            flown = f"it flies up to {off_m:.0f} m beside the path, in {excess_s:+.1f} s{back}"
        else:
            continue
        message = f"{first.label}: a turn tighter than the aircraft's: {flown}"
        found.setdefault(first.label, Finding("warning", first.index, first.line, "overshoot", message))
    named, rest = list(found.values()), []
    if most is not None and len(named) > most + 1:
        message = f"{len(named) - most} more turns tighter than the aircraft's, each with less delay"
        named, rest = named[:most], [replace(named[most], message=message)]
    return sorted(named, key=lambda one: one.line) + rest

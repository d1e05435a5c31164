"""A mission's items as the stages of a plan: what is flown, in order, and the paths between."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import constant
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Piece
from eadp.core.geometry.geodesy import FARTHEST_M, apart_m, to_near_local_m
from eadp.core.guidance import RATE_SHARE, air_density_kgpm3, calibrated_share
from eadp.errors import Fault, Unreachable, refuse
from eadp.exchange import items as d
from eadp.exchange.items import MOTIONLESS, DraftItem, MissionDraft, command_text
from eadp.exchange.waypoints import ON_CIRCLE_M, Loiter, Target, Waypoint, WaypointPath, path_through
from eadp.io.plan.reader import LIMIT_STAGES
from eadp.io.plan.sources import PlanReader
from eadp.io.text.streams import Location, Text
from eadp.models.airspace import Airspace, Obstacle
from eadp.models.plan.pieces import LOITER, TRIGGER_RADIUS_M, piece_path
from eadp.models.plan.plan import Finding, Plan, Site
from eadp.models.plan.stage import Stage

LOW_M = 50.0
"""Height below home beyond which an altitude above the sea may be one above home [m]."""
SETTLING_S = 8.0
"""Time that an aircraft takes to hold an altitude once its climb ends [s]."""
LOITER_RADIUS_M = 60.0
"""Radius of a loiter that states none, which is ArduPilot's default [m]."""
FAR_HOME_M = 20_000.0
"""Distance of the first waypoint from home beyond which home may be another place [m]."""
SAME_POINT_DEG = 1e-9

_POSITIONED = frozenset((
    d.WAYPOINT, d.LOITER_UNLIMITED, d.LOITER_TURNS, d.LOITER_TIME, d.LAND, d.TAKEOFF, d.LOITER_TO_ALTITUDE, d.SPLINE,
    d.VTOL_TAKEOFF, d.VTOL_LAND,
))  # fmt: skip
_LOITERS = frozenset((d.LOITER_UNLIMITED, d.LOITER_TURNS, d.LOITER_TIME, d.LOITER_TO_ALTITUDE))
_LANDS = frozenset((d.LAND, d.VTOL_LAND))
_ENDS = _LANDS | {d.RETURN, d.LOITER_UNLIMITED}
_HERE_IF_NULL = frozenset((d.TAKEOFF, d.VTOL_TAKEOFF, *_LANDS))
_MOVING = _POSITIONED | {d.RETURN}
_CONTROLS = frozenset((d.JUMP, d.CHANGE_SPEED, d.LAND_START)) | MOTIONLESS


class _Visit(NamedTuple):
    """A target with what holds on the way to it."""

    target: Target
    item: DraftItem
    altitude_m: float | None
    airspeed_mps: float | None
    commands: tuple[tuple[float, ...], ...]


@dataclass
class _Climb:
    """The aircraft's height along a mission, as its climbs and descents take time.

    `rates_mps` are those of climb and of descent [m/s], and `up_m` is the height that it has by now [m].
    """

    rates_mps: tuple[float, float]
    up_m: float = 0.0

    def fly_to(self, item: DraftItem, altitude_m: float | None, way_s: float, turn_s: float) -> float:
        """Climb on the way to an item; return the climb that its circle has to make [m], below 0 of a descent.

        `way_s` is the time of the way, and `turn_s` that of a turn of its circle [s].
        """
        if item.command == d.TAKEOFF:  # which goes on beyond its altitude
            self.up_m += self.rates_mps[0] * way_s
            return 0.0
        if altitude_m is None:
            self.up_m = 0.0
            return 0.0
        change_m = altitude_m - self.up_m
        rate_mps = self.rates_mps[change_m <= 0]
        left_m = max(abs(change_m) - rate_mps * way_s, 0.0)
        self.up_m = altitude_m if item.command in _LOITERS else altitude_m - math.copysign(left_m, change_m)
        if item.command == d.LOITER_TO_ALTITUDE and abs(change_m) > rate_mps * max(way_s - SETTLING_S, 0.0):
            left_m = max(left_m, rate_mps * turn_s)  # one that is not over as the circle begins takes a turn
        return math.copysign(left_m, change_m)


@dataclass
class _Walk:
    """A mission's items in the order flown so far, by their indices, and how often each jump was taken."""

    order: list[int] = field(default_factory=list)
    taken: Counter[int] = field(default_factory=Counter)
    flown_m: float = 0.0
    _here: Point = (0.0, 0.0)
    _moves: int = 0
    _moves_at: dict[int, int] = field(default_factory=dict)  # when a jump was taken last

    def fly(self, index: int, point: Point | None, turns_m: float, *, moves: bool) -> None:
        """Add an item, at a point or where the aircraft is, and the length of its turns."""
        self.order.append(index)
        if moves:
            self._moves += 1
            self.flown_m += math.dist(self._here, point or self._here) + turns_m
            self._here = point or self._here

    def jump(self, index: int) -> bool:
        """Take a jump; return whether anything was flown since it was taken last."""
        if self._moves_at.get(index) == self._moves:
            return False
        self._moves_at[index] = self._moves
        self.taken[index] += 1
        return True


def _is_placed(item: DraftItem) -> bool:
    """Whether an item has a position, and not that of the aircraft."""
    latitude, longitude = item.parameters[4:6]
    placed = abs(latitude) <= 90 and abs(longitude) <= 360 and max(abs(latitude), abs(longitude)) >= SAME_POINT_DEG
    return item.command in _POSITIONED and placed


def _command(item: DraftItem) -> tuple[float, ...]:
    """An item as the command of a stage."""
    return (float(item.command), *(0.0 if math.isnan(value) else value for value in item.parameters))


def _without_place(item: DraftItem) -> tuple[float, ...]:
    """As `_command`, of an item whose place is the path's."""
    return (*_command(item)[:5], 0.0, 0.0, 0.0)


def _commands_by_piece(visits: Sequence[_Visit], path: WaypointPath) -> list[list[tuple[float, ...]]]:
    """What is commanded on each piece of a path: on the way to its target, and to those before that take no way.

    On the last piece also what is commanded before last targets that take none.
    """
    found: list[list[tuple[float, ...]]] = []
    done = 0  # targets whose commands are given
    for target, piece in path.pieces:
        visit = visits[target]
        commands = [each for earlier in visits[done : target + 1] for each in earlier.commands]
        done = max(done, target + 1)
        circles = piece.centre_m is not None and math.dist(piece.centre_m, visit.target.centre_m) < ON_CIRCLE_M
        if visit.item.command == d.LOITER_TO_ALTITUDE and circles:
            commands.append(LOITER)
        found.append(commands)
    found[-1] += [each for visit in visits[done:] for each in visit.commands]
    return found


def _end_of(piece: Piece, before: Point | None) -> Point:
    """Where a piece ends [m], after one that ends at `before`, if there is one.

    A whole turn ends where it begins, which a way that is too short to be a piece may be away from.
    """
    if before is None or piece.centre_m is None or piece.start != piece.end:
        return piece.end[:2]
    cx, cy = piece.centre_m
    bearing = math.atan2(before[1] - cy, before[0] - cx)
    return cx + piece.radius_m * math.cos(bearing), cy + piece.radius_m * math.sin(bearing)


@dataclass
class MissionPlan:
    """The plan of a draft, for an aircraft with the turns and speeds of a reader; faults and findings by the way."""

    source: Text
    draft: MissionDraft
    motion: PlanReader
    faults: list[Fault] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    points: dict[int, Point | None] = field(default_factory=dict)
    """Where each item with a position lies [m]; None for where the aircraft is."""

    def plan(self) -> tuple[Plan, list[Finding]]:
        for doubt in self.draft.doubts:
            self._find(*doubt)
        self._check_home()
        for index, item in enumerate(self.draft.items):
            self._check_item(index, item)
        refuse(self.faults)
        if self.draft.multirotor:
            message = "the mission is for a multirotor; it is read as one of a fixed wing, which hovers on circles"
            self._find((1, 1), "multirotor", message)
        visits = self._visits(self._order())
        refuse(self.faults)
        return self._assembled(visits), self.findings

    def _fault(self, location: Location, item: DraftItem, message: str, expected: str) -> None:
        self.faults.append(self.source.fault(location, f"{item.label}: {message}", expected))

    def _find(self, location: Location, code: str, message: str) -> None:
        self.findings.append(Finding("warning", None, location[0], code, message, location[1]))

    # --- items as they stand

    def _check_home(self) -> None:
        latitude, longitude, altitude = self.draft.home
        if not (abs(latitude) <= 90 and abs(longitude) <= 180 and abs(altitude) <= d.HIGHEST_M):
            message = f"home at latitude {latitude:.10g}, longitude {longitude:.10g}, altitude {altitude:.10g}"
            expected = "degrees within ±90 and ±180, and metres"
        elif latitude == longitude == 0:
            first = next((item for item in self.draft.items if _is_placed(item)), None)
            above_sea = [
                item for item in self.draft.items if _is_placed(item) and d.GLOBAL_FRAMES.get(item.frame) == d.ABSOLUTE
            ]
            if first is not None and not above_sea:
                self.draft.home = (*first.parameters[4:6], 0.0)
                message = f"home has no position: taken as that of {first.label}, its first item with one"
                self._find(self.draft.home_location, "no-home", message)
                return
            message, expected = "home has no position", "its latitude and longitude"
            if above_sea:
                expected += f", and its altitude: that of {above_sea[0].label} is above the sea"
        else:
            return
        raise self.source.error(self.draft.home_location, message, expected)

    def _check_item(self, index: int, item: DraftItem) -> None:
        command, at = item.command, item.locations
        if command not in _MOVING | _CONTROLS:
            expected = "a command for fixed wings that eadp knows (docs/missions.md lists them)"
            self._fault(at[0], item, f"the command {command_text(command)} cannot be flown", expected)
        elif command in _POSITIONED:
            if item.frame not in d.GLOBAL_FRAMES:
                self._fault(at[1], item, f"the frame {item.frame}", f"one of {', '.join(map(str, d.GLOBAL_FRAMES))}")
            self.points[index] = self._point_of(item)
        for k, value in enumerate(item.parameters):
            if not abs(value) <= 1e9 and not math.isnan(value):
                self._fault(at[k + 2], item, f"a parameter of {value:g}", "a number of at most 1e9")
        p1, p2 = item.parameters[:2]
        if command in (d.LOITER_TIME, d.LOITER_TURNS) and not p1 >= 0:
            self._fault(at[2], item, "no time or number of turns", "a number of 0 or more")
        if command == d.JUMP and math.isnan(p2):
            self._fault(at[3], item, "no number of repetitions", "a number, -1 for ever")
        if command == d.CHANGE_SPEED and p1 in (0, 1) and not (p2 in (-1, 0, d.DEFAULT_SPEED) or 0.1 <= p2 <= 1000):
            expected = "one above 0, -1 for no change, or -2 for the default airspeed"
            self._fault(at[3], item, f"a speed of {p2:g} m/s", expected)

    def _point_of(self, item: DraftItem) -> Point | None:
        """Where an item lies [m]; None where the aircraft is, or with a fault."""
        (latitude, longitude, altitude), at = item.parameters[4:], item.locations
        if math.isnan(latitude) or math.isnan(longitude):
            if item.command not in _HERE_IF_NULL:
                self._fault(at[6], item, "no coordinates", "a latitude and a longitude")
            return None
        if abs(altitude) > d.HIGHEST_M:
            self._fault(at[8], item, f"an altitude of {altitude:.10g} m", f"at most {d.HIGHEST_M:g} m")
        if 180 < abs(longitude) <= 360:  # counted on across the antimeridian
            longitude = math.remainder(longitude, 360.0)
        if abs(latitude) > 90:
            self._fault(at[6], item, f"a latitude of {latitude:.10g}", "degrees within ±90")
            return None
        if abs(longitude) > 180:
            self._fault(at[7], item, f"a longitude of {longitude:.10g}", "degrees within ±180")
            return None
        if max(abs(latitude), abs(longitude)) < SAME_POINT_DEG:
            return None
        point = to_near_local_m(latitude, longitude, self._origin_deg)
        if point is None:
            far_m = apart_m(self._origin_deg, (latitude, longitude))
            message = f"too far from home, {far_m / 1000:.0f} km: home may be another place"
            self._fault(at[6], item, message, f"at most {FARTHEST_M / 1000:g} km")
        return point

    # --- items in the order flown

    def _order(self) -> list[int]:
        """The items in the order flown: jumps followed, up to the landing or the return."""
        items, walk = self.draft.items, _Walk()
        self._check_jumps()
        i = 0
        while i < len(items):
            item = items[i]
            if item.command == d.JUMP and walk.taken[i] < self._repetitions(item, walk.taken[i], walk.flown_m):
                if not walk.jump(i):
                    message = f"a jump to item {item.parameters[0]:g} and back here that flies nothing"
                    self._fault(item.locations[2], item, message, "a jump to before a waypoint")
                    return walk.order
                i = self._numbers[int(item.parameters[0])]
                continue
            turns_m = 0.0
            if item.command in _LOITERS:
                turns_m = 2 * math.pi * abs(self._radius_m(item)) * self._turns(item, None, 0.0)
            walk.fly(i, self.points.get(i) if item.command in _MOVING else None, turns_m, moves=item.command in _MOVING)
            if len(walk.order) > d.ITEMS_LIMIT:
                expected = "fewer repetitions, or --laps N where it repeats for ever"
                self._fault(item.locations[0], item, f"more than {d.ITEMS_LIMIT} items are flown", expected)
                return walk.order
            if item.command in _ENDS:
                break
            i += 1
        self._check_left_out(walk.order)
        return walk.order

    @cached_property
    def _numbers(self) -> dict[int, int]:
        """The index of the first item of each number."""
        return {item.number: i for i, item in reversed(list(enumerate(self.draft.items)))}

    def _check_jumps(self) -> None:
        """Refuse jumps to items that are not there."""
        for item in self.draft.items:
            if item.command == d.JUMP and item.parameters[0] not in self._numbers:
                message = f"a jump to item {item.parameters[0]:g}, which is not there"
                self._fault(item.locations[2], item, message, f"1 to {self.draft.items[-1].number}")
        refuse(self.faults)

    def _repetitions(self, item: DraftItem, taken: int, flown_m: float) -> float:
        """How often a jump is taken, `taken` so often by now; one for ever, until the length flown is enough."""
        stated = item.parameters[1]
        if stated >= 0:
            return stated
        if self.motion.laps is not None:
            return self.motion.laps - 1
        if flown_m <= self.motion.repeated_m:
            return math.inf
        planned = f"{taken + 1} laps are planned, {flown_m / 1000:.0f} km"
        message = f"{item.label} repeats for ever: {planned}; --laps sets their number"
        self._find(item.locations[0], "repeats", message)
        return taken

    def _check_left_out(self, order: list[int]) -> None:
        """Find what is not flown as the mission ends before it; after a loiter without end that is a fault."""
        items, last, flown = self.draft.items, order[-1] if order else 0, set(order)
        left = [later for i, later in enumerate(items) if i > last and i not in flown and later.command in _MOVING]
        if not left:
            return
        if items[last].command == d.LOITER_UNLIMITED:
            expected = "a number of turns, or no waypoint after it"
            self._fault(items[last].locations[0], items[last], "a loiter without end before other items", expected)
        ending = f"{items[last].label}, {command_text(items[last].command)}, ends the mission"
        self._find(left[0].locations[0], "not-flown", f"{left[0].label} and what follows it is not flown: {ending}")

    def _radius_m(self, item: DraftItem) -> float:
        """The signed radius of a loiter [m]: MAVLink's is above 0 clockwise; ±1 and 0 are directions alone."""
        stated = item.parameters[1 if item.command == d.LOITER_TO_ALTITUDE else 2]
        if math.isnan(stated):
            stated = 0.0
        size = abs(stated) if abs(stated) > 1 else LOITER_RADIUS_M
        return size if stated < 0 else -size

    def _turns(self, item: DraftItem, airspeed_mps: float | None, climb_m: float) -> float:
        """The turns of a loiter; those of a time are flown at the airspeed, without wind."""
        round_m = 2 * math.pi * abs(self._radius_m(item))
        speed = airspeed_mps or self.motion.airspeed_mps
        if item.command == d.LOITER_TURNS:
            return item.parameters[0]
        if item.command == d.LOITER_TIME:
            return item.parameters[0] * speed / round_m
        if item.command == d.LOITER_TO_ALTITUDE:
            return abs(climb_m) / self._climb_rates_mps[climb_m <= 0] * speed / round_m
        return 1.0

    @property
    def _climb_rates_mps(self) -> tuple[float, float]:
        """The rates of climb and of descent at which ways and circles are planned [m/s]."""
        return RATE_SHARE * self.motion.climb_rate_mps, RATE_SHARE * self.motion.descent_rate_mps

    def _visits(self, order: list[int]) -> list[_Visit]:
        """The targets of the items in order, with altitude, airspeed and commands on the way to them."""
        visits: list[_Visit] = []
        commands: list[tuple[float, ...]] = []
        altitude: float | None = None
        airspeed: float | None = None
        here: Point = (0.0, 0.0)
        climb = _Climb(self._climb_rates_mps)
        for index in order:
            item = self.draft.items[index]
            if item.command == d.CHANGE_SPEED and item.parameters[0] in (0, 1):
                airspeed = self._commanded_mps(item, airspeed)
            elif item.command in _MOVING:
                left, here = here, (0.0, 0.0) if item.command == d.RETURN else self.points.get(index) or here
                before_m, altitude = altitude, self._altitude_m(item, here, altitude)
                if visits and visits[-1].item.command == d.TAKEOFF:  # to the higher altitude of both
                    climb.up_m = min(climb.up_m, max(before_m or 0.0, altitude or 0.0))
                speed = airspeed or self.motion.airspeed_mps
                radius_m = abs(self._radius_m(item)) if item.command in _LOITERS else 0.0
                way_s, turn_s = max(math.dist(left, here) - radius_m, 0.0) / speed, 2 * math.pi * radius_m / speed
                climb_m = climb.fly_to(item, altitude, way_s, turn_s)
                target = self._target(index, item, here, airspeed, climb_m)
                if item.command == d.TAKEOFF and not visits:
                    commands.append((*_without_place(item)[:-1], altitude or 0.0))
                if target is not None:
                    visits.append(_Visit(target, item, altitude, airspeed, tuple(commands)))
                    commands = []
            elif item.command in MOTIONLESS or item.command in (d.CHANGE_SPEED, d.LAND_START):
                commands.append(_command(item))
        if [each[1] for each in commands if each[0] == d.TRIGGER_DISTANCE][-1:] == [0]:  # where nothing more is flown
            commands = [each for each in commands if each[0] != d.TRIGGER_DISTANCE]
        if commands and visits:
            visits[-1] = visits[-1]._replace(commands=(*visits[-1].commands, *commands))
        return visits

    def _commanded_mps(self, item: DraftItem, before: float | None) -> float | None:
        """The true airspeed after a change of speed [m/s], None for the aircraft's own; `before` is that before it."""
        of_ground, speed = item.parameters[0] == 1, item.parameters[1]
        if speed == d.DEFAULT_SPEED:
            return None
        if not speed > 0:
            return before
        if not of_ground:
            return round(speed / self._calibrated, 6)
        self._find(item.locations[2], "ground-speed", f"{item.label}: a ground speed, taken as an airspeed")
        return speed

    @cached_property
    def _ground_m(self) -> dict[Point, float]:
        """Height of the ground above the sea at home and the items [m]; empty where it is not known."""
        points = [(0.0, 0.0), *filter(None, self.points.values())]
        ground = self.motion.ground
        return {} if ground is None else dict(zip(points, ground(np.array(points), self._origin_deg), strict=True))

    @cached_property
    def _zero_m(self) -> float | None:
        """Height of home above the sea [m], where altitudes are above a ground that is known."""
        if self._ground_m:
            return round(float(self._ground_m[0.0, 0.0]), 2)
        return None if all(item.above_sea_m is None for item in self.draft.items) else self.draft.home[2]

    @property
    def _height_m(self) -> float | None:
        """Height of home above the sea [m]; one of 0 is not set."""
        return self.draft.home[2] or None

    @cached_property
    def _calibrated(self) -> float:
        """Calibrated over true airspeed at home."""
        height_m = self._height_m if self._zero_m is None else self._zero_m
        return self.motion.calibrated if height_m is None else float(calibrated_share(air_density_kgpm3(height_m)))

    def _altitude_m(self, item: DraftItem, place: Point, before: float | None) -> float | None:
        """The altitude above home at an item [m]: a landing's is that of the ground, a return's the one before."""
        altitude = item.parameters[6]
        if item.command == d.RETURN or math.isnan(altitude):
            return before
        frame = d.GLOBAL_FRAMES[item.frame]
        if frame == d.TERRAIN and self._zero_m is not None:
            if self._ground_m:
                return round(altitude + float(self._ground_m[place]) - self._zero_m, 2)
            if item.above_sea_m is not None:
                return round(item.above_sea_m - self._zero_m, 2)
        if frame == d.TERRAIN and not any(finding.code == "terrain" for finding in self.findings):
            message = f"{item.label}: an altitude above ground, taken as above home; eadp plan --terrain has the ground"
            self._find(item.locations[1], "terrain", message)
        if frame != d.ABSOLUTE:
            return altitude
        above_m = altitude - self.draft.home[2]
        if above_m < -LOW_M and not any(finding.code == "below-home" for finding in self.findings):
            message = f"{item.label}: {altitude:g} m above the sea, which is {-above_m:.0f} m below home"
            self._find(item.locations[8], "below-home", message)
        return above_m

    def _target(
        self, index: int, item: DraftItem, here: Point, airspeed: float | None, climb_m: float
    ) -> Target | None:
        """What an item flies to; None where it stays where the aircraft is."""
        p1, p2, p3 = (0.0 if math.isnan(value) else value for value in item.parameters[:3])
        if item.command in _LOITERS:
            turns = self._turns(item, airspeed, climb_m)
            if turns > LIMIT_STAGES:
                self._fault(item.locations[2], item, f"{turns:.0f} turns", f"at most {LIMIT_STAGES}")
                return None
            return Loiter(here, self._radius_m(item), turns)
        if item.command != d.RETURN and self.points[index] is None:
            return None
        if item.command == d.SPLINE:
            message = f"{item.label}: a spline waypoint, flown as a waypoint"
            self._find(item.locations[0], "spline", message)
        if item.command in (d.WAYPOINT, d.SPLINE):
            if p1 > 0:  # a fixed wing holds on a circle
                round_m = 2 * math.pi * LOITER_RADIUS_M
                return Loiter(here, -LOITER_RADIUS_M, p1 * (airspeed or self.motion.airspeed_mps) / round_m)
            return Waypoint(here, p2 if p2 > 0 else self.motion.turn_radius_m, abs(p3), max(p2, 0.0))
        return Waypoint(here, self.motion.turn_radius_m)

    # --- the plan

    def _assembled(self, visits: list[_Visit]) -> Plan:
        path = self._path(visits)
        stages = self._stages(visits, path)
        last = visits[-1].item
        if last.command in (d.LAND, d.RETURN):
            stages[-1] = replace(stages[-1], commands=(*stages[-1].commands, _without_place(last)))
        self._doubt_home(visits[0])
        self._doubt_altitudes(visits)
        shortest_m = min(piece.length_m for _, piece in path.pieces)
        return Plan(
            name=self.source.name,
            stages=tuple(stages),
            path_count=0,
            trigger_radius_m=min(TRIGGER_RADIUS_M, float(f"{0.9 * shortest_m:.2g}")),
            min_radius_m=self.motion.turn_radius_m,
            site=Site(
                self._origin_deg,
                (0.0, 0.0),
                home_m=(0.0, 0.0),
                airspace=self._airspace(),
                ground_m=self._zero_m,
                height_m=self._height_m,
            ),
        )

    def _path(self, visits: list[_Visit]) -> WaypointPath:
        """The path along all targets; with findings of those that are too close. Raises InputError without a path."""
        radius_m = self.motion.turn_radius_m
        try:
            path = path_through((0.0, 0.0), [visit.target for visit in visits], radius_m)
        except Unreachable as error:
            item = visits[error.target].item
            raise self.source.error(item.locations[0], f"{item.label}: {error}", "a point outside of it") from None
        if not path.pieces and self.draft.fences:
            raise self.source.error(self.draft.fences[0].location, d.NO_MISSION, d.FOR_FENCE)
        if not path.pieces:
            raise self.source.error(self.draft.home_location, "no item moves the aircraft", "a waypoint")
        if len(path.pieces) > LIMIT_STAGES:
            jumps = [each for each in self.draft.items if each.command == d.JUMP]
            endless = next((each for each in jumps if each.parameters[1] < 0), None)
            longest = endless or max(jumps, key=lambda each: each.parameters[1], default=None)
            often = "for ever" if endless or longest is None else f"{longest.parameters[1]:g} times"
            what = "" if longest is None else f", as {longest.label} jumps back {often}"
            expected = f"at most {LIMIT_STAGES}: fewer repetitions, or --laps N of one that repeats for ever"
            where = (1, 1) if longest is None else longest.locations[3]
            raise self.source.error(where, f"{len(path.pieces)} legs and turns{what}", expected)
        seen: set[int] = set()
        for tight in path.tight:
            item = visits[tight.target].item
            if item.number not in seen:
                seen.add(item.number)
                message = (
                    f"{item.label} is {tight.distance_m:.1f} m from the one before, where turns of {radius_m:.1f} m "
                    f"radius need {tight.needed_m:.1f} m"
                )
                self._find(item.locations[0], "too-close", message)
        return path

    def _stages(self, visits: list[_Visit], path: WaypointPath) -> list[Stage]:
        """The pieces of a path as stages, with what is commanded on the way."""
        stages: list[Stage] = []
        read = cache(read_expression)  # laps have theirs in common
        end: Point | None = None
        for (target, piece), commands in zip(path.pieces, _commands_by_piece(visits, path), strict=True):
            visit, end = visits[target], _end_of(piece, end)
            function, rotation, gain = piece_path(piece)
            x, y = (constant(round(value, 9)) for value in end)
            stages.append(
                Stage(
                    len(stages) + 1,
                    visit.item.locations[0][0],
                    float(f"{gain:.4g}"),
                    rotation,
                    read(function),
                    (x, y),
                    altitude_m=visit.altitude_m,
                    airspeed_mps=visit.airspeed_mps,
                    commands=tuple(commands),
                    item=visit.item.label,
                )
            )
        return stages

    def _doubt_home(self, first: _Visit) -> None:
        """Find a home that may be another place."""
        far_m = math.hypot(*first.target.centre_m)
        if far_m > FAR_HOME_M:
            message = f"home is {far_m / 1000:.0f} km from {first.item.label}: it may be that of another place"
            self._find(self.draft.home_location, "far-home", message)

    def _doubt_altitudes(self, visits: Sequence[_Visit]) -> None:
        """Find waypoints that have no height."""
        placed = [each for each in visits if each.item.command in _POSITIONED - _LANDS and each.altitude_m is not None]
        if placed and all(each.altitude_m == 0 for each in placed):
            message = f"{placed[0].item.label}: every waypoint is 0 m above home: altitudes may be missing"
            self._find(placed[0].item.locations[8], "no-altitude", message)

    @property
    def _origin_deg(self) -> Point:
        return self.draft.home[0], self.draft.home[1]

    def _airspace(self) -> Airspace:
        """The fences: obstacles and boundary. Raises InputError of one that is far away, or crosses itself."""
        rings = [(fence.inclusion, self._ring(fence)) for fence in self.draft.fences]
        outside = [ring for inclusion, ring in rings if not inclusion]
        obstacles = tuple(Obstacle(ring, f"fence {i}") for i, ring in enumerate(outside, 1))
        return Airspace(obstacles, tuple(ring for inclusion, ring in rings if inclusion))

    def _ring(self, fence: d.Fence) -> tuple[Point, ...]:
        """The corners of a fence [m]."""
        from eadp.core.geometry.polygons import flaw

        placed = [to_near_local_m(*corner, self._origin_deg) for corner in fence.corners_deg]
        ring = tuple(point for point in placed if point is not None)
        if len(ring) < len(placed):
            expected = f"latitude before longitude, at most {FARTHEST_M / 1000:g} km from home"
            raise self.source.error(fence.location, "a fence far from home", expected)
        if defect := flaw(ring, ()):
            message = f"a fence that {defect.message} at ({{:.1f}}, {{:.1f}}) m from home".format(*defect.point_m)
            raise self.source.error(fence.location, message, "corners in the order round it")
        return ring

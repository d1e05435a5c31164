"""Plans as missions of autopilots and as maps, and which stages the items of a mission lead along.

`EXPORTS` lists the formats. Missions are written from items: lines by their ends, whole and half turns as loiters,
other arcs as corners whose fillets they are; for PX4, which refuses `LOITER_TURNS`, all arcs as corners near them.
The map of the items to stages is a file of its own: a ground station drops what it does not know.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple

from annotated_types import Ge, Le, MaxLen

from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import Fault
from eadp.exchange import items as d
from eadp.exchange.autopilot import ACCEPTANCE_M
from eadp.exchange.items import ITEMS_LIMIT, NO_POSITION, Fence, MissionItem
from eadp.exchange.path import (
    EXPORT_NAMES,
    FENCE_ENDING,
    Arc,
    PlannedPath,
    Section,
    geojson_text,
    gpx_text,
    kml_text,
    one_circle,
    paparazzi_text,
)
from eadp.exchange.reader import ARDUPILOT, PX4, fence_text, qgc_text, wpl_text
from eadp.exchange.waypoints import ARC_RAD, TURNS_TOLERANCE
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import STRICT, keys_document, validated
from eadp.models.plan.pieces import CLIMB_OUT_M
from eadp.models.plan.route import PlannedLegs
from eadp.models.plan.stage import Stage
from eadp.plug_ins import plug_in

SCHEMA = "eadp.items/1"
SAME_DEG = 2e-7
"""How far a position may be off that was sent in units of 1e-7 degrees, or as single precision's next one."""


class MappedItem(NamedTuple):
    """An item of a mission, and the stages that it leads along.

    Attributes
    ----------
    item : MissionItem
    first, last : int
        The numbers of the first and last stage that is started on the way to it, over the whole flight, from 1.
    parameters : tuple of float
        Path parameters in force there.
    """

    item: MissionItem
    first: int
    last: int
    parameters: tuple[float, ...]


def mapped_items(items: Sequence[MissionItem], planned: PlannedLegs, path_count: int) -> list[MappedItem]:
    """Items that lead along legs, with their stages and the path parameters in force."""
    started = planned.started
    return [
        MappedItem(item, started + item.legs[0], started + item.legs[1], planned.parameters[item.legs[0]][:path_count])
        for item in items
    ]


def items_text(items: Sequence[MappedItem], path_names: Sequence[str]) -> str:
    """The file of a map: a row for each item, home aside."""
    head = {"schema": SCHEMA, "path_parameters": list(path_names)}
    rows = [
        json.dumps([each.item.command, *each.item.parameters[4:6], each.first, each.last, *each.parameters])
        for each in items
    ]
    return json.dumps(head)[:-1] + ', "items": [\n' + ",\n".join(rows) + "\n]}\n"


@dataclass(frozen=True)
class ItemsFile:
    """A map of a mission's items: for each its command, its place, its first and last leg, and path parameters."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.items/1"]
    path_parameters: list[str]
    items: Annotated[list[list[Annotated[float, Ge(-1e12), Le(1e12)]]], MaxLen(ITEMS_LIMIT)]


def read_items(path: str, path_names: Sequence[str]) -> list[MappedItem]:
    """A map of the mission of a plan with these path parameters.

    Raises
    ------
    InputError
        If it is no such file, or the map of another plan's mission.
    """
    return parse_items(read_text(path), path_names)


def parse_items(text: Text, path_names: Sequence[str]) -> list[MappedItem]:
    """As `read_items`, of a text."""
    document = keys_document(text, SCHEMA)

    def check(file: ItemsFile) -> list[Fault]:
        if file.path_parameters != list(path_names):
            known = ", ".join(path_names) or "none"
            return [document.fault(("path_parameters",), "is of another plan", f"the path parameters {known}")]
        width, started, faults = 5 + len(path_names), 1, []
        for number, row in enumerate(file.items):
            whole = len(row) == width and all(value == int(value) for value in (row[0], *row[3:5]))
            if not whole or not started <= row[3] <= row[4]:
                expected = "command, latitude, longitude, first and last stage, and the path parameters"
                faults.append(document.fault(("items", number), "is no row of an item", expected))
            else:
                started = int(row[3])
        return faults

    file = validated(ItemsFile, document, document.value, check)
    return [_item(row) for row in file.items]


def _item(row: Sequence[float]) -> MappedItem:
    command, latitude, longitude, first, last, *parameters = row
    item = MissionItem(int(command), NO_POSITION, (0.0, 0.0, 0.0, 0.0, latitude, longitude, 0.0))
    return MappedItem(item, int(first), int(last), tuple(parameters))


def same_items(ours: Sequence[MissionItem], held: Sequence[MissionItem]) -> bool:
    """Whether a mission that an autopilot holds has the commands and positions of ours, in the same order.

    A position of 0, 0 is that of the aircraft, which a ground station may fill in.
    """
    return len(ours) == len(held) and all(_same(*pair) for pair in zip(ours, held, strict=True))


def _same(one: MissionItem, other: MissionItem) -> bool:
    place = one.parameters[4:6]
    there = place == (0.0, 0.0) or all(
        math.isclose(a, b, rel_tol=0.0, abs_tol=SAME_DEG) for a, b in zip(place, other.parameters[4:6], strict=True)
    )
    return one.command == other.command and there


HALVES_TOLERANCE = 1e-4
"""How near to a whole number of half turns an arc is one."""

LARGE_M = 255.5
"""Radius of a loiter from which on ArduPilot holds it in tens of metres [m]."""

STRAIGHT_RAD, LONG_M = math.radians(5.0), 50.0
"""Turn at the end of a line up to which the path goes straight on; length from which on a line is long, so that the
aircraft does not come out of a turn beyond its end [m]. The waypoint there has an acceptance radius (p2): without,
ArduPilot leaves a waypoint before a loiter at its turn distance, tens of metres before the end of the line."""

SWITCH_S = 3.4
"""Flight at the airspeed within which PX4 turns to the next waypoint [s], in a wind of half of it: NPFG_SW_DST_MLT
0.32 · NPFG_DAMPING 0.7 · NPFG_PERIOD 10 s at the ground speed. Flown at 14 m/s: 24 to 34 m; in 7 m/s of wind, 44 m."""

CLEARLY, LONG_WAY = 1.1, 4
"""Distance that is certainly out of reach, and that from which on a way has room for a waypoint there, by the reach."""

JOINED_M = 5.0
"""Largest gap that a trigger off its path leaves which becomes one waypoint, in its middle [m]."""


def mission_items(path: PlannedPath, *, flying: bool = False, px4: bool = False) -> list[MissionItem]:
    """The items of the mission that flies a path; home is not among them.

    `flying`: whether the aircraft comes from the leg before, so that it neither takes off nor flies to the start.
    `px4`: whether turns are waypoints within the path's tolerance, and the take-off has a place.
    """
    return _ItemBuilder(path, flying=flying, px4=px4).items


class _ItemBuilder:
    def __init__(self, path: PlannedPath, *, flying: bool, px4: bool) -> None:
        self.path, self.items, self._px4 = path, list[MissionItem](), px4
        self._skipped: int | None = None  # the first leg of a line without an item of its own
        self._airspeed_mps = path.flown_mps
        sections = path.sections
        self._sections = sections
        self._flown = self._as_flown()
        self._altitude_m, self._legs = path.altitude_of(sections[0]), (sections[0].first, sections[0].last)
        if not flying:
            self._take_off(sections[0])
        if path.trigger_distance_m is not None:
            self._take_pictures(path.trigger_distance_m)
        for k, section in enumerate(sections):
            self._altitude_m, self._legs = path.altitude_of(section), (section.first, section.last)
            self._change_speed(section)
            self._give_commands(section.stage)
            if self._gap_m(k) > JOINED_M:
                self._fly_to(section.start_m)
            self._fly(k)
        self._end_pictures()
        if px4 and not sections[0].stage.item:  # a mission's own pictures stay as they are
            for i in reversed([i for i, item in enumerate(self.items) if _ends_pictures(item)]):
                self._end_pictures_later(i)
        last = sections[-1].stage
        if last.command(d.RETURN) or (path.home_deg is not None and not last.command(d.LAND)):
            self._command((d.RETURN, *(0.0,) * 7))

    def _give_commands(self, stage: Stage) -> None:
        """Add what a stage commands, but for what has items of its own."""
        own = {d.TAKEOFF, d.LAND, d.RETURN, d.LOITER_TO_ALTITUDE}
        if self.path.trigger_distance_m is not None:
            own.add(d.TRIGGER_DISTANCE)
        for command in stage.commands:
            if command[0] not in own:
                self._command(command)

    def _take_pictures(self, every_m: float) -> None:
        """Take a picture every so many metres from here on; none with 0."""
        self._command((d.TRIGGER_DISTANCE, every_m, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0))

    def _end_pictures(self) -> None:
        """End the pictures that are taken at the end of the path, before a landing: what follows that is not done."""
        distances_m = [item.parameters[0] for item in self.items if item.command == d.TRIGGER_DISTANCE]
        if not distances_m or distances_m[-1] == 0:
            return
        never_ended = self.path.trigger_distance_m is None and 0.0 not in distances_m
        if never_ended and self._sections[-1].stage.command(d.LAND):  # a mission's own, which go on in its landing
            return
        self._take_pictures(0.0)
        for i, item in enumerate(self.items):
            if item.command == d.LAND_START:
                self.items.insert(i, self.items.pop()._replace(legs=item.legs))
                return

    def _end_pictures_later(self, i: int) -> None:
        """Move the end of pictures behind the first waypoint out of reach of that where a line ends, for PX4.

        PX4 does what follows a waypoint once it turns to the next one, its switching distance before. Pictures that
        begin again nearer than that go on. A long way on has one more waypoint for it, as where none follows.
        """
        end = self.items.pop(i)
        reach_m = SWITCH_S * max(self.path.airspeed_of(each) or self.path.airspeed_mps for each in self._sections)
        line_end_deg = self._place_before(i)
        for j, item in enumerate(self.items[i:], i):
            if item.command == d.TRIGGER_DISTANCE:
                return
            if item.command in (d.LAND_START, d.LAND):  # a landing is three items that follow one another
                self.items.insert(j, end._replace(legs=item.legs))
                return
            away_m = math.hypot(*to_local_m(*item.position_deg, line_end_deg)) if item.placed else 0.0
            if away_m > reach_m:
                if away_m > LONG_WAY * reach_m:
                    self.items.insert(j, self._out_of_reach(j, line_end_deg, reach_m))
                self.items.insert(j + 1, end._replace(legs=item.legs))
                return
        (x, y), course = self._sections[-1].end_m, self._sections[-1].courses_rad[1]
        beyond = x + CLEARLY * reach_m * math.cos(course), y + CLEARLY * reach_m * math.sin(course)
        if not self.path.airspace.entries((0.0, 0.0), ((x, y), beyond), (-math.inf, -math.inf)):
            self._fly_to(beyond)
        self.items.append(end)

    def _place_before(self, j: int) -> tuple[float, float]:
        """Latitude and longitude of the last item with a place before an index [°], or of home."""
        places = (item.position_deg for item in reversed(self.items[:j]) if item.placed)
        return next(places, self.path.home)

    def _out_of_reach(self, j: int, line_end_deg: tuple[float, float], reach_m: float) -> MissionItem:
        """A waypoint on the way to item `j` that is out of reach of the end of the line, wherever the way leads.

        The item before is within reach of that end: so far again, and clearly farther, is out of it.
        """
        item, before_deg = self.items[j], self._place_before(j)
        apart_m = math.hypot(*to_local_m(*before_deg, line_end_deg))
        share = (apart_m + CLEARLY * reach_m) / math.hypot(*to_local_m(*item.position_deg, before_deg))
        on_deg = [a + share * (b - a) for a, b in zip(before_deg, item.position_deg, strict=True)]
        return item._replace(command=d.WAYPOINT, parameters=(*(0.0,) * 4, *on_deg, item.altitude_m))

    def _take_off(self, first: Section) -> None:
        """Add the take-off, and the start of a path that does not take off there itself."""
        path, takeoff = self.path, first.stage.command(d.TAKEOFF)
        on_path = bool(takeoff) and path.home_deg is None
        if takeoff or path.home_deg is not None:
            # the autopilot climbs straight ahead to this height, and on along the path
            height_m = takeoff[-1] if takeoff and takeoff[-1] > 0 else min(self._altitude_m, CLIMB_OUT_M)
            pitch_deg = path.climb_deg or (takeoff[1] if takeoff else 0.0)
            towards = first.end_m if on_path else first.start_m
            self._add(d.TAKEOFF, (pitch_deg, 0.0, 0.0, 0.0), towards if self._px4 else None, height_m)
        self._change_speed(first)
        if not on_path:
            self._fly_to(first.start_m)

    def _gap_m(self, k: int) -> float:
        """Distance from the end of the section before to the start of one [m]; 0 where it is the first or beyond."""
        ends = self._sections[k - 1].end_m, self._sections[k % len(self._sections)].start_m
        return math.dist(*ends) if 0 < k < len(self._sections) else 0.0

    def _is_gap(self, k: int) -> bool:
        """Whether a section starts beside the end of the one before, by what becomes one waypoint in the middle."""
        return self.path.tolerance_m < self._gap_m(k) <= JOINED_M

    def _as_flown(self) -> list[Section]:
        """The sections with their ends where the waypoints are: in the middles of gaps."""
        flown, start_m = [], self._sections[0].start_m
        for k, section in enumerate(self._sections):
            (x, y), following = section.end_m, self._sections[k + 1 : k + 2]
            middle = ((x + following[0].start_m[0]) / 2, (y + following[0].start_m[1]) / 2) if following else (x, y)
            end_m = middle if self._is_gap(k + 1) else (x, y)
            flown.append(replace(section, start_m=start_m, end_m=end_m))
            start_m = following[0].start_m if self._gap_m(k + 1) > JOINED_M else end_m
        return flown

    def _fly(self, k: int) -> None:
        """Add a section; its end is no waypoint where the turns beside it lead there by themselves."""
        section = self._sections[k]
        self._fly_along(k, section)
        if k + 1 < len(self._sections):
            self._fly_on(self._flown[k].end_m, section, self._sections[k + 1])
        elif section.stage.command(d.LAND):
            self._land(section)
        else:
            self._fly_to(section.end_m)

    def _fly_along(self, k: int, section: Section) -> None:
        """Add the items between the ends of a section: a circle, or the corners of an arc or a curve."""
        arc = section.arc
        if arc and section.stage.command(d.LOITER_TO_ALTITUDE):
            # left along the tangent, at its altitude and where the next item lies ahead
            self._add(d.LOITER_TO_ALTITUDE, (1.0, -arc.turn * held_radius_m(arc.radius_m), 0.0, 1.0), arc.centre_m)
        elif arc and (loiter := self._loiter(section)):
            self._add(d.LOITER_TURNS, (*loiter, 1.0), arc.centre_m)
        elif self._is_gap(k) or self._is_gap(k + 1):
            # the autopilot turns as it does: there is no room for the arc and for the kink of the gap
            for point, _ in section.corners(self.path.tolerance_m):
                self._fly_to(point)
        else:
            taken_m = self._taken_m(k, arc) if arc else 0.0
            for point, begins_m in section.corners(self.path.tolerance_m if self._px4 else math.inf):
                self._fly_to(point, self._held_m(max(begins_m - taken_m, 0.0)))

    def _taken_m(self, k: int, arc: Arc) -> float:
        """What waypoints at the ends of a turn take of its room, where the lines beside it lead elsewhere [m]."""
        taken_m = arc.radius_m * math.tan(max(self._kink_rad(k), self._kink_rad(k + 1)) / 2)
        if self._kink_rad(k) > ARC_RAD:  # what the acceptance radius before it takes, too
            taken_m = max(taken_m, self.items[-1].parameters[1])
        return taken_m

    def _kink_rad(self, k: int) -> float:
        """By how much the course changes at the start of a section [rad]; 0 where it is the first, or beyond, or flown
        to."""
        if not 0 < k < len(self._flown) or self._gap_m(k) > JOINED_M:
            return 0.0
        turn = self._flown[k].courses_rad[0] - self._flown[k - 1].courses_rad[1]
        return abs(math.remainder(turn, 2 * math.pi))

    def _fly_on(self, end_m: Point, section: Section, following: Section) -> None:
        """Add the waypoint at the end of a section that another one follows, unless there is none."""
        if section.arc and _leads_on(section, following):
            return
        turn = math.remainder(following.courses_rad[0] - section.courses_rad[1], 2 * math.pi)
        straight = abs(turn) <= STRAIGHT_RAD
        if straight and self._joins(section, following):
            self._skipped = None if section.arc else section.first
            return
        long = section.arc is None and math.dist(section.start_m, section.end_m) >= LONG_M
        self._fly_to(end_m, ACCEPTANCE_M if long and straight else 0.0)

    def _land(self, section: Section) -> None:
        """Add a landing, and the item that says where it begins: before the waypoint or the circle of the approach."""
        before = self.items[-1] if self.items else None
        approaches = before is not None and before.command in (d.WAYPOINT, d.LOITER_TO_ALTITUDE)
        if before and approaches and all(item.command != d.LAND_START for item in self.items):
            self.items.insert(-1, MissionItem(d.LAND_START, d.NO_POSITION, (0.0,) * 7, before.legs))
        self._add(d.LAND, section.stage.command(d.LAND)[1:5], section.end_m)

    def _held_m(self, acceptance_m: float) -> float:
        """An acceptance radius as the autopilot holds it: ArduPilot's is in whole metres, and 0 is its own [m]."""
        return acceptance_m if self._px4 or acceptance_m == 0 else float(max(math.floor(acceptance_m), 1))

    def _loiter(self, section: Section) -> tuple[float, float, float] | None:
        """The loiter that an arc is, up to where the next item lies ahead: turns, 0 and radius; None for corners."""
        arc = section.arc
        halves = arc.sweep_rad / math.pi if arc else 0.0
        if arc is None or self._px4 or not (halves > 2 - HALVES_TOLERANCE or abs(halves - 1) < HALVES_TOLERANCE):
            return None
        radius_m = held_radius_m(arc.radius_m)
        if radius_m < 1 or abs(radius_m - arc.radius_m) > self.path.tolerance_m:
            return None
        turns = math.floor(halves / 2 + TURNS_TOLERANCE) if halves > 1.5 else 0.5
        return turns, 0.0, -arc.turn * radius_m

    def _joins(self, section: Section, following: Section) -> bool:
        """Whether the corners of a turn lead to a short line, or that to them, where nothing else changes."""
        line, turn = (following, section) if section.arc else (section, following)
        short = not line.points_m and math.dist(line.start_m, line.end_m) < LONG_M
        if not short or line.arc or not turn.arc or self._loiter(turn) is not None:
            return False
        one, other = section.stage, following.stage
        same = not other.commands and one.airspeed_mps == other.airspeed_mps and one.altitude_m == other.altitude_m
        return same and math.dist(section.end_m, following.start_m) <= self.path.tolerance_m

    def _fly_to(self, point: Point, acceptance_m: float = 0.0) -> None:
        self._add(d.WAYPOINT, (0.0, acceptance_m, 0.0, 0.0), point)

    def _add(
        self, command: int, parameters: Sequence[float], point: Point | None, altitude_m: float | None = None
    ) -> None:
        place = (0.0, 0.0) if point is None else self.path.geodetic_deg(point)
        first, last = self._legs
        legs = first if self._skipped is None else self._skipped, last
        above_home_m = self._altitude_m if altitude_m is None else altitude_m
        self.items.append(MissionItem(command, d.RELATIVE, (*parameters, *place, above_home_m), legs))
        self._skipped = None

    def _change_speed(self, section: Section) -> None:
        """Command the airspeed that is stated for a section, where it is another than before."""
        airspeed_mps = self.path.airspeed_of(section)
        if airspeed_mps != self._airspeed_mps:
            self._airspeed_mps = airspeed_mps
            held_mps = d.DEFAULT_SPEED if airspeed_mps is None else round(airspeed_mps * self.path.calibrated, 6)
            self._command((d.CHANGE_SPEED, 0.0, held_mps, -1.0, 0.0, 0.0, 0.0, 0.0))

    def _command(self, command: Sequence[float]) -> None:
        self.items.append(MissionItem(int(command[0]), d.NO_POSITION, tuple(command[1:]), self._legs))


def _leads_on(section: Section, following: Section) -> bool:
    """Whether an arc leads on without a waypoint: to another arc, or as a loiter to an altitude to a landing."""
    if section.stage.command(d.LOITER_TO_ALTITUDE) and following.stage.command(d.LAND):
        return True
    to_loiter = following.stage.command(d.LOITER_TO_ALTITUDE) and not one_circle(section.arc, following.arc)
    return following.arc is not None and not to_loiter


def _ends_pictures(item: MissionItem) -> bool:
    return item.command == d.TRIGGER_DISTANCE and item.parameters[0] == 0


def held_radius_m(radius_m: float) -> float:
    """The radius of a loiter as ArduPilot holds it: whole metres, above 255 m tens [m]."""
    return float(round(radius_m) if radius_m < LARGE_M else 10 * round(radius_m / 10))


def _fences(path: PlannedPath) -> list[Fence]:
    """The fences of an autopilot: obstacles, which are left out, and a boundary."""
    outside = [(False, each.outline) for each in path.airspace.obstacles]
    rings = [*outside, *((True, ring) for ring in path.airspace.boundary)]
    return [Fence(inclusion, [path.geodetic_deg(point) for point in ring]) for inclusion, ring in rings]


def _qgc(path: PlannedPath, firmware: int) -> str:
    """The plan of QGroundControl."""
    items = mission_items(path, px4=firmware == PX4)
    return qgc_text(items, path.home, path.airspeed_mps, _fences(path), firmware, path.height_m)


def files_beside(path: PlannedPath) -> dict[str, str]:
    """ArduPilot's file of the fence, if there is one, by the ending of its name."""
    fences = _fences(path)
    return {FENCE_ENDING: fence_text(fences)} if fences else {}


_WRITERS: tuple[Callable[[PlannedPath], str], ...] = (
    lambda path: _qgc(path, ARDUPILOT),
    lambda path: wpl_text(mission_items(path), path.home, path.height_m),
    lambda path: _qgc(path, PX4),
    paparazzi_text,
    kml_text,
    geojson_text,
    gpx_text,
)
EXPORTS = dict(zip(EXPORT_NAMES, _WRITERS, strict=True))
"""Formats that a plan is exported to: a name, and the text of a path."""


def writer_of(name: str) -> Callable[[PlannedPath], str] | None:
    """What writes a format of eadp, or of an installed package; None where there is none."""
    return EXPORTS.get(name) or plug_in("mission_writers", name)

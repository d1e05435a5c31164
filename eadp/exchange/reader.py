"""Missions of other software as plans: QGroundControl's plans, WPL, and the list of formats; and their texts.

A plan of QGroundControl is JSON with simple items, and complex ones that hold the items of a survey. WPL is the text
format of Mission Planner, ArduPilot and QGroundControl: a row for each item.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from eadp.core.geometry.curves import Point
from eadp.errors import Fault, InputError, counted, printable, refuse
from eadp.exchange.items import (
    ABSOLUTE,
    FOR_FENCE,
    ITEMS_LIMIT,
    LAND,
    LAND_START,
    LOITER_TO_ALTITUDE,
    NO_MISSION,
    NO_POSITION,
    RALLY_LEFT_OUT,
    RELATIVE,
    TERRAIN,
    VTOL_LAND,
    WAYPOINT,
    DraftItem,
    Fence,
    MissionDraft,
    MissionItem,
    command_text,
    place_fault,
    radius_fault,
)
from eadp.io.plan.sources import PlanReader
from eadp.io.text.csv import Row, number_fault, read_rows
from eadp.io.text.json import JsonList, JsonObject, JsonReader
from eadp.io.text.streams import HEAD, Location, Text, refuse_others
from eadp.models.plan.plan import Finding, Plan
from eadp.plug_ins import plug_ins

ARDUPILOT, PX4 = 3, 12
FENCE_VERSION = RALLY_VERSION = 2
GEO_FENCE, FENCE_KEYS = "geoFence", ("polygons", "circles", "breachReturn", "version")
FIXED_WING, VTOL = 1, frozenset((19, 20, 21, 22, 23, 24, 25))
"""MAVLink's types of aircraft that fly on wings."""
VERSIONS = {"survey": (4, 5), "CorridorScan": (2,), "fwLandingPattern": (1, 2), "vtolLandingPattern": (1,)}
"""The versions of each complex item."""
LANDINGS = {"fwLandingPattern": LAND, "vtolLandingPattern": VTOL_LAND}
ABOVE_HOME, CALCULATED, ABOVE_TERRAIN = 1, 3, 4
"""QGroundControl's AltitudeMode; of heights above ground: with the altitude of the ground added, or not."""
_TRANSECTS = "TransectStyleComplexItem"
_KINDS = {
    str: "a string", float: "a number", bool: "true or false", JsonObject: "an object", JsonList: "a list",
    tuple: "a list of numbers",
}  # fmt: skip


@dataclass(frozen=True)
class _Value:
    """A value of the file, with its location and its path in the JSON."""

    source: Text
    value: Any
    offset: int
    path: str

    @property
    def location(self) -> Location:
        return self.source.location(self.offset)

    def error(self, message: str, expected: str) -> InputError:
        return self.source.error(self.location, f"{self.path or 'the file'}: {message}", expected)

    def member(self, key: str) -> _Value:
        """A member of an object; None where it has no such."""
        path = f"{self.path}.{key}" if self.path else key
        if not isinstance(self.value, JsonObject):
            raise self.error("no object", f"an object with {key}")
        return _Value(self.source, self.value.get(key), self.value.offsets.get(key, self.offset), path)

    def is_(self, kind: type) -> _Value:
        """Itself where it is of a kind; a list of two or three numbers is a list too."""
        own = type(self.value)
        if kind is float and own in (int, float) and math.isfinite(self.value):
            return self
        if own is kind or (kind is JsonList and own is tuple):
            return self
        raise self.error("nothing here" if self.value is None else "another kind of value", _KINDS[kind])

    def elements(self) -> list[_Value]:
        """The elements of a list."""
        value = self.is_(JsonList).value
        offsets = getattr(value, "offsets", [self.offset] * len(value))
        return [
            _Value(self.source, each, offset, f"{self.path}[{i}]")
            for i, (each, offset) in enumerate(zip(value, offsets, strict=True))
        ]

    def whole(self, key: str) -> int:
        """A member that is a whole number of 0 or more."""
        found = self.member(key).is_(float)
        if found.value != int(found.value) or not 0 <= found.value < 1e6:
            raise found.error(f"{found.value:g}", "a whole number of 0 or more")
        return int(found.value)

    def position(self, key: str) -> tuple[float, ...]:
        """A member that is a latitude, a longitude and an altitude."""
        found = self.member(key).is_(JsonList)
        if len(found.value) != 3 or any(type(each) not in (int, float) for each in found.value):
            raise found.error("no position", "[latitude, longitude, altitude]")
        return tuple(map(float, found.value))

    def expect(self, key: str, *known: Any) -> None:
        """Refuse another value of a member than those that are known."""
        found = self.member(key)
        if found.value not in known or isinstance(found.value, bool):
            what = "without a value" if found.value is None else f"{printable(str(found.value), 40)} is not known"
            raise found.error(what, f"{key} {' or '.join(map(str, known))}")


def is_qgc(head: str) -> bool:
    """Whether a text that starts so is a plan of QGroundControl, and not GeoJSON, which is JSON too."""
    return head.startswith("{") and '"fileType"' in head


def read_qgc(source: Text) -> MissionDraft:
    """Read the mission of a plan and its fences; places to rally are left out.

    Raises
    ------
    InputError
        If it is no JSON, another version, or an item is not as it should be.
    """
    root = _root(source)
    if root.value.get("fileType") is None:
        refuse_others(Text(source.name, source.body))
    root.expect("fileType", "Plan")
    root.expect("version", 1)
    mission = root.member("mission").is_(JsonObject)
    mission.expect("version", 2)
    home = mission.member("plannedHomePosition")
    vehicle = mission.member("vehicleType").value
    flies = vehicle in (None, 0, FIXED_WING) or vehicle in VTOL
    draft = MissionDraft(mission.position("plannedHomePosition"), home.location, multirotor=not flies)
    for item in mission.member("items").elements():
        _read_item(item.is_(JsonObject), draft)
    draft.fences += _fences_of(root)
    rally = root.member("rallyPoints")
    if isinstance(rally.value, JsonObject) and rally.value.get("points"):
        draft.doubts.append((rally.location, "rally", RALLY_LEFT_OUT))
    return draft


def qgc_fences(source: Text) -> list[Fence]:
    """The fences of a plan alone; raises InputError."""
    return _fences_of(_root(source))


def _root(source: Text) -> _Value:
    root = _Value(source, JsonReader(source).document(), len(source.body) - len(source.body.lstrip()), "")
    return root.is_(JsonObject)


def _fences_of(root: _Value) -> list[Fence]:
    """The fences of a plan; a key that may be meant for one is refused: a fence that is not read is flown through."""
    alike = next((key for key in root.value if key != GEO_FENCE and key.lower() == GEO_FENCE.lower()), None)
    if alike is not None:
        raise root.member(alike).error("is not known", GEO_FENCE)
    fences = root.member(GEO_FENCE)
    if fences.value is None:
        return []
    found: list[Fence] = []
    unknown = next((key for key in fences.is_(JsonObject).value if key not in FENCE_KEYS), None)
    if unknown is not None:
        raise fences.member(unknown).error("is not known", f"one of {', '.join(FENCE_KEYS)}")
    for key, read in (("polygons", _polygon), ("circles", _circle)):
        members = fences.member(key)
        if members.value and fences.member("version").value != FENCE_VERSION:
            raise fences.member("version").error("fences of another version", f"version {FENCE_VERSION}")
        found += [read(each.is_(JsonObject)) for each in (members.elements() if members.value is not None else [])]
    return found


def _polygon(fence: _Value) -> Fence:
    corners = [_corner(each) for each in fence.member("polygon").elements()]
    if len(corners) < 3:
        raise fence.member("polygon").error(f"{len(corners)} corners", "3 or more")
    return Fence(fence.member("inclusion").is_(bool).value, corners, fence.location)


def _circle(fence: _Value) -> Fence:
    circle, inclusion = fence.member("circle").is_(JsonObject), fence.member("inclusion").is_(bool).value
    radius = circle.member("radius").is_(float)
    if fault := radius_fault(radius.value):
        raise radius.error(*fault)
    return Fence.circle(inclusion, _corner(circle.member("center")), radius.value, fence.location)


def _corner(place: _Value) -> tuple[float, float]:
    values = place.is_(JsonList).value
    if len(values) < 2 or any(type(each) not in (int, float) for each in values):
        raise place.error("no position", "[latitude, longitude]")
    corner = float(values[0]), float(values[1])
    if fault := place_fault(*corner):
        raise place.error(*fault)
    return corner


def _read_item(item: _Value, draft: MissionDraft) -> None:
    """An item, or the items that a complex one holds."""
    kind = item.member("type").is_(str).value
    if kind == "SimpleItem":
        _read_simple(item, draft)
    elif kind == "ComplexItem":
        _read_complex(item, draft)
    else:
        raise item.member("type").error(f"{printable(kind, 40)} is not known", "SimpleItem or ComplexItem")


def _read_complex(item: _Value, draft: MissionDraft) -> None:
    """A landing pattern, or the transects of a survey or a corridor by the items that they hold."""
    name = item.member("complexItemType").is_(str)
    if name.value not in VERSIONS:
        raise name.error(f"{printable(name.value, 40)} is not known", f"one of {', '.join(VERSIONS)}")
    item.expect("version", *VERSIONS[name.value])
    if name.value in LANDINGS:
        _read_landing(item, draft, LANDINGS[name.value])
        return
    transects = item.member(_TRANSECTS)
    if transects.value is not None and (hover := transects.member("HoverAndCapture")).value is True:
        raise hover.error("the aircraft hovers for each picture", "false: a fixed wing does not hover")
    items = [] if transects.value is None else transects.member("Items").elements()
    if not items:
        raise item.error(f"a {name.value} without items", f"its items in {_TRANSECTS}.Items")
    for each in items:
        _read_simple(each.is_(JsonObject), draft)


def _read_simple(item: _Value, draft: MissionDraft) -> None:
    if len(draft.items) >= ITEMS_LIMIT:
        raise item.error(f"more than {ITEMS_LIMIT} items", "as many or fewer")
    parameters = item.member("params").elements()
    if len(parameters) == 4 and item.member("coordinate").value is not None:  # of earlier versions of QGroundControl
        parameters += item.member("coordinate").elements()
    if len(parameters) != 7:
        raise item.member("params").error(f"{len(parameters)} parameters", "7")
    values = tuple(math.nan if each.value is None else float(each.is_(float).value) for each in parameters)
    number = len(draft.items) + 1 if item.member("doJumpId").value is None else item.whole("doJumpId")
    places = [item.member("command").location, item.member("frame").location, *(each.location for each in parameters)]
    command, frame = item.whole("command"), item.whole("frame")
    height = item.member("Altitude")
    if math.isnan(values[6]) and height.value is not None:
        # above ground whose altitude is added when the mission is sent
        values = (*values[:6], float(height.is_(float).value))
        frame = TERRAIN if item.member("AltitudeMode").value in (CALCULATED, ABOVE_TERRAIN) else frame
    sea = item.member("AMSLAltAboveTerrain")
    sea_m = None if sea.value is None or frame != TERRAIN else float(sea.is_(float).value)
    draft.items.append(DraftItem(item.path, number, command, frame, values, tuple(places), sea_m))


def _read_landing(item: _Value, draft: MissionDraft, landing: int) -> None:
    """A landing pattern: from an approach, a circle or a point, straight to where the aircraft lands."""
    old = item.member("landingApproachCoordinate").value is None and item.member("loiterCoordinate").value is not None
    approach = item.position("loiterCoordinate" if old else "landingApproachCoordinate")
    land = item.position("landCoordinate")
    radius = item.member("loiterRadius").is_(float).value
    if item.member("loiterClockwise").value is False:
        radius = -radius
    circle = item.member("useLoiterToAlt").value is not False
    above, land_above = (
        ABSOLUTE if False in (item.member(key).value, item.member("altitudesAreRelative").value) else RELATIVE
        for key in ("loiterAltitudeRelative", "landAltitudeRelative")
    )
    for command, frame, values in (
        (LAND_START, NO_POSITION, (0.0,) * 7),
        (LOITER_TO_ALTITUDE if circle else WAYPOINT, above, (0.0, radius if circle else 0.0, 0.0, 0.0, *approach)),
        (landing, land_above, (0.0, 0.0, 0.0, 0.0, *land)),
    ):
        number = len(draft.items) + 1
        draft.items.append(DraftItem(item.path, number, command, frame, values, (item.location,) * 9))


def _rounded(values: Sequence[float]) -> list[float | None]:
    return [round(value, 9) for value in values]


def _simple_item(number: int, item: MissionItem) -> dict[str, Any]:
    """An item of a plan, by its number."""
    simple = {
        "autoContinue": True,
        "command": item.command,
        "doJumpId": number,
        "frame": item.frame,
        "params": _rounded(item.parameters),
        "type": "SimpleItem",
    }
    if item.frame != RELATIVE:
        return simple
    return simple | {"AMSLAltAboveTerrain": None, "Altitude": item.altitude_m, "AltitudeMode": ABOVE_HOME}


def _landing_pattern(approach: MissionItem, land: MissionItem) -> dict[str, Any]:
    """A landing as the complex item of a plan, from its approach, a waypoint or a circle."""
    circle, radius_m = approach.command == LOITER_TO_ALTITUDE, approach.parameters[1]
    return {
        "type": "ComplexItem",
        "complexItemType": "fwLandingPattern",
        "version": 2,
        "altitudesAreRelative": True,
        "landingApproachCoordinate": _rounded(approach.parameters[4:]),
        "landCoordinate": _rounded(land.parameters[4:]),
        "useLoiterToAlt": circle,
        "loiterRadius": abs(radius_m) if circle else 0.0,
        "loiterClockwise": not circle or radius_m > 0,
        "stopTakingPhotos": False,
        "stopVideoPhotos": False,
    }


def qgc_text(
    items: Sequence[MissionItem],
    home_deg: Point,
    airspeed_mps: float,
    fences: Sequence[Fence] = (),
    firmware: int = ARDUPILOT,
    home_m: float = 0.0,
) -> str:
    """The file of a mission of a fixed wing; of ArduPilot, with a landing as the pattern that can be edited.

    `home_m` is the height of home above the sea [m], 0 if not known.

    MAVSDK, which sends plans to PX4, refuses a pattern. There it is the same items, which QGroundControl makes one of.
    """
    polygons = [
        {"inclusion": fence.inclusion, "polygon": [_rounded(corner) for corner in fence.corners_deg], "version": 1}
        for fence in fences
    ]
    written = [_simple_item(number, item) for number, item in enumerate(items, 1)]
    ending = [item.command for item in items[-3:]]
    if ending in ([LAND_START, WAYPOINT, LAND], [LAND_START, LOITER_TO_ALTITUDE, LAND]):
        if firmware == ARDUPILOT:
            written[-3:] = [_landing_pattern(*items[-2:])]
        elif items[-2].command == WAYPOINT:
            written[-2]["params"][3] = None
    mission = {
        "cruiseSpeed": airspeed_mps,
        "firmwareType": firmware,
        "globalPlanAltitudeMode": ABOVE_HOME,
        "hoverSpeed": airspeed_mps,
        "items": written,
        "plannedHomePosition": [*_rounded(home_deg), home_m],
        "vehicleType": FIXED_WING,
        "version": 2,
    }
    plan = {
        "fileType": "Plan",
        GEO_FENCE: {"circles": [], "polygons": polygons, "version": FENCE_VERSION},
        "groundStation": "QGroundControl",
        "mission": mission,
        "rallyPoints": {"points": [], "version": RALLY_VERSION},
        "version": 1,
    }
    return json.dumps(plan, indent=4) + "\n"


VERSION, WITHOUT_HOME = "QGC WPL 110", "QGC WPL 120"
"""The versions; QGroundControl reads the second as the first, without the row of home."""
COLUMNS = 12
_WHOLE = {0: "index", 2: "frame", 3: "command"}
_PARAMETERS = range(4, 11)
_ROWS = f"{COLUMNS} columns, separated by tabs or blanks"
FENCE_RETURN, RALLY = 5000, 5100
POLYGONS, CIRCLES = {5001: True, 5002: False}, {5003: True, 5004: False}
"""Commands of the corners of a fence and of a round one, and whether it is kept in."""


def read_wpl(source: Text) -> MissionDraft:
    """Read a mission: row 0 is home. Fences may be among its rows; places to rally are left out.

    Raises
    ------
    InputError
        With the faults of the rows, or of the first line; if it has fences or places to rally alone.
    """
    rows, doubts = _rows(source), list[tuple[Location, str, str]]()
    fences = _fences(source, rows)
    items = [each for each in rows if not _is_fence(each)]
    first_is_home = source.body.split(None, 3)[2] == VERSION.split()[2]
    home = items[0] if first_is_home and items and items[0].number == 0 and items[0].command == WAYPOINT else None
    moved = items if home is None else items[1:]
    if len(items) < len(rows) and not moved:
        raise source.error(rows[0].locations[0], NO_MISSION, FOR_FENCE)
    if rally := [each for each in rows if each.command == RALLY]:
        doubts.append((rally[0].locations[0], "rally", RALLY_LEFT_OUT))
    draft = MissionDraft((0.0, 0.0, 0.0), rows[0].locations[6], moved, fences=fences, doubts=doubts)
    if home is not None:
        draft.home, draft.home_location = home.parameters[4:], home.locations[6]
    elif rows[0] is items[0] and first_is_home:
        message = f"row 0 is {command_text(rows[0].command)} and no home: it is flown as the first item"
        doubts.append((rows[0].locations[0], "no-home", message))
    return draft


def mission_fences(source: Text) -> list[Fence] | None:
    """The fences of a mission, or of a file of fences alone; None of another text. Raises InputError."""
    head = source.body.lstrip()[:HEAD]
    if is_qgc(head):
        return qgc_fences(source)
    return _fences(source, _rows(source)) if head.startswith(VERSION[:7]) else None


def _is_fence(item: DraftItem) -> bool:
    return item.command in POLYGONS or item.command in CIRCLES or item.command in (FENCE_RETURN, RALLY)


def _fences(source: Text, rows: Sequence[DraftItem]) -> list[Fence]:
    """The fences among rows; the first row of a polygon says how many its corners are."""
    fences: list[Fence] = []
    left = iter(rows)
    for item in left:
        if item.command in CIRCLES:
            radius_m = item.parameters[0]
            if fault := radius_fault(radius_m):
                raise source.error(item.locations[2], *fault)
            fences.append(Fence.circle(CIRCLES[item.command], _place(source, item), radius_m, item.locations[6]))
        elif item.command in POLYGONS:
            count = item.parameters[0]
            if not 3 <= count <= ITEMS_LIMIT or count != int(count):
                raise source.error(item.locations[2], f"{count:g} corners", "3 or more, in the rows that follow")
            corners = [item, *itertools.islice(left, int(count) - 1)]
            whole = [each for each in corners if each.command == item.command]
            if missing := int(count) - len(whole):
                message = f"a polygon without its last {missing} corners"
                raise source.error(item.locations[6], message, "as many as it states")
            places = [_place(source, each) for each in whole]
            fences.append(Fence(POLYGONS[item.command], places, item.locations[6]))
    return fences


def _place(source: Text, item: DraftItem) -> Point:
    """Latitude and longitude of a row of a fence [°]."""
    latitude, longitude = item.parameters[4:6]
    if fault := place_fault(latitude, longitude):
        raise source.error(item.locations[6], *fault)
    return latitude, longitude


def _rows(source: Text) -> list[DraftItem]:
    """The rows, numbered in their order as autopilots do, whatever their index."""
    rows = read_rows(source.name, source.body, "")
    head = next(rows)
    if head.fields not in (VERSION.split(), WITHOUT_HOME.split()):
        version = printable(" ".join(head.fields), 40)
        raise source.error((head.line, 1), f"the version {version} of this format is not known", VERSION)
    faults: list[Fault] = []
    items: list[DraftItem] = []
    for index, row in enumerate(rows):
        if index > ITEMS_LIMIT:
            raise source.error((row.line, 1), f"more than {ITEMS_LIMIT} items", "as many or fewer")
        if found := _row_faults(row):
            faults += found
            continue
        numbers = [float(text) for text in row.fields]
        places = [(row.line, row.columns[i]) for i in (3, 2, *range(4, 11))]
        items.append(
            DraftItem(f"item {index}", index, int(numbers[3]), int(numbers[2]), tuple(numbers[4:11]), tuple(places))
        )
    refuse(faults)
    if not items:
        raise source.error((head.line, 1), "no home", "a row for home, and one for each item")
    return items


def _row_faults(row: Row) -> list[Fault]:
    count = len(row.fields)
    if count != COLUMNS:
        message = f"a row of {counted(count, 'column')}"
        return [row.fault(0 if count < COLUMNS else COLUMNS, message, _ROWS)]
    faults = [
        row.fault(i, *wrong)
        for i, text in enumerate(row.fields)
        if (wrong := number_fault(text)) and not (i in _PARAMETERS and text.lower() == "nan")  # a parameter not set
    ]
    for i, name in _WHOLE.items():
        if not faults and not re.fullmatch(r"\+?[0-9]{1,5}(\.0*)?", row.fields[i]):
            faults.append(row.fault(i, f"{printable(row.fields[i], 40)} is no {name}", "a whole number of 0 or more"))
    return faults


def fence_text(fences: Sequence[Fence]) -> str:
    """The file of a fence, as ground stations send it beside a mission: a row for each corner."""
    kinds = {inside: command for command, inside in POLYGONS.items()}
    rows = [
        MissionItem(kinds[inclusion], 0, (float(len(corners)), 0.0, 0.0, 0.0, *corner, 0.0))
        for inclusion, corners, _ in fences
        for corner in corners
    ]
    return _text(rows)


def wpl_text(items: Sequence[MissionItem], home_deg: Point, home_m: float = 0.0) -> str:
    """The file of a mission: home, at its height above the sea, 0 where that is not known; then its items."""
    return _text([MissionItem(WAYPOINT, ABSOLUTE, (0.0, 0.0, 0.0, 0.0, *home_deg, home_m)), *items])


def _text(items: Sequence[MissionItem]) -> str:
    """The file of all rows; the first is the current one."""
    lines = [VERSION]
    for index, (command, frame, parameters, _) in enumerate(items):
        numbers = [f"{value:.9f}".rstrip("0").rstrip(".") for value in parameters]
        lines.append("\t".join([str(index), str(int(index == 0)), str(frame), str(command), *numbers, "1"]))
    return "\n".join([*lines, ""])


@dataclass(frozen=True)
class MissionFormat:
    """A format of missions: its name, whether a text that starts so has it, and its reader."""

    name: str
    recognise: Callable[[str], bool]
    read: Callable[[Text], MissionDraft]


FORMATS = (
    MissionFormat("QGroundControl plan", lambda head: head.startswith("{"), read_qgc),
    MissionFormat("WPL", lambda head: head.startswith("QGC WPL"), read_wpl),
)
"""Formats of missions; the first that recognises a text reads it, and those of other packages where it has no stage."""


class _Missions:
    """Missions as a source of plans."""

    @staticmethod
    def recognises(text: Text) -> bool:
        """Whether a format of missions recognises a text."""
        return _format_of(text) is not None

    @staticmethod
    def read(text: Text, reader: PlanReader) -> tuple[Plan, list[Finding]]:
        """A mission as a plan, and warnings; raises InputError."""
        chosen = _format_of(text)
        assert chosen is not None
        from eadp.exchange.mission_plan import MissionPlan

        return MissionPlan(text, chosen.read(text), reader).plan()


MISSION = _Missions()


def _format_of(text: Text) -> MissionFormat | None:
    """The format of a mission by its first characters; None for a plan of eadp."""
    head = text.body.lstrip()[:HEAD]
    found = next((each for each in FORMATS if each.recognise(head)), None)
    if found is None:
        found = next((each for each in plug_ins("mission_formats") if each.recognise(head)), None)
    return found

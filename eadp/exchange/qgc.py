"""Plans of QGroundControl: JSON with simple items, and complex ones that hold the items of a survey."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from eadp.core.geometry.curves import Point
from eadp.errors import InputError, printable
from eadp.exchange.items import (
    ABSOLUTE,
    ITEMS_LIMIT,
    LAND,
    LAND_START,
    LOITER_TO_ALTITUDE,
    MAX_FENCE_M,
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
)
from eadp.io.text.json import JsonList, JsonObject, JsonReader
from eadp.io.text.streams import Location, SourceText

ARDUPILOT, PX4 = 3, 12
FENCE_VERSION = RALLY_VERSION = 2
FIXED_WING, VTOL = 1, frozenset((19, 20, 21, 22, 23, 24, 25))
"""MAVLink's types of aircraft that fly on wings."""
VERSIONS = {
    "survey": (4, 5),
    "CorridorScan": (2,),
    "fwLandingPattern": (1, 2),
    "vtolLandingPattern": (1,),
}
"""The versions of each complex item."""
LANDINGS = {"fwLandingPattern": LAND, "vtolLandingPattern": VTOL_LAND}
STRUCTURE = "StructureScan"
ABOVE_HOME, CALCULATED, ABOVE_TERRAIN = 1, 3, 4
"""QGroundControl's AltitudeMode; of heights above ground: with the altitude of the ground added, or not."""
NEWER = "a plan (*.plan), which a later QGroundControl makes of it"
_TRANSECTS = "TransectStyleComplexItem"
_KINDS = {str: "a string", float: "a number", JsonObject: "an object", JsonList: "a list", tuple: "a list of numbers"}


@dataclass(frozen=True)
class _Value:
    """A value of the file, with its location and its path in the JSON."""

    source: SourceText
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


def read_qgc(source: SourceText) -> MissionDraft:
    """Read the mission of a plan and its fences; places to rally are left out.

    Raises
    ------
    InputError
        If it is no JSON, another version, or an item is not as it should be.
    """
    root = _root(source)
    if root.value.get("fileType") is None and {"items", "plannedHomePosition"} <= root.value.keys():
        raise root.error("a mission of QGroundControl 3.1 or older, which is not read", NEWER)
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
    draft.fences += _fences(root)
    rally = root.member("rallyPoints")
    if isinstance(rally.value, JsonObject) and rally.value.get("points"):
        draft.doubts.append((rally.location, "rally", RALLY_LEFT_OUT))
    return draft


def qgc_fences(source: SourceText) -> list[Fence]:
    """The fences of a plan alone; raises InputError."""
    return _fences(_root(source))


def _root(source: SourceText) -> _Value:
    root = _Value(source, JsonReader(source).document(), len(source.body) - len(source.body.lstrip()), "")
    return root.is_(JsonObject)


def _fences(root: _Value) -> list[Fence]:
    fences = root.member("geoFence")
    found: list[Fence] = []
    if isinstance(fences.value, JsonObject) and fences.member("version").value == FENCE_VERSION:
        for key, read in (("polygons", _polygon), ("circles", _circle)):
            members = fences.member(key)
            found += [read(each.is_(JsonObject)) for each in (members.elements() if members.value else [])]
    return found


def _polygon(fence: _Value) -> Fence:
    corners = [_corner(each) for each in fence.member("polygon").elements()]
    if len(corners) < 3:
        raise fence.member("polygon").error(f"{len(corners)} corners", "3 or more")
    return Fence(fence.member("inclusion").value is True, corners, fence.location)


def _circle(fence: _Value) -> Fence:
    circle, inclusion = fence.member("circle").is_(JsonObject), fence.member("inclusion").value is True
    radius = circle.member("radius").is_(float)
    if not 0 < radius.value <= MAX_FENCE_M:
        raise radius.error(f"{radius.value:g} m", f"metres, above 0, at most {MAX_FENCE_M:g}")
    return Fence.circle(inclusion, _corner(circle.member("center")), radius.value, fence.location)


def _corner(place: _Value) -> tuple[float, float]:
    values = place.is_(JsonList).value
    if len(values) < 2 or any(type(each) not in (int, float) for each in values):
        raise place.error("no position", "[latitude, longitude]")
    latitude, longitude = float(values[0]), float(values[1])
    if not (abs(latitude) <= 90 and abs(longitude) <= 180):
        raise place.error(f"{latitude:g}, {longitude:g}", "a latitude and a longitude [°]")
    return latitude, longitude


def _read_item(item: _Value, draft: MissionDraft) -> None:
    kind = item.member("type").is_(str).value
    if kind == "SimpleItem":
        _read_simple(item, draft)
    elif kind != "ComplexItem":
        raise item.member("type").error(f"{printable(kind, 40)} is not known", "SimpleItem or ComplexItem")
    else:
        name = item.member("complexItemType").is_(str)
        if name.value == STRUCTURE:
            message = "a StructureScan: the file has its outline, and not the items that QGroundControl makes of it"
            raise item.error(message, "the mission as WPL, or as read back from the vehicle, which have them")
        if name.value not in VERSIONS:
            raise name.error(f"{printable(name.value, 40)} is not known", f"one of {', '.join(VERSIONS)}")
        item.expect("version", *VERSIONS[name.value])
        if name.value in LANDINGS:
            _read_landing(item, draft, LANDINGS[name.value])
            return
        holder = item.member(_TRANSECTS)
        hover = holder.member("HoverAndCapture") if holder.value is not None else holder
        if hover.value is True:
            raise hover.error("the aircraft hovers for each picture", "false: a fixed wing does not hover")
        items = holder.member("Items").elements() if holder.value is not None else []
        if not items:
            raise item.error(f"a {name.value} without items", f"its items in {_TRANSECTS}.Items")
        for each in items:
            _read_simple(each.is_(JsonObject), draft)


def _read_simple(item: _Value, draft: MissionDraft) -> None:
    if len(draft.items) >= ITEMS_LIMIT:
        raise item.error(f"more than {ITEMS_LIMIT} items", "as many or fewer")
    parameters = item.member("params").elements()
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
        {
            "inclusion": inclusion,
            "polygon": [_rounded(corner) for corner in corners],
            "version": 1,
        }
        for inclusion, corners, _ in fences
    ]
    written: list[dict[str, Any]] = []
    ending = [item.command for item in items[-3:]]
    lands = ending in ([LAND_START, WAYPOINT, LAND], [LAND_START, LOITER_TO_ALTITUDE, LAND])
    pattern = lands and firmware == ARDUPILOT
    for number, (command, frame, parameters, _) in enumerate(items[:-3] if pattern else items, 1):
        item: dict[str, Any] = {"autoContinue": True, "command": command, "doJumpId": number, "frame": frame}
        item |= {"params": _rounded(parameters), "type": "SimpleItem"}
        if frame == RELATIVE:
            item |= {"AMSLAltAboveTerrain": None, "Altitude": parameters[6], "AltitudeMode": ABOVE_HOME}
        written.append(item)
    if lands and not pattern and items[-2].command == WAYPOINT:
        written[-2]["params"][3] = None
    if pattern:
        approach, land = (_rounded(item.parameters[4:]) for item in items[-2:])
        circle, radius_m = items[-2].command == LOITER_TO_ALTITUDE, items[-2].parameters[1]
        written.append(
            {"type": "ComplexItem", "complexItemType": "fwLandingPattern", "version": 2, "altitudesAreRelative": True}
            | {"landingApproachCoordinate": approach, "landCoordinate": land, "useLoiterToAlt": circle}
            | {"loiterRadius": abs(radius_m) * circle, "loiterClockwise": not circle or radius_m > 0}
            | {"stopTakingPhotos": False, "stopVideoPhotos": False}
        )
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
        "geoFence": {"circles": [], "polygons": polygons, "version": FENCE_VERSION},
        "groundStation": "QGroundControl",
        "mission": mission,
        "rallyPoints": {"points": [], "version": RALLY_VERSION},
        "version": 1,
    }
    return json.dumps(plan, indent=4) + "\n"

"""MAVLink's commands of missions: their names, and which of them do not move an aircraft."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.io.text.streams import Location
from eadp.models.plan import stage

_TABLE = """
    16 NAV_WAYPOINT, 17 NAV_LOITER_UNLIM, 18 NAV_LOITER_TURNS, 19 NAV_LOITER_TIME, 20 NAV_RETURN_TO_LAUNCH, 21
    NAV_LAND, 22 NAV_TAKEOFF, 23 NAV_LAND_LOCAL, 24 NAV_TAKEOFF_LOCAL, 25 NAV_FOLLOW, 30
    NAV_CONTINUE_AND_CHANGE_ALT, 31 NAV_LOITER_TO_ALT, 32 DO_FOLLOW, 33 DO_FOLLOW_REPOSITION, 34 DO_ORBIT, 35
    DO_FIGURE_EIGHT, 36 NAV_ARC_WAYPOINT, 81 NAV_PATHPLANNING, 82 NAV_SPLINE_WAYPOINT, 83 NAV_ALTITUDE_WAIT, 84
    NAV_VTOL_TAKEOFF, 85 NAV_VTOL_LAND, 92 NAV_GUIDED_ENABLE, 93 NAV_DELAY, 94 NAV_PAYLOAD_PLACE, 113
    CONDITION_CHANGE_ALT, 176 DO_SET_MODE, 177 DO_JUMP, 178 DO_CHANGE_SPEED, 185 DO_FLIGHTTERMINATION, 186
    DO_CHANGE_ALTITUDE, 189 DO_LAND_START, 190 DO_RALLY_LAND, 191 DO_GO_AROUND, 192 DO_REPOSITION, 193
    DO_PAUSE_CONTINUE, 194 DO_SET_REVERSE, 213 NAV_SET_YAW_SPEED, 224 DO_SET_MISSION_CURRENT, 252 OVERRIDE_GOTO,
    262 DO_SET_STANDARD_MODE, 601 DO_JUMP_TAG, 2800 PANORAMA_CREATE, 4000 SET_GUIDED_SUBMODE_STANDARD, 4001
    SET_GUIDED_SUBMODE_CIRCLE, 5000 NAV_FENCE_RETURN_POINT, 5001 NAV_FENCE_POLYGON_VERTEX_INCLUSION, 5002
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION, 5003 NAV_FENCE_CIRCLE_INCLUSION, 5004 NAV_FENCE_CIRCLE_EXCLUSION, 5100
    NAV_RALLY_POINT, 30001 PAYLOAD_PREPARE_DEPLOY, 31000 WAYPOINT_USER_1, 31001 WAYPOINT_USER_2, 31002
    WAYPOINT_USER_3, 31003 WAYPOINT_USER_4, 31004 WAYPOINT_USER_5, 42702 NAV_SCRIPT_TIME, 42703 NAV_ATTITUDE_TIME,
    43000 GUIDED_CHANGE_SPEED, 43001 GUIDED_CHANGE_ALTITUDE, 43002 GUIDED_CHANGE_HEADING
"""

NAMES = {int(number): name for number, name in (each.split() for each in _TABLE.split(","))}
"""Names of commands that say where or how to fly, without MAV_CMD_."""

MOTIONLESS = frozenset((
    80, 112, 114, 115, *range(179, 185), 187, 188, *range(195, 199), *range(200, 213), *range(214, 219),
    *range(220, 224), 241, 245, 246, 260, 300, 400, *range(530, 535), 600, 1000, 1001, 2000, 2001, *range(2003, 2006),
    2010, *range(2500, 2504), 2510, 2511, 3000, 4501, 30002, *range(31005, 31015), 42600, 43003, 43005,
))  # fmt: skip
"""Commands that do not move the aircraft: waits, cameras, mounts, servos, engines, settings. They are kept."""


def command_text(command: int) -> str:
    """A command in messages: its number and, where it is known, its name."""
    return f"{command} ({NAMES[command]})" if command in NAMES else f"{command}"


ITEMS_LIMIT = 10_000
"""Most items of a mission, and most that are flown: an autopilot holds hundreds."""

ARDUPILOT_ITEMS = 724
"""Items that ArduPilot stores on most boards, of 15 bytes each in 11 kB; smaller boards store fewer.

Source: ArduPilot, StorageManager and AP_Mission; BRD_SD_MISSION stores more on an SD card."""

WAYPOINT, LOITER_UNLIMITED, LOITER_TURNS, LOITER_TIME = 16, 17, 18, 19
RETURN, LAND, TAKEOFF = stage.RETURN, stage.LAND, stage.TAKEOFF
LOITER_TO_ALTITUDE = stage.LOITER_TO_ALTITUDE
SPLINE, VTOL_TAKEOFF, VTOL_LAND = 82, 84, 85
JUMP, CHANGE_SPEED, LAND_START, TRIGGER_DISTANCE = 177, 178, 189, stage.TRIGGER_DISTANCE

DEFAULT_SPEED = -2.0
"""A speed of MAV_CMD_DO_CHANGE_SPEED that stands for the aircraft's own airspeed."""

HIGHEST_M = 1e5
"""Highest altitude, and greatest depth [m]."""

CIRCLE_CORNERS, MAX_FENCE_M = 32, 1e6
"""Corners of a round fence, and its largest radius [m]."""

ABSOLUTE, RELATIVE, TERRAIN, NO_POSITION = 0, 3, 10, 2
GLOBAL_FRAMES = {0: ABSOLUTE, 5: ABSOLUTE, 3: RELATIVE, 6: RELATIVE, 10: TERRAIN, 11: TERRAIN}
"""Frames whose positions are in degrees, and what their altitude is above: the sea, home, or the ground."""


class MissionItem(NamedTuple):
    """An item to write: MAVLink's command, frame and seven parameters, the position in degrees and metres.

    `legs` are the indices of the first and the last leg that it leads along.
    """

    command: int
    frame: int
    parameters: tuple[float, ...]
    legs: tuple[int, int] = (0, 0)

    @property
    def placed(self) -> bool:
        """Whether it has a position; one at 0, 0 is where the aircraft is."""
        return self.frame in GLOBAL_FRAMES and any(self.parameters[4:6])

    @property
    def position_deg(self) -> tuple[float, float]:
        """Its latitude and longitude [°]."""
        return self.parameters[4], self.parameters[5]

    @property
    def altitude_m(self) -> float:
        """Its altitude, as its frame has it [m]."""
        return self.parameters[6]


@dataclass(frozen=True, slots=True)
class DraftItem:
    """An item of a mission: MAVLink's command, frame and seven parameters, NaN where there is none.

    `number` is what a jump calls it, `label` what messages call it; `locations` are those of the command, the frame and
    the parameters. `above_sea_m` is the altitude of one above ground, where its file has that, too [m].
    """

    label: str
    number: int
    command: int
    frame: int
    parameters: tuple[float, ...]
    locations: tuple[Location, ...]
    above_sea_m: float | None = None


NO_MISSION = "fences or places to rally, and no mission"
FOR_FENCE = "a mission; a fence belongs to --inside or --avoid of eadp plan, or into the mission's file"
RALLY_LEFT_OUT = "places to rally are left out: an autopilot that has some returns there instead of home"


def place_fault(latitude: float, longitude: float) -> tuple[str, str] | None:
    """What is wrong with a place of a fence, and what is expected; None where nothing is."""
    if abs(latitude) <= 90 and abs(longitude) <= 180:
        return None
    return f"{latitude:g}, {longitude:g}", "a latitude and a longitude [°]"


def radius_fault(radius_m: float) -> tuple[str, str] | None:
    """As `place_fault`, of the radius of a round fence."""
    if 0 < radius_m <= MAX_FENCE_M:
        return None
    return f"a radius of {radius_m:g} m", f"above 0, at most {MAX_FENCE_M:g}"


class Fence(NamedTuple):
    """An area that an autopilot keeps in, or out of: its corners as latitude and longitude [°]."""

    inclusion: bool
    corners_deg: list[tuple[float, float]]
    location: Location = (1, 1)

    @classmethod
    def circle(cls, inclusion: bool, centre_deg: tuple[float, float], radius_m: float, location: Location) -> Fence:
        """A circle, of a valid radius, as a polygon around what is to be left out, or within what is to be kept in."""
        if not inclusion:
            radius_m /= math.cos(math.pi / CIRCLE_CORNERS)
        angles = [2 * math.pi * i / CIRCLE_CORNERS for i in range(CIRCLE_CORNERS)]
        corners = [to_geodetic_deg(radius_m * math.cos(a), radius_m * math.sin(a), centre_deg) for a in angles]
        return cls(inclusion, corners, location)


@dataclass
class MissionDraft:
    """A mission before it is checked: latitude, longitude [°] and altitude [m] of home, and the items.

    `multirotor` is whether it says that it is for an aircraft that hovers; `doubts` are what the reader took one way of
    several: where, a code of a finding, and a sentence.
    """

    home: tuple[float, ...]
    home_location: Location
    items: list[DraftItem] = field(default_factory=list)
    multirotor: bool = False
    fences: list[Fence] = field(default_factory=list)
    doubts: list[tuple[Location, str, str]] = field(default_factory=list)

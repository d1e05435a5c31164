"""What autopilots keep of the items that are sent to them: some round a number, or leave it out.

Source: ArduPilot's `AP_Mission.cpp`, `mavlink_int_to_mission_cmd` and `mission_cmd_to_mavlink_int`, for Plane; PX4's
`mavlink_mission.cpp`, `parse_mavlink_mission_item` and `format_mavlink_mission_item`. Flown: items sent to and read
back from ArduPlane 4.7 and PX4, main of early 2025.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from eadp.io.mission import draft as d
from eadp.io.mission.draft import MissionItem
from eadp.io.mission.items import same_items

SINGLE = 1e-6
"""Relative error of numbers that were sent in single precision."""
ALTITUDE_M = 0.011
"""How far an altitude may be off that is kept in whole centimetres, cut off [m]."""
LARGE_M, TENS = 255.0, 10.0
"""ArduPilot has a byte for a radius: from this one on it keeps tens of metres [m]."""

Kept = Callable[[float], float]


def _same(value: float) -> float:
    return value


def _nothing(_value: float) -> float:
    return 0.0


def _whole(value: float) -> float:
    """Cut off, as it is in single precision."""
    return float(np.trunc(np.float32(value))) if math.isfinite(value) else 0.0


def _byte(value: float) -> float:
    return min(_whole(value), LARGE_M)


def _radius(value: float) -> float:
    """The radius of a loiter with turns."""
    return _whole(value) if abs(value) <= LARGE_M else TENS * _whole(value / TENS)


def _sign(value: float) -> float:
    return -1.0 if value < 0 else 1.0


def _flag(value: float) -> float:
    return float(value > 0)


Row = tuple[Kept, Kept, Kept, Kept]
_AS_SENT: Row = (_same, _same, _same, _same)
_NOTHING: Row = (_nothing, _nothing, _nothing, _nothing)

KEPT: dict[int, tuple[Row, Row]] = {
    d.WAYPOINT: ((_nothing, _byte, _byte, _nothing), (_same, _same, _nothing, _same)),
    d.LOITER_UNLIMITED: ((_nothing, _nothing, _whole, _nothing), (_nothing, _nothing, _same, _same)),
    d.LOITER_TURNS: ((_same, _nothing, _radius, _flag), _AS_SENT),
    d.LOITER_TIME: ((_whole, _nothing, _sign, _flag), (_same, _flag, _same, _flag)),
    d.RETURN: (_NOTHING, _AS_SENT),
    d.LAND: ((_whole, _nothing, _nothing, _sign), (_nothing, _whole, _nothing, _same)),
    d.TAKEOFF: ((_whole, _nothing, _nothing, _nothing), (_nothing, _nothing, _nothing, _same)),
    d.LOITER_TO_ALTITUDE: ((_nothing, _whole, _nothing, _flag), (_flag, _same, _nothing, _flag)),
    d.CHANGE_SPEED: ((_same, _same, _same, _nothing), _AS_SENT),
    d.LAND_START: (_NOTHING, _AS_SENT),
    d.TRIGGER_DISTANCE: ((_same, _nothing, _nothing, _nothing), _AS_SENT),
}
"""What ArduPilot and PX4 keep of the first four numbers of a command. A number that comes back as sent is kept, too."""
OTHERS: tuple[Row, Row] = ((_whole, _whole, _whole, _whole), _NOTHING)
"""Of commands that do not move the aircraft, as those of cameras and servos: each number is whole, or left out."""


def equal_items(held: Sequence[MissionItem], written: Sequence[MissionItem]) -> bool:
    """Whether the items held are the items written: as many of them, and the same numbers as far as they are kept."""
    return same_items(written, held) and all(map(_is_kept, held, written))


def _is_kept(held: MissionItem, written: MissionItem) -> bool:
    """Whether an item held is what an autopilot keeps of the one written.

    The frame and the altitude count only of an item that has a position.
    """
    if written.frame in d.GLOBAL_FRAMES:
        if d.GLOBAL_FRAMES.get(held.frame) != d.GLOBAL_FRAMES[written.frame]:
            return False
        if not math.isclose(held.altitude_m, written.altitude_m, rel_tol=SINGLE, abs_tol=ALTITUDE_M):
            return False
    rows = zip(_AS_SENT, *KEPT.get(written.command, OTHERS), strict=True)
    numbers = zip(held.parameters[:4], written.parameters[:4], rows, strict=True)
    return all(any(_is_near(has, keep(sent)) for keep in kept) for has, sent, kept in numbers)


def _is_near(one: float, other: float) -> bool:
    """Whether two numbers are the same in single precision, or neither is one."""
    return math.isclose(one, other, rel_tol=SINGLE, abs_tol=SINGLE) or (math.isnan(one) and math.isnan(other))

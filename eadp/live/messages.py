"""What MAVLink's messages say of the flight: values in SI units, None where a message says that it does not know.

Source: mavlink.io, the messages of `common` and `ardupilotmega`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.exchange.autopilot import INT32, AutopilotParameter
from eadp.live.mavlink import is_number
from eadp.live.mission import PROTOCOL
from eadp.models import autopilot

Values = dict[str, Any]
Fields = Mapping[str, Any]

UNKNOWN_16, UNKNOWN = 65535, -1
NO_MISSION = 1
"""State of a mission that PX4 holds, and does not fly: it has refused it, or lacks its home position."""
IN_AIR, ON_GROUND = (2, 3, 4), 1
ARMED = 128
"""Flag of a heartbeat: motors are armed."""
ACTIVE = (4, 5, 6)
"""States of a system that flies: active, critical, emergency."""
PICTURES = ("CAMERA_FEEDBACK", "CAMERA_TRIGGER", "CAMERA_IMAGE_CAPTURED")
"""Messages of a picture that was taken; recordings have them."""
ARDUPILOT, PX4 = 3, 12
KINDS = {ARDUPILOT: autopilot.ARDUPILOT, PX4: autopilot.PX4}
"""Kinds of autopilots whose own rules are known, by a heartbeat's `autopilot`."""
NO_AUTOPILOT, NOT_AIRCRAFT = 8, (5, 6, 18, 26, 27, 30)
"""A heartbeat's `autopilot` of senders that are no autopilot, and its `type` of what is no aircraft: antenna tracker,
ground station, computer, gimbal, ADS-B receiver, camera."""
COPTERS, COPTER_MISSION, PLANE_MISSION, PX4_MISSION = (2, 3, 4, 13, 14, 15, 29, 35), 3, 10, (4, 4)
"""ArduPilot's types of copters, its modes AUTO of copters and of planes, and PX4's main mode AUTO, sub-mode MISSION."""
COPTER_RETURNS, PLANE_RETURNS, PX4_RETURNS = (6, 21), (11, 21), (4, 5)
"""The modes in which they fly home: RTL, SMART_RTL, QRTL; PX4's AUTO, RTL."""
COPTER_GUIDED, PLANE_GUIDED, PX4_OFFBOARD = 4, 15, 6
"""The modes in which a computer may fly the plan without a mission; PX4's is a main mode."""


# what each message says, see `READERS`


def _position(fields: Fields) -> Values:
    """Position, ground velocity as east and north, altitude above home, and heading, at a time."""
    found: Values = {"time_s": fields["time_boot_ms"] / 1e3}
    if fields["lat"] or fields["lon"]:  # 0, 0 is no position yet
        found |= {"lat_deg": fields["lat"] / 1e7, "lon_deg": fields["lon"] / 1e7}
        found["velocity_mps"] = [fields["vy"] / 100, fields["vx"] / 100]
        found["altitude_m"] = fields["relative_alt"] / 1e3
    if fields["hdg"] != UNKNOWN_16:
        found["heading_deg"] = fields["hdg"] / 100
    return found


def _battery(fields: Fields) -> Values:
    """Voltage, current, charge drawn and share that remains, of the first battery."""
    if fields["id"]:  # another battery than the first
        return {}
    cells = [cell for cell in (*fields["voltages"], *fields.get("voltages_ext", ())) if cell != UNKNOWN_16]
    amps, consumed = fields["current_battery"], fields["current_consumed"]
    return {
        "voltage_v": sum(cells) / 1e3 if cells and sum(cells) else None,
        "current_a": None if amps < 0 else amps / 100,
        "consumed_ah": None if consumed < 0 or amps < 0 else consumed / 1e3,  # 0 where nothing measures the current
        "remaining": None if fields["battery_remaining"] == UNKNOWN else fields["battery_remaining"] / 100,
    }


def _status(fields: Fields) -> Values:
    """Voltage, current and share that remains, which stand in for those of `_battery` where these do not come."""
    volts, amps, share = fields["voltage_battery"], fields["current_battery"], fields["battery_remaining"]
    return {
        "status_voltage_v": None if volts in (0, UNKNOWN_16) else volts / 1e3,
        "status_current_a": None if amps < 0 else amps / 100,
        "status_remaining": None if share == UNKNOWN else share / 100,
    }


def _wind(fields: Fields) -> Values:
    """The vector that the wind blows towards, from its speed and the direction that it comes from."""
    speed, comes_from = fields["speed"], math.radians(fields["direction"])
    if speed == 0:  # no estimate yet
        return {}
    return {"wind_mps": [-speed * math.sin(comes_from), -speed * math.cos(comes_from)]}


def _item(fields: Fields) -> Values:
    """The number of the item that is flown to, how many items there are, and whether the mission can be flown.

    The number of items is None where an older autopilot does not say it, or none is held: ArduPilot's 0, PX4's 65535.
    PX4 has no item for a moment after an upload: the one before it holds on.
    """
    count, state = fields.get("total", 0), fields.get("mission_state", 0)
    found: Values = {"item_count": None if count in (0, UNKNOWN_16) else count}
    found["valid"] = None if state == 0 or found["item_count"] is None else state != NO_MISSION
    return found if fields["seq"] == UNKNOWN_16 else {"item": fields["seq"], **found}


def _heartbeat(fields: Fields) -> Values:
    """Whether motors are armed, what the autopilot flies, the system is active, and whether item 0 is home."""
    return {
        "armed": bool(fields["base_mode"] & ARMED),
        **_mode(fields),
        "active": fields["system_status"] in ACTIVE,
        "home_is_item": fields["autopilot"] == ARDUPILOT,
        "kind": KINDS.get(fields["autopilot"]),
    }


def is_autopilot(kind: str, fields: Fields) -> bool:
    """Whether a message is the heartbeat of an aircraft's autopilot."""
    return kind == "HEARTBEAT" and fields["autopilot"] != NO_AUTOPILOT and fields["type"] not in NOT_AIRCRAFT


def _mode(fields: Fields) -> Values:
    """Whether the autopilot flies a mission by itself, flies home, or obeys a computer; none for unknown modes."""
    mode, copter = fields["custom_mode"], fields["type"] in COPTERS
    if fields["autopilot"] == PX4:
        modes = mode >> 16 & 255, mode >> 24 & 255
        return {"automatic": modes == PX4_MISSION, "returns": modes == PX4_RETURNS, "guided": modes[0] == PX4_OFFBOARD}
    if fields["autopilot"] != ARDUPILOT:
        return {"automatic": None}
    return {
        "automatic": mode == (COPTER_MISSION if copter else PLANE_MISSION),
        "returns": mode in (COPTER_RETURNS if copter else PLANE_RETURNS),
        "guided": mode == (COPTER_GUIDED if copter else PLANE_GUIDED),
    }


def _landed(fields: Fields) -> Values:
    """Whether the aircraft is in the air, None where the autopilot does not know."""
    state = fields["landed_state"]
    return {"in_air": None if state not in (ON_GROUND, *IN_AIR) else state in IN_AIR}


def _named(fields: Fields) -> Values:
    """A named value, that of a parameter that a process on board runs with: its name, and the value."""
    return {"named": (_text(fields["name"]), fields["value"])}


def _parameter(fields: Fields) -> Values:
    """A parameter of the autopilot: its name, value and MAVLink's type."""
    return {"parameter": (_text(fields["param_id"]), fields["param_value"], fields["param_type"])}


def _text(name: str | bytes) -> str:
    """A name as text, without the zeros that fill it up."""
    return (name if isinstance(name, str) else bytes(name).decode("ascii", "replace")).rstrip("\0")


def _said(fields: Fields) -> Values:
    """A text, or a piece of one: its number, 0 for a whole text, the number of the piece, and the text."""
    return {"said": (fields.get("id", 0), fields.get("chunk_seq", 0), _text(fields["text"]))}


def _answer(fields: Fields) -> Values:
    """The answer to a command: the command's number, and the result, 0 where it is accepted."""
    return {"answer": (fields["command"], fields["result"])}


READERS: dict[str, Callable[[Fields], Values]] = {
    "GLOBAL_POSITION_INT": _position,
    "BATTERY_STATUS": _battery,
    "SYS_STATUS": _status,
    "VFR_HUD": lambda fields: {"airspeed_mps": fields["airspeed"]},
    "WIND": _wind,
    "WIND_COV": lambda fields: {"wind_mps": [fields["wind_y"], fields["wind_x"]]},
    "SYSTEM_TIME": lambda fields: {"time_s": fields["time_boot_ms"] / 1e3},
    "MISSION_CURRENT": _item,
    "MISSION_ITEM_REACHED": lambda fields: {"reached": fields["seq"]},
    "HEARTBEAT": _heartbeat,
    "EXTENDED_SYS_STATE": _landed,
    "NAMED_VALUE_FLOAT": _named,
    "COMMAND_ACK": _answer,
    "PARAM_VALUE": _parameter,
    "STATUSTEXT": _said,
}
"""The messages that are read, and what each says."""

TIMED = ("GLOBAL_POSITION_INT", "SYSTEM_TIME")
"""The messages that have the autopilot's time, and so make lines."""

WANTED = frozenset(READERS) | PROTOCOL


def values_of(kind: str, fields: Fields) -> Values:
    """What a message says; numbers that are not finite are None."""
    return {key: finite(value) for key, value in READERS[kind](fields).items()}


def finite(value: Any) -> Any:
    """A value of a message; None where it is, or has, a number that is not finite; a tuple is a name and a value."""
    if isinstance(value, float):
        return value if is_number(value) else None
    if isinstance(value, list):
        return value if all(map(is_number, value)) else None
    if isinstance(value, tuple):
        return value if is_number(value[1]) else None
    return value


ASKED = 3
"""How often a name is asked for; then its name in older versions is, as often."""


class ParameterCheck:
    """Asks for parameters until they have come, or do not.

    Parameters
    ----------
    wanted : sequence of AutopilotParameter
    as_bytes : bool
        Whether a whole number comes as the bytes of a number in single precision, as PX4 sends it.
        Source: mavlink.io, "Parameter Protocol", parameter encoding.
    """

    def __init__(self, wanted: Sequence[AutopilotParameter], *, as_bytes: bool = False) -> None:
        self._as_bytes = as_bytes
        self._left = list(wanted)  # parameters that have not come
        self._differences = list[str]()  # of each that has come, how it disagrees, empty where it does not
        self._rounds = 0  # how often names were asked for

    def take(self, name: str, value: float, kind: int) -> float | None:
        """Compare a parameter that has come, of one of MAVLink's types, if it is one of those wanted; return its value.

        None for others, and for one that has come before.
        """
        if self._as_bytes and kind == INT32:
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        found = [each for each in self._left if name in (each.name, each.older)]
        for each in found:
            self._left.remove(each)
            self._differences.append(each.difference(name, value))
        return value if found else None

    def names(self) -> list[str]:
        """The names to ask for now: of parameters that have not come, `ASKED` times the name, then the older name."""
        self._rounds += 1
        if self._rounds <= ASKED:
            return [each.name for each in self._left]
        return [each.older for each in self._left if each.older] if self._rounds <= 2 * ASKED else []

    def result(self) -> str:
        """What disagrees, once all parameters have come or no more are asked for; empty before, and at later calls."""
        if self._left and self._rounds <= 2 * ASKED:
            return ""
        text, self._differences = "; ".join(filter(None, self._differences)), []
        return text

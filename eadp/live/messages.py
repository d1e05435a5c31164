"""What MAVLink's messages say of the flight, in SI units, and the readings of telemetry that are made of it.

A reading is made for each position, five a second at most, of the messages and the autopilot's clock alone, so that a
recording gives the same lines.

Source: mavlink.io, the messages of `common` and `ardupilotmega`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.exchange.autopilot import INT32, AutopilotParameter
from eadp.exchange.writer import MappedItem
from eadp.live.mavlink import is_number
from eadp.live.mission import PROTOCOL
from eadp.live.telemetry import Reading, TelemetryReader
from eadp.models import autopilot
from eadp.models.performance import calibrated_over_true
from eadp.models.world import Mission

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
    "HEARTBEAT": _heartbeat,
    "EXTENDED_SYS_STATE": _landed,
    "NAMED_VALUE_FLOAT": _named,
    "COMMAND_ACK": _answer,
    "PARAM_VALUE": _parameter,
    "STATUSTEXT": _said,
}
"""The messages that are read, and what each says."""

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


LINE_S = 0.2
"""Least time between two lines [s]: ten a second to one in two seconds are enough."""

BLIND_S = 1.0
"""Time after which a line is made without a position [s]."""

STALE_S = 5.0
"""Age from which a value is unknown [s]: as positions are after a gap of that length."""

PASSING = frozenset(
    (
        *("time_s", "named", "answer", "parameter", "said", "valid"),
        *("lat_deg", "lon_deg", "velocity_mps", "heading_deg", "altitude_m"),
    )
)
"""Keys of values that hold at the time of their message alone; others are known until they are old."""

STILL_MPS = 5.0
"""Ground speed below which a disarmed aircraft has landed [m/s]: an autopilot that restarts in the air is disarmed."""


class Heard:
    """What was heard, by name: the value, and when it came.

    Attributes
    ----------
    now_s : float
        The autopilot's time [s]; −∞ before the first.
    restarts : int
        How often that time started again.
    """

    def __init__(self) -> None:
        self.now_s = -math.inf
        self.restarts = 0
        self._known: dict[str, tuple[float, Any]] = {}

    def starts(self, time_s: float) -> bool:
        """Go on to a time; whether an autopilot starts with it, whose values so far are of that time then."""
        # one that starts again counts from 0; messages that overtake one another are no new start
        starts = self.now_s == -math.inf or time_s < self.now_s - STALE_S
        if starts:
            self.restarts += self.now_s > -math.inf
            self._known = {key: (time_s, value) for key, (_, value) in self._known.items()}
        self.now_s = time_s if starts else max(self.now_s, time_s)
        return starts

    def keep(self, key: str, value: Any) -> None:
        """Keep a value that came now."""
        self._known[key] = self.now_s, value

    def value(self, *keys: str, ages: bool = True) -> Any:
        """The value of the first key that has one that is not old, with `ages=False` of any age; None without."""
        for key in keys:
            at_s, value = self._known.get(key, (0.0, None))
            if value is not None and (not ages or self.now_s - at_s <= STALE_S):
                return value
        return None


class LineMaker:
    """Collects what an autopilot says, and makes lines of it.

    Parameters
    ----------
    reader : TelemetryReader
        Checks values, and makes samples of them.
    mission : Mission
    items : list of MappedItem, optional
        The stages of its mission's items.
    warn : function
        Called with a text, once for each thing that is wrong.

    Attributes
    ----------
    items : list of MappedItem or None
        As given; who holds the LineMaker replaces it where the autopilot has another mission.
    autopilot : dict
        Values of the autopilot's parameters that are read, by name.
    decided : tuple of float or None
        The path parameters decided, where the mission has them or is about to get them: an item that has others is not
        taken as a pilot's refusal of them. Else None.
    flown : bool
        Whether the aircraft has been in the air.
    heard : Heard
        What the autopilot said last.
    count : int
        The number of lines made.
    """

    def __init__(
        self, reader: TelemetryReader, mission: Mission, items: Sequence[MappedItem] | None, warn: Callable[[str], None]
    ) -> None:
        self._reader, self.items, self._warn = reader, items, warn
        self._mission, self._calibrated = mission, calibrated_over_true(mission.plan.site, mission.vehicle)
        self.heard = Heard()
        self.count = 0
        self._line_s = -math.inf  # the time of the last line [s]
        self._ground: dict[str, Any] | None = None  # the last line on the ground
        self.flown = False
        self.autopilot: dict[str, float] = {}
        self._said: dict[str, Any] = {}  # of the autopilot, in the last line that has it
        self.decided: tuple[float, ...] | None = None

    def update(self, values: Mapping[str, Any]) -> list[Reading]:
        """Take what a message says; return the lines that are due: one, or two where the aircraft takes off."""
        readings = []
        for line in self._due(values):
            self.count += 1
            readings.append(self._reader.reading(self.count, line))
        return readings

    def _due(self, values: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Keep what a message says, see `_keep`; return the lines that are due with it.

        A message with a time makes a line, unless it comes too soon after the last line, or on the ground. The first
        line in the air comes after the last one on the ground, at which the flight starts.
        """
        self._keep(values)
        time_s, placed = values.get("time_s"), "lat_deg" in values
        if time_s is None or not self._is_due(time_s, placed=placed):
            return []
        line = self._line(values)
        self._line_s = time_s
        if not self._flies():
            self._ground = line if placed else self._ground
            return []
        lines = [line]
        if not self.flown and self._ground is not None and 0 < time_s - self._ground["time_s"] <= STALE_S:
            lines = [self._ground, line]
        self.flown = True
        for each in lines:  # lines on the ground, which no one has, say nothing
            if (autopilot := each.get("autopilot", self._said)) != self._said:
                self._said = autopilot
            else:
                each.pop("autopilot", None)
        return lines

    def _is_due(self, time_s: float, *, placed: bool) -> bool:
        """Go on to a time; whether a line is due with it: one without a position only where none has come for long."""
        before_s = self.heard.now_s
        if self.heard.starts(time_s):  # as the first time does
            return True
        return time_s >= before_s and time_s - self._line_s >= (LINE_S - 1e-6 if placed else BLIND_S)

    def _keep(self, values: Mapping[str, Any]) -> None:
        """Keep what a message says for the lines to come."""
        if values.get("named") is not None:
            self._report(*values["named"])
        for key, value in values.items():
            if key not in PASSING:
                self.heard.keep(key, value)
        if velocity := values.get("velocity_mps"):
            self.heard.keep("speed_mps", math.hypot(*velocity))

    @property
    def landed(self) -> bool:
        """Whether the flight is over: the aircraft has flown, is disarmed, and does not move."""
        speed_mps = self.heard.value("speed_mps", ages=False) or 0.0
        return self.flown and speed_mps < STILL_MPS and self.heard.value("armed") is False

    @property
    def flies_by_itself(self) -> bool:
        """Whether the autopilot flies its mission, and not the pilot."""
        return bool(self.heard.value("automatic", ages=False))

    @property
    def flies_mission(self) -> bool | None:
        """Whether the mission is flown: False where a pilot flies, or the autopilot holds or returns.

        None where that is unknown: without a map an autopilot of unknown modes, or one that a computer guides, may fly
        any way.
        """
        automatic = self.heard.value("automatic", ages=False)
        if self.items is not None or not (automatic is None or self.heard.value("guided", ages=False)):
            return automatic is not False
        return None

    @property
    def returns(self) -> bool:
        """Whether the autopilot flies home, by its mode."""
        return bool(self.heard.value("returns", ages=False))

    @property
    def item(self) -> int | None:
        """The number of the item that is flown to, as the autopilot counts."""
        number: int | None = self.heard.value("item", ages=False)
        return number

    @property
    def index(self) -> int | None:
        """The index in the map of the item that is flown to; None where that is unknown."""
        return None if self.item is None else self.item - self._home_is_item

    # --- one line

    def _line(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The line of telemetry at a message's time: what the message says, and earlier values that are not old."""
        volts = self.heard.value("voltage_v", "status_voltage_v")
        amps = self.heard.value("current_a", "status_current_a")
        line: dict[str, Any] = {"time_s": self.heard.now_s}
        for key in ("lat_deg", "lon_deg", "velocity_mps", "heading_deg"):
            line[key] = values.get(key)
        line["power_w"] = None if volts is None or amps is None else round(volts * amps, 4)
        line["voltage_v"] = volts
        line |= self._charge()
        item, flies, kind = self._item(), self.flies_mission, self.heard.value("kind", ages=False)
        more = {
            "altitude_m": values.get("altitude_m"),
            "airspeed_mps": self._true_mps(),
            "wind_mps": self.heard.value("wind_mps"),
            "flies_mission": flies if self.items is not None or flies is False else None,
            "returns_home": self.returns or None,
            "stages_started": item.first if item is not None and item.first == item.last else None,
            "parameters": self._in_force(item) or None,
            "autopilot": None if kind is None else {"kind": kind, **self.autopilot},
        }
        return line | {key: value for key, value in more.items() if value is not None}

    def _true_mps(self) -> float | None:
        """The true airspeed, of a calibrated one where it is not said itself [m/s]."""
        true_mps: float | None = self.heard.value("true_mps")
        calibrated_mps: float | None = self.heard.value("airspeed_mps")
        if true_mps is None and calibrated_mps is not None:
            true_mps = round(calibrated_mps / self._calibrated, 4)
        return true_mps

    def _in_force(self, item: MappedItem | None) -> dict[str, float | None]:
        """Parameters in force: computations' as their processes report them, the path's as the item flown to has them.

        None where the mission is about to get other values: a value is on its way to the aircraft.
        """
        plan = self._mission.plan
        reported = {
            each.name: self.heard.value(f"parameter {each.name}") for each in plan.parameters[plan.path_count :]
        }
        found: dict[str, float | None] = {name: value for name, value in reported.items() if value is not None}
        if item is None:
            return found
        on_its_way = self.decided not in (None, item.parameters)
        path = (None if on_its_way else value for value in item.parameters)
        return found | dict(zip(plan.names, path, strict=False))

    def _charge(self) -> dict[str, Any]:
        """The charge of a line: the charge drawn, in finer steps, if it was ever reported; else the share left."""
        if self.heard.value("consumed_ah", ages=False) is not None:
            return {"current_consumed_ah": self.heard.value("consumed_ah")}
        return {"soc": self.heard.value("remaining", "status_remaining")}

    def _item(self) -> MappedItem | None:
        """The item of the map that is flown to; None where that is unknown, or, with a warning, not in the map."""
        number, index = self.item, self.index
        if self.items is None or index is None:
            return None
        if not 0 <= index < len(self.items):
            if self._flies():  # on the ground ArduPilot flies to item 0
                self._warn(f"the mission has no item {number} of those of --items: the stage is found by the position")
            return None
        return self.items[index]

    def _report(self, name: str, value: float) -> None:
        """Note the value of a computation's parameter that its process reports to be in force."""
        plan = self._mission.plan
        for parameter in plan.parameters[plan.path_count :]:
            if name in (parameter.name, parameter.label[:10]):  # NAMED_VALUE_FLOAT has 10 characters for a name
                self.heard.keep(f"parameter {parameter.name}", value)

    def _flies(self) -> bool:
        """Whether the aircraft is in the air: as the autopilot says, else if it is armed and active."""
        in_air = self.heard.value("in_air", ages=False)
        if in_air is not None:
            return bool(in_air)
        return bool(self.heard.value("armed", ages=False)) and bool(self.heard.value("active", ages=False))

    @property
    def _home_is_item(self) -> bool:
        """Whether the autopilot's item 0 is home."""
        return bool(self.heard.value("home_is_item", ages=False))

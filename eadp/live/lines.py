"""Readings of telemetry from what an autopilot's messages say: one for each position, five a second at most.

Readings depend on the messages and the autopilot's clock alone, so that a recording gives the same lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.exchange.item_map import MappedItem
from eadp.live.telemetry import Reading, TelemetryReader
from eadp.models.performance import calibrated_over_true
from eadp.planning.base import Mission

LINE_S = 0.2
"""Least time between two lines [s]: ten a second to one in two seconds are enough."""

BLIND_S = 1.0
"""Time after which a line is made without a position [s]."""

STALE_S = 5.0
"""Age from which a value is unknown [s]: as positions are after a gap of that length."""

PASSING = frozenset(
    (
        *("time_s", "named", "answer", "parameter", "reached", "said", "valid", "mission_id"),
        *("lat_deg", "lon_deg", "velocity_mps", "heading_deg", "altitude_m"),
    )
)
"""Keys of values that hold at the time of their message alone; others are known until they are old."""

STILL_MPS = 5.0
"""Ground speed below which a disarmed aircraft has landed [m/s]: an autopilot that restarts in the air is disarmed."""

CURVE_SHARE, RESISTANCE_SHARE = 0.2, 0.5
"""By how much a voltage may differ from the battery's: a share of the rise from empty to full, by which the curves of
usual cells differ from a straight line; and a share of the drop at the inner resistance, which is known roughly."""


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
        self._reached = -1  # the number of the item reached last

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
        values = self._keep(values)
        time_s = values.get("time_s")
        if time_s is None:
            return []
        before_s = self.heard.now_s
        starts = self.heard.starts(time_s)  # the first time counts as a start, too
        if not starts and time_s < before_s:
            return []
        placed = "lat_deg" in values  # a line without a position is made where none has come for `BLIND_S`
        if not starts and time_s - self._line_s < (LINE_S - 1e-6 if placed else BLIND_S):
            return []
        line = self._line(values)
        self._line_s = time_s
        if not self._flies():
            self._ground = line if placed else self._ground
            return []
        ground = None if self.flown else self._ground
        self.flown = True
        if ground is not None and 0 < time_s - ground["time_s"] <= STALE_S:
            return [ground, line]
        return [line]

    def _keep(self, values: Mapping[str, Any]) -> Mapping[str, Any]:
        """Keep what a message says for the lines to come; return it, for an item that is reached see `_after`."""
        if values.get("named") is not None:
            self._report(*values["named"])
        if "reached" in values:
            values = self._after(values["reached"])
        for key, value in values.items():
            if key not in PASSING:
                self.heard.keep(key, value)
        if velocity := values.get("velocity_mps"):
            self.heard.keep("speed_mps", math.hypot(*velocity))
        return values

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
        self._check_voltage(volts, amps, line)
        if (altitude_m := values.get("altitude_m")) is not None:
            line["altitude_m"] = altitude_m
        calibrated_mps, true_mps, wind_mps = map(self.heard.value, ("airspeed_mps", "true_mps", "wind_mps"))
        if true_mps is None and calibrated_mps is not None:
            true_mps = round(calibrated_mps / self._calibrated, 4)
        line |= {} if true_mps is None else {"airspeed_mps": true_mps}
        line |= {} if wind_mps is None else {"wind_mps": wind_mps}
        # parameters in force: computations' as their processes report them, the path's as the item flown to has them
        item = self._item()
        plan = self._mission.plan
        reported = {
            each.name: self.heard.value(f"parameter {each.name}") for each in plan.parameters[plan.path_count :]
        }
        parameters: dict[str, float | None] = {name: value for name, value in reported.items() if value is not None}
        flies = self.flies_mission
        if self.items is not None or flies is False:
            line["flies_mission"] = flies
        if self.returns:
            line["returns_home"] = True
        if item is not None:
            if item.first == item.last:
                line["stages_started"] = item.first
            # None where the mission is about to get other values: a value is on its way to the aircraft
            on_its_way = self.decided not in (None, item.parameters)
            path = (None if on_its_way else value for value in item.parameters)
            parameters |= dict(zip(plan.names, path, strict=False))
        if parameters:
            line["parameters"] = parameters
        kind = self.heard.value("kind", ages=False)
        if kind is not None and (own := {"kind": kind, **self.autopilot}) != self._said:
            line["autopilot"] = self._said = own
        return line

    def _charge(self) -> dict[str, Any]:
        """The charge of a line: the charge drawn, in finer steps, if it was ever reported; else the share left."""
        if self.heard.value("consumed_ah", ages=False) is not None:
            return {"current_consumed_ah": self.heard.value("consumed_ah")}
        return {"soc": self.heard.value("remaining", "status_remaining")}

    def _check_voltage(self, volts: float | None, amps: float | None, line: Mapping[str, Any]) -> None:
        """Warn where the voltage does not fit the charge: another battery, or one that was not full."""
        battery, soc = self._mission.battery, line.get("soc")
        if (drawn := line.get("current_consumed_ah")) is not None:
            soc = max(battery.soc - battery.drain_per_as * 3600 * drawn, 0.0)
        if volts is None or soc is None or battery.voltage_empty_v is None:
            return
        # V + R I is the open-circuit voltage
        drop_v = battery.resistance_ohm * max(amps or 0.0, 0.0)
        off_v = volts + drop_v - battery.voltage_at(soc)
        allowed_v = CURVE_SHARE * (battery.voltage_v - battery.voltage_empty_v) + RESISTANCE_SHARE * drop_v
        if abs(off_v) > allowed_v:
            said = "above" if off_v > 0 else "below"
            self._warn(f"the voltage is far {said} that of the charge: another battery, or one that was not full")

    def _after(self, reached: int) -> dict[str, Any]:
        """What an item that is reached says: that the item after it is flown to; nothing where it was said before."""
        again, self._reached = reached == self._reached, reached
        if again or reached < (self.item or 0):
            return {}
        last = None if self.items is None else len(self.items) - 1 + self._home_is_item
        return {"item": reached + 1 if last is None else min(reached + 1, last)}

    def _item(self) -> MappedItem | None:
        """The item of the map that is flown to; None where that is unknown, or, with a warning, not in the map."""
        number = self.item
        if self.items is None or number is None:
            return None
        index = number - 1 if self._home_is_item else number
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

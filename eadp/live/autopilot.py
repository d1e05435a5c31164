"""The autopilot at the other end of a link: who it is, whether it is heard, what it is asked and commanded."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.errors import Fault, printable
from eadp.exchange.items import CHANGE_SPEED
from eadp.exchange.writer import MappedItem
from eadp.live.flight import COMPLETED, KEPT, TAKE_OFF
from eadp.live.mavlink import COMPONENT, Message
from eadp.live.messages import is_autopilot
from eadp.live.replanner import Warn
from eadp.models.autopilot import ARDUPILOT, LIMITS, PX4
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import RETURN
from eadp.planning.state.flight_state import CELL_LOST

HEARTBEAT_S, LOST_S = 1.0, 5.0
"""How often to send a heartbeat, and the time without one after which the autopilot's are lost [s]."""

BEAT = {"type": 18, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
"""The heartbeat of a computer on board, which is no autopilot."""

ACCEPTED, IN_PROGRESS = 0, 5
"""Answers to a command that the autopilot accepts, and works on."""
MAX_COMMANDS = 10
"""How often a command is given at most."""
SET_INTERVAL = 511
"""The command that asks for a message at an interval."""
AGAINST = re.compile(r"mission rejected|arming denied|(pre)?arm: .*(mission|land)", re.IGNORECASE)
"""What an autopilot's texts begin with that speak against its mission: PX4's, and those of ArduPilot's arming checks.

Source: PX4's `FeasibilityChecker.cpp` and `Commander.cpp`; ArduPilot's `AP_Arming.cpp` and, of Plane,
`AP_Arming_Plane.cpp`."""
NO_REASON = "no reason given, it may lack its home position"
REFUSED_S = 30.0
"""For how long such a text counts [s]: ArduPilot repeats them as often."""
PIECE = 50
"""Characters of a piece of a text that another one follows."""
INTERVALS = {
    "GLOBAL_POSITION_INT": (33, 200_000),
    "VFR_HUD": (74, 500_000),
    "BATTERY_STATUS": (147, 500_000),
    "WIND": (168, 1_000_000),
    "WIND_COV": (231, 1_000_000),
    "EXTENDED_SYS_STATE": (245, 1_000_000),
    "SYSTEM_TIME": (2, 1_000_000),
    "MISSION_CURRENT": (42, 1_000_000),
}
"""The messages that are asked for: the number of each, and its interval [µs]."""


class HeardAutopilot:
    """The autopilot that is heard.

    Parameters
    ----------
    system : int or None
        Its MAVLink system; None for the first one heard.
    give : function
        Sends a message by name and fields.
    pilot : Pilot
        Reads what is noted of it.

    Attributes
    ----------
    system, component : int or None, int
        Who it is; component 0 before it is heard.
    lost : bool
        Whether its heartbeats are lost.
    armed, ardupilot : bool
        By its last heartbeat.
    missing : set of str
        Names of messages that were asked for, and have not come yet.
    refusal : str
        What it says against its mission, empty where it does not.
    """

    def __init__(self, system: int | None, give: Callable[[str, Mapping[str, Any]], None], pilot: Pilot) -> None:
        self.system, self.component, self._give, self._pilot = system, 0, give, pilot
        self.lost = self.armed = self.ardupilot = False
        self.missing: set[str] = set()
        self.refusal, self._refused_s = "", -math.inf
        self._text = ""  # a text of which pieces are still to come
        self._heard_s: float | None = None  # its last heartbeat [s]
        self._sent_s = -math.inf  # our last heartbeat [s]
        self._asked = self._returns = 0  # how often messages were asked for, and a return was commanded

    def hear(self, message: Message, now_s: float) -> bool:
        """Note who sends, and whether heartbeats are back; return whether the message is to be taken.

        Taken are all messages of the autopilot, which is the first one heard, but for `NAMED_VALUE_FLOAT`; and these of
        other computers of its aircraft: values that they report to run with. PX4 sends those that it gets back as its
        own.
        """
        beats = is_autopilot(message.kind, message.fields)
        if message.kind == "HEARTBEAT" and not beats:
            return False
        # a heartbeat of the autopilot, or of the first one that is heard
        if self.system in (None, message.system) and beats and self.component in (0, message.component):
            if not self.component:
                self._pilot.note(f"autopilot of system {message.system}, component {message.component}")
            self.system, self.component, self._heard_s = message.system, message.component, now_s
            if self.lost:
                self.lost, self._returns = False, 0
                self._pilot.note("the autopilot's heartbeats are back")
        if message.system != self.system or not self.component:
            if self.system not in (None, message.system):
                self._pilot.say(f"messages of system {message.system} are ignored")
            return False
        if message.kind == "NAMED_VALUE_FLOAT":  # not our own, which the autopilot or a router may send back
            return message.component not in (COMPONENT, self.component)
        if message.component == self.component:
            self.missing.discard(message.kind)
        return message.component == self.component

    def beat(self, now_s: float) -> bool:
        """Note whether its heartbeats are lost, and send our heartbeat where it is due; return whether it was due."""
        if self._heard_s is not None and not self.lost and now_s - self._heard_s > LOST_S:
            self.lost = True
            self._pilot.note("the autopilot's heartbeats are lost")
        if self.armed or now_s - self._refused_s > REFUSED_S:
            self.refusal = ""
        if due := now_s - self._sent_s >= HEARTBEAT_S:
            self._sent_s = now_s
            self._give("HEARTBEAT", BEAT)
        return due

    def read_text(self, said: tuple[int, int, str], now_s: float) -> None:
        """Take a text of it, or a piece of one; the pilot reads what speaks against its mission."""
        number, piece, text = said
        self._text = text if piece == 0 else self._text + text
        if (number == 0 or len(text) < PIECE) and AGAINST.match(self._text):
            self.refusal, self._refused_s = self._text.strip(), now_s
            self._pilot.tell(f"the autopilot refuses: {printable(self.refusal)}")

    def judge(self, valid: bool | None, now_s: float) -> None:
        """Note whether it says that its mission can be flown; None where it does not say."""
        if valid and self.refusal == NO_REASON:
            self.refusal = ""
        elif valid is False:
            self.refusal, self._refused_s = self.refusal or NO_REASON, now_s

    def ask(self) -> None:
        """Ask for the messages of `INTERVALS`, of the two of the wind for the autopilot's own."""
        # ArduPilot sends WIND, and shows the pilot each request for WIND_COV
        self.missing, self._asked = set(INTERVALS) - {"WIND_COV" if self.ardupilot else "WIND"}, 0
        self.ask_again()

    def ask_again(self) -> None:
        """Ask again for the messages of which none has come, `MAX_COMMANDS` times at most."""
        self._asked += 1
        for kind in sorted(self.missing) if self._asked <= MAX_COMMANDS else ():
            self.command(SET_INTERVAL, INTERVALS[kind])

    @property
    def was_commanded(self) -> bool:
        """Whether it was commanded to return."""
        return self._returns > 0

    def command_return(self) -> bool:
        """Command it to return home, once more; True where it is to be given up, after `MAX_COMMANDS` commands."""
        self._returns += 1
        if self._returns > MAX_COMMANDS:
            self._pilot.tell(f"return not accepted by the autopilot, commanded {MAX_COMMANDS} times")
            return True
        self.command(RETURN, (), self._returns - 1)
        return False

    def command(self, command: int, numbers: Sequence[float], repeated: int = 0) -> None:
        """Give a command with the first of its seven parameters; `repeated` is how often it was given before."""
        values = {f"param{k}": float(value) for k, value in enumerate((*numbers, *(0.0,) * 7)[:7], 1)}
        self.give("COMMAND_LONG", {"command": command, "confirmation": repeated, **values})

    def give(self, kind: str, values: Mapping[str, Any]) -> None:
        """Send it a message."""
        self._give(kind, {"target_system": self.system, "target_component": self.component, **values})


class CommandedAirspeed:
    """The airspeed of a flight as it is commanded: at once where another is decided, and again until it is accepted.

    Parameters
    ----------
    cruise_mps, calibrated : float
        True airspeed that the autopilot holds by itself, as in each mode anew [m/s]; and what it holds over a true one.
    autopilot : HeardAutopilot
    pilot : Pilot
        Reads once that an airspeed is refused.

    Attributes
    ----------
    decided_mps : float or None
        The true airspeed decided [m/s]; None where none is: then the autopilot, or its pilot, chooses.
    """

    def __init__(self, cruise_mps: float, calibrated: float, autopilot: HeardAutopilot, pilot: Pilot) -> None:
        self._calibrated, self._autopilot, self._pilot = calibrated, autopilot, pilot
        self.decided_mps: float | None = None
        # calibrated airspeeds [m/s]: of cruise; that the autopilot holds, None where that is unknown, as after a start
        # in flight; and that was commanded, so often, without an answer yet
        self._cruise_mps = round(cruise_mps * calibrated, 2)
        self._held_mps: float | None = None
        self._asked_mps, self._asked = 0.0, 0
        self._refusals = set[float]()  # calibrated airspeeds that were refused [m/s]
        self._index: int | None = None  # of the item that was flown to

    def pass_items(self, items: Sequence[MappedItem] | None, index: int | None) -> None:
        """Note the airspeed that an item of the mission has commanded on the way to the one that is flown to now."""
        if items is not None and index is not None and self._index is not None:
            for each in items[self._index : index]:
                if each.item.command == CHANGE_SPEED and each.item.parameters[0] == 0 < each.item.parameters[1]:
                    self._held_mps = round(each.item.parameters[1], 2)
        self._index = index

    def command(self, *, flies: bool | None) -> dict[str, float]:
        """Command what is decided where the mission `flies`, None for unknown; return as `take`, of no answer."""
        if not flies:  # a mode is entered with the autopilot's own airspeed
            self._held_mps, self._asked = None if flies is None else self._cruise_mps, 0
            return {}
        wanted_mps = self._held_mps if self.decided_mps is None else round(self.decided_mps * self._calibrated, 2)
        if wanted_mps is None or wanted_mps in (self._held_mps, *self._refusals):
            self._asked = 0
            return {}
        if wanted_mps != self._asked_mps:
            self._asked_mps, self._asked = wanted_mps, 0
        self._asked += 1
        if self._asked > MAX_COMMANDS:
            return self._refused(f"no answer to {MAX_COMMANDS} commands")
        self._autopilot.command(CHANGE_SPEED, (0.0, wanted_mps, -1.0), self._asked - 1)
        return {}

    def take(self, command: int, result: int) -> dict[str, float]:
        """Take an answer; of a refusal return the autopilot's limit that it shows, by name: what is held is allowed."""
        if command != CHANGE_SPEED or not self._asked or result == IN_PROGRESS:
            return {}
        if result != ACCEPTED:
            return self._refused(f"result {result}")
        self._held_mps, self._asked = self._asked_mps, 0
        self._pilot.note(f"the autopilot accepts an airspeed of {self._held_mps:g} m/s")
        return {}

    def _refused(self, why: str) -> dict[str, float]:
        self._pilot.tell(f"the autopilot refuses an airspeed of {self._asked_mps:g} m/s: {why}")
        self._refusals.add(self._asked_mps)
        low, high = LIMITS[ARDUPILOT if self._autopilot.ardupilot else PX4]
        held_mps, self._asked = self._held_mps or self._cruise_mps, 0
        return {low if self._asked_mps < held_mps else high: held_mps}


NOTICE, WARNING, CRITICAL = 5, 4, 2
"""MAVLink's severities of texts."""
TEXT_CHARACTERS, NAME_CHARACTERS, MAX_TEXT = 50, 10, 200
"""Characters of a piece of a text, of a name, and of a text at most."""

MARKS_MIN = (60, 45, 30, 20, 15, 10, 5, 3, 2, 1)
"""Minutes left for the way home at which the pilot reads how many there are; at `FEW_MIN` and fewer as a warning."""
FEW_MIN = 5

_NUMBERS = re.compile(r"[-+.\d]+")
"""Numbers in a text: texts that differ in them alone say the same thing."""


class Pilot:
    """The pilot of a flight over a link.

    Parameters
    ----------
    name : str
        Name of the link in warnings.
    plan : Plan
    parameters : sequence of float
        At take-off.
    warn : function of a Fault
    give : function
        Sends a message to all, by name and fields.
    line : function
        The number of the line that is being taken.
    clock_s : function, optional
        The time of day, in seconds since 1970.
    """

    def __init__(
        self,
        name: str,
        plan: Plan,
        parameters: Sequence[float],
        warn: Warn,
        give: Callable[[str, Mapping[str, Any]], None],
        line: Callable[[], int],
        clock_s: Callable[[], float] = time.time,
    ) -> None:
        self._name, self._plan, self._warn, self._give, self._line = name, plan, warn, give, line
        self._clock_s = clock_s
        self._warned: set[str] = set()
        self._about = ""  # the parameters, and the reason without its numbers, of the last text of a decision
        self._path = tuple(parameters[: plan.path_count])  # last decided
        self._passed: int | None = None  # how many of `MARKS_MIN` there are above the minutes left; None before any
        self._texts = 0  # the number of the last text that was sent in pieces

    # --- warnings

    def say(self, what: str) -> None:
        """Warn on standard error, once."""
        self.once(Fault(self._name, max(self._line(), 1), 1, what, severity="warning"))

    def tell(self, what: str) -> None:
        """Warn on standard error and at the ground station, once."""
        before = len(self._warned)
        self.say(what)
        if len(self._warned) > before:
            self.show(what, WARNING)

    def note(self, what: str) -> None:
        """Note on standard error something that is as it should be."""
        self._warn(Fault(self._name, max(self._line(), 1), 1, what, severity="note"))

    def once(self, fault: Fault) -> None:
        """Warn of each thing once: a link repeats what is wrong with it many times a second."""
        kind = _NUMBERS.sub("", fault.message)
        if kind not in self._warned:
            self._warned.add(kind)
            self._warn(fault)

    # --- at the ground station

    def decision(self, line: Mapping[str, Any], *, completes: bool, flown: bool = True, returns: bool = False) -> None:
        """Send a decision's numbers to the ground station, and its reason as a text, if that says something new.

        While the mission is not `flown` its reasons are none of the flight. While the autopilot `returns`, the
        parameters are not sent either.
        """
        boot_ms = max(0, round(line["time_s"] * 1000)) % 2**32
        parameters, left_min = () if returns else self._plan.parameters, _left_min(line)
        shown: dict[str, float | None] = {p.label: p.shown(line["parameters"][p.name]) for p in parameters}
        shown |= {"airspeed": line["airspeed_mps"], "soc_end": line["soc_end_forecast"]}
        shown |= {"p_done": line["completes_probability"], "min_left": left_min}
        for name, value in shown.items():
            if value is not None:
                fields = {"time_boot_ms": boot_ms, "name": _ascii(name)[:NAME_CHARACTERS].encode(), "value": value}
                self._give("NAMED_VALUE_FLOAT", fields)
        # a reason of which only numbers change is sent once; new path parameters are always sent, before the reason
        # where it does not start with their name
        about = repr(line["parameters"]) + _NUMBERS.sub("", line["reason"])
        path = self._new_path(line)
        speaks = (flown and not returns) or line["reason"] == COMPLETED
        if speaks and (line["reason"] != KEPT or path) and about != self._about:
            self._about = about
            has_path = not path or line["reason"].startswith(path.partition(" ")[0])
            text = line["reason"] if has_path else f"{path}: {line['reason']}"
            self.show(text, NOTICE if completes or line["reason"] == TAKE_OFF else WARNING)
        if left_min is not None:
            self._minutes(left_min, line)
        if CELL_LOST in line["warnings"]:
            self.tell("the voltage fell for good: a cell, or its charge, is lost")

    def _minutes(self, left_min: float, line: Mapping[str, Any]) -> None:
        """Say how many minutes are left for the way home: at first, and where they fall below a mark."""
        passed, before = sum(left_min < mark for mark in MARKS_MIN), self._passed
        # minutes that waver about a mark are said once
        if before is not None and passed in (before - 1, before):
            return
        self._passed = passed
        if before is not None and passed < before:
            return
        by_s = line["home_by_s"]
        if by_s is None:
            self.show("home is out of reach with the reserve", WARNING)
            return
        at = time.localtime(self._clock_s() + by_s - line["time_s"])
        severity = WARNING if left_min < FEW_MIN else NOTICE
        self.show(f"{math.floor(left_min)} min left, home by {time.strftime('%H:%M', at)}", severity)

    def show(self, what: str, severity: int) -> None:
        """Show a text, in pieces where it is long."""
        text = _ascii(f"eadp: {what}")[:MAX_TEXT].encode()
        if len(text) <= TEXT_CHARACTERS:
            self._give("STATUSTEXT", {"severity": severity, "text": text})
            return
        self._texts = self._texts % 65_535 + 1
        # the last piece is shorter than `TEXT_CHARACTERS`, if need be empty: that marks the end of the text
        for number, start in enumerate(range(0, len(text) + 1, TEXT_CHARACTERS)):
            piece = {"text": text[start : start + TEXT_CHARACTERS], "id": self._texts, "chunk_seq": number}
            self._give("STATUSTEXT", {"severity": severity, **piece})

    def _new_path(self, line: Mapping[str, Any]) -> str:
        """Take the path parameters of a decision; return those that have changed, as a text, empty where none has."""
        parameters = self._plan.parameters[: self._plan.path_count]
        before, self._path = self._path, tuple([line["parameters"][each.name] for each in parameters])
        new = zip(parameters, before, self._path, strict=True)
        return ", ".join(f"{each.label} now {each.text(now)}" for each, was, now in new if now != was)


def _left_min(line: Mapping[str, Any]) -> float | None:
    """Minutes for which the way home can wait, by a decision; None where that is unknown."""
    until_s = line["point_of_no_return_s"]
    return None if until_s is None else max(0.0, (until_s - line["time_s"]) / 60)


def _ascii(text: str) -> str:
    """A text in ASCII, as MAVLink's texts are."""
    return text.replace("→", "->").replace("−", "-").encode("ascii", "replace").decode()

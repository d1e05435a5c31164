"""The autopilot at the other end of a link: who it is, whether it is heard, what it is asked and commanded."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.api.replan.pilot import Pilot
from eadp.errors import printable
from eadp.io.link.mavlink import COMPONENT, Message
from eadp.io.link.messages import is_autopilot
from eadp.models.plan.stage import RETURN

HEARTBEAT_S, LOST_S = 1.0, 5.0
"""How often to send a heartbeat, and the time without one after which the autopilot's are lost [s]."""

BEAT = {"type": 18, "autopilot": 8, "base_mode": 0, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
"""The heartbeat of a computer on board, which is no autopilot."""

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

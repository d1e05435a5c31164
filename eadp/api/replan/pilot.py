"""What a pilot reads: decisions and texts at the ground station, and warnings, of each thing once."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from eadp.api.replan.replanner import Warn
from eadp.errors import Fault
from eadp.models.plan.plan import Plan
from eadp.planning.base import INFEASIBLE
from eadp.planning.state.flight_state import CELL_LOST
from eadp.planning.track.live import COMPLETED, KEPT, TAKE_OFF

NOTICE, WARNING, CRITICAL = 5, 4, 2
"""MAVLink's severities of texts."""
TEXT_CHARACTERS, NAME_CHARACTERS, MAX_TEXT = 50, 10, 200
"""Characters of a piece of a text, of a name, and of a text at most."""

MARKS_MIN = (60, 45, 30, 20, 15, 10, 5, 3, 2, 1)
"""Minutes left for the way home at which the pilot reads how many there are; at `FEW_MIN` and fewer as a warning."""
FEW_MIN = 5
FEASIBLE_S = 10.0
"""For how long a plan is feasible again before the pilot reads it [s]."""

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
        self._infeasible_s: float | None = None  # when a plan was infeasible that is not known to be feasible again [s]
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
        parameters are not sent either. That a plan is feasible again is a text once it has been so for `FEASIBLE_S`.
        """
        boot_ms = max(0, round(line["time_s"] * 1000)) % 2**32
        parameters, left_min = () if returns else self._plan.parameters, _left_min(line)
        shown: dict[str, float | None] = {p.label: p.shown(line["parameters"][p.name]) for p in parameters}
        shown |= {"soc_end": line["soc_end_forecast"], "p_done": line["completes_probability"], "min_left": left_min}
        for name, value in shown.items():
            if value is not None:
                fields = {"time_boot_ms": boot_ms, "name": _ascii(name)[:NAME_CHARACTERS].encode(), "value": value}
                self._give("NAMED_VALUE_FLOAT", fields)
        # a reason of which only numbers change is sent once; new path parameters are always sent, before the reason
        # where it does not start with their name
        about = repr(line["parameters"]) + _NUMBERS.sub("", line["reason"])
        path = self._new_path(line)
        if INFEASIBLE in line["reason"]:
            self._infeasible_s = line["time_s"]
        elif self._infeasible_s is not None and flown and line["time_s"] - self._infeasible_s > FEASIBLE_S:
            self._infeasible_s, self._about = None, ""
            self.show("the plan is feasible again", NOTICE)
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

"""An autopilot's parameters, read once beside a flight: which of them disagree with the forecast."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from eadp.io.mission.autopilot import INT32, AutopilotParameter

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

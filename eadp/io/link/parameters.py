"""An autopilot's parameters, read once beside a flight: which of them disagree with the forecast."""

from __future__ import annotations

from collections.abc import Sequence

from eadp.io.mission.autopilot import AutopilotParameter

ASKED = 3
"""How often a name is asked for; then its name in older versions is, as often."""


class ParameterCheck:
    """Asks for parameters until they have come, or do not.

    Parameters
    ----------
    wanted : sequence of AutopilotParameter
    """

    def __init__(self, wanted: Sequence[AutopilotParameter]) -> None:
        self._left = list(wanted)  # parameters that have not come
        self._differences = list[str]()  # of each that has come, how it disagrees, empty where it does not
        self._rounds = 0  # how often names were asked for

    def take(self, name: str, value: float) -> None:
        """Compare a parameter that has come, if it is one of those wanted."""
        for each in [each for each in self._left if name in (each.name, each.older)]:
            self._left.remove(each)
            self._differences.append(each.difference(name, value))

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

"""An autopilot's parameters, read once beside a flight: which of them disagree with the forecast."""

from __future__ import annotations

from collections.abc import Sequence

from eadp.io.mission.autopilot import AutopilotParameter

ASKED = 3
"""How often a name is asked for; then that of older versions is."""


class ParameterCheck:
    """Asks for parameters until they have come, or do not.

    Parameters
    ----------
    wanted : sequence of AutopilotParameter
    """

    def __init__(self, wanted: Sequence[AutopilotParameter]) -> None:
        # those that have not come; what of the others disagrees; how often names were asked for
        self._left, self._differences, self._rounds = list(wanted), list[str](), 0

    def take(self, name: str, value: float) -> None:
        """Compare a parameter that has come, if it is one of those wanted."""
        for each in [each for each in self._left if name in (each.name, each.older)]:
            self._left.remove(each)
            self._differences.append(each.difference(name, value))

    def names(self) -> list[str]:
        """The names to ask for now: `ASKED` times each name that has not come, then as often its older one, if any."""
        self._rounds += 1
        if self._rounds <= ASKED:
            return [each.name for each in self._left]
        return [each.older for each in self._left if each.older] if self._rounds <= 2 * ASKED else []

    def result(self) -> str:
        """What disagrees, once all has come that comes; empty before, and after it was given."""
        if self._left and self._rounds <= 2 * ASKED:
            return ""
        text, self._differences = "; ".join(filter(None, self._differences)), []
        return text

"""Which of the parameters decided are in force on an aircraft that reports its own."""

from __future__ import annotations

import math
from collections.abc import Mapping

from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan

APPLY_S, SAME_SHARE = 10.0, 0.01
"""Time in which the aircraft applies a parameter [s]; and by how much a value may be off, as a share of its set."""

APART_S = 3.0
"""By how much the aircraft may start a stage before positions show it, or after [s]."""


class AppliedParameters:
    """Which of the parameters decided the aircraft applies, by those that it reports to be in force.

    A parameter that should have changed `APPLY_S` before, and is still reported as it was, is held: it keeps that value
    until another value of it is reported, or one is on its way.

    Parameters
    ----------
    parameters : tuple of float
        Decided at take-off.
    plan : Plan

    Attributes
    ----------
    asked : tuple of float
        Parameters to fly with; of those that are held, the values decided before.
    held : dict of int to float
        Parameters that are held, by index, and the values reported.
    """

    def __init__(self, parameters: Vector, plan: Plan) -> None:
        self.asked = parameters
        self.held: dict[int, float] = {}
        boxes = [plan.hull(i) for i in range(len(parameters))] if plan.has_sets else []
        self._tolerances = [SAME_SHARE * (box.hi - box.lo) for box in boxes] or [0.0] * len(parameters)
        self._reported: dict[int, float] = {}
        self._before: dict[int, float] = {}
        """The value that was reported of a parameter when another value of it was decided."""
        self._refused_s: dict[int, float] = {}
        """Since when a parameter that should have changed is reported as it was [s]."""
        self._ahead_s: dict[int, float] = {}
        """Since when a parameter is reported as decided, though by the plan's rules it is not in force yet [s]."""
        self._expected = parameters
        self._left: dict[int, tuple[float, float]] = {}
        """Of each parameter: the value in force before its last change by the plan's rules, and that time [s]."""

    @property
    def effective(self) -> Vector:
        """The parameters that will be in force."""
        return tuple([self.held.get(i, value) for i, value in enumerate(self.asked)])

    def decide(self, parameters: Vector) -> None:
        """Set `asked` to the parameters decided, but for those that are held; keep what is reported of each changed."""
        asked = list(self.asked)
        for i, value in enumerate(parameters):
            if i not in self.held and value != asked[i]:
                asked[i] = value
                if i in self._reported:
                    self._before[i] = self._reported[i]
        self.asked = tuple(asked)

    def release(self, i: int) -> bool:
        """Hold a parameter no longer, since a value of it is on its way to the aircraft; return whether it was held."""
        self._refused_s.pop(i, None)
        return self.held.pop(i, None) is not None

    def update(self, time_s: float, reported: Mapping[int, float], expected: Vector) -> bool:
        """Update `held` with the parameters reported, by index; return whether it has changed.

        `expected` are the parameters in force by the plan's rules.
        """
        self._reported |= reported
        held_before = dict(self.held)
        for i, value in reported.items():
            if i in self.held:
                if not self._same(i, value, self.held[i]):
                    del self.held[i], self._before[i]
                continue
            # it refuses a value while it is reported as before the decision, and neither as asked nor as expected
            unchanged = i in self._before and self._same(i, value, self._before[i])
            if not unchanged or self._same(i, value, self.asked[i]):
                self._refused_s.pop(i, None)
            elif not self._same(i, value, expected[i]):  # else it waits for its stage
                self._refused_s.setdefault(i, time_s)
            if time_s - self._refused_s.get(i, math.inf) >= APPLY_S:
                self.held[i] = value
                del self._refused_s[i]
        return held_before != self.held

    def update_apart(self, time_s: float, reported: Mapping[int, float], expected: Vector) -> list[int]:
        """Indices of reported parameters that differ from `expected`, but have done so for less than `APART_S`.

        `expected` are the parameters in force by the plan's rules. The aircraft may start a stage a little sooner, and
        report what is decided; or later, and report what was in force before. Such a report is no refusal.
        """
        for i, value in enumerate(expected):
            if value != self._expected[i]:
                self._left[i] = self._expected[i], time_s
        self._expected = expected
        differ = {i: value for i, value in reported.items() if not self._same(i, value, expected[i])}
        # sooner: reported as decided, since the first such report; later: as before the last change, since that change
        ahead = [i for i, value in differ.items() if self._same(i, value, self.asked[i])]
        self._ahead_s = {i: self._ahead_s.get(i, time_s) for i in ahead}
        behind_s = {i: since_s for i, (value, since_s) in self._left.items() if i in differ and differ[i] == value}
        return [i for i, since_s in (self._ahead_s | behind_s).items() if time_s - since_s < APART_S]

    def _same(self, i: int, one: float, other: float) -> bool:
        """Whether two values of a parameter are the same within its tolerance."""
        return abs(one - other) <= self._tolerances[i]

"""Segments of a plan: stages flown once, or lap by lap with loop variables that change from lap to lap.

The letter's plans are laps of primitive stages moved by one shift (Def. II.5). A field with slanted ends needs laps
whose length changes too, and a whole mission has stages before its laps and after them. A plan may therefore have
several segments, one after the other, and the laps of a segment may be written in loop variables of their own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from eadp.core.expressions.tree import Expression, substituted

State = tuple[float, ...]
"""The values, in this lap, of a segment's loop variables that change from lap to lap."""

MAX_KEPT = 10_000
"""Most laps whose values a segment keeps."""


@dataclass(frozen=True, slots=True)
class LoopVariable:
    """A named number of a segment: a first value and an increment for each lap; without `shift`, a formula.

    Formulas may name parameters, variables that change from lap to lap and formulas above them; a first value, only
    parameters; a shift, all of them.
    """

    name: str
    first: Expression
    shift: Expression | None = None


@dataclass(frozen=True)
class Segment:
    """Stages `first` (from 0) to `first + count`, flown once, or lap by lap until `until` holds.

    `until` is (a, b) for a ≥ b; it is evaluated before every lap, the first included.
    """

    first: int
    count: int
    variables: tuple[LoopVariable, ...] = ()
    until: tuple[Expression, Expression] | None = None

    @property
    def repeats(self) -> bool:
        """Whether the segment is flown lap by lap."""
        return self.until is not None

    def dependent(self, name: str) -> set[str]:
        """A parameter, and the loop variables whose formula depends on it, through formulas of formulas."""
        found = {name}
        for q in self.variables:
            if q.shift is None and q.first.names & found:
                found.add(q.name)
        return found

    def start(self, parameters: Sequence[float]) -> State:
        """The state of the first lap.

        Raises
        ------
        PathUndefined
            If a first value is no finite real number; so do the other methods for what they evaluate.
        """
        values = _named(parameters)
        return tuple([q.first.value(values) for q in self.variables if q.shift is not None])

    def values(self, parameters: Sequence[float], state: State) -> Mapping[str, float]:
        """Every loop variable's value in a lap."""
        if not self.variables:
            return {}
        known = self._known(parameters, state)
        return {q.name: known[q.name] for q in self.variables}

    def next(self, parameters: Sequence[float], state: State) -> State:
        """The state of the next lap."""
        known = self._known(parameters, state)
        changing = [q for q in self.variables if q.shift is not None]
        return tuple([value + q.shift.value(known) for q, value in zip(changing, state, strict=True) if q.shift])

    def over(self, parameters: Sequence[float], state: State) -> bool:
        """Whether no further lap is to be flown."""
        if self.until is None:
            return True
        known = self._known(parameters, state)
        return self.until[0].value(known) >= self.until[1].value(known)

    def left(self, parameters: Sequence[float], state: State) -> float:
        """How far the end of a repeated segment is at a state: b − a, 0 or less where no further lap is flown."""
        assert self.until is not None
        known = self._known(parameters, state)
        return self.until[1].value(known) - self.until[0].value(known)

    def first_lap(self) -> dict[str, Expression]:
        """Every loop variable in the first lap, in parameters alone.

        Raises
        ------
        ExpressionError
            If formulas of formulas grow too large.
        """
        return self.formulas({q.name: q.first for q in self.variables if q.shift is not None})

    def formulas(self, known: Mapping[str, Expression]) -> dict[str, Expression]:
        """`known`, and every formula with what is known and the formulas above it substituted.

        Raises
        ------
        ExpressionError
            If formulas of formulas grow too large.
        """
        known = dict(known)
        for q in self.variables:
            if q.shift is None:
                known[q.name] = substituted(q.first, known) if known else q.first
        return known

    def _known(self, parameters: Sequence[float], state: State) -> dict[str, float]:
        """Every name's value: parameters, then what changes from lap to lap, then formulas in their order."""
        key = (tuple(parameters), state)
        if key in self._values:
            return self._values[key]
        known = _named(parameters)
        changing = [q.name for q in self.variables if q.shift is not None]
        known.update(zip(changing, state, strict=True))
        for q in self.variables:
            if q.shift is None:
                known[q.name] = q.first.value(known)
        if len(self._values) >= MAX_KEPT:
            self._values.clear()
        self._values[key] = known
        return known

    @cached_property
    def _values(self) -> dict[tuple[tuple[float, ...], State], dict[str, float]]:
        """Values by parameters and state: each lap asks for the same ones several times, and so do similar routes."""
        return {}


def _named(parameters: Sequence[float]) -> dict[str, float]:
    return {f"c{i + 1}": value for i, value in enumerate(parameters)}

"""The way through a plan of parts, stage by stage: which comes next, and which parameters are in force there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.models.plan.plan import COMPUTATION, Plan, Stage
from eadp.models.plan.segments import Segment, State

LAP_LIMIT = 10_000
Vector = tuple[float, ...]


@dataclass(frozen=True, slots=True)
class StageVisit:
    """A stage as it is flown in some lap: with the parameters in force at its start and the state of its part."""

    stage: Stage
    parameters: Vector
    state: State
    lap: int

    def path(self) -> PathFunction:
        """The stage's path function here; raises PathUndefined as `Stage.path_at`."""
        return self.stage.path_at(self.parameters, self.state)

    def trigger_m(self) -> Point:
        """The stage's trigger here [m]; raises PathUndefined as `Stage.trigger_at`."""
        return self.stage.trigger_at(self.parameters, self.state)


class PlanCursor:
    """A walk through a plan of parts.

    A new computation takes effect at once. A new path parameter waits, in a part flown lap by lap, for the stage before
    the first one whose path or whose laps depend on it; in a part flown once, for the next stage; and for the begin of
    the next part.

    Attributes
    ----------
    place : Place
        Where the walk is.
    done : bool
        Whether the last stage has been left.
    """

    def __init__(self, plan: Plan, parameters: Sequence[float]) -> None:
        self._plan = plan
        self._latches = [_latches(plan, part) for part in plan.parts]
        self._decided: Vector = tuple(parameters)
        self._waiting: Vector = tuple(parameters)
        self._part = -1
        self._laps = 0
        self.done = False
        self.place: StageVisit
        self._enter_part()

    def decide(self, parameters: Sequence[float]) -> None:
        """Take new parameters; computations change at once."""
        self._decided = tuple(parameters)
        self._waiting = tuple(
            new if parameter.kind == COMPUTATION else old
            for new, old, parameter in zip(self._decided, self._waiting, self._plan.parameters, strict=True)
        )
        place = self.place
        self.place = StageVisit(place.stage, self._clipped(place.stage), place.state, place.lap)

    def believe(self, parameters: Sequence[float]) -> None:
        """Take parameters that are known to be in force, whatever was decided."""
        self._waiting = tuple(parameters)
        place = self.place
        self.place = StageVisit(place.stage, self._clipped(place.stage), place.state, place.lap)

    def next(self) -> None:
        """Go on to the next stage, or be done.

        Raises
        ------
        PathUndefined
            If the next lap's quantities have no value, or a part does not end within 10,000 laps.
        """
        part, place = self._plan.parts[self._part], self.place
        if place.stage.index < part.first + part.count:
            self._enter(place.stage.index, place.state)
            return
        if not part.repeats:
            self._enter_part()
            return
        state = part.next(place.parameters, place.state)
        self._laps += 1
        if self._laps > LAP_LIMIT:
            raise PathUndefined(f"the plan does not come to the end of a part within {LAP_LIMIT} laps")
        if part.over(place.parameters, state):
            self._enter_part()
        else:
            self._enter(part.first, state)

    def _enter_part(self) -> None:
        """The first stage of the next part that has any lap to fly."""
        parts = self._plan.parts
        self._waiting = self._decided
        self._part += 1
        self._laps = 0
        while self._part < len(parts):
            part = parts[self._part]
            values = self._clipped(self._plan.stages[part.first])
            state = part.begin(values)
            if not part.repeats or not part.over(values, state):
                self._enter(part.first, state)
                return
            self._part += 1
        self.done = True

    def _enter(self, index: int, state: State) -> None:
        latches = self._latches[self._part]
        stage = self._plan.stages[index]
        self._waiting = tuple(
            new if latch in (index, None) else old
            for new, old, latch in zip(self._decided, self._waiting, latches, strict=True)
        )
        self.place = StageVisit(stage, self._clipped(stage), state, self._laps)

    def _clipped(self, stage: Stage) -> Vector:
        if not stage.sets:
            return self._waiting
        return tuple(box.clip(value) for box, value in zip(stage.sets, self._waiting, strict=True))


def _latches(plan: Plan, part: Segment) -> list[int | None]:
    """For each parameter the stage (from 0) of a part at whose start it takes effect; None for at every start."""
    stages = plan.stages[part.first : part.first + part.count]
    latches: list[int | None] = []
    for parameter in plan.parameters:
        if parameter.kind == COMPUTATION or not part.repeats:
            latches.append(None)
            continue
        # names of quantities that depend on the parameter, through formulas of formulas
        dependent = {parameter.name}
        for quantity in part.quantities:
            if quantity.shift is None and quantity.first.names & dependent:
                dependent.add(quantity.name)
        bent = next((stage.index - 1 for stage in stages if stage.path.names & dependent), part.first)
        latches.append(part.first + (bent - part.first - 1) % part.count)
    return latches

"""Places: path parameters as shares of their sets; and the route that is left at each."""

from __future__ import annotations

from collections.abc import Collection

from eadp.errors import PathUndefined
from eadp.models.plan.cursor import Vector
from eadp.models.plan.route import Route, RoutePredictor
from eadp.planning.forecast.evaluate import Evaluation, Evaluator
from eadp.planning.forecast.held import margin_m
from eadp.planning.joint.search import Shares
from eadp.planning.state.known import Known

SAME_SHARE = 1e-5
"""Change of a path parameter, as a share of its set, that counts as none."""


class Places:
    """The places of one mission: a place is a choice of its free path parameters, as shares of their sets, 0 to 1.

    Parameters
    ----------
    evaluator : Evaluator
    decided : tuple of float
        Parameters decided.
    held : collection of int
        Indices of path parameters that stay as they are.

    Attributes
    ----------
    open : list of int
        Indices of the free path parameters.
    decided : tuple of float
        Parameters decided.
    shares : tuple of float
        The place decided.
    """

    def __init__(self, evaluator: Evaluator, decided: Vector, held: Collection[int] = ()) -> None:
        self.evaluator, plan = evaluator, evaluator.mission.plan
        # of each path parameter, from the lowest to the highest value of its sets
        self._boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
        self.open = [i for i, box in enumerate(self._boxes) if not box.fixed and i not in held]
        self.decided = decided
        self.shares: Shares = tuple([self._boxes[i].share(decided[i]) or 0.0 for i in self.open])
        self._predictor = RoutePredictor()
        self._routes: dict[Shares, Route | None] = {}
        self._stage: tuple[object, ...] = ()
        """What `_routes` depend on: the stage, its path parameters, and whether the end of the plan is uncertain."""

    def enter(self, known: Known) -> None:
        """Begin a re-planning: forget the routes kept unless they start from the stage and parameters of now."""
        cursor = known.cursor
        path = len(self._boxes)
        stage = known.stages_started, cursor.waiting[:path], cursor.parameters[:path], known.reach_std_m > 0
        if stage != self._stage:
            self._stage = stage
            self._routes.clear()

    def parameters(self, shares: Shares) -> Vector:
        """The parameters at a place: the free path parameters at shares of their sets, and all others as decided."""
        if shares == self.shares:  # as decided to the last digit
            return self.decided
        values = list(self.decided)
        for i, share in zip(self.open, shares, strict=True):
            box = self._boxes[i]
            value = box.lo + share * (box.hi - box.lo)
            if abs(value - values[i]) > SAME_SHARE * (box.hi - box.lo):  # else a rounding, which is no change
                values[i] = value
        return tuple(values)

    def route(self, known: Known, shares: Shares) -> Route | None:
        """The route that is left at a place; None where its path is undefined, or nothing is left to fly."""
        if shares not in self._routes:
            cursor = known.cursor.decide(self.parameters(shares))
            try:
                route = self._predictor.route(cursor, known.joined_m, margin_m(known))
                self._routes[shares] = route if len(route.order) else None
            except PathUndefined:
                self._routes[shares] = None
        return self._routes[shares]

    def evaluate(self, known: Known, places: list[Shares]) -> tuple[list[Shares], Evaluation | None]:
        """Evaluate places together; return those that can be flown, and their evaluation in this order.

        An empty list and None where none can be flown.
        """
        routes = [(shares, route) for shares in places if (route := self.route(known, shares)) is not None]
        if not routes:
            return [], None
        try:
            evaluation = self.evaluator.evaluate(known, [route for _, route in routes])
        except PathUndefined:
            return [], None
        return [routes[i][0] for i in evaluation.index.tolist()], evaluation

    def decide(self, shares: Shares, parameters: Vector) -> None:
        """Note the place and the parameters that the planner has decided."""
        self.shares, self.decided = shares, parameters

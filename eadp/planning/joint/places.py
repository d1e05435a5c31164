"""Path parameters as shares of their sets, and the routes that are left at them."""

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
    """The places of one mission.

    Where a plan has one free path parameter and several segments of laps are left, a place has two shares of it: for
    the first segment and for those after it.

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
        self._boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
        self.open = [i for i, box in enumerate(self._boxes) if not box.fixed and i not in held]
        self.decided = decided
        self.shares: Shares = tuple([self._boxes[i].share(decided[i]) or 0.0 for i in self.open])
        self._predictor = RoutePredictor()
        self._routes: dict[Shares, Route | None] = {}
        self._stage: tuple[object, ...] = ()

    def enter(self, known: Known) -> None:
        """Go on from a stage: the routes known are those from its start."""
        cursor = known.cursor
        stage = known.stages_started, cursor.waiting[: len(self._boxes)], cursor.parameters[: len(self._boxes)]
        if stage != self._stage:
            self._stage = stage
            self._routes.clear()
        several = len(self.open) == 1 and known.cursor.later_laps
        if several != (len(self.shares) == 2 * len(self.open)):
            self.shares = self.shares[: len(self.open)] * (2 if several else 1)
            self._routes.clear()

    def parameters(self, shares: Shares) -> Vector:
        """Parameters with the path's at shares of their sets, and the computations as decided."""
        if shares[: len(self.open)] == self.shares[: len(self.open)]:  # exact, not rounded
            return self.decided
        return self._with_path(shares[: len(self.open)])

    def later(self, shares: Shares) -> Vector | None:
        """Parameters of the segments of laps after the first; None where they are those of the first."""
        count = len(self.open)
        return self._with_path(shares[count:]) if shares[count:] not in ((), shares[:count]) else None

    def _with_path(self, shares: Shares) -> Vector:
        values = list(self.decided)
        for i, share in zip(self.open, shares, strict=True):
            box = self._boxes[i]
            value = box.lo + share * (box.hi - box.lo)
            values[i] = value if abs(value - values[i]) > SAME_SHARE * (box.hi - box.lo) else values[i]
        return tuple(values)

    def route(self, known: Known, shares: Shares) -> Route | None:
        """The route at a place; None where it has no path."""
        if shares not in self._routes:
            cursor = known.cursor.decide(self.parameters(shares))
            try:
                route = self._predictor.route(cursor, known.joined_m, margin_m(known), self.later(shares))
                self._routes[shares] = route if len(route.order) else None
            except PathUndefined:
                self._routes[shares] = None
        return self._routes[shares]

    def evaluate(self, known: Known, places: list[Shares]) -> tuple[list[Shares], Evaluation | None]:
        """Evaluate places; returns those that can be flown, and their evaluation."""
        routes = [(shares, route) for shares in places if (route := self.route(known, shares)) is not None]
        if not routes:
            return [], None
        try:
            found = self.evaluator.evaluate(known, [route for _, route in routes])
        except PathUndefined:
            return [], None
        return [routes[i][0] for i in found.index.tolist()], found

    def settled(self, known: Known, shares: Shares) -> Shares:
        """The same place, or that of the later segments alone where the first share alters nothing from now on."""
        later = shares[len(self.open) :]
        if not later or later == shares[: len(self.open)]:
            return shares
        here, there = self.route(known, shares), self.route(known, later * 2)
        same = here is not None and there is not None and here.parameters == there.parameters
        return later * 2 if same else shares

    def decide(self, shares: Shares, parameters: Vector) -> None:
        """Set the place and the parameters decided."""
        self.shares, self.decided = shares, parameters

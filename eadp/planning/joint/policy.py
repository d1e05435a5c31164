"""When to change what: the hysteresis between a plan that is optimal now and the parameters that are flown.

A pilot changes little. Path parameters change for a least gain, which grows with each change. Computations fall when
the plan needs it, stay down for a while, and rise when they can stay up.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import Vector
from eadp.models.plan.route import Route, RoutePredictor
from eadp.planning.forecast.evaluate import Evaluation, Evaluator
from eadp.planning.forecast.speed_to_fly import SpeedChoice
from eadp.planning.joint.program import Solution
from eadp.planning.joint.search import Shares
from eadp.planning.state.known import Known

SETTLED_S = 60.0
"""Computations do not rise again for this long after a fall. Of the two configurations around the sustained power, the
upper one is flown first, and the lower one for the rest: it rises to the upper one if that can be flown for as long
[s]."""

EARLY_S, NO_TIME_S = 30.0, 1e-3
"""Time from take-off in which computations do not fall for the margin alone: the deviation of the forecast halves in
it; and a time that is rounding [s]."""

LEAST_CHANGE_MPS = 1.0
"""Least rise of the pace, and least change of a stage's airspeed at the pace in force [m/s]."""


class Policy:
    """The hysteresis of one flight.

    Attributes
    ----------
    path_changes : int
        Changes of path parameters so far.
    fell_s, slowed_s : float
        When computations fell last, and the airspeed [s].
    awaits_s : float
        When to search anew, while the flight is slow for a path in reach, or short of charge [s].
    """

    def __init__(self, min_gain: float) -> None:
        self._min_gain = min_gain
        self.path_changes = 0
        self.fell_s = self.slowed_s = -SETTLED_S
        self.awaits_s = math.inf

    @property
    def path_gain(self) -> float:
        """Least gain of the objective for which a path parameter changes; each change before adds half of it."""
        return self._min_gain * (1 + self.path_changes / 2)

    def pace(self, time_s: float, now_mps: float | None, good_mps: Sequence[float]) -> float:
        """The pace to fly [m/s] of those that are as good, the fastest first; asking changes nothing.

        That in force, `now_mps`, where it is among them and the fastest is little more, or it fell not long ago.
        """
        fastest_mps = good_mps[0]
        if now_mps is None or now_mps not in good_mps:
            return fastest_mps
        waits = fastest_mps - now_mps < LEAST_CHANGE_MPS or time_s - self.slowed_s < SETTLED_S
        return now_mps if waits else fastest_mps

    def computations(
        self, time_s: float, now_w: float, evaluation: Evaluation, solution: Solution
    ) -> tuple[Vector, float]:
        """The computations to fly with now, and for how long [s], infinite for to the end; asking changes nothing.

        One of the two configurations around the power that can be sustained to the end, or the configuration in force
        where a rise or a fall has to wait; see `SETTLED_S` and `EARLY_S`.

        Parameters
        ----------
        time_s : float
            Time of the flight [s].
        now_w : float
            Power of the computations in force [W].
        evaluation : Evaluation
            Of one place.
        solution : Solution
        """
        kind = int(evaluation.kinds[0])
        envelope = evaluation.evaluator.envelopes[kind]
        powers_w = envelope.powers_w
        # numbers of the envelope's vertices, from 0: `held` is in force; the sustained power lies between `below` and
        # the next one
        held = _at_or_below(powers_w, now_w)
        chosen, lasts_s = 0, math.inf  # of an infeasible plan: minimum power
        if solution.feasible:
            below, share = _vertex(powers_w, sustained_w(evaluation, kind, solution))
            # the upper one can be flown for this share of the time left, then the lower one
            if share < 1:
                lasts_s = share * float(evaluation.totals.seconds[0])
            # the highest vertex to rise to, and the highest to stay at: none is flown for a moment only
            rises_to = below + 1 if lasts_s > SETTLED_S else below
            stays_to = below + 1 if lasts_s > NO_TIME_S else below
            chosen = below
            if rises_to > held:
                waits = time_s - self.fell_s < SETTLED_S
                chosen = held if waits else rises_to
            elif held <= stays_to:
                chosen = held
            # the lower one lasts to the end
            lasts_s = lasts_s if chosen > below else math.inf
        if chosen < held and time_s < EARLY_S:
            expected_soc = evaluation.final_charge(solution.filling).mean
            if expected_soc >= evaluation.evaluator.objective.reserve_soc:
                chosen, lasts_s = held, EARLY_S - time_s
        return tuple(envelope.configurations[chosen].tolist()), lasts_s


def _at_or_below(powers_w: FloatArray, target_w: float) -> int:
    """Number of the vertex at or below a power [W], from 0; of the first where none is."""
    return max(int(np.searchsorted(powers_w, target_w + 1e-9, side="right")) - 1, 0)


def _vertex(powers_w: FloatArray, target_w: float) -> tuple[int, float]:
    """Number of the vertex at or below a power [W], from 0, and the power's share of the way to the next vertex.

    Where the power is at the last vertex or above, the last vertex but one, with a share of 1 or more.
    """
    if len(powers_w) == 1:
        return 0, 0.0
    below = min(_at_or_below(powers_w, target_w), len(powers_w) - 2)
    return below, float((target_w - powers_w[below]) / (powers_w[below + 1] - powers_w[below]))


def sustained_w(evaluation: Evaluation, kind: int, solution: Solution) -> float:
    """Mean power of the computations over the legs of a kind, as the solution allocates it [W].

    Held constant, it uses as much charge as the solution's mix over time, and the charge that is left over.
    """
    envelope = evaluation.evaluator.envelopes[kind]
    mine, steps = evaluation.kinds == kind, len(envelope.powers_w) - 1
    use, shares = evaluation.knapsack.use[mine, :steps], solution.filling.shares[mine, :steps]
    # of each increment, summed over the legs: the share of its charge that is taken
    whole = use.sum(axis=0)
    taken = (use * shares).sum(axis=0)
    mix = np.divide(taken, whole, out=np.zeros(steps), where=whole > 0)
    power_w = float(envelope.powers_w[0] + mix @ np.diff(envelope.powers_w))
    # charge left over, and the charge that a watt more takes to the end
    left_over = evaluation.left_over(solution.filling)
    soc_per_w = float(evaluation.totals.soc_per_j[0] * evaluation.totals.seconds[0])
    return power_w + max(left_over, 0.0) / max(soc_per_w, 1e-12)


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
    pace_mps, thriftiest_mps : float or None
        The pace decided, see `eadp.planning.forecast.speed_to_fly`, and the one that leaves the most charge [m/s]; None
        where the airspeed is not decided.
    airspeeds_mps : tuple of float
        Those of the stages at it [m/s].
    """

    def __init__(self, evaluator: Evaluator, decided: Vector, held: Collection[int] = ()) -> None:
        self.evaluator, plan = evaluator, evaluator.mission.plan
        # of each path parameter, from the lowest to the highest value of its sets
        self._boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
        self.open = [i for i, box in enumerate(self._boxes) if not box.fixed and i not in held]
        self.decided = decided
        self.shares: Shares = tuple([self._boxes[i].share(decided[i]) or 0.0 for i in self.open])
        self.pace_mps: float | None = None
        self.thriftiest_mps: float | None = None
        self.airspeeds_mps: Vector = ()
        self._choice: tuple[Known, Route, SpeedChoice] | None = None  # of a moment and a route, see `_speed_choice`
        self._predictor = RoutePredictor()
        self._routes: dict[Shares, Route | None] = {}
        self._airspeeds: dict[tuple[tuple[Shares, ...], float], FloatArray] = {}  # see `_airspeeds_mps`
        self._kept_for: tuple[object, ...] = ()
        """What both are kept for: the stage, its path parameters, the margin at its end, the autopilot."""

    def enter(self, known: Known) -> None:
        """Begin a re-planning: forget the routes kept unless they start from the stage and parameters of now."""
        cursor = known.cursor
        path = len(self._boxes)
        path_now = cursor.waiting[:path], cursor.parameters[:path]
        here = known.joined.stages_started, path_now, known.margin_m, known.autopilot
        if here != self._kept_for:
            self._kept_for = here
            self._routes.clear()
            self._airspeeds.clear()

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
                route = self._predictor.route(cursor, known.joined.position_m, known.margin_m)
                self._routes[shares] = route if len(route.order) else None
            except PathUndefined:
                self._routes[shares] = None
        return self._routes[shares]

    def evaluate(
        self, known: Known, places: list[Shares], pace_mps: float | None = None
    ) -> tuple[list[Shares], Evaluation | None]:
        """Evaluate places together, at a pace [m/s]; return those that can be flown, and their evaluation in order.

        An empty list and None where none can be flown.
        """
        routes = [(shares, route) for shares in places if (route := self.route(known, shares)) is not None]
        if not routes:
            return [], None
        try:
            airspeeds_mps = None if pace_mps is None else self._airspeeds_mps(known, routes, pace_mps)
            evaluation = self.evaluator.evaluate(known, [route for _, route in routes], airspeeds_mps)
        except PathUndefined:
            return [], None
        return [routes[i][0] for i in evaluation.index.tolist()], evaluation

    def _airspeeds_mps(self, known: Known, routes: list[tuple[Shares, Route]], pace_mps: float) -> FloatArray:
        """The airspeed of each stage on the routes of places at a pace, shape (routes, stages) [m/s].

        Those of one place are kept for the stage. At the pace decided, those in force stay where they differ by little:
        the estimate of the wind varies.
        """
        key = tuple(shares for shares, _ in routes), pace_mps
        if key in self._airspeeds:
            return self._airspeeds[key]
        found = self._speed_choice(known, [route for _, route in routes]).at_pace(pace_mps)
        if pace_mps == self.pace_mps and self.airspeeds_mps:
            kept = np.array(self.airspeeds_mps)
            found = np.where(np.abs(found - kept) < LEAST_CHANGE_MPS, kept, found)
        if len(routes) == 1:
            self._airspeeds[key] = found
        return found

    def _speed_choice(self, known: Known, routes: list[Route]) -> SpeedChoice:
        """As `Evaluator.speed_choice`; that of one route is kept for a re-planning."""
        if len(routes) > 1:
            return self.evaluator.speed_choice(known, routes)
        if self._choice is None or self._choice[0] is not known or self._choice[1] is not routes[0]:
            self._choice = known, routes[0], self.evaluator.speed_choice(known, routes)
        return self._choice[2]

    def paces(self, known: Known, shares: Shares) -> tuple[list[float], Evaluation | None]:
        """The paces that there are at a place, the fastest first [m/s], and their evaluation; None if none is flown."""
        route = self.route(known, shares)
        if route is None:
            return [], None
        choice = self._speed_choice(known, [route])
        paces, airspeeds_mps = choice.paces_mps, np.concatenate([*map(choice.airspeeds_mps, choice.values_w)])
        try:
            evaluation = self.evaluator.evaluate(known, [route] * len(paces), airspeeds_mps)
        except PathUndefined:
            return [], None
        return [paces[i] for i in evaluation.index.tolist()], evaluation

    def decide(
        self, shares: Shares, parameters: Vector, paces_mps: tuple[float | None, float | None], airspeeds_mps: Vector
    ) -> None:
        """Note the place, the parameters, the paces and the airspeeds that the planner has decided."""
        self.shares, self.decided = shares, parameters
        self.pace_mps, self.thriftiest_mps = paces_mps
        if airspeeds_mps != self.airspeeds_mps:  # else the same object, which changes nothing
            self.airspeeds_mps = airspeeds_mps

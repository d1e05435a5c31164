"""Forecast of a flight at parameters that are held, before take-off and in the air."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.route import PlannedLegs, Route, RoutePredictor
from eadp.models.world import Mission
from eadp.planning.base import Ending, PlannerSettings
from eadp.planning.forecast.evaluate import Evaluation, Evaluator, Objective
from eadp.planning.forecast.home import Reach, home_ending, latest_turn_back, reach
from eadp.planning.forecast.knapsack import Filling
from eadp.planning.state.flight_state import FlightState
from eadp.planning.state.known import Known


@dataclass(frozen=True)
class Preflight:
    """Forecast of a mission before take-off.

    Attributes
    ----------
    parameters : dict
        Planned, by name; computations averaged over the time with a free set.
    decided : tuple of float
        Parameters that it decides at take-off.
    forecast : Ending
    feasible : bool
        Whether the reserve is kept with the probability of the settings.
    quality : float or None
        Planned U.
    stages : dict
        Time [s] and energy [Wh] of each stage, over all its laps.
    computing_wh : float
        Energy of the computations, of that of the forecast [Wh].
    reach : Reach or None
        How far one pack carries it with the reserve kept, where that is not to the end.
    turns_back_soc : float
        State of charge at the end with less of which the autopilot turns back on the way; 0 where it does not.
    at_cruise : Preflight or None
        The same at the aircraft's own airspeed, where others are decided.
    entering : dict
        Probability of each obstacle to be entered, and of the boundary to be left, by name; see `clearance.entering`.
    evaluated : tuple of (Evaluation, Filling)
        What it is of.
    """

    parameters: dict[str, float]
    decided: Vector
    forecast: Ending
    feasible: bool
    quality: float | None
    stages: dict[int, tuple[float, float]]
    computing_wh: float
    evaluated: tuple[Evaluation, Filling] = field(repr=False, compare=False)
    reach: Reach | None = None
    turns_back_soc: float = 0.0
    entering: dict[str, float] = field(default_factory=dict)
    at_cruise: Preflight | None = None

    @classmethod
    def of(cls, evaluation: Evaluation, filling: Filling, parameters: Vector) -> Preflight:
        """The forecast by an evaluation of one place: with the path of `parameters`, and computations as filled."""
        route, evaluator = evaluation.routes[0], evaluation.evaluator
        plan = evaluator.mission.plan
        means = _mean_computations(evaluation, filling, route, plan.path_count)
        names = dict(zip(plan.names, (*parameters[: plan.path_count], *means), strict=True))
        # U counts parameters with a choice: there is no U where no stage has any
        counted = any(evaluator.envelopes.shares.scaled(stage).any() for stage in route.stages.tolist())
        quality = float(filling.value[0]) if counted else None
        feasible, times_s = bool(filling.feasible[0]), evaluation.load.times_s
        computing_w = evaluation.computing_w(filling.shares)
        powers_w = evaluation.load.motion_w + computing_w
        # sums over the legs of each stage, from 1; index 0 is none
        seconds, energies_j = (np.bincount(route.stages, values) for values in (times_s, powers_w * times_s))
        return cls(
            parameters=names,
            decided=parameters,
            forecast=evaluation.forecast(filling),
            feasible=feasible,
            quality=quality,
            stages={i: (float(seconds[i]), float(energies_j[i]) / 3600) for i in np.unique(route.stages).tolist()},
            computing_wh=float(computing_w @ times_s) / 3600,
            evaluated=(evaluation, filling),
            reach=None if feasible else reach(evaluation, filling),
            turns_back_soc=float(evaluation.own.turns_back_soc[0]),
        )

    @cached_property
    def turn_back(self) -> Reach | None:
        """The latest turn back, where there is a home; it takes most of the time of a forecast."""
        evaluation, filling = self.evaluated
        return latest_turn_back(evaluation, filling)

    @property
    def autopilot_text(self) -> str:
        """What is said of an autopilot that turns back; empty where it does not."""
        if self.turns_back_soc <= 0:
            return ""
        return f"turns back by itself unless {100 * self.turns_back_soc:.0f} % of the charge is left at the end"

    @property
    def airspeeds_mps(self) -> Vector:
        """The airspeed of each stage, where it is decided [m/s]; else empty."""
        of_places = self.evaluated[0].airspeeds_mps
        return () if of_places is None else tuple(of_places[0].tolist())

    def planned(self, mission: Mission) -> PlannedLegs:
        """The legs that were forecast, to the plan's end; where airspeeds are decided, their stages command them."""
        cursor = PlanCursor.start(mission.plan, mission.parameters, mission.rules).decide(self.decided)
        planned = RoutePredictor().route(cursor, mission.start_m or (0.0, 0.0)).planned()
        if not set(self.airspeeds_mps) - {mission.cruise_mps}:
            return planned
        stages = {
            stage.index: replace(stage, airspeed_mps=stage.airspeed_mps or airspeed_mps)
            for stage, airspeed_mps in zip(mission.plan.stages, self.airspeeds_mps, strict=True)
        }
        return planned._replace(legs=tuple(leg._replace(stage=stages[leg.stage.index]) for leg in planned.legs))


def _mean_computations(evaluation: Evaluation, filling: Filling, route: Route, rho: int) -> list[float]:
    """Mean of each computation, as filled, over the time of the stages in which it is not inhibited."""
    envelopes = [evaluation.evaluator.envelopes[kind].configurations for kind in evaluation.kinds.tolist()]
    # mean configuration of each leg, shape (legs, computations): the one of minimum power, plus the shares taken of the
    # steps from vertex to vertex of its envelope
    configurations = np.array([envelope[0] for envelope in envelopes])
    for leg, (envelope, shares) in enumerate(zip(envelopes, filling.shares, strict=True)):
        configurations[leg] += shares[: len(envelope) - 1] @ np.diff(envelope, axis=0)
    means = []
    for k in range(configurations.shape[1]):
        weights = evaluation.load.times_s * np.array([not stage.sets[rho + k].inhibited for stage in route.of_legs])
        total_s = float(weights.sum())
        means.append(float(configurations[:, k] @ weights) / total_s if total_s > 0 else 0.0)
    return means


class HeldForecast:
    """Forecasts a flight at parameters that stay as they are.

    Parameters
    ----------
    settings : PlannerSettings
    mission : Mission
    """

    def __init__(self, settings: PlannerSettings, mission: Mission) -> None:
        self._settings, self._mission = settings, mission
        self._predictor = RoutePredictor()
        self._evaluators: dict[Vector, Evaluator] = {}

    def evaluation(self, known: Known, parameters: Vector) -> Evaluation:
        """The rest of the flight evaluated at parameters; place 0 of it.

        Raises
        ------
        PathUndefined
            If the plan cannot be flown at them, or not in this wind.
        """
        # an evaluator with a single level of each computation holds them
        computing = parameters[self._mission.plan.path_count :]
        if computing not in self._evaluators:
            levels = {name: (value,) for name, value in zip(self._mission.plan.names, parameters, strict=True)}
            settings = replace(self._settings, levels=levels)
            self._evaluators[computing] = Evaluator(self._mission, settings, Objective(settings.reserve_soc))
        cursor = known.cursor.decide(parameters)
        route = self._predictor.route(cursor, known.joined.position_m, known.margin_m)
        return self._evaluators[computing].evaluate(known, [route])

    def at(self, known: Known, parameters: Vector) -> Ending | None:
        """Forecast at parameters; None where the plan cannot be flown at them. Of the way home, once that is flown."""
        try:
            found = self.evaluation(known, parameters)
        except PathUndefined:
            return None
        if known.returns_home:
            return home_ending(found)
        return found.forecast(found.filled())


def before_take_off(settings: PlannerSettings, mission: Mission, wind_mps: Point, gust_std_mps: float) -> Known:
    """What is known of a flight before take-off, in a forecast wind [m/s] and its gusts."""
    state = FlightState(mission, settings.weights)
    state.assume(wind_mps, gust_std_mps)
    return state.known(0.0, mission.start_m or (0.0, 0.0))

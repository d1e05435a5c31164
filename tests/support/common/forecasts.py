"""What is known before take-off, routes from there, and evaluators: forecasts without a flight."""

from dataclasses import replace

from common import ROOT
from eadp.api.inputs import load_flight
from eadp.errors import PathUndefined
from eadp.models.plan.route import RoutePredictor
from eadp.planning.forecast.evaluate import Evaluator, Objective
from eadp.planning.forecast.held import before_take_off

CALM = {"wind.speed_mps": 0.0}


def survey_inputs(planner="joint", plan="plans/survey.plan", **overrides):
    """The survey without faults."""
    fixed = {"planner.name": planner, "step_s": 0.05, "faults": [], **overrides}
    return load_flight(str(ROOT / plan), scenario=str(ROOT / "scenarios/survey.yaml"), overrides=fixed)


def plan_inputs(tmp_path, text, **overrides):
    """A plan's text, with computations of the profile."""
    path = tmp_path / "a.plan"
    path.write_text(text)
    profile = str(ROOT / "profiles/pednet-jetson-nano.yaml")
    return load_flight(str(path), profile=profile, overrides={"step_s": 0.05, **overrides})


class Forecasting:
    """Evaluations of one mission from before take-off, or from what is known later."""

    def __init__(self, inputs, *, wind_mps=(0.0, 0.0), gust_std_mps=0.0, objective=None, battery=None, **settings):
        self.inputs, self.mission = inputs, inputs.mission
        if battery:
            self.mission = replace(self.mission, battery=replace(self.mission.battery, **battery))
        self.settings = replace(inputs.scenario.planner, **settings)
        self.objective = objective or Objective(self.settings.reserve_soc)
        self.known = before_take_off(self.settings, self.mission, wind_mps, gust_std_mps)
        self.evaluator = Evaluator(self.mission, self.settings, self.objective)
        self._predictor = RoutePredictor()

    def parameters(self, *shares):
        """Parameters with the path's at shares of their sets."""
        boxes = [self.mission.plan.hull(i) for i in range(len(shares))]
        path = [box.lo + share * (box.hi - box.lo) for share, box in zip(shares, boxes, strict=True)]
        return (*path, *self.mission.parameters[len(shares) :])

    def route(self, *shares, margin_m=1.0):
        """The route with shares of the path parameters decided: the first leg is the same at all."""
        cursor = self.known.cursor.decide(self.parameters(*shares))
        return self._predictor.route(cursor, self.known.joined.position_m, margin_m)

    def at(self, *places, margin_m=1.0):
        """Evaluation of places: one share, or a tuple of shares, each."""
        shares = [place if isinstance(place, tuple) else (place,) for place in places]
        return self.evaluator.evaluate(self.known, [self.route(*each, margin_m=margin_m) for each in shares])

    def evaluate(self, places):
        """As `Places.evaluate`: those that can be flown, and their evaluation."""
        routes = []
        for shares in places:
            try:
                routes.append((shares, self.route(*shares)))
            except PathUndefined:
                continue
        if not routes:
            return [], None
        found = self.evaluator.evaluate(self.known, [route for _, route in routes])
        return [routes[i][0] for i in found.index.tolist()], found

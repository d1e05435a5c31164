"""A cursor that is moved by hand, and the routes from where it is."""

from eadp.models.plan.cursor import PlanCursor, Rules
from eadp.models.plan.route import RoutePredictor


class Tracked:
    """Where a flight is in its plan, and where the stage was joined."""

    def __init__(self, plan, parameters, start, rules=None):
        self.cursor = PlanCursor.start(plan, tuple(parameters), rules or Rules())
        self.joined_m = start
        self._predictor = RoutePredictor()

    @property
    def stage(self):
        return self.cursor.stage

    def route(self, parameters, margin_m=0.0):
        """What is left to fly if these parameters were decided now."""
        return self._predictor.route(self.cursor.decide(tuple(parameters)), self.joined_m, margin_m)

    def decide(self, parameters):
        self.cursor = self.cursor.decide(tuple(parameters))

    def next_stage(self):
        self.joined_m, self.cursor = self.cursor.trigger_m(), self.cursor.next()

"""How a flight is likely to end with its parameters held, for planners that make no forecast of their own."""

from __future__ import annotations

from dataclasses import replace

from eadp.models.plan.cursor import Vector
from eadp.planning.base import Mission, Observation, PlannerSettings
from eadp.planning.joint.forecaster import Forecast, Forecaster
from eadp.planning.joint.program import best_at

NEAR_END_M = 0.5
"""A held path is not chosen to just reach the end: what comes this near to it counts as the end [m]."""


def held_settings(settings: PlannerSettings, mission: Mission, parameters: Vector) -> PlannerSettings:
    """Settings that leave one value to each computation."""
    levels = {name: (value,) for name, value in zip(mission.plan.names, parameters, strict=True)}
    return replace(settings, levels=levels)


class HeldForecast:
    """Follows a flight and forecasts its end at given parameters.

    Parameters
    ----------
    settings : PlannerSettings
    mission : Mission
    """

    def __init__(self, settings: PlannerSettings, mission: Mission) -> None:
        self._settings, self._mission = settings, mission
        self._forecaster = Forecaster(
            held_settings(settings, mission, mission.parameters), mission, margin_m=-NEAR_END_M
        )
        self._held = mission.parameters

    def observe(self, o: Observation) -> None:
        """Take an observation."""
        self._forecaster.see(o)
        self._forecaster.read(o, self._mission.computing.power_w(o.parameters, o.cursor.stage.sets))

    def at(self, o: Observation, parameters: Vector) -> Forecast | None:
        """The end as forecast from an observation, at parameters; None where the plan cannot be flown at them."""
        forecaster = self._forecaster
        if parameters != self._held:
            self._held = parameters
            forecaster.hold(held_settings(self._settings, self._mission, parameters), parameters)
        forecaster.at(o.time_s, (o.x_m, o.y_m), 0.0)
        candidate = forecaster.prospect(forecaster.shares)
        return None if candidate is None else forecaster.forecast(best_at(candidate))

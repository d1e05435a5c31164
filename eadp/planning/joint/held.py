"""Forecast of a flight at fixed parameters, for planners without a forecast of their own."""

from __future__ import annotations

from dataclasses import replace

from eadp.core.geometry.curves import Point
from eadp.models.plan.cursor import Vector
from eadp.planning.base import Mission, Observation, PlannerSettings
from eadp.planning.joint.forecaster import Forecast, Forecaster
from eadp.planning.joint.program import best_at


def held_settings(settings: PlannerSettings, mission: Mission, parameters: Vector) -> PlannerSettings:
    """Settings that allow each computation a single level."""
    levels = {name: (value,) for name, value in zip(mission.plan.names, parameters, strict=True)}
    return replace(settings, levels=levels)


class HeldForecast:
    """Tracks a flight and forecasts its end at given parameters.

    Parameters
    ----------
    settings : PlannerSettings
    mission : Mission
    """

    def __init__(self, settings: PlannerSettings, mission: Mission) -> None:
        self._settings, self._mission = settings, mission
        self._forecaster = Forecaster(held_settings(settings, mission, mission.parameters), mission)
        self._held = mission.parameters

    @property
    def wind_mps(self) -> Point:
        """The wind to plan with [m/s]."""
        return self._forecaster.wind_mps

    @property
    def warnings(self) -> tuple[str, ...]:
        """Codes of what is wrong with the readings."""
        return self._forecaster.warnings

    def observe(self, o: Observation) -> None:
        """Take an observation."""
        self._forecaster.update_stage(o)
        computing_w = self._mission.computing.power_w(o.parameters, o.cursor.stage.sets)
        power_w = self._forecaster.passed_w(o, computing_w)
        self._forecaster.observe(o._replace(power_w=power_w), computing_w)

    def at(self, o: Observation, parameters: Vector) -> Forecast | None:
        """Forecast from an observation at parameters; None where the plan cannot be flown at them."""
        forecaster = self._forecaster
        if parameters != self._held:
            self._held = parameters
            forecaster.hold(held_settings(self._settings, self._mission, parameters), parameters)
        forecaster.start_at(o.time_s, (o.x_m, o.y_m))
        candidate = forecaster.candidate(forecaster.shares)
        return None if candidate is None else forecaster.forecast(best_at(candidate))

"""Forecast before take-off: probability of completion, and time and energy of each stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.errors import Infeasible
from eadp.planning.base import Mission, PlannerSettings
from eadp.planning.joint.forecaster import Forecast, Forecaster
from eadp.planning.joint.held import held_settings
from eadp.planning.joint.program import MissionProgram, Solution, best_at
from eadp.planning.joint.settings import JointSettings


@dataclass(frozen=True)
class Preflight:
    """Forecast of a mission before take-off.

    Attributes
    ----------
    parameters : dict
        Planned, by name; computations averaged over the time with a free set.
    forecast : Forecast
    feasible : bool
        Whether the reserve is kept with the probability of the settings.
    quality : float or None
        Planned U.
    stages : dict
        Time [s] and energy [Wh] of each stage, over all its laps.
    """

    parameters: dict[str, float]
    forecast: Forecast
    feasible: bool
    quality: float | None
    stages: dict[int, tuple[float, float]]


def preflight(
    settings: PlannerSettings, mission: Mission, wind_mps: Point, gust_std_mps: float, own: JointSettings | None
) -> Preflight | None:
    """The forecast of a mission before take-off, in the wind of the weather forecast.

    With `own`, the parameters are those that planner `joint` would choose; without, those of take-off.

    Returns
    -------
    Preflight or None
        None if the charge is replayed, or the plan cannot be flown in this wind.
    """
    plan, battery = mission.plan, mission.battery
    if battery.prescribed:
        return None
    if own is None:
        settings = held_settings(settings, mission, mission.parameters)
    forecaster = Forecaster(settings, mission, own)
    forecaster.assume(wind_mps, gust_std_mps, battery.soc)
    forecaster.start_at(0.0, mission.start_m or (0.0, 0.0))
    if own is not None and forecaster.open:
        try:
            program = MissionProgram(len(forecaster.open))
            solution = program.solve(forecaster.candidate, forecaster.shares, by_blocks=forecaster.by_blocks)
        except Infeasible:
            return None
    else:
        here = forecaster.candidate(forecaster.shares)
        if here is None:
            return None
        solution = best_at(here)
    shares = solution.candidate.shares
    values = list(forecaster.parameters_of(shares))
    values[plan.path_count :] = _mean_configuration(forecaster, solution)
    names = dict(zip(plan.names, values, strict=True))
    quality = solution.value if forecaster.open or len(solution.candidate.increments.use) else None
    forecast, stages = forecaster.forecast(solution), forecaster.of_stages(solution)
    return Preflight(names, forecast, solution.allocation.feasible, quality, stages)


def _mean_configuration(forecaster: Forecaster, solution: Solution) -> list[float]:
    """Mean of each computation over the time with a free set, as allocated."""
    terms, load = forecaster.terms(solution.candidate.shares)
    route = forecaster.route(solution.candidate.shares)
    count = terms.kinds[0].configurations.shape[1]
    rho = len(route.parameters[0]) - count
    envelopes = terms.envelopes
    configurations = np.array([envelope.configurations[0] for envelope in envelopes])
    increments = terms.increments
    for segment, level, share in zip(
        increments.segment.tolist(), increments.level.tolist(), solution.allocation.shares.tolist(), strict=True
    ):
        envelope = envelopes[segment].configurations
        configurations[segment] += share * (envelope[level + 1] - envelope[level])
    means = []
    for k in range(count):
        runs = np.array([not stage.sets[rho + k].inhibited for stage in route.of_legs])
        weights = load.times_s * runs
        total = float(weights.sum())
        means.append(float(configurations[:, k] @ weights) / total if total > 0 else 0.0)
    return means

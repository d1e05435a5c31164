"""Before take-off: will it finish, how surely, and what does each stage take?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.errors import Infeasible
from eadp.models.plan.route import MARGIN_M
from eadp.planning.base import Mission, PlannerSettings
from eadp.planning.joint.forecaster import Forecast, Forecaster
from eadp.planning.joint.held import NEAR_END_M, held_settings
from eadp.planning.joint.program import MissionProgram, Solution, best_at
from eadp.planning.joint.settings import JointSettings


@dataclass(frozen=True)
class Preflight:
    """What is to be expected of a mission.

    Attributes
    ----------
    parameters : dict
        By name: as planned, computations averaged over the time in which they have a choice.
    forecast : Forecast
    feasible : bool
        Whether the reserve is kept as surely as asked for.
    quality : float or None
        U as planned.
    """

    parameters: dict[str, float]
    forecast: Forecast
    feasible: bool
    quality: float | None


def preflight(
    settings: PlannerSettings, mission: Mission, wind_mps: Point, gust_std_mps: float, own: JointSettings | None
) -> Preflight | None:
    """The forecast of a mission before take-off, in the wind of the weather forecast.

    With `own`, the parameters are those that planner `joint` would choose now; without, those of take-off are kept.

    Returns
    -------
    Preflight or None
        None where the charge is replayed, or the plan cannot be flown in this wind.
    """
    plan, battery = mission.plan, mission.battery
    if battery.prescribed:
        return None
    margin_m = MARGIN_M
    if own is None:
        settings, margin_m = held_settings(settings, mission, mission.parameters), -NEAR_END_M
    ahead = Forecaster(settings, mission, own, margin_m)
    ahead.assume(wind_mps, gust_std_mps, battery.soc)
    ahead.at(0.0, mission.start_m or (0.0, 0.0), 0.0)
    if own is not None and ahead.open:
        try:
            answer = MissionProgram(len(ahead.open)).solve(ahead.prospect, ahead.shares)
        except Infeasible:
            return None
    else:
        here = ahead.prospect(ahead.shares)
        if here is None:
            return None
        answer = best_at(here)
    shares = answer.prospect.shares
    values = list(ahead.parameters_of(shares))
    values[plan.path_count :] = _mean_configuration(ahead, answer)
    names = dict(zip(plan.names, values, strict=True))
    quality = answer.value if ahead.open or len(answer.prospect.steps.use) else None
    return Preflight(names, ahead.forecast(answer), answer.allocation.feasible, quality)


def _mean_configuration(ahead: Forecaster, answer: Solution) -> list[float]:
    """Each computation's mean over the time in which it has a choice, as allocated."""
    told = ahead.told(answer.prospect.shares)
    assert told is not None
    terms, segments = told
    course = ahead.course(answer.prospect.shares)
    count = terms.kinds[0].configurations.shape[1]
    rho = len(course.parameters[0]) - count
    menus = terms.menus
    configurations = np.array([menu.configurations[0] for menu in menus])
    steps = terms.steps
    for segment, level, share in zip(
        steps.segment.tolist(), steps.level.tolist(), answer.allocation.shares.tolist(), strict=True
    ):
        menu = menus[segment].configurations
        configurations[segment] += share * (menu[level + 1] - menu[level])
    means = []
    for k in range(count):
        runs = np.array([not leg.stage.sets[rho + k].inhibited for leg in course.legs])
        weights = segments.times_s * runs
        total = float(weights.sum())
        means.append(float(configurations[:, k] @ weights) / total if total > 0 else 0.0)
    return means

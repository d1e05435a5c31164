"""The joint planner: path and computations together, to the end of the mission.

One program is solved for the path parameters and the computations of every leg that is left; see `mission_program`, and
`forecaster` for what it is told. Of the state of charge the reserve is kept back, and a margin of z standard deviations
of the forecast, so that the reserve is kept with a stated probability.

In the air it is calm: path parameters are looked at anew when what is left has changed and where they can take effect,
and change where that pays. Of the computations, the dearer ones come first: what is not known of the rest shrinks on
the way, and the margin with it, so that what had to be saved at first may be spent after all.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from eadp.errors import Infeasible
from eadp.models.plan.cursor import Vector
from eadp.models.plan.route import Route
from eadp.planning.base import (
    Decision,
    DecisionRecord,
    Mission,
    Observation,
    PlannerSettings,
    Readings,
    TrackingPlanner,
    next_multiple,
)
from eadp.planning.estimation.estimator import EstimatorSettings
from eadp.planning.joint.forecaster import Forecaster, ripple_w
from eadp.planning.joint.program import MissionProgram, Solution, best_at
from eadp.planning.joint.settings import JointSettings
from eadp.planning.joint.terms import QUALITY, KnapsackTerms

TIME, NEW_STAGE, JUMPED = "time", "new stage", "the charge has jumped"

LOOK_EVERY_S = 1.0
"""How often it looks at the charge, so that it answers a jump in time however seldom it re-plans."""

WARM_UP_S = 5.0
"""Before this nothing is decided: wind and power are hardly known."""

LOOK_AGAIN_SOC, LOOK_AGAIN_VALUE = 0.002, 0.002
"""By how much the charge that the best plan leaves over, or its quality, has to differ before path parameters are
looked at again."""

RISE, FALL = 0.25, 0.10
"""Of two configurations between which the power lies that lasts to the end, the upper one is flown first, as long as it
can be for more than this share of the time that is left: to rise to it, and to stay with it."""

LEAST_RISE_S, HOLD_S = 15.0, 20.0
"""Nothing rises with less time left than this, nor so soon after it has fallen."""


class JointPlanner(TrackingPlanner):
    """One optimisation over path and computations to the end of the mission; see the module.

    Source: letter, Sec. VI (future work).
    """

    own_settings = JointSettings
    optimises_to_end = True

    def __init__(
        self,
        settings: PlannerSettings,
        estimator: EstimatorSettings,
        mission: Mission,
        own: JointSettings | None = None,
    ) -> None:
        super().__init__(settings, estimator, mission)
        self._rho = mission.plan.path_count
        self._own = own = own or JointSettings()
        self._ahead = Forecaster(settings, mission, own)
        self._program = MissionProgram(len(self._ahead.open))
        self._next_s = self._begins_s = WARM_UP_S + own.start_after_s
        self._looked_at: tuple[float, float] | None = None
        self._infeasible_since_s: float | None = None
        self._fell_s = -math.inf
        self._jumped = False
        self._looked_s, self._in_doubt = 0.0, False

    @property
    def next_update_s(self) -> float:
        """When it re-plans next; soon, and at the next reading where the charge may have jumped."""
        seen_s = self._next_reading_s if self._in_doubt else self._looked_s + LOOK_EVERY_S
        return min(self._next_s, seen_s)

    def ingest(self, readings: Readings) -> Decision:
        """Take readings all at once; a jump of the charge among them is answered at the next look."""
        self._jumped |= self._ahead.read_all(readings, self._computing_w)
        return super().ingest(readings)

    def update(self, observation: Observation) -> Decision:
        """Take an observation; re-plan when it is time to, at a new stage, and at once when the charge jumps."""
        o, ahead = observation, self._ahead
        why = NEW_STAGE if ahead.see(o) else ""
        read = o.time_s >= self._next_reading_s - 1e-9
        self._track(o)
        self._jumped |= read and ahead.read(o, self._computing_w)
        self._looked_s, self._in_doubt = o.time_s, ahead.is_ambiguous(o.soc)
        if self._jumped:
            why = JUMPED
        elif not why and o.time_s >= self._next_s - 1e-9:
            why = TIME
        begins_s = WARM_UP_S if why == JUMPED else self._begins_s
        if why and o.time_s >= begins_s - 1e-9:
            self._jumped = False
            self._next_s = max(next_multiple(o.time_s, self._settings.every_s), self._begins_s)
            self._replan(o, why)
        return self._decision

    # --- decisions

    def _replan(self, o: Observation, why: str) -> None:
        ahead = self._ahead
        self.report.replans += 1
        ahead.at(o.time_s, (o.x_m, o.y_m), ripple_w(self._estimator.state_w) if self.period_s else 0.0)
        started = time.perf_counter()
        try:
            answer, looked = self._answer(why)
        except Infeasible as error:
            self.report.infeasible += 1
            self._decision = self._decision._replace(reason=f"infeasible: {error}")
            return
        finally:
            self.report.solve_ms.append(1e3 * (time.perf_counter() - started))
        self.report.solves += 1
        self.report.qps += answer.passes
        self.report.failures += answer.failures
        if not answer.allocation.feasible:
            self.report.infeasible += 1
        shares = answer.prospect.shares
        told = ahead.told(shares)
        assert told is not None
        terms, segments = told
        path = ahead.parameters_of(shares)[: self._rho]
        remaining_s = float(segments.times_s.sum())
        chosen = (*path, *self._computations(o, ahead.course(shares), terms, answer, remaining_s))
        reason = self._reason(o, answer, terms, chosen, looked=looked)
        record = self._record(o, why, chosen, answer, reason)
        ahead.decide(chosen, shares)
        self._decision = Decision(chosen, self._decision.power_forecast_w, reason, record)

    def _answer(self, why: str) -> tuple[Solution, bool]:
        """The best from here, with the path parameters kept or looked at anew; and which of both."""
        ahead = self._ahead
        here = ahead.prospect(ahead.shares)
        if here is not None and 0 < here.steps.least_use - here.available < here.tolerance:
            here = replace(here, available=here.steps.least_use)  # what is flown is not doubted for so little
        kept = best_at(here) if here is not None else None
        if not ahead.open:
            if kept is None:
                raise Infeasible("what is left of the plan cannot be flown in this wind")
            return kept, False
        if kept is not None and why != JUMPED and not self._look_again(kept, why):
            return kept, False
        flown = kept if kept is not None and kept.allocation.feasible else None
        least = -math.inf if flown is None else flown.value + self._own.min_gain
        at_best = least >= 1.0 and self._own.objective == QUALITY  # U is 1 at most
        found = None if at_best else self._program.solve(ahead.prospect, ahead.shares, least)
        if flown is not None and (found is None or not found.allocation.feasible or found.value <= least):
            self._looked_at = _left_over(flown)
            return flown, True
        assert found is not None
        self._looked_at = _left_over(found)
        if kept is not None and not found.allocation.feasible and found.short > kept.short - kept.prospect.tolerance:
            return kept, True
        return found, True

    def _look_again(self, kept: Solution, why: str) -> bool:
        """Whether path parameters are to be looked at again: they can take effect, and what is left has changed."""
        if not kept.allocation.feasible and self._infeasible_since_s is None:
            return True
        if why != NEW_STAGE or not self._ahead.before_latch:
            return False
        if self._looked_at is None:
            return True
        (value, over), (then_value, then_over) = _left_over(kept), self._looked_at
        return abs(value - then_value) > LOOK_AGAIN_VALUE or abs(over - then_over) > LOOK_AGAIN_SOC

    def _computations(
        self, o: Observation, course: Route, terms: KnapsackTerms, answer: Solution, remaining_s: float
    ) -> list[float]:
        """The computations to fly with now: those that last to the end, with hysteresis."""
        now = list(self._decision.parameters[self._rho :])
        if not now:
            return now
        menu = terms.kinds[terms.kind_of[0]]
        if not answer.allocation.feasible:
            return [float(value) for value in menu.configurations[0]]
        target_w = _lasting_w(terms, answer, remaining_s)
        # what is flown now is one of these, or the next one below
        ladder, values, configurations = menu.near
        held = int(np.searchsorted(ladder, self._power_of(now, course) + 1e-9, side="right")) - 1
        below = min(max(int(np.searchsorted(ladder, target_w + 1e-9, side="right")) - 1, 0), len(ladder) - 2)
        held = min(max(held, 0), len(ladder) - 1)
        share = (target_w - ladder[below]) / (ladder[below + 1] - ladder[below]) if len(ladder) > 1 else 0.0
        calm = remaining_s > LEAST_RISE_S and o.time_s > self._fell_s + HOLD_S
        enough = FALL if held > below else RISE if calm else math.inf
        lasting = below + 1 if share > enough else max(below, 0)
        if lasting < held:
            self._fell_s = o.time_s
        if lasting == held and configurations[held].tolist() == now:
            return now
        affordable = ladder <= ladder[lasting] + 1e-12
        return [float(value) for value in configurations[int(np.argmax(np.where(affordable, values, -np.inf)))]]

    def _power_of(self, values: list[float], course: Route) -> float:
        own = (*course.parameters[0][: self._rho], *values)
        boxes = course.legs[0].stage.sets
        clipped = tuple(box.clip(value) for box, value in zip(boxes, own, strict=True))
        return self._mission.computing.power_w(clipped, boxes)

    # --- what is told

    def _reason(self, o: Observation, answer: Solution, terms: KnapsackTerms, chosen: Vector, *, looked: bool) -> str:
        if not answer.allocation.feasible:
            if self._infeasible_since_s is None:
                self._infeasible_since_s = o.time_s
            if terms.beyond_w > 0:
                return (
                    f"infeasible since {self._infeasible_since_s:.1f} s: {terms.beyond_w:.1f} W more than the battery "
                    "can deliver on the way; lowest configuration"
                )
            volts = self._mission.battery.voltage_at(max(self._ahead.soc, 0.0))
            short_wh = answer.short * self._mission.battery.capacity_ah * volts
            return (
                f"infeasible since {self._infeasible_since_s:.1f} s: short by {answer.short:.4f} of the charge, "
                f"{short_wh:.2f} Wh; lowest configuration"
            )
        self._infeasible_since_s = None
        names = self._mission.plan.names
        moved = [
            f"{name} {old:g} → {new:g}"
            for name, old, new in zip(names, self._decision.parameters, chosen, strict=True)
            if old != new
        ]
        if moved:
            return ", ".join(moved)
        return "kept: no change gains enough" if looked else "kept"

    def _record(self, o: Observation, why: str, chosen: Vector, answer: Solution, reason: str) -> DecisionRecord:
        ahead, b = self._ahead, self._mission.battery
        forecast, (reachable, lost_s) = ahead.forecast(answer), ahead.home(answer)
        told = ahead.told(answer.prospect.shares)
        assert told is not None
        floor = max(self._settings.reserve_soc, told[0].least_soc)
        return DecisionRecord(
            time_s=o.time_s,
            why=why,
            stage=o.stage,
            lap=ahead.lap,
            parameters=chosen,
            remaining_s=forecast.remaining_s,
            remaining_std_s=forecast.remaining_std_s,
            energy_wh=forecast.energy_wh,
            energy_std_wh=forecast.energy_std_wh,
            available_wh=max(ahead.soc - floor, 0.0) * b.capacity_ah * b.voltage_at((ahead.soc + floor) / 2),
            soc_end=forecast.soc_end,
            soc_end_std=forecast.soc_end_std,
            completes_probability=forecast.completes_probability,
            reserve_probability=forecast.reserve_probability,
            quality_ahead=answer.value if self._own.objective == QUALITY else None,
            wind_mps=ahead.wind_mps,
            passes=answer.passes,
            status=answer.status,
            reason=reason,
            home_reachable=reachable,
            point_of_no_return_s=lost_s,
        )


def _lasting_w(terms: KnapsackTerms, answer: Solution, remaining_s: float) -> float:
    """The mean power of the computations over the legs that are like this one, as allocated [W].

    Flown all the time, it uses what the best mix in time uses.
    """
    kind = terms.kind_of[0]
    menu, steps = terms.kinds[kind], terms.steps
    mine = terms.kind_of[steps.segment] == kind
    level, use = steps.level[mine], steps.use[mine]
    whole = np.bincount(level, use, len(menu.powers_w) - 1)
    taken = np.bincount(level, use * answer.allocation.shares[mine], len(menu.powers_w) - 1)
    shares = np.divide(taken, whole, out=np.zeros(len(whole)), where=whole > 0)
    power = float(menu.powers_w[0] + shares @ np.diff(menu.powers_w))
    # what is left over beyond the highest, spread over all that is left
    over = answer.prospect.available - answer.allocation.use
    return power + max(over, 0.0) / max(terms.soc_per_j * remaining_s, 1e-12)


def _left_over(answer: Solution) -> tuple[float, float]:
    """What a plan is worth, and the state of charge that it leaves over."""
    return answer.value, answer.prospect.available - answer.allocation.use

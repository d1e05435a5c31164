"""The joint planner: path and computations together, to the end of the mission.

One program is solved for the path parameters and the computations of every remaining leg; see `program`, and
`forecaster` for its data. The available state of charge excludes the reserve and a margin of z standard deviations of
the forecast, so that the reserve is kept with a given probability.

Decisions have hysteresis: path parameters are optimised again when the forecast has changed and they can take effect,
and change if the gain exceeds a minimum. Of the computations, the more expensive configurations come first: the
variance of the forecast shrinks during the flight, and the margin with it, so that charge saved at first may be spent
later.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from eadp.errors import Infeasible
from eadp.models.battery import LETTER
from eadp.models.plan.cursor import Vector
from eadp.models.plan.route import Route
from eadp.planning.base import (
    JUMPED,
    NEW_STAGE,
    TIME,
    Decision,
    DecisionRecord,
    Mission,
    Observation,
    PlannerSettings,
    Readings,
    TrackingPlanner,
    next_multiple,
    with_limit,
)
from eadp.planning.estimation.estimator import EstimatorSettings
from eadp.planning.joint.forecaster import Forecaster, ripple_w
from eadp.planning.joint.program import MissionProgram, Solution, best_at
from eadp.planning.joint.settings import JointSettings
from eadp.planning.joint.terms import QUALITY, KnapsackTerms

UPDATE_EVERY_S = 5.0
"""Maximum time between updates [s], so that a jump of the charge has a response however seldom it re-plans; and the
time between looks whether the forecast holds."""

GAUGE_DISBELIEVED = "; the gauge does not fall with the power: disbelieved, the charge is the integral of the power"
"""Warning in the reason of a decision."""

ROUNDING = 1e-9
"""Charge that counts as rounding."""

SAME_SHARE = 1e-5
"""Change of a path parameter, as a share of its set, that counts as none."""

FULL_SHARE = 1 - 1e-6
"""Share above which an increment of the knapsack counts as taken."""

WARM_UP_S = 5.0
"""No decision before this time [s]: the variance of wind and power is still large."""

REEVALUATE_SOC, REEVALUATE_VALUE = 0.002, 0.002
"""Minimum change of the charge left by the best plan, or of its value, before path parameters are optimised again."""

RISE, FALL, MAX_RISE = 0.25, 0.10, 0.97
"""Of the two configurations around the sustained power, the upper one is flown first if it can be for more than this
share of the remaining time: thresholds to rise to it, once more of it for each fall, to stay with it, and to rise at
most."""

HELD_SHARE = 0.2
"""Longest time between re-plannings as a share of the time that is left."""

SURPRISE_VALUE, SURPRISE_SHARE = 1e-3, 0.05
"""The forecast holds while its error changes the objective, and the share of the upper configuration, by less."""

RISE_GAIN = 0.002
"""Least gain of the objective over the remaining time for which computations rise, times one more for each change."""


class JointPlanner(TrackingPlanner):
    """One optimisation over path and computations to the end of the mission; see the module.

    Source: letter, Sec. VI (future work).
    """

    own_settings = JointSettings
    optimises_to_end = True
    takes_arrays = True

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
        self._forecaster = Forecaster(settings, mission, own)
        self._program = MissionProgram(len(self._forecaster.open), self.report)
        self._next_s = self._starts_s = WARM_UP_S + own.start_after_s
        self._evaluated_at: tuple[float, float] | None = None
        self._infeasible_since_s: float | None = None
        self._falls = self._changes = 0
        hulls = [mission.plan.hull(i) for i in range(self._rho)] if mission.plan.has_sets else []
        self._same = [SAME_SHARE * (box.hi - box.lo) for box in hulls] or [0.0] * self._rho
        self._home_spare: float | None = None
        self._home_s = 0.0
        self._jumped = False
        self._updated_s, self._ambiguous = 0.0, False
        self._holds_until_s, self._tolerance, self._steady_s = -math.inf, 0.0, math.inf
        self._held_stages, self._held_sets = 0, mission.plan.stages[0].sets
        self._max_interval_s = 0.0 if mission.live else own.max_interval_s

    @property
    def next_update_s(self) -> float:
        """When it re-plans or updates next; at the next reading where the charge may have jumped."""
        update_s = self._next_reading_s if self._ambiguous else self._updated_s + UPDATE_EVERY_S
        if self._jumped and self._updated_s < WARM_UP_S:
            update_s = min(update_s, WARM_UP_S)
        return min(self._next_s, update_s)

    def ingest(self, readings: Readings) -> Decision:
        """Take a batch of readings; the next update responds to a jump of the charge among them."""
        gate, now_w = self._forecaster.gate, self._computing_w
        powers_w: Any = gate.ingest(readings.times_s, readings.powers_w, now_w)
        readings = readings._replace(powers_w=powers_w)
        self._jumped |= self._forecaster.observe_batch(readings, self._computing_w)
        return super().ingest(readings)

    def update(self, observation: Observation) -> Decision:
        """Update with an observation; re-plan when due, at a new stage, and at once when the charge jumps."""
        if self._decision.returns_home:
            return self._decision
        o, forecaster = observation, self._forecaster
        cause = NEW_STAGE if forecaster.update_stage(o) else ""
        read = o.time_s >= self._next_reading_s - 1e-9
        if read:
            o = o._replace(power_w=forecaster.passed_w(o, self._computing_w))
        self._track(o)
        self._jumped |= read and forecaster.observe(o, self._computing_w)
        self._updated_s, self._ambiguous = o.time_s, forecaster.is_ambiguous(o.soc)
        if self._jumped:
            cause = JUMPED
        elif cause or o.time_s >= self._next_s - 1e-9:
            if self._holds(o):
                cause, self._next_s = "", self._next_look_s(o.time_s)
            else:
                cause = cause or TIME
        starts_s = WARM_UP_S if cause == JUMPED else self._starts_s
        if cause and o.time_s >= starts_s - 1e-9:
            self._jumped = False
            self._replan(o, cause)
            self._next_s = self._next_look_s(o.time_s)
        return self._decision

    def hold(self, held: Mapping[int, float]) -> None:
        """Re-plan at the next update, with these parameters as they are."""
        levels = {self._mission.plan.names[i]: (value,) for i, value in held.items() if i >= self._rho}
        settings = replace(self._settings, levels={**self._settings.levels, **levels})
        chosen = tuple([held.get(i, value) for i, value in enumerate(self._decision.parameters)])
        self._forecaster.restrict(settings, self._own, held, chosen)
        self._program = MissionProgram(len(self._forecaster.open), self.report)
        self._decision = self._decision._replace(parameters=chosen)
        self._next_s, self._evaluated_at = self._starts_s, None

    # --- decisions

    def _holds(self, o: Observation) -> bool:
        """Whether the last forecast is still good enough: no re-planning would gain anything to speak of."""
        if o.time_s >= self._holds_until_s - 1e-9 or o.cursor.stage.sets != self._held_sets:
            return False
        if o.stages_started != self._held_stages:
            self._held_stages = o.stages_started
            if self._forecaster.open and self._forecaster.before_latch:
                return False
        return abs(self._forecaster.surprise(o.time_s, (o.x_m, o.y_m), self._computing_w)) <= self._tolerance

    def _next_look_s(self, time_s: float) -> float:
        """When to re-plan, or to look whether the forecast holds, next [s]."""
        soon_s = next_multiple(time_s, self._settings.every_s)
        return max(soon_s, min(time_s + UPDATE_EVERY_S, self._holds_until_s), self._starts_s)

    def _replan(self, o: Observation, cause: str) -> None:
        forecaster, report = self._forecaster, self.report
        self._holds_until_s = o.time_s  # nothing holds where the plan cannot be flown
        estimator = self._estimator
        forecaster.start_at(o.time_s, (o.x_m, o.y_m), (lambda: ripple_w(estimator.state_w)) if self.period_s else None)
        calls, started = report.calls, time.perf_counter()
        try:
            start, searched, moved = self._solve(cause)
            solution = self._program.decided(forecaster.candidate, start, movable=moved)
        except Infeasible as error:
            report.infeasible += 1
            self._decision = self._decision._replace(reason=f"infeasible: {error}")
            return
        finally:
            report.solve_ms.append(1e3 * (time.perf_counter() - started))
            report.replans += report.calls > calls
        if not solution.allocation.feasible:
            report.infeasible += 1
        shares = solution.candidate.shares
        terms, load = forecaster.terms(shares)
        settled = forecaster.settled(shares)
        path = self._rounded(forecaster.parameters_of(settled)[: self._rho])
        remaining_s = float(load.times_s.sum())
        chosen = (*path, *self._computations(o, forecaster.route(shares), terms, solution, remaining_s))
        reason = with_limit(
            self._reason(o, solution, terms, chosen, searched=searched), self._battery_limit(solution, terms)
        )
        if not forecaster.believes_gauge:
            reason += GAUGE_DISBELIEVED
        returns_home = self._must_turn_back(o.time_s, solution)
        if returns_home:
            reason = f"home: {reason}"
        record = self._record(o, cause, chosen, solution, reason, report.calls - calls)
        forecaster.expect(solution)
        self._hold(o, solution, terms, remaining_s)
        forecaster.decide(chosen, settled)
        self._decision = Decision(chosen, reason, record, returns_home)

    def _hold(self, o: Observation, solution: Solution, terms: KnapsackTerms, remaining_s: float) -> None:
        """Set until when the forecast holds at most, and how much charge it may be off by.

        A plan that is not feasible, and one with a home to turn back to, is forecast at every re-planning.
        """
        self._held_stages, self._held_sets = o.stages_started, o.cursor.stage.sets
        if not solution.allocation.feasible or self._home_spare is not None:
            return
        self._holds_until_s += min(self._max_interval_s, HELD_SHARE * remaining_s, self._steady_s)
        rises_w = terms.relative[terms.kind_of[0]].rises_w
        step = float(rises_w.min(initial=math.inf)) * remaining_s * terms.soc_per_j
        over = max(solution.candidate.available - solution.allocation.use, 0.0)
        price = self._program.price(solution)
        self._tolerance = over + min(SURPRISE_VALUE / max(price, ROUNDING), SURPRISE_SHARE * step)

    def _rounded(self, path: Vector) -> Vector:
        """Path parameters, those decided before where the difference is rounding."""
        known = zip(path, self._decision.parameters, self._same, strict=False)
        return tuple([old if abs(new - old) <= same else new for new, old, same in known])

    def _must_turn_back(self, time_s: float, solution: Solution) -> bool:
        """Whether the plan is infeasible, and home is out of reach by the next re-planning, or short by less."""
        before, spare = self._home_spare, self._forecaster.home_spare(solution)
        self._home_spare = spare
        if spare is None:
            return False
        if spare >= 0:
            self._home_s = time_s
        if not self._mission.returns_home or solution.allocation.feasible:
            return False
        falls = max(0.0, before - spare) if before is not None and math.isfinite(before) else 0.0
        return -solution.shortfall < spare < falls

    def _solve(self, cause: str) -> tuple[Solution, bool, bool]:
        """The point from which OSQP decides, whether path parameters were scanned for it, and whether they may move."""
        kept = self._kept()
        if not self._forecaster.open:
            if kept is None:
                raise Infeasible("the rest of the plan cannot be flown in this wind")
            return kept, False, False
        if kept is not None and cause != JUMPED and not self._must_reevaluate(kept, cause):
            return kept, False, False
        best = self._optimised(kept)
        return best, True, best is not kept

    def _kept(self) -> Solution | None:
        """The solution at the path parameters in force; None if the plan cannot be flown at them."""
        candidate = self._forecaster.candidate(self._forecaster.shares)
        if candidate is None:
            return None
        if 0 < candidate.increments.base_use - candidate.available < candidate.tolerance:
            # the parameters in force stay valid within the tolerance
            candidate = candidate._replace(available=candidate.increments.base_use)
        return best_at(candidate)

    def _optimised(self, kept: Solution | None) -> Solution:
        """The solution with optimal path parameters, or the kept one unless the gain exceeds the minimum."""
        forecaster = self._forecaster
        flown = kept if kept is not None and kept.allocation.feasible else None
        threshold = -math.inf if flown is None else flown.value + self._own.min_gain
        if flown is not None and threshold >= 1.0 and self._own.objective == QUALITY:  # U is at most 1
            best = flown
        else:
            best = self._program.scanned(
                forecaster.candidate,
                forecaster.shares,
                threshold,
                by_blocks=forecaster.by_blocks,
                bound=forecaster.bound,
                place_at=forecaster.place,
            )
            if flown is not None and (not best.allocation.feasible or best.value <= threshold):
                best = flown
        self._evaluated_at = _value_and_rest(best)
        if kept is None or best.allocation.feasible or best.shortfall <= kept.shortfall - kept.candidate.tolerance:
            return best
        return kept

    def _must_reevaluate(self, kept: Solution, cause: str) -> bool:
        """Whether to optimise path parameters again: they can take effect, and the forecast has changed."""
        if not kept.allocation.feasible and self._infeasible_since_s is None:
            return True
        if cause != NEW_STAGE or not self._forecaster.before_latch:
            return False
        if self._evaluated_at is None:
            return True
        (value, over), (then_value, then_over) = _value_and_rest(kept), self._evaluated_at
        return abs(value - then_value) > REEVALUATE_VALUE or abs(over - then_over) > REEVALUATE_SOC

    def _computations(
        self, o: Observation, route: Route, terms: KnapsackTerms, solution: Solution, remaining_s: float
    ) -> list[float]:
        """The computations to fly with now: those sustained to the end, with hysteresis.

        After each fall they rise later, in the end where the upper ones last to the end.
        """
        now = list(self._decision.parameters[self._rho :])
        self._steady_s = math.inf
        if all(box.fixed for box in route.of_legs[0].sets[self._rho :]):  # none, or none that has a choice here
            return now
        envelope = terms.kinds[terms.kind_of[0]]
        if not solution.allocation.feasible:
            return list(envelope.configurations[0].tolist())
        target_w = _sustained_w(terms, solution, remaining_s)
        # the configuration in force is one of these, or rounded down to one
        powers, values, configurations = envelope.powers_w, envelope.values, envelope.configurations
        held = int(np.searchsorted(powers, self._power_of(now, route) + 1e-9, side="right")) - 1
        below = min(max(int(np.searchsorted(powers, target_w + 1e-9, side="right")) - 1, 0), len(powers) - 2)
        held = min(max(held, 0), len(powers) - 1)
        share = (target_w - powers[below]) / (powers[below + 1] - powers[below]) if len(powers) > 1 else 0.0
        threshold = FALL if held > below else min(RISE * (1 + self._falls), MAX_RISE)
        sustained = below + 1 if share > threshold else max(below, 0)
        gain = (values[sustained] - values[held]) * remaining_s
        if sustained > held and gain < RISE_GAIN * (1 + self._changes) and configurations[held].tolist() == now:
            sustained = held
        # what the mix still has of the configuration not flown stays, over a time that shrinks
        missing, limit = (1 - share, 1 - FALL) if sustained > below else (share, threshold)
        self._steady_s = remaining_s * (1 - missing / limit) if 0 <= missing < limit else math.inf
        self._falls += sustained < held
        self._changes += sustained != held
        return list(configurations[sustained].tolist())

    def _power_of(self, values: list[float], route: Route) -> float:
        own = (*route.parameters[0][: self._rho], *values)
        boxes = route.of_legs[0].sets
        clipped = tuple(box.clip(value) for box, value in zip(boxes, own, strict=True))
        return self._mission.computing.power_w(clipped, boxes)

    # --- records

    def _reason(
        self, o: Observation, solution: Solution, terms: KnapsackTerms, chosen: Vector, *, searched: bool
    ) -> str:
        if not solution.allocation.feasible:
            if self._infeasible_since_s is None:
                self._infeasible_since_s = o.time_s
            if terms.beyond_w > 0:
                return (
                    f"infeasible since {self._infeasible_since_s:.1f} s: {terms.beyond_w:.1f} W more than the battery "
                    "can deliver on the way; lowest configuration"
                )
            volts = self._mission.battery.voltage_at(max(self._forecaster.soc, 0.0))
            shortfall_wh = solution.shortfall * self._mission.battery.capacity_ah * volts
            return (
                f"infeasible since {self._infeasible_since_s:.1f} s: short by {solution.shortfall:.4f} of the charge, "
                f"{shortfall_wh:.2f} Wh; lowest configuration"
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
        return "kept: no change gains enough" if searched else "kept"

    def _battery_limit(self, solution: Solution, terms: KnapsackTerms) -> str | None:
        """The limit of the battery's power without which there would be more computations, or a feasible plan."""
        b, allocation = self._mission.battery, solution.allocation
        if terms.beyond_w > 0:
            return b.limit_at(b.voltage_at(self._forecaster.soc))
        spare = solution.candidate.available - allocation.use
        if spare <= solution.candidate.tolerance and terms.min_soc > self._settings.reserve_soc + ROUNDING:
            by_letter = terms.letter_soc >= terms.delivered_soc
            return LETTER if by_letter else b.limit_at(b.voltage_at(terms.delivered_soc))
        if not allocation.feasible:
            return None
        full = terms.truncated.copy()  # and every configuration below flown
        full[terms.increments.segment[allocation.shares < FULL_SHARE]] = False
        if not full.any():
            return None
        first = int(full.argmax())
        return LETTER if terms.by_letter[first] else b.limit_at(float(terms.volts[first]))

    def _record(
        self, o: Observation, cause: str, chosen: Vector, solution: Solution, reason: str, calls: int
    ) -> DecisionRecord:
        forecaster, b = self._forecaster, self._mission.battery
        forecast = forecaster.forecast(solution)
        terms, _ = forecaster.terms(solution.candidate.shares)
        floor = max(self._settings.reserve_soc, terms.min_soc)
        return DecisionRecord(
            time_s=o.time_s,
            cause=cause,
            stage=o.stage,
            lap=forecaster.lap,
            parameters=chosen,
            status=solution.status,
            calls=calls,
            iterations=solution.iterations,
            gap=solution.gap,
            reason=reason,
            battery_limit=self._battery_limit(solution, terms),
            remaining_s=forecast.remaining_s,
            remaining_std_s=forecast.remaining_std_s,
            energy_wh=forecast.energy_wh,
            energy_std_wh=forecast.energy_std_wh,
            available_wh=max(forecaster.soc - floor, 0.0) * b.capacity_ah * b.voltage_at((forecaster.soc + floor) / 2),
            soc_end=forecast.soc_end,
            soc_end_std=forecast.soc_end_std,
            completes_probability=forecast.completes_probability,
            reserve_probability=forecast.reserve_probability,
            quality_forecast=solution.value if self._own.objective == QUALITY else None,
            wind_mps=forecaster.wind_mps,
            home_reachable=None if self._home_spare is None else self._home_spare >= 0,
            point_of_no_return_s=None if self._home_spare is None or self._home_spare >= 0 else self._home_s,
        )


def _sustained_w(terms: KnapsackTerms, solution: Solution, remaining_s: float) -> float:
    """Mean power of the computations over the legs of this one's kind, as allocated [W].

    Held constant, it uses as much charge as the optimal mix over time.
    """
    kind = terms.kind_of[0]
    envelope, increments = terms.relative[kind], terms.increments
    mine = terms.kind_of[increments.segment] == kind
    level, use = increments.level[mine], increments.use[mine]
    whole = np.bincount(level, use, len(envelope.powers_w) - 1)
    taken = np.bincount(level, use * solution.allocation.shares[mine], len(envelope.powers_w) - 1)
    shares = np.divide(taken, whole, out=np.zeros(len(whole)), where=whole > 0)
    power = float(envelope.powers_w[0] + shares @ envelope.rises_w)
    # charge left above the most expensive configurations, over the remaining time
    over = solution.candidate.available - solution.allocation.use
    return power + max(over, 0.0) / max(terms.soc_per_j * remaining_s, 1e-12)


def _value_and_rest(solution: Solution) -> tuple[float, float]:
    """Value of a solution, and the state of charge that it leaves."""
    return solution.value, solution.candidate.available - solution.allocation.use

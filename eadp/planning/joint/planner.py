"""The joint planner: path and computations together, to the end of the mission.

The planner re-plans at each stage from which the path can change, when charge was lost, and every `max_interval_s`: it
forecasts the plan in force; it searches the path where that plan is short of charge, or its value has changed; OSQP
decides the computations at the path found; the policy decides what of them to fly. See `search`, `program` and
`policy`, and `eadp.planning.forecast` for the data.

The charge to spend excludes the reserve and a margin of z standard deviations of the forecast, so that the reserve is
kept with a given probability.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Lt

from eadp.core.arrays import NotNegative, Share
from eadp.core.geometry.curves import Point
from eadp.models.battery import LETTER
from eadp.models.plan.cursor import Vector
from eadp.models.world import Mission
from eadp.planning.base import (
    BY_FALLBACK,
    FALLBACK,
    JUMPED,
    NEW_STAGE,
    SHORT,
    TIME,
    TOO_WINDY,
    TURNS_BACK,
    Decision,
    DecisionRecord,
    Ending,
    HomeRecord,
    Observation,
    PlannerSettings,
    TradeOff,
    next_multiple,
    with_limit,
)
from eadp.planning.forecast.evaluate import LAST_CHANGE_S, ROUNDING, Evaluation, Evaluator, Objective
from eadp.planning.forecast.held import Preflight, before_take_off
from eadp.planning.forecast.home import can_fall, home_spare, latest_turn_back
from eadp.planning.forecast.knapsack import fill_greedy
from eadp.planning.joint.policy import EARLY_S, SETTLED_S, Places, Policy
from eadp.planning.joint.program import ComputationProgram, Solution
from eadp.planning.joint.search import Search, Shares
from eadp.planning.registry import Planner
from eadp.planning.state.flight_state import FlightState
from eadp.planning.state.known import Known

WARM_UP_S = 5.0
"""No decision before this time, from take-off and since the plan is reached [s]: the variance of wind and power is
still large."""

GAUGE_DISBELIEVED = "; the gauge does not fall with the power: disbelieved, the charge is the integral of the power"
"""Warning in the reason of a decision."""

BETTER = 0.1
"""Standard deviations of the final charge by which a plan has to be less short to be another one."""

SAME_VALUE = 1e-3
"""A quality that is less by so much is as great: a faster pace is taken for it."""

FULL_SHARE = 1 - 1e-6
"""Share above which an increment of the knapsack counts as taken."""


@dataclass(frozen=True)
class JointSettings:
    """Settings of planner `joint`."""

    reserve_probability: Annotated[float, Ge(0.5), Lt(1)] = 0.95
    """Probability with which the reserve is kept."""

    min_gain: Share = 0.01
    """Least gain of the quality U for which a path parameter is changed."""

    objective: Literal["quality"] = "quality"
    """What is maximised: the quality U, by the ground of the mission."""

    trade_offs: tuple[TradeOff, ...] = ()
    """Rows R c − r ≥ 0 that the computations keep to."""

    loss_rate_per_h: NotNegative = 0.5
    """Sudden losses of charge to expect before any is seen, of 2 to 12 % of the full charge each [1/h]."""

    max_interval_s: NotNegative = 30.0
    """Longest time between re-plannings [s]; the shortest is `planner.every_s`, which a flight with a home and
    `eadp replan` keep to."""

    airspeed: Literal["fixed", "when-short", "least-energy"] = "when-short"
    """Whether the airspeed is decided, within the aircraft's `airspeed_range_mps`: `when-short` slows the flight for as
    much quality as the battery allows, and no further; `least-energy` always takes the least energy for the ground."""

    start_after_s: NotNegative = 0.0
    """Time before which nothing is re-planned [s]."""


class Candidate(NamedTuple):
    """A plan that may be flown: path and computations to the end of the mission.

    Attributes
    ----------
    shares : tuple of float
        Its path: the place.
    evaluation : Evaluation
        Of this place alone.
    solution : Solution
        Its computations.
    pace_mps, thriftiest_mps : float or None
        Its pace, and the one that leaves the most charge [m/s]; None where the airspeed is not decided.
    in_reach : float
        Of a path searched: the greatest value of any by the smaller margin, see `Evaluation.later`.
    """

    shares: Shares
    evaluation: Evaluation
    solution: Solution
    pace_mps: float | None = None
    thriftiest_mps: float | None = None
    in_reach: float = -math.inf

    @property
    def airspeeds_mps(self) -> Vector:
        """Airspeed of each stage [m/s]; empty where that is not decided."""
        of_stages = self.evaluation.airspeeds_mps
        return () if self.pace_mps is None or of_stages is None else tuple(of_stages[0].tolist())

    @property
    def at_thriftiest(self) -> Candidate:
        """The same path at the pace that leaves the most charge, where the airspeed is decided."""
        evaluation = self.evaluation.thriftiest or self.evaluation
        return Candidate(self.shares, evaluation, Solution(evaluation.filled(), ""), self.thriftiest_mps)

    @property
    def with_later_margin(self) -> Candidate:
        """The same, feasible already where it is with the smaller margin of what can still change."""
        least = self.evaluation.thriftiest or self.evaluation
        evaluation = replace(self.evaluation, thriftiest=replace(least, knapsack=least.later))
        return self._replace(evaluation=evaluation, solution=Solution(fill_greedy(evaluation.adaptive), ""))

    @property
    def left_over(self) -> float:
        """State of charge that it leaves beyond the reserve and today's margin; negative where it is short."""
        return float(self.evaluation.knapsack.available[0] - self.solution.filling.use[0])


class LastSearch(NamedTuple):
    """Value, and charge left over, of the plan that the last search has found."""

    value: float
    left_over: float


class ComputationChoice(NamedTuple):
    """Computations to fly with now, for how long [s], and whether their power falls."""

    computations: Vector
    lasts_s: float
    falls: bool


class JointPlanner(Planner):
    """One optimisation over path and computations to the end of the mission; see the module.

    Source: letter, Sec. VI (future work).
    """

    own_settings = JointSettings
    own: JointSettings
    optimises_to_end = True

    def __init__(self, settings: PlannerSettings, mission: Mission, own: JointSettings | None = None) -> None:
        super().__init__(settings, mission, own or JointSettings())
        own = self.own
        self._places = Places(self._evaluator(settings), mission.parameters)
        self._program = ComputationProgram(self.report)
        self._policy = Policy(own.min_gain)
        self._next_s = WARM_UP_S + own.start_after_s
        self._last_search: LastSearch | None = None
        self._infeasible_since_s: float | None = None
        self._losses_answered = 0
        self._stages_started = 1  # as of the last update
        self._next_reading_s = math.inf  # of the reading that decides whether the charge has jumped [s]
        self._home_reached_s = 0.0  # when home could be reached last [s]
        # whether the airspeed is decided now; in a live flight where what is commanded is known to be flown
        self._airspeed_open = self._decides_airspeed and not mission.live
        # where forecasts are shown live, and where a turn home depends on them
        self._replans_each_period = mission.live or (mission.way_home is not None and mission.way_home.turns_back)

    @classmethod
    def preflight(
        cls, settings: PlannerSettings, mission: Mission, wind_mps: Point, gust_std_mps: float
    ) -> Preflight | None:
        """The forecast before take-off, at the parameters that it would choose."""
        planner = cls(settings, mission, settings.own)
        places, known = planner._places, before_take_off(settings, mission, wind_mps, gust_std_mps)
        places.enter(known)
        plan = planner._kept_plan(known)
        if planner._searchable:
            plan = planner._search_plan(known, plan)
        if plan is None:
            return None
        solution = planner._program.solve(plan.evaluation.adaptive)
        return Preflight.of(plan.evaluation, solution.filling, places.parameters(plan.shares))

    def _evaluator(self, settings: PlannerSettings) -> Evaluator:
        """The evaluator of routes with the objective that the settings state."""
        own, losses_per_s = self.own, self.own.loss_rate_per_h / 3600
        objective = Objective(settings.reserve_soc, own.reserve_probability, losses_per_s, own.trade_offs)
        return Evaluator(self.mission, settings, objective)

    @property
    def _decides_airspeed(self) -> bool:
        """Whether the settings and the aircraft leave the airspeed to be decided."""
        return self.own.airspeed != "fixed" and self.mission.vehicle.airspeed_range_mps is not None

    @property
    def _searchable(self) -> bool:
        """Whether there is a path or an airspeed to search."""
        return bool(self._places.open) or self._airspeed_open

    @property
    def next_update_s(self) -> float:
        """When it re-plans next [s]; at the next reading where the charge may have jumped."""
        return min(self._next_s, self._next_reading_s)

    def update(self, state: FlightState) -> Decision:
        """Re-plan when due, at a new stage, and at once when charge was lost; else repeat the last decision."""
        o = state.now
        if self._decision.returns_home:
            return self._decision
        if self.mission.live and self._decides_airspeed:
            self._airspeed_open = state.flies_commanded
        due, entered = o.time_s >= self._next_s - 1e-9, self._enters_stage(o)
        jumped = state.losses > self._losses_answered
        self._next_reading_s = state.jump_decided_s(o.soc)
        # a loss of charge is answered before `start_after_s`, too
        starts_s = max(state.reached_s + WARM_UP_S, WARM_UP_S + (0.0 if jumped else self.own.start_after_s))
        if o.time_s < starts_s - 1e-9:
            self._next_s = starts_s
        elif jumped or entered or due:
            self._losses_answered = state.losses
            interval_s = 0.0 if self._replans_each_period else self.own.max_interval_s
            self._next_s = max(next_multiple(o.time_s, self.settings.every_s), o.time_s + interval_s)
            self._replan(o, state.known(o.time_s, o.position_m), JUMPED if jumped else NEW_STAGE if entered else TIME)
        return self._decision

    def _enters_stage(self, o: Observation) -> bool:
        """Whether a stage has started since the last update at which the decision may change.

        It may where the path can change at it, where trade-offs differ by stage, and in a live flight.
        """
        started, self._stages_started = o.stages_started != self._stages_started, o.stages_started
        if not started:
            return False
        by_stage = any(row.stages for row in self.own.trade_offs)
        return self.mission.live or by_stage or (bool(self._places.open) and o.cursor.accepts_changes())

    def hold(self, held: Mapping[int, float]) -> None:
        """Take the parameters, by index, that stay at a value from now on; re-plan at the next update.

        A computation is held by an evaluator with one level of it, a path parameter by not being searched.
        """
        rho, names = self.mission.plan.path_count, self.mission.plan.names
        levels = {names[i]: (value,) for i, value in held.items() if i >= rho}
        settings = replace(self.settings, levels={**self.settings.levels, **levels})
        chosen = tuple([held.get(i, value) for i, value in enumerate(self._decision.parameters)])
        self._places = Places(self._evaluator(settings), chosen, [i for i in held if i < rho])
        self._decision = self._decision._replace(parameters=chosen)
        self._next_s, self._last_search = WARM_UP_S + self.own.start_after_s, None

    def _replan(self, o: Observation, known: Known, cause: str) -> None:
        """Forecast the plan in force, search the path where it is to be searched, and decide."""
        report, calls, started = self.report, self.report.calls, time.perf_counter()
        self._places.enter(known)
        plan = self._kept_plan(known)
        search = self._searchable and self._must_search(o, plan, cause)
        found = self._search_plan(known, plan) if search else plan
        if search and found is not None:
            self._last_search = LastSearch(found.solution.value, found.left_over)
        if found is None:
            why = f"{TOO_WINDY}: the rest of the plan cannot be flown in this wind"
            self._decision = self._decision._replace(reason=why)
        else:
            found = found._replace(solution=self._program.solve(found.evaluation.adaptive))
            self._decide(o, known, cause, found, self._choose(o, found), calls, searched=search)
        report.solve_ms.append(1e3 * (time.perf_counter() - started))
        report.replans += report.calls > calls

    def _kept_plan(self, known: Known) -> Candidate | None:
        """The plan at the place and the pace in force; None where it cannot be flown."""
        shares, pace_mps = self._places.shares, self._places.pace_mps
        if not self._airspeed_open:
            return self._plan(known, shares)
        if pace_mps is None:
            return self._decide_pace(known, shares)
        return self._at_pace(known, shares, pace_mps, self._places.thriftiest_mps or pace_mps)

    def _plan(self, known: Known, shares: Shares, pace_mps: float | None = None) -> Candidate | None:
        """The plan at a place, with the computations in closed form; None where it cannot be flown."""
        _, evaluation = self._places.evaluate(known, [shares], pace_mps)
        if evaluation is None:
            return None
        return Candidate(shares, evaluation, Solution(evaluation.filled(), ""), pace_mps)

    def _search_plan(self, known: Known, kept: Candidate | None) -> Candidate | None:
        """Search the path, then the airspeed; return the best plan.

        The path is searched at the pace that leaves the most charge, as the fastest that allows its value is found for
        it. The plan in force, `kept`, is returned where another gains little.
        """
        if not self._airspeed_open:
            return self._search_path(known, kept)
        shares = self._places.shares
        least = kept and kept.at_thriftiest
        found = self._search_path(known, least) if self._places.open else None
        if found is None:
            return self._decide_pace(known, shares)
        if least is not None and self._stays_early(known, least, found):
            stays = self._decide_pace(known, shares, found.in_reach)
            return stays and stays.with_later_margin
        return self._decide_pace(known, found.shares, found.in_reach)

    def _stays_early(self, known: Known, least: Candidate, found: Candidate) -> bool:
        """Whether a path that another is to replace stays while it is in reach, as computations do; see `EARLY_S`.

        Not in the forecast before take-off, which is of what can be promised.
        """
        if not 0 < known.time_s < EARLY_S or self._losses_answered > 0 or found.shares == least.shares:
            return False
        later = fill_greedy(least.evaluation.later)
        return bool(later.feasible[0]) and float(later.value[0]) > found.solution.value

    def _decide_pace(self, known: Known, shares: Shares, in_reach: float = -math.inf) -> Candidate | None:
        """The plan at a place and the best pace; None where it cannot be flown.

        It is the fastest at which its value is as great, or its shortfall as small, as at any: by the smaller margin of
        what can still change where that is the fastest of all, see `Evaluation.adaptive`, else by the whole one. That
        in force stays where it will do, see `Policy.pace`. While a path of a greater value, `in_reach`, may still come
        within the whole margin, it is the one that leaves the most charge.
        """
        self._policy.awaits_s = math.inf
        paces, evaluation = self._places.paces(known, shares)
        if evaluation is None:
            return None
        filling, spare = evaluation.filled(), np.round(evaluation.knapsack.spare, 11)
        pace_mps = thriftiest_mps = paces[int(np.argmax(spare))]
        if self.own.airspeed == "least-energy":
            pace_mps = paces[-1]
        elif not filling.feasible.any() or in_reach > filling.value[filling.feasible].max() + self._policy.path_gain:
            self._policy.awaits_s = known.time_s + SETTLED_S
        else:
            # the fastest of all by the margin that is left later, others by the whole one
            good = fill_greedy(evaluation.later).as_good(SAME_VALUE)
            good = good if good[0] == 0 else filling.as_good(SAME_VALUE)
            pace_mps = self._policy.pace(known.time_s, self._places.pace_mps, [paces[i] for i in good.tolist()])
        return self._at_pace(known, shares, pace_mps, thriftiest_mps)

    def _at_pace(self, known: Known, shares: Shares, pace_mps: float, thriftiest_mps: float) -> Candidate | None:
        """The plan at a place and a pace, beside the one that leaves the most charge; None where it cannot be flown."""
        plan = least = self._plan(known, shares, pace_mps)
        if thriftiest_mps != pace_mps:
            least = self._plan(known, shares, thriftiest_mps)
        if plan is None or least is None:
            return None
        evaluation = replace(plan.evaluation, thriftiest=least.evaluation)
        return Candidate(shares, evaluation, Solution(fill_greedy(evaluation.adaptive), ""), pace_mps, thriftiest_mps)

    def _search_path(self, known: Known, kept: Candidate | None) -> Candidate | None:
        """Search the path at the pace of the plan in force, `kept`, which is returned where another gains little."""
        places, pace_mps = self._places, kept and kept.pace_mps
        # the value to exceed, if the plan in force is feasible
        feasible = kept is not None and kept.solution.feasible
        threshold = -math.inf if kept is None or not feasible else kept.solution.value + self._policy.path_gain
        evaluate = partial(places.evaluate, known, pace_mps=pace_mps)
        search = Search(evaluate, places.evaluator.path_weight, threshold, ahead=pace_mps is not None)
        best = search.best(places.shares)
        if best is None:
            return kept
        found = kept
        if not (feasible and best.value <= threshold):
            found = self._plan(known, best.shares, pace_mps) or kept
            if kept and found and not best.feasible:
                clearly_less = kept.evaluation.shortfall - BETTER * float(kept.evaluation.std[0])
                found = found if found.evaluation.shortfall <= clearly_less else kept
        return found and found._replace(in_reach=search.in_reach)

    def _must_search(self, o: Observation, kept: Candidate | None, cause: str) -> bool:
        """Whether to search the path: at first, when charge was lost, newly short, or of another value.

        While short of charge at each new stage, too, where the path can change; and before computations fall, since
        another path may cost less. Not near the end, and not while the power of the motion may have changed for good:
        its next windows decide on that. `kept` is the plan in force.
        """
        if kept is None or self._last_search is None or cause == JUMPED or o.time_s >= self._policy.awaits_s:
            return True
        if kept.evaluation.totals.seconds[0] < LAST_CHANGE_S:
            return False
        value, left_over = self._last_search
        changed = max(abs(kept.solution.value - value), abs(kept.left_over - left_over)) > self._policy.path_gain
        if not kept.solution.feasible:
            newly = self._infeasible_since_s is None
            return newly or (o.cursor.accepts_changes() and (changed or cause == NEW_STAGE))
        if self._is_free(o) and self._computations(o, kept).falls:
            return True
        return (
            changed
            and (self._airspeed_open or o.cursor.accepts_changes())
            and not kept.evaluation.known.motion.in_doubt
        )

    # --- decisions

    def _choose(self, o: Observation, plan: Candidate) -> Vector:
        """Choose the parameters to fly with now by a plan; the policy counts a new path and notes a fall.

        The next update is at the latest when these computations are to change.
        """
        rho, before = self.mission.plan.path_count, self._decision.parameters
        chosen = self._places.parameters(plan.shares)
        if self._is_free(o):
            choice = self._computations(o, plan)
            self._next_s = min(self._next_s, o.time_s + choice.lasts_s)
            if choice.falls:
                self._policy.fell_s = o.time_s
            chosen = (*chosen[:rho], *choice.computations)
        if chosen[:rho] != before[:rho]:
            self._policy.path_changes += 1
        return chosen

    def _computations(self, o: Observation, plan: Candidate) -> ComputationChoice:
        """The computations to fly with now by a plan; asking changes nothing."""
        before, evaluator = self._decision.parameters, plan.evaluation.evaluator
        now_w = self._power_w(plan.evaluation, before)
        computations, lasts_s = self._policy.computations(o.time_s, now_w, plan.evaluation, plan.solution)
        after_w = self._power_w(plan.evaluation, (*before[: self.mission.plan.path_count], *computations))
        # no fall where the stage, by its trade-offs, allows no more power
        max_w = evaluator.envelopes[int(plan.evaluation.kinds[0])].powers_w[-1]
        return ComputationChoice(computations, lasts_s, after_w < min(now_w, max_w) - 1e-9)

    def _is_free(self, o: Observation) -> bool:
        """Whether the stage leaves the computations a choice."""
        return any(not box.fixed for box in o.cursor.stage.sets[self.mission.plan.path_count :])

    def _decide(
        self, o: Observation, known: Known, cause: str, plan: Candidate, chosen: Vector, calls: int, *, searched: bool
    ) -> None:
        """Set the decision to `chosen`, the parameters of a plan to fly with now, with its reason and record.

        `calls` is the count of OSQP's runs before this re-planning, and `searched` whether the path was searched.
        """
        solution, limit = plan.solution, self._battery_limit(known, plan)
        if solution.feasible:
            self._infeasible_since_s = None
        elif self._infeasible_since_s is None:
            self._infeasible_since_s = o.time_s
        reason = with_limit(self._reason(known, plan, chosen, searched=searched), limit)
        if solution.status == FALLBACK:
            reason += f"; {BY_FALLBACK}closed form: OSQP failed"
        ending = plan.evaluation.forecast(solution.filling)
        if not known.charge.believed:
            reason += GAUGE_DISBELIEVED
        returns_home, home = self._way_home(o.time_s, plan, ending)
        if returns_home:
            reason = TURNS_BACK + reason
        elif home.home_by_s is not None and home.point_of_no_return_s is not None and not solution.feasible:
            reason += f"; home can wait {home.point_of_no_return_s - o.time_s:.0f} s"
        record = DecisionRecord(
            time_s=o.time_s,
            cause=cause,
            stage=o.stage,
            lap=o.cursor.lap,
            parameters=chosen,
            status=solution.status,
            calls=self.report.calls - calls,
            gap=solution.gap,
            reason=reason,
            battery_limit=limit,
            ending=ending._replace(quality_forecast=solution.value),
            wind_mps=known.wind.mps,
            home=home,
            airspeed_mps=None if plan.pace_mps is None else plan.airspeeds_mps[o.stage - 1],
        )
        if plan.pace_mps is not None and plan.pace_mps < (self._places.pace_mps or math.inf):
            self._policy.slowed_s = o.time_s
        self._places.decide(plan.shares, chosen, (plan.pace_mps, plan.thriftiest_mps), plan.airspeeds_mps)
        self._decision = Decision(chosen, reason, record, returns_home, self._places.airspeeds_mps)

    def _power_w(self, evaluation: Evaluation, parameters: Vector) -> float:
        """Power of the computations among `parameters`, clipped to the sets of the stage being flown [W]."""
        route = evaluation.routes[0]
        boxes, rho = route.of_legs[0].sets, self.mission.plan.path_count
        own = (*route.parameters[0][:rho], *parameters[rho:])
        clipped = tuple(box.clip(value) for box, value in zip(boxes, own, strict=True))
        return self.mission.computing.power_w(clipped, boxes)

    def _way_home(self, time_s: float, plan: Candidate, ending: Ending) -> tuple[bool, HomeRecord]:
        """Whether to turn back now, and the way home; in a live flight that goes on, with the latest turn back.

        It is time where the plan is infeasible, the way home is short of less charge than the plan, if of any, and home
        may be out of reach by the next re-planning.
        """
        spare, way_home = home_spare(plan.evaluation), self.mission.way_home
        if spare is None or way_home is None:
            return False, HomeRecord()
        if spare >= 0:
            self._home_reached_s = time_s
        turns_back = way_home.turns_back and not plan.solution.feasible and spare > -plan.evaluation.shortfall
        turns_back = turns_back and spare < can_fall(plan.evaluation, self._next_s - time_s)
        waits = None
        if self.mission.live and not turns_back:
            waits = latest_turn_back(plan.evaluation, plan.solution.filling)
        if waits is None:
            return turns_back, HomeRecord(spare >= 0, None if spare >= 0 else self._home_reached_s)
        to_end = waits.share >= 1 - ROUNDING
        home_by_s = time_s + (ending.remaining_s or 0.0) if to_end else waits.home_s
        return turns_back, HomeRecord(spare >= 0, waits.time_s, home_by_s)

    # --- records

    def _reason(self, known: Known, plan: Candidate, chosen: Vector, *, searched: bool) -> str:
        """The decision and its reason, in words: what an infeasible plan lacks, else what changes, else "kept"."""
        evaluation, battery = plan.evaluation, self.mission.battery
        if not plan.solution.feasible:
            since = f"{SHORT} since {self.mission.clock_s + (self._infeasible_since_s or 0.0):.1f} s: "
            beyond_w = float(evaluation.limits.beyond_w[0])
            min_w = evaluation.evaluator.envelopes[int(evaluation.kinds[0])].powers_w[0]
            lowest = self._power_w(evaluation, chosen) <= min_w + 1e-9
            flown = f"; computations {'at their lowest' if lowest else 'as before'}"
            flown = flown if self.mission.plan.path_count < len(chosen) else ""
            if beyond_w > 0:
                return f"{since}{beyond_w:.1f} W more than the battery can deliver on the way{flown}"
            short = evaluation.shortfall
            short_wh = short * battery.capacity_ah * battery.voltage_at(max(known.soc, 0.0))
            own = plan.evaluation.reserve_soc
            turns = f"; the autopilot turns back below {100 * own:.1f} %" if own > self.settings.reserve_soc else ""
            return f"{since}by {100 * short:.2f} % of the charge, {short_wh:.2f} Wh{flown}{turns}"
        moved = [
            f"{item.label} {item.text(old)} → {item.text(new)}"
            for item, old, new in zip(self.mission.plan.parameters, self._decision.parameters, chosen, strict=True)
            if old != new
        ]
        if plan.pace_mps is not None and plan.pace_mps != (self._places.pace_mps or self.mission.cruise_mps):
            moved.append(self._airspeed_text(known, plan.airspeeds_mps))
        if moved:
            return ", ".join(moved)
        return "kept: no change gains enough" if searched else "kept"

    def _airspeed_text(self, known: Known, airspeeds_mps: Vector) -> str:
        """The change of the airspeed on the stage being flown; where that stays, of the fastest and slowest stage."""
        stage, before = known.cursor.stage.index - 1, self._places.airspeeds_mps
        old, new = (
            f"{speed:.3g}" for speed in (before[stage] if before else self.mission.cruise_mps, airspeeds_mps[stage])
        )
        if old != new:
            return f"airspeed {old} → {new} m/s"
        others = [speed for i, speed in enumerate(airspeeds_mps) if i != stage] or airspeeds_mps
        ends = dict.fromkeys(f"{speed:.3g}" for speed in (min(others), max(others)))
        return f"airspeed of other stages {' to '.join(ends)} m/s"

    def _battery_limit(self, known: Known, plan: Candidate) -> str | None:
        """The battery's limit of power that costs computations, or makes the plan infeasible; None where none does."""
        b, limits, std = self.mission.battery, plan.evaluation.limits, float(plan.evaluation.std[0])
        # 1. minimum power exceeds what can be delivered
        if limits.beyond_w[0] > 0:
            return b.limit_at(b.voltage_at(known.soc))
        # 2. all charge is used but for what a limit requires above the reserve
        if (
            plan.evaluation.left_over(plan.solution.filling) <= BETTER * std
            and limits.min_soc[0] > self.settings.reserve_soc + ROUNDING
        ):
            by_letter = limits.letter_soc[0] >= limits.delivered_soc[0]
            return LETTER if by_letter else b.limit_at(b.voltage_at(float(limits.delivered_soc[0])))
        if not plan.solution.feasible:
            return None
        # 3. on some leg a limit excludes configurations, and all increments that it leaves are taken
        taken = (plan.solution.filling.shares >= FULL_SHARE) | (plan.evaluation.knapsack.use <= 0)
        limited = np.flatnonzero(limits.truncated & taken.all(axis=1))
        if not len(limited):
            return None
        first = int(limited[0])
        return LETTER if limits.by_letter[first] else b.limit_at(float(limits.volts[first]))

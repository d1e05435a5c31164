"""The joint planner: path and computations together, to the end of the mission.

What is left to fly is laid out from the plan's own geometry in the wind as estimated, its energy forecast with its
spread, and one program solved for the path parameters and the computations of every leg; see `mission_program`. Of the
state of charge the reserve is kept back, and a margin of z standard deviations of the forecast, so that the reserve is
kept with a stated probability.

In the air it is calm: path parameters are looked at anew when what is left has changed and where they can take effect,
and change where that pays; computations are held at the power that lasts to the end, rise when the spare would last
with a margin, and fall as soon as they have to.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eadp.core.geometry import Point
from eadp.core.wind import GUST_TIME_S, WindFilter
from eadp.errors import EadpError, Infeasible, PathUndefined
from eadp.models.ahead import Course, Follower, left_m
from eadp.models.itinerary import Vector
from eadp.planning.allocation import Menu
from eadp.planning.estimator import EstimatorSettings
from eadp.planning.mission_program import Answer, MissionProgram, Prospect, Shares, best_at
from eadp.planning.observed import ChargeFilter, Flown, MotionPower, TimeRatio
from eadp.planning.planner import Decision, Mission, Observation, PlannerSettings, Record, StaticPlanner, next_multiple
from eadp.planning.prospects import Past, Segments, Terms, Terrain

FloatArray = NDArray[np.float64]

TIME, NEW_STAGE, JUMPED = "time", "new stage", "the charge has jumped"

WARM_UP_S = 5.0
"""Before this nothing is decided: wind and power are hardly known."""

WIND_STEP_MPS = 0.02
"""A wind that has changed by less is planned with as before."""

SENSITIVITY_EVERY_S = 10.0
LOOK_AGAIN_SOC, LOOK_AGAIN_VALUE = 0.002, 0.002
"""By how much the charge that the best plan leaves over, or its quality, has to differ before path parameters are
looked at again."""

RISE, FALL = 0.15, 0.10
"""Hysteresis of the computations, as shares of the power from one configuration to the next."""

NEAR_ENVELOPE = 0.01
"""A configuration whose value is below the best mix of the same power by less than this share is as good."""

PERIOD_SAMPLES = 48
HOME_TURN = 1.1
"""The way home is longer than straight by this factor: it begins with a turn."""

FLOOR_STD = 1e-6


class _Legs(NamedTuple):
    """Times and turning of a course's legs in the wind of the moment, the first leg's less what is flown of it."""

    times_s: FloatArray
    turning_s: FloatArray


@dataclass(frozen=True)
class Outcome:
    """What a course costs with a choice of computations: see `Record`."""

    remaining_s: float
    remaining_std_s: float
    energy_wh: float
    energy_std_wh: float
    soc_end: float
    soc_end_std: float


class JointPlanner(StaticPlanner):
    """One optimisation over path and computations to the end of the mission; see the module.

    Source: letter, Sec. VI (future work).
    """

    def __init__(self, settings: PlannerSettings, estimator: EstimatorSettings, mission: Mission) -> None:
        super().__init__(settings, estimator, mission)
        plan = mission.plan
        self._rho = plan.path_count
        self._boxes = [plan.hull(i) if plan.has_sets else None for i in range(self._rho)]
        self._open = [i for i, box in enumerate(self._boxes) if box is not None and not box.fixed]
        self._terrain = Terrain(
            plan,
            mission.computing,
            mission.battery,
            settings.weights,
            settings.levels,
            settings.trade_offs,
            settings.objective,
        )
        self._program = MissionProgram(len(self._open))
        self._z = NormalDist().inv_cdf(settings.reserve_probability)
        start = mission.start_m or (0.0, 0.0)
        self._follower = Follower(plan, mission.parameters, start, mission.rules)
        self._wind = WindFilter(mission.cruise_mps)
        self._wind_used: Point = (0.0, 0.0)
        self._known_wind: tuple[Point, float] | None = None
        self._ratio = TimeRatio()
        told_w = mission.energy.mean_w if mission.energy is not None else mission.motion_w
        self._motion = MotionPower(told_w)
        self._slope = 0.0
        self._charge = ChargeFilter()
        self._flown = Flown(len(plan.parameters))
        self._courses: dict[Shares, Course | None] = {}
        self._legs: dict[Shares, _Legs] = {}
        self._told: dict[Shares, tuple[Terms, Segments]] = {}
        self._shares = self._shares_of(mission.parameters)
        self._next_s = WARM_UP_S + settings.start_after_s
        self._stage_since_s = self._looked_s = 0.0
        self._last_s: float | None = None
        self._position: Point = start
        self._looked_at: tuple[float, float] | None = None
        self._sensitivity = (-math.inf, (0.0, 0.0))
        self._held_for: tuple[Vector, int] | None = None
        self._infeasible_since_s: float | None = None
        self._home_since_s: float | None = 0.0
        self._warm: FloatArray | None = None
        self._ended = False
        self._follower_moves = 0
        self._before_latch = self._follower.before_latch
        self._charge_s = 0.0
        self._drained_w = 0.0

    # --- what is seen

    def update(self, observation: Observation) -> Decision:
        """Take an observation; re-plan when it is time to, at a new stage, and at once when the charge jumps."""
        o = observation
        why = ""
        if o.stages_begun != self._stages_begun:
            self._begin_stage(o)
            why = NEW_STAGE
        self._hold(o)
        read = o.time_s >= self._next_reading_s - 1e-9
        if read:
            self._look(o)
        self._track(o)
        jumped = read and self._observe_charge(o)
        if jumped:
            why = JUMPED
        elif not why and o.time_s >= self._next_s - 1e-9:
            why = TIME
        if why and o.time_s >= min(WARM_UP_S, self._next_s) - 1e-9 and not self._ended:
            self._next_s = next_multiple(o.time_s, self._settings.every_s)
            self._replan(o, why)
        return self._decision

    def _look(self, o: Observation) -> None:
        """Wind from the velocity, and the leg's energy."""
        step_s = o.time_s - self._last_s if self._last_s is not None else 0.0
        self._last_s = o.time_s
        self._position = (o.x_m, o.y_m)
        if o.power_w is not None and step_s > 0:
            self._motion.observe(o.power_w - self._computing_w, step_s, self._slope)
        if o.wind_mps is not None:
            self._known_wind = (o.wind_mps, 0.0)
        elif o.velocity_mps is not None and step_s > 0:
            self._wind.observe(o.velocity_mps, o.heading_rad, step_s)

    def _observe_charge(self, o: Observation) -> bool:
        if math.isnan(self._charge.soc):
            self._charge_s = o.time_s
            return self._charge.observe(o.soc, 0.0)
        step_s = o.time_s - self._charge_s
        self._charge_s = o.time_s
        power = o.power_w if o.power_w is not None else self._drained_w
        self._drained_w = power
        b = self._mission.battery
        volts = b.voltage_at(min(max(self._charge.soc, 0.0), 1.0))
        root = math.sqrt(max(volts * volts - 4 * b.resistance_ohm * power, 0.0))
        drained = b.k_b_per_s / b.capacity_ah * 2 * power / (volts + root) * step_s
        return self._charge.observe(o.soc, 0.0 if b.prescribed else drained)

    def _hold(self, o: Observation) -> None:
        """Keep account of the parameters flown."""
        if self._held_for != (o.parameters, o.stage):
            self._held_for = (o.parameters, o.stage)
            self._flown.hold(o.time_s, o.parameters, self._mission.plan.stages[o.stage - 1].sets)

    def _begin_stage(self, o: Observation) -> None:
        """The follower goes on; what the leg took is learned from."""
        duration = o.time_s - self._stage_since_s
        self._stage_since_s = o.time_s
        course = self._in_force()
        if course is not None and len(course.legs) and self._follower_moves > 0:
            times, _ = course.times_s(self._mission.cruise_mps, self._wind_mps)
            if math.isfinite(times[0]) and times[0] > 0:
                self._ratio.learn(
                    float(times[0]), duration, self._wind.gust_std_mps, self._mission.cruise_mps, GUST_TIME_S
                )
        self._motion.end_spell(self._slope)
        try:
            for _ in range(o.stages_begun - self._stages_begun):
                self._follower.next_stage(o.parameters)
                self._follower_moves += 1
        except EadpError:
            self._ended = True
            return
        taken = self._courses.get(self._shares)
        self._courses.clear()
        self._legs.clear()
        if taken is not None and len(taken.legs) > 1 and taken.legs[1].stage.index == o.stage:
            self._courses[self._shares] = taken.after()
        self._before_latch = self._follower.before_latch
        course = self._in_force()
        if course is not None:
            times, turning = course.times_s(self._mission.cruise_mps, self._wind_mps)
            self._slope = float(turning[0] / times[0]) if 0 < times[0] < math.inf else 0.0

    # --- wind

    @property
    def _wind_mps(self) -> Point:
        """The wind to plan with: as estimated, in steps, so that times need not be told anew each second."""
        now = self._known_wind[0] if self._known_wind is not None else self._wind.wind_mps
        if math.dist(now, self._wind_used) > WIND_STEP_MPS:
            self._wind_used = now
            self._legs.clear()
        return self._wind_used

    def _wind_covariance(self) -> tuple[float, float, float]:
        if self._known_wind is not None:
            return self._known_wind[1] ** 2, self._known_wind[1] ** 2, 0.0
        return self._wind.covariance

    # --- courses

    def _shares_of(self, parameters: Vector) -> Shares:
        shares = []
        for i in self._open:
            box = self._boxes[i]
            assert box is not None
            shares.append(box.share(parameters[i]) or 0.0)
        return tuple(shares)

    def _parameters_of(self, shares: Shares) -> Vector:
        values = list(self._decision.parameters)
        for i, share in zip(self._open, shares, strict=True):
            box = self._boxes[i]
            assert box is not None
            values[i] = box.lo + share * (box.hi - box.lo)
        return tuple(values)

    def _course(self, shares: Shares) -> Course | None:
        if shares not in self._courses:
            same = shares == self._shares  # keep the numbers that were decided, not their rounding
            parameters = self._decision.parameters if same else self._parameters_of(shares)
            try:
                self._courses[shares] = self._follower.course(parameters)
            except PathUndefined:
                self._courses[shares] = None
        return self._courses[shares]

    def _in_force(self) -> Course | None:
        return self._course(self._shares)

    def _legs_of(self, shares: Shares, course: Course) -> _Legs:
        wind = self._wind_mps
        if shares not in self._legs:
            self._legs[shares] = _Legs(*course.times_s(self._mission.cruise_mps, wind))
        return self._legs[shares]

    # --- forecasts

    def _segments(self, shares: Shares, course: Course, o: Observation) -> Segments | None:
        """What is left of a course, in time and power of the motion."""
        whole, turning = self._legs_of(shares, course)
        if not np.isfinite(whole).all():
            return None
        elapsed = o.time_s - self._stage_since_s
        first = float(whole[0]) * self._ratio.ratio
        leg = course.legs[0]
        flown_m = leg.distance_m * min(1.0, elapsed / max(first, 1e-9))
        try:
            left = left_m(leg, (o.x_m, o.y_m), flown_m) / max(leg.distance_m, 1e-9)
        except PathUndefined:
            left = 1.0 - flown_m / max(leg.distance_m, 1e-9)
        part = np.ones(len(whole))
        part[0] = left
        times = whole * part * self._ratio.ratio
        bank = turning * part * self._ratio.ratio
        total_s = max(float(times.sum()), 1e-3)
        slopes = np.divide(turning, whole, out=np.zeros(len(whole)), where=whole > 0)
        motion = np.maximum(self._motion.level_w + self._motion.slope_w * slopes, 0.0)
        time_var = self._ratio.variance_s2(total_s) + total_s**2 * self._wind_share(course, o)
        energy_var = self._motion.energy_variance_j2(total_s, float(bank.sum()))
        return Segments(times, motion, motion + self._ripple_w(), math.sqrt(time_var), math.sqrt(energy_var))

    def _ripple_w(self) -> float:
        """How far the motion's power rises above its level within a lap [W]."""
        state = self._estimator.state_w
        if len(state) < 2 or not self.period_s:
            return 0.0
        angles = np.arange(PERIOD_SAMPLES) * (2 * math.pi / PERIOD_SAMPLES)
        orders = np.arange(1, len(state) // 2 + 1)[:, None]
        wave = state[1::2] @ np.cos(orders * angles) + state[2::2] @ np.sin(orders * angles)
        return max(float(wave.max()), 0.0)

    def _wind_share(self, course: Course, o: Observation) -> float:
        """Variance of the logarithm of the time by what is not known of the wind."""
        since, (gx, gy) = self._sensitivity
        if o.time_s - since >= SENSITIVITY_EVERY_S:
            wx, wy = self._wind_mps
            speed = self._mission.cruise_mps
            logs = [
                math.log(max(float(course.times_s(speed, (wx + dx, wy + dy))[0].sum()), 1e-9))
                for dx, dy in ((0.3, 0.0), (-0.3, 0.0), (0.0, 0.3), (0.0, -0.3))
            ]
            if all(math.isfinite(value) for value in logs):
                gx, gy = (logs[0] - logs[1]) / 0.6, (logs[2] - logs[3]) / 0.6
            self._sensitivity = (o.time_s, (gx, gy))
        pxx, pyy, pxy = self._wind_covariance()
        return max(gx * gx * pxx + 2 * gx * gy * pxy + gy * gy * pyy, 0.0)

    def _terms(self, shares: Shares, o: Observation) -> tuple[Terms, Segments] | None:
        if shares in self._told:
            return self._told[shares]
        course = self._course(shares)
        if course is None or not course.legs:
            return None
        segments = self._segments(shares, course, o)
        if segments is None:
            return None
        past = Past(self._flown.times_s, self._flown.areas_s)
        terms = self._terrain.terms(course, segments, past, self._soc, self._settings.reserve_soc)
        self._told[shares] = terms, segments
        return terms, segments

    def _prospect(self, shares: Shares, o: Observation) -> Prospect | None:
        told = self._terms(shares, o)
        if told is None:
            return None
        terms, segments = told
        course = self._courses[shares]
        assert course is not None
        margin = self._z * self._soc_std(terms, segments)
        available = self._soc - self._settings.reserve_soc - margin
        return Prospect(shares, course.shape, terms.steps, available)

    def _soc_std(self, terms: Terms, segments: Segments) -> float:
        """Standard deviation of the state of charge at the end."""
        energy_j2 = segments.energy_std_j**2 + (terms.mean_w * segments.time_std_s) ** 2
        return math.sqrt(terms.soc_per_j**2 * energy_j2 + self._charge.variance)

    @property
    def _soc(self) -> float:
        return self._charge.soc

    # --- decisions

    def _replan(self, o: Observation, why: str) -> None:
        self.report.replans += 1
        self._told.clear()
        started = time.perf_counter()
        try:
            answer, looked = self._answer(o, why)
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
        parameters = list(self._parameters_of(shares) if shares != self._shares else self._decision.parameters)
        told = self._terms(shares, o)
        assert told is not None
        terms, segments = told
        course = self._courses[shares]
        assert course is not None
        parameters[self._rho :] = self._computations(o, course, terms, answer, float(segments.times_s.sum()))
        chosen = tuple(parameters)
        reason = self._reason(o, answer, chosen, looked=looked)
        record = self._record(o, why, chosen, answer, terms, segments, reason)
        if shares != self._shares:
            self._shares = shares
        if chosen != self._decision.parameters:
            kept = {self._shares: course}
            self._follower.decide(chosen)
            self._courses = {**self._courses, **kept}
        self._decision = Decision(chosen, self._decision.power_forecast_w, reason, record)

    def _answer(self, o: Observation, why: str) -> tuple[Answer, bool]:
        """The best from here: with the path parameters kept, or with them looked at anew; and which of both."""
        here = self._prospect(self._shares, o)
        kept = best_at(here) if here is not None else None
        if not self._open:
            if kept is None:
                raise Infeasible("what is left of the plan cannot be flown in this wind")
            return self._solved(kept), False
        if kept is not None and why != JUMPED and not self._look_again(kept, why):
            return self._solved(kept), False
        found = self._program.solve(lambda shares: self._prospect(shares, o), self._shares)
        self._looked_at = _left_over(found)
        if kept is not None and kept.allocation.feasible:
            better = found.value > kept.value + self._settings.keep_gain
            if not better:
                self._looked_at = _left_over(kept)
            return (found, True) if better else (self._solved(kept), True)
        if kept is not None and not found.allocation.feasible and found.short > kept.short - 1e-6:
            return kept, True
        return found, True

    def _solved(self, kept: Answer) -> Answer:
        """The computations at the path parameters kept: by QPs where the settings ask for them."""
        if self._settings.solver != "qp" or not kept.allocation.feasible:
            return kept
        answer = self._program.allocated(kept.prospect, self._warm)
        self._warm = answer.allocation.shares
        return answer

    def _look_again(self, kept: Answer, why: str) -> bool:
        """Whether path parameters are to be looked at again: they can take effect, and what is left has changed."""
        if not kept.allocation.feasible and self._infeasible_since_s is None:
            return True
        if why != NEW_STAGE or not self._before_latch:
            return False
        if self._looked_at is None:
            return True
        (value, over), (then_value, then_over) = _left_over(kept), self._looked_at
        return abs(value - then_value) > LOOK_AGAIN_VALUE or abs(over - then_over) > LOOK_AGAIN_SOC

    def _computations(
        self, o: Observation, course: Course, terms: Terms, answer: Answer, remaining_s: float
    ) -> list[float]:
        """The computations to fly with now: those that last to the end, with hysteresis."""
        sets = self._mission.plan.stages[o.stage - 1].sets
        now = list(self._decision.parameters[self._rho :])
        if not now:
            return now
        menu = terms.menus[0]
        if not answer.allocation.feasible:
            return [float(value) for value in menu.configurations[0]]
        target_w = _lasting_w(terms, answer, remaining_s)
        configurations, powers = self._terrain.configurations(sets, course.parameters[0])
        values = self._terrain.values(configurations, sets, terms.worth[self._rho :])
        span = max(float(menu.values[-1] - menu.values[0]), 1e-300)
        envelope = np.interp(powers, menu.powers_w, menu.values)
        near = (values >= envelope - NEAR_ENVELOPE * span) & (powers <= menu.powers_w[-1] + 1e-9)
        near |= np.isin(powers, menu.powers_w)
        choices = np.nonzero(near)[0]
        # among them by power; what is flown now is one of them, or the next one below
        ladder = powers[choices]
        held = int(np.searchsorted(ladder, self._power_of(now, course) + 1e-9, side="right")) - 1
        lasting = max(int(np.searchsorted(ladder, target_w + 1e-9, side="right")) - 1, 0)
        held = min(max(held, 0), len(ladder) - 1)
        if lasting > held:
            rise = ladder[lasting] - ladder[lasting - 1]
            if target_w < ladder[lasting] + RISE * rise:
                lasting -= 1
            lasting = max(lasting, held)
        elif lasting < held and held - lasting == 1:
            fall = ladder[held] - ladder[lasting]
            if target_w > ladder[held] - FALL * fall:
                lasting = held
        if lasting == held and np.array_equal(configurations[choices[held]], now):
            return now
        best = choices[powers[choices] <= ladder[lasting] + 1e-12]
        return [float(value) for value in configurations[best[int(np.argmax(values[best]))]]]

    def _power_of(self, values: list[float], course: Course) -> float:
        own = (*course.parameters[0][: self._rho], *values)
        boxes = course.legs[0].stage.sets
        clipped = tuple(box.clip(value) for box, value in zip(boxes, own, strict=True))
        return self._mission.computing.power_w(clipped, boxes)

    # --- what is told

    def _reason(self, o: Observation, answer: Answer, chosen: Vector, *, looked: bool) -> str:
        if not answer.allocation.feasible:
            if self._infeasible_since_s is None:
                self._infeasible_since_s = o.time_s
            volts = self._mission.battery.voltage_at(max(self._soc, 0.0))
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

    def _record(
        self,
        o: Observation,
        why: str,
        chosen: Vector,
        answer: Answer,
        terms: Terms,
        segments: Segments,
        reason: str,
    ) -> Record:
        outcome = self._outcome(terms, segments, answer)
        b = self._mission.battery
        reserve = self._settings.reserve_soc
        std = max(outcome.soc_end_std, FLOOR_STD)
        volts = b.voltage_at((self._soc + reserve) / 2)
        reachable, lost = self._home(o, terms, segments)
        return Record(
            time_s=o.time_s,
            why=why,
            stage=o.stage,
            lap=self._follower.lap,
            parameters=chosen,
            remaining_s=outcome.remaining_s,
            remaining_std_s=outcome.remaining_std_s,
            energy_wh=outcome.energy_wh,
            energy_std_wh=outcome.energy_std_wh,
            available_wh=max(self._soc - reserve, 0.0) * b.capacity_ah * volts,
            soc_end=outcome.soc_end,
            soc_end_std=outcome.soc_end_std,
            completes_probability=NormalDist().cdf(outcome.soc_end / std),
            reserve_probability=NormalDist().cdf((outcome.soc_end - reserve) / std),
            quality_ahead=answer.value if self._settings.objective == "quality" else None,
            wind_mps=self._wind_mps,
            passes=answer.passes,
            status=answer.status,
            reason=reason,
            home_reachable=reachable,
            point_of_no_return_s=lost,
        )

    def _outcome(self, terms: Terms, segments: Segments, answer: Answer) -> Outcome:
        total_s = float(segments.times_s.sum())
        computing_j = computing_energy_j(terms, segments, answer)
        energy_j = float(segments.motion_w @ segments.times_s) + computing_j
        mean_w = energy_j / max(total_s, 1e-9)
        std_j = math.hypot(segments.energy_std_j, mean_w * segments.time_std_s)
        return Outcome(
            total_s,
            segments.time_std_s,
            energy_j / 3600,
            std_j / 3600,
            self._soc - answer.allocation.use,
            self._soc_std(terms, segments),
        )

    def _home(self, o: Observation, terms: Terms, segments: Segments) -> tuple[bool | None, float | None]:
        """Whether home can be reached with the reserve kept, and where not, when it last could [s]."""
        home = self._mission.home_m
        if home is None:
            return None, None
        dx, dy = home[0] - o.x_m, home[1] - o.y_m
        distance = math.hypot(dx, dy)
        reachable = distance < 1.0
        if not reachable:
            wx, wy = self._wind_mps
            tail, cross = (wx * dx + wy * dy) / distance, (wx * dy - wy * dx) / distance
            square = self._mission.cruise_mps**2 - cross**2
            speed = tail + math.sqrt(square) if square > 0 else 0.0
            if speed > 0:
                seconds = HOME_TURN * distance / speed
                lowest_w = min(float(menu.powers_w[0]) for menu in terms.menus)
                power = float(np.min(segments.motion_w)) + lowest_w
                reachable = self._soc - self._settings.reserve_soc >= seconds * power * terms.soc_per_j
        if reachable:
            self._home_since_s = o.time_s
            return True, None
        return False, self._home_since_s


def computing_energy_j(terms: Terms, segments: Segments, answer: Answer) -> float:
    """Energy of the computations to the end as allocated [J]."""
    least = float(sum(menu.powers_w[0] * t for menu, t in zip(terms.menus, segments.times_s.tolist(), strict=True)))
    steps, shares = terms.steps, answer.allocation.shares
    more = 0.0
    for segment, level, share in zip(steps.segment.tolist(), steps.level.tolist(), shares.tolist(), strict=True):
        if share:
            powers = terms.menus[segment].powers_w
            more += share * float(powers[level + 1] - powers[level]) * float(segments.times_s[segment])
    return least + more


def _lasting_w(terms: Terms, answer: Answer, remaining_s: float) -> float:
    """The mean power of the computations over the legs that are like this one, as allocated [W].

    Flown all the time, it uses what the best mix in time uses.
    """
    menu: Menu = terms.menus[0]
    steps, shares = terms.steps, answer.allocation.shares
    alike = np.array([other.powers_w is menu.powers_w for other in terms.menus])
    power = float(menu.powers_w[0])
    mine = alike[steps.segment] if len(steps.segment) else np.zeros(0, dtype=bool)
    for level in range(len(menu.powers_w) - 1):
        chosen = mine & (steps.level == level)
        use = float(steps.use[chosen].sum())
        if use > 0:
            taken = float((steps.use[chosen] * shares[chosen]).sum()) / use
            power += taken * float(menu.powers_w[level + 1] - menu.powers_w[level])
    # what is left over beyond the highest, spread over all that is left
    over = answer.prospect.available - answer.allocation.use
    return power + max(over, 0.0) / max(terms.soc_per_j * remaining_s, 1e-12)


def _left_over(answer: Answer) -> tuple[float, float]:
    """What a plan is worth, and the state of charge that it leaves over."""
    return answer.value, answer.prospect.available - answer.allocation.use

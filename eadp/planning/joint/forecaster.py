"""What the rest of a mission will take: time, energy and charge for any parameters, and how sure that is.

What is left to fly comes from the plan's own geometry in the wind as estimated, corrected by how long legs took so far;
the motion's power from what was flown; the state of charge at the end through the battery. Each comes with its spread.
"""

from __future__ import annotations

import math
from functools import lru_cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.compiled import jitted
from eadp.core.flight.wind import GUST_TIME_S, WindFilter
from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.legs import left_m
from eadp.models.plan.route import MARGIN_M, Route, RoutePredictor
from eadp.planning.base import Mission, Observation, PlannerSettings, Readings
from eadp.planning.estimation.regressions import ChargeFilter, MotionPower, ParameterAverages, TimeRatio
from eadp.planning.joint.program import Candidate, Shares, Solution
from eadp.planning.joint.settings import JointSettings
from eadp.planning.joint.terms import FlownShares, KnapsackTerms, RouteLoad, TermBuilder

WIND_STEP_MPS = 0.02
"""A wind that has changed by less is planned with as before."""

SENSITIVITY_EVERY_S, WIND_DIFFERENCE_MPS = 10.0, 0.3
PERIOD_SAMPLES = 48
HOME_TURN = 1.1
"""The way home is longer than straight by this factor: it begins with a turn."""

ALIKE_STDS = 0.1
"""Plans whose charge at the end differs by less, in standard deviations, are as safe: probabilities differ by four
points at most, near 0.95 by one."""

LEAST_STD = 1e-6
TOLD_FOR_S = 60.0
"""A wind that is told counts for so long."""

OFF_PATH_S, MOST_OFF_PATH_M = 60.0, 10.0
"""Over how long the distance from the path is taken, and how far off counts as that far: what is farther is joining."""


class Forecast(NamedTuple):
    """What a mission's rest takes with given parameters: see `planner.DecisionRecord`.

    `stages` tells time [s] and energy [Wh] of each stage of the plan, all its laps together.
    """

    remaining_s: float
    remaining_std_s: float
    energy_wh: float
    energy_std_wh: float
    soc_end: float
    soc_end_std: float
    reserve_soc: float
    stages: dict[int, tuple[float, float]]

    @property
    def completes_probability(self) -> float:
        """That the battery is not empty before the end."""
        return NormalDist().cdf(self.soc_end / max(self.soc_end_std, LEAST_STD))

    @property
    def reserve_probability(self) -> float:
        """That the reserve is kept."""
        return NormalDist().cdf((self.soc_end - self.reserve_soc) / max(self.soc_end_std, LEAST_STD))


class Forecaster:
    """Follows a flight and tells what its rest takes; see the module.

    Parameters
    ----------
    settings : PlannerSettings
        The reserve, weights and levels are used here.
    mission : Mission
    own : JointSettings, optional
        Probability of the reserve, trade-offs and objective. Default: its defaults.
    margin_m : float
        By how much the end of the plan has to be passed to be counted on [m], at least.

    Attributes
    ----------
    open : list of int
        Path parameters that leave a choice; `Shares` are those of their boxes, in this order.
    shares : tuple of float
        Those decided.
    """

    def __init__(
        self,
        settings: PlannerSettings,
        mission: Mission,
        own: JointSettings | None = None,
        margin_m: float = MARGIN_M,
    ) -> None:
        own = own or JointSettings()
        plan = mission.plan
        self._settings, self._mission, self._plan = settings, mission, plan
        self._boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
        self.open = [i for i, box in enumerate(self._boxes) if not box.fixed]
        self.terrain = _term_builder(settings, own, mission)
        self._z = NormalDist().inv_cdf(own.reserve_probability)
        self._speed = mission.cruise_mps
        self._position: Point = mission.start_m or (0.0, 0.0)
        self._predictor = RoutePredictor()
        self._cursor = PlanCursor.start(plan, mission.parameters, mission.rules)
        self._joined = self._position
        self._least_margin_m = self._margin_m = margin_m
        self._wind = WindFilter(mission.cruise_mps)
        self._wind_used: Point = (0.0, 0.0)
        self._known_wind: Point | None = None
        self._known_until_s = -math.inf
        self._ratio = TimeRatio()
        self._motion = MotionPower(mission.energy.mean_w if mission.energy is not None else mission.motion_w)
        self._slope = 0.0
        self._charge = ChargeFilter()
        self._flown = ParameterAverages(len(plan.parameters))
        self._held_for: tuple[Vector, int] | None = None
        self._decided = mission.parameters
        self.shares = self._shares_of(mission.parameters)
        self._courses: dict[Shares, Route | None] = {}
        self._times: dict[Shares, tuple[FloatArray, FloatArray]] = {}
        self._told: dict[Shares, tuple[KnapsackTerms, RouteLoad] | None] = {}
        self._time_s = self._stage_since_s = self._charge_s = 0.0
        self._last_s: float | None = None
        self._sensitivity = (-math.inf, (0.0, 0.0))
        self._ripple_w = 0.0
        self._off_path_m2 = 0.0
        self._power_w = 0.0
        self._stages_started = 1
        self._home_s: float | None = 0.0
        self.before_latch = self._cursor.accepts_changes()

    # --- what is seen

    @property
    def lap(self) -> int:
        """Laps flown before this one."""
        return self._cursor.lap

    @property
    def soc(self) -> float:
        """State of charge, freed from the gauge's noise."""
        return self._charge.soc

    @property
    def wind_mps(self) -> Point:
        """The wind to plan with [m/s]: as given, else as estimated, in small steps."""
        now = self._known_wind if self._known_wind is not None else self._wind.wind_mps
        if math.dist(now, self._wind_used) > WIND_STEP_MPS:
            self._wind_used = now
            self._times.clear()
        return self._wind_used

    def see(self, o: Observation) -> bool:
        """Take note of stage and parameters; return whether a new stage has begun."""
        begun = o.stages_started != self._stages_started
        rho = self._plan.path_count
        if begun:
            self._begin_stage(o)
        elif not o.cursor.table.live and o.cursor.waiting[:rho] != self._cursor.waiting[:rho]:
            self._routes_change()  # other path parameters are in force than was decided
        self._cursor, self._joined = o.cursor, o.joined_m
        if self._held_for != (o.parameters, o.stage):
            self._held_for = (o.parameters, o.stage)
            self._flown.hold(o.time_s, o.parameters, o.cursor.stage.sets)
        return begun

    def read(self, o: Observation, computing_w: float) -> bool:
        """Take readings: wind from the velocity, the motion's power, the charge; return whether the charge has jumped.

        Parameters
        ----------
        o : Observation
        computing_w : float
            What of the power is the computations' [W].
        """
        step_s = self._since(o.time_s)
        self._off_path((o.x_m, o.y_m), step_s)
        if o.power_w is not None and step_s > 0:
            self._motion.observe(o.power_w - computing_w, step_s, self._slope)
        if o.wind_mps is not None:
            self._known_wind, self._known_until_s = o.wind_mps, o.time_s + TOLD_FOR_S
        elif o.time_s > self._known_until_s:
            self._known_wind = None
        if o.wind_mps is None and o.velocity_mps is not None and step_s > 0:
            self._wind.observe(o.velocity_mps, o.heading_rad, step_s)
        return self._read_charge(o.time_s, o.power_w, o.soc)

    def read_all(self, readings: Readings, computing_w: float) -> bool:
        """Take readings one after the other, see `read`; return whether the charge has jumped in any."""
        times = readings.times_s
        steps = [self._since(time_s) for time_s in times]
        for x, y, step_s in zip(readings.x_m, readings.y_m, steps, strict=True):
            self._off_path((x, y), step_s)
        first = 0 if steps[0] > 0 else 1  # before the first of all nothing is known to have lasted
        self._wind.observe_batch(
            readings.vx_mps[first:], readings.vy_mps[first:], readings.headings_rad[first:], steps[first:]
        )
        jumped = False
        for time_s, step_s, power_w, soc in zip(times, steps, readings.powers_w, readings.charges, strict=True):
            if power_w is not None and step_s > 0:
                self._motion.observe(power_w - computing_w, step_s, self._slope)
            jumped |= self._read_charge(time_s, power_w, soc)
        if times[-1] > self._known_until_s:
            self._known_wind = None
        return jumped

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the charge, `soc` now, may have jumped: the next reading will tell."""
        return self._charge.is_ambiguous(soc)

    def _since(self, time_s: float) -> float:
        """How long after the last readings these are [s]."""
        step_s = time_s - self._last_s if self._last_s is not None else 0.0
        self._last_s = time_s
        return step_s

    def _off_path(self, position: Point, step_s: float) -> None:
        """Take a position, and how far it is off the path: by twice that the end of the plan has to be passed."""
        self._position = position
        course = self._courses.get(self.shares)
        if course is None or not course.legs or step_s <= 0:
            return
        leg = course.legs[0]
        try:
            phi, gx, gy, *_ = leg.path(position[0] - leg.offset_m[0], position[1] - leg.offset_m[1])
        except (ArithmeticError, ValueError):
            return
        square = gx * gx + gy * gy
        if square > 0 and math.isfinite(phi):
            share = min(1.0, step_s / OFF_PATH_S)
            self._off_path_m2 += share * (min(phi * phi / square, MOST_OFF_PATH_M**2) - self._off_path_m2)

    def assume(self, wind_mps: Point, gust_std_mps: float, soc: float) -> None:
        """Before take-off: the wind of the weather forecast [m/s], its gusts, and the state of charge."""
        self._known_wind, self._known_until_s = wind_mps, math.inf
        self._ratio.expect(gust_std_mps, self._speed, GUST_TIME_S)
        self._charge.observe(soc, 0.0)

    def _read_charge(self, time_s: float, power_w: float | None, soc: float) -> bool:
        if math.isnan(self._charge.soc):
            self._charge_s = time_s
            return self._charge.observe(soc, 0.0)
        step_s = time_s - self._charge_s
        self._charge_s = time_s
        if power_w is not None:
            self._power_w = power_w
        b = self._mission.battery
        volts = b.voltage_at(min(max(self._charge.soc, 0.0), 1.0))
        drained = 0.0 if b.prescribed else float(b.drain_per_s(self._power_w, volts)) * step_s
        return self._charge.observe(soc, drained)

    def _begin_stage(self, o: Observation) -> None:
        """Go on to the next stage; what the last leg took is learned from, but for the first, which began anywhere."""
        duration = o.time_s - self._stage_since_s
        self._stage_since_s = o.time_s
        course = self._course(self.shares)
        if course is not None and self._stages_started > 1:
            forecast_s = float(course.times_s(self._speed, self.wind_mps)[0][0])
            self._ratio.learn(forecast_s, duration, self._wind.gust_std_mps, self._speed, GUST_TIME_S)
        self._motion.end_window(self._slope)
        self._margin_m = max(self._least_margin_m, 2 * math.sqrt(self._off_path_m2))
        self._stages_started = o.stages_started
        self._cursor, self._joined = o.cursor, o.joined_m
        self._routes_change()
        rho = self._plan.path_count
        if (
            course is not None
            and len(course.legs) > 1
            and course.legs[1].stage.index == o.stage
            and course.parameters[1][:rho] == o.parameters[:rho]
        ):
            self._courses[self.shares] = course.after()
        self.before_latch = self._cursor.accepts_changes()
        course = self._course(self.shares)
        if course is not None and course.legs:
            times, turning = course.times_s(self._speed, self.wind_mps)
            self._slope = float(turning[0] / times[0]) if 0 < times[0] < math.inf else 0.0

    def hold(self, settings: PlannerSettings, parameters: Vector) -> None:
        """Forecast with other settings and parameters from now on."""
        self._settings, self.terrain = settings, _term_builder(settings, JointSettings(), self._mission)
        self.decide(parameters, self._shares_of(parameters))

    def _routes_change(self) -> None:
        """What is left of the plan has changed for all parameters."""
        self._courses.clear()
        self._times.clear()
        self._told.clear()

    def decide(self, parameters: Vector, shares: Shares) -> None:
        """Parameters have been decided."""
        if parameters == self._decided:
            return
        self._decided, self.shares = parameters, shares

    # --- courses

    def _shares_of(self, parameters: Vector) -> Shares:
        return tuple(self._boxes[i].share(parameters[i]) or 0.0 for i in self.open)

    def parameters_of(self, shares: Shares) -> Vector:
        """Parameters with the path's at shares of their boxes, computations as decided."""
        if shares == self.shares:  # as decided, not as rounded
            return self._decided
        values = list(self._decided)
        for i, share in zip(self.open, shares, strict=True):
            values[i] = self._boxes[i].lo + share * (self._boxes[i].hi - self._boxes[i].lo)
        return tuple(values)

    def course(self, shares: Shares) -> Route:
        """What is left to fly; only for shares that `prospect` has told of."""
        course = self._courses[shares]
        assert course is not None
        return course

    def _course(self, shares: Shares) -> Route | None:
        if shares not in self._courses:
            # what has been decided had the margin then, and is not doubted each time that the margin grows
            margin_m = min(0.0, self._margin_m) if shares == self.shares else self._margin_m
            cursor = self._cursor.decide(self.parameters_of(shares))
            try:
                self._courses[shares] = self._predictor.route(cursor, self._joined, margin_m)
            except PathUndefined:
                self._courses[shares] = None
        return self._courses[shares]

    # --- forecasts

    def at(self, time_s: float, position: Point, ripple_w: float) -> None:
        """Forecast from a moment and a place on; the motion's power rises above its mean by `ripple_w` within a lap."""
        self._time_s, self._position, self._ripple_w = time_s, position, ripple_w
        self._told.clear()

    def told(self, shares: Shares) -> tuple[KnapsackTerms, RouteLoad] | None:
        """The program's terms and the segments at shares; None where the plan cannot be flown at them."""
        if shares not in self._told:
            course = self._course(shares)
            segments = self._segments(shares, course) if course is not None and course.legs else None
            if course is None or segments is None:
                self._told[shares] = None
            else:
                past = FlownShares(*self._flown.until(self._time_s))
                terms = self.terrain.terms(course, segments, past, self.soc, self._settings.reserve_soc)
                self._told[shares] = terms, segments
        return self._told[shares]

    def prospect(self, shares: Shares) -> Candidate | None:
        """What the program is to know of the rest at shares: its margin is z standard deviations of the charge."""
        told = self.told(shares)
        if told is None:
            return None
        terms, segments = told
        std = self._soc_std(terms, segments)
        available = self.soc - max(self._settings.reserve_soc, terms.least_soc) - self._z * std
        if terms.beyond_w > 0:
            available = -math.inf
        return Candidate(shares, self.course(shares).shape, terms.steps, available, ALIKE_STDS * std)

    def forecast(self, answer: Solution) -> Forecast:
        """What the rest takes as planned."""
        told = self.told(answer.prospect.shares)
        assert told is not None
        terms, segments = told
        powers = segments.motion_w + _computing_w(terms, answer)
        energies_wh = powers * segments.times_s / 3600
        mean_w = float(powers @ segments.times_s) / max(float(segments.times_s.sum()), 1e-9)
        of_leg = self.course(answer.prospect.shares).stages
        seconds, of_stage_wh = (np.bincount(of_leg, values) for values in (segments.times_s, energies_wh))
        stages = {i: (float(seconds[i]), float(of_stage_wh[i])) for i in np.unique(of_leg).tolist()}
        return Forecast(
            remaining_s=float(segments.times_s.sum()),
            remaining_std_s=segments.time_std_s,
            energy_wh=float(energies_wh.sum()),
            energy_std_wh=math.hypot(segments.energy_std_j, mean_w * segments.time_std_s) / 3600,
            soc_end=self.soc - answer.allocation.use,
            soc_end_std=self._soc_std(terms, segments),
            reserve_soc=self._settings.reserve_soc,
            stages=stages,
        )

    def _segments(self, shares: Shares, course: Route) -> RouteLoad | None:
        """What is left of a course, in time and power of the motion; None where it cannot be flown in this wind."""
        wind = self.wind_mps
        if shares not in self._times:
            self._times[shares] = course.times_s(self._speed, wind)
        whole, turning = self._times[shares]
        if not math.isfinite(whole.sum()):
            return None
        left, motion = self._left(course, float(whole[0])), self._motion
        times, motion_w, total_s, bank_s = jitted(_left_of)(
            whole, turning, left, self._ratio.ratio, motion.level_w, motion.slope_w
        )
        time_var = self._ratio.variance_s2(total_s) + total_s**2 * self._wind_share(course)
        energy_var = self._motion.energy_variance_j2(total_s, bank_s)
        return RouteLoad(times, motion_w, motion_w + self._ripple_w, math.sqrt(time_var), math.sqrt(energy_var))

    def _left(self, course: Route, whole_s: float) -> float:
        """The share of the first leg that is left: by the position, told apart from other turns by the time."""
        leg = course.legs[0]
        flown = min(1.0, (self._time_s - self._stage_since_s) / max(whole_s * self._ratio.ratio, 1e-9))
        if leg.distance_m <= 0:
            return 0.0
        try:
            early_m = self._plan.trigger_radius_m if self._stages_started > 1 else 0.0
            return left_m(leg, self._position, flown * leg.distance_m, early_m) / leg.distance_m
        except PathUndefined:
            return 1.0 - flown

    def _wind_share(self, course: Route) -> float:
        """Variance of the logarithm of the time by what is not known of the wind."""
        if self._known_wind is not None:
            return 0.0
        since, (gx, gy) = self._sensitivity
        if self._time_s - since >= SENSITIVITY_EVERY_S:
            (wx, wy), d = self.wind_mps, WIND_DIFFERENCE_MPS
            logs = [
                math.log(max(float(course.times_s(self._speed, (wx + dx, wy + dy))[0].sum()), 1e-9))
                for dx, dy in ((d, 0.0), (-d, 0.0), (0.0, d), (0.0, -d))
            ]
            if all(math.isfinite(value) for value in logs):
                gx, gy = (logs[0] - logs[1]) / (2 * d), (logs[2] - logs[3]) / (2 * d)
            self._sensitivity = (self._time_s, (gx, gy))
        pxx, pyy, pxy = self._wind.covariance
        return max(gx * gx * pxx + 2 * gx * gy * pxy + gy * gy * pyy, 0.0)

    def _soc_std(self, terms: KnapsackTerms, segments: RouteLoad) -> float:
        """Standard deviation of the state of charge at the end."""
        energy_j2 = segments.energy_std_j**2 + (terms.mean_w * segments.time_std_s) ** 2
        return math.sqrt(terms.soc_per_j**2 * energy_j2 + self._charge.variance)

    def home(self, answer: Solution) -> tuple[bool | None, float | None]:
        """Whether home can be reached with the reserve kept; where not, when it last could [s]. None without one."""
        home = self._mission.home_m
        told = self.told(answer.prospect.shares)
        if home is None or told is None:
            return None, None
        terms, segments = told
        dx, dy = home[0] - self._position[0], home[1] - self._position[1]
        distance = math.hypot(dx, dy)
        reachable = distance < 1.0
        if not reachable:
            wx, wy = self.wind_mps
            tail, cross = (wx * dx + wy * dy) / distance, (wx * dy - wy * dx) / distance
            square = self._speed**2 - cross**2
            speed = tail + math.sqrt(square) if square > 0 else 0.0
            if speed > 0:
                lowest_w = min(float(menu.powers_w[0]) for menu in terms.kinds)
                energy_j = HOME_TURN * distance / speed * (float(segments.motion_w.min()) + lowest_w)
                reachable = self.soc - self._settings.reserve_soc >= energy_j * terms.soc_per_j
        if reachable:
            self._home_s = self._time_s
            return True, None
        return False, self._home_s


def _term_builder(settings: PlannerSettings, own: JointSettings, mission: Mission) -> TermBuilder:
    return TermBuilder(
        mission.plan,
        mission.computing,
        mission.battery,
        settings.weights,
        settings.levels,
        own.trade_offs,
        own.objective,
    )


def _left_of(
    whole_s: FloatArray, turning_s: FloatArray, left: float, ratio: float, level_w: float, slope_w: float
) -> tuple[FloatArray, FloatArray, float, float]:
    """Times [s] and the motion's powers [W] of legs, of whose first a share is left; time and ∫ tan² φ in all [s].

    Written in that part of numpy that may be compiled, see `eadp.core.compiled`.
    """
    times_s = whole_s * ratio
    times_s[0] *= left
    bank_s = (turning_s.sum() - (1.0 - left) * turning_s[0]) * ratio
    slopes = turning_s / np.where(whole_s > 0.0, whole_s, 1.0)
    return times_s, np.maximum(level_w + slope_w * slopes, 0.0), max(times_s.sum(), 1e-3), bank_s


def _computing_w(terms: KnapsackTerms, answer: Solution) -> FloatArray:
    """Mean power of the computations on each segment as allocated, shape (segments,) [W]."""
    more = np.bincount(terms.steps.segment, answer.allocation.shares * terms.rises_w, len(terms.kind_of))
    return terms.lowest_w + more


def ripple_w(state_w: FloatArray) -> float:
    """How far the motion's power rises above its level within a lap [W], of an energy state q."""
    if len(state_w) < 3:
        return 0.0
    cosines, sines = _waves(len(state_w) // 2)
    wave = state_w[1::2] @ cosines + state_w[2::2] @ sines
    return max(float(wave.max()), 0.0)


@lru_cache
def _waves(order: int) -> tuple[FloatArray, FloatArray]:
    """Cosine and sine of each harmonic over a period, shape (order, samples)."""
    angles = np.arange(1, order + 1)[:, None] * (np.arange(PERIOD_SAMPLES) * (2 * math.pi / PERIOD_SAMPLES))
    return np.cos(angles), np.sin(angles)

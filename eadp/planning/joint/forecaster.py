"""Forecast of the rest of a mission at any parameters: time, energy and final state of charge, with their variances.

The route to the end comes from the plan's geometry; its time from the estimated wind and the ratio of measured to
forecast times of the legs flown; the motion's power from a regression on the readings; the final state of charge from
the battery model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.compiled import enabled
from eadp.core.flight.battery import drain_per_s
from eadp.core.flight.wind import WindFilter
from eadp.core.geometry.curves import Point
from eadp.core.geometry.tracks import Nodes
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.leg_table import leg_times_s
from eadp.models.plan.legs import left_m
from eadp.models.plan.route import MARGIN_M, Route, RoutePredictor
from eadp.planning.base import HOME_RADII, Mission, Observation, PlannerSettings, Readings
from eadp.planning.estimation.power_gate import MAX_OF_MOTOR, PowerGate
from eadp.planning.estimation.regressions import Charge, ChargeFilter, MotionPower, ParameterAverages, TimeRatio
from eadp.planning.joint import kernels
from eadp.planning.joint.climb import ClimbForecast
from eadp.planning.joint.kernels import EXPECTED, MOTION, PEAK, TIMES
from eadp.planning.joint.place_kernel import (
    FEASIBLE,
    MIN_STD,
    NO_ENDS,
    ROUNDING,
    SAME_SOC,
    UNFLYABLE,
    UNKNOWN,
    Found,
    Now,
    find_place,
)
from eadp.planning.joint.program import Candidate, Place, Shares, Solution, place_of
from eadp.planning.joint.settings import JointSettings
from eadp.planning.joint.terms import TOTAL, FlownShares, KnapsackTerms, RouteLoad, TermBuilder
from eadp.planning.state.heading_gate import HEADING_DISBELIEVED, HeadingGate

WIND_STEP_MPS = 0.02
"""A smaller change of the estimated wind is ignored."""

SENSITIVITY_EVERY_S, WIND_DIFFERENCE_MPS = 10.0, 0.3
PERIOD_SAMPLES = 48
AT_HOME_M = 1.0
"""Distance at which the aircraft is at home [m]."""

ALIKE_STDS = 0.1
"""Plans whose final charge differs by less, in standard deviations, are equally safe: probabilities differ by at most
four points, near 0.95 by one."""

NAVIGATION_M, NAVIGATION_STDS = (0.25, 10.0), 2.5
"""Least and greatest standard deviation of how far the aircraft reaches [m]; ends that it passes, or misses, by more
than so many are certain."""

LOSS, LOSS_SQUARE = 0.07, (0.12**3 - 0.02**3) / 3 / 0.1
"""Mean and mean square of a loss of charge, uniform in 2 to 12 %; losses are a Poisson process."""

PASSED_S = 3.0
"""An end that has been passed for this long without the flight having ended there is none [s]."""

MAX_STEP_S = 10.0
"""Time between readings above which the power in it is not measured [s]."""

MAX_AIRSPEEDS = 5.0
"""Ratio of a measured airspeed to that of cruise, or the inverse, above which it is false."""

MEASURED_WIND_S = 60.0
"""How long a measured wind is used [s]."""

GAUGE_STUCK, GAUGE_RISES, POWER_OUTLIER = "gauge-stuck", "gauge-rises", "power-outlier"
"""Codes of warnings: the gauge is disbelieved, as it does not fall or rises; the last reading of power is false."""

BOUND_SLACK = 0.9
"""Times at values between the ends of a parameter's set lie between those at the ends, up to this factor."""

OFF_PATH_S, MEDIAN_PER_STD = 30.0, 0.6745
"""Time constant of the median cross-track error [s], and the median of a normal variable's size per its deviation."""


class FinalCharge(NamedTuple):
    """State of charge at the end: a normal distribution for each end that the flight may have, of one variance.

    Attributes
    ----------
    std : float
    shares, means : tuple of float
        Probability of each end, and its mean.
    """

    std: float = MIN_STD
    shares: tuple[float, ...] = (1.0,)
    means: tuple[float, ...] = (0.0,)

    @property
    def mean(self) -> float:
        """Mean over all ends."""
        return _moments(self.shares, self.means)[0]

    @property
    def variance(self) -> float:
        """Variance over all ends."""
        return self.std**2 + _moments(self.shares, self.means)[1]

    def probability_above(self, soc: float) -> float:
        """Probability of a state of charge above one."""
        scale = max(self.std, MIN_STD) * math.sqrt(2.0)
        above = 0.0
        for share, mean in zip(self.shares, self.means, strict=True):
            above += share * math.erfc((soc - mean) / scale)
        return above / 2

    def level(self, probability: float) -> float:
        """State of charge above which it is with a probability."""
        quantile = NormalDist().inv_cdf(probability) * self.std
        low, high = min(self.means) - quantile, max(self.means) - quantile
        while high - low > SAME_SOC:
            middle = (low + high) / 2
            low, high = (middle, high) if self.probability_above(middle) > probability else (low, middle)
        return low


class Forecast(NamedTuple):
    """Forecast of the rest of a mission at given parameters, see `DecisionRecord`.

    Means and standard deviations are over all the ends that the flight may have, whose charges are `ends`. At
    `empty_soc` the battery is empty: the cut-off voltage is reached.
    """

    remaining_s: float
    remaining_std_s: float
    energy_wh: float
    energy_std_wh: float
    soc_end: float
    soc_end_std: float
    reserve_soc: float
    empty_soc: float = 0.0
    ends: FinalCharge = FinalCharge()

    @property
    def completes_probability(self) -> float:
        """Probability that the battery is not empty before the end."""
        return self.ends.probability_above(self.empty_soc)

    @property
    def reserve_probability(self) -> float:
        """Probability that the reserve is kept."""
        return self.ends.probability_above(max(self.reserve_soc, self.empty_soc))


class _Times(NamedTuple):
    """Of a parameter: its weight, the time flown with a choice of it and the time integral of its share [s], and the
    least and greatest time ahead in which it has a choice [s]."""

    weight: float
    flown_s: float
    area_s: float
    shortest_s: float
    longest_s: float

    def bound(self, share: float) -> float:
        """The greatest part of U, with a share ahead."""
        _, flown_s, area_s, shortest_s, longest_s = self
        averages = [(area_s + share * t) / max(flown_s + t, MIN_STD) for t in (shortest_s, longest_s)]
        return self.weight * min(max(averages), 1.0)


@dataclass
class _Expected:
    """What a forecast expects of the flight until the next one, see `Forecaster.surprise`.

    Route, time [s], whole time and time left of each leg [s] and its motion power [W]; the ratio of times; whether the
    gauge is believed, the drain predicted to the end, and the state of charge then; ∫ tan² φ over the time left [s],
    and power regressed [W]; wind [m/s]; soc_per_j and mean_w of the terms; standard deviation of the final charge. And
    of the flight since: which leg is flown, since when [s], and the motion's energy on those before it [J].
    """

    route: Route
    time_s: float
    whole_s: FloatArray
    times_s: FloatArray
    motion_w: FloatArray
    ratio: float
    believed: bool
    drain: float
    soc_end: float
    bank_s: float
    level_w: float
    slope_w: float
    wind_mps: Point
    soc_per_j: float
    mean_w: float
    std: float = 0.0
    leg: int = 0
    leg_since_s: float = 0.0
    before_j: float = 0.0

    def __post_init__(self) -> None:
        self.leg_since_s = self.time_s

    def start_leg(self, time_s: float, route: Route) -> None:
        """Go on with the next leg."""
        self.before_j += float(self.motion_w[self.leg]) * (time_s - self.leg_since_s)
        self.route, self.leg, self.leg_since_s = route, self.leg + 1, time_s


class Forecaster:
    """Tracks a flight and forecasts its rest; see the module.

    Parameters
    ----------
    settings : PlannerSettings
        Reserve, weights and levels are used here.
    mission : Mission
    own : JointSettings, optional
        Probability of the reserve, trade-offs and objective. Default: its defaults.

    Attributes
    ----------
    open : list of int
        Indices of the free path parameters; `Shares` follow this order.
    shares : tuple of float
        Shares decided.
    gate : PowerGate
        Every reading of power passes it first.
    """

    def __init__(
        self,
        settings: PlannerSettings,
        mission: Mission,
        own: JointSettings | None = None,
    ) -> None:
        own = own or JointSettings()
        plan, battery = mission.plan, mission.battery
        self._settings, self._mission, self._plan = settings, mission, plan
        self._boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
        self.open = [i for i, box in enumerate(self._boxes) if not box.fixed]
        self._choices = [
            {sets[j] for sets in plan.quality_sets if sets and not sets[j].fixed} for j in range(len(plan.names))
        ]
        self.term_builder = TermBuilder(mission, settings, own)
        self._own = own
        self._speed = mission.cruise_mps
        self._position: Point = mission.start_m or (0.0, 0.0)
        self._predictor = RoutePredictor()
        self._cursor = PlanCursor.start(plan, mission.parameters, mission.rules)
        self._joined = self._position
        self._margin_m = MARGIN_M
        self._wind = WindFilter(mission.cruise_mps, mission.gust_time_s)
        self._headings = HeadingGate()
        self._wind_used: Point = (0.0, 0.0)
        self._measured_wind: Point | None = None
        self._measured_until_s = -math.inf
        self._ratio = TimeRatio()
        self._motion = MotionPower(mission.energy.mean_w if mission.energy is not None else mission.motion_w)
        limit_w = min(float(battery.max_power_w(battery.voltage_v)), MAX_OF_MOTOR * mission.max_motion_w)
        self.gate = PowerGate(mission.motion_w, limit_w)
        self._slope = 0.0
        full_v, empty_v = battery.voltage_at(1.0), battery.voltage_at(0.0)
        drain_per_as = 0.0 if battery.prescribed else battery.drain_per_as
        self._cell = (empty_v, full_v - empty_v, battery.resistance_ohm, drain_per_as)
        self._charge = ChargeFilter((full_v - empty_v) / battery.voltage_at(0.5))
        self._climb = ClimbForecast.of(mission)
        self._flown = ParameterAverages(len(plan.parameters))
        self._held_for: tuple[Vector, int] | None = None
        self._decided = mission.parameters
        self.shares = self._shares_of(mission.parameters)
        self._routes: dict[Shares, Route | None] = {}
        self._left: dict[int, float] = {}
        self._evaluated: dict[Shares, tuple[KnapsackTerms, RouteLoad] | None] = {}
        self._ahead: tuple[float, float, list[tuple[int, _Times]]] | None = None
        self._now: tuple[Now, Charge, tuple[FloatArray, FloatArray]] | None = None
        self._found: dict[Shares, Found | None] = {}
        self._in_steps = False
        self._expected: _Expected | None = None
        self._time_s = self._stage_since_s = self._charge_s = self._located_s = 0.0
        self._last_s: float | None = None
        self._sensitivity = (-math.inf, (0.0, 0.0))
        self._ripple_w = 0.0
        self._ask_ripple_w: Callable[[], float] | None = None
        self._navigation_std_m = NAVIGATION_M[0]
        self._power_w = self._computing_w = 0.0
        self._stages_started = 1
        self._through_gap = False
        self.before_latch = self._cursor.accepts_changes()

    # --- measurements

    @property
    def lap(self) -> int:
        """Laps flown before this one."""
        return self._cursor.lap

    @property
    def soc(self) -> float:
        """Filtered state of charge."""
        return self._charge.soc

    @property
    def believes_gauge(self) -> bool:
        """Whether the gauge's charge is used, and not the integral of the power."""
        return self._charge.believed

    @property
    def warnings(self) -> tuple[str, ...]:
        """Codes of what is wrong with the readings."""
        known = {
            GAUGE_STUCK: not self._charge.believed and not self._charge.rises,
            GAUGE_RISES: not self._charge.believed and self._charge.rises,
            POWER_OUTLIER: self.gate.rejects,
            HEADING_DISBELIEVED: self._headings.disbelieved,
        }
        return tuple([code for code, holds in known.items() if holds])

    @property
    def wind_mps(self) -> Point:
        """The wind to plan with [m/s]: measured, else estimated; changes below `WIND_STEP_MPS` are ignored."""
        now = self._measured_wind if self._measured_wind is not None else self._wind.wind_mps
        if math.dist(now, self._wind_used) > WIND_STEP_MPS:
            self._wind_used = now
            self._left.clear()
        return self._wind_used

    def update_stage(self, o: Observation) -> bool:
        """Update position, stage and parameters; return whether a new stage has started."""
        self._off_path((o.x_m, o.y_m), o.time_s - self._located_s)
        self._located_s = o.time_s
        started = o.stages_started != self._stages_started
        self._through_gap |= o.through_gap
        rho = self._plan.path_count
        if started:
            self._start_stage(o)
            self._through_gap = o.through_gap
        elif not o.cursor.table.live and o.cursor.waiting[:rho] != self._cursor.waiting[:rho]:
            self._clear_routes()  # path parameters other than those decided are waiting
        by_blocks = self.by_blocks
        self._cursor, self._joined = o.cursor, o.joined_m
        if by_blocks and not self.by_blocks:
            self.shares = self.shares[: len(self.open)]
            self._clear_routes()
        if self._held_for != (o.parameters, o.stage):
            self._held_for = (o.parameters, o.stage)
            self._flown.hold(o.time_s, o.parameters, self._plan.quality_sets[o.stage - 1])
        return started

    def observe(self, o: Observation, computing_w: float) -> bool:
        """Update the estimates of wind, motion power and charge; return whether the charge has jumped.

        Its power has passed the gate.

        Parameters
        ----------
        o : Observation
        computing_w : float
            Power of the computations [W].
        """
        step_s = self._duration_s(o.time_s)
        beside_w = computing_w + self._followed_w(step_s, o.airspeed_mps)
        if o.power_w is not None and step_s > 0:
            self._motion.observe(o.power_w - beside_w, min(step_s, MAX_STEP_S), self._slope)
        if o.wind_mps is not None:
            self._measured_wind, self._measured_until_s = o.wind_mps, o.time_s + MEASURED_WIND_S
        elif o.time_s > self._measured_until_s:
            self._measured_wind = None
        if o.wind_mps is None and o.velocity_mps is not None and step_s > 0:
            heading = math.nan if o.heading_rad is None else o.heading_rad
            self._observe_wind([o.velocity_mps[0]], [o.velocity_mps[1]], [heading], [step_s])
        return self._observe_charge(o.time_s, o.power_w, o.soc)

    def observe_batch(self, readings: Readings, computing_w: float) -> bool:
        """Update the estimates with a batch of readings, see `observe`; return whether the charge has jumped in any."""
        times_s: Any = readings.times_s
        first_s, last_s = float(times_s[0]), float(times_s[-1])
        if isinstance(times_s, np.ndarray):
            later_s = (times_s[1:] - times_s[:-1]).tolist()
        else:
            later_s = [b - a for a, b in itertools.pairwise(times_s)]
        durations = [self._duration_s(first_s), *later_s]
        self._last_s = last_s
        first = 0 if durations[0] > 0 else 1  # the first reading of a flight has no duration
        if self._climb is None:
            beside_w = [computing_w + self._followed_w(durations[-1])] * len(durations)
        else:
            beside_w = [computing_w + self._followed_w(duration_s) for duration_s in durations]
        steps_s = [first_s - self._charge_s, *later_s]
        self._charge_s = last_s
        columns: list[Any] = [readings.vx_mps, readings.vy_mps, readings.headings_rad, durations]
        columns += [readings.powers_w, beside_w, readings.charges, steps_s]
        if enabled():  # each is converted once
            columns = [np.asarray(column) for column in columns]
        *of_wind, powers_w, beside_w, charges, steps_s = columns
        self._observe_wind(*[column[first:] for column in of_wind])
        self._motion.observe_batch(powers_w, beside_w, of_wind[-1], self._slope)
        if last_s > self._measured_until_s:
            self._measured_wind = None
        jumped, self._power_w = self._charge.observe_batch(
            self._power_w, powers_w, charges, steps_s, MAX_STEP_S, self._cell
        )
        return jumped

    def _observe_wind(self, vx: Any, vy: Any, headings: Any, steps_s: Any) -> None:
        headings = self._headings.ingest(vx, vy, headings, steps_s, self._wind.airspeed_mps, self._wind)
        self._wind.observe_batch(vx, vy, headings, steps_s)

    def is_ambiguous(self, soc: float) -> bool:
        """Whether the charge, `soc` now, may have jumped: the next reading decides."""
        return self._charge.is_ambiguous(soc)

    def _duration_s(self, time_s: float) -> float:
        """Time since the last reading [s]."""
        step_s = time_s - self._last_s if self._last_s is not None else 0.0
        self._last_s = time_s
        return step_s

    def _followed_w(self, step_s: float, airspeed_mps: float | None = None) -> float:
        """Power that climbing and the stage's airspeed added over a step [s], which ends now [W].

        The wind is estimated with the airspeed measured [m/s] where it can be, else with the one commanded.
        """
        power_w, commanded_mps = 0.0, self._speed
        if self._climb is not None:
            self._climb.follow(self._cursor.stage, step_s)
            power_w, commanded_mps = self._climb.power_w, self._climb.level_mps
        measured = airspeed_mps is not None and 1 / MAX_AIRSPEEDS < airspeed_mps / self._speed < MAX_AIRSPEEDS
        self._wind.airspeed_mps = airspeed_mps if airspeed_mps is not None and measured else commanded_mps
        return power_w

    def _off_path(self, position: Point, step_s: float) -> None:
        """Update position and the standard deviation of the cross-track error, by its median: stages are joined from
        far off.

        Source: recursive median, a step up or down for each reading above or below it.
        """
        self._position = position
        route = self._routes.get(self.shares)
        if route is None or not len(route.order) or step_s <= 0:
            return
        leg = route.first
        try:
            phi, gx, gy, *_ = leg.path(position[0] - leg.offset_m[0], position[1] - leg.offset_m[1])
        except (ArithmeticError, ValueError):
            return
        square = gx * gx + gy * gy
        if square > 0 and math.isfinite(phi):
            above = phi * phi > square * (MEDIAN_PER_STD * self._navigation_std_m) ** 2
            std_m = self._navigation_std_m * math.exp((1.0 if above else -1.0) * min(1.0, step_s / OFF_PATH_S))
            self._navigation_std_m = min(max(std_m, NAVIGATION_M[0]), NAVIGATION_M[1])

    def assume(self, wind_mps: Point, gust_std_mps: float, soc: float) -> None:
        """Before take-off: assume the wind of the weather forecast [m/s], its gusts, and a state of charge."""
        self._measured_wind, self._measured_until_s = wind_mps, math.inf
        self._ratio.expect(gust_std_mps, self._speed, self._mission.gust_time_s)
        self._charge.observe(soc, 0.0)

    def _observe_charge(self, time_s: float, power_w: float | None, soc: float) -> bool:
        """Update the state of charge with a reading; return whether it has jumped."""
        powers_w, steps_s = [math.nan if power_w is None else power_w], [time_s - self._charge_s]
        self._charge_s = time_s
        jumped, self._power_w = self._charge.observe_batch(
            self._power_w, powers_w, [soc], steps_s, MAX_STEP_S, self._cell
        )
        return jumped

    def _start_stage(self, o: Observation) -> None:
        """Start the next stage; update the time ratio with the last leg, unless it is the first, flown only in part.

        A leg flown through a gap of the telemetry has no known time.
        """
        duration, slowed_s = o.time_s - self._stage_since_s, 0.0
        self._stage_since_s = o.time_s
        if self._climb is not None:
            slowed_s, self._climb.slowed_s = self._climb.slowed_s, 0.0
        route = self._route(self.shares)
        if route is not None and self._stages_started > 1 and not self._through_gap:
            forecast_s = float(route.times_s(self._speed, self.wind_mps)[0][0])
            gusts = self._wind.gust_std_mps, self._speed, self._mission.gust_time_s
            self._ratio.learn(forecast_s, duration - slowed_s, *gusts)
        self._motion.end_window(self._slope)
        self._margin_m = max(MARGIN_M, NAVIGATION_STDS * self._navigation_std_m)
        next_leg, self._stages_started = o.stages_started == self._stages_started + 1, o.stages_started
        self._cursor, self._joined = o.cursor, o.joined_m
        expected = self._expected
        self._clear_routes()
        rho = self._plan.path_count
        if (
            route is not None
            and next_leg
            and len(route.order) > 1
            and route.stages[1] == o.stage
            and route.parameters[1][:rho] == o.parameters[:rho]
        ):
            self._routes[self.shares] = after = route.after()
            if expected is not None and expected.route is route:
                expected.start_leg(o.time_s, after)
                self._expected = expected
        self.before_latch = self._cursor.accepts_changes()
        route = self._route(self.shares)
        if route is not None and len(route.order):
            times, turning = route.times_s(self._speed, self.wind_mps)
            self._slope = float(turning[0] / times[0]) if 0 < times[0] < math.inf else 0.0

    def hold(self, settings: PlannerSettings, parameters: Vector) -> None:
        """Forecast with other settings and parameters from now on."""
        self._settings, self.term_builder = settings, TermBuilder(self._mission, settings, JointSettings())
        self.decide(parameters, self._shares_of(parameters))

    def restrict(
        self, settings: PlannerSettings, own: JointSettings, held: Mapping[int, float], parameters: Vector
    ) -> None:
        """Plan with other settings from now on, and with path parameters as they are, by index, that are held."""
        self._settings, self.term_builder = settings, TermBuilder(self._mission, settings, own)
        self.open = [i for i, box in enumerate(self._boxes) if not box.fixed and i not in held]
        self._decided, self.shares = parameters, self._shares_of(parameters)
        self._clear_routes()

    def _clear_routes(self) -> None:
        """The remaining plan has changed for all parameters."""
        self._now, self._in_steps = None, False
        self._routes.clear()
        self._left.clear()
        self._evaluated.clear()
        self._found.clear()
        self._expected = None

    def decide(self, parameters: Vector, shares: Shares) -> None:
        """Set the parameters decided."""
        self._decided, self.shares = parameters, shares

    # --- routes

    @property
    def by_blocks(self) -> bool:
        """Whether `Shares` hold a path parameter twice: for the first segment of laps, and for those after it."""
        return len(self.open) == 1 and self._cursor.later_laps

    def _shares_of(self, parameters: Vector) -> Shares:
        return tuple(self._boxes[i].share(parameters[i]) or 0.0 for i in self.open) * (2 if self.by_blocks else 1)

    def parameters_of(self, shares: Shares) -> Vector:
        """Parameters with the path's at shares of their sets and the computations as decided."""
        now, count = shares[: len(self.open)], len(self.open)
        if now == self.shares[:count]:  # exact, not rounded
            return self._decided
        return self._with_path(now)

    def _with_path(self, shares: Shares) -> Vector:
        values = list(self._decided)
        for i, share in zip(self.open, shares, strict=True):
            values[i] = self._boxes[i].lo + share * (self._boxes[i].hi - self._boxes[i].lo)
        return tuple(values)

    def route(self, shares: Shares) -> Route:
        """The remaining route at shares that `candidate` has evaluated."""
        route = self._routes[shares]
        assert route is not None
        return route

    def _route(self, shares: Shares) -> Route | None:
        if shares not in self._routes:
            cursor, count = self._cursor.decide(self.parameters_of(shares)), len(self.open)
            later = self._with_path(shares[count:]) if shares[count:] not in ((), shares[:count]) else None
            try:
                self._routes[shares] = self._predictor.route(cursor, self._joined, self._margin_m, later)
            except PathUndefined:
                self._routes[shares] = None
        return self._routes[shares]

    def settled(self, shares: Shares) -> Shares:
        """The same shares, or those for later segments of laps alone where the others alter nothing from now on."""
        later = shares[len(self.open) :]
        if not later or later == shares[: len(self.open)]:
            return shares
        here, there = self._route(shares), self._route(later * 2)
        same = here is not None and there is not None and here.parameters == there.parameters
        return later * 2 if same else shares

    # --- forecasts

    def start_at(self, time_s: float, position: Point, ripple_w: Callable[[], float] | None = None) -> None:
        """Forecast from a time and location on.

        `ripple_w` gives the rise of the motion's power above its mean [W]; None for none. It counts up to the greatest
        power that was measured, and that of the motor, and is asked for where it could matter: where the battery would
        limit these.
        """
        self._time_s, self._position = time_s, position
        self._ask_ripple_w, self._ripple_w = ripple_w, 0.0 if ripple_w is None else math.inf
        self._evaluated.clear()
        self._found.clear()
        self._left.clear()
        self._ahead, self._now, self._in_steps = None, None, False

    def terms(self, shares: Shares) -> tuple[KnapsackTerms, RouteLoad]:
        """Knapsack terms and load of the route at shares that `candidate` has evaluated."""
        evaluated = self._evaluated[shares]
        assert evaluated is not None
        return evaluated

    def _evaluate(self, shares: Shares) -> tuple[KnapsackTerms, RouteLoad] | None:
        if shares not in self._evaluated:
            route, self._evaluated[shares] = self._route(shares), None
            found = self._find(shares)
            if found is not None and route is not None:
                self._evaluated[shares] = self._evaluation(found, route)
            elif route is not None and len(route.order):
                evaluated = self._on_route(route)
                if self._ripple_w == math.inf and evaluated is not None and self._is_limited(evaluated[0]):
                    assert self._ask_ripple_w is not None
                    self._ripple_w, self._now, self._in_steps = self._ask_ripple_w(), None, False
                    evaluated = self._on_route(route)
                self._evaluated[shares] = evaluated
        return self._evaluated[shares]

    def _on_route(self, route: Route) -> tuple[KnapsackTerms, RouteLoad] | None:
        """Terms and load of a route; None where it cannot be flown in this wind."""
        load = self._load(route)
        if load is None:
            return None
        past = FlownShares(*self._flown.until(self._time_s))
        return self.term_builder.terms(route, load, past, self.soc, self._settings.reserve_soc), load

    def _is_limited(self, terms: KnapsackTerms) -> bool:
        """Whether the maximum power of the motion alters a forecast."""
        limited = terms.beyond_w > 0 or terms.letter_soc > self._settings.reserve_soc or terms.delivered_soc > ROUNDING
        return limited or bool(terms.truncated.any())

    def candidate(self, shares: Shares) -> Candidate | None:
        """The program's candidate at shares: the margin keeps the reserve with its probability.

        Where the objective is the total, shares whose last lap is uncertain are none, but for those in force.
        """
        evaluated = self._evaluate(shares)
        if evaluated is None:
            return None
        terms, load = evaluated
        found = self._find(shares)
        if found is not None:
            n, shape = found.numbers, self.route(shares).shape
            return Candidate(shares, shape, terms.increments, n.available, ALIKE_STDS * n.std, not n.ends)
        if load.ends and self._own.objective == TOTAL and shares != self.shares:
            return None
        # the computations' power matters where an end is uncertain
        powers_w = load.motion_w + terms.base_w if load.ends else load.motion_w
        ends = self._final_charge(terms, load, self.soc, powers_w)
        available = ends.level(self._own.reserve_probability) - max(self._settings.reserve_soc, terms.min_soc)
        if terms.beyond_w > 0:
            # power that cannot be delivered counts as charge that is short, so that the least excess ranks first
            excess_j = terms.beyond_w * float(load.times_s.sum())
            available = min(available, terms.increments.base_use) - excess_j * terms.soc_per_j
        shape, tolerance = self.route(shares).shape, ALIKE_STDS * ends.std
        return Candidate(shares, shape, terms.increments, available, tolerance, not load.ends)

    def place(self, shares: Shares) -> Place | None:
        """The candidate at shares in short."""
        found = self._find(shares)
        if found is None:
            candidate = self.candidate(shares)
            return None if candidate is None else place_of(candidate)
        n = found.numbers
        if n.kind == UNFLYABLE:
            return None
        shape, tolerance, feasible = self.route(shares).shape, ALIKE_STDS * n.std, n.kind == FEASIBLE
        return Place(shares, shape, not n.ends, tolerance, feasible, n.value, n.use, n.available)

    def _find(self, shares: Shares) -> Found | None:
        """What compiled code finds at shares; None where steps have to be taken."""
        if self._climb is not None or not enabled() or not self.term_builder.is_quality:
            return None
        if shares not in self._found:
            route, self._found[shares] = self._route(shares), None
            if route is not None and len(route.order) and not self._in_steps:
                found = self._found_on(route)
                # what cannot be found here mostly cannot be at other shares
                self._in_steps = found.numbers.kind == UNKNOWN
                self._found[shares] = None if self._in_steps else found
        return self._found[shares]

    def _found_on(self, route: Route) -> Found:
        """What compiled code finds on a route."""
        builder = self.term_builder
        if self._now is None:
            flown_s, areas_s = self._flown.until(self._time_s)
            self._now = self._common(), self._charge.ahead, (np.array(flown_s), np.array(areas_s))
        now, charge, past = self._now
        return find_place(
            *(route.table.rows, route.order, *builder.envelopes(route), past, builder.weights, self._plan.path_count),
            np.array(route.ends, dtype=float) if route.ends else NO_ENDS,
            now,
            builder.cell,
            charge,
            self._left_of_first(route, self.wind_mps),
            self._wind_share(route),
        )

    def _evaluation(self, found: Found, route: Route) -> tuple[KnapsackTerms, RouteLoad] | None:
        """Terms and load of a route that compiled code has found; None where it cannot be flown in this wind."""
        n, legs = found.numbers, found.legs
        if n.kind == UNFLYABLE:
            return None
        ends = self._ends(route, self._left_of_first(route, self.wind_mps))
        stds = math.sqrt(n.time_variance), math.sqrt(n.energy_variance)
        load = RouteLoad(legs[TIMES], legs[MOTION], legs[PEAK], *stds, n.use_ratio, math.sqrt(n.charge_variance), ends)
        return self.term_builder.terms_of(found), load

    def _common(self) -> Now:
        """What all places of this forecast have in common."""
        ratio, motion, own, battery = self._ratio, self._motion, self._own, self._mission.battery
        empty_v, rise_v, *_ = self._cell
        return Now(
            *(self._speed, *self.wind_mps, ratio.ratio, ratio.variance, ratio.noise_s),
            *(motion.level_w, motion.slope_w, *motion.variances),
            *(self._ripple_w, min(self.gate.max_motion_w, self._mission.max_motion_w), self._computing_w),
            *(self._navigation_std_m, PASSED_S * self._speed),
            *(self.soc, self._settings.reserve_soc, empty_v + rise_v * min(max(self.soc, 0.0), 1.0)),
            *(battery.drain_per_as, *self._charge.gauge_gain),
            *(own.loss_rate_per_h / 3600, LOSS, LOSS_SQUARE),
            *(own.reserve_probability, NormalDist().inv_cdf(own.reserve_probability)),
        )

    def bound(self, shares: Shares) -> float:
        """The greatest value of the objective at shares, if the computations were the highest on the whole route.

        Infinite for the total, which grows with the time. U is the mean of each parameter's average over flown time
        and time ahead; the latter is taken to lie between those at the ends of the sets, or a tenth beyond.
        """
        ahead = self._known_ahead()
        if ahead is None:
            return math.inf
        count, (greatest, total, of_path) = len(self.open), ahead
        values = (self._with_path(shares[:count]), self._with_path(shares[-count:]))
        for j, times in of_path:
            share = max(box.share(box.clip(own[j])) or 0.0 for box in self._choices[j] for own in values)
            greatest += times.bound(share)
        return greatest / total if total else math.inf

    def _known_ahead(self) -> tuple[float, float, list[tuple[int, _Times]]] | None:
        """Bound of the computations' part of U, the total weight, and times of the path parameters by index.

        None where the ends of the sets cannot be flown.
        """
        if self._ahead is None and self._own.objective != TOTAL:
            found = []
            for share in (0.0, 1.0):
                expected_s = self._expected_times_s((share,) * len(self.shares))
                if expected_s is None:
                    return None
                route = self.route((share,) * len(self.shares))
                found.append((expected_s @ route.free, expected_s @ route.shares))
            (low_s, before_s), (high_s, _) = found
            shortest_s, longest_s = BOUND_SLACK * np.minimum(low_s, high_s), np.maximum(low_s, high_s) / BOUND_SLACK
            # shares of 0 leave the time integral of path parameters in force until others take effect
            before_s[self._plan.path_count :] = 0.0
            flown_s, areas_s = self._flown.until(self._time_s)
            columns = np.array(
                [self.term_builder.weights, flown_s, before_s / BOUND_SLACK + areas_s, shortest_s, longest_s]
            )
            all_times = [(j, _Times(*own)) for j, own in enumerate(columns.T.tolist())]
            counted = [(j, own) for j, own in all_times if own.weight > 0 and own.flown_s + own.longest_s > 0]
            greatest = sum(own.bound(1.0) for j, own in counted if j >= self._plan.path_count)
            of_path = [(j, own) for j, own in counted if j < self._plan.path_count]
            self._ahead = greatest, sum(own.weight for _, own in counted), of_path
        return self._ahead

    def _expected_times_s(self, shares: Shares) -> FloatArray | None:
        """Expected time on each leg at shares [s]; None where the plan cannot be flown at them."""
        found = self._find(shares)
        if found is not None:
            return None if found.numbers.kind == UNFLYABLE else found.legs[EXPECTED]
        evaluated = self._evaluate(shares)
        return None if evaluated is None else evaluated[1].expected_s

    def forecast(self, solution: Solution) -> Forecast:
        """Forecast of the rest of the mission as planned."""
        terms, load = self.terms(solution.candidate.shares)
        powers = load.motion_w + _computing_w(terms, solution)
        energies_wh = powers * load.times_s / 3600
        total_s = max(float(load.times_s.sum()), 1e-9)
        mean_w = float(powers @ load.times_s) / total_s
        self._computing_w = mean_w - float(load.motion_w @ load.times_s) / total_s
        expected_s = load.expected_s
        ends = self._final_charge(terms, load, self.soc - solution.allocation.use, powers)
        energy_std_j = math.hypot(load.energy_std_j, mean_w * load.time_std_s)
        return Forecast(
            remaining_s=float(expected_s.sum()),
            remaining_std_s=math.sqrt(load.time_std_s**2 + _spread(load, load.times_s)),
            energy_wh=float(powers @ expected_s) / 3600,
            energy_std_wh=math.sqrt((energy_std_j / 3600) ** 2 + _spread(load, energies_wh)),
            soc_end=ends.mean,
            soc_end_std=math.sqrt(ends.variance),
            reserve_soc=self._settings.reserve_soc,
            empty_soc=max(terms.delivered_soc, 0.0),
            ends=ends,
        )

    def of_stages(self, solution: Solution) -> dict[int, tuple[float, float]]:
        """Time [s] and energy [Wh] of each stage of the plan, over all its laps, as planned."""
        terms, load = self.terms(solution.candidate.shares)
        energies_wh = (load.motion_w + _computing_w(terms, solution)) * load.expected_s / 3600
        of_leg = self.route(solution.candidate.shares).stages
        seconds, of_stage_wh = (np.bincount(of_leg, values) for values in (load.expected_s, energies_wh))
        return {i: (float(seconds[i]), float(of_stage_wh[i])) for i in np.unique(of_leg).tolist()}

    def expect(self, solution: Solution) -> None:
        """Remember what the forecast of a solution expects, for `surprise`."""
        shares = solution.candidate.shares
        terms, load = self.terms(shares)
        whole, turning = self.route(shares).times_s(self._speed, self.wind_mps)
        ratio, motion, total_s = self._ratio.ratio, self._motion, float(load.times_s.sum())
        drain = (
            self._drain_per_s(float(load.motion_w @ load.times_s) / max(total_s, 1e-9) + self._computing_w) * total_s
        )
        self._expected = _Expected(
            self.route(shares),
            self._time_s,
            whole * ratio,
            load.times_s,
            load.motion_w,
            ratio,
            self.believes_gauge,
            drain,
            self.soc - self._charge.use(drain)[0],
            float(turning.sum()) * ratio,
            *(motion.level_w, motion.slope_w, self.wind_mps, terms.soc_per_j, terms.mean_w),
        )
        self._expected.std = self._std_ahead(self._expected, drain, total_s)[1]

    def _std_ahead(self, expected: _Expected, drain: float, left_s: float) -> tuple[float, float]:
        """State of charge at the end after a predicted drain, and its standard deviation, for a time left [s]."""
        used, charge_var = self._charge.use(drain)
        time_var = self._ratio.variance_s2(left_s) + left_s**2 * self._wind_variance()
        bank_s = expected.bank_s * left_s / max(float(expected.times_s.sum()), MIN_STD)
        energy_j2 = self._motion.energy_variance_j2(left_s, bank_s) + expected.mean_w**2 * time_var
        end = self.soc - used
        return end, self._charge_std(expected.soc_per_j, energy_j2, math.sqrt(charge_var), end, left_s)

    def surprise(self, time_s: float, position: Point, computing_w: float) -> float:
        """By how much more charge is available than expected after the last forecast, to first order.

        From the charge, the battery's use, the place on the leg, the motion's power, the wind, and the margin for their
        errors, each against what was expected of it; infinite where nothing was.

        Parameters
        ----------
        time_s : float
        position : (float, float)
            [m].
        computing_w : float
            Power of the computations in force [W].
        """
        e = self._expected
        if e is None or e.believed != self.believes_gauge:
            return math.inf
        motion, leg = self._motion, e.leg
        passed_j = e.before_j + float(e.motion_w[leg]) * (time_s - e.leg_since_s)
        passed_s = max(time_s - e.time_s, MIN_STD)
        drained = self._drain_per_s(passed_j / passed_s + computing_w) * passed_s
        later_s = float(e.times_s[leg + 1 :].sum())
        leg_s = float(e.whole_s[leg])
        left_s = leg_s * self._left_share(e.route, time_s, position, leg_s) + later_s
        late_s = time_s + left_s - e.time_s - float(e.times_s.sum())
        (wx, wy), (gx, gy) = self.wind_mps, self._sensitivity[1]
        late_s += left_s * (gx * (wx - e.wind_mps[0]) + gy * (wy - e.wind_mps[1]) + self._ratio.ratio / e.ratio - 1)
        more_j = (motion.level_w - e.level_w) * left_s + (motion.slope_w - e.slope_w) * e.bank_s
        end, std = self._std_ahead(e, max(e.drain - drained, 0.0), left_s)
        margin = NormalDist().inv_cdf(self._own.reserve_probability) * (std - e.std)
        return end - e.soc_end - e.soc_per_j * (more_j + e.mean_w * late_s) - margin

    def _drain_per_s(self, power_w: float) -> float:
        """Predicted rate of discharge at the voltage of now [1/s]."""
        empty_v, rise_v, resistance_ohm, _ = self._cell
        volts = empty_v + rise_v * min(max(self.soc, 0.0), 1.0)
        return drain_per_s(power_w, volts, resistance_ohm, self._mission.battery.drain_per_as)

    def _load(self, route: Route) -> RouteLoad | None:
        """Time and motion power of the remaining route; None where it cannot be flown in this wind."""
        wind, motion = self.wind_mps, self._motion
        left = self._left_of_first(route, wind)
        max_w = min(self.gate.max_motion_w, self._mission.max_motion_w)
        times, motion_w, peak_w, total_s, bank_s, motion_j = (kernels.remaining_load if enabled() else _remaining_load)(
            *(*route.table.rows[:3], route.order, self._speed, wind, left, self._ratio.ratio),
            *(motion.level_w, motion.slope_w, self._ripple_w, max_w),
        )
        if not math.isfinite(total_s):
            return None
        if self._climb is not None:
            whole = route.times_s(self._speed, wind)[0] * self._ratio.ratio
            times, motion_w, climb_w = self._climb.loaded(route, whole, times, motion_w)
            total_s, motion_j = max(float(times.sum()), 1e-3), float(motion_w @ times)
            peak_w = np.maximum(np.minimum(motion_w + self._ripple_w, max_w), np.maximum(motion_w, climb_w))
        time_var = self._ratio.variance_s2(total_s) + total_s**2 * self._wind_share(route)
        energy_var = motion.energy_variance_j2(total_s, bank_s)
        drain = self._drain_per_s(motion_j / total_s + self._computing_w) * total_s
        used, charge_var = self._charge.use(drain)
        stds = math.sqrt(time_var), math.sqrt(energy_var)
        use = used / max(drain, MIN_STD), math.sqrt(charge_var)
        return RouteLoad(times, motion_w, peak_w, *stds, *use, self._ends(route, left))

    def _ends(self, route: Route, left: float) -> tuple[tuple[float, FloatArray], ...]:
        """Uncertain ends ahead, see `RouteLoad`; `left` is the remaining share of the first leg."""
        if not route.ends:
            return ()
        reach = NormalDist(0.0, self._navigation_std_m)
        before, ends = 0.0, []
        for end in route.ends:
            ahead_m = end.length_m * (left if end.leg == 0 else 1.0)
            unflown_m = end.length_m - end.flown_m
            if ahead_m - unflown_m < -PASSED_S * self._speed:
                continue
            unflown = np.zeros(len(route.order))
            unflown[end.leg] = min(1.0, unflown_m / max(ahead_m, MIN_STD))
            unflown[end.leg + 1 :] = 1.0
            reached = reach.cdf(end.clearance_m)
            ends.append((reached - before, unflown))
            before = reached
        return tuple(ends)

    def _left_of_first(self, route: Route, wind: Point) -> float:
        """Remaining share of the route's first leg; routes mostly share it."""
        row = int(route.order[0])
        if row not in self._left:
            times, _ = leg_times_s(*route.table.rows[:3], route.order[:1], self._speed, wind)
            self._left[row] = self._left_share(route, self._time_s, self._position, float(times[0]) * self._ratio.ratio)
        return self._left[row]

    def _left_share(self, route: Route, time_s: float, position: Point, leg_s: float) -> float:
        """Remaining share of the first leg, which takes `leg_s` [s], by the position; elapsed time distinguishes the
        turns of a circle."""
        leg = route.first
        flown = min(1.0, (time_s - self._stage_since_s) / max(leg_s, 1e-9))
        if leg.distance_m <= 0:
            return 0.0
        try:
            early_m = self._plan.max_radius_m if self._stages_started > 1 else 0.0
            return left_m(leg, position, flown * leg.distance_m, early_m) / leg.distance_m
        except PathUndefined:
            return 1.0 - flown

    def _wind_share(self, route: Route) -> float:
        """Variance of the logarithm of the time due to the variance of the wind estimate."""
        if self._measured_wind is not None:
            return 0.0
        since, (gx, gy) = self._sensitivity
        if self._time_s - since >= SENSITIVITY_EVERY_S:
            (wx, wy), d = self.wind_mps, WIND_DIFFERENCE_MPS
            logs = [
                math.log(max(float(route.times_s(self._speed, (wx + dx, wy + dy))[0].sum()), 1e-9))
                for dx, dy in ((d, 0.0), (-d, 0.0), (0.0, d), (0.0, -d))
            ]
            if all(math.isfinite(value) for value in logs):
                gx, gy = (logs[0] - logs[1]) / (2 * d), (logs[2] - logs[3]) / (2 * d)
            self._sensitivity = (self._time_s, (gx, gy))
        return self._wind_variance()

    def _wind_variance(self) -> float:
        """`_wind_share` with the sensitivity as it was found last."""
        if self._measured_wind is not None:
            return 0.0
        gx, gy = self._sensitivity[1]
        pxx, pyy, pxy = self._wind.covariance
        return max(gx * gx * pxx + 2 * gx * gy * pxy + gy * gy * pyy, 0.0)

    def _final_charge(self, terms: KnapsackTerms, load: RouteLoad, soc: float, powers_w: FloatArray) -> FinalCharge:
        """The final state of charge, of mean `soc` where the whole route is flown, at powers of its legs [W]."""
        energy_j2 = load.energy_std_j**2 + (terms.mean_w * load.time_std_s) ** 2
        left_s = float(load.times_s.sum())
        soc -= self._own.loss_rate_per_h / 3600 * left_s * LOSS
        std = self._charge_std(terms.soc_per_j, energy_j2, load.charge_std, soc, left_s)
        if not load.ends:
            return FinalCharge(std, means=(soc,))
        unused_j = _unspent(load, powers_w * load.times_s)
        return FinalCharge(std, _shares_of(load), tuple([soc + terms.soc_per_j * energy_j for energy_j in unused_j]))

    def _charge_std(self, soc_per_j: float, energy_j2: float, charge_std: float, soc: float, left_s: float) -> float:
        """Standard deviation of the final charge `soc`, from the variance of the energy until then [J²], and losses."""
        losses = self._own.loss_rate_per_h / 3600 * left_s
        charge_var = charge_std**2 + self._charge.gain_std(soc) ** 2
        return math.sqrt(soc_per_j**2 * energy_j2 + charge_var + losses * LOSS_SQUARE)

    def home_spare(self, solution: Solution) -> float | None:
        """Charge above the reserve after a flight home from here, with the reserve's probability; None without a home.

        The way is a whole turn and a straight line, with the computations of minimum power.
        """
        home = self._mission.home_m
        if home is None:
            return None
        terms, load = self.terms(solution.candidate.shares)
        dx, dy = home[0] - self._position[0], home[1] - self._position[1]
        distance, seconds = math.hypot(dx, dy), 0.0
        if distance >= AT_HOME_M:
            wx, wy = self.wind_mps
            tail, cross = (wx * dx + wy * dy) / distance, (wx * dy - wy * dx) / distance
            square = self._speed**2 - cross**2
            speed = tail + math.sqrt(square) if square > 0 else 0.0
            if speed <= 0:
                return -math.inf
            seconds = distance / speed + 2 * math.pi * HOME_RADII * self._mission.turn_radius_m / self._speed
        power_w = float(load.motion_w.min()) + float(terms.base_w.min())
        drain = self._drain_per_s(power_w) * seconds
        used, charge_var = self._charge.use(drain)
        energy_j2 = self._motion.energy_variance_j2(seconds, 0.0) + power_w**2 * self._ratio.variance_s2(seconds)
        soc = self.soc - used - self._own.loss_rate_per_h / 3600 * seconds * LOSS
        std = self._charge_std(terms.soc_per_j, energy_j2, math.sqrt(charge_var), soc, seconds)
        return FinalCharge(std, means=(soc,)).level(self._own.reserve_probability) - self._settings.reserve_soc


def _remaining_load(
    nodes: Nodes,
    first: IntArray,
    airspeeds_mps: FloatArray,
    order: IntArray,
    airspeed_mps: float,
    wind_mps: Point,
    left: float,
    ratio: float,
    level_w: float,
    slope_w: float,
    ripple_w: float,
    max_w: float,
) -> tuple[FloatArray, FloatArray, FloatArray, float, float, float]:
    """Times [s], motion powers and their maxima [W] of legs, the first only in part; time, ∫ tan² φ [s], energy [J].

    Whole legs are those of `leg_times_s`; the time is infinite where one cannot be flown.
    """
    whole_s, turning_s = leg_times_s(nodes, first, airspeeds_mps, order, airspeed_mps, wind_mps)
    if not np.isfinite(whole_s.sum()):
        return whole_s, whole_s, whole_s, math.inf, 0.0, 0.0
    times_s = whole_s * ratio
    times_s[0] *= left
    bank_s = (turning_s.sum() - (1.0 - left) * turning_s[0]) * ratio
    slopes = turning_s / np.where(whole_s > 0.0, whole_s, 1.0)
    motion_w = np.maximum(level_w + slope_w * slopes, 0.0)
    peak_w = np.maximum(np.minimum(motion_w + ripple_w, max_w), motion_w)
    energy_j = (motion_w * times_s).sum()
    return times_s, motion_w, peak_w, max(times_s.sum(), 1e-3), bank_s, energy_j


def _shares_of(load: RouteLoad) -> tuple[float, ...]:
    """Probability of the route's end, and of each before it."""
    shares = tuple([share for share, _ in load.ends])
    return (1.0 - sum(shares), *shares)


def _unspent(load: RouteLoad, values: FloatArray) -> list[float]:
    """What is not spent of some values of the segments, shape (segments,), at the route's end and each before it."""
    return [0.0, *(float(values @ unflown) for _, unflown in load.ends)]


def _moments(shares: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Mean and variance of values with probabilities."""
    mean = sum(share * value for share, value in zip(shares, values, strict=True))
    return mean, sum(share * (value - mean) ** 2 for share, value in zip(shares, values, strict=True))


def _spread(load: RouteLoad, values: FloatArray) -> float:
    """Variance of a sum over the segments flown, by where the flight ends."""
    if not load.ends:
        return 0.0
    return _moments(_shares_of(load), _unspent(load, values))[1]


def _computing_w(terms: KnapsackTerms, solution: Solution) -> FloatArray:
    """Mean power of the computations on each segment as allocated [W], shape (segments,)."""
    more = np.bincount(terms.increments.segment, solution.allocation.shares * terms.rises_w, len(terms.kind_of))
    return terms.base_w + more


def ripple_w(state_w: FloatArray) -> float:
    """Rise of the motion's power above its level within a lap [W], from an energy state q."""
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

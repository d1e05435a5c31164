"""The state of a flight, of its readings: wind, power, times, charge, navigation, climb, ground seen.

Planners and forecasts ask it what is known. Readings and observations wait in a queue until it is asked, and are
processed in their order. A planner that never asks costs nothing, and what it answers does not depend on when it is
asked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight import WindReadings
from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import GroundLog
from eadp.models.plan.route import MARGIN_M, Route, RoutePredictor
from eadp.models.vehicle import LEVEL_SHARE
from eadp.models.world import Mission
from eadp.planning.base import Observation, Readings, Sample
from eadp.planning.state.charge import MAX_STEP_S, ChargeFilter, DrainModel
from eadp.planning.state.climb import ClimbFollower
from eadp.planning.state.known import ChargeKnown, Joined, Known, TimeKnown, TimeRatio
from eadp.planning.state.motion import MotionPower
from eadp.planning.state.power import PowerGate, max_reading_w
from eadp.planning.state.queue import ReadingQueue, Seen
from eadp.planning.state.voltage import VoltageWatch
from eadp.planning.state.wind import HEADING_DISBELIEVED, FlightWind

MAX_AIRSPEEDS = 5.0
"""Ratio of a measured airspeed to that of cruise, or the inverse, above which it is false."""

READ_S = 0.1
"""Default least time between readings [s]."""

OTHER_MPS = 0.25
"""Distance of an airspeed from that of cruise from which on it is another one: half a step of `speed_to_fly` [m/s]."""

SAME_MPS = 0.02
"""Airspeed's distance from the commanded one that counts as none [m/s]."""

SLOWS_S, ERROR_S, UNMEASURED_S = 60.0, 10.0, 10.0
"""Time in which an autopilot reaches another airspeed: PX4 takes 40 to 50 s of it; time constant of the mean error of
the measured one; and its greatest age [s]."""

NOT_OBEYED_MPS = 1.5
"""Mean error from which on the commanded airspeed is not flown: more than that of a good calibration [m/s]."""

GAUGE_STUCK, GAUGE_RISES, POWER_OUTLIER, CELL_LOST = "gauge-stuck", "gauge-rises", "power-outlier", "cell-lost"
"""Codes of warnings: the gauge is disbelieved, as it does not fall or rises; the last reading of power is false; the
voltage shows a loss of charge that the gauge does not."""


class FlightState:
    """What is known of a flight; see the module.

    Parameters
    ----------
    mission : Mission
    weights : mapping of name to float, optional
        Weights of the parameters in U.
    every_s : float, optional
        Least time between readings [s]: an observation sooner after one is none.

    Attributes
    ----------
    reached_s : float
        When the flight has reached its plan, after a take-off [s].
    autopilot : Autopilot
        That flies; whoever reads its parameters in flight replaces it.
    """

    def __init__(self, mission: Mission, weights: Mapping[str, float] | None = None, every_s: float = READ_S) -> None:
        self._mission = mission
        self._place = _Place(mission)
        self._ground = GroundLog(mission.plan, weights or {})
        self._wind = FlightWind(mission.gust_time_s)
        self._times = TimeRatio(mission.cruise_mps, mission.gust_time_s)
        # the motion's power before it is learned: of a model fitted to a log, else as stated
        vehicle = mission.vehicle
        level_w, level_share = vehicle.cruise_power_w, vehicle.power_std_share
        if mission.energy is not None:
            level_w, level_share = mission.energy.mean_w, LEVEL_SHARE
        speeds_mps = *(vehicle.airspeed_range_mps or ()), *(stage.airspeed_mps for stage in mission.plan.stages)
        others = any(abs((speed or mission.cruise_mps) - mission.cruise_mps) > OTHER_MPS for speed in speeds_mps)
        self._motion = MotionPower(level_w, vehicle, level_share, vehicle.climb_j_per_m, by_polar=others)
        self._airspeed = FlownAirspeed(mission)
        battery = mission.battery
        full_v, empty_v = battery.voltage_at(1.0), battery.voltage_at(0.0)
        self._gate = PowerGate(vehicle.cruise_power_w, max_reading_w(mission))
        self._queue = ReadingQueue(every_s)
        drain_model = DrainModel(
            empty_v=empty_v,
            rise_v=full_v - empty_v,
            resistance_ohm=battery.resistance_ohm,
            per_as=0.0 if battery.prescribed else battery.drain_per_as,  # a charge that is replayed is not drained
            curve=np.array(battery.curve),
        )
        self._charge = ChargeFilter(drain_model, (full_v - empty_v) / battery.voltage_at(0.5), battery.soc)
        self._voltage = VoltageWatch(battery)
        self._climb = ClimbFollower.of(mission)
        self._last_s: float | None = None  # of the last reading that the filters have taken
        self.reached_s, self.autopilot = 0.0, mission.autopilot

    # --- readings in

    def ingest(self, readings: Readings) -> None:
        """Take readings since the last observation, all on its stage and with its parameters; they wait."""
        self._queue.ingest(readings)

    def observe(self, observation: Observation) -> Seen:
        """Take an observation, which is a reading, too, unless it is too soon after the last one; it waits.

        The voltage is compared at once: charge that it shows to be lost is taken off the gauge's.
        """
        sample = observation.sample
        if sample.soc is not None:
            if sample.voltage_v is not None and sample.power_w is not None:
                self._voltage.ingest(sample.time_s, sample.voltage_v, sample.power_w, sample.soc)
            if self._voltage.lost > 0:
                soc = max(sample.soc - self._voltage.lost, 0.0)
                observation = observation._replace(sample=sample._replace(soc=soc), soc=soc)
        if not observation.on_plan:
            self.reached_s = observation.time_s
        computing_w = self._mission.computing.power_w(observation.parameters, observation.cursor.stage.sets)
        return self._queue.observe(observation, computing_w)

    def assume(self, wind_mps: Point, gust_std_mps: float) -> None:
        """Before take-off: take the wind of the weather forecast, and the standard deviation of its gusts [m/s]."""
        self._wind.forecast(wind_mps)
        self._times.expect(gust_std_mps)

    def _process(self) -> None:
        """Pass what waits through the filters, in its order; called before any of them is asked.

        A batch of readings is held back until what follows it is known: an observation's reading joins the batch. The
        place in the plan of this observation counts after them, as they were made on the stage before.
        """
        readings: Readings | None = None
        for each in self._queue.take():
            if isinstance(each, Seen):
                if each.is_reading:
                    readings = _with_reading(readings, each.observation.sample)
                if readings is not None:
                    self._read(readings, each.observation)
                self._locate(each)
                readings = None
            else:
                if readings is not None:
                    self._read(readings)
                readings = each
        if readings is not None:
            self._read(readings)

    def _locate(self, seen: Seen) -> None:
        """Update the place in the plan, the parameters in force and a measured wind by an observation.

        Readings before it are processed already, with the parameters that were in force then.
        """
        o, place = seen.observation, self._place
        # a leg whose airspeed changes on the way says nothing of times
        slowed = o.stages_started == seen.stages_before and o.cursor.airspeed_mps != place.cursor.airspeed_mps
        place.through_gap |= o.through_gap or slowed
        # a new stage; or no route yet: at take-off, or where it could not be laid out, which is tried again
        if o.stages_started != seen.stages_before or place.route is None:
            self._start_stage(o, seen.stages_before)
        elif (o.cursor.parameters, o.cursor.decided) != (place.cursor.parameters, place.cursor.decided):
            self._ground.hold(o.time_s, o.cursor, o.parameters)
        place.cursor, place.flies_mission = o.cursor, bool(o.sample.mode.flies_mission)
        place.computing_w = seen.computing_w
        place.returns_home, place.rejoins_at_start = o.returns_home, o.rejoins_at_start
        if o.sample.wind_mps is not None:
            self._wind.measure(o.sample.wind_mps, o.time_s)

    def _start_stage(self, o: Observation, stages_before: int) -> None:
        """Learn from the leg that has ended, and lay out the leg of the stage that starts with an observation.

        The time flown on the ended leg, beside its forecast, shows how long legs take, if the leg was flown whole and
        as planned. The first leg of a flight may be joined anywhere, so that it shows nothing.
        """
        place, cruise_mps = self._place, self._mission.cruise_mps
        slowed_s = 0.0  # by climbing, on the leg that ended
        if self._climb is not None:
            slowed_s, self._climb.slowed_s = self._climb.slowed_s, 0.0
        if place.route is not None:
            rho = self._mission.plan.path_count
            # an autopilot whose line is changed during a turn leaves the turn elsewhere, up to a whole turn later
            diverted = place.flies_mission and o.cursor.waiting[:rho] != place.cursor.waiting[:rho]
            if stages_before > 1 and not place.through_gap and not diverted:
                times_s, _ = place.route.times_s(self._commanded_mps, self.wind_mps)
                excess = self._mission.excess.get(place.cursor.stage.index)
                forecast_s = float(times_s[0]) + (0.0 if excess is None else excess.seconds)
                flown_s = o.time_s - place.since_s - slowed_s
                self._times.learn(forecast_s, flown_s, self._wind.gust_std_mps)
            # windows of the motion's power lie within one leg, of one bank
            self._motion.end_window(place.slope)
        place.start(o)
        route = place.route
        if route is not None:
            self._ground.start_leg(o.time_s, o.cursor, route.legs[0].length_m)
            times_s, turning_s = route.times_s(o.cursor.airspeed_mps or cruise_mps, self.wind_mps)
            # mean tan² φ = ∫tan² φ dt / t
            slope = float(turning_s[0] / times_s[0]) if 0 < times_s[0] < math.inf else 0.0
            # no steeper bank than it can fly
            place.slope = min(slope, math.tan(math.radians(self._mission.vehicle.max_bank_deg)) ** 2)
        self._ground.hold(o.time_s, o.cursor, o.parameters)

    def _read(self, readings: Readings, o: Observation | None = None) -> None:
        """Update the filters with readings, columns of shape (n,), all on the stage of `_place`.

        `o` is the observation whose reading is the last one, or None. Each filter comes after those that it needs:
        power gate, climb, heading gate, wind, motion power, charge. The first reading of a flight has a
        step of 0 s. Readings at the time of the last one taken are left out. Where the plan is not flown, the power
        updates only the charge, and the wind is estimated by measured airspeeds alone.
        """
        on_plan = o is None or o.on_plan
        times_s, airspeeds_mps = readings.times_s, readings.airspeeds_mps
        before_s = float(times_s[0]) if self._last_s is None else self._last_s
        steps_s = np.diff(times_s, prepend=before_s)
        if self._last_s is not None and not steps_s.any():
            return
        self._last_s = float(times_s[-1])
        powers_w = self._gate.ingest(times_s, readings.powers_w, self._place.computing_w, on_plan=on_plan)
        if on_plan and self._climb is not None:  # the take-off is over
            self._climb.climb = self._climb.climb._replace(take_off_j_per_m=0.0)
        # measured airspeeds; the commanded airspeed where none is measured, or the one measured cannot be true
        ratios = airspeeds_mps / self._mission.cruise_mps
        possible = (ratios > 1 / MAX_AIRSPEEDS) & (ratios < MAX_AIRSPEEDS)
        flown_mps = self._airspeed.follow(self._commanded_mps, steps_s)
        # while the airspeed changes, the power is that of the change, too
        steady_w = np.where(np.abs(flown_mps - self._commanded_mps) > SAME_MPS, math.nan, powers_w)
        if self._mission.vehicle.airspeed_range_mps is not None:
            if on_plan:
                self._airspeed.measure(self._commanded_mps, times_s[possible], airspeeds_mps[possible])
            else:
                self._airspeed.interrupt(self._last_s)
            flown_mps = np.where(possible, airspeeds_mps, flown_mps)
        climb_w, level_mps = self._follow_climb(steps_s, flown_mps)
        climb_mps = self._take_altitude(o, float(steps_s.sum()))
        airspeeds_mps = np.where(possible, airspeeds_mps, level_mps)
        # where the plan is not flown, the airspeed is another than commanded
        vx_mps = readings.vx_mps if on_plan else np.where(possible, readings.vx_mps, math.nan)
        velocities = WindReadings(vx_mps, readings.vy_mps, readings.headings_rad, steps_s, airspeeds_mps)
        self._wind.ingest(velocities, self._last_s)
        if on_plan:
            # the power of a measured climb is a term of the regression; that of a commanded one is subtracted before
            beside_w = self._place.computing_w + (climb_w if climb_mps is None else 0.0)
            # a reading after a long gap stands for MAX_STEP_S of it
            steps = np.minimum(steps_s, MAX_STEP_S)
            self._motion.ingest(steady_w, beside_w, steps, self._place.slope, climb_mps or 0.0, flown_mps)
        # over a long gap the charge is drained by the power before it
        drain_powers_w = np.where(steps_s > MAX_STEP_S, math.nan, powers_w)
        self._charge.ingest(readings.charges, drain_powers_w, steps_s, measured=on_plan)

    @property
    def _commanded_mps(self) -> float:
        """The airspeed that is commanded [m/s]."""
        return self._place.cursor.airspeed_mps or self._mission.cruise_mps

    def _follow_climb(self, steps_s: FloatArray, airspeeds_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Follow the commanded climb over steps [s] at airspeeds [m/s]; return two arrays of shape (n,).

        The power that the climb adds to the motion's [W], and the horizontal part of the airspeed [m/s].
        """
        if self._climb is None:
            return np.zeros(len(steps_s)), airspeeds_mps
        steps, stage = zip(airspeeds_mps.tolist(), steps_s.tolist(), strict=True), self._place.cursor.stage
        added_w, level_mps = np.array([self._climb.follow(stage, *step) for step in steps]).T
        return added_w, level_mps

    def _take_altitude(self, o: Observation | None, seconds: float) -> float | None:
        """Note an observation's altitude; return the rate of climb [m/s], None without the altitude before it.

        `seconds` is the time since the altitude before [s]. In a take-off the dead reckoning is set to the altitude.
        """
        altitude_m = None if o is None else o.sample.altitude_m
        before_m, self._place.altitude_m = self._place.altitude_m, altitude_m
        if altitude_m is None or o is None:
            return None
        if not o.on_plan and self._climb is not None:
            self._climb.climb = self._climb.climb._replace(altitude_m=altitude_m)
        return None if before_m is None or not 0 < seconds <= MAX_STEP_S else (altitude_m - before_m) / seconds

    # --- what is known

    @property
    def now(self) -> Observation:
        """The last observation."""
        return self._queue.now

    @property
    def every_s(self) -> float:
        """Least time between readings [s]."""
        return self._queue.every_s

    @property
    def wind_mps(self) -> Point:
        """The wind to plan with [m/s]: measured, else estimated."""
        self._process()
        return self._wind.mps

    @property
    def soc(self) -> float:
        """Filtered state of charge at the last reading."""
        self._process()
        return self._charge.soc

    @property
    def losses(self) -> int:
        """Sudden losses of charge so far."""
        self._process()
        return self._charge.belief.losses

    def jump_decided_s(self, soc: float) -> float:
        """When the next reading may decide whether the charge, `soc` now, has jumped [s]; infinite without doubt."""
        self._process()
        return self._queue.next_reading_s if self._charge.is_ambiguous(soc) else math.inf

    @property
    def flies_commanded(self) -> bool:
        """Whether the airspeed is measured, and is the one that is commanded."""
        self._process()
        return self._airspeed.is_commanded(self._last_s or 0.0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Codes of what is wrong with the readings."""
        self._process()
        gauge = self._charge.belief
        applies = {
            GAUGE_STUCK: not gauge.believed and not gauge.rises,
            GAUGE_RISES: not gauge.believed and gauge.rises,
            POWER_OUTLIER: self._gate.state.rejects,
            HEADING_DISBELIEVED: self._wind.headings.disbelieved,
            CELL_LOST: self._voltage.lost > 0,
        }
        return tuple([code for code, holds in applies.items() if holds])

    def known(self, time_s: float, position: Point) -> Known:
        """What is known at a time [s] and a position [m], those of the last reading: what a forecast starts from."""
        self._process()
        place, times = self._place, self._times
        gain_std, gain_from = self._charge.gauge_gain
        return Known(
            time_s=time_s,
            position_m=position,
            cursor=self._flown_cursor(),
            joined=Joined(place.joined_m, place.since_s, self._queue.stages_started, place.rejoins_at_start),
            wind=self._wind.known,
            time=TimeKnown(times.ratio, times.variance, times.noise_s),
            motion=self._motion.known(min(self._gate.state.max_motion_w, self._mission.vehicle.max_motion_w)),
            charge=ChargeKnown(
                filtered=self._charge.ahead,
                gain_std=gain_std,
                gain_from=gain_from,
                believed=self._charge.belief.believed,
                lost_std=self._voltage.lost_std,
                losses=self._charge.belief.losses,
            ),
            # an autopilot's mission ends where it is laid out to
            margin_m=0.0 if place.flies_mission else MARGIN_M,
            climb=None if self._climb is None else self._climb.climb,
            flown=self._ground.until(time_s),
            autopilot=self.autopilot,
            returns_home=place.returns_home,
        )

    def _flown_cursor(self) -> PlanCursor:
        """The place in the plan, in a live flight with airspeeds that are known to be flown; else with no command."""
        cursor, mission = self._place.cursor, self._mission
        if not mission.live or mission.vehicle.airspeed_range_mps is None or self.flies_commanded:
            return cursor
        flown_mps = self._airspeed.refused_mps
        return cursor._replace(airspeeds_mps=() if flown_mps is None else (flown_mps,) * len(mission.plan.stages))


class FlownAirspeed:
    """The airspeed as the throttle brings it to the commanded one, and whether the measured one gets there.

    Its mean error counts from `SLOWS_S` after each command on. An airspeed that is not obeyed is a pilot's, or that
    of a limit, for the rest of the flight.
    """

    def __init__(self, mission: Mission) -> None:
        self._mps, self._gain_per_s = mission.cruise_mps, mission.vehicle.speed_gain_per_s
        self._commanded_mps = self._error_mps = 0.0
        self._since_s = self._last_s = -math.inf
        self._refused = False

    def follow(self, commanded_mps: float, steps_s: FloatArray) -> FloatArray:
        """The airspeed after steps [s] while one is commanded, shape (n,) [m/s]."""
        if commanded_mps == self._mps:
            return np.full(len(steps_s), commanded_mps)
        # V̇ = k (V_d − V)
        off_mps = (self._mps - commanded_mps) * np.exp(-self._gain_per_s * np.cumsum(steps_s))
        flown_mps: FloatArray = commanded_mps + np.where(np.abs(off_mps) < SAME_MPS, 0.0, off_mps)
        self._mps = float(flown_mps[-1])
        return flown_mps

    def measure(self, commanded_mps: float, times_s: FloatArray, measured_mps: FloatArray) -> None:
        """Take measured airspeeds with their times, shape (n,), while one is commanded [m/s]."""
        if not len(times_s):
            return
        if commanded_mps != self._commanded_mps:
            if self._since_s > -math.inf:  # the airspeed is still that of before
                self._error_mps += self._commanded_mps - commanded_mps
            self._commanded_mps, self._since_s = commanded_mps, float(times_s[0])
        for time_s, airspeed_mps in zip(times_s.tolist(), measured_mps.tolist(), strict=True):
            # e ← e + (1 − e^(−Δt/τ)) (v − v_c − e)
            share = -math.expm1(min(self._last_s - time_s, 0.0) / ERROR_S)
            self._error_mps += share * (airspeed_mps - commanded_mps - self._error_mps)
            self._last_s = time_s
        settled = self._last_s - self._since_s > SLOWS_S
        self._refused |= settled and abs(self._error_mps) > NOT_OBEYED_MPS

    def interrupt(self, time_s: float) -> None:
        """Another airspeed is flown up to a time [s], in a take-off or by hand."""
        self._since_s = time_s

    @property
    def refused_mps(self) -> float | None:
        """The mean of the airspeed that is flown where one that was commanded was not [m/s]; else None."""
        return self._commanded_mps + self._error_mps if self._refused else None

    def is_commanded(self, time_s: float) -> bool:
        """Whether an airspeed was measured not long before a time [s], and none that was commanded was not flown."""
        return not self._refused and time_s - self._last_s < UNMEASURED_S


class _Place:
    """Where the flight is in its plan, as of the last observation processed.

    Attributes
    ----------
    cursor : PlanCursor
        The stage being flown.
    joined_m : (float, float)
        Where it was joined [m].
    route : Route or None
        The leg being flown alone; None where it cannot be laid out.
    since_s : float
        When the leg was joined [s].
    slope : float
        Mean tan² φ of the leg, as the aircraft can turn.
    computing_w : float
        Power of the computations in force [W].
    through_gap : bool
        Whether the leg's start or end may be unknown.
    flies_mission : bool
        Whether an autopilot flies a mission laid out before.
    returns_home, rejoins_at_start : bool, bool or None
        Whether it flies home, and where the plan that is taken up again is joined, as in `Observation`.
    altitude_m : float or None
        As measured [m].
    """

    def __init__(self, mission: Mission) -> None:
        self.cursor = PlanCursor.start(mission.plan, mission.parameters, mission.rules)
        self.joined_m: Point = mission.start_m or (0.0, 0.0)
        self.route: Route | None = None
        self.since_s = self.slope = self.computing_w = 0.0
        self.through_gap = self.flies_mission = self.returns_home = False
        self.rejoins_at_start: bool | None = None
        self.altitude_m: float | None = None
        self._predictor = RoutePredictor()

    def start(self, o: Observation) -> None:
        """Start a stage where an observation is in the plan, and lay its leg out."""
        self.joined_m, self.since_s, self.through_gap = o.joined_m, o.time_s, o.through_gap
        try:
            self.route = self._predictor.leg(o.cursor, o.joined_m)
        except PathUndefined:
            self.route = None


def _with_reading(before: Readings | None, sample: Sample) -> Readings:
    """Readings with a sample as one more; as they are where the sample is no later than the last of them."""
    # a measured wind is not estimated from the velocity, too
    velocity_mps = (None, None) if sample.velocity_mps is None or sample.wind_mps is not None else sample.velocity_mps
    one = sample.time_s, sample.power_w, sample.soc, *velocity_mps, sample.heading_rad, sample.airspeed_mps
    numbers = np.array(one, dtype=float)  # in the order of `Readings`, NaN for None
    if before is None:
        return Readings(*numbers[:, None])
    if before.times_s[-1] >= sample.time_s:
        return before
    return Readings(*map(np.append, before, numbers))

"""A planner on a real flight: samples of telemetry to observations, decisions to advice. No files, no clock.

`LiveFlight` tracks the plan with the samples that the gate accepts and updates the planner. Both depend on their input
alone, so that a flight is restored from the same samples.
"""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, printable
from eadp.live.gate import BY_HAND_S, FAR, SLACK_M, SPEED_FACTOR, Departure, Notice
from eadp.live.locator import InitialClimb, path_mismatch
from eadp.live.tracker import Messages, PlanTracker
from eadp.models.autopilot import Autopilot
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import PlannedLegs, RoutePredictor
from eadp.models.plan.stage import Leg, Stage, left_m
from eadp.models.world import Mission
from eadp.planning.base import BY_FALLBACK, Ending, HomeRecord, Observation, Sample, next_multiple
from eadp.planning.forecast.held import HeldForecast
from eadp.planning.registry import PlannedFlight
from eadp.planning.state.flight_state import FlightState

WINDOW_S, MIN_SPAN_S, MAX_CHORD_S = 2.5, 0.9, 3.0
"""Window of positions for the ground velocity, its minimum span, and the maximum step in it [s]."""

CLOCK_START_S = 10.0
"""A clock up to this at the first sample has started with the flight; any other counts from the first sample."""

RECENT_S = 10.0
"""Maximum age of a decision record that counts as a forecast [s], if it exceeds three re-plannings."""

STALE, STAGE_UNKNOWN, NOT_APPLIED = "stale", "stage-unknown", "not-applied"
"""Codes of warnings: position or charge is not measured, the stage is not certain, parameters are not applied."""

COMPLETED, EMPTY, TAKE_OFF, KEPT = "final point reached", "battery empty", "take-off", "kept"
NOT_FLOWN, RETURNS = "the plan is not flown: parameters stay", "the autopilot returns: parameters stay"
NOT_PLACED = "the stage being flown is not known, do not act on this: parameters stay"
UNDECIDED = TAKE_OFF, KEPT, NOT_FLOWN, RETURNS, NOT_PLACED
"""Reasons of advice without a decision of the planner."""


class Advice(NamedTuple):
    """A planner's advice at a sample.

    Attributes
    ----------
    time_s : float
        Time of the sample [s].
    stage, lap : int
        Being flown, from 1 and from 0.
    parameters, in_force : mapping of name to value
        Decided; and in force, since path parameters may wait for their stage.
    ending : Ending
        Forecast of the end of the plan.
    wind_mps : (float, float) or None
        Estimated wind [m/s].
    reason : str
        The decision and its reason, in words.
    warnings : tuple of str
        Codes of what is wrong with the telemetry.
    returns_home : bool
        Whether to give the plan up and fly home.
    home : HomeRecord
        The way home.
    airspeed_mps : float or None
        True airspeed decided for this stage [m/s]; None where it is not.
    """

    time_s: float
    stage: int
    lap: int
    parameters: Mapping[str, float]
    in_force: Mapping[str, float]
    ending: Ending
    wind_mps: Point | None
    reason: str
    warnings: tuple[str, ...]
    returns_home: bool = False
    home: HomeRecord = HomeRecord()
    airspeed_mps: float | None = None


class _Schedule:
    """When advice is due: each `every_s`, at once where it is said so; that the battery is empty, once.

    Attributes
    ----------
    empty : bool
        Whether there has been advice that the battery is empty.
    """

    def __init__(self, every_s: float) -> None:
        self.every_s, self.empty = every_s, False
        self._next_s = -math.inf

    def is_due(self, time_s: float) -> bool:
        """Whether advice is due at a time [s]."""
        return time_s >= self._next_s - 1e-9

    def give(self, time_s: float) -> None:
        """Advice is given at a time [s]."""
        self._next_s = next_multiple(time_s, self.every_s)

    def hurry(self) -> None:
        """Advice is due at once."""
        self._next_s = -math.inf


class LiveFlight:
    """A flight tracked through its plan by telemetry, and its planner.

    Parameters
    ----------
    mission : Mission
        Known before take-off. The flight starts at the first sample with a position if that is far from the mission's
        start.
    make : function of a Mission
        A new flight with its planner, and a forecast for planners without their own.
    every_s : float
        Maximum time between two pieces of advice [s].

    Attributes
    ----------
    forecast_completes : bool
        Whether the plan is complete, or is forecast at the last sample to be so before the battery is empty.
    """

    def __init__(
        self, mission: Mission, make: Callable[[Mission], tuple[PlannedFlight, HeldForecast]], every_s: float
    ) -> None:
        self._mission, self._make = mission, make
        self._schedule = _Schedule(every_s)
        self._messages = Messages()
        self._ground = _GroundVelocity(mission.cruise_mps)
        self._started = False
        # made at the first sample, by `_start`
        self._tracker: PlanTracker
        self._climbs: InitialClimb
        self._flight: PlannedFlight
        self._held: HeldForecast
        self._departure = Departure()
        self._began_elsewhere = False  # far from the plan's start, without a report of the stage
        self._origin_s = 0.0  # the flight's time 0 on the samples' clock [s]
        # time [s] and state of charge of the last sample
        self._last: tuple[float, float] = (0.0, 1.0)
        self.forecast_completes = False

    def know(self, autopilot: Autopilot) -> None:
        """Take what is read of the autopilot; what the mission states of one of its kind stays where nothing is."""
        stated = self._mission.autopilot
        if stated.kind == autopilot.kind:
            autopilot = replace(autopilot, parameters={**stated.parameters, **autopilot.parameters})
        self._mission = replace(self._mission, autopilot=autopilot)
        if self._started:
            self._flight.state.autopilot = autopilot

    def rest(self) -> PlannedLegs | None:
        """The legs that are left at the parameters decided, from the last known position on; None where it is unknown.

        Raises
        ------
        PathUndefined
            If they cannot be laid out.
        """
        if not self._started or self._tracker.complete or self._tracker.lost:
            return None
        executor, (time_s, position) = self._tracker.executor, self._tracker.located
        cursor = executor.cursor.decide(self._flight.decision.parameters)
        rest = RoutePredictor().route(cursor, executor.joined_m).planned()
        # roughly how much of the first leg is flown, by time and airspeed: `_rest_of` corrects it by the position
        flown_m = self._mission.cruise_mps * (time_s - self._tracker.stage_started_s)
        first, *others = rest.legs
        return PlannedLegs((_rest_of(first, position, flown_m), *others), rest.parameters, executor.stages_started)

    def update(self, sample: Sample) -> tuple[Advice | None, tuple[Notice, ...]]:
        """Update with a sample later than the last one; return advice, if any is due, and notices."""
        self._messages.clear()
        velocity = self._ground.update(sample)
        if not self._started:
            if sample.position_m is None and self._mission.start_m is None:
                return None, (Notice("x_m", "the flight starts at the first position", "a position"),)
            self._start(sample)
        tracker = self._tracker
        to = sample._replace(time_s=sample.time_s - self._origin_s, velocity_mps=velocity)
        if tracker.complete and not tracker.end_uncertain:
            return None, ()
        if not tracker.complete and sample.soc is not None and sample.soc <= 0:
            return self._advise_empty(sample), ()
        self._schedule.empty = False
        advice = self._track_and_advise(sample, to)
        # past the end only what comes with advice is of use
        return advice, () if advice is None and tracker.complete else tuple(self._messages.notices)

    def _track_and_advise(self, sample: Sample, to: Sample) -> Advice | None:
        """Track the plan, update the planner, and return advice if any is due.

        `to` is the sample at the time of the flight, with its ground velocity.
        """
        tracker, flight, before, time_s = self._tracker, self._flight, self._flight.decision, to.time_s
        if sample.mode.flies_mission is not False:
            tracker.flies_mission = bool(sample.mode.flies_mission)
        # the charge measured, else the one known; and the parameters reported: NaN is one on its way to the aircraft
        soc = flight.state.soc if sample.soc is None else sample.soc
        self._climbs.update(sample, _altitude_m(self._mission, tracker.executor.stage))
        position = self._track(flight, to, soc)
        tracker.put_in_force(_by_name(self._mission.plan, sample.parameters), time_s, position, flight.planner.hold)
        # whether the plan has ended; `ends` is None where that has not changed
        step_s, self._last = time_s - self._last[0], (time_s, soc)
        was_complete, ends = tracker.complete, tracker.update_end(to, position, step_s)
        if ends is not None:
            self.forecast_completes = ends
        if tracker.complete:
            ending = Ending(remaining_s=0.0, soc_end=soc, soc_end_std=0.0, completes_probability=1.0)
            return None if was_complete else self._advice(sample, COMPLETED, sample.wind_mps, ending)
        # the planner's decision; advice where that is new, or advice is due
        self._update_departure(to)
        observation = self._observation(to, position, soc)
        self._update_planner(flight, observation)
        now = flight.decision
        changed = (now.parameters, now.reason) != (before.parameters, before.reason)
        replanned = now.record is not before.record or changed
        if not (replanned or self._schedule.is_due(time_s)):
            return None
        advice = self._advise(flight, sample, observation)
        self._schedule.give(time_s)
        self.forecast_completes = not observation.returns_home and (
            tracker.end_uncertain or (advice.ending.soc_end or 0.0) > 0
        )
        return advice

    # --- the plan

    def _start(self, sample: Sample) -> None:
        """Begin with the first sample: set time and place of the start, and take off, or find where the flight is."""
        mission = self._mission
        self._origin_s = 0.0 if 0 <= sample.time_s <= CLOCK_START_S else sample.time_s
        elapsed_s = sample.time_s - self._origin_s
        start, away = self._place_of_start(sample.position_m, elapsed_s)
        self._climbs = InitialClimb(sample, mission.cruise_mps, _altitude_m(mission, mission.plan.stages[0]))
        if self._climbs.from_ground:
            mission = self._mission = replace(mission, altitude_m=sample.altitude_m or 0.0)
        # a flight in the middle of its plan has the parameters that it reports
        within = sample.stage not in (None, 1) or (sample.stages_started or 1) > 1
        reported = _by_name(mission.plan, sample.parameters) if within or away else {}
        time_s, begins_m = min(0.0, elapsed_s), mission.start_m or start if within else start
        self._tracker = PlanTracker(mission, begins_m, time_s, self._messages, reported)
        self._last = (time_s, mission.battery.soc if sample.soc is None else sample.soc)
        self._started = True
        if within:
            self._tracker.begin_within(sample._replace(time_s=elapsed_s))
        else:
            self._messages.reasons.append(TAKE_OFF)
            self._tracker.guessed = self._began_elsewhere = away
        executor = self._tracker.executor
        mission = replace(mission, start_m=executor.joined_m, parameters=executor.parameters)
        mission = replace(mission, live=True, clock_s=self._origin_s)
        self._flight, self._held = self._make(mission)

    def _place_of_start(self, position: Point | None, elapsed_s: float) -> tuple[Point, bool]:
        """Where the flight starts [m], and whether that is away from the mission's start.

        It is the mission's, if the first position can be reached from it in the time flown, else that position.
        """
        start = self._mission.start_m
        if start is None or position is None:
            known = start or position
            assert known is not None
            return known, False
        away = math.dist(position, start) > SPEED_FACTOR * self._mission.cruise_mps * elapsed_s + SLACK_M
        return (position, True) if away else (start, False)

    def _track(self, flight: PlannedFlight, to: Sample, soc: float) -> Point:
        """Advance through the plan to a sample; return the position at it, see `PlanTracker.track`.

        The planner observes each stage that starts before the sample, at that time.
        """
        last_s, last_soc = self._last

        def started(time_s: float, position: Point, part: float) -> None:
            """Have the planner observe a start of a stage; `part` is how much of the way from the last sample it is."""
            # a charge between two readings of a gauge is no reading: the sample has none
            at_start = Sample(max(time_s, last_s), position, power_w=None, soc=None)
            self._update_planner(flight, self._observation(at_start, position, last_soc + part * (soc - last_soc)))

        return self._tracker.track(to, flight.state.wind_mps, started)

    def _update_departure(self, to: Sample) -> None:
        """Update whether the plan is flown, and where it is taken up again, with a sample that is tracked."""
        tracker, was_away = self._tracker, self._departure.away
        executor = tracker.executor
        # the first leg may be joined from anywhere
        known = to.position_m is not None and executor.stages_started > 1 and not tracker.stage_unknown
        mismatch = path_mismatch(executor, to) if known else 0.0
        if self._climbs.on_plan:
            self._departure.update(to, mismatch)
        if self._departure.away_s > BY_HAND_S:
            tracker.through_gap = True
        back = bool(to.mode.flies_mission) and was_away
        self._departure.rejoins = (self._departure.rejoins or back) and (tracker.is_behind or mismatch > FAR)

    @property
    def _not_placed(self) -> bool:
        """Whether nothing shows yet where in its plan the flight began: no report, and no start of a stage."""
        return self._began_elsewhere and self._tracker.guessed

    def _observation(self, to: Sample, position: Point, soc: float) -> Observation:
        """A sample as an observation, see `PlanTracker.observation`."""
        return self._tracker.observation(to, position, soc)._replace(
            on_plan=self._climbs.on_plan and not (self._departure.away or self._not_placed),
            returns_home=to.mode.returns_home or self._flight.decision.returns_home,
            rejoins_at_start=self._tracker.is_behind if self._departure.rejoins else None,
        )

    # --- the planner

    def _update_planner(self, flight: PlannedFlight, observation: Observation) -> None:
        """Update the planner with an observation, and the plan with its decision; not once the plan is complete."""
        if self._tracker.complete:
            return
        before = flight.decision
        try:
            now = flight.take(observation)
            # in flight the figures of each re-planning are asked for by no one, and a flight may last
            flight.planner.report.gaps.clear()
            flight.planner.report.solve_ms.clear()
        except Exception as error:  # in flight, a failure of the planner must not stop the advice
            what = f"the planner failed, and parameters stay: {type(error).__name__}: {printable(str(error))}"
            if what != self._messages.failure:
                self._messages.failure = what
                self._messages.notices.append(Notice("time_s", what))
            return
        if now.parameters != before.parameters:
            self._messages.reasons.append(now.reason)
        # also where a new decision has the same values
        if now.parameters is not before.parameters or now.airspeeds_mps is not before.airspeeds_mps:
            self._tracker.decide(now.parameters, observation.position_m, now.airspeeds_mps)

    # --- advice

    def _advise(self, flight: PlannedFlight, sample: Sample, observation: Observation) -> Advice:
        """Advice by the last decision: with its own forecast, or if that is too old, with one at the parameters flown.

        Adds the decision's reason to those of this sample.
        """
        decision, record, reasons = flight.decision, flight.decision.record, self._messages.reasons
        if self._not_placed:
            return self._advice(sample, NOT_PLACED, sample.wind_mps, Ending())
        if self._departure.away:
            reason = RETURNS if sample.mode.returns_home else NOT_FLOWN
            end = self._forecast(flight.state, self._tracker.applied.effective)
            return self._advice(sample, reason, sample.wind_mps, Ending() if end is None else end.finite)
        # once home is flown to, the forecast is of the way there
        if record is not None and (observation.returns_home or self._is_old(record.time_s, observation.time_s)):
            record = None
        # "kept" is no reason beside another one
        kept = decision.reason.startswith(KEPT) and BY_FALLBACK not in decision.reason
        if decision.reason not in reasons and not (reasons and kept):
            reasons.append(decision.reason)
        reason = "; ".join(reason for reason in reasons if reason) or KEPT
        if record is not None and record.ending.soc_end is not None:
            reachable, *times_s = record.home
            home = HomeRecord(reachable, *(None if at_s is None else at_s + self._origin_s for at_s in times_s))
            return self._advice(sample, reason, record.wind_mps, record.ending.finite)._replace(home=home)
        end = None if self._tracker.lost else self._forecast(flight.state, self._tracker.applied.effective)
        return self._advice(sample, reason, sample.wind_mps, Ending() if end is None else end.finite)

    def _is_old(self, time_s: float, now_s: float) -> bool:
        """Whether a record of a time [s] is no forecast any more."""
        return now_s - time_s > max(RECENT_S, 3 * self._schedule.every_s)

    def _forecast(self, state: FlightState, parameters: Vector) -> Ending | None:
        """The end of the plan at parameters that are held; None where it is unknown."""
        with contextlib.suppress(EadpError):
            return self._held.at(state.known(state.now.time_s, state.now.position_m), parameters)
        return None

    def _advise_empty(self, sample: Sample) -> Advice | None:
        """Advice that the battery is empty by its gauge, once; None after it, until charge is measured again."""
        self.forecast_completes = False
        if self._schedule.empty:
            return None
        self._schedule.empty = True
        self._schedule.hurry()
        return self._advice(sample, EMPTY, sample.wind_mps, Ending(soc_end=0.0, completes_probability=0.0))

    def _advice(self, sample: Sample, reason: str, wind_mps: Point | None, ending: Ending) -> Advice:
        """Advice at a sample, with the position in the plan and the parameters as they are."""
        tracker, names = self._tracker, self._mission.plan.names
        executor = tracker.executor
        return Advice(
            time_s=sample.time_s,
            stage=executor.stage.index,
            lap=executor.cursor.lap,
            parameters=dict(zip(names, tracker.applied.asked, strict=True)),
            in_force=dict(zip(names, executor.parameters, strict=True)),
            ending=ending,
            wind_mps=wind_mps,
            reason=reason,
            warnings=self._warnings(sample),
            returns_home=self._flight.decision.returns_home,
            airspeed_mps=executor.cursor.airspeed_mps if self._flight.decision.airspeeds_mps else None,
        )

    def _warnings(self, sample: Sample) -> tuple[str, ...]:
        """Codes of what is wrong: with the sample, with the flight in its plan, with the readings so far."""
        applies = {
            STALE: sample.position_m is None or sample.soc is None,
            STAGE_UNKNOWN: self._tracker.stage_unknown,
            NOT_APPLIED: bool(self._tracker.applied.held),
        }
        return (*sample.warnings, *(code for code, holds in applies.items() if holds), *self._flight.state.warnings)


def _altitude_m(mission: Mission, stage: Stage) -> float:
    """The altitude that holds on a stage [m]."""
    return mission.vehicle.cruise_altitude_m if stage.altitude_m is None else stage.altitude_m


class _GroundVelocity:
    """Ground velocity: measured, else estimated from the positions of the last seconds."""

    def __init__(self, cruise_mps: float) -> None:
        self._max_mps = SPEED_FACTOR * cruise_mps
        self._positions: deque[tuple[float, float, float]] = deque()  # t [s], x and y [m]

    def update(self, sample: Sample) -> Point | None:
        """Add a sample's position to the window; return the velocity at it [m/s], None if unknown.

        Source: the least-squares parabola through the positions, its slope at the last one, so that turns do not lag.
        """
        positions = self._positions
        position = sample.position_m
        if position is None:
            return sample.velocity_mps
        if positions and sample.time_s - positions[-1][0] > MAX_CHORD_S:
            positions.clear()
        positions.append((sample.time_s, *position))
        while len(positions) > 2 and sample.time_s - positions[0][0] > WINDOW_S:
            positions.popleft()
        if sample.velocity_mps is not None:
            return sample.velocity_mps
        data = np.array(positions)
        times, offsets = data[:, 0] - sample.time_s, data[:, 1:] - data[-1, 1:]
        if len(positions) < 2 or -times[0] < MIN_SPAN_S:
            return None
        # p = p₀ + v t + c t², with t and p from the last one; a line through two
        vx, vy = np.polyfit(times, offsets, min(2, len(positions) - 1))[-2].tolist()
        return (vx, vy) if math.hypot(vx, vy) <= self._max_mps else None


def _by_name(plan: Plan, values: Mapping[str, float]) -> dict[str, float]:
    """Values of parameters by name, of those by name or title; names that the plan does not know stay."""
    found = {}
    for key, value in values.items():
        if (i := plan.parameter(key)) is None:
            found[key] = value
            continue
        item = plan.parameters[i]
        by_title = key != item.name and plan.has_sets
        found[item.name] = item.of_shown(value, plan.hull(i)) if by_title else value
    return found


def _rest_of(leg: Leg, position: Point, flown_m: float) -> Leg:
    """A leg from a position on [m], with about the distance flown on it so far [m]; see `left_m`."""
    rest_m = min(left_m(leg, position, flown_m), leg.distance_m)
    (ox, oy), (x, y) = leg.offset_m, leg.track.nearest(leg.local_m(position))
    cut_m = leg.length_m - leg.distance_m
    return leg._replace(start_m=(x + ox, y + oy), length_m=rest_m + cut_m, flown_m=rest_m)

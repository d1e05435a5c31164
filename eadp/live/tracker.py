"""A flight tracked through its plan by telemetry: stage and lap, parameters in force, and the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, PathUndefined, printable
from eadp.live.gate import AppliedParameters, Continuation, Notice, is_certain
from eadp.live.locator import (
    GAP_S,
    GAP_STEPS,
    MAX_STDS,
    FollowedExecutor,
    best_match,
    legs_ahead,
    line_between,
    time_std_s,
)
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import Box
from eadp.models.world import Mission
from eadp.planning.base import Observation, Sample

MAX_NOTICES = 100
GOES_ON = "the flight goes on after the final point"
UNCERTAIN_END = "final point passed by less than the error of a position"


@dataclass
class Messages:
    """Reasons of the advice at one sample, and notices of what is wrong with it."""

    reasons: list[str] = field(default_factory=list)
    notices: list[Notice] = field(default_factory=list)
    noticed: set[str] = field(default_factory=set)
    """What there has been a notice about, over the flight."""
    failure: str = ""
    """The last one of the planner that there was a notice of."""

    def clear(self) -> None:
        """Begin another sample, without reasons and notices; `noticed` stays."""
        self.reasons, self.notices = [], []

    def once(self, key: str, message: str, expected: str, about: str = "") -> None:
        """Add a notice, unless there has been one about the same thing, `about`; by default, the same message."""
        if (about or message) not in self.noticed and len(self.noticed) < MAX_NOTICES:
            self.noticed.add(about or message)
            self.notices.append(Notice(key, message, expected))


Started = Callable[[float, Point, float], None]
"""Called at each start of a stage before a sample: its time [s], position [m] and share of the way to the sample."""


class PlanTracker:
    """Where a flight is in its plan, and which parameters are in force.

    A stage that is reported has precedence. Else the plan's triggers along the straight line between two positions end
    stages, as in a simulation; after a gap the flight is on the leg ahead that its position, course and time fit best,
    and on the stage of that line where none fits.

    Parameters
    ----------
    mission : Mission
    start_m : (float, float)
        Where the flight starts [m].
    time_s : float
        When [s].
    messages : Messages
        Takes what there is to say.
    reported : mapping of str to float, optional
        Parameters in force at the start, by name.

    Attributes
    ----------
    executor : FollowedExecutor
        The flight through the plan.
    stage_started_s : float
        When its stage started [s].
    through_gap : bool
        Whether the start of the stage, or the end of the one before, may have been in a gap.
    guessed : bool
        Whether the stage is the likeliest one alone: after a gap, or in the middle of a flight, until the next starts.
    applied : AppliedParameters
    complete : bool
        Whether the plan is complete.
    lost : bool
        Whether the plan cannot be followed any more, for good.
    located : (float, (float, float))
        Time of the last known position [s], and that position [m].
    flies_mission : bool
        Whether an autopilot has a mission laid out before, so that its end is certain.
    is_behind : bool
        Whether it flies to an item of a stage behind.
    """

    def __init__(
        self,
        mission: Mission,
        start_m: Point,
        time_s: float,
        messages: Messages,
        reported: Mapping[str, float] | None = None,
    ) -> None:
        self._mission, self._messages = mission, messages
        plan, parameters = mission.plan, mission.parameters
        if reported and plan.has_sets:
            known = self._clipped(reported, [plan.hull(i) for i in range(len(parameters))])
            parameters = tuple([known.get(i, value) for i, value in enumerate(parameters)])
        self.executor = FollowedExecutor(PlanCursor.start(plan, parameters, mission.rules), start_m)
        self.stage_started_s = time_s
        self.applied = AppliedParameters(parameters, plan)
        self.located: tuple[float, Point] = (time_s, start_m)
        self._last_step_s = 0.0
        self._continuation: Continuation | None = None
        self.lost = self.complete = self.flies_mission = self.is_behind = False
        self.through_gap = self.guessed = self._blind = False

    @property
    def end_uncertain(self) -> bool:
        """Whether an end of the plan is reached, and it is not known yet whether the flight goes on after it."""
        return self._continuation is not None

    @property
    def stage_unknown(self) -> bool:
        """Whether the stage is not certain."""
        return self.lost or self.guessed or self._blind or (self.end_uncertain and not self.complete)

    def observation(self, sample: Sample, position: Point, soc: float) -> Observation:
        """A sample, and where the flight is in its plan, as an observation.

        `position` [m] and `soc` stand for those of the sample, which may not have measured them.
        """
        executor = self.executor
        at = sample._replace(position_m=position, mode=sample.mode._replace(flies_mission=self.flies_mission))
        return Observation(at, soc, executor.cursor, executor.joined_m, executor.stages_started, self.through_gap)

    # --- stage and lap

    def begin_within(self, to: Sample) -> None:
        """Begin in the middle of the flight: on the reported stage, in the lap by its number or the position."""
        if to.position_m is not None:
            self.located = to.time_s, to.position_m
        try:
            if not self._find(to, None, (0.0, 0.0)):
                self._skip(to, self._take_report(to) or 0, to.time_s, lambda *_: None)
        except EadpError as error:
            self._lose(error)
        self.through_gap, self.guessed = True, to.stages_started is None

    def track(self, to: Sample, wind_mps: Point, started: Started) -> Point:
        """Find the flight's place in the plan; return the aircraft's position, the last known one without any [m].

        `started` is called at each start of a stage before this sample.
        """
        before, position = self.located, to.position_m
        last_s, last = before
        step_s = to.time_s - last_s
        gap = step_s > GAP_S and step_s > GAP_STEPS * self._last_step_s
        self._blind = position is None and step_s > GAP_S
        if position is not None:
            self.located, self._last_step_s = (to.time_s, position), step_s
        # whatever triggers are passed, a mission that is not flown is taken up again on this stage
        waits = to.mode.flies_mission is False and not (to.mode.returns_home and self._may_end)
        if self.lost or waits:
            return position or last
        try:
            skips = 0 if to.mode.flies_mission is False else self._take_report(to)
            if position is None:
                self._skip(to, skips or 0, last_s, started)
            elif not (gap and skips is None and self._find(to, before, wind_mps)):
                self._follow(to, line_between(last, position), skips, last_s, started)
        except EadpError as error:
            self._lose(error)
        return position or last

    def _follow(self, to: Sample, line: list[Point], skips: int | None, last_s: float, started: Started) -> None:
        """Advance along a line, from `last_s` [s] on, by its triggers, or by a number of stages, at its end."""
        for k, (x, y) in enumerate(line, 1):
            share = k / len(line)
            if skips is not None:
                self.executor.stay(x, y)
            elif self.executor.advance(x, y):
                self._start(last_s + share * (to.time_s - last_s))
                if k < len(line):
                    started(self.stage_started_s, (x, y), share)
            if self.executor.complete:
                break
        self._skip(to, skips or 0, last_s, started)

    def _skip(self, to: Sample, skips: int, last_s: float, started: Started) -> None:
        """Leave a number of stages, as reported, at the sample's position, or at their triggers where it has none."""
        for k in range(1, skips + 1):
            if self.executor.complete:
                break
            position = to.position_m or self.executor.trigger_m
            self.executor.skip(position)
            self._start(last_s + k / skips * (to.time_s - last_s))
            self.through_gap |= skips != 1
            # the last stage starts at `to`, which the caller observes itself
            if k < skips and not self.executor.complete:
                started(self.stage_started_s, position, 1.0)

    def _start(self, time_s: float) -> None:
        """Note that a stage starts at a time [s]."""
        self.stage_started_s, self.through_gap, self.guessed = time_s, False, False

    def _find(self, to: Sample, before: tuple[float, Point] | None, wind_mps: Point) -> bool:
        """Put the flight on the leg ahead that a sample fits best, of the reported stage; return whether one does.

        Legs are ahead of the time and place `before` a gap, or, with None, of the start of the plan, at any time.
        """
        if to.position_m is None:
            return False
        last_s, last = before or (self.stage_started_s, self.executor.joined_m)
        elapsed_s = None if before is None else to.time_s - last_s
        latest_s = math.inf if elapsed_s is None else elapsed_s + MAX_STDS * time_std_s(elapsed_s)
        flown_s, flown = max(last_s - self.stage_started_s, 0.0), self.executor.stages_started
        found = []
        try:
            for ahead in legs_ahead(self.executor, flown_s, last, self._mission.cruise_mps, wind_mps):
                if ahead.start_s > latest_s:
                    break
                count = flown + ahead.legs_on
                if to.stage in (None, ahead.leg.stage.index) and to.stages_started in (None, count):
                    found.append(best_match(ahead, to, elapsed_s))
        except PathUndefined:
            return False
        best = min((match for match in found if match is not None), key=lambda match: match.mismatch, default=None)
        if best is None:
            return False
        ahead = best.ahead
        joined = ahead.leg.start_m if ahead.legs_on else self.executor.joined_m
        self.executor = self.executor.placed(ahead.cursor, joined, flown + ahead.legs_on, to.position_m, best.share)
        self.stage_started_s = to.time_s - best.share * ahead.duration_s
        self.through_gap = self.guessed = True
        return True

    def _leads(self, stages: int) -> bool:
        """Whether the flight may be that many stages ahead: the plan has them. A negative number is behind: False."""
        if stages < 2:  # behind; or this stage, or the one after it, which need no route
            return stages >= 0
        try:
            return stages < len(RoutePredictor().route(self.executor.cursor, self.executor.joined_m).legs)
        except PathUndefined:
            return False

    @property
    def _may_end(self) -> bool:
        """Whether the plan may end in this lap."""
        cursor = self.executor.cursor
        return cursor.next() is None or cursor.end() is not None

    def _take_report(self, to: Sample) -> int | None:
        """Number of stages to skip by what a sample reports; None where its position decides.

        A reported count of stages has precedence over the stage's index. A report that cannot be true gives a notice,
        and is ignored. An autopilot that takes its mission up again may fly to the item before, whose stage is behind.
        """
        self.is_behind = False
        if to.stages_started is not None:
            flown = self.executor.stages_started
            if self._leads(to.stages_started - flown):
                self.guessed = False
                return to.stages_started - flown
            if to.mode.flies_mission:
                self.is_behind = True
                return 0
            what = f"{to.stages_started} stages started, and {flown} are flown; ignored"
            self._messages.once("stages_started", what, "a stage ahead")
        return None if to.stage is None else self._ahead_to(to.stage)

    def _ahead_to(self, reported: int) -> int | None:
        """Number of stages from the one flown to the next with the reported index, from 1; 0 if it is the one flown.

        None where the position decides: with a notice where the index cannot be true, and in a plan of one stage.
        """
        now, count = self.executor.stage.index, len(self._mission.plan.stages)
        if reported > count:
            self._messages.once("stage", f"there is no stage {reported}; ignored", f"one of 1 to {count}")
            return None
        if reported == now:
            one_stage = self.executor.stages_to(now) == 1  # whose laps only positions distinguish
            return None if one_stage else 0
        skips = self.executor.stages_to(reported)
        if skips is None or (reported < now and self._jumps_back(skips)):
            what = f"stage {reported} is before stage {now}, which is flown; ignored"
            self._messages.once("stage", what, "a stage ahead")
            return None
        return skips

    def _jumps_back(self, skips: int) -> bool:
        """Whether to skip so many stages is more than half of a lap: 4 → 1 of 4 is the next lap, and 3 → 2 is not."""
        lap = self.executor.stages_to(self.executor.stage.index)  # from a start of this stage to the next one
        return lap is not None and 2 * skips > lap

    def update_end(self, to: Sample, position: Point, step_s: float) -> bool | None:
        """Update `complete` and `end_uncertain` with a sample, `step_s` [s] after the last one.

        Where the plan has more stages after the end reached, it is followed past that end, and later positions decide
        whether the aircraft flies on: then `complete` is False again.

        Returns
        -------
        bool or None
            True where an end of the plan is reached, be it uncertain, or confirmed; False where the aircraft is seen to
            fly on; None where nothing has changed.
        """
        if self._continuation is not None:
            goes_on = self._continuation.update(self.executor, to, step_s)
            if goes_on is None:
                return None
            self._continuation = None
            if goes_on:
                self.through_gap |= self.complete
                self._messages.reasons.append(GOES_ON)
                self._messages.notices.append(Notice("x_m", GOES_ON))
            self.complete = not goes_on
            return self.complete
        if not self.executor.complete:
            return None
        certain = is_certain(self.executor, position, to.course_rad)  # before the executor is moved past this end
        try:
            following = self.executor.past_end()
        except PathUndefined:  # the next lap has no path
            following = None
        self.complete = certain or following is None
        if following is not None:
            self.executor = following
            self._continuation = Continuation(following)
        if not self.complete:
            self._messages.reasons.append(UNCERTAIN_END)
        return True

    # --- parameters

    def decide(self, parameters: Vector, position: Point, airspeeds_mps: Vector) -> None:
        """Put decided parameters, as far as the aircraft applies them, and airspeeds into the plan at a place [m]."""
        self.applied.decide(parameters)
        if not self.lost:
            try:
                self.executor.decide(self.applied.effective, position, airspeeds_mps)
            except EadpError as error:
                self._lose(error)

    def put_in_force(
        self,
        parameters: Mapping[str, float],
        time_s: float,
        position: Point,
        hold: Callable[[Mapping[int, float]], None],
    ) -> None:
        """Put the parameters that the aircraft reports in force, at a position [m].

        `hold` is called with those that the aircraft does not change, by index, where these are others than before. A
        parameter that is not a number is on its way to the aircraft.
        """
        if not parameters or self.lost:
            return
        by_rules, names = self.executor.parameters, self._mission.plan.names
        on_their_way = [i for i, name in enumerate(names) if math.isnan(parameters.get(name, 0.0))]
        released = [self.applied.release(i) for i in on_their_way]
        reported = self._clipped(parameters, self.executor.stage.sets)
        apart = []
        if not self.executor.cursor.table.live:  # else nothing waits for its stage
            apart = self.applied.update_apart(time_s, reported, by_rules)
        in_force = {i: value for i, value in reported.items() if i not in apart}
        try:
            self.executor.take_in_force([in_force.get(i, value) for i, value in enumerate(by_rules)], position)
            changed = self.applied.update(time_s, reported, by_rules)
            if changed or any(released):
                self._hold(position, hold)
        except EadpError as error:
            self._lose(error)

    def _clipped(self, parameters: Mapping[str, float], sets: Sequence[Box]) -> dict[int, float]:
        """Parameters reported that are numbers, by index, within their sets, if there are any.

        There is a notice of each that is changed or unknown.
        """
        names = self._mission.plan.names
        reported: dict[int, float] = {}
        for name, value in parameters.items():
            if name not in names:
                known = f"one of {', '.join(names) or 'none'}"
                what = f"the plan has no parameter {printable(name, 40)}; ignored"
                self._messages.once("parameters", what, known, name)
            elif not math.isnan(value):
                i = names.index(name)
                reported[i] = sets[i].clip(value) if sets else value
                if reported[i] != value:
                    known = f"a value in [{sets[i].lo:.10g}, {sets[i].hi:.10g}]"
                    what = f"{name} = {value:g} is outside its set; clipped"
                    self._messages.once("parameters", what, known, f"{name} outside")
        return reported

    def _hold(self, position: Point, hold: Callable[[Mapping[int, float]], None]) -> None:
        """Have the planner hold the parameters that the aircraft does not change, with a notice of each.

        The plan is followed with the parameters that will be in force.
        """
        held = self.applied.held
        hold(held)
        self.executor.decide(self.applied.effective, position)
        for i, value in held.items():
            item, asked = self._mission.plan.parameters[i], self.applied.asked[i]
            what = f"{item.label} = {item.text(asked)} is not applied: {item.text(value)} stays in force"
            self._messages.once("parameters", what, "the parameters decided", f"{item.name} held at {value:g}")

    def _lose(self, error: EadpError) -> None:
        """Stop tracking the plan for good, with a notice: stage and parameters stay."""
        self.lost = True
        self._messages.notices.append(Notice("x_m", f"the plan cannot be followed on from here: {error}"))

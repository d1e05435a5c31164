"""A flight tracked through its plan by telemetry: stage and lap, parameters in force, and the end."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, printable
from eadp.live.gate import AppliedParameters, Continuation, Notice, is_certain
from eadp.live.locator import GAP_S, GAP_STEPS, Acquisition, Hypothesis, Locator
from eadp.models.plan.cursor import Vector
from eadp.models.plan.executor import PlanExecutor
from eadp.planning.base import Mission, Observation, Sample

MAX_NOTICES = 100
FOUND = "stage and lap are found"
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


class PlanTracker:
    """Where a flight is in its plan, and which parameters are in force.

    Parameters
    ----------
    mission : Mission
    start_m : (float, float)
        Where the flight starts [m].
    time_s : float
        When [s].
    messages : Messages
        Takes what there is to say.

    Attributes
    ----------
    acquisition : Acquisition or None
        Finds stage and lap where telemetry begins in the middle of the flight, until they are found.
    applied : AppliedParameters
    complete : bool
        Whether the plan is complete.
    locator : Locator
        Has the hypotheses of where the flight is.
    lost : bool
        Whether the plan cannot be followed any more, for good; `locator.lost` is until the flight is found again.
    located : (float, (float, float))
        Time of the last known position [s], and that position [m].
    flies_mission : bool
        Whether an autopilot has a mission laid out before, so that its end is certain.
    is_behind : bool
        Whether it flies to an item of a stage behind.
    """

    def __init__(self, mission: Mission, start_m: Point, time_s: float, messages: Messages) -> None:
        self._mission, self._messages = mission, messages
        executor = PlanExecutor(mission.plan, mission.parameters, start_m, mission.rules)
        self.locator = Locator(executor, mission.cruise_mps, time_s)
        self.applied = AppliedParameters(mission.parameters, mission.plan)
        self.located: tuple[float, Point] = (time_s, start_m)
        self._last_step_s = 0.0
        self.acquisition: Acquisition | None = None
        self._continuation: Continuation | None = None
        self._past_stage: int | None = None  # the stage behind that was reported last: one notice for each
        self.lost = self.complete = self.flies_mission = self.is_behind = False

    @property
    def executor(self) -> PlanExecutor:
        """The flight through the plan."""
        return self.locator.executor

    @property
    def end_uncertain(self) -> bool:
        """Whether an end of the plan is reached, and it is not known yet whether the flight goes on after it."""
        return self._continuation is not None

    @property
    def stage_unknown(self) -> bool:
        """Whether the stage is not certain."""
        undecided = self.acquisition is not None or (self.end_uncertain and not self.complete)
        return self.lost or self.locator.uncertain or undecided

    def observation(self, sample: Sample, position: Point, soc: float) -> Observation:
        """A sample, and where the flight is in its plan, as an observation.

        `position` [m] and `soc` stand for those of the sample, which may not have measured them.
        """
        executor, gap = self.executor, self.locator.through_gap
        at = sample._replace(position_m=position, flies_mission=self.flies_mission)
        return Observation(at, soc, executor.cursor, executor.joined_m, executor.stages_started, gap)

    # --- stage and lap

    def acquire_from(self, start_m: Point) -> None:
        """Find stage and lap of a flight that may have started there [m] long ago."""
        self.acquisition = Acquisition(self.executor, start_m)

    def place(self, found: Hypothesis, to: Sample, parameters: Vector, *, settled: bool) -> None:
        """Track on from a hypothesis, with the parameters decided; `settled` if stage and lap are found."""
        self.applied = AppliedParameters(parameters, self._mission.plan)
        self.locator = Locator(found.executor, self._mission.cruise_mps, to.time_s, to.position_m)
        self.locator.hypotheses, self.locator.through_gap = [found], True
        if to.position_m is not None:
            self._last_step_s, self.located = to.time_s - self.located[0], (to.time_s, to.position_m)
            self.locator.decide(self.applied.effective, to.position_m)
        if settled:
            self.acquisition = None
            self._messages.reasons.append(FOUND)

    def track(
        self, to: Sample, last_s: float, wind_mps: Point, started: Callable[[float, Point, float], None]
    ) -> Point:
        """Find the flight's place in the plan; return the aircraft's position, as measured or as forecast [m].

        In ordinary flight the plan is advanced along the straight line from the last sample, at `last_s` [s], and a
        reported stage has precedence. `started` is called at each start of a stage before this sample, see
        `Locator.follow`.
        """
        (located_s, last), position = self.located, to.position_m
        step_s = to.time_s - located_s
        gap = step_s > GAP_S and (position is None or step_s > GAP_STEPS * self._last_step_s)
        if position is not None:
            self.located, self._last_step_s = (to.time_s, position), step_s
        if self.lost:
            return position or last
        try:
            if to.flies_mission is False and not (to.returns_home and self._may_end):
                # whatever triggers are passed, the mission is taken up again on this stage
                if position is not None:
                    self.locator.wait(to.time_s, position)
                return position or last
            if gap or self.locator.lost:
                sought = self._seek(to, last_s, wind_mps, started)
                if sought is not None or position is None:
                    return sought or last
                # the plan cannot be laid out after the gap: it is followed straight across the gap, as below
            elif position is None:
                return last
            self.locator.follow(to, 0 if to.flies_mission is False else self._take_report(to), started)
        except EadpError as error:
            self._lose(error)
        assert position is not None
        return position

    def _seek(
        self, to: Sample, last_s: float, wind_mps: Point, started: Callable[[float, Point, float], None]
    ) -> Point | None:
        """Find the flight again after a gap, see `Locator.seek`; `started` is called if it is on a later stage."""
        before = self.executor.stages_started
        position = self.locator.seek(to, wind_mps)
        since_s = self.locator.hypotheses[0].stage_started_s
        if position is not None and self.executor.stages_started != before and last_s < since_s < to.time_s:
            started(since_s, self.executor.joined_m, 1.0)
        return position

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
            if self.locator.leads(to.stages_started - flown):
                return to.stages_started - flown
            if to.flies_mission:
                self.is_behind = True
                return 0
            what = f"{to.stages_started} stages started, and {flown} are flown; ignored"
            self._messages.once("stages_started", what, "a stage ahead")
        return None if to.stage is None else self._ahead_to(to.stage)

    def _ahead_to(self, reported: int) -> int | None:
        """Number of stages from the one flown to the next with the reported index, from 1; 0 if it is the one flown.

        None where the position decides: with a notice where the index cannot be true, and in a plan of one stage.
        """
        executor = self.executor
        now, count = executor.stage.index, len(self._mission.plan.stages)
        if reported > count:
            self._messages.once("stage", f"there is no stage {reported}; ignored", f"one of 1 to {count}")
            return None
        # to the next start of that stage: in the next lap where it is the one flown, or one before it
        skips = executor.stages_to(reported)
        if reported == now:
            self._past_stage = None
            # only positions distinguish the laps of a plan of one stage
            return None if skips == 1 else 0
        # a lap has as many stages as there are to the next start of this one
        lap_stages = executor.stages_to(now) if reported < now else None
        # a stage behind: 4 → 1 is the next lap; 3 → 2 is a jump back, since forwards is more than half of a lap
        if skips is None or (lap_stages is not None and 2 * skips > lap_stages):
            if self._past_stage != reported:
                self._past_stage = reported
                what = f"stage {reported} is before stage {now}, which is flown; ignored"
                self._messages.notices.append(Notice("stage", what, "a stage ahead"))
            return None
        self._past_stage = None
        return skips

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
                self.locator.through_gap |= self.complete
                self._messages.reasons.append(GOES_ON)
                self._messages.notices.append(Notice("x_m", GOES_ON))
            self.complete = not goes_on
            return self.complete
        if not self.executor.complete:
            return None
        certain = is_certain(self.executor, position, to.course_rad)  # before the executor is moved past this end
        has_more = self.locator.go_on()
        self.complete = certain or not has_more
        if has_more:
            self._continuation = Continuation(self.executor)
        if not self.complete:
            self._messages.reasons.append(UNCERTAIN_END)
        return True

    # --- parameters

    def decide(self, parameters: Vector, position: Point, airspeeds_mps: Vector) -> None:
        """Put decided parameters, as far as the aircraft applies them, and airspeeds into the plan at a place [m]."""
        self.applied.decide(parameters)
        if not self.lost:
            try:
                self.locator.decide(self.applied.effective, position, airspeeds_mps)
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
        expected, names = self.executor.parameters, self._mission.plan.names
        on_their_way = {name for name, value in parameters.items() if math.isnan(value)}
        released = [self.applied.release(names.index(name)) for name in on_their_way & set(names)]
        reported = self._clipped({name: value for name, value in parameters.items() if name not in on_their_way})
        values = [reported.get(i, value) for i, value in enumerate(expected)]
        if not self.executor.cursor.table.live:
            for i in self.applied.update_apart(time_s, reported, expected):
                values[i] = expected[i]
        try:
            self.locator.take_in_force(values, position)
            if self.applied.update(time_s, reported, expected) or any(released):
                self._hold(position, hold)
        except EadpError as error:
            self._lose(error)

    def _clipped(self, parameters: Mapping[str, float]) -> dict[int, float]:
        """Parameters reported, by index, within their sets; with a notice of each that is changed or unknown."""
        names, sets = self._mission.plan.names, self.executor.stage.sets
        reported: dict[int, float] = {}
        for name, value in parameters.items():
            if name not in names:
                known = f"one of {', '.join(names) or 'none'}"
                what = f"the plan has no parameter {printable(name, 40)}; ignored"
                self._messages.once("parameters", what, known, name)
                continue
            i = names.index(name)
            reported[i] = clipped = sets[i].clip(value) if sets else value
            if clipped != value:
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
        self.locator.decide(self.applied.effective, position)
        for i, value in held.items():
            item, asked = self._mission.plan.parameters[i], self.applied.asked[i]
            what = f"{item.label} = {item.text(asked)} is not applied: {item.text(value)} stays in force"
            self._messages.once("parameters", what, "the parameters decided", f"{item.name} held at {value:g}")

    def _lose(self, error: EadpError) -> None:
        """Stop tracking the plan for good, with a notice: stage and parameters stay."""
        self.lost = True
        self._messages.notices.append(Notice("x_m", f"the plan cannot be followed on from here: {error}"))

"""Samples of telemetry as received, and a gate: clocks that jump, positions that are wrong or do not move."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.live.locator import GAP_S, GAP_STEPS, path_mismatch
from eadp.models.plan.cursor import Vector
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import MARGIN_M
from eadp.planning.base import Sample

MAX_GAP_S = 3600.0
SPEED_FACTOR, SLACK_M = 3.0, 50.0
"""Maximum distance of a sample from the last one: multiple of the cruise speed, and a constant [m]."""
MIN_AGREEING, MIN_BACK = 3, 10
"""Number of consecutive samples in agreement that are accepted however far they are from the last one; and however
early."""

FROZEN_S, MOVING_SHARE = 2.0, 0.1
"""Time after which an unchanged position is frozen [s], if the aircraft moves: by this share of the cruise speed."""

CLOCK = "clock"


class Notice(NamedTuple):
    """A warning about a sample: its key, what is wrong, and what was expected."""

    key: str
    message: str
    expected: str = ""


class OutlierGate:
    """Accepts samples in order of time, on a time without jumps of the clock, and rejects positions that cannot be.

    Parameters
    ----------
    cruise_mps : float
        Airspeed of the aircraft [m/s].
    """

    def __init__(self, cruise_mps: float) -> None:
        self._cruise_mps, self._max_mps = cruise_mps, SPEED_FACTOR * cruise_mps
        self._last: Sample | None = None
        # the step between the last two accepted samples, and what is added to the time of each sample [s]
        self._step_s = self._clock_offset_s = 0.0
        # time [s] and position [m] of the last position accepted, and the velocity to it from the one before [m/s]
        self._located: tuple[float, Point] | None = None
        self._velocity: Point | None = None
        # the last sample that may be on a clock that jumped, and how many consecutive ones agree on that clock
        self._off_clock: Sample | None = None
        self._off_clock_count = 0
        # time [s] and position [m] of the last position too far off, and how many consecutive ones agree with it
        self._far: tuple[float, Point] | None = None
        self._far_count = 0
        self._frozen = False

    def accept(self, sample: Sample) -> tuple[Sample | None, list[Notice]]:
        """Judge a sample; return it on a clock without jumps, and notices of what is wrong with its time and position.

        Its position is None where that cannot be. None instead of the sample where its time cannot be, or is yet to be
        confirmed by the samples that follow.
        """
        timed, of_time = self._take_time(sample)
        if timed is None:
            return None, [of_time] if of_time else []
        usable, of_position = self._take_position(timed)
        notices = [notice for notice in (of_time, of_position) if notice is not None]
        return timed if usable else timed._replace(position_m=None), notices

    # --- the clock

    def _take_time(self, sample: Sample) -> tuple[Sample | None, Notice | None]:
        """Take a sample, on a clock without jumps, as the last one; None where its time is not confirmed."""
        sample, notice = sample._replace(time_s=sample.time_s + self._clock_offset_s), None
        last = self._last
        if last is not None:
            step_s = sample.time_s - last.time_s
            # a step back, or far on, may be a clock that jumped: the samples that follow confirm it
            if (jump := self._jump(last, sample)) is not None:
                if not self._confirm(sample, step_s):
                    return None, jump
                sample, notice = self._reset_clock(last, sample, step_s)
            elif step_s > GAP_S and step_s > GAP_STEPS * self._step_s:
                notice = Notice("time_s", f"a gap of {step_s:.6g} s", "lines more often")
            self._step_s = sample.time_s - last.time_s
        self._last, self._off_clock, self._off_clock_count = sample, None, 0
        return sample, notice

    def _jump(self, last: Sample, sample: Sample) -> Notice | None:
        """A notice where the clock may have jumped, so that the time has to be confirmed; None where it has not."""
        step_s = sample.time_s - last.time_s
        if step_s <= 0:
            what = f"late: {sample.time_s:.15g} s is not after {last.time_s:.15g} s"
            return Notice("time_s", what, "a time after the last line's")
        if step_s > MAX_GAP_S:
            expected = f"{MAX_GAP_S:g} s or less, or {MIN_AGREEING} lines in a row that agree"
            return Notice("time_s", f"{step_s:.6g} s after the last line", expected)
        return None

    def _confirm(self, sample: Sample, step_s: float) -> bool:
        """Count a sample that may be on a clock that jumped; return whether enough in a row agree that it has.

        `step_s` is its time after the last sample accepted, negative for one before it [s].
        """
        before, self._off_clock = self._off_clock, sample
        agrees = before is not None and 0 < sample.time_s - before.time_s <= max(GAP_S, GAP_STEPS * self._step_s)
        self._off_clock_count = self._off_clock_count + 1 if agrees else 1
        if step_s > 0:
            return self._off_clock_count >= MIN_AGREEING
        return -step_s > GAP_S and self._off_clock_count >= MIN_BACK  # else it was delayed

    def _reset_clock(self, last: Sample, sample: Sample, step_s: float) -> tuple[Sample, Notice]:
        """Set the clock's offset after a jump of `step_s`; return the sample on the corrected clock, and a notice.

        The time that has passed is that of as many usual steps as there were samples, or of the distance at cruise
        speed, if that is longer.
        """
        usual_s = self._off_clock_count * max(self._step_s, 1e-3)
        way_s = 0.0
        if self._located is not None and sample.position_m is not None:
            way_s = math.dist(self._located[1], sample.position_m) / self._cruise_mps
        passed_s = max(usual_s, way_s)
        self._clock_offset_s += passed_s - step_s
        what = f"the clock has jumped by {step_s - passed_s:.6g} s"
        sample = sample._replace(time_s=last.time_s + passed_s, warnings=(*sample.warnings, CLOCK))
        return sample, Notice("time_s", what, "a clock that rises steadily")

    # --- the position

    def _take_position(self, sample: Sample) -> tuple[bool, Notice | None]:
        """Take a position as the reference of the next ones; return whether it is one to use, and a notice.

        The notice is of a position that cannot be, or that is frozen from now on; there is none while it stays frozen.
        """
        position, time_s = sample.position_m, sample.time_s
        if position is None:
            return False, None
        if self._located is None:
            self._located = time_s, position
            return True, None
        since_s, (x, y) = self._located
        # the same as before, though the aircraft moves: frozen, once that has lasted
        if position == (x, y) and (self._frozen or self._moving(sample)):
            if time_s - since_s <= FROZEN_S or self._frozen:
                return not self._frozen, None
            self._frozen, what = True, f"the position has not changed for {time_s - since_s:.6g} s"
            return False, Notice("x_m", what, "a position that moves")
        self._frozen = False
        # too far off, unless enough in a row agree that the aircraft is there
        outlier = self._outlier(self._located, (time_s, position))
        if outlier is not None and not self._confirm_position((time_s, position)):
            return False, outlier
        if time_s > since_s:
            self._velocity = (position[0] - x) / (time_s - since_s), (position[1] - y) / (time_s - since_s)
        self._located, self._far, self._far_count = (time_s, position), None, 0
        return True, None

    def _moving(self, sample: Sample) -> bool:
        """Whether the aircraft moves, by the velocity measured or else that of the positions."""
        velocity = sample.velocity_mps or self._velocity
        return velocity is not None and math.hypot(*velocity) > MOVING_SHARE * self._cruise_mps

    def _confirm_position(self, now: tuple[float, Point]) -> bool:
        """Count a position too far off, with its time; return whether enough consecutive ones agree on where it is."""
        before, self._far = self._far, now
        agrees = before is not None and self._outlier(before, now) is None
        self._far_count = self._far_count + 1 if agrees else 1
        return self._far_count >= MIN_AGREEING

    def _outlier(self, before: tuple[float, Point], now: tuple[float, Point]) -> Notice | None:
        """A notice if a position, with its time, cannot be reached from the one before."""
        step_s, distance_m = now[0] - before[0], math.dist(before[1], now[1])
        if distance_m <= self._max_mps * step_s + SLACK_M:
            return None
        expected = f"a position that can be reached, or {MIN_AGREEING} lines in a row that agree"
        return Notice("x_m", f"{distance_m:.6g} m from the last line's position, {step_s:.6g} s before", expected)


AHEAD_M = 20.0
"""Distance straight on within which a certain end is passed by the error of a position, `MARGIN_M` [m]."""


def is_certain(executor: PlanExecutor, position: Point, course_rad: float | None) -> bool:
    """Whether the end of a plan is passed by more than the error of a position.

    Parameters
    ----------
    executor : PlanExecutor
        A flight that is complete.
    position : (float, float)
        Position [m].
    course_rad : float or None
        Direction of the ground velocity [rad]: along it, what is passed by little now is passed by more soon.
    """
    end = executor.cursor.end()
    if end is None or end.at_trigger:
        return True
    # where the aircraft is soon, straight on
    ahead_m = 0.0 if course_rad is None else AHEAD_M
    course_rad = course_rad or 0.0
    straight_on = position[0] + ahead_m * math.cos(course_rad), position[1] + ahead_m * math.sin(course_rad)
    # on each axis: by how much the end is passed in the direction of the plan's shift d, now or soon; without a shift
    # on this axis, by how much the position is inside the final point's radius
    for x, later_x, final, d in zip(position, straight_on, end.final_m, end.shift_m, strict=True):
        if abs(d) < 1e-9:
            beyond_m = executor.cursor.table.plan.final_radius_m - abs(x - final)
        else:
            beyond_m = max((x - final) * math.copysign(1, d), (later_x - final) * math.copysign(1, d))
        if beyond_m < MARGIN_M:
            return False
    return True


FAR, NEAR, STAYS_S = 9.0, 4.0, 5.0
"""Square of the mismatch of position and course with the path, in standard deviations (`path_mismatch`), from which on
the plan is not flown: 45 m, or 86°; and that below which it has to stay for some time [s] to be flown again: circles
cross the path. In flights of the plant it is below 2."""

BY_HAND_S = 5.0
"""Time off the plan from which on a leg counts as flown by hand [s]: turns may be flown wide for a moment."""


class Continuation:
    """Whether a flight goes on along its plan after an end of it, by the positions that follow.

    Positions near the path count from the next leg on, since a loiter at the end may lie on the leg that ends.

    Parameters
    ----------
    executor : PlanExecutor
        The flight that goes on.
    """

    def __init__(self, executor: PlanExecutor) -> None:
        self._stages_started, self._near_s = executor.stages_started, 0.0

    def update(self, executor: PlanExecutor, to: Sample, step_s: float) -> bool | None:
        """Take a sample, `step_s` [s] after the last one; return whether the flight goes on, None while unknown."""
        if executor.complete:
            return False
        mismatch = 0.0 if to.position_m is None else path_mismatch(executor, to)
        if mismatch > FAR:
            self._near_s -= step_s
        elif executor.stages_started > self._stages_started:
            self._near_s += step_s
        return None if abs(self._near_s) < STAYS_S else self._near_s > 0


class Departure:
    """Follows whether the plan is flown: by the autopilot's mode, else by the distance from the path.

    Attributes
    ----------
    away : bool
        Whether the plan is not flown.
    away_s : float
        For how long [s].
    rejoins : bool
        Whether the plan is taken up again, and its path not reached yet.
    """

    def __init__(self) -> None:
        self.away, self.away_s, self.rejoins = False, 0.0, False
        self._far, self._near_s = False, 0.0  # whether the path was left, and for how long it has been near again [s]
        self._last_s: float | None = None

    def update(self, sample: Sample, mismatch: float) -> None:
        """Update `away` with a sample, and the mismatch of position and course with the path, see `path_mismatch`.

        The mismatch is 0 where it is not known.
        """
        step_s = 0.0 if self._last_s is None else max(sample.time_s - self._last_s, 0.0)
        self._last_s = sample.time_s
        self._near_s = self._near_s + step_s if mismatch <= NEAR else 0.0
        self._far = mismatch > FAR or (self._far and self._near_s < STAYS_S)
        self.away = self._far if sample.mode.flies_mission is None else not sample.mode.flies_mission
        self.away_s = self.away_s + step_s if self.away else 0.0


APPLY_S, SAME_SHARE = 10.0, 0.01
"""Time in which the aircraft applies a parameter [s]; and by how much a value may be off, as a share of its set."""

APART_S = 3.0
"""By how much the aircraft may start a stage before positions show it, or after [s]."""


class AppliedParameters:
    """Which of the parameters decided the aircraft applies, by those that it reports to be in force.

    A parameter that should have changed `APPLY_S` before, and is still reported as it was, is held: it keeps that value
    until another value of it is reported, or one is on its way.

    Parameters
    ----------
    parameters : tuple of float
        Decided at take-off.
    plan : Plan

    Attributes
    ----------
    asked : tuple of float
        Parameters to fly with; of those that are held, the values decided before.
    held : dict of int to float
        Parameters that are held, by index, and the values reported.
    """

    def __init__(self, parameters: Vector, plan: Plan) -> None:
        self.asked = parameters
        self.held: dict[int, float] = {}
        boxes = [plan.hull(i) for i in range(len(parameters))] if plan.has_sets else []
        self._tolerances = [SAME_SHARE * (box.hi - box.lo) for box in boxes] or [0.0] * len(parameters)
        self._reported: dict[int, float] = {}
        self._before: dict[int, float] = {}
        """The value that was reported of a parameter when another value of it was decided."""
        self._refused_s: dict[int, float] = {}
        """Since when a parameter that should have changed is reported as it was [s]."""
        self._ahead_s: dict[int, float] = {}
        """Since when a parameter is reported as decided, though by the plan's rules it is not in force yet [s]."""
        self._expected = parameters
        self._left: dict[int, tuple[float, float]] = {}
        """Of each parameter: the value in force before its last change by the plan's rules, and that time [s]."""

    @property
    def effective(self) -> Vector:
        """The parameters that will be in force."""
        return tuple([self.held.get(i, value) for i, value in enumerate(self.asked)])

    def decide(self, parameters: Vector) -> None:
        """Set `asked` to the parameters decided, but for those that are held; keep what is reported of each changed."""
        asked = list(self.asked)
        for i, value in enumerate(parameters):
            if i not in self.held and value != asked[i]:
                asked[i] = value
                if i in self._reported:
                    self._before[i] = self._reported[i]
        self.asked = tuple(asked)

    def release(self, i: int) -> bool:
        """Hold a parameter no longer, since a value of it is on its way to the aircraft; return whether it was held."""
        self._refused_s.pop(i, None)
        return self.held.pop(i, None) is not None

    def update(self, time_s: float, reported: Mapping[int, float], expected: Vector) -> bool:
        """Update `held` with the parameters reported, by index; return whether it has changed.

        `expected` are the parameters in force by the plan's rules.
        """
        self._reported |= reported
        held_before = dict(self.held)
        for i, value in reported.items():
            if i in self.held:
                if not self._same(i, value, self.held[i]):
                    del self.held[i], self._before[i]
            elif not self._is_as_before(i, value):
                self._refused_s.pop(i, None)
            # it waits for its stage while it is expected so; once it has not, what it reports becomes what is expected
            elif i in self._refused_s or not self._same(i, value, expected[i]):
                since_s = self._refused_s.setdefault(i, time_s)
                if time_s - since_s >= APPLY_S:
                    self.held[i] = value
                    del self._refused_s[i]
        return held_before != self.held

    def _is_as_before(self, i: int, value: float) -> bool:
        """Whether a value reported is that from before another one was decided, and not the one asked for."""
        decided = i in self._before and not self._same(i, value, self.asked[i])
        return decided and self._same(i, value, self._before[i])

    def update_apart(self, time_s: float, reported: Mapping[int, float], expected: Vector) -> list[int]:
        """Indices of reported parameters that differ from `expected`, but have done so for less than `APART_S`.

        `expected` are the parameters in force by the plan's rules. The aircraft may start a stage a little sooner, and
        report what is decided; or later, and report what was in force before. Such a report is no refusal.
        """
        for i, value in enumerate(expected):
            if value != self._expected[i]:
                self._left[i] = self._expected[i], time_s
        self._expected = expected
        differ = {i: value for i, value in reported.items() if not self._same(i, value, expected[i])}
        # sooner: reported as decided, since the first such report; later: as before the last change, since that change
        ahead = [i for i, value in differ.items() if self._same(i, value, self.asked[i])]
        self._ahead_s = {i: self._ahead_s.get(i, time_s) for i in ahead}
        behind_s = {i: since_s for i, (value, since_s) in self._left.items() if i in differ and differ[i] == value}
        return [i for i, since_s in (self._ahead_s | behind_s).items() if time_s - since_s < APART_S]

    def _same(self, i: int, one: float, other: float) -> bool:
        """Whether two values of a parameter are the same within its tolerance."""
        return abs(one - other) <= self._tolerances[i]

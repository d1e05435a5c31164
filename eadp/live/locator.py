"""The position in a plan by telemetry: one hypothesis in ordinary flight, several after a gap, or at a late beginning.

A hypothesis is a flight through the plan, with the logarithm of its likelihood. After a gap every stage and lap that
the time allows is one, by position, course and time. Where telemetry begins in the middle of a flight, each of the
nominal flight is one, at several values of the path parameters, since those flown before are not known. The positions
that follow decide between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point, tangent
from eadp.errors import EadpError, PathUndefined
from eadp.models.plan.cursor import PlanCursor, Vector, cursors
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import Leg, left_m, leg_points
from eadp.planning.base import Sample

GAP_S, GAP_STEPS = 5.0, 3.0
"""A gap: minimum length [s], and in multiples of the step before."""

STEP_M, MAX_STEPS = 1.0, 5000
"""Distance of trigger checks between two samples [m], and their maximum number."""

DISTANCE_STD_M, COURSE_STD_RAD = 15.0, 0.5
"""Standard deviations of the distance from the path, and of the course from its direction, on the right stage: the
aircraft joins each stage within a trigger's radius."""

TIME_STD_S, TIME_STD_SHARE = 3.0, 0.08
"""Standard deviation of the time flown in a gap: a constant [s], and a share of the forecast."""

MAX_STDS, ALIKE = 5.0, 7.0
"""Maximum mismatch of time, and of position and course together, in standard deviations; and the difference of log
likelihoods at which a hypothesis is dropped: 1 to 1,000."""

INDEPENDENT_S = 4.0
"""Time between positions that are independent evidence [s]."""

ENDS_ABOVE = 0.9
"""Probability of the likeliest hypothesis above which its end of the plan is the flight's."""

POINT_M, MAX_POINTS = 3.0, 400
"""Distance of the points of a stage at which a position is sought [m], and their maximum number."""


def max_time_stds(seen: Sample) -> float:
    """Maximum mismatch of time in standard deviations; infinite where a stage is reported and no position is known.

    The report decides then, whatever the time.
    """
    reported = seen.stage is not None or seen.stages_started is not None
    return math.inf if reported and seen.position_m is None else MAX_STDS


def allows(seen: Sample, executor: PlanExecutor) -> bool:
    """Whether a flight is on the stage that a sample reports, or on the one before it; True without a report."""
    following = executor.cursor.next()
    next_stage = None if following is None else following.stage.index
    stages = None, executor.stage.index, next_stage
    counts = None, executor.stages_started, executor.stages_started + 1
    return seen.stage in stages and seen.stages_started in counts


@dataclass
class Hypothesis:
    """A flight through the plan, the time at which its stage started [s], and the logarithm of its likelihood."""

    executor: PlanExecutor
    stage_started_s: float = 0.0
    log_likelihood: float = 0.0

    @property
    def stage(self) -> tuple[int, int, int]:
        """Segment, lap and stage."""
        cursor = self.executor.cursor
        return cursor.segment, cursor.lap, cursor.stage.index

    def weigh(self, to: Sample, share: float, max_mismatch: float, distance_std_m: float | None = None) -> None:
        """Update the likelihood with a position, by its mismatch with the path, at most `max_mismatch`.

        `share` is how much of the position is evidence of its own, independent of the one before; see `path_mismatch`.
        """
        # log of a normal density: −½ (mismatch in standard deviations)²
        mismatch = path_mismatch(self.executor, to, distance_std_m or DISTANCE_STD_M)
        self.log_likelihood -= min(mismatch, max_mismatch) / 2 * share

    def on_leg(self, cursor: PlanCursor, leg: Leg, legs_on: int, position: Point, share: float) -> PlanExecutor:
        """This flight `legs_on` legs later: on `leg`, whose stage `cursor` is at, at a position [m].

        `share` is how much of the leg is flown there. With 0 legs on, the leg is the one being flown.
        """
        executor = self.executor
        joined = leg.start_m if legs_on else executor.joined_m
        return executor.placed(cursor, joined, executor.stages_started + legs_on, position, share)


def likely(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    """The hypotheses that are not as good as excluded, the likeliest first; one at least, where all are."""
    ranked = sorted(hypotheses, key=lambda one: -one.log_likelihood)
    return [one for one in ranked if one.log_likelihood >= ranked[0].log_likelihood - ALIKE] or ranked[:1]


class Locator:
    """Where a flight is in its plan.

    Parameters
    ----------
    executor : PlanExecutor
        The flight at its start.
    cruise_mps : float
        Airspeed [m/s].
    time_s : float
        Time of the start [s].

    Attributes
    ----------
    hypotheses : list of Hypothesis
        The likeliest one first.
    lost : bool
        Whether the flight is sought after a gap, and not found again yet.
    through_gap : bool
        Whether the start of the stage, or the end of the one before, may have been in a gap.
    """

    def __init__(
        self, executor: PlanExecutor, cruise_mps: float, time_s: float, position_m: Point | None = None
    ) -> None:
        """`position_m` is where the flight is; by default where its stage was joined."""
        self.hypotheses = [Hypothesis(executor, time_s)]
        self.lost = self.through_gap = False
        self._cruise_mps = cruise_mps
        self._predictor = RoutePredictor()
        # of the last position from which the plan was followed: while the flight is lost, the last before the gap
        self._time_s, self._position = time_s, position_m or executor.joined_m
        self._before_gap: list[Hypothesis] = []
        """The hypotheses at that position while the flight is lost; none else."""

    @property
    def executor(self) -> PlanExecutor:
        """The flight of the likeliest hypothesis."""
        return self.hypotheses[0].executor

    @property
    def uncertain(self) -> bool:
        """Whether more than one hypothesis is left, or the flight has not been found again."""
        return len(self.hypotheses) > 1 or self.lost

    # --- parameters

    def decide(
        self, parameters: Sequence[float], position: Point, airspeeds_mps: tuple[float, ...] | None = None
    ) -> None:
        """Put parameters decided into the plan of every hypothesis, see `PlanExecutor.decide`."""
        self._each(lambda executor: executor.decide(parameters, position, airspeeds_mps))

    def take_in_force(self, parameters: Sequence[float], position: Point) -> None:
        """Put parameters in force in every hypothesis, as reported, see `PlanExecutor.take_in_force`."""
        self._each(lambda executor: executor.take_in_force(parameters, position))

    def _each(self, change: Callable[[PlanExecutor], object]) -> None:
        """Change the flight of every hypothesis; where `change` raises for one, it is excluded (log likelihood −∞).

        Raises
        ------
        EadpError
            If it raises for the likeliest.
        """
        change(self.executor)
        for hypothesis in [*self.hypotheses[1:], *self._before_gap]:
            try:
                change(hypothesis.executor)
            except EadpError:
                hypothesis.log_likelihood = -math.inf

    # --- ordinary flight

    def follow(self, to: Sample, skips: int | None, started: Callable[[float, Point, float], None]) -> None:
        """Advance every hypothesis along the straight line from the last position to that of a sample.

        Parameters
        ----------
        to : Sample
            With a position.
        skips : int or None
            Number of stages that the likeliest hypothesis skips there, as reported; None where its triggers decide.
        started : function of a time [s], a position [m] and a share of the line
            Called at each start of a stage of the likeliest hypothesis before `to`.

        Raises
        ------
        PathUndefined
            As `PlanExecutor.advance`.
        """
        assert to.position_m is not None
        last_s, position = self._time_s, self._position
        self._time_s, self._position = to.time_s, to.position_m
        step_s = to.time_s - last_s
        line = line_between(position, to.position_m)
        self._advance_others(line, to.time_s)
        # the likeliest hypothesis: by its triggers along the line, or without them, and stages skipped at its end
        likeliest, executor = self.hypotheses[0], self.executor
        for k, (x, y) in enumerate(line, 1):
            share = k / len(line)
            if skips is not None:
                executor.stay(x, y)
            elif executor.advance(x, y):
                self._start(likeliest, last_s + share * step_s)
                if k < len(line):
                    started(likeliest.stage_started_s, (x, y), share)
            if executor.complete:
                break
        to_skip = skips or 0
        for k in range(1, to_skip + 1):
            if executor.complete:
                break
            executor.skip(to.position_m)
            self._start(likeliest, last_s + k / to_skip * step_s)
            self.through_gap |= to_skip != 1
            # the last stage starts at `to`, which the caller observes itself
            if k < to_skip and not executor.complete:
                started(likeliest.stage_started_s, to.position_m, 1.0)
        if len(self.hypotheses) > 1:
            self._weigh(to, step_s)

    def wait(self, time_s: float, position: Point) -> None:
        """Take a position [m] at which no stage can end: the plan is not flown there."""
        self._time_s, self._position = time_s, position

    def _advance_others(self, line: list[Point], time_s: float) -> None:
        """Advance the hypotheses other than the likeliest along a line, by their triggers; its end is at `time_s`."""
        for hypothesis in self.hypotheses[1:]:
            try:
                for x, y in line:
                    if hypothesis.executor.advance(x, y):
                        hypothesis.stage_started_s = time_s
            except EadpError:
                hypothesis.log_likelihood = -math.inf

    def leads(self, stages: int) -> bool:
        """Whether the flight may be that many stages ahead: the plan has them. A negative number is behind: False."""
        if stages < 2:  # behind; or this stage, or the one after it, which need no route
            return stages >= 0
        try:
            return stages < len(self._predictor.route(self.executor.cursor, self.executor.joined_m).legs)
        except PathUndefined:
            return False

    def go_on(self) -> bool:
        """Put the likeliest hypothesis past the end of the plan that it has reached; return whether there is more."""
        try:
            following = self.executor.past_end()
        except PathUndefined:  # the next lap has no path
            return False
        if following is not None:
            self.hypotheses[0].executor = following
        return following is not None

    def _start(self, hypothesis: Hypothesis, time_s: float) -> None:
        """Note that the stage of a hypothesis starts at a time [s]; its start is uncertain where there are others."""
        hypothesis.stage_started_s, self.through_gap = time_s, len(self.hypotheses) > 1

    def _weigh(self, to: Sample, step_s: float) -> None:
        """Update the likelihoods with a position, `step_s` after the last; drop hypotheses that are no longer likely.

        The likeliest hypothesis has ended the flight only if it is likely enough; others that have ended are dropped.
        """
        for hypothesis in self.hypotheses:
            hypothesis.weigh(to, min(1.0, step_s / INDEPENDENT_S), 2 * MAX_STDS**2)
        reported = [one for one in self.hypotheses if allows(to, one.executor)]
        self._keep(reported or self.hypotheses)
        if self.executor.complete and len(self.hypotheses) > 1:
            # its probability p₀ = 1 / Σ exp(l − l₀), from log likelihoods: below `ENDS_ABOVE` it is dropped
            highest = self.hypotheses[0].log_likelihood
            if 1 / sum(math.exp(one.log_likelihood - highest) for one in self.hypotheses) < ENDS_ABOVE:
                self._keep(self.hypotheses[1:])
        flying = [one for one in self.hypotheses[1:] if not one.executor.complete]
        self.hypotheses[1:] = [] if self.executor.complete else flying

    def _keep(self, hypotheses: list[Hypothesis]) -> None:
        """Keep the likely hypotheses, the likeliest first, and of each stage and lap only its likeliest."""
        kept = {one.stage: one for one in reversed(likely(hypotheses))}  # likelier ones overwrite
        self.hypotheses = sorted(kept.values(), key=lambda one: -one.log_likelihood)

    # --- after a gap

    def seek(self, seen: Sample, wind_mps: Point) -> Point | None:
        """Find the flight again after a gap, or forecast where it is; `hypotheses` are those that this leaves.

        By the sample's position, by the stage that it reports, and by time. Where no leg fits the position, or there is
        none, the place in the plan is by the reported stage and time; where no leg fits these, by time alone.

        Parameters
        ----------
        seen : Sample
        wind_mps : (float, float)
            Wind [m/s].

        Returns
        -------
        (float, float) or None
            Where the flight is [m]: the sample's position, wherever its place in the plan is, else the forecast. None
            where the rest of the plan cannot be laid out: the flight is sought no longer.
        """
        if not self.lost:
            self.lost, self._before_gap = True, self.hypotheses
        unplaced = seen._replace(position_m=None, velocity_mps=None)
        by_report = seen.stage is not None or seen.stages_started is not None
        located = list(self._candidates(seen, wind_mps)) if seen.position_m is not None else []
        candidates = located or list(self._candidates(unplaced, wind_mps))
        if not candidates and by_report:
            candidates = list(self._candidates(unplaced._replace(stage=None, stages_started=None), wind_mps))
            by_report = False
        self.through_gap = True
        if not candidates:
            self._end_search()
            return None
        best = max(candidates, key=lambda one: one.log_likelihood)
        lowest = best.log_likelihood - ALIKE
        # a forecast, without a position that fits, is the best candidate alone
        likely_ones = [one for one in candidates if one.log_likelihood >= lowest] if located else [best]
        self._keep([one.placed(seen.position_m) for one in likely_ones])
        position = seen.position_m or best.match.position_m
        # found: at its position, or on the stage that it reports; later samples are followed from here
        if located or (by_report and seen.position_m is not None):
            self._end_search()
            self._time_s, self._position = seen.time_s, position
        return position

    def _end_search(self) -> None:
        """Seek the flight no longer: it is found again, or its plan cannot be laid out."""
        self.lost, self._before_gap = False, []

    def _candidates(self, seen: Sample, wind_mps: Point) -> Iterator[_Candidate]:
        """The best match on each leg after the gap's start that the time since then, and the reported stage, allow."""
        elapsed_s = seen.time_s - self._time_s
        std_s = TIME_STD_S + TIME_STD_SHARE * elapsed_s
        for before in self._before_gap:
            for ahead in self._legs_ahead(before, wind_mps):
                if ahead.start_s > elapsed_s + max_time_stds(seen) * std_s:
                    break
                count = before.executor.stages_started + ahead.legs_on
                if seen.stage not in (None, ahead.leg.stage.index) or seen.stages_started not in (None, count):
                    continue
                match = ahead.match(seen, elapsed_s, std_s)
                if match is not None:
                    yield _Candidate(before, ahead, seen.time_s, match)

    def _legs_ahead(self, hypothesis: Hypothesis, wind_mps: Point) -> Iterator[_LegAhead]:
        """The legs left to fly from a hypothesis at the last position, and when they are flown.

        Up to the first leg that cannot be flown in this wind; none where the route has no path.
        """
        executor = hypothesis.executor
        try:
            route = self._predictor.route(executor.cursor, executor.joined_m)
            times_s = route.times_s(self._cruise_mps, wind_mps)[0].tolist()
            # time of the first leg flown at the last position: by where that is, and on a circle by the time on it
            flown_s = 0.0
            if route.legs and 0 < times_s[0] < math.inf and route.legs[0].distance_m > 0:
                leg = route.legs[0]
                share = min(1.0, (self._time_s - hypothesis.stage_started_s) / times_s[0])
                radius_m = executor.cursor.table.plan.max_radius_m
                left = left_m(leg, self._position, share * leg.distance_m, radius_m)
                flown_s = (1 - left / leg.distance_m) * times_s[0]
            start_s = -flown_s
            for legs_on, (leg, time_s, cursor) in enumerate(
                zip(route.legs, times_s, cursors(executor.cursor), strict=False)
            ):
                if not math.isfinite(time_s):
                    return
                yield _LegAhead(legs_on, cursor, leg, start_s, time_s)
                start_s += time_s
        except PathUndefined:
            return


class Match(NamedTuple):
    """Where on a leg a sample fits best: the share of the leg, the point [m], and the log likelihood."""

    share: float
    position_m: Point
    log_likelihood: float


class _LegAhead(NamedTuple):
    """A leg from the last position on: `legs_on` legs later, from 0; its start after that position, and duration [s].

    `cursor` is at its stage.
    """

    legs_on: int
    cursor: PlanCursor
    leg: Leg
    start_s: float
    duration_s: float

    def match(self, seen: Sample, elapsed_s: float, std_s: float) -> Match | None:
        """The best match with a sample, `elapsed_s` after the last position, ± `std_s` [s]; None where none fits."""
        if self.start_s + self.duration_s < elapsed_s - max_time_stds(seen) * std_s:
            return None
        return best_match(self.leg, seen, LegTimes(self.start_s, self.duration_s, elapsed_s, std_s))


class _Candidate(NamedTuple):
    """Where a flight may be after a gap: the hypothesis before it, the leg ahead, the time [s], and the best match."""

    before: Hypothesis
    ahead: _LegAhead
    time_s: float
    match: Match

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the match and of the hypothesis before the gap together."""
        return self.before.log_likelihood + self.match.log_likelihood

    def placed(self, position: Point | None) -> Hypothesis:
        """The candidate as a hypothesis: the flight on that leg, at a known position [m], else at the match's."""
        ahead, share = self.ahead, self.match.share
        placed = self.before.on_leg(ahead.cursor, ahead.leg, ahead.legs_on, position or self.match.position_m, share)
        return Hypothesis(placed, self.time_s - share * ahead.duration_s, self.log_likelihood)


def path_mismatch(executor: PlanExecutor, to: Sample, distance_std_m: float = DISTANCE_STD_M) -> float:
    """Square of the mismatch of position and course with the path of a flight's stage, in standard deviations.

    `distance_std_m` is the standard deviation of the distance [m]. 0 where the path function has no value here: that
    does not speak against the stage.
    """
    assert to.position_m is not None
    ox, oy = executor.cursor.offset_m
    local = (to.position_m[0] - ox, to.position_m[1] - oy)
    try:
        phi, gx, gy, *_ = executor.path(*local)
        dx, dy = tangent(executor.path, local, executor.stage.sense)
    except (EadpError, ArithmeticError, ValueError):
        return 0.0
    # (d/σ_d)² + (Δχ/σ_χ)², with d = φ/|∇φ|
    mismatch = (phi / math.hypot(gx, gy) / distance_std_m) ** 2
    if to.course_rad is not None:
        turned = math.remainder(math.atan2(dy, dx) - to.course_rad, 2 * math.pi)
        mismatch += (turned / COURSE_STD_RAD) ** 2
    return mismatch


class LegTimes(NamedTuple):
    """Start and duration of a leg, and the time now with its standard deviation [s]."""

    start_s: float
    duration_s: float
    elapsed_s: float
    std_s: float


def best_match(leg: Leg, seen: Sample, times: LegTimes | None = None) -> Match | None:
    """The point of a leg that a sample fits best, by position, course and time; None where none fits.

    What the sample has not measured is left out, and so is the time where `times` is None.
    """
    points = list(leg_points(leg, max(POINT_M, leg.distance_m / MAX_POINTS)))
    shares = np.linspace(0.0, 1.0, len(points))
    # squares of how far each point is from time, place and course, in standard deviations
    off_time2, off_path2 = np.zeros(len(points)), np.zeros(len(points))
    if times is not None:
        off_time2 += ((times.start_s + shares * times.duration_s - times.elapsed_s) / times.std_s) ** 2
    if seen.position_m is not None:
        offsets = np.array([(point.x_m, point.y_m) for point in points]) - seen.position_m
        off_path2 += np.sum(offsets**2, axis=1) / DISTANCE_STD_M**2
        if seen.course_rad is not None:
            turned = np.array([point.heading_rad for point in points]) - seen.course_rad
            off_path2 += (np.remainder(turned + math.pi, 2 * math.pi) - math.pi) ** 2 / COURSE_STD_RAD**2
    near = (off_time2 <= max_time_stds(seen) ** 2) & (off_path2 <= MAX_STDS**2)
    total = np.where(near, off_time2 + off_path2, math.inf)
    best = int(np.argmin(total))
    if not math.isfinite(total[best]):
        return None
    return Match(float(shares[best]), (points[best].x_m, points[best].y_m), -float(total[best]) / 2)


def line_between(start: Point, end: Point) -> list[Point]:
    """The points after `start` of the straight line to `end`, at most `STEP_M` apart [m]."""
    (x0, y0), (x1, y1) = start, end
    steps = min(max(1, math.ceil(math.dist(start, end) / STEP_M)), MAX_STEPS)
    return [(x0 + k / steps * (x1 - x0), y0 + k / steps * (y1 - y0)) for k in range(1, steps + 1)]


VALUES = 49
"""Number of values of the path parameters from the lower to the upper ends of their sets, all at the same share."""

TRACK_STD_M = 2.0
"""Standard deviation of the distance from the path along a stage [m]: laps lie near to one another."""

OUTLIER = 9.0
"""Maximum squared mismatch, in standard deviations: joins are flown as freely on every lap."""

START_LOG_PRIOR = -ALIKE / 2
"""Logarithm of the prior likelihood of a flight that has just started, away from the mission's start."""

HISTORY_STD = 0.25
"""Standard deviation of the values flown before from those now in force, as a share of their sets."""

SETTLE_S, COURSE_S, SAME_M = 5.0, 5.0, 5.0
"""Least time in which one stage or lap is left, and maximum time to wait for a course [s]; and distance of laps that
count as one if parameters are the same [m]."""


class Acquisition:
    """Stage and lap by position, course and the stage or parameters reported, until one hypothesis is left.

    Parameters
    ----------
    start : PlanExecutor
        A flight at the start of the plan, which is a hypothesis, too.
    start_m : (float, float)
        Where flights start [m].

    Attributes
    ----------
    hypotheses : list of Hypothesis
        The likeliest one first.
    is_start : bool
        Whether no leg fits the first position: the flight starts there.
    stage_found, settled : bool
        Whether stages, and laps too, other than its own are as good as excluded.
    """

    def __init__(self, start: PlanExecutor, start_m: Point) -> None:
        self._start, self._start_m = start, start_m
        self.hypotheses = [Hypothesis(start)]
        self.settled = self.stage_found = self.is_start = False
        # time [s] and place of the last position used; when the first came, and the time between the last two [s]
        self._last: tuple[float, Point] | None = None
        self._first_s: float | None = None
        self._step_s = 0.0
        # when the hypotheses left last differed in their stages, and in their laps [s]
        self._stages_differed_s = self._laps_differed_s = math.inf

    def update(self, to: Sample, in_force: dict[int, float]) -> None:
        """Update the hypotheses with a position, and the parameters reported to be in force, by index.

        The first position, and one after a gap, makes the hypotheses anew; the first waits for a course or a report of
        the stage, up to `COURSE_S`. Other positions advance them. Each weighs them. `stage_found` and `settled` are set
        once all that are left have agreed for `SETTLE_S`.
        """
        if to.position_m is None:
            return
        if self._first_s is None:
            self._first_s = to.time_s
        position_alone = to.course_rad is None and to.stage is None and to.stages_started is None
        if position_alone and self._last is None and to.time_s - self._first_s < COURSE_S:
            return
        last, self._last = self._last, (to.time_s, to.position_m)
        step_s = to.time_s - last[0] if last is not None else 0.0
        step_before_s, self._step_s = self._step_s, step_s
        if last is None or step_s > max(GAP_S, GAP_STEPS * step_before_s):
            candidates = list(self._candidates(to, in_force))
            if last is None and not candidates:
                self.is_start = True
                return
            # or the flight starts only now, unless a later stage is reported
            if not candidates or (to.stage in (None, 1) and to.stages_started in (None, 1)):
                candidates.append(self._anew(to))
            self.hypotheses = candidates
            self._stages_differed_s = self._laps_differed_s = to.time_s
        else:
            for hypothesis in self.hypotheses:
                _follow(hypothesis, last, to, in_force)
        weight = 1.0 if last is None else min(1.0, step_s / INDEPENDENT_S)
        for hypothesis in self.hypotheses:
            hypothesis.weigh(to, weight, OUTLIER, TRACK_STD_M)
        self.hypotheses = likely(self.hypotheses)
        # when stages, and laps, disagreed last
        best = self.hypotheses[0]
        cursors_left = [one.executor.cursor for one in self.hypotheses]
        if len({(cursor.segment, cursor.stage.index) for cursor in cursors_left}) > 1:
            self._stages_differed_s = to.time_s
        if not all(_alike(one, best) for one in self.hypotheses):
            self._laps_differed_s = to.time_s
        self.stage_found = self.stage_found or to.time_s - self._stages_differed_s >= SETTLE_S
        self.settled = to.time_s - self._laps_differed_s >= SETTLE_S

    def _anew(self, to: Sample) -> Hypothesis:
        """The hypothesis that the flight starts now, at the sample's position, away from the mission's start."""
        cursor = self._start.cursor
        assert to.position_m is not None
        return Hypothesis(self._start.placed(cursor, to.position_m, 1, to.position_m, 0.0), to.time_s, START_LOG_PRIOR)

    def _candidates(self, to: Sample, in_force: dict[int, float]) -> Iterator[Hypothesis]:
        """A hypothesis of each leg that a sample fits, of the nominal flights at each choice of parameters."""
        plan, rules = self._start.cursor.table.plan, self._start.cursor.table.rules
        for values in self._choices():
            try:
                executor = PlanExecutor(plan, values, self._start_m, rules)
                legs = RoutePredictor().route(executor.cursor, self._start_m).legs
            except PathUndefined:
                continue
            prior = _history_log_prior(executor.cursor, values, in_force)
            for number, (leg, cursor) in enumerate(zip(legs, cursors(executor.cursor), strict=False)):
                if to.stage not in (None, leg.stage.index) or to.stages_started not in (None, number + 1):
                    continue
                hypothesis = _matched(executor, cursor, leg, number, to)
                if hypothesis is not None:
                    hypothesis.log_likelihood += prior
                    _put_in_force(hypothesis, to, in_force)
                    yield hypothesis

    def _choices(self) -> list[Vector]:
        """Choices of parameters: those of take-off, and path parameters from the lower to the upper ends of their sets.

        All path parameters are at the same share of their sets; the computations are as at take-off.
        """
        cursor = self._start.cursor
        plan, taken_off = cursor.table.plan, cursor.decided
        choices = [taken_off]
        if plan.has_sets and plan.path_count:
            boxes = [plan.hull(i) for i in range(plan.path_count)]
            for share in np.linspace(0.0, 1.0, VALUES).tolist():
                path = [box.lo + share * (box.hi - box.lo) for box in boxes]
                choices.append((*path, *taken_off[plan.path_count :]))
        return list(dict.fromkeys(choices))


def _matched(executor: PlanExecutor, cursor: PlanCursor, leg: Leg, legs_before: int, to: Sample) -> Hypothesis | None:
    """The hypothesis that the flight is on a leg, where a sample fits it best; None where it does not fit.

    `executor` is at the start of the plan, `legs_before` the leg, whose stage `cursor` is at. The log likelihood is
    left at 0: `update` weighs the position next, as it does for every hypothesis.
    """
    assert to.position_m is not None
    x, y = to.position_m[0] - leg.offset_m[0], to.position_m[1] - leg.offset_m[1]
    try:
        phi, gx, gy, *_ = leg.path(x, y)
    except (EadpError, ArithmeticError, ValueError):
        return None
    # the distance from the path, |φ|/|∇φ|, is too large: this is cheaper than `best_match`, which lays out points
    if phi * phi > (MAX_STDS * TRACK_STD_M) ** 2 * (gx * gx + gy * gy):
        return None
    match = best_match(leg, to)
    if match is None:
        return None
    try:
        placed = Hypothesis(executor).on_leg(cursor, leg, legs_before, to.position_m, match.share)
    except PathUndefined:
        return None
    return Hypothesis(placed, to.time_s)


def _follow(hypothesis: Hypothesis, last: tuple[float, Point], to: Sample, in_force: dict[int, float]) -> None:
    """Advance a hypothesis, in place, along a line to a position: by the stage reported, else by its triggers.

    It is excluded (log likelihood −∞) where the stage reported is more than one ahead, where its plan has ended, and
    where its path is undefined. `in_force` are the parameters reported, by index.
    """
    assert to.position_m is not None
    executor = hypothesis.executor
    try:
        for x, y in line_between(last[1], to.position_m):
            if to.stage is not None:
                executor.stay(x, y)
            elif executor.advance(x, y):
                hypothesis.stage_started_s = to.time_s
        if to.stage not in (None, executor.stage.index):
            executor.skip(to.position_m)
            hypothesis.stage_started_s = to.time_s
        if to.stage not in (None, executor.stage.index) or executor.complete:
            hypothesis.log_likelihood = -math.inf
        _put_in_force(hypothesis, to, in_force)
    except EadpError:
        hypothesis.log_likelihood = -math.inf


def _put_in_force(hypothesis: Hypothesis, to: Sample, in_force: dict[int, float]) -> None:
    """Put the parameters reported, by index, in force in a hypothesis, within their sets."""
    executor = hypothesis.executor
    assert to.position_m is not None
    sets = executor.stage.sets
    values = [in_force.get(i, value) for i, value in enumerate(executor.parameters)]
    if in_force:
        executor.take_in_force(
            [box.clip(value) for box, value in zip(sets, values, strict=True)] if sets else values, to.position_m
        )


def _history_log_prior(cursor: PlanCursor, values: Sequence[float], in_force: dict[int, float]) -> float:
    """Logarithm of the prior likelihood of path parameters flown so far, given those now reported, by index."""
    plan, total = cursor.table.plan, 0.0
    for i, value in in_force.items():
        if i < plan.path_count and plan.has_sets and not plan.hull(i).fixed:
            box = plan.hull(i)
            # −½ (Δ/σ)², in shares of the set
            total -= ((values[i] - box.clip(value)) / (box.hi - box.lo) / HISTORY_STD) ** 2 / 2
    return total


def _alike(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are the same stage and lap, or laps in the same place with the same parameters."""
    if one.stage == other.stage:
        return True
    first, second = one.executor.cursor, other.executor.cursor
    rho = first.table.plan.path_count
    return (
        (first.segment, first.stage.index) == (second.segment, second.stage.index)
        and first.parameters[:rho] == second.parameters[:rho]
        and math.dist(first.offset_m, second.offset_m) < SAME_M
    )


ON_GROUND = 0.5
"""Share of the airspeed of cruise below which no aeroplane flies."""

NEAR_M, NEAR_SHARE, STAYS_S = 10.0, 0.1, 5.0
"""How near altitude [m] and airspeed, as a share, are to the plan's once it is reached, and for how long [s]."""

SLOWEST_MPS, MAX_S = 1.0, 120.0
"""The slowest climb [m/s]: what changes its altitude by less flies level; and the longest take-off [s]: what holds
another airspeed by then goes on doing so."""


class InitialClimb:
    """Follows a take-off by the altitude and the airspeed, as far as they are measured.

    Parameters
    ----------
    first : Sample
        The first of the flight.
    cruise_mps : float
        Airspeed of cruise [m/s].
    altitude_m : float
        The plan's at its start [m].

    Attributes
    ----------
    from_ground : bool
        Whether the flight started on the ground.
    on_plan : bool
        Whether the plan is reached; it stays reached.
    """

    def __init__(self, first: Sample, cruise_mps: float, altitude_m: float) -> None:
        self._cruise_mps, self._start_s = cruise_mps, first.time_s
        airspeed_mps = cruise_mps if first.airspeed_mps is None else first.airspeed_mps
        self.from_ground = airspeed_mps < ON_GROUND * cruise_mps
        # the altitude of level flight [m], and since when it is held [s]; since when the flight is near its plan [s]
        self._level_m, self._level_s = first.altitude_m or 0.0, first.time_s
        self._near_s: float | None = None
        self.on_plan = not self.from_ground and self._update_near(first, altitude_m)

    def update(self, sample: Sample, altitude_m: float) -> None:
        """Update `on_plan` with a sample, beside the plan's altitude at it [m]."""
        if self.on_plan:
            return
        if not self._update_near(sample, altitude_m):
            self._near_s = None
        elif self._near_s is None:
            self._near_s = sample.time_s
        stays = self._near_s is not None and sample.time_s - self._near_s >= STAYS_S
        self.on_plan = stays or sample.time_s - self._start_s > MAX_S

    def _update_near(self, sample: Sample, altitude_m: float) -> bool:
        """Note the altitude of a sample; return whether the flight is near its plan, as far as this is measured.

        That is at cruise airspeed, and at the plan's altitude [m] or at another one that it holds. Where no altitude is
        measured, it is at the plan's once the slowest climb has got there.
        """
        near = sample.airspeed_mps is None or abs(sample.airspeed_mps / self._cruise_mps - 1) <= NEAR_SHARE
        if sample.altitude_m is None:
            return near and (not self.from_ground or (sample.time_s - self._start_s) * SLOWEST_MPS >= altitude_m)
        if abs(sample.altitude_m - self._level_m) > SLOWEST_MPS * STAYS_S:
            self._level_m, self._level_s = sample.altitude_m, sample.time_s
        held = sample.altitude_m > NEAR_M and sample.time_s - self._level_s >= STAYS_S
        return near and (held or abs(sample.altitude_m - altitude_m) <= NEAR_M)

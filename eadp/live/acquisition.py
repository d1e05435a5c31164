"""The position in a plan of a flight whose telemetry begins in the middle of it.

Every stage and lap of the nominal flight is a hypothesis, at several values of the path parameters, since those flown
before are not known. The positions that follow decide between them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, PathUndefined
from eadp.live.gate import GAP_S, GAP_STEPS
from eadp.live.locator import ALIKE, INDEPENDENT_S, MAX_STDS, Hypothesis, best_match, likely, line_between
from eadp.models.plan.cursor import PlanCursor, Vector, cursors
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.route import RoutePredictor
from eadp.models.plan.stage import Leg
from eadp.planning.base import Sample

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

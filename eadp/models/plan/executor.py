"""When a stage ends, and one flight through a plan."""

from __future__ import annotations

import copy
import math
from collections.abc import MutableSequence, Sequence

from eadp.core.expressions.derivatives import PathFunction
from eadp.core.geometry.curves import CIRCLE, LINE, CircleTrack, LineTrack, Point, project, tangent
from eadp.errors import PathUndefined
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.stage import Stage

FIRED, ENDED = 1, 2
"""What happens at a position, as bits: the trigger fires, the plan ends."""

IN_BOX, TRIGGER_X, TRIGGER_Y, RADIUS = range(4)
"""Whether the trigger fires in a box and not in a disc; its position, and its radius or half the box's side."""

ARMED, FLOWN, HALF_LENGTH, LAST_X, LAST_Y = range(4, 9)
"""Whether the disc is armed, the distance flown until then, half the stage's length, the last position."""

PASSED_BY, ALONG_X, ALONG_Y = range(9, 12)
"""Which progress passes the trigger: `BY_LINE`, along a direction of travel, `BY_CIRCLE` or neither."""

CENTRE_X, CENTRE_Y, TURN, TO_GO, GONE, BEARING, SEEN_X, SEEN_Y, REACH_SQUARED = range(12, 21)
"""Of a circle: its centre and turn, the angle to go, the angle gone, and the last direction from the centre, at the
position where it was computed; the square of the distance from there within which the angle cannot be gone."""

ENDS, FINAL_X, FINAL_Y, SIDE_X, SIDE_Y, ACROSS = range(21, 27)
"""Whether the plan ends beyond the final point; that point, the sides of it, the radius across them."""

WATCHED = 27
BY_LINE, BY_CIRCLE = 1.0, 2.0


def watched(w: MutableSequence[float], x: float, y: float, curve: CurveProgress | None) -> int:
    """Whether at a position [m] the trigger fires (`FIRED`) and whether the plan ends (`ENDED`), as bits.

    `w` is what is watched, a list or an array, and is updated. Compiled, `curve` is None. Nothing here may raise.
    """
    dx, dy = x - w[TRIGGER_X], y - w[TRIGGER_Y]
    if w[IN_BOX] != 0.0:
        fires = abs(dx) <= w[RADIUS] and abs(dy) <= w[RADIUS]
    else:
        inside = dx * dx + dy * dy <= w[RADIUS] * w[RADIUS]
        if w[ARMED] == 0.0:
            _arm(w, x, y, inside)
        fires = (inside and w[ARMED] != 0.0) or _passed(w, x, y, curve)
    events = FIRED if fires else 0
    if w[ENDS] != 0.0 and is_beyond(x - w[FINAL_X], y - w[FINAL_Y], w[SIDE_X], w[SIDE_Y], w[ACROSS]):
        events += ENDED
    return events


def _arm(w: MutableSequence[float], x: float, y: float, inside: bool) -> None:
    """Arm the disc once the robot has been outside it, or has flown half the stage."""
    ex, ey = x - w[LAST_X], y - w[LAST_Y]
    w[FLOWN] += math.sqrt(ex * ex + ey * ey)
    w[LAST_X], w[LAST_Y] = x, y
    if not inside or w[FLOWN] >= w[HALF_LENGTH]:
        w[ARMED] = 1.0


def _passed(w: MutableSequence[float], x: float, y: float, curve: CurveProgress | None) -> bool:
    """Whether the progress along the path has passed the trigger."""
    if curve is not None:
        return curve(x, y)
    if w[PASSED_BY] == BY_LINE:
        return (x - w[TRIGGER_X]) * w[ALONG_X] + (y - w[TRIGGER_Y]) * w[ALONG_Y] >= 0
    ex, ey = x - w[SEEN_X], y - w[SEEN_Y]
    if w[PASSED_BY] != BY_CIRCLE or ex * ex + ey * ey < w[REACH_SQUARED]:
        return False
    _turned(w, x, y)
    return w[GONE] >= w[TO_GO]


def _turned(w: MutableSequence[float], x: float, y: float) -> None:
    """Add the angle flown round a circle since the last position where it was computed.

    Seen from the centre, at a distance r, a disc of radius r sin a has the half angle a. Within it an angle a cannot be
    gone, and no turn is missed.
    """
    dx, dy = x - w[CENTRE_X], y - w[CENTRE_Y]
    now = math.atan2(dy, dx)
    turned = now - w[BEARING]
    # the remainder by 2π, exactly: the difference of two directions is within ±2π
    if turned > math.pi:
        turned -= 2 * math.pi
    elif turned < -math.pi:
        turned += 2 * math.pi
    w[GONE] += w[TURN] * turned
    w[BEARING], w[SEEN_X], w[SEEN_Y] = now, x, y
    share = math.sin(max(min(w[TO_GO] - w[GONE], math.pi / 2), 0.0))
    w[REACH_SQUARED] = (dx * dx + dy * dy) * share * share


def is_beyond(dx: float, dy: float, sx: float, sy: float, radius: float) -> bool:
    """Whether a position is strictly beyond the final point along the shift, of sides `sx` and `sy`, and within the
    radius across it [m]."""
    in_x = dx * sx > 0 if sx != 0.0 else abs(dx) <= radius
    in_y = dy * sy > 0 if sy != 0.0 else abs(dy) <= radius
    return in_x and in_y


def signs(shift: Point) -> Point:
    """The sides of the final point along a shift: ±1, and 0 across it."""
    dx, dy = shift
    return 0.0 if abs(dx) < 1e-9 else math.copysign(1.0, dx), 0.0 if abs(dy) < 1e-9 else math.copysign(1.0, dy)


class TriggerWatch:
    """What is watched along one stage.

    Attributes
    ----------
    numbers : list or array of float, shape (27,)
        What `watched` reads and updates; may be replaced by an array of the same numbers.
    curve : CurveProgress or None
        Progress along a general curve.
    """

    def __init__(self, flown: PlanExecutor, position_m: Point, before: TriggerWatch | None) -> None:
        """The stage that is flown, from a position [m]; `before` is its watch before its path was moved."""
        cursor, trigger = flown.cursor, flown.trigger_m
        plan, rules = cursor.table.plan, cursor.table.rules
        radius = plan.radius_m(cursor.stage)
        w = self.numbers = [0.0] * WATCHED
        self.curve: CurveProgress | None = None
        end = cursor.end()
        if end is not None and not end.at_trigger:
            w[ENDS : ACROSS + 1] = [1.0, *end.final_m, *signs(end.shift_m), plan.final_radius_m]
        w[IN_BOX : RADIUS + 1] = [float(rules.box_triggers), *trigger, radius]
        if rules.box_triggers:
            return
        armed = math.dist(trigger, position_m) > radius
        length_m = self._watch_passing(flown, position_m, before)
        w[ARMED : LAST_Y + 1] = [float(armed), 0.0, length_m / 2, *position_m]

    def events(self, x: float, y: float) -> int:
        """`watched` at a position [m]."""
        return watched(self.numbers, x, y, self.curve)

    def without_end(self) -> TriggerWatch:
        """The same watch, but the plan does not end on this stage."""
        other = copy.copy(self)
        other.numbers, other.curve = self.numbers.copy(), copy.copy(self.curve)
        other.numbers[ENDS] = 0.0
        return other

    def resume(self, share: float) -> None:
        """Go on with the stage where a share of it has been flown."""
        w = self.numbers
        if w[PASSED_BY] == BY_CIRCLE:
            self._add_turns((share * w[TO_GO] - w[GONE]) / (2 * math.pi))
        if self.curve is not None:
            self.curve.resume(share)
        w[FLOWN] = 2 * share * w[HALF_LENGTH]

    def _add_turns(self, turns: float) -> None:
        """Add whole turns round the circle to the angle gone."""
        self.numbers[GONE] += 2 * math.pi * round(turns)
        self.numbers[REACH_SQUARED] = 0.0

    def _watch_passing(self, flown: PlanExecutor, position_m: Point, before: TriggerWatch | None) -> float:
        """Watch the progress along the path that passes the trigger; return the stage's nominal length [m]."""
        (ox, oy), w = flown.cursor.offset_m, self.numbers
        local, join = ((x - ox, y - oy) for x, y in (flown.trigger_m, flown.joined_m))
        track = flown.stage.track(flown.path, local)
        length_m = abs(track.ahead_m(join))
        if isinstance(track, LineTrack):
            w[PASSED_BY : ALONG_Y + 1] = [BY_LINE, *track.line.direction]
        elif isinstance(track, CircleTrack):
            circle, (cx, cy) = track.circle, track.circle.centre_m
            w[PASSED_BY], w[BEARING] = BY_CIRCLE, circle.angle_rad(join)
            w[CENTRE_X : TO_GO + 1] = [cx + ox, cy + oy, circle.turn, circle.sweep_rad(join, local)]
            _turned(w, *position_m)  # from where the stage was joined in the plan to where the robot is
            if before is not None and before.numbers[PASSED_BY] == BY_CIRCLE:
                # the path has moved under the robot: whole turns flown stay flown; its angle is that of the last test
                _turned(before.numbers, *position_m)
                self._add_turns((before.numbers[GONE] - w[GONE]) / (2 * math.pi))
        elif math.isfinite(length_m):
            self.curve = CurveProgress(flown.path, flown.stage.sense, length_m, (ox, oy), track.nearest(join))
            self.curve(*position_m)
            if before is not None and before.curve is not None:
                self.curve.progress_m = before.curve.progress_m
        return length_m


class CurveProgress:
    """Progress along a general curve of the point below the robot; called, whether it has passed the trigger."""

    def __init__(self, path: PathFunction, sense: int, length_m: float, offset: Point, start: Point) -> None:
        self.progress_m = 0.0
        self._path, self._sense, self._length_m, self._offset = path, sense, length_m, offset
        self._foot = start

    def resume(self, share: float) -> None:
        """Go on where a share of the length has been flown."""
        self.progress_m = share * self._length_m

    def __call__(self, x: float, y: float) -> bool:
        try:
            foot = project(self._path, (x - self._offset[0], y - self._offset[1]))
            tx, ty = tangent(self._path, foot, self._sense)
        except PathUndefined:  # no point of the path below the robot: it has not moved along it
            return False
        self.progress_m += (foot[0] - self._foot[0]) * tx + (foot[1] - self._foot[1]) * ty
        self._foot = foot
        return self.progress_m >= self._length_m


Form = tuple[float, float, float, float, float, float]
"""A line or a circle: φ = q (u² + v²) + a u + b v + e at (u, v) = (x − x0, y − y0), as (q, x0, y0, a, b, e)."""


class PlanExecutor:
    """One flight through a plan.

    Attributes
    ----------
    cursor : PlanCursor
        The stage being flown, its lap, and the parameters in force.
    joined_m : (float, float)
        Where the stage was joined in the plan: the trigger before it, or the start of the flight [m].
    path : function (x, y) → jet
        Its path function in the frame of lap 0: evaluate it at the position less the cursor's `offset_m`.
    trigger_m : (float, float)
        Its trigger [m].
    form : tuple of float or None
        The path function's closed form in the same frame, where it is a line or a circle.
    watch : TriggerWatch
        What ends the stage and the plan.
    stages_started : int
        Stages started so far, the first included.
    complete : bool
        Whether the plan is done.
    """

    def __init__(self, cursor: PlanCursor, position: Point) -> None:
        """A flight from the start of a stage on, at a position [m]."""
        self.cursor = cursor
        self.joined_m = position
        self.stages_started = 1
        self.complete = False
        self._lay_out(position)

    @property
    def stage(self) -> Stage:
        """The stage being flown."""
        return self.cursor.stage

    @property
    def parameters(self) -> Vector:
        """The parameters in force."""
        return self.cursor.parameters

    def decide(self, parameters: Sequence[float], position: Point, airspeeds_mps: Vector | None = None) -> bool:
        """Take new parameters at a position [m], and airspeeds, None for no others; return whether any has changed.

        Raises
        ------
        PathUndefined
            If the path has no value at the new parameters.
        """
        values, before = tuple(parameters), self.cursor.airspeed_mps
        if airspeeds_mps is not None:
            self.cursor = self.cursor._replace(airspeeds_mps=airspeeds_mps)
        changed = self.cursor.airspeed_mps != before
        if values == self.cursor.decided:
            return changed
        return self._change(self.cursor.decide(values), position) or changed

    def advance(self, x: float, y: float) -> bool:
        """Go on where the stage, or the plan, ends at a position [m]; return whether the stage has changed.

        Raises
        ------
        PathUndefined
            If the next stage has no path or trigger at the parameters in force.
        """
        return self.handle(self.watch.events(x, y), x, y)

    def handle(self, events: int, x: float, y: float) -> bool:
        """Take what `watched` returned at a position [m]; return whether the stage has changed.

        Raises
        ------
        PathUndefined
            If the next stage has no path or trigger at the parameters in force.
        """
        if not events & FIRED:
            self.complete = self.complete or bool(events & ENDED)
            return False
        return self._leave((x, y), ended=bool(events & ENDED))

    def _change(self, cursor: PlanCursor, position: Point) -> bool:
        before, self.cursor = self.cursor, cursor
        rho = cursor.table.plan.path_count
        # live, a lap's last stage keeps the path that it started with
        kept = cursor.table.live and cursor.table.is_last(cursor.stage.index - 1)
        if cursor.parameters[:rho] != before.parameters[:rho] and not kept:
            self._lay_out(position, self.watch)
        return cursor.parameters != before.parameters

    def _leave(self, position: Point, *, ended: bool) -> bool:
        following = None if ended else self.cursor.next()
        if following is None:
            self.complete = True
            return False
        self.cursor, self.joined_m = following, self.trigger_m
        self.stages_started += 1
        self._lay_out(position)
        return True

    def _lay_out(self, position: Point, before: TriggerWatch | None = None) -> None:
        """Put path, trigger and watch where the stage lies now; `before` is this stage's watch so far."""
        cursor = self.cursor
        self.path, (x, y), (ox, oy) = cursor.path(), cursor.local_trigger_m(), cursor.offset_m
        self.trigger_m = (x + ox, y + oy)
        self.watch = TriggerWatch(self, position, before)
        self.form = _form(cursor.stage, self.path, (x, y))


def _form(stage: Stage, path: PathFunction, near: Point) -> Form | None:
    """The closed form of a line or a circle, from one evaluation; None for a curve."""
    if stage.kind not in (LINE, CIRCLE):
        return None
    x, y = near
    try:
        value, gx, gy, hxx, _, _ = path(x, y)
    except (ArithmeticError, ValueError):
        return None
    form = (0.0, x, y, gx, gy, value)
    if stage.kind == CIRCLE:
        if hxx == 0:
            return None
        # φ = ½h |p − c|² + e with p − c = ∇φ/h
        dx, dy = gx / hxx, gy / hxx
        form = (hxx / 2, x - dx, y - dy, 0.0, 0.0, value - hxx / 2 * (dx * dx + dy * dy))
    return form if all(math.isfinite(number) for number in form) else None

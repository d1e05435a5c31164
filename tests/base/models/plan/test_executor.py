"""The plan as it is flown: arming, passing, laps and their shifts, changes of parameters, the end."""

import itertools
import math

import pytest
from common import ROOT
from common.plans import ROUND_AND_ON, WAVES, plan_of, survey
from hypothesis import example, given
from hypothesis import strategies as st

from eadp.core.geometry.curves import CIRCLE, circle_of, line_of
from eadp.models.plan.cursor import LATCHED, LIVE, PlanCursor, Rules, reaches
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.trace import default_start, nominal_legs

NANOMETRE = 1e-9
MILLIMETRE = 1e-3
RADIUS_M = 20.0
STEP_M = 0.5

FLOWN = Rules()
PUBLISHED = Rules(LIVE, box_triggers=True)


def begun(plan, parameters=(), position=None, rules=FLOWN) -> PlanExecutor:
    return PlanExecutor(PlanCursor.start(plan, parameters, rules), position or default_start(plan, parameters)[0])


def polyline(*corners, step_m=STEP_M):
    """Points from corner to corner."""
    for (x0, y0), (x1, y1) in itertools.pairwise(corners):
        count = max(1, round(math.dist((x0, y0), (x1, y1)) / step_m))
        for k in range(count):
            yield x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count
    yield corners[-1]


def arc(centre, radius, begin_deg, end_deg, step_deg=0.5):
    """Points round a centre, either way."""
    count = round(abs(end_deg - begin_deg) / step_deg)
    for k in range(count + 1):
        angle = math.radians(begin_deg + (end_deg - begin_deg) * k / count)
        yield centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)


def first_change(itinerary, points):
    """Where the stage changes first along points, or None."""
    for x, y in points:
        if itinerary.advance(x, y) or itinerary.complete:
            return x, y
    return None


def to_next(itinerary):
    """Go straight to the trigger; the stages of these plans begin outside it."""
    before = itinerary.stages_started
    itinerary.advance(*itinerary.trigger_m)
    assert itinerary.stages_started == before + 1


# --- arming -----------------------------------------------------------------------------------------------------------


def test_a_closed_circle_does_not_fire_where_it_starts():
    itinerary = begun(plan_of(ROUND_AND_ON), position=(50.0, 0.0))
    x, y = first_change(itinerary, arc((0, 0), 50, 0, 400))
    # a chord of 20 m in a circle of 50 m: 2 asin(10/50) before the whole turn
    angle = math.degrees(math.atan2(y, x)) % 360
    assert angle == pytest.approx(360 - math.degrees(2 * math.asin(0.2)), abs=0.5)
    assert itinerary.stage.index == 2


@pytest.mark.parametrize("begin_deg", [1, 10, 22, -1, -10, -22])
def test_begun_within_the_radius_it_is_not_armed(begin_deg):
    start = (50 * math.cos(math.radians(begin_deg)), 50 * math.sin(math.radians(begin_deg)))
    itinerary = begun(plan_of(ROUND_AND_ON), position=start)
    assert not itinerary.advance(*start)
    x, y = first_change(itinerary, arc((0, 0), 50, begin_deg, begin_deg + 360))
    swept = (math.degrees(math.atan2(y, x)) - begin_deg) % 360
    if begin_deg > 0:  # beyond the trigger already: once round, to within the radius
        assert swept == pytest.approx(360 - 23.07 - begin_deg, abs=0.5)
    else:  # before it: half of what is left of the stage
        assert swept == pytest.approx(-begin_deg / 2, abs=0.6)


def test_of_two_stages_in_one_place_each_is_flown():
    text = "1; 90; x\n0, 100\n1; 90; x\n0, 104\n1; 90; x\n0, 300\n"
    itinerary = begun(plan_of(text), position=(0.0, 0.0))
    changes = [y for x, y in polyline((0, 0), (0, 200), step_m=0.1) if itinerary.advance(x, y)]
    assert changes[0] == pytest.approx(80, abs=0.2), "20 m before 100"
    # nominally 4 m long, begun at y = 80 within 24 m of its trigger: armed outside the radius
    assert changes[1] == pytest.approx(84, abs=0.2)
    assert itinerary.stage.index == 3


# --- what cannot be missed --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("off_m", [0, 15, 21, 300, -45])
@pytest.mark.parametrize("rotation", [90, 270])
def test_a_line_past_its_trigger(off_m, rotation):
    up = 1 if rotation == 90 else -1
    plan = plan_of(f"1; {rotation}; x - 30\n30, 0\n1; 90; y\n500, 0\n")
    itinerary = begun(plan, position=(30.0 + off_m, -200.0 * up))
    _, y = first_change(itinerary, polyline((30 + off_m, -200 * up), (30 + off_m, 200 * up)))
    early = math.sqrt(RADIUS_M**2 - off_m**2) if abs(off_m) < RADIUS_M else 0
    assert y * up == pytest.approx(-early, abs=STEP_M + NANOMETRE)


@pytest.mark.parametrize("off_m", [-45, -21, 21, 100])
@pytest.mark.parametrize("rotation", [90, 270])
@pytest.mark.parametrize("sweep_deg", [30, 170, 190, 350])
def test_a_circle_past_its_trigger(off_m, rotation, sweep_deg):
    turn = 1 if rotation == 90 else -1
    begin = 160 * turn  # so that ±180° lies on the way
    end = math.radians(begin + turn * sweep_deg)
    trigger = f"{7 + 70 * math.cos(end)}, {-3 + 70 * math.sin(end)}"
    text = f"1; {rotation}; (x-7)^2+(y+3)^2-4900\n{trigger}\n1; 90; y\n500, 0\n"
    points = list(arc((7, -3), 70 + off_m, begin, begin + turn * 400))
    itinerary = begun(plan_of(text), position=points[0])
    x, y = first_change(itinerary, points)
    swept = (turn * (math.degrees(math.atan2(y + 3, x - 7)) - begin)) % 360
    assert swept == pytest.approx(sweep_deg, abs=0.51)


ROUND_AN_ELLIPSE = "1; 90; x - 60\n60, 0\n1; 90; x^2/3600 + y^2/1600 - 1\n0, -40\n1; 90; y + 0*c1\n900, 0\n"


def round_an_ellipse(off_m, decided_at_deg=None):
    """The direction [°] in which three quarters of an ellipse are passed by a robot that flies beside it."""
    itinerary = begun(plan_of(ROUND_AN_ELLIPSE), (0.0,), (60.0, -100.0), Rules(LIVE))
    assert itinerary.advance(60.0, -19.0)
    for degrees in range(720):
        x, y = (60 + off_m) * math.cos(math.radians(degrees)), (40 + off_m) * math.sin(math.radians(degrees))
        if degrees == decided_at_deg:
            itinerary.decide((1.0,), (x, y))
        if itinerary.advance(x, y):
            return degrees
    return None


@pytest.mark.parametrize("off_m", [-22, 22, 40])
def test_a_curve_is_passed_at_its_trigger_and_not_where_its_length_has_been_flown(off_m):
    assert round_an_ellipse(off_m) == pytest.approx(270, abs=30)


@pytest.mark.parametrize("decided_at_deg", [90, 180])
def test_a_live_change_does_not_lose_the_progress_round_a_curve(decided_at_deg):
    assert round_an_ellipse(22, decided_at_deg) == pytest.approx(round_an_ellipse(22), abs=15)


def test_published_triggers_are_a_box_and_can_be_missed():
    text = "1; 90; x\n0, 0\n1; 90; x\n0, 500\n"
    rules = Rules(LATCHED, box_triggers=True)
    corner = begun(plan_of(text), position=(20.0, -100.0), rules=rules)
    assert first_change(corner, polyline((20, -100), (20, 100), step_m=1)) == pytest.approx((20, -20))
    assert first_change(begun(plan_of(text), rules=rules), polyline((20.1, -100), (20.1, 100))) is None
    assert begun(plan_of(text), position=(0.0, 0.0), rules=rules).advance(0.0, 0.0), "not armed either"


# --- the same in later laps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lap", [1, 7])
@pytest.mark.parametrize("off_m", [-30, 30])
def test_a_line_of_a_later_lap_past_its_trigger(lap, off_m):
    itinerary = begun(survey(), (0.0, 0.0))
    for _ in range(4 * lap + 1):
        to_next(itinerary)
    x = -115 + 10 * lap + off_m
    _, y = first_change(itinerary, polyline((x, 146 + lap), (x, -80)))
    assert y == pytest.approx(-11 + lap, abs=STEP_M + NANOMETRE)


@pytest.mark.parametrize("off_m", [-24, 24])
def test_a_curve_of_a_later_lap_past_its_trigger(off_m):
    itinerary = begun(plan_of(WAVES), (), (0.0, 0.0))
    to_next(itinerary)
    to_next(itinerary)
    assert (itinerary.cursor.lap, itinerary.cursor.offset_m) == (1, (90, 50))
    beside = ((90 + x, 50 + 30 * math.sin(x / 40) + off_m) for x in (k / 4 for k in range(1600)))
    x, _ = first_change(itinerary, beside)
    assert x == pytest.approx(290, abs=15), "beside it, progress is only near to that on it"


# --- one survey, two descriptions of where its stages lie -------------------------------------------------------------


class Table:
    """Where the survey's stages lie: ../spec/07, Stages, written out. The offset (sx, sy) is subtracted."""

    def __init__(self, c1):
        self.c1, self.stage = c1, 1
        self.sx = self.sy = 0.0

    @property
    def r2(self):
        return math.sqrt(4900 + self.c1)

    def increment(self):
        return 150 - 2 * self.r2, (75 - self.r2) / 5

    def path(self):
        """Kind, then centre and radius or the line's x; then the trigger."""
        sx, sy = self.sx, self.sy
        return {
            1: (CIRCLE, (self.r2 - 115 - sx, 146 - sy, self.r2), (-115 - sx, 146 - sy)),
            2: ("line", (-115 - sx,), (-115 - sx, -11 - sy)),
            3: (CIRCLE, (-40 - sx, 11 - sy, 75.0), (35 - sx, -11 - sy)),
            4: ("line", (35 - sx,), (35 - sx, 146 - sy)),
        }[self.stage]


class Latched(Table):
    """A decision waits for stage 4; the offset grows once at the end of the lap."""

    def __init__(self, c1):
        super().__init__(c1)
        self.decided = c1

    def decide(self, c1):
        self.decided = c1

    def next(self):
        self.stage = self.stage % 4 + 1
        if self.stage == 4:
            self.c1 = self.decided
        if self.stage == 1:
            dx, dy = self.increment()
            self.sx, self.sy = self.sx - dx, self.sy - dy


class Published(Table):
    """As flown for the letter: the offset grows on entering stage 4; a change takes the last increment back first."""

    def __init__(self, c1):
        super().__init__(c1)
        self.last = (0.0, 0.0)
        self.laps = 0
        self.kept = None

    def path(self):
        return self.kept if self.stage == 4 else super().path()

    def decide(self, c1):
        self.c1 = c1
        if self.laps:
            self.sx, self.sy = self.sx + self.last[0], self.sy + self.last[1]
            self._grow()

    def next(self):
        self.stage = self.stage % 4 + 1
        if self.stage == 4:
            self.kept = Table.path(self)
            self._grow()
            self.laps += 1

    def _grow(self):
        self.last = self.increment()
        self.sx, self.sy = self.sx - self.last[0], self.sy - self.last[1]


def lies(itinerary):
    """The itinerary's answer in the table's form."""
    ox, oy = itinerary.cursor.offset_m
    local = (itinerary.trigger_m[0] - ox, itinerary.trigger_m[1] - oy)
    if itinerary.stage.kind == CIRCLE:
        circle = circle_of(itinerary.path, local, itinerary.stage.sense)
        shape = (circle.centre_m[0] + ox, circle.centre_m[1] + oy, circle.radius_m)
    else:
        line = line_of(itinerary.path, local, itinerary.stage.sense)
        assert line.direction == pytest.approx((0, -1 if itinerary.stage.index == 2 else 1))
        shape = (line.point_m[0] + ox,)
    return itinerary.stage.kind, shape, itinerary.trigger_m


def same_place(itinerary, table):
    kind, shape, trigger = lies(itinerary)
    wanted_kind, wanted_shape, wanted_trigger = table.path()
    assert (itinerary.stage.index, kind) == (table.stage, wanted_kind)
    assert shape == pytest.approx(wanted_shape, abs=1e-7)
    assert trigger == pytest.approx(wanted_trigger, abs=1e-7)


decisions = st.floats(-1000, 0)
events = st.lists(st.one_of(st.just("next"), st.just("next"), st.just("next"), decisions), max_size=20)


def follow(itinerary, table, happenings):
    same_place(itinerary, table)
    for event in happenings:
        if event == "next":
            to_next(itinerary)
            table.next()
        else:
            itinerary.decide((event, 2.0), (-1000.0, -1000.0))  # away from every trigger: armed
            table.decide(event)
        same_place(itinerary, table)


@given(decisions, events)
def test_latched_changes_wait_for_stage_4(c1, happenings):
    itinerary, table = begun(survey(), (c1, 2.0)), Latched(c1)
    follow(itinerary, table, happenings)
    assert itinerary.parameters[0] == table.c1


@given(decisions, events, st.sampled_from([PUBLISHED, Rules(LIVE)]))
def test_live_changes_are_the_published_ones(c1, happenings, rules):
    itinerary, table = begun(survey(), (c1, 2.0), rules=rules), Published(c1)
    follow(itinerary, table, happenings)
    assert itinerary.parameters[0] == table.c1


def touch_m(one, other):
    """How far the path of a line is from touching a circle, or of a circle a line [m]."""
    (kind, shape, _), (_, line, _) = (one, other) if one[0] == CIRCLE else (other, one)
    assert kind == CIRCLE
    return abs(abs(shape[0] - line[0]) - shape[2])


@given(decisions, events)
@example(-1.0, ["next", "next", "next", "next", 0.0])
def test_latched_stages_always_join(c1, happenings):
    itinerary = begun(survey(), (c1, 2.0))
    for event in [*happenings, *["next"] * 8]:
        if event != "next":
            itinerary.decide((event, 2.0), itinerary.trigger_m)
            continue
        before = lies(itinerary)
        to_next(itinerary)
        assert touch_m(before, lies(itinerary)) < 1e-7


def test_computations_change_at_once():
    itinerary = begun(survey(), (0.0, 2.0))
    assert itinerary.decide((-500.0, 7.0), (0.0, 0.0)) is True
    assert itinerary.parameters == (0, 7)
    assert itinerary.decide((-500.0, 7.0), (0.0, 0.0)) is False


LATE = """\
init:
a = 0, 10 + c2
path:
0.1; 90; x - a
a, 100
0.1; 90; y - 100
a + 200, 100
0.1; 270; x - a - 200 - c1
a + 200 + c1, 0
0.1; 270; y - 0*c3
a + c4, 0
trig:
1000, 0
"""


def test_a_parameter_waits_for_the_stage_before_the_first_whose_path_names_it():
    itinerary = begun(plan_of(LATE), (0.0,) * 4, (0.0, -100.0))
    itinerary.decide((1.0, 2.0, 3.0, 4.0), (0.0, -50.0))
    seen = []
    for _ in range(5):
        seen.append(itinerary.parameters)
        to_next(itinerary)
    assert seen == [
        (0, 0, 0, 0),
        (1, 0, 0, 0),  # stage 3's path names c1
        (1, 0, 3, 0),  # stage 4's names c3
        (1, 0, 3, 0),
        (1, 2, 3, 4),  # no path names c2 and c4: from the next lap on
    ]
    assert itinerary.cursor.offset_m == (10, 0), "the shift of the lap that was flown with c2 = 0"
    for _ in range(4):
        to_next(itinerary)
    assert itinerary.cursor.offset_m == (22, 0)


# --- sets per stage ---------------------------------------------------------------------------------------------------


def test_a_decision_is_clipped_to_the_stages_set():
    first = "1; 90; x - c1\n0, 0\n[-5, 5]\n[2, 10]\n"
    second = "1; 270; x - c1\n0, -500\n[0, 3]\n[0, 0]\n"
    text = first + second + "1; 90; x\n0, 0\n[9, 9]\n[3, 4]\n"
    itinerary = begun(plan_of(text), (8.0, 20.0), (0.0, -100.0))
    assert itinerary.parameters == (5, 10)
    to_next(itinerary)
    assert itinerary.parameters == (3, 0), "inhibited here"
    itinerary.decide((1.0, 1.0), (0.0, -300.0))
    assert itinerary.parameters == (3, 0), "the path waits for the next stage"
    to_next(itinerary)
    assert itinerary.parameters == (9, 3), "fixed here"


def test_a_set_that_fixes_c1_where_no_path_names_it_does_not_part_the_stages():
    text = (ROOT / "plans" / "survey.plan").read_text(encoding="utf-8")
    head, tail = text.split("right, top\n[-1000, 0]")
    itinerary = begun(plan_of(f"{head}right, top\n[0, 0]{tail}"), (0.0, 2.0))
    itinerary.decide((-1000.0, 2.0), itinerary.trigger_m)
    for _ in range(8):
        before = lies(itinerary)
        to_next(itinerary)
        assert touch_m(before, lies(itinerary)) < 1e-7


# --- the end ----------------------------------------------------------------------------------------------------------

STRIPS = """\
init:
n = 4
a = 0, 10
b = 40, 10
path:
0.1; 90; x - a
a, 100
0.01; 270; (x - a - 20)^2 + (y - 100)^2 - 400
b, 100
0.1; 270; x - b
b, 0
0.01; 270; (x - b + 15)^2 + y^2 - 225
a + 10, 0
trig:
57, 15
"""


def laps_on(plan, parameters, laps):
    """An itinerary that has just begun a lap."""
    itinerary = begun(plan, parameters)
    while itinerary.cursor.lap < laps:
        to_next(itinerary)
    return itinerary


def test_a_plan_with_a_shift_along_one_axis_ends_within_the_radius_across_it():
    plan = plan_of(STRIPS)
    # the last trigger of lap k lies at x = 10 + 10 k: from lap 5 at or beyond 57
    for x, y, over in [(57.0, 15.0, False), (60.0, -5.1, False), (60.0, 35.1, False), (57.1, 35.0, True)]:
        itinerary = laps_on(plan, (), 5)
        itinerary.advance(x, y)
        assert itinerary.complete == over, (x, y)
        itinerary = laps_on(plan, (), 4)
        itinerary.advance(x, y)
        assert not itinerary.complete, "a lap too early"
    never = laps_on(plan_of(STRIPS.replace("57, 15", "57, 50")), (), 20)
    never.advance(60.0, 50.0)
    assert not never.complete, "no lap's last trigger lies within 20 m of y = 50"
    wide = laps_on(plan_of(STRIPS.replace("57, 15", "57, 50").replace("a + 10, 0", "a + 10, 0, 60")), (), 5)
    wide.advance(60.0, -9.9)
    assert wide.complete, "the last stage's own radius"


def test_published_flights_end_by_position_alone():
    itinerary = begun(survey(), (0.0, 2.0), rules=PUBLISHED)
    itinerary.advance(175.1, 161.1)
    assert itinerary.complete


def test_an_explicit_plan_ends_at_its_last_trigger():
    itinerary = begun(plan_of(ROUND_AND_ON), (), (0.0, -50.0))
    to_next(itinerary)
    assert first_change(itinerary, polyline((50, 0), (50, 190))) == pytest.approx((50, 180), abs=STEP_M)
    assert itinerary.complete
    assert itinerary.stage.index == 2


@given(*[st.floats(-100, 100)] * 4, st.sampled_from([0.0, 1e-12, 3.0, -3.0]), st.sampled_from([0.0, 0.5, -7.0]))
def test_reaching_the_final_point_axis_by_axis(x, y, fx, fy, dx, dy):
    def axis(value, end, d):
        return abs(value - end) <= 20 if abs(d) < 1e-9 else (value >= end if d > 0 else value <= end)

    if min(abs(x - fx), abs(y - fy), abs(abs(x - fx) - 20), abs(abs(y - fy) - 20)) < 1e-6:
        return
    assert reaches((x, y), (fx, fy), (dx, dy), 20.0) == (axis(x, fx, dx) and axis(y, fy, dy))


# --- the nominal flight -----------------------------------------------------------------------------------------------

WEST = math.atan2(22, 75)  # how far below its circle's diameter stage 3 begins and ends, seen from its centre


def lap_by_hand(c1):
    """Lengths [m] of a survey's lap after the first, from the figure: arcs between the triggers' directions."""
    r2 = math.sqrt(4900 + c1)
    dy = (75 - r2) / 5
    # circle 1 is joined from the last line's end, r2 to the right of its centre and dy below
    return [r2 * (math.pi + math.atan(dy / r2)), 157, 75 * (math.pi - 2 * WEST), 157]


@pytest.mark.parametrize(("c1", "laps"), [(0.0, 16), (-500.0, 10), (-1000.0, 7)])
def test_nominal_laps_of_the_survey(c1, laps):
    legs = nominal_legs(survey(), (c1, 2.0))
    hand = lap_by_hand(c1)
    first = [math.sqrt(4900 + c1) * math.pi / 2, *hand[1:]]
    lengths = [leg.length_m for leg in legs]
    assert lengths[:4] == pytest.approx(first, abs=MILLIMETRE)
    for lap in range(1, laps):
        assert lengths[4 * lap : 4 * lap + 4] == pytest.approx(hand, abs=MILLIMETRE)
    # the laps that it takes by 01-model's rule: until the last trigger is at or beyond 175 and 161
    d, e = 150 - 2 * math.sqrt(4900 + c1), (75 - math.sqrt(4900 + c1)) / 5
    assert laps == 1 + max(math.ceil(140 / d - 1e-9), math.ceil(15 / e - 1e-9))
    # it is over within the length of the trigger's radius round the last one
    whole = sum(first) + (laps - 1) * sum(hand)
    assert sum(leg.distance_m for leg in legs) == pytest.approx(whole, abs=1.5)


# --- where to begin ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stage", "position", "heading"),
    [
        ("1; 90; x - 3\n3, 50", (3, -50), math.pi / 2),
        ("1; 90; 3*x + 4*y\n-40, 30", (40, -30), math.atan2(3, -4)),
        ("1; 90; (x+45)^2+(y-146)^2-4900\n-115, 146", (-45, 216), math.pi),
        ("1; 90; 4900-(x+45)^2-(y-146)^2\n-115, 146", (-45, 76), math.pi),
        ("1; 90; x - 3\n40, 50", (3, -50), math.pi / 2),  # a trigger beside its line
    ],
)
def test_default_start(stage, position, heading):
    start, direction = default_start(plan_of(f"{stage}\n1; 90; y\n500, 0\n"), ())
    assert start == pytest.approx(position, abs=NANOMETRE)
    assert (math.cos(direction), math.sin(direction)) == pytest.approx((math.cos(heading), math.sin(heading)))

"""The Zamboni-like motion: its equations, its legs, and plans written of it, at any parameters lap by lap."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.geometry.polygons import covered_share
from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text
from eadp.models.airspace import Field
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.trace import nominal_legs
from eadp.survey.coverage import ZAMBONI, CoverageRequest, cover
from eadp.survey.plan_builder import build_plan
from eadp.survey.swaths import MotionLimits, frame_of
from eadp.survey.zamboni import BlockLayout, build_block, layouts

MOTION = MotionLimits(swath_m=30.0, min_radius_m=30.0, radius_m=45.0, spacing_m=15.0)
rounding = 1e-6


def quadrilateral(seed):
    """A field of four slanted sides, some 400 m across."""
    rng = np.random.default_rng(seed)
    corners = np.array([(-200, -200), (200, -200), (200, 200), (-200, 200)]) * (0.9 + 0.5 * rng.random((4, 1)))
    return Field(tuple(map(tuple, (corners + 40 * rng.random((4, 2))).tolist())))


def solution_of(field, heading=math.pi / 2):
    return cover(CoverageRequest(field, MOTION, ZAMBONI, heading))


def covered(field, legs):
    lines = [(leg.piece.start[:2], leg.piece.end[:2]) for leg in legs if leg.sensing]
    return covered_share(field.parts, lines, MOTION.swath_m)


def flown(plan, draw):
    """The stages of a plan whose path parameter is drawn anew at every stage."""
    cursor = PlanCursor.start(plan, (draw(),) * plan.path_count)
    stages = []
    while cursor is not None:
        stages.append(cursor)
        cursor = cursor.decide((draw(),) * plan.path_count).next()
    return stages


@given(st.integers(1, 4), st.integers(5, 40), st.floats(15, 30), st.floats(0, 1))
def test_lines_lie_as_far_apart_as_the_letter_says(blocks, lines, pitch, share):
    layout = BlockLayout(blocks, lines, pitch)
    box = np.array([(0.0, 0.0), (lines * pitch, 0.0), (lines * pitch, 300.0), (0.0, 300.0)])
    block = build_block(frame_of(math.pi / 2), box, pitch / 2, layout, MOTION)
    c1 = share * block.min_c1
    # two lines and two half circles: over by 2 r1, back by 2 r2(c1); r1 = r + x_d/2
    r2 = math.sqrt(block.radius_m**2 + c1)
    assert block.spacing_at(c1) == pytest.approx(2 * block.first_radius_m - 2 * r2, abs=rounding)
    assert block.spacing_at(0.0) == pytest.approx(block.spacing_m, abs=rounding)
    # at the lowest they move as far as they may, a pitch or more
    assert block.spacing_at(block.min_c1) == pytest.approx(block.max_spacing_m, abs=rounding)
    assert block.max_spacing_m >= pitch - rounding
    assert block.spacing_m <= 0.5 * pitch + rounding


@given(st.floats(100, 2000))
def test_layouts_fill_the_width_and_keep_the_radius(width):
    for layout in layouts(width, MOTION):
        assert layout.blocks * layout.lines * layout.pitch_m == pytest.approx(width)
        assert layout.pitch_m <= MOTION.swath_m + rounding
        assert layout.second_radius_m >= MOTION.min_radius_m - rounding
        assert layout.max_spacing_m(MOTION) <= MOTION.swath_m + rounding
        assert layout.first_radius_m - layout.max_spacing_m(MOTION) / 2 >= MOTION.min_radius_m - rounding


def test_a_width_that_needs_tighter_turns_has_no_layout():
    # six lines 30 m apart: the second turn has (3 − 1)·30/2 m
    assert [layout.lines for layout in layouts(6 * 30, MOTION)] == [6, 7]
    # at 140 m five lines and six would turn with 28 m and 23.3 m
    assert layouts(140, MOTION) == []


@pytest.mark.slow
@given(st.integers(0, 10_000), st.floats(0, 1), st.floats(0, 1))
def test_a_smaller_parameter_never_needs_more_lines(seed, a, b):
    solution = solution_of(quadrilateral(seed))
    low, high = (share * solution.min_c1 for share in (max(a, b), min(a, b)))
    assert solution.path(low).lines <= solution.path(high).lines


def test_laps_are_saved_in_flight_too():
    """A parameter lowered after the first lap still shortens what is left of the block."""
    block = solution_of(quadrilateral(1)).blocks[0]
    paths = [block.legs(values) for values in ([0.0], [0.0, block.min_c1], [block.min_c1])]
    lines = [sum(leg.sensing for leg in legs) for legs in paths]
    assert lines[0] > lines[1] >= lines[2]


@pytest.mark.slow
@given(st.integers(0, 10_000), st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_no_gap_at_any_parameter_of_any_lap(seed, shares):
    field = quadrilateral(seed)
    solution = solution_of(field)
    legs = []
    for block in solution.blocks:
        legs += block.legs([share * block.min_c1 for share in shares])
    assert covered(field, legs) >= 0.9999
    for c1 in (0.0, solution.min_c1):
        assert covered(field, solution.path(c1).legs) >= 0.9999


@pytest.mark.quick(2)
@pytest.mark.parametrize("heading", [math.pi / 2, 0.3, 2.9])
@pytest.mark.parametrize("seed", range(4))
def test_the_plan_is_the_path_at_both_ends_of_its_parameter(seed, heading):
    solution = solution_of(quadrilateral(seed), heading)
    plan, findings = read_plan(Text("p", plan_text(build_plan(solution))))
    assert findings == []
    for c1 in (0.0, solution.min_c1):
        legs = nominal_legs(plan, [c1], solution.path(c1).legs[0].piece.start[:2])
        # the plan's first line is two stages, so that the default start is its start
        ends = [legs[0].start_m, *(leg.end_m for leg in legs[1:])]
        expected = [leg.piece.end[:2] for leg in solution.path(c1).legs]
        assert np.allclose(ends[1:], expected, atol=1e-3)
        assert sum(leg.length_m for leg in legs) == pytest.approx(solution.path(c1).length_m, abs=1e-2)


@pytest.mark.quick(1)
@pytest.mark.parametrize("seed", range(4))
def test_a_plan_flown_with_a_parameter_that_keeps_changing_is_whole(seed):
    """Position, direction and radius at every trigger, and the ground, whatever c1 is from stage to stage."""
    field = quadrilateral(seed)
    solution = solution_of(field)
    plan = read_plan(Text("p", plan_text(build_plan(solution))))[0]
    rng = np.random.default_rng(seed)
    places = flown(plan, lambda: rng.choice([0.0, 1.0, rng.random()]) * solution.min_c1)
    lines = []
    before = None
    for here, after in itertools.pairwise(places):
        trigger = here.trigger_m()
        jets = [place.path()(*trigger) for place in (here, after)]
        headings = []
        for place, (value, gx, gy, *_) in zip((here, after), jets, strict=True):
            assert abs(value) / math.hypot(gx, gy) < 1e-6
            headings.append(math.atan2(place.stage.sense * gx, -place.stage.sense * gy))
        assert abs(math.remainder(headings[1] - headings[0], 2 * math.pi)) < math.radians(1e-3)
        if here.stage.kind == "circle":
            value, gx, gy, hxx, *_ = here.path()(*trigger)
            assert math.hypot(gx, gy) / hxx >= MOTION.min_radius_m - 1e-6
        elif before is not None:
            lines.append((before, trigger))
        before = trigger
    lines.append((before, places[-1].trigger_m()))
    first = places[0].trigger_m()
    start = solution.path(0.0).legs[0].start[:2]
    assert covered_share([(field.outline,)], [(start, first), *lines], MOTION.swath_m) >= 0.9999


def test_a_rectangles_laps_move_by_the_letters_shift():
    """Eq. 2 with d(c1): where levels are flat, every stage of a lap is that of the lap before, moved by d(c1)."""
    field = Field(((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0)))
    solution = solution_of(field)
    plan = read_plan(Text("p", plan_text(build_plan(solution))))[0]
    assert plan.primitive_stages == 4
    part = next(part for part in plan.segments if part.repeats)
    block = solution.blocks[0]
    points = np.random.default_rng(0).uniform(-300, 300, (20, 2))
    for c1 in (0.0, solution.min_c1, 0.4 * solution.min_c1):
        state = part.start([c1])
        later = part.next([c1], state)
        dx, dy = (block.spacing_at(c1) * u for u in block.frame.across)
        for stage in plan.stages[part.first : part.first + 4]:
            here, there = stage.path_at([c1], state), stage.path_at([c1], later)
            for x, y in points:
                assert there(x + dx, y + dy)[0] == pytest.approx(here(x, y)[0], rel=1e-9, abs=1e-6)
            trigger, moved = stage.trigger_at([c1], state), stage.trigger_at([c1], later)
            assert (moved[0] - trigger[0], moved[1] - trigger[1]) == pytest.approx((dx, dy), abs=rounding)

"""Coverage paths: fields of any shape covered, no turn too tight, the same over a field turned, moved, mirrored."""

import itertools
import math
from functools import cache
from itertools import product

import numpy as np
import pytest
import shapely
from common import draws, few, few_rows
from hypothesis import given, settings
from hypothesis import strategies as st

from eadp.api.inputs import load_flight
from eadp.check.check import check_plan
from eadp.core.geometry.curves import wrap_angle_rad
from eadp.errors import Infeasible
from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text
from eadp.models.airspace import Field
from eadp.models.plan.stage import Box
from eadp.models.plan.trace import default_start
from eadp.simulation.loop import Outcome, fly
from eadp.survey.coverage import DUBINS, PATTERNS, ZAMBONI, CoverageRequest, cover
from eadp.survey.plan_builder import FieldComputations, build_plan
from eadp.survey.report import Covered
from eadp.survey.swaths import MotionLimits

MOTION = MotionLimits(swath_m=30.0, min_radius_m=30.0, radius_m=45.0, spacing_m=15.0)

SHAPES = {
    "rectangle": [(0, 0), (420, 60), (380, 340), (-40, 280)],
    "trapezoid": [(0, 0), (500, 0), (340, 300), (120, 300)],
    "L": [(0, 0), (420, 0), (420, 150), (180, 150), (180, 400), (0, 400)],
    "U": [(0, 0), (450, 0), (450, 380), (300, 380), (300, 140), (150, 140), (150, 380), (0, 380)],
    "T": [(0, 250), (0, 400), (460, 400), (460, 250), (310, 250), (310, 0), (150, 0), (150, 250)],
    "comb": [(0, 0), (500, 0), (500, 300), (420, 300), (420, 90), (300, 90), (300, 300), (200, 300), (200, 90),
             (90, 90), (90, 300), (0, 300)],
    "star": [(round(200 + r * math.cos(k * math.pi / 5), 1), round(200 + r * math.sin(k * math.pi / 5), 1))
             for k, r in zip(range(10), itertools.cycle((260, 120)), strict=False)],
    "narrow": [(0, 0), (600, 30), (600, 75), (0, 45)],
    "small": [(0, 0), (25, 0), (20, 18)],
}  # fmt: skip
HOLED = (0.0, 0.0), (460.0, 0.0), (460.0, 400.0), (0.0, 400.0)
HOLE = Field(HOLED, (((180.0, 250.0), (300.0, 260.0), (240.0, 130.0)),))
FIELDS = {name: Field(tuple((float(x), float(y)) for x, y in ring)) for name, ring in SHAPES.items()} | {"hole": HOLE}


def whole(legs):
    """Legs join in position and direction."""
    for a, b in itertools.pairwise(legs):
        assert math.dist(a.piece.end[:2], b.piece.start[:2]) < 1e-6
        assert abs(wrap_angle_rad(a.piece.end[2] - b.piece.start[2])) < math.radians(1e-3)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("name", "pattern"), few_rows(product(FIELDS, PATTERNS), 5))
def test_every_shape_is_covered(name, pattern):
    field = FIELDS[name]
    try:
        solution = cover(CoverageRequest(field, MOTION, pattern))
    except Infeasible:
        assert pattern == ZAMBONI
        assert name in ("narrow", "small")
        return
    for c1 in (0.0, solution.min_c1):
        path = solution.path(c1)
        assert Covered(field, path, MOTION.swath_m).share >= 0.9999
        assert path.min_radius_m >= MOTION.min_radius_m - 1e-6
        whole(path.legs)


@pytest.mark.slow
@pytest.mark.parametrize("pattern", [ZAMBONI, DUBINS])
@pytest.mark.parametrize("name", few(["hole", "L", "star"], 1))
def test_the_plan_passes_its_check_and_reads_back(name, pattern):
    ends = {"heading_rad": 0.3, "start_m": (-300.0, -200.0), "home_m": (-320.0, -180.0)}
    solution = cover(CoverageRequest(FIELDS[name], MOTION, pattern, **ends))
    computations = FieldComputations((("fps", ""),), (Box(2.0, 10.0),), off_on_turns=True)
    text = plan_text(build_plan(solution, computations=computations, min_radius_m=30.0))
    plan, findings = read_plan(Text("p", text))
    assert findings == []
    assert check_plan(plan).findings == ()
    assert plan_text(plan) == text


def test_computations_stop_on_turns():
    computations = FieldComputations((("fps", ""),), (Box(2.0, 10.0),), off_on_turns=True)
    solution = cover(CoverageRequest(HOLE, MOTION, DUBINS, heading_rad=0.0))
    plan = build_plan(solution, computations=computations)
    for stage in plan.stages:
        if stage.kind == "circle":
            assert stage.sets[-1].inhibited
    assert any(not stage.sets[-1].inhibited for stage in plan.stages)


def moved(field, angle, shift, mirror):
    """The field mirrored across the y axis or not, then turned, then shifted."""

    def place(point):
        x, y = (-point[0] if mirror else point[0]), point[1]
        c, s = math.cos(angle), math.sin(angle)
        return c * x - s * y + shift[0], s * x + c * y + shift[1]

    rings = [tuple(place(point) for point in ring) for ring in (field.outline, *field.holes)]
    if mirror:
        rings = [ring[::-1] for ring in rings]
    return Field(rings[0], tuple(rings[1:])), place


@cache
def unmoved(name, pattern):
    """A field of irregular corners, so that no two paths are equally long, and its path."""
    corners = np.array(FIELDS[name].outline) + np.array([(0, 0), (13, 4), (-9, 21), (5, -17)])
    field = Field(tuple(map(tuple, corners.tolist())))
    return field, cover(CoverageRequest(field, MOTION, pattern)).path(0.0)


@pytest.mark.slow
@given(
    st.sampled_from(["rectangle", "trapezoid"]),
    st.sampled_from([ZAMBONI, DUBINS]),
    st.floats(-3.1, 3.1),
    st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    st.booleans(),
)
@settings(max_examples=draws(0.2))
def test_the_path_over_a_field_moved_is_the_path_moved(name, pattern, angle, shift, mirror):
    field, a = unmoved(name, pattern)
    other, place = moved(field, angle, shift, mirror)
    b = cover(CoverageRequest(other, MOTION, pattern)).path(0.0)
    assert b.length_m == pytest.approx(a.length_m, abs=1e-3)
    ends = [place(leg.piece.end[:2]) for leg in a.legs]
    found = [leg.piece.end[:2] for leg in b.legs]
    backward = [place(leg.piece.start[:2]) for leg in reversed(a.legs)]
    assert np.allclose(found, ends, atol=1e-3) or np.allclose(found, backward, atol=1e-3)


@pytest.mark.slow
def test_wide_turns_and_close_lines_are_left_to_the_zamboni_like_motion():
    """Lines much closer than a turn is wide: skipping lines costs as much as the laps do, and laps can vary."""
    field = Field(((0.0, 0.0), (1200.0, 0.0), (1200.0, 3000.0), (0.0, 3000.0)))
    solution = cover(CoverageRequest(field, MotionLimits(20.0, 75.0, 75.0, 19.0)))
    assert solution.pattern == ZAMBONI


def test_a_heading_given_is_kept():
    for pattern in (ZAMBONI, DUBINS):
        solution = cover(CoverageRequest(FIELDS["rectangle"], MOTION, pattern, heading_rad=1.0))
        for leg in solution.path(0.0).legs:
            if leg.sensing:
                assert abs(math.remainder(leg.piece.start[2] - 1.0, math.pi)) < 1e-9


def test_the_path_starts_at_the_start_point_and_ends_at_home():
    start, home = (-250.0, -90.0), (700.0, 20.0)
    for pattern in (ZAMBONI, DUBINS):
        solution = cover(CoverageRequest(FIELDS["trapezoid"], MOTION, pattern, 0.3, start_m=start, home_m=home))
        legs = solution.path(0.0).legs
        assert legs[0].piece.start[:2] == pytest.approx(start)
        assert legs[-1].piece.end[:2] == pytest.approx(home)
        whole(legs)
        plan = build_plan(solution)
        assert default_start(plan, [0.0] * plan.path_count)[0] == pytest.approx(start, abs=1e-6)


def test_wind_changes_the_time_as_each_leg_is_flown():
    motion = MotionLimits(30.0, 30.0, 45.0, 15.0, 15.0, (6.0, 0.0))
    for pattern in (ZAMBONI, DUBINS):
        solution = cover(CoverageRequest(FIELDS["L"], motion, pattern, heading_rad=0.3))
        lowest = solution.min_c1
        legs = solution.path(lowest).legs
        # straight legs by hand: the ground speed along a course χ is w·χ + √(v² − (w × χ)²)
        by_hand = rest = 0.0
        for leg in legs:
            if leg.piece.turn:
                rest += motion.time_s([leg.piece])
                continue
            course = leg.piece.start[2]
            along, across = 6 * math.cos(course), 6 * math.sin(course)
            by_hand += leg.piece.length_m / (along + math.sqrt(15**2 - across**2))
        assert solution.time_s == pytest.approx(by_hand + rest, rel=1e-9)


def test_a_wind_as_fast_as_the_aircraft_and_more_lines_than_the_limit_are_refused():
    with pytest.raises(Infeasible, match="wind"):
        cover(CoverageRequest(HOLE, MotionLimits(30, 30, 45, 15.0, 15.0, (15.0, 0.0))))
    large = Field(((0.0, 0.0), (9000.0, 0.0), (9000.0, 9000.0), (0.0, 9000.0)))
    with pytest.raises(Infeasible, match="lines"):
        cover(CoverageRequest(large, MotionLimits(2, 30, 45, 1.5), DUBINS))


def flown_share(field, solution, path, wind_deg, c1):
    """Whether the simulated aircraft completes, and the share of the field beside the lines that it really flew.

    It banks at once, as the coverage paths assume; the physical one rolls into it in 0.3 s.
    """
    path.write_text(plan_text(build_plan(solution)))
    keys = {"vehicle.airframe.model": "paper", "planner.name": "static", "battery.capacity_ah": 20, "step_s": 0.05}
    keys |= {"wind.speed_mps": 5, "wind.towards_deg": wind_deg} | ({"parameters": {"c1": c1}} if c1 < 0 else {})
    inputs = load_flight(str(path), overrides=keys)
    outcome, rest = Outcome(), shapely.Polygon(field.outline, field.holes)
    kinds = {stage.index: stage.kind for stage in inputs.mission.plan.stages}
    runs = itertools.groupby(fly(inputs.world, inputs.flight(), outcome), key=lambda step: step.stage)
    for stage, steps in runs:
        points = [(step.x_m, step.y_m) for step in steps]
        if kinds[stage] == "line" and len(points) > 1:
            rest = rest.difference(shapely.LineString(points).buffer(MOTION.swath_m / 2, cap_style="flat"))
    return outcome.completed, 1 - rest.area / field.area_m2


@pytest.mark.quick(2)
@pytest.mark.parametrize("c1_at", ["highest", "lowest"])
@pytest.mark.parametrize("pattern", [ZAMBONI, DUBINS])
def test_what_the_aircraft_flies_covers_the_field(pattern, c1_at, tmp_path):
    field = FIELDS["trapezoid"]
    solution = cover(CoverageRequest(field, MOTION, pattern, heading_rad=0.3))
    c1 = 0.0 if c1_at == "highest" else solution.min_c1
    completed, share = flown_share(field, solution, tmp_path / "field.plan", 110, c1)
    assert completed
    assert share >= 0.99

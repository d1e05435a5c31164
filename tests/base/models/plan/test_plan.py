"""Boxes, stages and plans: what they answer about parameters; stages by sympy; the nominal flight by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
import sympy
from common.plans import APPENDIX_RIGHT, PARTS, SHORT, WAVES, plan_of
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.expressions.reader import read_expression, read_expressions
from eadp.errors import EadpError, PathUndefined
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import COMPUTATION, PATH, Box, Parameter, Stage
from eadp.models.plan.trace import default_start, nominal_legs, trace, varied_legs

number = st.floats(-1e6, 1e6)
boxes = st.tuples(number, number).map(lambda pair: Box(*sorted(pair)))


def point(text):
    first, second = read_expressions(text, count=2)
    return first, second


def stage(index=1, path="x - c1", trigger="c1, 0", sets=(), rotation=90):
    return Stage(index, 2 * index, 0.1, rotation, read_expression(path), point(trigger), tuple(sets))


def plan(*stages, path_count=1, **more):
    return Plan("p", stages or (stage(),), path_count, **more)


# --- boxes ------------------------------------------------------------------------------------------------------------


@given(boxes, number)
def test_clipping_gives_the_nearest_value_of_the_box(box, value):
    clipped = box.clip(value)
    assert box.lo <= clipped <= box.hi
    assert all(abs(clipped - value) <= abs(other - value) for other in (box.lo, box.hi, (box.lo + box.hi) / 2))
    assert box.clip(clipped) == clipped


@given(boxes, st.floats(0, 1))
def test_share_is_where_a_value_lies_between_the_bounds(box, part):
    if box.fixed:
        assert box.share(box.lo) is None
        return
    share = box.share(box.lo + part * (box.hi - box.lo))
    assert 0 <= share <= 1
    if box.hi - box.lo > 1e-3:
        assert share == pytest.approx(part, abs=1e-6)
    assert (box.share(box.lo), box.share(box.hi)) == (0, 1)
    assert (box.share(box.lo - 5), box.share(box.hi + 5)) == (0, 1), "a value is clipped first"


# --- stages -----------------------------------------------------------------------------------------------------------


def test_what_has_no_value_names_its_stage():
    bad = stage(3, path="x - sqrt(4900 + c1)", trigger="0, log(c1)")
    with pytest.raises(PathUndefined, match=r"^the path of stage 3 x - sqrt\(4900 \+ c1\) has no finite"):
        bad.path_at((-5000.0,))
    with pytest.raises(PathUndefined, match=r"^the trigger of stage 3: log\(c1\) has no finite"):
        bad.trigger_at((-1.0,))
    with pytest.raises(PathUndefined, match=r"^the trigger of stage 3: c1 has no value"):
        bad.trigger_at(())


# --- plans ------------------------------------------------------------------------------------------------------------


def test_parameters_are_the_paths_and_then_the_computations():
    sets = (Box(-1000, 0), Box(2, 10), Box(32, 448))
    made = plan(stage(sets=sets), computations=(("fps", "1/s"), ("keysize", "bit")))
    assert made.parameters == (
        Parameter("c1", PATH),
        Parameter("c2", COMPUTATION, "fps", "1/s"),
        Parameter("c3", COMPUTATION, "keysize", "bit"),
    )
    assert made.names == ("c1", "c2", "c3")
    assert made.has_sets


def test_the_hull_leaves_out_where_a_computation_does_not_run():
    made = plan(stage(1, sets=(Box(0, 0), Box(0, 0))), stage(2, sets=(Box(5, 6), Box(4, 10))))
    assert made.hull(1) == Box(4, 10)
    assert made.hull(0) == Box(0, 6), "a path parameter fixed at 0 is a value like any other"
    assert plan(stage(1, sets=(Box(-1, 0), Box(0, 0)))).hull(1) == Box(0, 0)


def test_no_sets_no_hull():
    with pytest.raises(EadpError, match="no sets"):
        plan().hull(0)


@given(st.lists(boxes, min_size=1, max_size=5))
def test_the_hull_holds_every_box_and_no_more(sets):
    hull = plan(*(stage(i, sets=(box,)) for i, box in enumerate(sets, 1))).hull(0)
    assert all(hull.lo <= box.lo <= box.hi <= hull.hi for box in sets)
    assert hull.lo in [box.lo for box in sets]
    assert hull.hi in [box.hi for box in sets]


def test_bounds_for_a_plan_without_sets():
    bounds = {"c2": Box(2, 10), "c1": Box(-1000, 0)}
    made = plan(stage(1), stage(2)).with_bounds(bounds)
    assert [one.sets for one in made.stages] == [(Box(-1000, 0), Box(2, 10))] * 2
    assert [parameter.kind for parameter in made.parameters] == [PATH, COMPUTATION]
    assert replace(made, stages=tuple(replace(one, sets=()) for one in made.stages)) == plan(stage(1), stage(2))


def test_bounds_that_do_not_cover_every_parameter():
    with pytest.raises(EadpError, match="no bounds for c1"):
        plan().with_bounds({"c2": Box(2, 10)})
    with pytest.raises(EadpError, match="no bounds for c1, c2"):
        plan(path_count=2).with_bounds({})


def test_the_final_point_is_the_last_trigger_unless_stated():
    made = plan(stage(1, trigger="1, 2"), stage(2, trigger="3, 4"))
    assert [part.value({}) for part in made.final_point] == [3, 4]
    assert [part.value({}) for part in replace(made, final=point("175, 161")).final_point] == [175, 161]


ROUNDING = 1e-9


def values_at(stage, expressions, place):
    """Floats of sympy expressions at values of their symbols, by 30 digits of exact ones."""
    exact = {sympy.Symbol(name, real=True): sympy.Rational(value) for name, value in place.items()}
    return [float(expression.xreplace(exact).evalf(30)) for expression in expressions]


def check_against_derivatives(plan, seed):
    rng = np.random.default_rng(seed)
    for stage in plan.stages[:12]:
        symbolic = stage.sympy
        assert symbolic.hessian == symbolic.hessian.T
        for _ in range(3):
            c = rng.uniform(-900, 0, len(plan.names)).tolist()
            x, y = rng.uniform(-200, 200, 2).tolist()
            place = {"x": x, "y": y, **dict(zip(plan.names, c, strict=True))}
            if stage.segment:
                place |= stage.segment.values(c, stage.segment.start(c))
            (xx, xy), (_, yy) = symbolic.hessian.tolist()
            got = values_at(stage, (symbolic.path, *symbolic.gradient, xx, xy, yy), place)
            # φ is a difference of squares of hundreds of metres
            assert got == pytest.approx(stage.path_at(c)(x, y), rel=ROUNDING, abs=1e-7)
            assert values_at(stage, symbolic.trigger, place) == pytest.approx(stage.trigger_at(c), rel=ROUNDING)


def test_the_shipped_plans(root):
    files = sorted((root / "plans").glob("*.plan"))
    assert files
    for seed, file in enumerate(files):
        check_against_derivatives(read_plan(read_text(str(file)))[0], seed)


@pytest.mark.parametrize("text", [APPENDIX_RIGHT, PARTS, WAVES])
def test_plans_of_every_form(text):
    check_against_derivatives(read_plan(Text("p", text))[0], 7)


@pytest.mark.parametrize("path", ["*".join(f"(x-{i})" for i in range(1000)), "x + " + "(" * 9 + "0.5" + ")^64" * 9])
def test_what_would_keep_sympy_busy_for_hours_is_refused(path):
    stage = read_plan(Text("p", f"0.1; 90; {path}\n0, 200\n"))[0].stages[0]
    with pytest.raises(EadpError, match="too large for sympy"):
        _ = stage.sympy


ON_CIRCLE = SHORT.replace("%: computations fps\n", "").replace("[2, 10]\n", "")


@pytest.mark.slow
def test_a_plan_that_never_reaches_its_final_point_says_so():
    away = ON_CIRCLE.replace("180, 146", "-500, 146").replace("150 - 2*sqrt(4900 + c1)", "10")
    assert nominal_legs(plan_of(away), (0.0,))[-1].lap == 0, "beyond along the shift at once"
    with pytest.raises(PathUndefined, match="does not reach its final point"):
        nominal_legs(plan_of(ON_CIRCLE.replace("180, 146", "180, 300")), (0.0,))


def test_a_trace_without_end_is_refused():
    with pytest.raises(PathUndefined, match="5000000 points"):
        trace(plan_of(ON_CIRCLE), (0.0,), 1e-6)


def test_each_lap_alone_at_other_values_lies_where_the_laps_before_it_lead():
    """Lap k of ON_CIRCLE at c after k − 1 laps at 0: shifted k − 1 times by 10 m, and once by 150 − 2 √(4900 + c)."""
    laps = varied_legs(plan_of(ON_CIRCLE), (0.0,), (-900.0,))
    nominal = nominal_legs(plan_of(ON_CIRCLE), (0.0,))
    assert [len(lap) for lap in laps] == [sum(leg.lap == k for leg in nominal) for k in range(nominal[-1].lap + 1)]
    radius, shift = math.sqrt(4000), 150 - 2 * math.sqrt(4000)
    for k, lap in enumerate(laps):
        left = -115 + (10 * (k - 1) + shift if k else 0)
        assert lap[0].end_m == pytest.approx((left, 146))
        for point in lap[0].track.points((lap[0].start_m[0] - lap[0].offset_m[0], lap[0].start_m[1]), 50.0, 0.5, 5):
            x, y = point[0] + lap[0].offset_m[0], point[1]
            assert math.hypot(x - left - radius, y - 146) == pytest.approx(radius)
        for leg, (x, y) in zip(lap[1:], [(left, 0), (left + 150, 0), (left + 150, 146)], strict=False):
            assert leg.end_m == pytest.approx((x, y))
    assert laps[0][0].start_m == pytest.approx(default_start(plan_of(ON_CIRCLE), (-900.0,))[0])
    same = varied_legs(plan_of(ON_CIRCLE), (0.0,), (0.0,))
    ends = [leg.end_m for lap in same for leg in lap]
    assert ends == [pytest.approx(leg.end_m) for leg in nominal], "at the same values it is the nominal flight"

"""Boxes, stages and plans: what they answer about parameters."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.expressions.reader import read_expression, read_expressions
from eadp.errors import EadpError, PathUndefined
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import COMPUTATION, PATH, Box, Parameter, Stage

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
    assert [part.at() for part in made.final_point] == [3, 4]
    assert [part.at() for part in replace(made, final=point("175, 161")).final_point] == [175, 161]

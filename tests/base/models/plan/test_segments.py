"""Plans of parts: read, walked, flown; variables that change from lap to lap; what cannot be read."""

import math

import pytest
from common.plans import PARTS, plan_of

from eadp.errors import InputError, PathUndefined
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.trace import nominal_legs


def stages(cursor):
    """Each stage's index with the loop variables of its segment, to the end."""
    found = []
    while cursor is not None:
        found.append((cursor.stage.index, *cursor.state))
        cursor = cursor.next()
    return found


def step(c1):
    return 24 + 2 * (45 - math.sqrt(2025 + c1))


@pytest.mark.parametrize("c1", [0.0, -400.0, -900.0])
def test_laps_follow_one_another_until_the_condition_holds(c1):
    expected, s = [(1,)], 0.0
    while s < 90:
        expected += [(index, pytest.approx(s)) for index in (2, 3, 4, 5)]
        s = min(s + step(c1), 90)
    assert stages(PlanCursor.start(plan_of(PARTS), [c1, 10])) == [*expected, (6,)]


def test_a_change_waits_for_the_stage_before_the_laps_bend():
    cursor = PlanCursor.start(plan_of(PARTS), [0.0, 10.0]).next()
    assert cursor.stage.index == 2
    cursor = cursor.decide((-900.0, 4.0))
    assert cursor.parameters == (0.0, 4.0)  # the computation at once, the path not yet
    cursor = cursor.next()
    assert cursor.parameters == (0.0, 0.0)  # inhibited on the turn
    cursor = cursor.next()
    assert cursor.parameters == (-900.0, 4.0)  # stage 4 comes before the circle that c1 bends
    assert cursor.next().next().state == pytest.approx((step(-900),))


def test_the_quality_counts_a_path_parameter_where_laps_depend_on_it():
    """c1 is named by a formula of the laps alone; the computation counts wherever it has a choice."""
    free = [[not box.fixed for box in sets] for sets in plan_of(PARTS).quality_sets]
    sets = [stage.sets[1] for stage in plan_of(PARTS).stages]
    assert [c1 for c1, _ in free] == [False, True, True, True, True, False]
    assert [c2 for _, c2 in free] == [not box.fixed for box in sets]


def test_laps_that_are_over_before_they_begin_are_passed_over():
    text = (
        PARTS.replace("s = 0, next - s", "s = 90, next - s")
        .replace("x - 10\n", "x - 100\n")
        .replace("10, 100", "100, 100")
    )
    assert [index for index, *_ in stages(PlanCursor.start(plan_of(text), [0.0, 10.0]))] == [1, 6]


def test_laps_without_end_are_refused():
    text = PARTS.replace("next - s", "0")
    with pytest.raises(PathUndefined, match="10000 laps"):
        nominal_legs(plan_of(text), [0.0, 10.0])


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("s >= 90", "s >= 90 + x", 31, "a value that depends on x"),
        ("next = min", "next = next + min", 10, "next is computed from itself"),
        ("top = 500 + 0.2*s", "top = r2", 11, "top is computed from r2, which stands below it"),
        ("s = 0, next", "s = top, next", 9, "the first value of s names top"),
        ("top = 500 + 0.2*s", "top = 500 + y", 11, "a coordinate that depends on y"),
        ("top = 500 + 0.2*s", "top = 500, 1, 2", 11, "3 values"),
        ("n = 4", "n = 3", 8, "n = 3 where 4 stages follow"),
        ("0.1; 90; x - (10 + s)", "0.1; 90; x - (10 + t)", 14, "unknown name t"),
        ("r2 = (2", "r2 = (c3 + 2", 12, "the coordinate r2 names c3"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(old, new, line, message):
    assert old in PARTS
    with pytest.raises(InputError) as caught:
        plan_of(PARTS.replace(old, new, 1))
    fault = caught.value.faults[0]
    assert (fault.line, message in fault.message) == (line, True), fault


def test_laps_before_another_part_end_on_a_condition():
    laps = "init:\na = 0, 10\npath:\n0.1; 90; x - a\na, 50\ntrig:\n90, 50\n"
    with pytest.raises(InputError, match="laps that do not end on a condition"):
        plan_of(laps + "path:\n0.1; 90; x - 100\n100, 500\n")

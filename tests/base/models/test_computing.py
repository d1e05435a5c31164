"""Plans and profiles brought together."""

import numpy as np
import pytest

from eadp.errors import EadpError
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text
from eadp.models.computing import join_profile
from eadp.models.plan.stage import Box
from eadp.models.profile import Profile

GRID = Profile(
    ("keysize", "fps"), ("bit", ""), np.array([[32, 2], [32, 10], [448, 2], [448, 10]]), np.array([1.0, 5.0, 2.0, 8.0])
)
ONE = Profile(("fps",), ("1/s",), np.array([[2.0], [10.0]]), np.array([4.0, 8.0]))


def plan(header, sets="[2, 10]\n[32, 448]\n", second=None):
    text = f"{header}0.1; 90; x\n0, 400\n{sets}"
    if second is not None:
        text += f"0.1; 90; x\n0, 800\n{second}"
    return read_plan(Text("p", text))[0]


def test_columns_are_found_by_name():
    computing = join_profile(plan("%: computations fps, keysize\n"), GRID)
    sets = (Box(2, 10), Box(32, 448))
    assert computing.power_w((10, 32), sets) == 5.0
    assert computing.power_w((2, 448), sets) == 2.0
    assert computing.levels(0, Box(2, 5)) == (2, 3, 4, 5)


def test_inhibited_computations_cost_nothing_and_are_not_looked_up():
    computing = join_profile(plan("", "[2, 10]\n", "[0, 0]\n"), ONE)
    assert computing.power_w((0,), (Box(0, 0),)) == 0.0
    assert computing.power_w((6,), (Box(2, 10),)) == 6.0


@pytest.mark.parametrize(
    ("made", "profile", "word"),
    [
        (plan("%: computations fps, keylength\n"), GRID, "keylength"),
        (plan("%: computations fps [Hz]\n", "[2, 10]\n"), ONE, "Hz"),
        (plan("", "[2, 10]\n"), GRID, "measures 2"),
        (plan("", "[1, 10]\n"), ONE, "stage 1"),
        (plan("", "[2, 10]\n", "[2, 11]\n"), ONE, "stage 2"),
        (plan("", "[2, 10]\n"), None, "no profile"),
        (plan("", second="[0, 0]\n[32, 448]\n"), None, "no profile"),
    ],
)
def test_disagreements_are_refused(made, profile, word):
    with pytest.raises(EadpError, match=word):
        join_profile(made, profile)


def test_a_plan_without_computations_needs_no_profile():
    assert join_profile(plan("", ""), None).power_w((), ()) == 0.0
    assert join_profile(plan("", "[0, 0]\n"), None).power_w((0,), (Box(0, 0),)) == 0.0


def test_a_configuration_measured_together_still_needs_its_zero():
    with pytest.raises(EadpError, match="stage 2: keysize=0"):
        join_profile(plan("%: computations fps, keysize\n", "[2, 10]\n[32, 448]\n", "[2, 10]\n[0, 0]\n"), GRID)


def test_the_least_power():
    made = plan("", "[2, 10]\n", "[4, 6]\n")
    assert join_profile(made, ONE).min_power_w(made) == 4.0
    off = plan("", "[0, 0]\n", "[4, 6]\n")
    assert join_profile(off, ONE).min_power_w(off) == 5.0, "not the stage on which it may not run"
    none = plan("", "[0, 0]\n")
    assert join_profile(none, None).min_power_w(none) == 0.0


@pytest.mark.parametrize("sets", ["", "[0, 0]\n[0, 0]\n"])
def test_beside_a_plan_without_computations_a_profile_is_a_constant_load(sets):
    still = plan("", sets)
    boxes = still.stages[0].sets
    values = tuple(box.lo for box in boxes)
    assert join_profile(still, GRID).power_w(values, boxes) == 8.0

"""Planner `paper`: faults of its settings, the share that the time allows, and where a sum crosses a value."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from common import ROOT, few

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.profile import Profile
from eadp.models.vehicle import PowerCurve
from eadp.models.world import Mission
from eadp.papers.estimator import EstimatorSettings
from eadp.papers.planner import VOLTAGE_STEP_V, PaperPlanner, PaperSettings, _crossing_s, _lasting_s, battery_near
from eadp.planning.base import PlannerSettings, TradeOff

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
PROFILE = Profile(("fps",), ("",), np.array([[2.0], [10.0]]), np.array([4.0, 12.0]))
VEHICLE = PowerCurve(cruise_altitude_m=0.0)
MISSION = Mission(PLAN, join_profile(PLAN, PROFILE), Battery(), VEHICLE, (0.0, 10.0), (-100.0, 220.0))


def settings(order=3, **own):
    shared = PlannerSettings(every_s=0.5)
    # the registry gives settings classes that hold each planner's section
    estimator = EstimatorSettings(order=order)
    return type("Settings", (), {"own": PaperSettings(**own), "every_s": shared.every_s, "estimator": estimator})()


def faults(order=3, **own):
    return PaperPlanner.faults(settings(order, **own), MISSION)


def test_horizons_of_more_than_400_steps_are_a_fault():
    assert faults(horizon_s=200.0) == []
    assert faults(horizon_s="period") == []
    ((key, message, expected),) = faults(horizon_s=200.5)
    assert key == "horizon_s"
    assert message == "more than 400 steps of 0.5 s in 200.5 s"
    assert expected.startswith("at most 200 s")


def test_weights_have_the_size_of_what_they_weigh():
    """Q is over the 2r + 1 coefficients, R over the parameters c1 and c2."""
    identity = lambda n: tuple(map(tuple, np.eye(n).tolist()))  # noqa: E731
    assert faults(order=1, cost_weights=(identity(3), identity(2))) == []
    assert faults(order=2, cost_weights=(identity(5), 2)) == []
    found = faults(order=2, cost_weights=(identity(3), identity(3)))
    assert [key for key, _, _ in found] == ["cost_weights.0", "cost_weights.1"]
    assert [message for _, message, _ in found] == ["Q is no 5 × 5 matrix", "R is no 2 × 2 matrix"]


def test_trade_offs_out_of_reach_are_a_fault():
    # c1 ≤ 0, c2 ≤ 10: c1 − 2 c2 is at most −4, at c2 = 2
    rows = [TradeOff({"c1": 1.0, "c2": -2.0}, at_least) for at_least in (-4.0, -3.9)]
    ((key, message, _),) = faults(trade_offs=tuple(rows))
    assert key == "trade_offs.1.at_least"
    assert "R c is at most -4, and r is -3.9" in message


@pytest.mark.parametrize(
    ("rule", "times_s", "time_s", "last_s", "share"),
    [
        # corrected: t̲ + share (t̄ − t̲) − t = t_b
        ("corrected", (200.0, 600.0), 100.0, 300.0, 0.5),
        ("corrected", (200.0, 600.0), 100.0, 1.0, 0.0),
        ("corrected", (200.0, 600.0), 100.0, 900.0, 1.0),
        ("corrected", (600.0, 200.0), 100.0, 300.0, 0.5),
        # published: (t̲ + share (t̄ − t̲)) (t̄ − t)/t̄ = t_b
        ("published", (200.0, 600.0), 150.0, 300.0, 0.5),
        ("published", (200.0, 600.0), 150.0, 225.0, 0.25),
        ("published", (600.0, 200.0), 150.0, 225.0, 0.75),
        ("published", (200.0, 600.0), 600.0, 1.0, 1.0),
        ("published", (600.0, 200.0), 600.0, 1.0, 0.0),
        ("corrected", (200.0, 600.0), 100.0, math.inf, 1.0),
        ("corrected", (300.0, 300.0), 100.0, 1.0, 1.0),
    ],
)
def test_the_largest_share_that_the_time_allows(rule, times_s, time_s, last_s, share):
    own = PaperSettings(remaining_time=rule, shortest_s=times_s[0], longest_s=times_s[1])
    pilot = PaperPlanner(PlannerSettings(), MISSION, own)
    assert pilot._largest_share(time_s, last_s, pilot._coverage) == pytest.approx(share)


@pytest.mark.parametrize(("spare", "time_s"), [(0.5, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (5.5, 5.25), (9.0, 6.0)])
def test_where_a_sum_crosses_a_value(spare, time_s):
    """After 2, 4 and 6 s the sum is 1, 3 and 7: linear between, and held after."""
    assert _crossing_s(np.array([1.0, 3.0, 7.0]), spare, 2.0) == pytest.approx(time_s)


@pytest.mark.parametrize("seed", few(range(8), 4))
def test_how_long_a_charge_lasts(seed):
    """Second by second: the head once, then its period again and again, each at the letter's current."""
    rng = np.random.default_rng(seed)
    battery = Battery(14.8, 0.05, 10 ** rng.uniform(-1, 0.5))
    power_w, head, spare = rng.uniform(5.0, 60.0, 40), int(rng.integers(1, 30)), rng.uniform(0.01, 0.3)
    drained, seconds = 0.0, 0
    while drained < spare:
        at = seconds if seconds < head else head + (seconds - head) % (len(power_w) - head)
        step = battery.drain_per_s(power_w[at], battery.voltage_v)
        drained, seconds = drained + step, seconds + 1
    expected = seconds - (drained - spare) / step
    assert _lasting_s(power_w, head, 1.0, spare, battery) == pytest.approx(expected, rel=1e-9)
    power_w[int(rng.integers(len(power_w)))] = 1100.0
    assert _lasting_s(power_w, head, 1.0, spare, battery) == 0.0, "V²/(4R) is 1095 W"


def test_stages_with_other_fixed_computations_have_powers_of_their_own():
    """Equal sets of the free computation, and the fixed one at 1 and at 5: 4 W to 12 W, and 14 W to 22 W."""
    text = "0.1; 90; x - 100\n100, 100\n[2, 10]\n[{}, {}]\n0.1; 270; -y + 100\n0, 100\n[2, 10]\n[5, 5]\n"
    grid = np.array([[2.0, 1.0], [10.0, 1.0], [2.0, 5.0], [10.0, 5.0]])
    profile = Profile(("a", "b"), ("", ""), grid, np.array([4.0, 12.0, 14.0, 22.0]))
    for fixed, lowest_w in ((1, 4.0), (5, 14.0)):
        plan, _ = read_plan(Text("two", text.format(fixed, fixed)))
        mission = Mission(plan, join_profile(plan, profile), Battery(), VEHICLE, (10.0, float(fixed)), (100.0, 0.0))
        pilot = PaperPlanner(PlannerSettings(), mission)
        stages = [SimpleNamespace(stage=k, parameters=mission.parameters, soc=0.8) for k in (1, 2)]
        first, second = (pilot._horizon(o, ()) for o in stages)
        assert [first.powers_w[0], first.powers_w[-1]] == pytest.approx([lowest_w, lowest_w + 8.0])
        assert [second.powers_w[0], second.powers_w[-1]] == pytest.approx([14.0, 22.0])
        assert (first is second) == (fixed == 5)


@pytest.mark.parametrize("soc", [0.0, 0.31, 0.5, 0.999, 1.0])
def test_near_a_charge_the_battery_has_one_voltage_a_little_below(soc):
    battery = Battery(voltage_v=16.8, voltage_empty_v=13.2)
    near = battery_near(battery, soc)
    assert near.voltage_empty_v is None
    assert -1e-9 <= battery.voltage_at(soc) - near.voltage_v <= VOLTAGE_STEP_V + 1e-9
    assert battery_near(Battery(), soc) == Battery()
    cells = battery_near(Battery(cells=4), 0.5)
    assert (cells.cells, cells.voltage_empty_v) == (None, None)
    assert cells.voltage_v == pytest.approx(15.4)

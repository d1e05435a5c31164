"""Planners from their observations alone: what they decide, when, and what they fall back to."""

import itertools
import time
from dataclasses import replace

import numpy as np
import pytest
from broken_osqp import BROKEN, break_osqp
from common import ROOT
from common.observations import Piloted
from common.observations import observation as observed
from scipy.integrate import solve_ivp

from eadp.errors import Infeasible, SolverFailed
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.energy import EnergyModel, Harmonic
from eadp.models.profile import Profile
from eadp.models.vehicle import FixedWing, PowerCurve
from eadp.models.world import Mission
from eadp.papers.horizon import Horizon
from eadp.papers.planner import PaperSettings
from eadp.planning.base import PlannerSettings, TradeOff
from eadp.planning.registry import PLANNERS, make_flight, planner_class

PLAN, _ = read_plan(read_text(str(ROOT / "plans/survey.plan")))
PROFILE = Profile(("fps",), ("",), np.array([[2.0], [10.0]]), np.array([4.75376, 9.75462]))
VEHICLE, SLOW = PowerCurve(cruise_altitude_m=0.0), FixedWing(airspeed_mps=10.0)
BATTERY = Battery(14.8, 0.0012, 3.2, 0.00183, 1.0, 10.0)
SETTINGS = PlannerSettings(name="paper", reserve_soc=0.0)
OWN = PaperSettings(min_periods=0, longest_s=705.96, shortest_s=270.15, delta={"c1": 500})


def mission(plan=PLAN, profile=PROFILE, battery=BATTERY, parameters=(0.0, 10.0)):
    return Mission(plan, join_profile(plan, profile), battery, VEHICLE, parameters, (-100.0, 220.0))


def planner(own=OWN, settings=SETTINGS, **changes):
    own = own if settings.name == "paper" else None
    return Piloted(planner_class(settings.name)(settings, mission(**changes), own))


def observation(time_s, soc=1.0, power_w=36.0, parameters=(0.0, 10.0), started=1, plan=PLAN):
    return observed(plan, parameters, time_s, 0.0, 0.0, started=started, soc=soc, power_w=power_w)


def run(pilot, seconds, soc=lambda t: 1.0, step_s=0.1, start_s=0.1, power_w=36.0):
    """Observations at steady power; decisions with their times, where they change."""
    changes, last = [], None
    for k in range(round(seconds / step_s)):
        time_s = start_s + k * step_s
        seen = observation(time_s, soc(time_s), power_w, last or (0.0, 10.0))
        decision = pilot.take(seen)
        if decision.parameters != last:
            last = decision.parameters
            changes.append((round(time_s, 6), last))
    return changes


def steadily(pilot, readings, **keys):
    """The last decision on so many readings of one kind, ten a second."""
    for k in range(readings):
        decision = pilot.take(observation(0.1 * (k + 1), **keys))
    return decision


def test_a_planner_is_named_in_the_registry_alone():
    for name in PLANNERS:
        for path in sorted((ROOT / "eadp").rglob("*.py")):
            if name in path.parts or path.name in ("plug_ins.py", "registry.py", "vehicle.py", "aircraft.py"):
                continue
            assert f'"{name}"' not in path.read_text(encoding="utf-8"), path


def test_static_never_changes_and_forecasts():
    pilot = planner(settings=replace(SETTINGS, name="static"))
    assert run(pilot, 30, soc=lambda t: 1 - t / 40) == [(0.1, (0.0, 10.0))]
    pilot.take(observation(31.0))
    assert pilot.power.estimates([31.0])[0] == pytest.approx([36.0], abs=0.05)
    assert pilot.report.replans == 0


def test_it_replans_every_so_often_from_when_it_may_start():
    pilot = planner(replace(OWN, start_after_s=5.0), replace(SETTINGS, every_s=2.0))
    run(pilot, 20.05)
    report = pilot.report
    assert len(report.solve_ms) == 1 + len([6, 8, 10, 12, 14, 16, 18, 20])
    assert report.replans + report.skipped == len(report.solve_ms)
    assert report.skipped > 0, "with charge for everything, the last solution stays optimal"
    assert report.calls == report.solved == report.replans


@pytest.mark.parametrize("name", ["paper", "joint"])
def test_the_time_of_a_solution_is_that_between_two_readings_of_the_clock(monkeypatch, name):
    clock = itertools.count()
    pilot = planner(settings=replace(SETTINGS, name=name))
    monkeypatch.setattr(time, "perf_counter", lambda: 0.25 * next(clock))
    run(pilot, 10)
    assert pilot.report.solve_ms
    assert all(took_ms >= 250 and took_ms % 250 == 0 for took_ms in pilot.report.solve_ms)
    assert min(pilot.report.solve_ms) == 250


def test_it_waits_for_its_periods():
    pilot = planner(replace(OWN, min_periods=2))
    for lap in range(3):
        for stage in range(1, 5):
            pilot.take(observation(10.0 * (4 * lap + stage), started=4 * lap + stage))
        assert bool(pilot.report.solve_ms) == (lap == 2)


def test_a_jump_of_the_charge_is_answered_at_once():
    pilot = planner(settings=replace(SETTINGS, every_s=60.0))
    soc = lambda t: 1.0 if t < 30.05 else 0.60  # noqa: E731
    changes = run(pilot, 40, soc=soc)
    assert changes[-1][0] == pytest.approx(30.1)
    assert changes[-1][1][0] == -500.0
    assert len(pilot.report.solve_ms) == 2


def test_time_to_an_empty_battery_is_the_integral_of_the_model():
    """Against solve_ivp on ḃ = −k_b I(y)/Q_c with the power as told: the horizon's, then its last."""
    pilot = planner(settings=replace(SETTINGS, reserve_soc=0.1))
    run(pilot, 20)
    o = observation(20.0, soc=0.8)
    b = BATTERY

    def rate(_t, _b):
        current_a = (b.voltage_v - np.sqrt(b.voltage_v**2 - 4 * b.resistance_ohm * 36.0)) / (2 * b.resistance_ohm)
        return [-b.k_b_per_s * current_a / b.capacity_ah]

    def empty(_t, y):
        return y[0] - 0.1

    empty.terminal = True
    solved = solve_ivp(rate, (0, 5000), [0.8], events=empty, rtol=1e-10, atol=1e-12)
    assert pilot._time_to_reserve_s(o, 0.0) == pytest.approx(solved.t_events[0][0], rel=2e-3)
    assert pilot._time_to_reserve_s(o._replace(soc=0.1), 0.0) == 0.0


@pytest.mark.slow
def test_time_to_an_empty_battery_follows_a_periodic_power():
    """Readings of a level and a harmonic of the lap's period: the closed form against a plain sum of seconds."""
    pilot = planner()
    period = pilot.power.period_s
    power = lambda t: 30 + 4 * np.sin(2 * np.pi * t / period)  # noqa: E731
    for k in range(1, 2000):
        pilot.take(observation(0.1 * k, power_w=float(power(0.1 * k)) + 9.75462))
    o = observation(199.9, soc=0.7)
    t, soc = 199.9, 0.7
    while soc > 0:
        y = power(t + 0.005) + pilot._computing_plan_w[-1]
        soc -= BATTERY.drain_per_s(float(y), BATTERY.voltage_v) * 0.01
        t += 0.01
    assert pilot._time_to_reserve_s(o, 0.0) == pytest.approx(t - 199.9, rel=0.005)


@pytest.mark.parametrize(
    ("rule", "time_s", "c1", "expected"),
    [
        ("corrected", 100.0, 0.0, 705.96 - 100),
        ("published", 100.0, 0.0, 705.96 - 100),
        ("corrected", 100.0, -1000.0, 270.15 - 100),
        ("published", 100.0, -1000.0, 270.15 / 705.96 * (705.96 - 100)),
        ("corrected", 488.055, -500.0, 0.0),
        ("published", 488.055, -500.0, 488.055 / 705.96 * (705.96 - 488.055)),
    ],
)
def test_remaining_time(rule, time_s, c1, expected):
    pilot = planner(replace(OWN, remaining_time=rule))
    assert pilot._remaining_s((c1, 10.0), time_s, pilot._coverage) == pytest.approx(expected, abs=1e-9)


def test_the_path_is_lowered_by_delta_while_time_is_short_and_raised_while_there_is_some_to_spare():
    # 711 s of battery at 36.4 W; what is planned takes 705.96 s
    down = planner(replace(OWN, raise_path=False))
    changes = run(down, 6, soc=lambda t: 0.5)
    assert [values[0] for _, values in changes] == [-500.0, -1000.0]
    up = planner(replace(OWN, raise_path=True), parameters=(-1000.0, 10.0))
    assert [values[0] for _, values in run(up, 6)] == [-1000.0 + 500, 0.0]
    still = planner(replace(OWN, raise_path=False), parameters=(-1000.0, 10.0))
    assert [values[0] for _, values in run(still, 6)] == [-1000.0]


def test_the_largest_path_that_fits_just_fits():
    pilot = planner(replace(OWN, path_rule="largest"))
    steadily(pilot, 99, soc=0.8)
    o = observation(10.0, soc=0.8)
    decision = pilot.take(o)
    t_b = pilot._time_to_reserve_s(o, 0.0)
    assert -1000 < decision.parameters[0] < 0
    assert pilot._remaining_s(decision.parameters, 10.0, pilot._coverage) == pytest.approx(t_b, abs=0.01)


def test_the_output_constraint_limits_the_computations():
    battery = replace(BATTERY, letter_crate_per_h=1.0)
    pilot = planner(battery=battery)
    # b Q_c V = 0.76 · 47.36 = 36.0 W allows what is flown; 0.70 allows 33.2 W: a motion of 26.2 W leaves 6.9 W
    decision = steadily(pilot, 59, soc=0.70)
    motion = 36.0 - 9.75462
    g = PROFILE.power_w_at((decision.parameters[1],))
    nxt = PROFILE.power_w_at((decision.parameters[1] + 1,))
    assert motion + g <= 0.70 * 47.36 + 0.1
    assert motion + nxt > 0.70 * 47.36 - 0.3


def test_nothing_admissible_is_the_lowest_and_said():
    pilot = planner(battery=replace(BATTERY, letter_crate_per_h=1.0))
    decision = steadily(pilot, 29, soc=0.3)
    assert decision.parameters[1] == 2.0
    assert decision.reason.startswith("infeasible")
    report = pilot.report
    assert report.calls == report.failed == report.fallbacks == 0
    assert decision.record.status == "infeasible"


def test_a_failed_solve_is_counted_and_answered_by_the_stated_fallback(monkeypatch):
    break_osqp(monkeypatch, BROKEN["failing"])
    pilot = planner(replace(OWN, delta={"c1": 500, "c2": 3}), battery=replace(BATTERY, letter_crate_per_h=1.0))
    decision = steadily(pilot, 29, soc=0.70)
    report = pilot.report
    assert report.fallbacks == report.replans == len(report.solve_ms) > 0
    assert (report.failed, report.solved, report.retried) == (report.calls, 0, report.calls / 2)
    assert (decision.record.status, decision.record.gap) == ("fallback", None)
    assert decision.reason.startswith("fallback, lowered by δ: OSQP")
    assert decision.parameters[1] == 4.0, "10, then 7, then 4, which fits 6.9 W"
    assert pilot.take(observation(4.0, soc=1.0)).parameters[1] == 10.0, "from the maximum again"


def test_a_failed_solve_without_an_admissible_answer_falls_back_to_the_lowest(monkeypatch):
    monkeypatch.setattr(Horizon, "solve", lambda self, forecast: (_ for _ in ()).throw(SolverFailed("x")))
    monkeypatch.setattr(Horizon, "lowered", lambda *args: (_ for _ in ()).throw(Infeasible("y")))
    pilot = planner()
    decision = pilot.take(observation(0.1))
    assert decision.parameters[1] == 2.0
    assert decision.reason.startswith("fallback, minimum")


def by_subroutine(time_s, soc, motion_w, delta):
    """The drafts' subroutine by plain loops: c̄ ← c̄ − δ until the constraint holds for 6 s, and the time suffices."""
    b = BATTERY

    def rate_per_s(power_w):
        root = np.sqrt(b.voltage_v**2 - 4 * b.resistance_ohm * power_w)
        return b.k_b_per_s * (b.voltage_v - root) / (2 * b.resistance_ohm) / b.capacity_ah

    def power_w(fps):
        return motion_w + np.interp(fps, [2.0, 10.0], [4.75376, 9.75462])

    def keeps(fps):
        left = [soc - k * rate_per_s(power_w(fps)) for k in range(1, 7)]
        return all(power_w(fps) <= each * b.capacity_ah * b.voltage_v for each in left)

    c1, fps = 0.0, 10.0
    while not keeps(fps) and fps > 2.0:
        fps = max(fps - delta["c2"], 2.0)
    while 705.96 + c1 / 1000 * (705.96 - 270.15) - time_s > soc / rate_per_s(power_w(fps)) and c1 > -1000.0:
        c1 = max(c1 - delta["c1"], -1000.0)
    return c1, fps


@pytest.mark.parametrize("delta", [{"c1": 500.0, "c2": 2.0}, {"c1": 130.0, "c2": 3.0}])
def test_the_subroutine_is_that_of_the_drafts(delta):
    found = set()
    for soc in np.linspace(0.2, 1.0, 30):
        own = replace(OWN, solver="subroutine", path_rule="delta", delta=delta)
        pilot = planner(own, battery=replace(BATTERY, letter_crate_per_h=1.0))
        decision = steadily(pilot, 30, soc=soc)
        expected = by_subroutine(3.0, soc, 36.0 - 9.75462, delta)
        assert decision.parameters == pytest.approx(expected)
        assert decision.record.status == ("infeasible" if decision.reason.startswith("infeasible") else "lowered")
        found.add(expected)
        assert pilot.report.calls == pilot.report.fallbacks == 0
    assert len(found) > 4


def test_inhibited_computations_are_not_solved_for():
    text = "0.1; 90; x\n0, 400\n[0, 0]\n0.1; 90; x\n0, 800\n[2, 10]\n"
    plan, _ = read_plan(Text("p", text))
    pilot = planner(replace(OWN, longest_s=None, shortest_s=None), plan=plan, parameters=(10.0,))
    decision = steadily(pilot, 29, parameters=(0.0,), power_w=26.0, plan=plan)
    assert pilot.report.calls == 0
    assert pilot.report.solve_ms
    assert decision.record.status == "nothing to choose"
    assert decision.parameters == (10.0,), "what was decided waits for the stage that runs it"
    for k in range(30, 60):
        decision = pilot.take(observation(0.1 * k, parameters=(10.0,), started=2, plan=plan))
    assert pilot.report.calls > 0


def test_levels_of_the_settings_are_kept_to():
    pilot = planner(settings=replace(SETTINGS, levels={"c2": (2.0, 5.0)}))
    assert run(pilot, 3)[-1][1][1] == 5.0


@pytest.mark.parametrize("cost", ["control", "power", "quadratic", "output"])
@pytest.mark.parametrize("horizon_s", [6.0, "period"])
def test_every_cost_and_horizon_takes_what_is_free(cost, horizon_s):
    pilot = planner(replace(OWN, cost=cost, horizon_s=horizon_s))
    assert run(pilot, 3)[-1][1][1] == 10.0
    assert pilot.report.failed == 0


def test_trade_offs_are_kept_with_the_path_in_force_and_the_one_decided():
    """Lowering c1 takes c2 down at once: the row holds at the old path and at the new one."""
    row = TradeOff({"c1": 1 / 200, "c2": -1.0}, -10.0)
    pilot = planner(replace(OWN, trade_offs=(row,)))
    decisions = []
    for k in range(1, 40):
        now = decisions[-1].parameters if decisions else (0.0, 10.0)
        decisions.append(pilot.take(observation(0.1 * k, soc=0.5, parameters=(0.0, now[1]))))
    assert decisions[-1].parameters[0] == -1000.0
    for decision in decisions[2:]:
        for c1 in (0.0, decision.parameters[0]):
            assert c1 / 200 - decision.parameters[1] >= -10.0 - 1e-9


def test_a_path_that_no_computations_allow_is_not_taken():
    """c1 ≥ −300 whatever the computations: the rule's step of 500 is cut short."""
    row = TradeOff({"c1": 1.0}, -300.0)
    pilot = planner(replace(OWN, trade_offs=(row,)))
    changes = run(pilot, 6, soc=lambda t: 0.4)
    assert min(values[0] for _, values in changes) == pytest.approx(-300.0, abs=60.0)
    assert all(values[0] >= -300.0 for _, values in changes)


def test_a_whole_step_under_trade_offs_ends_at_the_end_of_the_set():
    """In floats -0.3 + (0.1 - -0.3) is more than 0.1, out of the set."""
    plan, _ = read_plan(Text("p", "0.1; 90; x - 200*c1\n0, 400\n[-0.3, 0.1]\n[2, 10]\n"))
    row = TradeOff({"c1": 1.0}, -1.0)
    own = replace(OWN, longest_s=270.15, shortest_s=705.96, delta={"c1": 5}, trade_offs=(row,))
    pilot = planner(own, plan=plan, parameters=(-0.3, 10.0))
    assert steadily(pilot, 29, soc=0.4, parameters=(-0.3, 10.0), plan=plan).parameters[0] == 0.1


def test_the_subroutine_lowers_from_the_maximum_until_the_time_suffices():
    own = replace(OWN, path_rule="subroutine", delta={"c1": 100})
    pilot = planner(own, parameters=(-1000.0, 10.0))
    chosen = steadily(pilot, 99, soc=0.8, parameters=(-1000.0, 10.0)).parameters
    lasts_s = pilot._time_to_reserve_s(observation(10.0, soc=0.8), 0.0)
    ladder = [-100.0 * k for k in range(11)]
    enough = [c1 for c1 in ladder if pilot._remaining_s((c1, 10.0), 10.0, pilot._coverage) <= lasts_s]
    assert 0 > chosen[0] == max(enough) > -1000


def test_gains_step_the_level_when_the_path_changes():
    """002's Ω: 0.002 W per m² of c1, so −500 takes 1 W off the motion's level, once."""
    pilot = planner(replace(OWN, gains={"c1": 0.002}), settings=replace(SETTINGS, every_s=60.0))
    steadily(pilot, 199)
    before = pilot.power.estimator.state_w[0]
    for k in (200, 201):
        pilot.take(observation(0.1 * k, power_w=None, parameters=(-500.0, 10.0)))
        assert pilot.power.estimator.state_w[0] == pytest.approx(before - 1.0, abs=0.01)
    longer = pilot._time_to_reserve_s(observation(20.2), pilot._gained_w((-1000.0,)))
    assert longer > pilot._time_to_reserve_s(observation(20.2), pilot._gained_w((-500.0,)))


def test_coverage_times_without_being_told_are_those_of_the_nominal_flight():
    from eadp.models.plan.trace import nominal_legs

    pilot = planner(replace(OWN, longest_s=None, shortest_s=None))
    lengths = [sum(leg.distance_m for leg in nominal_legs(PLAN, (c1, 10.0), (-100.0, 220.0))) for c1 in (-1000.0, 0.0)]
    coverage = pilot._coverage
    assert (coverage.at_lowest_s, coverage.at_highest_s) == pytest.approx([length / 15 for length in lengths])
    # flown, triggers fire 20 m early and cut the corners: 717 s at the highest, 5 % less
    assert coverage.at_highest_s == pytest.approx(717.35 * 1.06, rel=0.02)


def test_a_fit_is_what_the_estimator_starts_from():
    fitted = EnergyModel(46.0, 31.0, (Harmonic(2.0, 0.3),), 0.5, 0.1)
    pilot = make_flight(SETTINGS, replace(mission(), energy=fitted))
    estimator = pilot.power.estimator
    assert estimator.state_w == pytest.approx(fitted.state_w(3))
    assert estimator.period_std_s == pytest.approx(0.02 * 46.0), "another flight's period is not as sure as its fit"
    mean = make_flight(SETTINGS, replace(mission(), energy=EnergyModel(None, 31.0)))
    assert mean.power.estimator.state_w.tolist() == [31.0]

"""Speed to fly: the law of power against airframes, the choice against a continuous minimum, flights that slow."""

import ast
import math
from functools import lru_cache

import numpy as np
import pytest
from common.forecasts import Forecasting, survey_inputs
from scipy.optimize import minimize_scalar

from eadp.api.flight import simulate
from eadp.core.guidance import load_factor
from eadp.models.battery import LOSS
from eadp.models.vehicle import FixedWing, PaperVehicle, PowerCurve
from eadp.planning.forecast.evaluate import Objective
from eadp.planning.forecast.speed_to_fly import HURRY_W, STEP_MPS, airspeeds_of, value_w
from eadp.planning.state.flight_state import FlownAirspeed
from eadp.planning.state.motion import MotionPower
from eadp.simulation.loop import Outcome, fly

WING = FixedWing(airspeed_range_mps=(10.0, 15.0))
CURVE = PowerCurve(points=((10.0, 24.0), (13.0, 27.0), (15.0, 36.0)), bank_w=9.0, airspeed_range_mps=(10.0, 15.0))
SLOW = {"vehicle.airframe.airspeed_range_mps": [11.0, 15.0], "planner.joint.airspeed": "when-short"}
CALM = {"planner.joint.loss_rate_per_h": 0.0}
PACK = {"battery.capacity_ah": 0.4, "wind.speed_mps": 2.0}


@pytest.mark.parametrize("airframe", [WING, CURVE], ids=["polar", "curve"])
def test_the_power_at_another_airspeed_is_the_airframes_own(airframe):
    a = airframe.cruise_power_w
    b = airframe.level_power_w(airframe.airspeed_mps, math.pi / 4) - a
    for speed in (9.5, 11.0, 13.3, 15.0, 17.0):
        for bank in (0.0, 0.3, 0.7):
            level, flat, turn, own_w = airframe.power_terms(speed)
            power_w = level * a + (flat + turn * math.tan(bank) ** 2) * b + own_w
            assert power_w == pytest.approx(airframe.level_power_w(speed, bank), rel=1e-12)
    assert airframe.power_terms(15.0) == (1.0, 0.0, 1.0, 0.0)
    assert PaperVehicle().power_terms(15.0) == (1.0, 0.0, 1.0, 0.0)


def test_what_is_learned_at_one_airspeed_and_in_turns_holds_at_another():
    true = FixedWing(zero_lift_drag_coefficient=0.026, oswald_efficiency=0.7)
    motion, rng = MotionPower(WING.cruise_power_w, WING, by_polar=True), np.random.default_rng(0)
    before = motion.known()
    for slope in (0.0, 0.4) * 40:
        power_w = true.level_power_w(15.0, math.atan(math.sqrt(slope)))
        motion.ingest(power_w + rng.normal(0, 0.3, 10), np.zeros(10), np.ones(10), slope)
        motion.end_window(slope)
    known, true_w = motion.known(), true.level_power_w(11.0)
    assert abs(known.straight_w(11.0) - true_w) < 0.5 < abs(before.straight_w(11.0) - true_w)
    # flown at 11 m/s, too, it is known as well as at 15 m/s
    slower = MotionPower(WING.cruise_power_w, WING, by_polar=True)
    for speed in (15.0, 11.0) * 40:
        powers_w = true.level_power_w(speed) + rng.normal(0, 0.3, 10)
        slower.ingest(powers_w, np.zeros(10), np.ones(10), 0.0, 0.0, np.full(10, speed))
        slower.end_window(0.0)
    assert slower.known().straight_w(11.0) == pytest.approx(true_w, abs=0.2)
    assert slower.known().straight_w(15.0) == pytest.approx(true.level_power_w(15.0), abs=0.2)


def test_the_value_of_a_second_is_the_derivative_by_the_pace():
    known = MotionPower(WING.cruise_power_w, WING, by_polar=True).known()
    for pace in (11.0, 12.5, 14.0):
        mu = value_w(pace, known, 4.0)

        def cost(speed, mu=mu):
            return (known.straight_w(speed) + 4.0 + mu) / speed

        best = minimize_scalar(cost, bounds=(8, 20), method="bounded", options={"xatol": 1e-6}).x
        assert best == pytest.approx(pace, abs=1e-3)


def chosen(wind_mps):
    """A survey of long lines, its route, and the choice of airspeeds on it."""
    forecasting = Forecasting(survey_inputs(**SLOW), wind_mps=wind_mps)
    route = forecasting.route(0.5)
    return forecasting, route, forecasting.evaluator.speed_choice(forecasting.known, [route])


@pytest.mark.parametrize("wind_mps", [(0.0, 0.0), (0.0, 4.0), (3.0, -2.0)])
def test_the_airspeed_of_a_stage_costs_least_of_all(monkeypatch, wind_mps):
    monkeypatch.setattr("eadp.planning.forecast.speed_to_fly.SETTLE_S", 0.0)
    forecasting, route, choice = chosen(wind_mps)
    for value in (0.0, 10.0, 40.0, HURRY_W):
        airspeeds = choice.airspeeds_mps(value)[0]
        for stage in set(route.stages.tolist()):
            mine = choice.row_of[choice.legs.stages == stage]
            costs = (choice.joules[:, mine] + value * choice.seconds[:, mine]).sum(axis=1)
            # by another way: the times and powers of an evaluation that flies all at one airspeed
            assert choice.speeds_mps[int(np.argmin(costs))] == airspeeds[stage - 1]
    for i, speed in enumerate(choice.speeds_mps.tolist()):
        whole = forecasting.evaluator.evaluate(forecasting.known, [route], np.full((1, choice.stages), speed))
        computing_w = (whole.load.min_w + whole.load.max_w) / 2
        flown_j = (whole.load.motion_w + computing_w) * whole.load.times_s
        rest = slice(1, None)  # of the first leg only a part may be left
        assert flown_j[rest].sum() == pytest.approx(choice.joules[i, choice.row_of][rest].sum(), rel=0.02)


def test_short_stages_have_the_airspeed_of_the_stage_before():
    _, _, choice = chosen((0.0, 4.0))
    assert len(set(choice.airspeeds_mps(5.0)[0].tolist())) == 1  # its lines and turns take 10 to 17 s


def test_no_airspeed_is_below_the_stall_in_turns_the_wind_and_its_gusts():
    forecasting = Forecasting(survey_inputs(**SLOW), wind_mps=(6.0, 0.0))
    rows = forecasting.route(0.0).table.rows
    known = forecasting.known
    speeds = airspeeds_of(WING, known._replace(wind=known.wind._replace(gust_std_mps=1.0)), rows)
    assert speeds[0] == 15.0
    assert speeds[-1] == pytest.approx(6 + 3 + 2)
    tight = rows._replace(bends_per_m=np.array([1 / 25.0]))
    slowest = airspeeds_of(WING, known, tight)[-1]
    bank = min(math.atan((slowest + 6) ** 2 / (25 * 9.80665)), math.radians(45))
    assert slowest >= 1.3 * WING.stall_mps * math.sqrt(load_factor(bank))
    assert np.allclose(np.diff(speeds)[:-1], -STEP_MPS)
    # faster than its own it flies where its bank allows the tightest turn
    quick = FixedWing(airspeed_range_mps=(10.0, 20.0))
    fastest = math.sqrt(9.80665 / rows.bends_per_m.max()) - 6.0  # at 45°, with the wind
    assert 15.0 < fastest - STEP_MPS < airspeeds_of(quick, known, rows)[0] <= fastest
    assert airspeeds_of(quick, known, tight)[0] == 15.0
    # a wind that leaves none slower
    fast = known._replace(wind=known.wind._replace(mps=(11.0, 0.0), gust_std_mps=1.0))
    assert airspeeds_of(WING, fast, rows).tolist() == [15.0]


@pytest.mark.parametrize(
    ("airframe", "fault"),
    [
        (FixedWing(airspeed_range_mps=(16.0, 20.0)), "the airspeed of 15 m/s is not in its range, 16 to 20 m/s"),
        (FixedWing(airspeed_range_mps=(8.0, 15.0)), "the range begins at 8 m/s, and the least airspeed is 9.6 m/s"),
        (FixedWing(airspeed_range_mps=(10.0, 60.0)), "the range ends at 60 m/s, and level flight at"),
    ],
)
def test_a_range_that_cannot_be_flown_is_a_fault(airframe, fault):
    assert any(each.startswith(fault) for each in airframe.faults())
    assert not WING.faults()


@lru_cache
def flown(items):
    inputs = survey_inputs(**CALM, **{"log_every_s": 1.0, **{key: ast.literal_eval(value) for key, value in items}})
    flight, ended = inputs.flight(), Outcome()
    list(fly(inputs.world, flight, ended))
    return ended


def outcome(**overrides):
    return flown(tuple((key, repr(value)) for key, value in overrides.items()))


def test_a_short_battery_slows_the_flight_instead_of_widening_its_lines():
    fixed, slowed = outcome(**PACK), outcome(**PACK, **SLOW)
    assert slowed.completed
    assert slowed.soc_final >= 0.05
    assert slowed.parameters.quality({}) > fixed.parameters.quality({}) + 0.05
    assert slowed.duration_s > 1.05 * fixed.duration_s
    assert 11.0 <= min(record.airspeed_mps for record in slowed.records) < 15.0
    assert all(record.airspeed_mps is None for record in fixed.records)
    assert any("airspeed 15 → " in record.reason for record in slowed.records)


@pytest.mark.slow
def test_the_forecast_is_of_the_speed_that_is_flown():
    slow = {**SLOW, "planner.joint.airspeed": "least-energy", "battery.capacity_ah": 2.0}
    expected, ended = survey_inputs(**CALM, **slow).preflight(), outcome(**slow)
    forecast = expected.forecast  # it does not know in which of two laps the plan ends
    assert abs(ended.duration_s - forecast.remaining_s) < 2 * forecast.remaining_std_s < 0.08 * ended.duration_s
    assert abs(ended.energy_j / 3600 - forecast.energy_wh) < 2 * forecast.energy_std_wh
    fixed = survey_inputs(**CALM, **{"battery.capacity_ah": 2.0}).preflight().forecast
    assert ended.duration_s > 1.1 * fixed.remaining_s


def test_what_commands_no_airspeed_is_forecast_at_its_own():
    fixed, slow = survey_inputs(**CALM), survey_inputs(**CALM, **{**SLOW, "planner.joint.airspeed": "least-energy"})
    assert slow.preflight().forecast.remaining_s > 1.05 * fixed.preflight().forecast.remaining_s
    assert slow.at_one_airspeed().preflight().forecast == fixed.preflight().forecast
    assert fixed.at_one_airspeed() is fixed


def flown_airspeeds(measured_mps):
    """Whether 12 m/s is commanded and known to be flown, each second, while an airspeed is measured."""
    airspeed, held = FlownAirspeed(survey_inputs().mission), []
    for second, speed in enumerate(measured_mps):
        if not math.isnan(speed):
            airspeed.measure(12.0, np.array([float(second)]), np.array([speed]))
        held.append(airspeed.is_commanded(float(second)))
    return held


def test_an_airspeed_that_is_commanded_counts_where_it_is_measured_and_flown():
    slows = [15.0 - 3 * min(k / 45, 1.0) for k in range(200)]  # as slowly as an autopilot may
    assert all(flown_airspeeds(slows))
    refused = flown_airspeeds([15.0] * 200)
    assert all(refused[:60])
    assert not any(refused[62:])
    lost = flown_airspeeds([12.0] * 50 + [math.nan] * 50)
    assert all(lost[:59])
    assert not any(lost[60:])


@pytest.mark.slow
def test_a_loss_is_answered_by_a_slower_flight_and_not_by_wider_lines():
    flight = simulate("plans/survey.plan", scenario="scenarios/survey-loss.yaml")
    before, after = (next(r for r in flight.decisions if r.time_s >= since_s) for since_s in (60.0, 120.0))
    assert after.airspeed_mps < before.airspeed_mps - 2
    assert flight.summary["reserve_kept"]
    assert flight.summary["quality"] > 0.99


def test_lines_leave_the_charge_of_a_first_loss_while_one_is_expected():
    """At 1 / h a loss in the survey's ten minutes is likelier than the 5 % with which the reserve may be missed."""
    spares = {}
    for rate_per_h, losses in ((0.0, 0), (1.0, 0), (1.0, 1)):
        forecasting = Forecasting(survey_inputs(**SLOW), objective=Objective(0.05, 0.95, rate_per_h / 3600))
        known = forecasting.known._replace(charge=forecasting.known.charge._replace(losses=losses))
        evaluation = forecasting.evaluator.evaluate(known, [forecasting.route(0.0), forecasting.route(1.0)])
        spares[rate_per_h, losses] = evaluation.knapsack.spare - evaluation.with_loss.spare
    assert spares == {(0.0, 0): pytest.approx(0.0), (1.0, 0): pytest.approx(LOSS), (1.0, 1): pytest.approx(0.0)}


@pytest.mark.slow
def test_a_flight_whose_lines_became_denser_keeps_the_reserve_after_a_loss():
    losing = {"parameters": {"c1": -1000.0}, "faults": [{"at_s": 300.0, "soc_drop": 0.08}]}
    inputs, ended = survey_inputs(**SLOW, **PACK, **losing), Outcome()
    list(fly(inputs.world, inputs.flight(), ended))
    assert ended.soc_final >= 0.05
    assert ended.parameters.quality({}) > 0.5

"""The charge that is spare at home, against the two equations of the battery along a turn and a line."""

import math
from dataclasses import replace

import numpy as np
import pytest
from common.forecasts import CALM, Forecasting, plan_inputs, survey_inputs

from eadp.core.flight import drain_per_s
from eadp.models.airspace import HOME_RADII
from eadp.models.plan.stage import leg_points
from eadp.planning.forecast.clearance import after_leg
from eadp.planning.forecast.evaluate import Objective
from eadp.planning.forecast.home import STEP_M, can_fall, home_spare, latest_turn_back
from eadp.planning.state.charge import after_drain
from eadp.planning.state.known import WindKnown

EVEN = Objective(0.05, 0.5)


def forecasting_of(home=(0.0, -2500.0), objective=EVEN, **overrides):
    own = {} if home is None else {"home.position_m": [*home]}
    return Forecasting(survey_inputs(**CALM, **own, **overrides), objective=objective)


def test_without_a_home_there_is_no_charge_at_it():
    assert home_spare(forecasting_of(None).at(0.0)) is None


@pytest.mark.parametrize("home", [(0.0, -2500.0), (900.0, 300.0)])
@pytest.mark.parametrize("wind_mps", [(0.0, 0.0), (5.0, 0.0), (-3.0, 6.0)])
def test_the_way_home_takes_a_turn_and_a_line_at_least_power(home, wind_mps):
    """V I = P and V = U − R I; the ground speed along the line from its components."""
    forecasting = forecasting_of(home)
    forecasting.known = forecasting.known._replace(wind=WindKnown(wind_mps))
    found, mission = forecasting.at(0.0), forecasting.mission
    start = forecasting.known.position_m
    course = np.subtract(home, start) / math.dist(home, start)
    along, across = np.dot(wind_mps, course), np.dot(wind_mps, (-course[1], course[0]))
    ground_mps = along + math.sqrt(mission.cruise_mps**2 - across**2)
    turn_m = 2 * math.pi * HOME_RADII * mission.way_home.turn_radius_m
    seconds = math.dist(home, start) / ground_mps + turn_m / mission.cruise_mps
    least_w = mission.vehicle.cruise_power_w + mission.computing.power_w((-1000.0, 2.0), mission.plan.stages[0].sets)
    battery = mission.battery
    current = min(np.roots([battery.resistance_ohm, -battery.voltage_v, least_w]).real)
    takes = current * seconds / 3600 / battery.capacity_ah
    assert found.known.soc - home_spare(found) - 0.05 == pytest.approx(takes, rel=1e-3)


def test_a_higher_way_home_takes_a_climb():
    """Of m g Δh / η from the altitude of cruise, 25 m; a lower one takes nothing."""
    heights = {}, {"home.altitude_m": 125.0}, {"home.altitude_m": 5.0}
    level, high, low = (home_spare(forecasting_of(**each).at(0.0)) for each in heights)
    assert low == level
    mission = forecasting_of().mission
    climb_ah = 100 * mission.vehicle.climb_j_per_m / mission.battery.voltage_v / 3600
    # the current of it, and what the resistance takes
    assert level - high == pytest.approx(climb_ah / mission.battery.capacity_ah, rel=0.05)


def test_it_falls_with_distance_and_with_the_probability_that_is_asked_for():
    by_distance = [home_spare(forecasting_of((0.0, -y)).at(0.0)) for y in (500.0, 1500.0, 4000.0)]
    assert by_distance == sorted(by_distance, reverse=True)
    objectives = [Objective(0.05, probability) for probability in (0.5, 0.95)]
    even, sure = (home_spare(forecasting_of(objective=each).at(0.0)) for each in objectives)
    assert sure < even
    losing = home_spare(forecasting_of(objective=Objective(0.05, 0.95, 1 / 600)).at(0.0))
    assert losing < sure


def test_against_a_wind_as_strong_as_the_airspeed_there_is_no_way_home():
    reached = []
    for speed in (0.0, 14.9, 15.5):
        forecasting = forecasting_of((-2000.0, 0.0))
        known = forecasting.known._replace(wind=WindKnown((speed, 0.0)))
        reached.append(home_spare(replace(forecasting.at(0.0), known=known)))
    assert reached[0] > 0 > reached[1] > reached[2] == -math.inf


def test_the_latest_turn_back_lies_between_take_off_and_the_end():
    by_capacity = []
    for capacity_ah in (0.25, 0.3, 3.0):
        found = forecasting_of((0.0, -1000.0), **{"battery.capacity_ah": capacity_ah}).at(0.0)
        by_capacity.append(latest_turn_back(found, found.filled()))
    early, later, never = (turn_back.time_s for turn_back in by_capacity)
    assert 0 < early < later < never
    assert never == pytest.approx(found.known.time_s + found.load.times_s.sum(), abs=1e-6)
    assert latest_turn_back(forecasting_of(None).at(0.0), found.filled()) is None


@pytest.mark.quick(1)
@pytest.mark.parametrize(("home", "capacity_ah"), [((0, -1000), 0.25), ((300, 900), 0.3), ((600, 100), 0.28)])
def test_no_point_after_the_latest_turn_back_is_within_reach_of_home(home, capacity_ah):
    """Beside fifty points of each leg; halving ends within `STEP_M`."""
    found = forecasting_of(home, **{"battery.capacity_ah": capacity_ah}).at(0.0)
    filling, (route,), known, battery = found.filled(), found.routes, found.known, found.evaluator.mission.battery
    powers_w = found.load.motion_w + found.computing_w(filling.shares)
    drains = drain_per_s(powers_w, found.limits.volts, battery.resistance_ohm, battery.drain_per_as)
    rows = zip(route.legs, found.load.times_s, powers_w, drains, strict=True)
    begin_s = begin_j = used = last_s = 0.0
    for leg, leg_s, power_w, drain in rows:
        for share in np.linspace(0.02, 1.0, 50):
            x, y, _ = leg_points(leg._replace(flown_m=share * leg.distance_m), math.inf)[-1]
            charge = known.charge._replace(filtered=after_drain(known.charge.filtered, used + drain * share * leg_s))
            there = after_leg(known, leg)._replace(position_m=(x, y), charge=charge)
            flown_s, flown_j = begin_s + share * leg_s, begin_j + share * leg_s * power_w
            if there.soc > 0 and home_spare(replace(found, known=there), flown_s, flown_j) >= 0:
                last_s = flown_s
        begin_s, begin_j, used = begin_s + leg_s, begin_j + leg_s * power_w, used + drain * leg_s
    assert 0 < last_s < begin_s, "home is out of reach before the plan's end"
    assert latest_turn_back(found, filling).time_s == pytest.approx(known.time_s + last_s, abs=(STEP_M + 10) / 15)


def test_the_way_home_is_level_flight_where_the_plan_descends():
    """A leg that descends draws the least; the way home is none."""
    found = forecasting_of().at(0.0)
    gliding_w = np.full_like(found.load.motion_w, found.known.motion.level_w)
    gliding_w[-1] = 0.0
    gliding = replace(found, load=found.load._replace(motion_w=gliding_w))
    assert home_spare(gliding) == pytest.approx(home_spare(found), abs=1e-12)


def returning(tmp_path, autopilot=None, landing="%: altitude 0\n%: command 21 0 0 0 0 0 0 0\n", **keys):
    """The evaluation of a line of 3 km to the east and a landing on the way on, at home beside its start."""
    text = f"%: home 0,-300\n%: altitude 60\n0.1; 90; y\n3000, 0\n{landing}0.1; 90; y\n3600, 0\n"
    own = {} if autopilot is None else {"autopilot.kind": autopilot}
    inputs = plan_inputs(tmp_path, text, **{"wind.speed_mps": 0.0, "battery.capacity_ah": 3.0, **own, **keys})
    return Forecasting(inputs, objective=EVEN)


def way_of(forecasting, position=(0.0, 0.0)):
    known = forecasting.known._replace(position_m=position)
    return forecasting.evaluator.homeward(known, 0.0)


def test_with_a_landing_the_way_home_leads_down_it(tmp_path):
    """To where it starts, with a turn there, and 600 m down; the descent of 60 m gives back m g h/η."""
    forecasting = returning(tmp_path)
    vehicle, speed = forecasting.mission.vehicle, forecasting.known.airspeed_mps
    turn_s = 2 * math.pi * HOME_RADII * vehicle.turn_radius_m / speed
    way, level_w = way_of(forecasting), forecasting.known.motion.level_w
    assert way.seconds == pytest.approx(3000 / speed + 2 * turn_s + 600 / speed)
    down_s = turn_s + 600 / speed
    energy_j = level_w * (3000 / speed + turn_s) + max(level_w * down_s - 60 * vehicle.climb_j_per_m, 0)
    assert way.seconds * way.power_w == pytest.approx(energy_j)
    assert forecasting.inputs.world.way_home.pieces((0.0, 0.0, 0.0))[-1].end[:2] == pytest.approx((3000, 0), abs=1e-6)


@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_an_autopilot_climbs_to_its_altitude_and_circles_at_home(tmp_path, kind):
    """At the factory's 100 m, once round; without a kind at the altitude that it has, to home alone."""
    own, plain = returning(tmp_path, kind, landing=""), returning(tmp_path, landing="")
    vehicle, speed = own.mission.vehicle, own.known.airspeed_mps
    circle_s = 2 * math.pi * HOME_RADII * vehicle.turn_radius_m / speed
    ways = [way_of(each) for each in (own, plain)]
    assert ways[0].seconds - ways[1].seconds == pytest.approx(circle_s)
    taken_j = [way.seconds * way.power_w for way in ways]
    climb_j = (100 - own.known.climb.altitude_m) * vehicle.climb_j_per_m
    assert taken_j[0] - taken_j[1] == pytest.approx(climb_j + circle_s * own.known.motion.level_w)
    # at the end of the plan it does the same: more energy and time, less charge left
    ends = [each.at(()) for each in (own, plain)]
    forecasts = [each.forecast(each.filled()) for each in ends]
    assert forecasts[0].remaining_s - forecasts[1].remaining_s == pytest.approx(ends[0].own.seconds[0])
    assert ends[0].own.seconds[0] > 3000 / speed
    assert forecasts[0].soc_end < forecasts[1].soc_end
    assert forecasts[0].energy_wh - forecasts[1].energy_wh == pytest.approx(ends[0].own.joules[0] / 3600)


def test_what_makes_px4_turn_back_is_in_the_reserve(tmp_path):
    """1.1 times the time home and 100 s of flight are left wherever it flies; off by its parameter."""
    small = {"battery.capacity_ah": 0.6}
    actions = [{"autopilot.parameters": {"COM_FLTT_LOW_ACT": action}} for action in (3.0, 0.0)]
    ends = [returning(tmp_path, "px4", **small, **each).at(()) for each in actions]
    keeps, free = (float(each.own.turns_back_soc[0]) for each in ends)
    assert free == 0
    battery, power_w = ends[0].evaluator.mission.battery, float(ends[0].totals.mean_w[0])
    left_s = keeps / battery.drain_per_s(power_w, battery.voltage_at(0.5))
    # at the end of the line the landing is ahead: the way is about twice that of the plan, with both turns
    known = ends[0].known._replace(position_m=(3000.0, 0.0))
    home_s = ends[0].evaluator.homeward(known, 0.0).seconds
    rest_s = float(ends[0].load.times_s[-1])
    assert left_s == pytest.approx(1.1 * home_s + 100 - rest_s, rel=0.15)
    assert ends[0].reserve_soc == keeps > 0.05
    assert ends[0].knapsack.available[0] == pytest.approx(ends[1].knapsack.available[0] - keeps + 0.05)


def test_home_can_wait_no_longer_than_until_px4_turns_back(tmp_path):
    """At the latest turn back its time left is what its rule asks for; without the rule the reserve alone counts."""
    places = {"start.position_m": [6000.0, 0.0], "home.position_m": [6000.0, -300.0]}
    small, waits = {"battery.capacity_ah": 0.15, **places}, {}
    for action in (3.0, 0.0):
        given = {"autopilot.parameters": {"COM_FLTT_LOW_ACT": action}}
        found = returning(tmp_path, "px4", landing="", **small, **given).at(())
        waits[action] = latest_turn_back(found, found.filled())
    own, free = waits[3.0], waits[0.0]
    assert 0 < own.time_s < free.time_s - 20
    battery, power_w = found.evaluator.mission.battery, float(found.totals.mean_w[0])
    left_s = 1 / battery.drain_per_s(power_w, battery.voltage_at(0.6)) - own.time_s
    climb_s = (100 - 60) / 3
    assert left_s == pytest.approx(1.1 * (own.home_s - own.time_s + climb_s) + 100, rel=0.1)


def test_the_charge_to_spare_falls_by_what_power_draws_not_by_what_was_lost():
    found = forecasting_of().at(0.0)
    falls = can_fall(found, 1.0)
    battery, known = found.evaluator.mission.battery, found.known
    power_w = known.motion.max_w + float(found.load.max_w.max()) + known.motion.level_w
    assert falls == pytest.approx(battery.drain_per_s(power_w, battery.voltage_at(known.soc)), rel=0.1)
    lost = replace(found, known=known._replace(charge=known.charge._replace(losses=3)))
    assert can_fall(lost, 1.0) == falls
    windy = replace(found, known=known._replace(wind=WindKnown((8.0, 0.0))))
    assert can_fall(windy, 1.0) > falls

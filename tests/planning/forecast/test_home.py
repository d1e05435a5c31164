"""The charge that is spare at home, against the two equations of the battery along a turn and a line."""

from __future__ import annotations

import math

import numpy as np
import pytest
from common.forecasts import CALM, Forecasting, survey_inputs

from eadp.models.airspace import HOME_RADII
from eadp.planning.forecast.evaluate import Objective
from eadp.planning.forecast.home import home_spare, latest_turn_back
from eadp.planning.state.known import WindKnown

EVEN = Objective(0.05, 0.5)


def forecasting_of(home=(0.0, -2500.0), objective=EVEN, **overrides):
    own = {} if home is None else {"home.position_m": [*home]}
    return Forecasting(survey_inputs(**CALM, **own, **overrides), objective=objective)


def test_without_a_home_there_is_no_charge_at_it():
    assert home_spare(forecasting_of(None).at(0.0), 0) is None


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
    assert found.known.soc - home_spare(found, 0) - 0.05 == pytest.approx(takes, rel=1e-3)


def test_a_higher_way_home_takes_a_climb():
    """Of m g Δh / η from the altitude of cruise, 25 m; a lower one takes nothing."""
    level, high, low = (
        home_spare(forecasting.at(0.0), 0)
        for forecasting in (forecasting_of(), *(forecasting_of(**{"home.altitude_m": m}) for m in (125.0, 5.0)))
    )
    assert low == level
    mission = forecasting_of().mission
    climb_ah = 100 * mission.vehicle.climb_j_per_m / mission.battery.voltage_v / 3600
    # the current of it, and what the resistance takes
    assert level - high == pytest.approx(climb_ah / mission.battery.capacity_ah, rel=0.05)


def test_at_home_nothing_is_needed():
    forecasting = forecasting_of()
    forecasting.known = forecasting.known._replace(position_m=(0.0, -2500.0))
    spare = home_spare(forecasting.evaluator.evaluate(forecasting.known, [forecasting.route(0.0)]), 0)
    assert spare == pytest.approx(forecasting.known.soc - 0.05, abs=1e-9)


def test_it_falls_with_distance_and_with_the_probability_that_is_asked_for():
    by_distance = [home_spare(forecasting_of((0.0, -y)).at(0.0), 0) for y in (500.0, 1500.0, 4000.0)]
    assert by_distance == sorted(by_distance, reverse=True)
    even, sure = (
        home_spare(forecasting_of(objective=Objective(0.05, probability)).at(0.0), 0) for probability in (0.5, 0.95)
    )
    assert sure < even
    losing = home_spare(forecasting_of(objective=Objective(0.05, 0.95, 1 / 600)).at(0.0), 0)
    assert losing < sure


def test_against_a_wind_as_strong_as_the_airspeed_there_is_no_way_home():
    reached = []
    for speed in (0.0, 14.9, 15.5):
        forecasting = forecasting_of((-2000.0, 0.0))
        found = forecasting.at(0.0)
        known = forecasting.known._replace(wind=WindKnown((speed, 0.0)))
        spare = home_spare(type(found)(**{**vars(found), "known": known}), 0)
        reached.append(spare)
    assert reached[0] > 0 > reached[1] > reached[2] == -math.inf


def test_the_latest_turn_back_lies_between_take_off_and_the_end():
    by_capacity = []
    for capacity_ah in (0.25, 0.3, 3.0):
        found = forecasting_of((0.0, -1000.0), **{"battery.capacity_ah": capacity_ah}).at(0.0)
        by_capacity.append(latest_turn_back(found, 0, found.filled()))
    early, later, never = (turn_back.time_s for turn_back in by_capacity)
    assert 0 < early < later < never
    assert never == pytest.approx(found.known.time_s + found.load.times_s.sum(), abs=1e-6)
    assert latest_turn_back(forecasting_of(None).at(0.0), 0, found.filled()) is None

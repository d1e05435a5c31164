"""An autopilot's own rules, by its parameters."""

import numpy as np
import pytest

from eadp.models.autopilot import Autopilot
from eadp.models.battery import Battery

PACK = Battery(voltage_v=12.6, voltage_empty_v=10.5, resistance_ohm=0.1, capacity_ah=2.0)


def low_soc(kind, power_w=0.0, **parameters):
    return float(Autopilot(kind, parameters).low_soc(PACK, np.array([power_w]))[0])


def test_a_value_is_the_one_given_else_the_factorys_of_its_kind():
    assert Autopilot("px4").value("COM_FLTT_LOW_ACT") == 3
    assert Autopilot("px4", {"COM_FLTT_LOW_ACT": 0.0}).value("COM_FLTT_LOW_ACT") == 0
    assert Autopilot("ardupilot").value("COM_FLTT_LOW_ACT") is None
    assert Autopilot().value("RTL_ALTITUDE") is None


@pytest.mark.parametrize(
    ("kind", "parameters", "planned_m", "altitude_m"),
    [
        ("px4", {}, None, 100),
        ("px4", {}, 144.0, 144),  # as the file of parameters has it
        ("px4", {"RTL_RETURN_ALT": 60.0}, 144.0, 60),  # what it has counts
        ("ardupilot", {}, None, 100),
        ("ardupilot", {"ALT_HOLD_RTL": 12000.0}, 144.0, 120),
        ("ardupilot", {"RTL_ALTITUDE": -1.0}, 144.0, None),
    ],
)
def test_it_returns_at_its_own_altitude_else_at_the_planned(kind, parameters, planned_m, altitude_m):
    assert Autopilot(kind, parameters).return_altitude_m(planned_m) == altitude_m


@pytest.mark.parametrize(
    ("kind", "parameters", "lands"),
    [
        ("px4", {}, True),
        ("px4", {"RTL_TYPE": 0.0}, False),
        ("ardupilot", {}, True),  # as the file of parameters has it: with 0 the mission is not armed
        ("ardupilot", {"RTL_AUTOLAND": 0.0}, False),
        ("ardupilot", {"RTL_AUTOLAND": 3.0}, False),
        ("ardupilot", {"RTL_AUTOLAND": 1.0}, True),
    ],
)
def test_its_return_lands_or_circles(kind, parameters, lands):
    assert Autopilot(kind, parameters).lands is lands


def test_px4_turns_back_by_the_time_left_unless_that_is_off():
    assert Autopilot("px4").time_rule == (1.1, 100, 3)
    assert Autopilot("px4", {"COM_FLTT_LOW_ACT": 1.0}).time_rule is None
    assert Autopilot("ardupilot").time_rule is None


def test_ardupilot_turns_back_by_the_charge_that_is_left_or_by_the_voltage_under_load():
    assert low_soc("ardupilot") == low_soc("ardupilot", BATT_LOW_MAH=500.0) == 0  # no action
    assert low_soc("ardupilot", BATT_FS_LOW_ACT=1.0, BATT_LOW_MAH=500.0) == 0.25
    both = {"BATT_FS_LOW_ACT": 1.0, "BATT_LOW_MAH": 500.0, "BATT_FS_CRT_ACT": 2.0, "BATT_CRT_MAH": 600.0}
    assert low_soc("ardupilot", **both) == 0.3
    # at 107 W of 10.7 V: 10 A, 1 V of sag
    by_voltage = {"BATT_FS_LOW_ACT": 1.0, "BATT_LOW_VOLT": 10.7}
    assert low_soc("ardupilot", 107.0, **by_voltage) == pytest.approx((10.7 + 1.0 - 10.5) / 2.1)
    assert low_soc("ardupilot", 107.0, BATT_FS_VOLTSRC=1.0, **by_voltage) == pytest.approx(0.2 / 2.1)


def test_px4_returns_at_a_critical_charge_where_it_is_to():
    assert low_soc("px4") == 0
    assert low_soc("px4", COM_LOW_BAT_ACT=3.0) == 0.07
    assert low_soc("px4", COM_LOW_BAT_ACT=2.0, BAT_CRIT_THR=0.2) == 0.2

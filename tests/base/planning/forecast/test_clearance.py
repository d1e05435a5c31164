"""The probability of entering an obstacle, beside the share of flights that do."""

import pytest
from common import few_rows

from eadp.api.inputs import load_flight
from eadp.simulation.loop import Outcome, fly

PLAN = """%: trigger-radius 10
%: avoid house {near},-50 {far},-50 {far},{top} {near},{top}
%: avoid shed height 20 150,4 250,4 250,9 150,9
0.05; 270; y
400, 0
0.0006; 90; (x-400)^2 + (y-{radius})^2 - {square}
400, {twice}
0.05; 90; y-{twice}
0, {twice}
"""
"""East, half a circle to the left in front of a house, and back; turns of 40 m can be flown in calm air."""


def inputs(tmp_path, radius, clear, limits="", **overrides):
    near = 400 + radius + clear
    numbers = {"near": near, "far": near + 60, "top": 2 * radius + 50, "square": radius**2, "twice": 2 * radius}
    path = tmp_path / "house.plan"
    path.write_text(limits + PLAN.format(radius=radius, **numbers))
    keys = {
        "planner.name": "static", "start.position_m": [0.0, 0.0], "start.heading_deg": 90.0,
        "vehicle.airframe.airspeed_mps": 15.0, "vehicle.airframe.max_bank_deg": 30.0, "battery.capacity_ah": 5.0,
        "step_s": 0.02,
    }  # fmt: skip
    return load_flight(str(path), overrides=keys | {key.replace("__", "."): value for key, value in overrides.items()})


def entered_share(tmp_path, name, flights, **case):
    count = 0
    for seed in range(flights):
        flight, outcome = inputs(tmp_path, seed=seed, **case), Outcome()
        list(fly(flight.world, flight.flight(), outcome))
        count += any(entry.name == name for entry in outcome.entries)
    return count / flights


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("radius", "clear", "wind"),
    few_rows(
        [
            (60, 5, {"wind__speed_mps": 4.0}),
            (60, 10, {"wind__speed_mps": 6.0, "wind__gust_std_mps": 2.0}),
            (45, 20, {"wind__speed_mps": 6.0, "wind__gust_std_mps": 2.0}),
        ],
        3,
    ),
)
def test_it_is_the_share_of_flights_that_enter(tmp_path, radius, clear, wind):
    case = {"radius": radius, "clear": clear, **wind}
    stated = inputs(tmp_path, **case).preflight().entering.get("house", 0.0)
    gusty = "wind__gust_std_mps" in wind
    flown = entered_share(tmp_path, "house", 24 if gusty else 1, **case)
    # without gusts all flights are one; of 24, the share has a standard deviation of up to 0.1
    assert stated == pytest.approx(flown, abs=0.25 if gusty else 0.0)


def test_an_obstacle_that_is_lower_and_one_that_is_far_are_not_entered(tmp_path):
    case = {"wind__speed_mps": 8.0, "wind__gust_std_mps": 3.0}
    assert set(inputs(tmp_path, 60, 5, **case).preflight().entering) == {"house"}
    assert inputs(tmp_path, 60, 500, **case).preflight().entering == {}
    low = inputs(tmp_path, 60, 5, **{"vehicle.airframe.cruise_altitude_m": 10.0}, **case).preflight().entering
    assert 0 < low["shed"] < 1


@pytest.mark.parametrize(("high_m", "low_m", "enters"), [(60, 20, False), (20, 60, True)])
def test_the_altitude_is_that_of_the_place(tmp_path, high_m, low_m, enters):
    """A mast of 30 m on a leg of 900 m, and a leg of another altitude that is far from it."""
    path = tmp_path / "mast.plan"
    mast = "%: avoid mast height 30 500,-10 520,-10 520,10 500,10\n"
    path.write_text(f"{mast}%: altitude {high_m}\n0.1; 270; y\n900, 0\n%: altitude {low_m}\n0.1; 270; y\n2500, 0\n")
    keys = {"planner.name": "static", "start.position_m": [0.0, 0.0], "start.altitude_m": high_m}
    found = load_flight(str(path), overrides=keys | {"battery.capacity_ah": 5.0}).preflight().entering
    assert found == ({"mast": 1.0} if enters else {})


def test_a_climb_from_the_ground_is_not_yet_above_what_stands_there(tmp_path):
    """At 3 m/s of 15 it is 100 m high after 515 m, and as it passes the mast at 200 m, 40 m."""
    path = tmp_path / "mast.plan"
    found = {}
    for top_m in (30, 50):
        mast = f"%: avoid mast height {top_m} 200,-10 220,-10 220,10 200,10\n"
        path.write_text(f"{mast}%: altitude 100\n0.1; 270; y\n2000, 0\n")
        keys = {"planner.name": "static", "start.position_m": [0.0, 0.0], "start.altitude_m": 0.0}
        keys |= {"battery.capacity_ah": 5.0, "start.heading_deg": 90.0}
        flight, outcome = load_flight(str(path), overrides=keys), Outcome()
        found[top_m] = flight.preflight().entering.get("mast", 0.0)
        list(fly(flight.world, flight.flight(), outcome))
        assert any(entry.name == "mast" for entry in outcome.entries) == (found[top_m] == 1.0)
    assert found == {30: 0.0, 50: 1.0}


def test_a_boundary_that_is_left(tmp_path):
    inside = "%: inside -50,-50 462,-50 462,200 -50,200\n"
    calm = inputs(tmp_path, 60, 500, inside).preflight().entering
    windy = inputs(tmp_path, 60, 500, inside, wind__speed_mps=8.0).preflight().entering
    assert (calm, windy) == ({}, {"the boundary": 1.0})

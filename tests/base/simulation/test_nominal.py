"""Paths that bend tighter than the aircraft can turn: forecast as they are flown, and named."""

from types import SimpleNamespace

import pytest

import eadp
from eadp.api.inputs import load_flight
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.models.plan.trace import whole_route
from eadp.models.world import Excess
from eadp.simulation.nominal import Overshoot, overshoot_findings, overshoots

HOME = (47.0, 8.0)
SHARP = [
    (400.0, 0.0), (400.0, 10.0), (0.0, 10.0), (0.0, 20.0), (400.0, 20.0), (401.0, 22.0), (401.0, 22.0), (0.0, 200.0),
]  # fmt: skip
WIDE = [(600.0, 0.0), (600.0, 400.0), (0.0, 400.0)]
WINDS = [{}, {"wind.speed_mps": 5.0, "wind.from_deg": 250.0}]


def mission(tmp_path, points):
    rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{HOME[0]}\t{HOME[1]}\t0\t1"]
    for index, point in enumerate(points, 1):
        latitude, longitude = to_geodetic_deg(*point, HOME)
        rows.append(f"{index}\t0\t3\t16\t0\t0\t0\t0\t{latitude:.8f}\t{longitude:.8f}\t60\t1")
    path = tmp_path / "sharp.waypoints"
    path.write_text("\n".join([*rows, ""]))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("wind", WINDS)
def test_a_path_too_sharp_to_follow_is_forecast_as_it_is_flown(tmp_path, wind):
    path = mission(tmp_path, SHARP)
    inputs = load_flight(path, overrides=wind)
    expected = inputs.preflight()
    summary = eadp.simulate(path, overrides=wind, warn=lambda _: None).summary
    route = whole_route(inputs.mission.plan, (), inputs.mission.rules, inputs.world.start.position_m)
    followed_s = route.times_s(inputs.mission.vehicle.airspeed_mps, inputs.world.wind.steady_mps)[0].sum()
    assert summary["completed"]
    assert followed_s < 0.9 * summary["duration_s"]  # of the path's own length it would be far off
    assert expected.forecast.remaining_s == pytest.approx(summary["duration_s"], rel=0.02)
    assert expected.forecast.energy_wh == pytest.approx(summary["energy_wh"], rel=0.06)
    powers_w = [3600 * energy / seconds for seconds, energy in expected.stages.values()]
    assert max(powers_w) <= inputs.mission.vehicle.max_motion_w


def test_an_overshot_turn_widens_the_deviation(tmp_path):
    sharp, wide = (load_flight(mission(tmp_path, points)).preflight().forecast for points in (SHARP, WIDE))
    assert sharp.remaining_std_s / sharp.remaining_s > 1.2 * wide.remaining_std_s / wide.remaining_s


def test_turns_are_named_by_their_items_with_what_is_flown(tmp_path):
    path = mission(tmp_path, SHARP)
    messages = [fault.message for fault in load_flight(path).warnings]
    named = [message for message in messages if "tighter than the aircraft's" in message]
    assert all(message.startswith("item ") and "beside the path" in message for message in named[:3])


def test_of_many_turns_the_worst_are_named_and_the_others_counted():
    stages = [SimpleNamespace(label=f"item {i}", index=i, line=i) for i in range(9)]
    off_m = [20.0, 70.0, 15.0, 50.0, 30.0, 60.0, 40.0, 12.0, 1.0]
    found = [Overshoot(stages[i], Excess(2.0, 0.0), off_m[i]) for i in range(9)]
    lines = [(found.line, found.message.split(":")[0]) for found in overshoot_findings(found)]
    assert lines == [
        (1, "item 1"),
        (3, "item 3"),
        (5, "item 5"),
        (6, "5 more turns tighter than the aircraft's, each nearer to its path"),
    ]
    assert len(overshoot_findings(found[:4])) == 4  # one is named in its own line as well as counted


def test_what_can_be_followed_is_left_as_it_is(tmp_path):
    agile = load_flight(mission(tmp_path, WIDE), overrides={"vehicle.airframe.max_bank_deg": 60}).world
    wide = load_flight(mission(tmp_path, WIDE)).world
    route = whole_route(wide.mission.plan, (), wide.mission.rules, wide.start.position_m)
    assert not overshoots(route, agile.mission.vehicle, agile.guidance, (0.0, 0.0))
    assert overshoots(route, wide.mission.vehicle, wide.guidance, (8.0, 0.0))

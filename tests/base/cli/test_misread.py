"""Inputs that seem to mean something else than they say: an error or a warning that says so."""

import math
import os

import pytest
from common.answers import refused

from eadp.exchange.writer import EXPORTS

MEADOW = ("plans/meadow.geojson", "--min-radius", "30", "--swath", "30")


@pytest.mark.parametrize(
    "command",
    [
        ("cover", "FILE", "--min-radius", "30", "--swath", "30"),
        ("plan", "FILE"),
        ("simulate", "plans/survey.plan", "--profile", "FILE"),
        ("replan", "plans/survey.plan", "--telemetry", "FILE"),
        ("report", "FILE"),
    ],
    ids=" ".join,
)
def test_names_that_no_file_can_have(eadp, tmp_path, command):
    os.symlink(tmp_path / "loop", tmp_path / "loop")
    for name in (tmp_path / "loop", "x" * 300, "a\0b"):
        assert refused(eadp(*(name if word == "FILE" else word for word in command)))


def test_outputs_that_no_file_can_be_are_refused_before_any_is_written(eadp, tmp_path):
    plan, picture = tmp_path / "a.plan", f"{'x' * 300}.svg"
    assert refused(eadp("cover", *MEADOW, "-o", plan, "--plot", picture), "cannot be written: File name too long")
    assert not plan.exists()


SHORT = ("simulate", "plans/survey.plan", "--scenario", "scenarios/survey.yaml", "--set", "time_limit_s=1", "--set")
PLACED = "%: origin 55.37 10.43\n0.1; 90; x\n0, 400\n"


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("battery.capacity_ah=3200", "less than or equal to 1000"),  # mAh
        ("vehicle.airframe.airspeed_mps=54", "an aeroplane that can fly so"),  # km/h
        ("wind.speed_mps=20", "a wind below the airspeed"),  # km/h
        ("wind.from_deg=2700", "less than or equal to 360"),
        ("guidance.wind_corrected=yes", "true or false"),
    ],
)
def test_settings_in_other_units(eadp, setting, expected):
    assert refused(eadp(*SHORT, setting), f"; expected {expected}")


SURVEY = ("plans/meadow.geojson", "--pattern", "dubins", "--vehicle", "vehicles/foam-wing.yaml")
CAMERA = {"--altitude": 80, "--sensor-width-mm": 6.3, "--sensor-height-mm": 4.7, "--focal-length-mm": 4.5}


def surveyed(**changed):
    """A coverage with a camera, some of its options changed."""
    options = CAMERA | {"--side-overlap": 60} | {f"--{key.replace('_', '-')}": value for key, value in changed.items()}
    return ("cover", *SURVEY, *(str(word) for pair in options.items() for word in pair))


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (surveyed(), 0, ""),
        (surveyed(home="10.333,55.4715"), 2, "which is at 55.47° N, 10.33° E; expected LAT,LON in that order: here or"),
        (surveyed(sensor_width_mm=0.0063), 2, "--sensor-width-mm:1:1: error: 0.0063 is out of range"),  # m
        (surveyed(side_overlap=0.7), 2, "0.7 %; expected percent from 1 to 99, as 70"),
        (surveyed(min_radius=15), 0, "which the aircraft holds not even in calm air; in 0 m/s it needs"),
        (
            surveyed(wind="20,240"),
            2,
            "no slower than the aircraft; expected less than its 15 m/s; 20 km/h are 5.56 m/s",
        ),
        (surveyed(wind="4,2400"), 2, "a bearing of 2400°; expected 0 to 360"),
    ],
)
def test_what_was_probably_meant(eadp, arguments, code, said):
    """A warning where a value may be right, an error where it cannot."""
    answer = eadp(*arguments)
    refused(answer) if code else answer
    assert said in answer.err
    assert (answer.err == "") == (said == ""), answer.err


def test_latitude_and_longitude_swapped(eadp, tmp_path):
    plan = tmp_path / "placed.plan"
    plan.write_text(PLACED)
    home = ("--set", "home.lat_deg=10.43", "--set", "home.lon_deg=55.37")
    assert refused(eadp("simulate", plan, *home), "too far from the plan's origin, but near it with lon_deg and")
    assert refused(eadp("export", plan, "--to", "kml", "--home", "10.43,55.37"), "--home:1:1", "LAT,LON in that order")
    assert refused(eadp("cover", *MEADOW, "--home", "10.43,55.37"), "--home:1:1", "LAT,LON in that order")
    zone = tmp_path / "zone.csv"
    zone.write_text("lat,lon\n10.43,55.37\n10.44,55.37\n10.44,55.38\n")
    for option in ("--avoid", "--inside"):
        answer = eadp("cover", *MEADOW, option, zone)
        assert refused(answer, "zone.csv:1:1: error: 1 polygon farther than 100 km left out; expected")


def test_metres_of_a_grid(eadp, tmp_path):
    """A plan in coordinates of a UTM zone: at home in its own metres, and nowhere near a place on the earth."""
    plan, placed, pole = tmp_path / "utm.plan", tmp_path / "placed.plan", tmp_path / "pole.csv"
    grid = [(492_000 + x, 5_393_700 + y) for x, y in ((0, 0), (300, 0), (300, 200), (0, 200))]
    (tmp_path / "field.csv").write_text("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in grid))
    pole.write_text("x_m,y_m\n492140,5393790\n492160,5393790\n492150,5393810\n")
    assert eadp("cover", tmp_path / "field.csv", *MEADOW[1:], "--metres", "-o", plan).code == 0
    # lines pass through a pole that was not known
    plan.write_text(eadp("plan", plan, "--avoid", pole).out)
    flown = eadp("simulate", plan, "--planner", "static")
    assert (flown.code, "entered obstacle 1" in flown.out + flown.err) == (1, True)
    for to in EXPORTS:
        far = eadp("export", plan, "--to", to, "--origin", "48.7,8.9")
        assert refused(far, "--origin:1:1: error: the path reaches 5416 km from the origin, 48.70° N, 8.90° E")
    placed.write_text(f"%: origin 48.7 8.9\n{plan.read_text()}")
    for command in (("plan", placed), ("simulate", placed), ("export", placed, "--to", "kml")):
        assert refused(eadp(*command), f"{placed}:1:11: error: the plan reaches 5416 km from there")
    home = eadp("cover", tmp_path / "field.csv", *MEADOW[1:], "--metres", "--home", "0,0")
    assert refused(home, "km from the field; expected 50 km or less")


LOG = [(0.5 * i, 30 + 5 * math.cos(0.25 * i)) for i in range(400)]


def table(head, rows, mark=","):
    return "\n".join([head, *(mark.join(map(str, row)) for row in rows)]) + "\n"


@pytest.mark.parametrize(
    ("command", "body", "message"),
    [
        ("plan", "%: origin 155.37 10.43\n0.1; 90; x\n0, 400\n", "latitude and longitude seem to be swapped"),
        ("profile", 'fps,power_w\n"2,5",5\n3,6\n', "2:1: error: 2,5 is not a number; expected a decimal point, as in"),
    ],
)
def test_texts_that_mean_something_else(eadp, tmp_path, command, body, message):
    file = tmp_path / "file"
    file.write_text(body)
    assert refused(eadp(command, file), message)


@pytest.mark.quick(5)
@pytest.mark.parametrize(
    ("command", "body", "message"),
    [
        ("plan", "0.1; 90; x\n0,5, 400\n", "2:1: warning: a trigger with a radius of 400 m, or a decimal comma"),
        ("profile", "fps,power_w\n2,500\n3,6000\n", "3:3: warning: a power of 6000 W; expected at most 1000 W"),
        # milliseconds, and milliwatts
        ("fit", table("time_s,power_w", [(1000 * t, p) for t, p in LOG]), "1:1: warning: a row every 500 s, over"),
        ("fit", table("time_s,power_w", [(t, 1000 * p) for t, p in LOG]), "1:1: warning: a mean power of 2.998e+04"),
    ],
)
def test_texts_that_may_mean_something_else(eadp, tmp_path, command, body, message):
    file = tmp_path / "file"
    file.write_text(body)
    answer = eadp(command, file)
    assert answer.out
    assert message in answer.err
    assert message or not answer.err


@pytest.mark.parametrize("value", ["-500,5", "-5000"])
def test_parameters_of_a_plan_are_checked_though_nothing_is_drawn(eadp, value):
    assert refused(eadp("plan", "plans/survey.plan", "--set", f"c1={value}"), "--set:1:4")

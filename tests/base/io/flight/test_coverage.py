"""What a flight covers of the field that its plan knows."""

import json

import numpy as np
import pytest
from common.answers import refused
from common.pages import Page

import eadp as library
from eadp.io.flight import covering_stages, flown_coverage, flown_lines, flown_of_plan, planned_lines
from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text

FIELD = "%: field 0 0, 200 0, 200 100, 0 100\n%: hole 120 40, 120 60, 160 60, 160 40\n%: swath 40\n"
STAGES = "0.1; 270; y - 20\n150, 20\n0.02; 90; (x - 150)^2 + (y - 50)^2 - 900\n150, 80\n0.1; 90; y - 80\n0, 80\n"
FLIGHT = {"time_limit_s": 40, "step_s": 0.05, "start.position_m": [0, 20], "start.heading_deg": 90}


def plan(text):
    return read_plan(Text("p.plan", text))


def columns(stages, xs, ys):
    return {"time_s": [float(i) for i in range(len(xs))], "stage": stages, "x_m": xs, "y_m": ys}


def test_a_plan_keeps_its_field():
    read, findings = plan(FIELD + STAGES)
    assert not [finding for finding in findings if finding.code == "field"]
    assert read.site.field.outline == ((0, 0), (200, 0), (200, 100), (0, 100))
    assert read.site.field.holes == (((120, 40), (120, 60), (160, 60), (160, 40)),)
    assert read.site.swath_m == 40
    assert plan(plan_text(read))[0] == plan(plan_text(plan(plan_text(read))[0]))[0]
    assert plan(plan_text(read))[0].site.field == read.site.field


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("%: field 0 0, 1 1", "no corners of an area"),
        ("%: field 0 0, 1 1, x 2", "no corners of an area"),
        ("%: field 0 0, 1 1, 1e10 2", "no corners of an area"),
        ("%: field 0 0, 1 1, nan 2", "no corners of an area"),
        ("%: hole 0 0, 1 1, 1 0", "a hole of no field"),
        ("%: swath -3", "-3"),
        ("%: swath x", "swath"),
    ],
)
def test_a_field_that_is_none_is_refused(eadp, tmp_path, header, words):
    (tmp_path / "bad.plan").write_text(f"{header}\n{STAGES}")
    assert refused(eadp("plan", tmp_path / "bad.plan"), "bad.plan:1:")


def test_a_field_that_crosses_itself_is_left_out_with_a_warning():
    read, findings = plan(f"%: field 0 0, 100 100, 100 0, 0 100\n{STAGES}")
    assert read.site.field is None
    assert [finding.code for finding in findings if "crosses itself" in finding.message] == ["field"]


def test_a_line_without_the_camera_covers_nothing():
    def on(distance_m):
        return f"%: command 206 {distance_m} 0 1 0 0 0 0\n"

    first, turn, last = ("".join(f"{line}\n" for line in STAGES.splitlines()[i : i + 2]) for i in (0, 2, 4))
    whole, _ = plan(FIELD + on(5) + first + on(0) + turn + on(5) + last)
    assert covering_stages(whole) == covering_stages(plan(FIELD + STAGES)[0]) == [True, False, True]
    transit, _ = plan(FIELD + first + turn + on(5) + last)
    assert covering_stages(transit) == [False, False, True]
    (line,) = planned_lines(transit, ())
    assert np.array(line) == pytest.approx(np.array([(150, 80), (0, 80)]))
    # turns with the camera on cover nothing: they are banked
    assert covering_stages(plan(FIELD + on(5) + first + turn + last)[0]) == [True, False, True]


def test_lines_cover_and_turns_do_not():
    read, _ = plan(FIELD + STAGES)
    log = columns([1, 1, 2, 2, 3, 3], [0.0, 100, 150, 180, 150, 0], [20.0, 20, 20, 50, 80, 80])
    assert flown_lines(read, log) == [((0, 20), (100, 20), (150, 20)), ((150, 80), (0, 80))]
    # the field has 20,000 m² less the hole's 800; the lines cover 150 m × 40 m each
    assert flown_coverage(read, log) == pytest.approx(2 * 150 * 40 / 19_200)


def test_it_is_unknown_without_a_field_a_swath_or_a_fine_log():
    log = columns([1, 1], [0.0, 50], [20.0, 20])
    for text in (STAGES, "\n".join(FIELD.splitlines()[:2]) + "\n" + STAGES):
        assert flown_coverage(plan(text)[0], log) is None
    assert flown_coverage(plan(FIELD + STAGES)[0], {**log, "time_s": [0.0, 3.0]}) is None


@pytest.mark.slow
@pytest.mark.usefixtures("drawn")
def test_a_flight_over_a_field(tmp_path):
    path = tmp_path / "field.plan"
    path.write_text(FIELD + STAGES)
    flight = library.simulate(path, overrides=FLIGHT)
    flight.write(tmp_path / "out")
    share = json.loads((tmp_path / "out/summary.json").read_text())["coverage"]
    assert 0.3 < share < 0.65
    page = Page((tmp_path / "out/report.html").read_text(encoding="utf-8"))
    page.check()
    assert page.data["field"]["rings"][0] == [[0, 0], [200, 0], [200, 100], [0, 100]]
    assert len(page.data["field"]["rings"]) == 2


def test_the_way_home_is_left_out():
    columns = {"time_s": [0.0, 1.0, 2.0], "x_m": [0.0, 5.0, 9.0]}
    assert flown_of_plan(columns, 1.0) == {"time_s": [0.0, 1.0], "x_m": [0.0, 5.0]}
    assert flown_of_plan(columns, None) == columns

"""Several flights on one page: the figure, the table, and what is refused."""

import base64
import json
import re
import shutil

import pytest
from common import ROOT
from common.answers import refused

from eadp import simulate
from eadp.report.report import comparison, read_flights, table_text

PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two flights that differ, and one that falls."""
    found, place = [], tmp_path_factory.mktemp("flights")
    for name, keys in (
        ("high", {"planner.name": "static", "battery.capacity_ah": 1.0}),
        ("low", {"planner.name": "paper", "battery.capacity_ah": 1.0, "parameters.c2": 2}),
        ("fallen", {"planner.name": "static", "battery.capacity_ah": 0.05}),
    ):
        flight = simulate(PLAN, scenario=SCENARIO, overrides={"step_s": 0.05, **keys}, warn=lambda _: None)
        flight.write(place / name)
        found.append(str(place / name))
    return found


def test_the_page_opens_without_a_fault(eadp, browser, folders, tmp_path):
    page = tmp_path / "page.html"
    assert eadp("report", *folders, "-o", page).code == 0
    browser.faults.clear()
    browser.open(page)
    assert browser.faults == []
    assert browser.run("document.querySelectorAll('#differences tbody tr').length") > 5


def test_the_page_has_the_table_and_the_figure(eadp, folders, tmp_path):
    page = tmp_path / "page.html"
    answer = eadp("report", *folders, "-o", page)
    assert answer.code == 0, answer.err
    text = page.read_text()
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1])
    assert base64.b64decode(data["figure"]) == page.with_suffix(".svg").read_bytes()
    assert page.with_suffix(".png").stat().st_size > 10_000
    assert table_text(data["table"]) in answer.out
    assert data["plans"] == ["survey.plan"]


def test_the_table_is_the_summaries(folders):
    flights = read_flights(folders)
    table = {row[0]: row[1:] for row in comparison(flights)}
    # two planners are one: the folders name them
    assert table[""] == ["high", "low", "fallen: NOT completed"]
    assert table["completed"][:2] == ["yes", "yes"]
    assert table["completed"][2].startswith("NO: battery empty")
    for i, flight in enumerate(flights):
        assert float(table["energy [Wh]"][i]) == pytest.approx(flight.summary["energy_wh"], abs=6e-4)
        assert float(table["quality"][i]) == pytest.approx(flight.summary["quality"], abs=6e-4)
    assert table["fps"][0] == "10, no change"


def test_planners_name_flights_where_they_differ(folders):
    assert [flight.name for flight in read_flights(folders[:2])] == ["static", "paper"]


@pytest.mark.slow
def test_a_parameter_of_one_flight_alone_is_drawn_of_it(eadp, folders, tmp_path):
    field = ROOT / "plans/meadow.geojson"
    assert eadp("cover", field, "--swath", "60", "--min-radius", "30", "-o", tmp_path / "meadow.plan").code == 0
    meadow = simulate(str(tmp_path / "meadow.plan"), overrides={"step_s": 0.1}, warn=lambda _: None)
    meadow.write(tmp_path / "meadow")
    for order in ([tmp_path / "meadow", folders[0]], [folders[0], tmp_path / "meadow"]):
        answer = eadp("report", *order, "-o", tmp_path / "page.html")
        assert answer.code == 0, answer.err
        assert "fps" in answer.out
    decisions = {row.split("  ")[0]: row for row in answer.out.splitlines()}["re-plannings"]
    assert f" {len(meadow.decisions)}, failed" in decisions


@pytest.mark.slow
def test_what_is_refused(eadp, folders, tmp_path):
    page = tmp_path / "page.html"
    assert refused(eadp("report", folders[0], folders[0], "-o", page), "stands twice")
    assert refused(eadp("report", folders[0], PLAN, "-o", page), "is no folder of a flight")
    assert refused(eadp("report", folders[0], folders[1], "--keep", "x", "-o", page), "no --keep beside several")
    page.write_text("mine")
    assert refused(eadp("report", *folders, "-o", page), "is no page of eadp")
    assert refused(eadp("report", folders[0], "-o", page), "is no page of eadp")
    (tmp_path / "thesis.svg").write_text("mine")
    assert refused(eadp("report", *folders, "-o", tmp_path / "thesis.html"), "is no picture of this page")
    assert (tmp_path / "thesis.svg").read_text() == "mine"
    assert page.read_text() == "mine"


def test_a_damaged_result_is_a_fault_of_its_file(eadp, folders, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(folders[0], damaged)
    (damaged / "summary.json").write_text("{}")
    page = tmp_path / "page.html"
    assert refused(eadp("report", damaged, folders[1], "-o", page), "is damaged")
    assert not page.exists()

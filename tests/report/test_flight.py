"""The page of a flight: its data are the folder's, and the command makes it again."""

from __future__ import annotations

import csv
import json
import math
import shutil

import numpy as np
import pytest
from common.answers import refused
from common.pages import Page
from scipy.integrate import trapezoid

import eadp as library

MAX_BYTES = 3_000_000


@pytest.fixture(scope="module")
def page(folder):
    return Page((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def log(folder):
    """The columns of `flight.csv`."""
    with (folder / "flight.csv").open(newline="") as stream:
        head, *rows = csv.reader(stream)
    return dict(zip(head, np.array(rows, dtype=float).T, strict=True))


@pytest.fixture(scope="module")
def decisions(folder):
    return [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()]


def test_the_page_is_whole_and_small(folder, page):
    page.check()
    assert (folder / "report.html").stat().st_size < MAX_BYTES


def test_the_series_are_those_of_the_log(page, log):
    data = page.data
    rows = np.searchsorted(log["time_s"], np.array(data["path"]["t"]) - 1e-9)
    for series, name, column in (
        ("path", "x", "x_m"),
        ("path", "y", "y_m"),
        ("power", "w", "power_w"),
        ("power", "forecast_w", "power_forecast_w"),
        ("charge", "soc", "soc"),
    ):
        assert data[series][name] == pytest.approx(log[column][rows].tolist(), abs=1e-4), column
    turned = np.angle(np.exp(1j * (np.array(data["path"]["heading"]) - log["heading_rad"][rows])))
    assert np.abs(turned).max() < 1e-4


def test_parameters_and_stages_are_exact(page, log):
    apart_m = 150 - 2 * np.sqrt(4900 + log["c1"])
    spacing, fps = page.data["parameters"]
    assert (spacing["name"], spacing["unit"], fps["name"]) == ("spacing", "m", "fps")
    for series, values in ((spacing, apart_m), (fps, log["c2"]), (page.data["stage"], log["stage"])):
        at = np.searchsorted(series["t"], log["time_s"] + 1e-9, side="right") - 1
        assert np.array(series["v"])[at] == pytest.approx(values, abs=1e-9)
    assert (spacing["low"], spacing["high"]) == pytest.approx((150 - 2 * 3900**0.5, 10))
    assert (fps["low"], fps["high"]) == (2, 10)


def test_decisions_keep_what_was_forecast_beside_what_came(page, decisions, log):
    shown = page.data["decisions"]
    assert len(decisions) == len(shown["time_s"])
    for i in (0, 7, len(decisions) - 1):
        row = decisions[i]
        assert shown["time_s"][i] == row["time_s"]
        assert shown["reason"]["of"][shown["reason"]["at"][i]] == row["reason"]
        assert shown["soc_end"][i] == pytest.approx(row["soc_end"], rel=1e-5)
        assert shown["wind_mps"]["of"][shown["wind_mps"]["at"][i]] == pytest.approx(row["wind_mps"], rel=1e-5)
        after = log["time_s"] >= row["time_s"]
        assert shown["used_after_wh"][i] == pytest.approx(
            trapezoid(log["power_w"][after], log["time_s"][after]) / 3600, abs=2e-3
        )
    changed = [row["parameters"] for row, new in zip(decisions, shown["changed"], strict=True) if new]
    assert len(changed) >= 1
    assert changed[0]["c1"] < 0


def test_the_plan_in_force_is_flown(page, log):
    """The aircraft is near the lines of the plan in force, wherever it is."""
    routes = page.data["plan"]["routes"]
    assert routes[0][0] == 0
    assert len(routes) == page.data["plan"]["shown"] == len(page.data["parameters"][0]["v"])
    rows = range(200, len(log["time_s"]), 97)
    for i in rows:
        line = np.reshape(next(line for time_s, line in reversed(routes) if time_s <= log["time_s"][i]), (-1, 2))
        start, along = line[:-1], np.diff(line, axis=0)
        point = np.array([log["x_m"][i], log["y_m"][i]])
        share = np.clip(((point - start) * along).sum(1) / np.maximum((along**2).sum(1), 1e-9), 0, 1)
        assert np.hypot(*(start + share[:, None] * along - point).T).min() < 25


def test_laps_are_counted(page, decisions):
    laps = page.data["lap"]
    for row in decisions[::50]:
        at = np.searchsorted(laps["t"], row["time_s"], side="right") - 1
        assert abs(laps["v"][at] - row["lap"]) <= (row["cause"] == "new stage")


def test_the_words_are_the_summarys(folder, page):
    summary, facts = json.loads((folder / "summary.json").read_text()), dict(page.data["facts"])
    assert page.data["words"][0].startswith("completed: final point reached after ")
    assert facts["energy"].startswith(f"{summary['energy_wh']:.3f} Wh; power mean ")
    assert facts["spacing"].startswith("mean ")


def test_the_command_makes_the_same_page(eadp, folder, tmp_path):
    copy = shutil.copytree(folder, tmp_path / "copy")
    (copy / "report.html").unlink()
    answer = eadp("report", copy)
    assert (answer.code, answer.err) == (0, "")
    assert (copy / "report.html").read_bytes() == (folder / "report.html").read_bytes()
    assert library.report(copy) == str(copy / "report.html")
    assert eadp("report", copy, "-o", "-").out == (folder / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "body", "words"),
    [
        ("summary.json", "{", "summary.json:1:2: error: is not JSON"),
        ("summary.json", "{}", "summary.json:1:1: error: is damaged"),
        ("flight.csv", "", "flight.csv:1:1: error: is damaged"),
        ("flight.csv", "time_s,stage\n", "flight.csv:1:1: error: is damaged"),
        ("flight.csv", "time_s,stage\n1,x\n", "flight.csv:1:1: error: is damaged: ValueError: could not convert"),
        ("flight.csv", "time_s,stage\n1,1\n", "is damaged"),
        ("decisions.jsonl", '{"time_s": 1}\nx\n', "decisions.jsonl:2:1: error: is not JSON"),
        ("inputs/plan/survey.plan", "0.1; 90; x +\n1, 2\n", "inputs/plan/survey.plan:1:13: error"),
    ],
)
def test_a_damaged_folder_is_refused_and_nothing_written(eadp, folder, tmp_path, name, body, words):
    copy = shutil.copytree(folder, tmp_path / "copy")
    before = (copy / "report.html").read_bytes()
    (copy / name).write_text(body)
    refused(eadp("report", copy), words)
    assert (copy / "report.html").read_bytes() == before


def test_other_columns_and_a_climb(eadp, folder, tmp_path):
    """Latitude and longitude are shown, an altitude that varies has a chart, and what is not known is no fault."""
    copy = shutil.copytree(folder, tmp_path / "copy")
    with (copy / "flight.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for i, row in enumerate(rows):
        row |= {"altitude_m": 20 + i / 100, "lat_deg": 55 + i * 1e-6, "lon_deg": 10 - i * 1e-6, "novel_unit": i}
    with (copy / "flight.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    assert eadp("report", copy).code == 0
    data = Page((copy / "report.html").read_text(encoding="utf-8")).data
    times = [float(row["time_s"]) for row in rows]
    for shown, name, error in ((data["path"], "lat", 1e-5), (data["path"], "lon", 1e-5), (data["altitude"], "m", 0.5)):
        column = {"lat": "lat_deg", "lon": "lon_deg", "m": "altitude_m"}[name]
        assert np.abs(np.interp(times, shown["t"], shown[name]) - [row[column] for row in rows]).max() <= error * 1.001


def test_what_is_no_result_is_refused(eadp, tmp_path):
    (tmp_path / "empty").mkdir()
    refused(eadp("report", tmp_path / "empty"), "empty:1:1: error: is no folder of a flight")
    refused(eadp("report", tmp_path / "nothing"), "nothing:1:1: error: cannot be read")
    (tmp_path / "text.txt").write_text("hello\n")
    refused(eadp("report", tmp_path / "text.txt"), "text.txt:1:1: error: ")


def test_a_flight_that_does_not_complete(tmp_path, root):
    """The plan is a mission of 30 laps, and the battery is empty before its end; a planner without records."""
    flight = library.simulate(
        str(root / "plans/survey.plan"),
        str(root / "scenarios/survey.yaml"),
        overrides={"step_s": 0.05, "battery.capacity_ah": 0.1, "planner.name": "static"},
    )
    flight.write(tmp_path / "short")
    page = Page((tmp_path / "short/report.html").read_text(encoding="utf-8"))
    page.check()
    assert page.data["completed"] is False
    assert page.data["words"][0].startswith("NOT completed: battery empty")
    assert page.data["decisions"]["changed"] == []
    assert math.isclose(page.data["end"]["soc_final"], flight.summary["soc_final"])

"""The page of a flight on telemetry, from the log of `eadp replan`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from common import ROOT
from common.answers import refused
from common.pages import Page
from common.plans import ORIGIN, placed_survey

from eadp.cli.main import main
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.live.log_page import log_data
from eadp.report.flight import finished

PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")
TELEMETRY = ROOT / "scenarios/example-telemetry.jsonl"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A log of the first 200 lines, without power and position in some of them, and with a gap."""
    lines = [json.loads(line) for line in TELEMETRY.read_text().splitlines()[:200]]
    for line in lines[20:30]:
        line["power_w"] = None
    for line in lines[40:50]:
        line["x_m"] = line["y_m"] = None
    folder = tmp_path_factory.mktemp("log")
    flown = folder / "telemetry.jsonl"
    flown.write_text("".join(f"{json.dumps(line)}\n" for line in lines[:100] + lines[130:]))
    target = folder / "flight.log"
    main(["replan", PLAN, "--scenario", SCENARIO, "--telemetry", str(flown), "--log", str(target)])
    return target


@pytest.fixture
def log(made, tmp_path):
    """A copy of it."""
    return Path(shutil.copy(made, tmp_path))


def test_the_page_of_a_log(eadp, log):
    answer = eadp("report", log)
    assert (answer.code, answer.err) == (0, "")
    page = Page(log.with_suffix(".html").read_text(encoding="utf-8"))
    page.check()
    entries = [json.loads(line) for line in log.read_text().splitlines()[1:]]
    telemetry = [entry for entry in entries if entry["kind"] == "telemetry"]
    decided = [entry for entry in entries if entry["kind"] == "decision"]
    first_s = telemetry[0]["time_s"]
    path, shown = page.data["path"], page.data["decisions"]
    assert shown["count"] == len(decided)
    assert shown["soc_end"][3] == pytest.approx(decided[3]["soc_end_forecast"], rel=1e-5)
    known = [entry for entry in telemetry if entry["x_m"] is not None]
    times = np.array([entry["time_s"] - first_s for entry in known])
    whole = [(t, x) for t, x in zip(path["t"], path["x"], strict=True) if x is not None]
    assert np.abs(np.interp(times, *zip(*whole, strict=True)) - [entry["x_m"] for entry in known]).max() <= 0.31
    assert None in path["x"]  # the gap of 30 s
    assert page.data["words"][0].startswith("A flight on telemetry: 170 lines over 3 min 19 s")


def test_the_page_of_a_flight_over_a_link(eadp, tmp_path):
    """Positions on the earth and the charge drawn alone: a map, the charge that is left, parameters by their names."""
    plan, telemetry, log = placed_survey(tmp_path), tmp_path / "telemetry.jsonl", tmp_path / "flight.log"
    rows = [json.loads(line) for line in TELEMETRY.read_text().splitlines()[:60]]
    drawn_ah = np.linspace(0.0, 0.3, len(rows)).tolist()
    linked = [
        dict(zip(("lat_deg", "lon_deg"), to_geodetic_deg(row["x_m"], row["y_m"], ORIGIN), strict=True))
        | {"time_s": row["time_s"], "power_w": row["power_w"], "current_consumed_ah": ah}
        for row, ah in zip(rows, drawn_ah, strict=True)
    ]
    telemetry.write_text("".join(f"{json.dumps(row)}\n" for row in linked))
    assert eadp("replan", plan, "--scenario", SCENARIO, "--telemetry", telemetry, "--log", log).out
    head, *lines = map(json.loads, log.read_text().splitlines())

    def shown(head):
        text = "".join(f"{json.dumps(line)}\n" for line in (head, *lines))
        return finished(log_data(Text("flight.log", text)))

    page = shown(head)
    for name, i in (("x", 0), ("y", 1)):
        moved_m = [row[f"{name}_m"] - rows[0][f"{name}_m"] for row in rows]
        times = [row["time_s"] - rows[0]["time_s"] for row in rows]
        assert np.interp(times, page["path"]["t"], page["path"][name]) == pytest.approx(moved_m, abs=0.31), i
    left = 1 - drawn_ah[-1] * head["soc_per_ah"]
    assert (page["charge"]["soc"][-1], page["end"]["soc_final"], page["drawn"]) == (
        pytest.approx(left, abs=1e-3),
        pytest.approx(left),
        None,
    )
    plan_read = read_plan(read_text(str(plan)))[0]
    decided = next(line for line in lines if line["kind"] == "decision")["parameters"]
    assert {one["name"] for one in page["parameters"]} == {item.label for item in plan_read.parameters}
    assert page["decisions"]["parameters"]["of"][0] == pytest.approx(plan_read.shown(decided), rel=1e-5)
    # a log of a version that did not keep the battery has what was drawn
    old = shown({key: head[key] for key in ("kind", "schema", "eadp", "inputs")})
    assert (old["charge"]["soc"], old["drawn"]["ah"][-1]) == ([], pytest.approx(0.3, abs=1e-3))
    assert {one["name"] for one in old["parameters"]} == {*decided}


@pytest.mark.parametrize("flight", ["level", "upload-in-flight", "px4/untouched", "second/Z"])
def test_pages_of_flights_beside_an_autopilot(flight):
    path = ROOT.parent / "shared/reference/autopilot" / flight / "log.jsonl"
    if not path.is_file():
        pytest.skip("the recordings are not there")
    page = finished(log_data(read_text(str(path))))
    assert np.ptp([x for x in page["path"]["x"] if x is not None]) > 100
    assert page["charge"]["soc"] or page["drawn"]["ah"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda lines: ["{}", *lines[1:]], "1:1: error: is no log of eadp replan"),
        (lambda lines: lines[:1], "1:1: error: has no telemetry"),
        (lambda lines: [*lines[:2], "{"], "3:2: error: is not JSON"),
        (lambda lines: [*lines[:2], '{"kind": "telemetry"}'], "is damaged"),
        (lambda lines: [*lines[:2], '{"kind": "decision", "time_s": 9}'], "is damaged"),
    ],
)
def test_a_damaged_log_is_refused(eadp, log, change, words):
    log.write_text("\n".join(change(log.read_text().splitlines())))
    assert refused(eadp("report", log), words)
    assert not log.with_suffix(".html").exists()

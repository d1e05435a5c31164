"""The page of a flight on telemetry, from the log of `eadp replan`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from common import ROOT
from common.answers import refused
from common.pages import Page

PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")
TELEMETRY = ROOT / "scenarios/example-telemetry.jsonl"


@pytest.fixture
def log(eadp, tmp_path):
    """A log of the first 200 lines, without power and position in some of them, and with a gap."""
    lines = [json.loads(line) for line in TELEMETRY.read_text().splitlines()[:200]]
    for line in lines[20:30]:
        line["power_w"] = None
    for line in lines[40:50]:
        line["x_m"] = line["y_m"] = None
    flown = tmp_path / "telemetry.jsonl"
    flown.write_text("".join(f"{json.dumps(line)}\n" for line in lines[:100] + lines[130:]))
    target = tmp_path / "flight.log"
    eadp("replan", PLAN, "--scenario", SCENARIO, "--telemetry", flown, "--log", target)
    return target


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

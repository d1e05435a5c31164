"""The page of a flight: its data are the folder's, the command makes it again, and a browser opens it."""

import csv
import json
import math
import re
import shutil

import numpy as np
import pytest
from common import ROOT
from common.answers import refused
from common.pages import Page
from scipy.integrate import trapezoid

import eadp as library
from eadp.report.page import page_html

MAX_BYTES = 3_000_000
PLAN, SCENARIO = str(ROOT / "plans/survey.plan"), str(ROOT / "scenarios/survey.yaml")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The result folder of the survey with the planner joint: it completes, and c1 changes."""
    target = tmp_path_factory.mktemp("pages") / "survey"
    library.simulate(PLAN, SCENARIO, overrides={"step_s": 0.05}).write(target)
    return target


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


def test_what_the_page_asks_of_a_decision_is_a_key_of_it(decisions):
    script = (ROOT / "eadp/report/assets/flight.js").read_text(encoding="utf-8")
    assert {*re.findall(r'decided\("(\w+)"', script)} <= {*decisions[0]}


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


@pytest.mark.slow
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


@pytest.mark.slow
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


# --- in a browser

SIZES = [(1440, 900, False), (820, 1100, False), (390, 844, True)]


@pytest.fixture
def shown(browser, folder):
    browser.faults.clear()
    browser.open(folder / "report.html")
    yield browser
    assert browser.faults == []


def picture(browser):
    """The map as it is drawn."""
    return browser.run("$('map').toDataURL()")


@pytest.mark.quick(1)
@pytest.mark.parametrize(("width", "height", "phone"), SIZES[::-1])
@pytest.mark.parametrize("dark", [False, True])
def test_it_opens_without_a_fault_at_every_size(browser, folder, tmp_path, width, height, phone, dark):
    browser.faults.clear()
    browser.open(folder / "report.html", width, height, dark=dark, phone=phone)
    assert browser.faults == []
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")  # nothing to scroll to the side
    assert browser.run("document.querySelectorAll('.chart canvas').length") >= 4
    browser.picture(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 30_000


def test_the_words_and_figures_are_shown(shown, folder):
    data = Page((folder / "report.html").read_text(encoding="utf-8")).data
    assert shown.run("[...document.querySelectorAll('#words p')].map((p) => p.textContent)") == data["words"]
    assert shown.run("document.title") == "survey.plan"
    assert shown.run("document.querySelectorAll('#figures tr').length") == len(data["facts"]) + 1


@pytest.mark.parametrize(("kept", "word"), [("true", "yes"), ("false", "no"), ("null", "–")])
def test_the_reserve_is_kept_in_the_table_as_in_the_words(shown, kept, word):
    """Of a flight that returned home with its reserve, too, which did not complete."""
    shown.run(f"data.completed = false, data.reserve_kept = {kept}, setTime(250), showDecision()")
    rows = shown.run("[...document.querySelectorAll('#decision-now tr')].map((one) => one.textContent)")
    (row,) = [one for one in rows if one.startswith("keeps the reserve")]
    assert row.endswith(word)


@pytest.mark.slow
def test_the_cursor_moves_what_it_should(shown, folder):
    def state():
        return shown.run(
            "({clock: $('clock').textContent, now: $('now').textContent, label: $('map').getAttribute('aria-label'),"
            "decision: $('decision-now').textContent, slider: +$('time').value,"
            "lines: [...document.querySelectorAll('.cursor-line')].map((line) => line.style.transform)})"
        )

    shown.run("setTime(100)")
    before, drawn = state(), picture(shown)
    assert before["clock"].startswith("1 min 40.0 s of ")
    assert before["label"].startswith("Map at 1 min 40.0 s: stage ")
    shown.run("setTime(250)")
    after = state()
    assert after["slider"] == 250
    assert before["now"] != after["now"]
    assert before["decision"] != after["decision"]
    assert picture(shown) != drawn
    assert len(after["lines"]) >= 4
    assert all(a != b for a, b in zip(before["lines"], after["lines"], strict=True))
    shown.run("setTime(1e9)")
    duration_s = json.loads((folder / "summary.json").read_text())["duration_s"]
    assert shown.run("state.t") == pytest.approx(duration_s)


@pytest.mark.slow
def test_the_keyboard(shown):
    shown.run("setTime(200)")
    for key, shift, t in (("ArrowRight", False, 201), ("ArrowLeft", False, 200), ("ArrowRight", True, 210)):
        shown.press(key, shift=shift)
        assert shown.run("state.t") == pytest.approx(t)
    shown.press("Home")
    assert shown.run("state.t") == 0
    shown.press("ArrowDown")
    assert shown.run("decisions.changed[state.decision]")
    shown.press(" ")
    assert shown.run("state.playing")
    start_s = shown.run("new Promise((done) => setTimeout(() => done(state.t), 300))")
    shown.press(" ")
    assert not shown.run("state.playing")
    assert shown.run("state.t") >= start_s > 5
    speed = shown.run("state.speed")
    shown.press("+")
    assert shown.run("state.speed") > speed
    shown.press("End")
    assert shown.run("state.t === END")


def test_a_decision_is_opened_by_a_click(shown, folder):
    rows = [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()]
    x, y = shown.run(
        "(() => { $('decision-list').scrollIntoView({block: 'center'});"
        "const box = document.querySelector('#decision-list tr[data-at]').getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2]; })()"
    )
    shown.click(x, y)
    at = shown.run("state.decision")
    assert shown.run("state.t") == rows[at]["time_s"]
    text = shown.run("$('decision-now').textContent")
    assert rows[at]["reason"] in text
    assert "forecast then" in text
    assert shown.run("document.querySelector('#decision-list tr[aria-current]').dataset.at") == str(at)


def test_a_click_on_the_map_goes_to_its_decision(shown):
    shown.run("scrollTo(0, 0)")
    x, y, t = shown.run(
        "(() => { const i = decisions.changed.indexOf(true), box = map.getBoundingClientRect();"
        "const t = decisionTimes[i];"
        "return [box.x + px(at(path, 'x', t)), box.y + py(at(path, 'y', t)), t]; })()"
    )
    shown.click(x, y)
    assert shown.run("state.t") == t


def test_parameters_are_drawn_from_their_low_end_to_their_high_one(shown):
    """Also where the low end shows the greater value, as a spacing does."""
    spacing, fps = shown.run("data.parameters.map((one) => [one.low, one.high])")
    assert spacing[0] > spacing[1]
    assert fps == [2, 10]
    shares = "data.parameters.map((one) => [one.low, (one.low + one.high) / 2, one.high].map((v) => shareOf(one, v)))"
    assert shown.run(shares) == [[0, 0.5, 1], [0, 0.5, 1]]


def test_text_alternatives(shown):
    pictures = "canvas:not([aria-hidden]):not(.uplot canvas), .uplot"
    assert shown.run(f"[...document.querySelectorAll('{pictures}')].every((c) => c.getAttribute('aria-label'))")
    named = "e.textContent || e.labels?.length || e.getAttribute('aria-label')"
    assert shown.run(f"[...document.querySelectorAll('button, input, select')].every((e) => {named})")


NASTY = "<script>window.struck = 1</script><img src=x onerror='window.struck = 2'>\u2028"


def test_data_are_shown_as_text_and_never_run(browser, folder, tmp_path):
    browser.faults.clear()
    data = Page((folder / "report.html").read_text(encoding="utf-8")).data
    data["title"] = data["words"][0] = data["facts"][0][1] = data["parameters"][1]["name"] = NASTY
    data["decisions"]["reason"]["of"] = [NASTY] * len(data["decisions"]["reason"]["of"])
    target = tmp_path / "nasty.html"
    target.write_text(page_html("flight", {k: v for k, v in data.items() if k not in ("schema", "kind", "version")}))
    browser.open(target)
    assert browser.run("document.title") == NASTY
    assert browser.run("$('title').textContent") == NASTY
    assert browser.run("document.querySelectorAll('#words p')[0].textContent") == NASTY
    assert NASTY in browser.run("$('decision-now').textContent")
    assert NASTY in browser.run("$('charts').textContent")
    assert browser.run("typeof window.struck") == "undefined"
    assert browser.run("document.querySelectorAll('img, main script').length") == 0
    assert browser.faults == []


def test_the_policy_refuses_any_other_script(browser, folder):
    browser.open(folder / "report.html")
    browser.run(
        "(() => { const s = document.createElement('script'); s.textContent = 'window.struck = 3';"
        "document.body.append(s); })()"
    )
    assert browser.run("typeof window.struck") == "undefined"
    assert any("Content Security Policy" in fault for fault in browser.faults)
    browser.faults.clear()

"""The page of a sweep: counts over all runs, the runs themselves, links to the flights that were kept."""

import json
from contextlib import closing

import pytest
from common.answers import refused
from common.pages import Page

from eadp.sweep import page as sweep_page
from eadp.sweep.engines import Result, Run
from eadp.sweep.results import Results, wilson_interval

LINE = "0.1; 90; x\n0, 400\n"
SWEEP = """schema: eadp.sweep/1
plan: line.plan
grid:
  wind.speed_mps: [0, 4]
  battery.capacity_ah: [0.003, 3]
  planner: [static, joint]
seeds: 2
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """A sweep of 16 short flights, their folders, and its page."""
    from eadp.cli.main import main

    folder = tmp_path_factory.mktemp("sweep")
    (folder / "line.plan").write_text(LINE)
    (folder / "sweep.yaml").write_text(SWEEP)
    command = ["sweep", str(folder / "sweep.yaml"), "-o", str(folder / "results.db"), "--jobs", "1"]
    assert main([*command, "--keep", str(folder / "kept"), "--set", "step_s=0.05"]) == 0
    return folder


@pytest.fixture(scope="module")
def page(swept):
    return Page((swept / "results.html").read_text(encoding="utf-8"))


def rows_of(path):
    with closing(Results(str(path), read_only=True)) as results:
        return list(results.everything(1000))


def test_the_page_has_every_run(swept, page):
    page.check()
    rows, runs = rows_of(swept / "results.db"), page.data["runs"]
    assert page.data["keys"] == ["battery.capacity_ah", "planner.name", "wind.speed_mps", "seed"]
    assert page.data["count"] == len(rows) == 16
    for i, row in enumerate(rows):
        assert runs["values"]["wind.speed_mps"][i] == row["overrides"]["wind.speed_mps"]
        planner = runs["values"]["planner.name"]
        assert planner["of"][planner["at"][i]] == row["overrides"]["planner.name"]
        assert runs["completed"][i] == row["completed"]
        assert runs["duration_s"][i] == pytest.approx(row["duration_s"], rel=1e-5)
        assert runs["reason"]["of"][runs["reason"]["at"][i]] == row["reason"]


def test_the_words_have_the_interval(page):
    runs = page.data["runs"]
    done = sum(runs["completed"])
    assert 0 < done < 16
    assert done % 2 == 0, "two seeds of a calm flight"
    low, high = wilson_interval(done // 2, 8)
    assert page.data["words"][0].startswith(f"{done} of 16 flights completed: {100 * done / 16:.3g} %")
    assert f"(95 % interval of 8 distinct flights {100 * low:.3g} % to {100 * high:.3g} %)" in page.data["words"][0]


def test_kept_folders_are_those_of_the_runs_and_change_no_result(swept, page, eadp, tmp_path):
    assert page.data["folder"] == "kept"
    rows = rows_of(swept / "results.db")
    assert page.data["runs"]["folder"] == [row["key"] for row in rows]
    for row in rows:
        summary = json.loads((swept / "kept" / row["key"] / "summary.json").read_text())
        assert (summary["completed"], summary["duration_s"]) == (row["completed"], row["duration_s"])
    eadp("sweep", swept / "sweep.yaml", "-o", tmp_path / "plain.db", "--jobs", "1", "--set", "step_s=0.05")
    plain = rows_of(tmp_path / "plain.db")
    assert [row | {"took_s": 0} for row in plain] == [row | {"took_s": 0} for row in rows]
    assert Page((tmp_path / "plain.html").read_text(encoding="utf-8")).data["folder"] is None
    assert eadp("report", swept / "kept" / rows[0]["key"]).code == 0


def test_the_command_makes_the_same_page(swept, eadp, tmp_path):
    before = (swept / "results.html").read_bytes()
    assert eadp("report", swept / "results.db", "--keep", swept / "kept").code == 0
    assert (swept / "results.html").read_bytes() == before
    assert eadp("report", swept / "results.db", "--keep", swept / "kept", "-o", tmp_path / "other.html").code == 0
    other = Page((tmp_path / "other.html").read_text(encoding="utf-8"))
    assert (tmp_path / other.data["folder"]).resolve() == (swept / "kept").resolve()


def test_a_file_of_another_is_kept_and_nothing_is_flown(swept, eadp, tmp_path):
    (tmp_path / "results.html").write_text("mine")
    answer = eadp("sweep", swept / "sweep.yaml", "--jobs", "1", "-o", tmp_path / "results.db")
    refused(answer, "results.html:1:1: error: exists already, and is no page of eadp")
    assert not (tmp_path / "results.db").exists()


def test_a_damaged_results_file_is_refused(swept, eadp, tmp_path):
    body = (swept / "results.db").read_bytes()
    (tmp_path / "cut.db").write_bytes(body[: len(body) // 2])
    refused(eadp("report", tmp_path / "cut.db"), "cut.db:1:1: error: ")


@pytest.fixture
def many(tmp_path):
    """A results file of 300 runs that were not flown, with names that are no names."""
    path = tmp_path / "many.db"
    runs = [
        Run(f"{i * 7919 % 300:04}", {"plan": "<b>p</b>"}, {"seed": i, "wind.speed_mps": i / 7, "faults": [i % 40]})
        for i in range(300)
    ]
    end = {"completed": True, "reason": "</script>", "duration_s": 1 / 3, "soc_final": 0.5, "quality": None}
    end |= {"reserve_kept": True, "energy_wh": 1.5, "distance_m": 700.0}
    with closing(Results(str(path))) as results:
        results.expect(run.key for run in runs)
        results.store([(run, Result(None, "<i>") if i % 10 == 3 else Result(end)) for i, run in enumerate(runs)])
    return path


def test_many_runs_are_a_sample_and_all_are_counted(many, monkeypatch, tmp_path):
    monkeypatch.setattr(sweep_page, "MAX_RUNS", 50)
    data = sweep_page.sweep_data(str(many), tmp_path / "x.html")
    assert (data["count"], data["failed"], len(data["runs"]["completed"])) == (300, 30, 50)
    assert data["words"][0].startswith("270 of 270 flights completed")
    assert data["words"][-1] == "The charts and the list show 50 of the 300 runs, a random sample."


# --- in a browser


@pytest.fixture
def opened(browser, swept):
    browser.faults.clear()
    browser.open(swept / "results.html")
    yield browser
    assert browser.faults == []


@pytest.mark.quick(1)
@pytest.mark.parametrize(("width", "height", "phone"), [(1440, 900, False), (820, 1100, False), (390, 844, True)])
def test_it_opens_without_a_fault_at_every_size(browser, swept, width, height, phone):
    browser.faults.clear()
    browser.open(swept / "results.html", width, height, phone=phone, dark=phone)
    assert browser.faults == []
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    assert browser.run("document.querySelectorAll('#heat button').length") == 4  # capacities and planners


def choose(browser, **chosen):
    for name, value in chosen.items():
        browser.run(f"(() => {{ $('{name}').value = '{value}'; $('{name}').dispatchEvent(new Event('change')); }})()")


def test_the_heat_map_over_any_two_keys(opened, page):
    choose(opened, figure="completed", across="wind.speed_mps", upward="battery.capacity_ah")
    labels = opened.run("[...document.querySelectorAll('#heat button')].map((b) => b.getAttribute('aria-label'))")
    assert [label.split(" (")[0] for label in labels] == [  # the highest row first
        "wind.speed_mps 0, battery.capacity_ah 3: share of flights that complete: 100 %",
        "wind.speed_mps 4, battery.capacity_ah 3: share of flights that complete: 100 %",
        "wind.speed_mps 0, battery.capacity_ah 0.003: share of flights that complete: 0 %",
        "wind.speed_mps 4, battery.capacity_ah 0.003: share of flights that complete: 0 %",
    ]
    assert [label.splitlines()[-1][:6] for label in labels] == ["4 of 4", "4 of 4", "0 of 4", "0 of 4"]
    choose(opened, figure="duration_s", across="planner.name", upward="")
    assert opened.run("document.querySelectorAll('#heat button').length") == 2


def test_the_interval_is_wilsons(opened):
    for successes, trials in ((0, 1), (1, 1), (3, 8), (200, 400), (9999, 10000)):
        assert opened.run(f"wilson({successes}, {trials})") == pytest.approx(wilson_interval(successes, trials))


def test_a_cell_lists_its_runs_with_their_flights(opened, page, swept):
    choose(opened, figure="completed", across="wind.speed_mps", upward="battery.capacity_ah")
    opened.run("document.querySelector('#heat button').click()")
    assert opened.run("$('runs-title').textContent") == "4 runs: wind.speed_mps 0, battery.capacity_ah 3"
    links = opened.run("[...document.querySelectorAll('#runs a')].map((a) => a.getAttribute('href'))")
    assert len(links) == 4
    for link in links:
        assert (swept / link).is_file()


def test_names_are_text(browser, many, eadp):
    browser.faults.clear()
    assert eadp("report", many).code == 0
    browser.open(many.with_suffix(".html"))
    assert browser.run("document.querySelectorAll('b, i').length") == 0
    assert "</script>" in browser.run("$('runs').textContent")
    assert "could not be made: <i>" in browser.run("$('runs').textContent")
    assert browser.faults == []

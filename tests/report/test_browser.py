"""The page of a flight in a real browser."""

import json

import pytest
from common.pages import Page

from eadp.io.page import page_html

SIZES = [(1440, 900, False), (820, 1100, False), (390, 844, True)]


@pytest.fixture
def page(browser, folder):
    browser.faults.clear()
    browser.open(folder / "report.html")
    yield browser
    assert browser.faults == []


def picture(browser):
    """The map as it is drawn."""
    return browser.run("$('map').toDataURL()")


@pytest.mark.quick(2)
@pytest.mark.parametrize(("width", "height", "phone"), SIZES)
@pytest.mark.parametrize("dark", [False, True])
def test_it_opens_without_a_fault_at_every_size(browser, folder, tmp_path, width, height, phone, dark):
    browser.faults.clear()
    browser.open(folder / "report.html", width, height, dark=dark, phone=phone)
    assert browser.faults == []
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")  # nothing to scroll to the side
    assert browser.run("document.querySelectorAll('.chart canvas').length") >= 4
    browser.picture(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 30_000


def test_the_words_and_figures_are_shown(page, folder):
    data = Page((folder / "report.html").read_text(encoding="utf-8")).data
    assert page.run("[...document.querySelectorAll('#words p')].map((p) => p.textContent)") == data["words"]
    assert page.run("document.title") == "survey.plan"
    assert page.run("document.querySelectorAll('#figures tr').length") == len(data["facts"]) + 1


@pytest.mark.parametrize(("kept", "word"), [("true", "yes"), ("false", "no"), ("null", "–")])
def test_the_reserve_is_kept_in_the_table_as_in_the_words(page, kept, word):
    """Of a flight that returned home with its reserve, too, which did not complete."""
    page.run(f"data.completed = false, data.reserve_kept = {kept}, setTime(250), showDecision()")
    rows = page.run("[...document.querySelectorAll('#decision-now tr')].map((one) => one.textContent)")
    (row,) = [one for one in rows if one.startswith("keeps the reserve")]
    assert row.endswith(word)


def test_the_cursor_moves_what_it_should(page, folder):
    def state():
        return page.run(
            "({clock: $('clock').textContent, now: $('now').textContent, label: $('map').getAttribute('aria-label'),"
            "decision: $('decision-now').textContent, slider: +$('time').value,"
            "lines: [...document.querySelectorAll('.cursor-line')].map((line) => line.style.transform)})"
        )

    page.run("setTime(100)")
    before, drawn = state(), picture(page)
    assert before["clock"].startswith("1 min 40.0 s of ")
    assert before["label"].startswith("Map at 1 min 40.0 s: stage ")
    page.run("setTime(250)")
    after = state()
    assert after["slider"] == 250
    assert before["now"] != after["now"]
    assert before["decision"] != after["decision"]
    assert picture(page) != drawn
    assert len(after["lines"]) >= 4
    assert all(a != b for a, b in zip(before["lines"], after["lines"], strict=True))
    page.run("setTime(1e9)")
    duration_s = json.loads((folder / "summary.json").read_text())["duration_s"]
    assert page.run("state.t") == pytest.approx(duration_s)


def test_the_keyboard(page):
    page.run("setTime(200)")
    for key, shift, t in (("ArrowRight", False, 201), ("ArrowLeft", False, 200), ("ArrowRight", True, 210)):
        page.press(key, shift=shift)
        assert page.run("state.t") == pytest.approx(t)
    page.press("Home")
    assert page.run("state.t") == 0
    page.press("ArrowDown")
    assert page.run("decisions.changed[state.decision]")
    page.press(" ")
    assert page.run("state.playing")
    start_s = page.run("new Promise((done) => setTimeout(() => done(state.t), 300))")
    page.press(" ")
    assert not page.run("state.playing")
    assert page.run("state.t") >= start_s > 5
    speed = page.run("state.speed")
    page.press("+")
    assert page.run("state.speed") > speed
    page.press("End")
    assert page.run("state.t === END")


def test_a_decision_is_opened_by_a_click(page, folder):
    rows = [json.loads(line) for line in (folder / "decisions.jsonl").read_text().splitlines()]
    x, y = page.run(
        "(() => { $('decision-list').scrollIntoView({block: 'center'});"
        "const box = document.querySelector('#decision-list tr[data-at]').getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2]; })()"
    )
    page.click(x, y)
    at = page.run("state.decision")
    assert page.run("state.t") == rows[at]["time_s"]
    text = page.run("$('decision-now').textContent")
    assert rows[at]["reason"] in text
    assert "forecast then" in text
    assert page.run("document.querySelector('#decision-list tr[aria-current]').dataset.at") == str(at)


def test_a_click_on_the_map_goes_to_its_decision(page):
    page.run("scrollTo(0, 0)")
    x, y, t = page.run(
        "(() => { const i = decisions.changed.indexOf(true), box = map.getBoundingClientRect();"
        "const t = decisionTimes[i];"
        "return [box.x + px(at(path, 'x', t)), box.y + py(at(path, 'y', t)), t]; })()"
    )
    page.click(x, y)
    assert page.run("state.t") == t


def test_parameters_are_drawn_from_their_low_end_to_their_high_one(page):
    """Also where the low end shows the greater value, as a spacing does."""
    spacing, fps = page.run("data.parameters.map((one) => [one.low, one.high])")
    assert spacing[0] > spacing[1]
    assert fps == [2, 10]
    shares = "data.parameters.map((one) => [one.low, (one.low + one.high) / 2, one.high].map((v) => shareOf(one, v)))"
    assert page.run(shares) == [[0, 0.5, 1], [0, 0.5, 1]]


def test_text_alternatives(page):
    pictures = "canvas:not([aria-hidden]):not(.uplot canvas), .uplot"
    assert page.run(f"[...document.querySelectorAll('{pictures}')].every((c) => c.getAttribute('aria-label'))")
    named = "e.textContent || e.labels?.length || e.getAttribute('aria-label')"
    assert page.run(f"[...document.querySelectorAll('button, input, select')].every((e) => {named})")


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

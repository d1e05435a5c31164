"""A page: self-contained, its data are data, its series at fewer times than were logged."""

import json
import re

import numpy as np
import pytest
from common import ROOT
from common.pages import Page

from eadp.errors import InputError
from eadp.io.text.json import significant
from eadp.report.flight import MAX_SAMPLES, changes, evenly, sampled
from eadp.report.page import check_page, data_json, page_html

NASTY = [
    "</script><script>alert(1)</script>", "<!--<script>", "a & b", "\u2028\u2029", "{{scripts}}", "\ud800", "]]>", "é",
]  # fmt: skip


def test_data_come_back_as_they_were_and_cannot_end_their_block():
    text = data_json({"names": NASTY})
    assert json.loads(text) == {"names": NASTY}
    assert text.isascii()
    assert not set(text) & set("<>&")


def test_numbers_that_json_lacks_are_refused():
    with pytest.raises(ValueError, match="JSON"):
        data_json({"x": float("nan")})


def test_a_page_is_whole_and_allows_its_own_scripts_alone():
    page = Page(page_html("flight", {"title": NASTY[0], "words": NASTY}))
    page.check()
    assert page.data["words"] == NASTY
    assert page.data["schema"] == "eadp.report/1"
    assert not any("alert(1)" in script for script in page.scripts)


def test_the_library_has_its_licence():
    html = page_html("flight", {})
    assert "uPlot" in html
    assert "The MIT License (MIT)" in html
    assert "Leon Sorokin" in html


def test_scripts_insert_text_alone():
    written = r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(|new Function|DOMParser"
    for path in (ROOT / "eadp/report/assets").glob("*.js"):
        assert not re.search(written, path.read_text(encoding="utf-8")), path.name


def test_a_file_that_is_no_page_is_not_replaced(tmp_path):
    page, other = tmp_path / "page.html", tmp_path / "other.html"
    page.write_text(page_html("flight", {}))
    other.write_text("<html>mine</html>")
    check_page(page)
    check_page(tmp_path / "none.html")
    with pytest.raises(InputError, match="no page of eadp"):
        check_page(other)


def test_a_long_series_keeps_rows_evenly():
    times = [0.1 * i for i in range(12_001)]
    series = sampled({"t": times, "lat": times, "w": [1 / 3] * len(times)})
    assert len(series["t"]) <= MAX_SAMPLES
    assert series["t"][-1] == 1200.0
    assert series["lat"] == series["t"]
    assert set(series["w"]) == {0.3333}


def test_changes_are_kept_exactly():
    times = [float(i) for i in range(10)]
    assert changes(times, [1, 1, 2, 2, 2, 1, 1, 1, 1, 1]) == {"t": [0, 2, 5], "v": [1, 2, 1]}


@pytest.mark.parametrize(("count", "limit"), [(0, 3), (3, 3), (10, 3), (11, 3), (1000, 7)])
def test_evenly_keeps_the_last(count, limit):
    kept = evenly(count, limit)
    assert len(kept) <= limit
    assert kept[-1:] == [count - 1][: bool(count)]
    assert len({*np.diff(kept).tolist()}) <= 1


def test_significant_digits():
    assert significant(1234.5678, 3) == 1230
    assert significant(None) is significant(float("inf")) is None

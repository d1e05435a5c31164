"""Measured figures stand in docs/measured, which benchmarks write; pages link there, and the README quotes a few.

A figure is followed there by a comment with its file, row and column: `0.9<!-- quality.md: joint; U, all -->`.
`PYTHONPATH=tests/support python tests/test_measured.py` writes the present figures into it.
"""

import re
import shlex
import sys

import pytest
from common import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
from measured import PAGES, age

README, FOLDER = ROOT / "README.md", ROOT / "docs/measured"
FIGURE = re.compile(r"([+-]?[\d.,?]+(?: ± [\d.]+)?)<!-- (\w+\.md): ([^;]+); (.+?) -->")
MAX_FIGURES = 16
LINKING = [README, *sorted(ROOT.glob("docs/*.md"))]
LINKED = sorted(
    {name for page in LINKING for name in re.findall(r"measured/(\w+\.md)", page.read_text(encoding="utf-8"))}
)


def body(name):
    """The text of a measured file."""
    path = FOLDER / name
    assert path.exists(), f"docs/measured/{name} is missing: run its benchmark with --write (docs/contributing.md)"
    return path.read_text(encoding="utf-8")


def cells(row):
    return [cell.strip() for cell in row.strip().strip("|").split("|")]


def cell(name, row, column):
    """The first cell of a file's tables in a row, by its first cell, and a column, by its title."""
    before, titles = "", []
    for text in body(name).splitlines():
        if text.startswith("|---"):
            titles = cells(before)
        elif text.startswith("| ") and column in titles and cells(text)[0] == row:
            return cells(text)[titles.index(column)]
        before = text
    pytest.fail(f"docs/measured/{name} has no row {row!r} with a column {column!r}")


def test_the_readme_quotes_few_figures():
    quoted = FIGURE.findall(README.read_text(encoding="utf-8"))
    assert 1 <= len(quoted) <= MAX_FIGURES
    assert len(quoted) == len(re.findall(r"<!-- \w+\.md:", README.read_text(encoding="utf-8")))


def test_a_figure_of_the_readme_is_that_of_its_file():
    found = FIGURE.findall(README.read_text(encoding="utf-8"))
    stale = [f"{figure} of docs/measured/{name}" for figure, name, *at in found if figure != cell(name, *at)]
    assert stale == [], "these files have other figures: see this test's module"


def test_a_measured_file_names_its_command_date_and_machine():
    for name in LINKED:
        text = body(name)
        command = re.search(r"^    (python benchmarks/\S+\.py.*)$", text, re.MULTILINE)
        assert command, f"{name}: no command"
        assert (ROOT / shlex.split(command[1])[1]).exists()
        assert re.search(r"^\d{4}-\d\d-\d\d, \d+ cores, .*Python 3\.\d+", text, re.MULTILINE), (
            f"{name}: no date and machine"
        )
        assert re.search(r"^(\||- )", text, re.MULTILINE), f"{name}: nothing measured"


@pytest.mark.parametrize("name", sorted({name for _, name, *_ in FIGURE.findall(README.read_text("utf-8"))}))
def test_a_figure_of_the_readme_is_of_this_code_or_has_its_date(name):
    why, link = age(name.removesuffix(".md")), re.escape(f"](docs/measured/{name})")
    date = re.search(r"^\d{4}-\d\d-\d\d", body(name), re.MULTILINE)[0]
    dated = re.search(rf"\[measured on {date}, {why}{link}", " ".join(README.read_text("utf-8").split()))
    assert not why or dated, f"{name}: {why}: run its command again, or write: measured on {date}, {why}"


def test_the_speed_that_the_readme_quotes_is_of_this_code():
    assert not age("replan")


def test_the_age_of_a_page_is_that_of_its_code(monkeypatch, tmp_path):
    monkeypatch.setattr("measured.FOLDER", tmp_path)
    (tmp_path / "replan.md").write_text("2026-11-25, 2 cores\n\nCode `0123` of `planning/qp.py`.\n")
    monkeypatch.setattr("measured.digest", lambda _: "0123")
    assert age("replan") == ""
    monkeypatch.setattr("measured.digest", lambda _: "4567")
    assert age("replan") == "with code that has changed"
    (tmp_path / "replan.md").write_text("2026-11-25, 2 cores\n")
    assert age("replan") == "with code that was not recorded"


def test_the_code_that_a_page_measures_exists():
    paths = {path for _, paths in PAGES.values() for path in paths}
    assert [path for path in paths if not (ROOT / "eadp" / path).exists()] == []


def test_every_measured_file_is_linked_and_has_its_command():
    assert {path.name for path in FOLDER.glob("*.md")} == set(LINKED) == {f"{name}.md" for name in PAGES}


if __name__ == "__main__":
    text = README.read_text(encoding="utf-8")
    README.write_text(FIGURE.sub(lambda m: cell(*m.groups()[1:]) + m[0][len(m[1]) :], text), encoding="utf-8")

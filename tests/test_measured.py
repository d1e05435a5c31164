"""Measured figures stand in docs/measured, which benchmarks write; pages link there, and the README quotes a few.

A figure of the README is followed by a comment with its file, row and column: `0.9<!-- quality.md: joint; U, all -->`.
`PYTHONPATH=tests/support python tests/test_measured.py` writes the present figures into the README.
"""

from __future__ import annotations

import re
import shlex
import sys

import pytest
from common import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
from measured import digest

README, FOLDER = ROOT / "README.md", ROOT / "docs/measured"
FIGURE = re.compile(r"([\d.,]+)<!-- (\w+\.md): ([^;]+); (.+?) -->")
MAX_FIGURES = 6
PAGES = [README, *sorted(ROOT.glob("docs/*.md"))]
LINKED = sorted(
    {name for page in PAGES for name in re.findall(r"measured/(\w+\.md)", page.read_text(encoding="utf-8"))}
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


@pytest.mark.parametrize(("figure", "name", "row", "column"), FIGURE.findall(README.read_text(encoding="utf-8")))
def test_a_figure_of_the_readme_is_that_of_its_file(figure, name, row, column):
    assert figure == cell(name, row, column), f"docs/measured/{name} has another figure: see this test's module"


@pytest.mark.parametrize("name", LINKED)
def test_a_measured_file_names_its_command_date_and_machine(name):
    text = body(name)
    command = re.search(r"^    (python benchmarks/\S+\.py.*)$", text, re.MULTILINE)
    assert command, "no command"
    assert (ROOT / shlex.split(command[1])[1]).exists()
    assert re.search(r"^\d{4}-\d\d-\d\d, \d+ cores, .*Python 3\.\d+", text, re.MULTILINE), "no date and machine"
    assert re.search(r"^(\||- )", text, re.MULTILINE), "nothing measured"


@pytest.mark.parametrize(
    "name", sorted(path.name for path in FOLDER.glob("*.md") if "\nCode `" in path.read_text("utf-8"))
)
def test_a_page_is_no_older_than_the_code_that_it_measures(name):
    known, paths = re.search(r"^Code `(\w+)` of (.*)\.$", body(name), re.MULTILINE).groups()
    assert known == digest(re.findall("`(.*?)`", paths)), f"run the command of docs/measured/{name} again"


def test_the_speed_that_the_readme_quotes_is_of_this_code():
    assert "\nCode `" in body("replan.md")


def test_every_measured_file_is_linked():
    assert {path.name for path in FOLDER.glob("*.md")} == set(LINKED)


if __name__ == "__main__":
    text = README.read_text(encoding="utf-8")
    README.write_text(FIGURE.sub(lambda m: cell(*m.groups()[1:]) + m[0][len(m[1]) :], text), encoding="utf-8")

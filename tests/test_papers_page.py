"""docs/papers.md: every numbered item of the papers is in it, and everything that it names exists."""

import importlib
import re
from functools import cache

import papers_mutants
import pytest
from common import ROOT
from common.console import missing_links

from eadp.io import scenario as scenario_file
from eadp.io.text.yaml import properties

PAGE = ROOT / "docs/papers.md"
SECTIONS = re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
ROWS = {
    section.splitlines()[0]: [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section.splitlines()
        if line.startswith("| ") and not line.startswith("| item |")
    ]
    for section in SECTIONS
}
NUMBERED = {
    "The letter": {
        "Eq": range(1, 23), "Fig": range(1, 7), "Alg": range(1, 3), "Lem": ["III.1", "III.2", "III.3"],
        "Def": ["II.1", "II.2", "II.3", "II.4", "II.5", "III.1", "III.2", "III.3"], "Pb": ["II.1", "II.2"],
        "App": "ABC",
    },
    "Draft 002": {
        "Eq": range(1, 18), "Fig": range(1, 4), "Def": ["II.1", "III.1"], "Lem": ["II.1"], "Asm": ["II.2"],
        "Thm": ["III.1"], "App": ["I", "II", "III", "IV"],
    },
    "Draft 003": {
        "Eq": range(1, 13), "Fig": range(1, 8), "Def": ["II.1", "II.2", "IV.1", "IV.2"], "Asm": ["II.1", "IV.1"],
        "Prop": ["II.2"], "Pb": ["II.1"], "Lem": ["III.1"], "Thm": ["IV.2"], "App": ["I"],
    },
    "Draft 004": {
        "Eq": range(1, 15), "Fig": range(1, 8), "Def": ["II.1", "II.2", "IV.1"], "Pb": ["II.1"], "Lem": ["III.1"],
        "App": ["I"],
    },
}  # fmt: skip
"""What each paper numbers."""

PACKAGES = {path.name for path in (ROOT / "eadp").iterdir() if path.is_dir()}


def listed(items, kind):
    """The numbers of a kind that the first cells of the rows name: `Eq. 3`, `Eqs. 4-6, 9`."""
    found = set()
    for item in items:
        for numbers in re.findall(rf"{kind}s?\. ((?:[\dIVABC]+(?:\.\d)?[a-f]?(?:-|, )?)+)", item):
            for number in filter(None, numbers.split(", ")):
                first, _, last = number.partition("-")
                ends = re.sub(r"[a-f]\Z", "", first), last
                found |= set(map(str, range(int(ends[0]), int(last) + 1))) if last.isdigit() else {ends[0]}
    return found


@pytest.mark.parametrize("paper", NUMBERED)
def test_everything_that_a_paper_numbers_is_listed(paper):
    items = [row[0] for row in ROWS[paper]]
    for kind, numbers in NUMBERED[paper].items():
        assert listed(items, kind) >= set(map(str, numbers)), kind


@cache
def settings():
    """The dotted keys of a scenario."""
    schema = scenario_file.json_schema()

    def keys(node, path):
        for name, inner in properties(schema, node):
            yield ".".join((*path, name))
            yield from keys(inner, (*path, name))

    return set(keys(schema, ()))


@cache
def help_of(command):
    """The help of a command: its options stand in it."""
    return (ROOT / "docs/cli.md").read_text(encoding="utf-8").partition(f"## eadp {command}\n")[2].partition("\n## ")[0]


def exists(name):
    """Whether a file, module, class, function, scenario key or command of the page is there."""
    if name.startswith("eadp "):
        command, *options = name.split()[1:]
        return all(re.search(rf"^  (-., )?{option}\b", help_of(command), re.MULTILINE) for option in options)
    if "/" in name:
        return (ROOT / name).exists()
    if name.split(".")[0] not in PACKAGES:
        return name in settings()
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        module = ".".join(["eadp", *parts[:end]])
        try:
            found = importlib.import_module(module)
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            fields = getattr(found, "__dataclass_fields__", {})
            if not hasattr(found, part) and part not in fields:
                return False
            found = getattr(found, part, None)
        return end > 1 or len(parts) == 1
    return False


def test_what_a_row_names_exists():
    for row in (row for rows in ROWS.values() for row in rows):
        assert len(row) == 4, row
        where, tests = row[2:]
        assert [name for name in re.findall(r"`([^`]+)`", where) if not exists(name)] == [], row
        assert where == "–" or "`" in where, row
        assert tests, row
        assert where != "–" or tests.startswith("Left out: "), row
        source = ""
        for name in re.findall(r"`((?:tests|docs|benchmarks)/[^`]+|test_[^`]+)`", tests):
            file, _, test = name.rpartition("::") if "::" in name or "/" not in name else (name, "", "")
            if file:
                assert (ROOT / file).exists(), file
                source = (ROOT / file).read_text(encoding="utf-8")
            assert not test or f"def {test}(" in source, name


def test_references_between_the_papers_and_links():
    assert missing_links(PAGE) == []
    for paper, rows in ROWS.items():
        assert len({row[0] for row in rows}) == len(rows), paper


MUTANTS = papers_mutants.rows()


def test_every_row_with_a_test_has_a_mutation_of_its_formula():
    assert len(MUTANTS) > 50
    broken = {row: papers_mutants.of_row(row) for row in MUTANTS}
    assert {row for row, mutations in broken.items() if not mutations} == {*papers_mutants.WITHOUT_FORMULA}
    assert sum(map(len, broken.values())) == len(papers_mutants.mutations())
    for row, mutations in broken.items():
        assert all(papers_mutants.broken(each, MUTANTS[row])[1] for each in mutations)


@pytest.mark.slow
@pytest.mark.parametrize("row", [row for row in MUTANTS if row not in papers_mutants.WITHOUT_FORMULA])
def test_the_test_of_a_row_falls_where_its_formula_is_broken(row):
    assert all(papers_mutants.falls(each, MUTANTS[row]) for each in papers_mutants.of_row(row))

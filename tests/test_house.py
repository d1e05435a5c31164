"""The house keeps its order: names of classes are unique, and prose and names are in the field's terms."""

from __future__ import annotations

import ast
import re
from collections import defaultdict

import pytest
from common import ROOT

SOURCES = sorted((ROOT / "eadp").rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

FIELD_TERMS = {
    r"\btold\b": "measured, forecast, estimated or given",
    r"\bspells?\b": "window or batch",
    r"\bdearer\b": "more expensive",
    r"\b(?:begun|mended?|nobody)\b": "started, repaired, no one",
    r"(?<!\")\b(?:most|least|highest|lowest)_[a-z]+": "max_ or min_",  # a name that is gone stands in quotes
    r"\b(?:Prospects?|Outlook|Remarks?|Terrain|Follower|Itinerary)\b": "Candidate, Forecast, Notice, TermBuilder, ...",
    r"\bitinerar(?:y|ies)\b": "executor or plan",
}


def test_no_two_public_classes_share_a_name():
    found = defaultdict(list)
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(path.relative_to(ROOT).as_posix())
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


@pytest.mark.parametrize("path", [*SOURCES, *PAGES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_words_are_the_fields(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        for word, instead in FIELD_TERMS.items():
            match = re.search(word, line)
            assert not match, f"{path.name}:{number}: {match[0] if match else ''}; rather {instead}"

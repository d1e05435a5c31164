"""The house keeps its order: names of classes are unique, and prose and names are in the field's terms."""

import ast
import re
import tomllib
from collections import defaultdict
from graphlib import TopologicalSorter

import grimp
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
        for name in re.findall(r"^ *class ([A-Za-z]\w*)[:(]", path.read_text(encoding="utf-8"), re.MULTILINE):
            found[name].append(path.relative_to(ROOT).as_posix())
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


def test_words_are_the_fields():
    found = [
        f"{path.relative_to(ROOT)}:{number}: {match[0]}; rather {instead}"
        for path in (*SOURCES, *PAGES)
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        for word, instead in FIELD_TERMS.items()
        if (match := re.search(word, line))
    ]
    assert found == []


@pytest.mark.parametrize("page", ["architecture.md", "contributing.md"])
def test_a_page_names_what_there_is(page):
    """Modules as `room/module`, and what is in them as `room/module.Name`."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    places = re.findall(r"`((?:[a-z_]+/)+[a-z_]+)(?:\.py)?(?:\.([A-Za-z_]+))?(?:\.[a-z_]+)?`", text)
    assert len(places) > 25
    missing = []
    for place, name in places:
        found = [*(ROOT / "eadp").glob(f"**/{place}*"), *ROOT.glob(f"{place}*")]
        files = [path for path in found if path.suffix == ".py"]
        named = not name or any(re.search(rf"^(?:class |def |){name}\b", path.read_text(), re.M) for path in files)
        missing += [] if found and named else [f"{place} {name}"]
    assert missing == []


def test_extras_that_pages_and_messages_name_exist():
    texts = [path.read_text(encoding="utf-8") for path in (*PAGES, *SOURCES)]
    named = {name for text in texts for names in re.findall(r"eadp\[([a-z,-]+)\]", text) for name in names.split(",")}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"terrain", "mavlink"} <= named <= project["optional-dependencies"].keys()


def test_no_pattern_tries_blanks_from_each_of_them():
    r"""A pattern that starts with `\s*` is matched at a place: searched, it takes the square of the blanks."""
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "re.compile(" in text else ():
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "compile":
                source = "\n".join(text.splitlines()[node.lineno - 1 : node.end_lineno])
                name = re.match(r"\s*(\w+)", source)
                if re.search(r"MULTILINE", source):
                    assert r"^\s" not in source, source
                if re.search(r"""r"\\s[*+]""", source) and name:
                    searched = re.search(rf"\b{name[1]}\.(search|sub|findall|finditer|split)\(", text)
                    assert not searched, f"{path.name}: {name[1]}"


def test_no_circle_of_files():
    """Not by imports inside functions, either."""
    graph = grimp.build_graph("eadp", exclude_type_checking_imports=True)
    order = TopologicalSorter({name: graph.find_modules_directly_imported_by(name) for name in graph.modules})
    assert len(list(order.static_order())) == len(graph.modules) > 150  # a circle raises CycleError

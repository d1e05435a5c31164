"""Results as a JUnit report, which pipelines show."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

from eadp.errors import printable


class Case(NamedTuple):
    """A test: its name, the time that it took [s], what is wrong, as `failure` or `error`, and what to know besides."""

    name: str
    time_s: float
    wrong: str | None = None
    kind: str = "failure"
    note: str | None = None


def junit_text(title: str, cases: Sequence[Case]) -> str:
    """A suite of tests as XML."""
    kinds = [case.kind for case in cases if case.wrong is not None]
    counts = {"tests": len(cases), "failures": kinds.count("failure"), "errors": kinds.count("error")}
    time_s = f"{sum(case.time_s for case in cases):.3f}"
    name = printable(title)
    suite = ET.Element("testsuite", {"name": name, **{key: str(n) for key, n in counts.items()}, "time": time_s})
    for case in cases:
        test = ET.SubElement(suite, "testcase", classname=name, name=printable(case.name), time=f"{case.time_s:.3f}")
        if case.wrong is not None:
            ET.SubElement(test, case.kind, message=printable(case.wrong, 2000))
        if case.note is not None:
            ET.SubElement(test, "system-out").text = printable(case.note, 2000)
    ET.indent(suite)
    return ET.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"

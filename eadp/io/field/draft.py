"""What the readers of fields hand on: vertices with their places, rings, a draft of the field, and its text.

A reader of a format finds the features of a file that have polygons, chooses one, and reads its rings into a draft:
numbers as they stand in the file, each with its line and column. Whether they make a field is judged afterwards.
"""

from __future__ import annotations

import re
from array import array
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple, TypeVar

from eadp.errors import Fault, InputError, capped, printable
from eadp.io.text.streams import Text

VERTICES_LIMIT = 20_000
"""Most vertices of a field, those of its holes among them."""
NAMES_SHOWN = 10
"""Most names that a message lists."""

StageVisit = tuple[int, int]
"""Line and column, from 1."""


class Vertex(NamedTuple):
    """A vertex as its file has it: x is east, or longitude; y is north, or latitude."""

    x: float
    y: float
    line: int
    column: int

    @property
    def place(self) -> StageVisit:
        """Where it stands."""
        return self.line, self.column


@dataclass
class Ring:
    """The vertices of the outline or of a hole, in the order of the file, and where the ring begins."""

    vertices: list[Vertex]
    place: StageVisit


@dataclass
class FieldDraft:
    """What a file says before it is judged.

    `rings` are the outline and then the holes; `degrees` is whether they are in degrees and not in metres; `closes` is
    whether the format repeats the first vertex of a ring at its end; `remedy` is the end of what was expected where the
    unit seems to be another; `notes` are what the reader took for granted, a sentence each.
    """

    rings: list[Ring]
    degrees: bool
    closes: bool
    remedy: str
    name: str = ""
    notes: list[str] = field(default_factory=list)


class FieldSource:
    """The text of a file by lines, to name places in."""

    def __init__(self, text: Text) -> None:
        self.name, self.body, self.lines = text.name, text.body, text.body.split("\n")

    @cached_property
    def starts(self) -> Sequence[int]:
        """Offsets of the lines; as an array, since a text may be all line ends."""
        return array("q", accumulate((len(line) + 1 for line in self.lines), initial=0))

    def place(self, offset: int) -> StageVisit:
        """Line and column of an offset."""
        line = bisect_right(self.starts, offset, hi=len(self.lines))
        return line, offset - self.starts[line - 1] + 1

    def fault(self, place: StageVisit, message: str, expected: str = "") -> Fault:
        """A fault at a place, with the line it is in."""
        line, column = place
        source = self.lines[line - 1] if line <= len(self.lines) else ""
        return Fault(self.name, line, column, message, expected, source)

    def error(self, place: StageVisit, message: str, expected: str = "") -> InputError:
        """The error of a single fault at a place, to be raised."""
        return InputError(self.fault(place, message, expected))


class VertexReader:
    """Adds vertices to rings, up to `VERTICES_LIMIT`, and gathers the faults of those that are none."""

    def __init__(self, source: FieldSource) -> None:
        self.source = source
        self.faults: list[Fault] = []
        self.count = 0

    def add(self, ring: Ring, x: float, y: float, place: StageVisit) -> None:
        """Add a vertex, which stands at a place, to a ring."""
        self._count(place)
        ring.vertices.append(Vertex(x, y, *place))

    def refuse(self, faults: Sequence[Fault]) -> None:
        """Take down the faults, one or more, of what should have been a vertex."""
        self.faults += faults
        self._count((faults[0].line, faults[0].column))

    def _count(self, place: StageVisit) -> None:
        self.count += 1
        if self.count > VERTICES_LIMIT:
            self.finish()
            message = f"more than {VERTICES_LIMIT} vertices"
            raise self.source.error(place, message, f"at most {VERTICES_LIMIT}: a simpler outline")

    def finish(self) -> None:
        """Raise the faults, if there are any."""
        if self.faults:
            raise capped(self.faults)


@dataclass
class FeatureCandidate:
    """A feature with polygons: where it stands, what it may be called, and its polygons, each with its place.

    A polygon is what its reader makes of it.
    """

    place: StageVisit
    names: list[str]
    polygons: list[tuple[Any, StageVisit]]

    @property
    def label(self) -> str:
        """What messages call it."""
        return printable(self.names[0], 40) if self.names else "without a name"


_AnyCandidate = TypeVar("_AnyCandidate", bound=FeatureCandidate)


def choose_feature(candidates: Sequence[_AnyCandidate], feature: str | None, source: FieldSource) -> _AnyCandidate:
    """The feature that was asked for, by a name or by its number from 1, or the only one.

    Raises
    ------
    InputError
        Of the file if there are several and none was asked for; of `--feature` if none is called so, or several are.
    """
    shown = [f"{i} {candidate.label}" for i, candidate in enumerate(candidates[:NAMES_SHOWN], 1)]
    known = "; ".join(shown) + (f"; and {len(candidates) - NAMES_SHOWN} more" if len(candidates) > NAMES_SHOWN else "")
    if feature is None:
        if len(candidates) == 1:
            return candidates[0]
        message = f"{len(candidates)} features with polygons"
        raise source.error(candidates[1].place, message, f"one, or --feature with a name or number of {known}")
    named = [candidate for candidate in candidates if feature.strip() in candidate.names]
    if len(named) > 1:
        message = f"{len(named)} features are called {printable(feature, 80)}"
        raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))
    if named:
        return named[0]
    if re.fullmatch("[0-9]{1,7}", feature.strip()) and 1 <= int(feature) <= len(candidates):
        return candidates[int(feature) - 1]
    message = f"no feature {printable(feature, 80)} with a polygon"
    raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))


def only_polygon(chosen: FeatureCandidate, source: FieldSource) -> tuple[Any, StageVisit]:
    """The polygon of a feature and its place; a feature of several is refused at the second."""
    if len(chosen.polygons) > 1:
        message = f"{len(chosen.polygons)} polygons in one feature"
        raise source.error(chosen.polygons[1][1], message, "one polygon: each part of a field in a file of its own")
    return chosen.polygons[0]


def counted(count: int, one: str, several: str) -> str:
    """A count and what is counted: "1 hole", "2 holes"."""
    return f"1 {one}" if count == 1 else f"{count} {several}"

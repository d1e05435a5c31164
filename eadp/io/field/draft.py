"""The draft of a field that the reader of a format returns: rings of vertices with their locations in the file.

A reader of a format finds the features of a file that have polygons, chooses one, and reads its rings into a draft:
numbers as they stand in the file, each with its line and column. `reader` checks whether they make a field.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from eadp.errors import Fault, InputError, printable, refuse
from eadp.io.text.source import Location, SourceText

VERTICES_LIMIT = 20_000
"""Most vertices of a field, those of its holes among them."""
NAME_LIMIT = 100
"""Most characters of a name."""
NAME_KEYS = ("name", "Name", "NAME", "id")
"""Properties that are names."""
ALL = "all"
"""In the place of a feature's name: all of them, as parts of one field."""

OBSTACLE = "avoid"
"""Start of the name of a feature that is not flown over."""

NAMES_SHOWN = 10
"""Most names that a message lists."""


class Vertex(NamedTuple):
    """A vertex in a file: x is east, or longitude; y is north, or latitude."""

    x: float
    y: float
    location: Location


@dataclass
class Ring:
    """The vertices of the outline or of a hole, in the order of the file, and the location of its start.

    An obstacle has a name, '' if none is given, and may have a height above the field's origin [m].
    """

    vertices: list[Vertex]
    location: Location
    name: str = ""
    height_m: float | None = None


@dataclass
class FieldDraft:
    """The content of a file before it is checked.

    `rings` are the outline and then the holes; `degrees` is whether they are in degrees and not in metres; `closes` is
    whether the format repeats the first vertex of a ring at its end; `remedy` is the advice of an error where the unit
    seems to be another; `notes` are assumptions of the reader, a sentence each. `obstacles` are outlines in the
    same file that are not flown over, `others` the rings of the field's other parts.
    """

    rings: list[Ring]
    degrees: bool
    closes: bool
    remedy: str
    name: str = ""
    notes: list[str] = field(default_factory=list)
    obstacles: list[Ring] = field(default_factory=list)
    others: list[list[Ring]] = field(default_factory=list)


class VertexReader:
    """Adds vertices to rings, up to `VERTICES_LIMIT`, and collects the faults of the others."""

    def __init__(self, source: SourceText) -> None:
        self.source = source
        self.faults: list[Fault] = []
        self.count = 0

    def add(self, ring: Ring, x: float, y: float, location: Location) -> None:
        """Add a vertex at a location to a ring."""
        self._count(location)
        ring.vertices.append(Vertex(x, y, location))

    def refuse(self, faults: Sequence[Fault]) -> None:
        """Add the faults, one or more, of something that is no vertex."""
        self.faults += faults
        self._count((faults[0].line, faults[0].column))

    def _count(self, location: Location) -> None:
        self.count += 1
        if self.count > VERTICES_LIMIT:
            self.finish()
            message = f"more than {VERTICES_LIMIT} vertices"
            raise self.source.error(location, message, f"at most {VERTICES_LIMIT}: a simpler outline")

    def finish(self) -> None:
        """Raise the faults, if there are any."""
        refuse(self.faults)


@dataclass
class FeatureCandidate:
    """A feature with polygons: its location, its names, and its polygons, each with its location.

    The type of a polygon is its reader's. `chain` are the objects of GeoJSON that enclose it, which may have the units;
    `properties` are its other texts and numbers, by which it may be asked for.
    """

    location: Location
    names: list[str]
    polygons: list[tuple[Any, Location]]
    chain: list[Any] = field(default_factory=list)
    height_m: float | None = None
    properties: dict[str, str] = field(default_factory=dict)

    @property
    def avoided(self) -> bool:
        """Whether it is an obstacle: its name is "avoid", or starts so."""
        return any(name.lower().startswith(OBSTACLE) for name in self.names)

    def outlines(self, rings: Callable[..., list[Ring]], source: SourceText) -> Iterator[Ring]:
        """The outlines of its polygons as obstacles; `rings` reads a polygon."""
        name = "".join(self.names[:1])
        name = name[len(OBSTACLE) :].strip(" :-_") if self.avoided else name
        for polygon in self.polygons:
            yield replace(rings(*polygon, source)[0], name=name, height_m=self.height_m)

    def label(self, key: str) -> str:
        """Its name in messages, or the value of a property that tells it from the others."""
        if self.names:
            return printable(self.names[0], 40)
        return printable(f"{key}={self.properties[key]}", 60) if key in self.properties else "without a name"


class FeatureFormat(NamedTuple):
    """A format of features with names: how they are found, how their vertices are read, and in which units these are.

    Attributes
    ----------
    features : function of source, metres and lines
        The features with polygons, one or more; or those with lines.
    rings : function of a polygon, its location and source
        Its outline and its holes.
    units : function of a feature's chain, metres and source
        Whether it is in degrees, and the remedy where that is wrong.
    """

    features: Callable[[SourceText, bool, bool], list[FeatureCandidate]]
    rings: Callable[[Any, Location, SourceText], list[Ring]]
    units: Callable[[Sequence[Any], bool, SourceText], tuple[bool, str]]

    def read(self, source: SourceText, metres: bool, feature: str | None, lines: bool) -> FieldDraft:
        """Read the polygons of a feature, and others as obstacles; or its line, as the only ring.

        Parameters
        ----------
        source : SourceText
        metres : bool
            It is in metres, whatever it states.
        feature : str or None
            Of several features, the one to read.
        lines : bool

        Raises
        ------
        InputError
            If it is not of the format, or has no such feature; of the options, if they do not fit.
        """
        candidates = self.features(source, metres, lines)
        avoided = [] if lines else [each for each in candidates if each.avoided]
        wanted = [each for each in candidates if each not in avoided] or candidates
        chosen = choose_feature(wanted, feature, source, "line" if lines else "polygon")
        # before the vertices: their faults may come from the units
        degrees, remedy = self.units(chosen.chain, metres, source)
        rings, *others = (self.rings(*polygon, source) for polygon in chosen.polygons)
        obstacles = [ring for each in avoided if each != chosen for ring in each.outlines(self.rings, source)]
        return FieldDraft(rings, degrees, True, remedy, "".join(chosen.names[:1]), [], obstacles, others)

    def zones(self, source: SourceText, metres: bool, inside: bool) -> tuple[list[Ring], bool]:
        """The outlines of all polygons, and whether they are in degrees; raises InputError as `read`."""
        candidates = self.features(source, metres, False)
        rings = [ring for each in candidates for ring in each.outlines(self.rings, source)]
        return rings, self.units(candidates[0].chain, metres, source)[0]


def choose_feature(
    candidates: Sequence[FeatureCandidate], feature: str | None, source: SourceText, what: str = "polygon"
) -> FeatureCandidate:
    """The feature that was asked for, by a name, by KEY=VALUE of a property, by its number from 1, or the only one.

    Raises
    ------
    InputError
        Of the file if there are several and none was asked for; of `--feature` if none or several have the name.
    """
    differing = _differing(candidates)
    shown = [
        f"{i} {candidate.label(differing[0] if differing else '')}"
        for i, candidate in enumerate(candidates[:NAMES_SHOWN], 1)
    ]
    known = "; ".join(shown) + (f"; and {len(candidates) - NAMES_SHOWN} more" if len(candidates) > NAMES_SHOWN else "")
    if differing:
        known += f"; or KEY=VALUE by {', '.join(printable(key, 40) for key in differing[:NAMES_SHOWN])}"
    if len(candidates) > 1 and feature is not None and feature.strip() == ALL:
        polygons = [polygon for candidate in candidates for polygon in candidate.polygons]
        return replace(candidates[0], names=[], polygons=polygons)
    if feature is None:
        if len(candidates) == 1:
            return candidates[0]
        message = f"{len(candidates)} features with {what}s"
        raise source.error(candidates[1].location, message, f"one, or --feature with a name or number of {known}")
    named = [candidate for candidate in candidates if feature.strip() in candidate.names]
    key, is_property, value = feature.partition("=")
    if is_property and not named:
        named = [each for each in candidates if each.properties.get(key.strip()) == value.strip()]
    if len(named) > 1:
        message = f"{len(named)} features have {'' if is_property else 'the name '}{printable(feature, 80)}"
        raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))
    if named:
        return named[0]
    if re.fullmatch("[0-9]{1,7}", feature.strip()) and 1 <= int(feature) <= len(candidates):
        return candidates[int(feature) - 1]
    message = f"no feature {printable(feature, 80)} with a {what}"
    raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))


def _differing(candidates: Sequence[FeatureCandidate]) -> list[str]:
    """Properties by which features without names of their own differ, those by which all do first."""
    if len({each.names[0] for each in candidates if each.names}) == len(candidates):
        return []
    keys = dict.fromkeys(key for each in candidates for key in each.properties if key not in NAME_KEYS)
    counts = {key: len({each.properties.get(key) for each in candidates}) for key in keys}
    return sorted((key for key in keys if counts[key] > 1), key=lambda key: -counts[key])


def counted(count: int, one: str, several: str) -> str:
    """A count with its noun: "1 hole", "2 holes"."""
    return f"1 {one}" if count == 1 else f"{count} {several}"

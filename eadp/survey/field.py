"""Coordinates of a reference system as longitude and latitude.

This is the one door to pyproj (the extra `fields`), imported where a file states such a system.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from eadp.core.geometry.curves import Point
from eadp.errors import Fault, InputError, printable, refuse
from eadp.io.text.streams import Location, SourceText

ToDegrees = Callable[[float, float], Point | None]
"""Longitude and latitude [°, WGS-84] of coordinates; None outside the system."""


def degrees_of(code: tuple[str, str], name: str, error: Callable[[str, str], InputError], otherwise: str) -> ToDegrees:
    """What makes degrees of the coordinates of a reference system.

    Parameters
    ----------
    code : (str, str)
        An authority and its code, as EPSG and 25832.
    name : str
        For messages.
    error : function of a message and what is expected
    otherwise : str
        What is expected instead.

    Raises
    ------
    InputError
        If the extra is not installed, or the system is not known, or not related to WGS-84.
    """
    try:
        import pyproj
        from pyproj.exceptions import ProjError
    except ImportError:
        message = "pyproj, which converts coordinates, is missing"
        raise error(message, f"pip install 'eadp[fields]', or {otherwise}") from None
    try:
        known = pyproj.CRS.from_authority(*code)
        if not (known.is_projected or known.is_geographic):
            raise ProjError("neither projected nor geographic")
        # without a known datum PROJ takes it as WGS-84, which may be hundreds of metres off
        transform = pyproj.Transformer.from_crs(known, 4326, always_xy=True, allow_ballpark=False).transform
    except ProjError:
        raise error(f"the reference system {name} is not known", otherwise) from None

    def to_degrees(x: float, y: float) -> Point | None:
        longitude, latitude = transform(x, y)
        if not (math.isfinite(longitude) and math.isfinite(latitude)):
            return None
        return round(longitude, 9), round(latitude, 9)

    return to_degrees


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
MAX_HEIGHT_M = 10_000.0
"""Largest height of an obstacle [m]."""
A_HEIGHT = f"metres above the field, from 0 to {MAX_HEIGHT_M:g}"

FIELDS, OBSTACLES, BOUNDARIES = "fields", "obstacles", "boundaries"
"""What is looked for in a file. Obstacles may be points and lines, too; beside fields, those named so are read."""

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
    `properties` are its other texts and numbers, by which it may be asked for. One that is `thin` is of points or
    lines, and no field.
    """

    location: Location
    names: list[str]
    polygons: list[tuple[Any, Location]]
    chain: list[Any] = field(default_factory=list)
    height_m: float | None = None
    properties: dict[str, str] = field(default_factory=dict)
    thin: bool = False

    @property
    def avoided(self) -> bool:
        """Whether it is an obstacle: its name is "avoid", or starts so."""
        return is_avoided(self.names)

    @property
    def name(self) -> str:
        """Its name, as that of an obstacle; '' without one."""
        name = "".join(self.names[:1])
        return name[len(OBSTACLE) :].strip(" :-_") if self.avoided else name

    def label(self, key: str) -> str:
        """Its name in messages, or the value of a property that tells it from the others."""
        if self.names:
            return printable(self.names[0], 40)
        return printable(f"{key}={self.properties[key]}", 60) if key in self.properties else "without a name"


def is_avoided(names: Sequence[str]) -> bool:
    """Whether a feature of these names is an obstacle."""
    return any(name.lower().startswith(OBSTACLE) for name in names)


def there_and_back(line: Sequence[Any]) -> list[Any]:
    """The vertices of a line as those of a ring without an area."""
    return [*line, *line[-2:0:-1]]


class Units(NamedTuple):
    """Whether coordinates are, or become by `to_degrees`, degrees; and the remedy where that is wrong."""

    degrees: bool
    remedy: str = ""
    to_degrees: ToDegrees | None = None


class Zones(NamedTuple):
    """Outlines of obstacles or of a boundary, and whether they are in degrees; and the obstacles within a boundary."""

    rings: list[Ring]
    degrees: bool
    obstacles: Sequence[Ring] = ()


class FeatureFormat(NamedTuple):
    """A format of features with names: how they are found, how their vertices are read, and in which units these are.

    Attributes
    ----------
    features : function of source, metres and what is looked for
        The features, one or more, obstacles among them.
    rings : function of a polygon, its location and source
        Its outline and its holes.
    units : function of a feature's chain, metres and source
    """

    features: Callable[[SourceText, bool, str], list[FeatureCandidate]]
    rings: Callable[[Any, Location, SourceText], list[Ring]]
    units: Callable[[Sequence[Any], bool, SourceText], Units]

    def read(self, source: SourceText, metres: bool, feature: str | None) -> FieldDraft:
        """Read the polygons of a feature, and others as obstacles.

        Parameters
        ----------
        source : SourceText
        metres : bool
            It is in metres, whatever it states.
        feature : str or None
            Of several features, the one to read.

        Raises
        ------
        InputError
            If it is not of the format, or has no such feature; of the options, if they do not fit.
        """
        candidates = self.features(source, metres, FIELDS)
        wanted = [each for each in candidates if not each.avoided] or [each for each in candidates if not each.thin]
        chosen = choose_feature(wanted, feature, source)
        polygons, units = self._placed(chosen, metres, source)
        rings, *others = [rings for of_feature in polygons for rings in of_feature]
        avoided = [each for each in candidates if each.avoided and each not in chosen]
        obstacles = self._outlines(avoided, metres, source, units)
        name = "".join(chosen[0].names[:1]) if len(chosen) == 1 else ""
        return FieldDraft(rings, units.degrees, True, units.remedy, name, [], obstacles, others)

    def zones(self, source: SourceText, metres: bool, inside: bool) -> Zones:
        """The outlines of all features; raises InputError as `read`."""
        candidates = self.features(source, metres, BOUNDARIES if inside else OBSTACLES)
        units = self.units(candidates[0].chain, metres, source)
        bounds = [each for each in candidates if not (inside and each.avoided)] or candidates
        avoided = [each for each in candidates if each not in bounds]
        obstacles = self._outlines(avoided, metres, source, units)
        polygons, _ = self._placed(bounds if inside else [], metres, source, units)
        holes = [hole for of_feature in polygons for _, *inner in of_feature for hole in inner]
        obstacles += [replace(hole, name="hole") for hole in holes]
        return Zones(self._outlines(bounds, metres, source, units), units.degrees, obstacles)

    def _outlines(
        self, candidates: Sequence[FeatureCandidate], metres: bool, source: SourceText, beside: Units
    ) -> list[Ring]:
        """The outlines of features in the same units as others, with their names and heights."""
        polygons, _ = self._placed(candidates, metres, source, beside)
        return [
            replace(outline, name=each.name, height_m=each.height_m)
            for each, of_feature in zip(candidates, polygons, strict=True)
            for outline, *_ in of_feature
        ]

    def _placed(
        self, candidates: Sequence[FeatureCandidate], metres: bool, source: SourceText, beside: Units | None = None
    ) -> tuple[list[list[list[Ring]]], Units]:
        """The polygons of each feature, in degrees or metres, and these units; all the same, and as those of others."""
        result = []
        for each in candidates:
            # before the vertices: their faults may come from the units
            units = self.units(each.chain, metres, source)
            beside = beside or units
            if units.degrees != beside.degrees:
                ours, theirs = ("degrees", "metres") if units.degrees else ("metres", "degrees")
                message = f"a feature in {ours} beside one in {theirs}"
                raise source.error(each.location, message, "units, or a reference system, for all features")
            polygons = [self.rings(*polygon, source) for polygon in each.polygons]
            for ring in (ring for rings in polygons for ring in rings if units.to_degrees is not None):
                ring.vertices = [_in_degrees(vertex, units, source) for vertex in ring.vertices]
            result.append(polygons)
        assert beside is not None
        return result, beside


def _in_degrees(vertex: Vertex, units: Units, source: SourceText) -> Vertex:
    """A vertex in degrees. Raises InputError."""
    assert units.to_degrees is not None
    place = units.to_degrees(vertex.x, vertex.y)
    if place is None:
        message = f"a vertex at ({vertex.x:.10g}, {vertex.y:.10g}) lies outside the reference system"
        raise source.error(vertex.location, message, "coordinates of that system")
    return vertex._replace(x=place[0], y=place[1])


def choose_feature(
    candidates: Sequence[FeatureCandidate], feature: str | None, source: SourceText
) -> list[FeatureCandidate]:
    """The feature that was asked for, by a name, by KEY=VALUE of a property, by its number from 1, or the only one.

    All of them where `ALL` was asked for.

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
        return list(candidates)
    if feature is None:
        if len(candidates) == 1:
            return list(candidates)
        message = f"{len(candidates)} features with polygons"
        raise source.error(candidates[1].location, message, f"one, or --feature with a name or number of {known}")
    named = [candidate for candidate in candidates if feature.strip() in candidate.names]
    key, is_property, value = feature.partition("=")
    if is_property and not named:
        named = [each for each in candidates if each.properties.get(key.strip()) == value.strip()]
    if len(named) > 1:
        message = f"{len(named)} features have {'' if is_property else 'the name '}{printable(feature, 80)}"
        raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(feature, 80))
    if named:
        return named
    if re.fullmatch("[0-9]{1,7}", feature.strip()) and 1 <= int(feature) <= len(candidates):
        return [candidates[int(feature) - 1]]
    message = f"no feature {printable(feature, 80)} with a polygon"
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

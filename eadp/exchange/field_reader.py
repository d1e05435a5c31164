"""Fields, obstacles and boundaries from files, in the metres of a field: read, repaired and checked.

All of them are the features of `features`, or the fences of a mission; `_Outlines` says what is wrong with an outline.
"""

from __future__ import annotations

import math
import os
import statistics
import zipfile
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

from eadp.api.given import File
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import FARTHEST_M, to_geodetic_deg, to_local_m, to_near_local_m
from eadp.errors import Fault, InputError, counted, printable
from eadp.exchange.features import NAME_LIMIT, Feature, Features, Line, read_features
from eadp.exchange.reader import mission_fences
from eadp.io.plan.writer import parameters_of
from eadp.io.text.streams import LIMIT_BYTES, Text, read_text, text_of
from eadp.models.airspace import Airspace, Field, Obstacle
from eadp.models.plan.plan import Plan

EXTENT_LIMIT_M = 50_000.0
"""Largest width and height of a field [m]: beyond it the tangent plane is distorted."""
LATITUDE_LIMIT_DEG = 85.0
"""Largest latitude [°], north or south: nearer to a pole nothing is planned."""
LARGEST_M = 1e8
"""Largest coordinate in metres: grids have numbers of seven or eight digits."""
SMALLEST_M2, NO_AREA_M2 = 1.0, 0.01
"""Smallest area of a field and of its parts; a hole or an obstacle that is smaller than the second has no area [m²]."""
DEGREE_M = 111_000.0
"""Length of a degree of latitude, roughly [m]."""
ZONES_M = FARTHEST_M
"""How far from a field, or from the start of a plan, obstacles and boundaries are read [m]."""
BROKEN_M = 5_000.0
"""How far from the middle of a field, or from the start of a plan, an obstacle may cross itself [m]."""
THIN_M = 10.0
"""How far around an obstacle without an area, as a mast or a power line, nothing is flown [m]."""
VALID_SHARE = 1e-3
"""Share of its area by which a polygon that crosses or touches itself may change where it is made valid."""
RING_LIMIT, COARSE_M = 1000, 1.0
"""Most vertices of a field's ring, as the time to find a path grows with their number; a ring of more is simplified
within the second [m]."""

_ORDER = "longitude before latitude"
_DEGREES = f"longitude within ±360 and latitude within ±90 degrees, {_ORDER}"

Part = list[tuple[Point, ...]]
"""An outline and its holes [m]."""


# --- what is wrong with an outline


@dataclass
class _Outlines:
    """Makes polygons of a file, in metres, parts without flaws, and counts what it changes; `origin_deg` for messages.

    What is smaller than `smallest_m2` is left out; holes without an area are collected in `thin`.
    """

    source: Text
    smallest_m2: float
    origin_deg: Point | None = None
    counts: Counter[str] = field(default_factory=Counter)
    thin: list[Line] = field(default_factory=list)

    def parts(self, rings: Sequence[Line], of: Feature) -> list[Part]:
        """A polygon without flaws, as parts, outlines counter-clockwise and holes clockwise; none without an area.

        Raises
        ------
        InputError
            Where its rings cross or touch one another, or themselves, so that repairing them would change the area.
        """
        from eadp.core.geometry.polygons import flaw, ground_m2, made_valid, signed_area_m2

        kept: Part = []
        for k, ring in enumerate(rings):
            cleaned = _tidied(ring)
            if len(cleaned) >= 3 and ground_m2(cleaned) >= (NO_AREA_M2 if k else self.smallest_m2):
                wound = (signed_area_m2(cleaned) > 0) == (k == 0)
                kept.append(cleaned if wound else (cleaned[0], *cleaned[:0:-1]))
                self.counts["coarse"] += len(ring) > RING_LIMIT
            elif k == 0:
                self.counts["small"] += 1
                return []
            elif ring:
                self.thin.append(ring)
        defect = flaw(kept[0], kept[1:])
        if defect is None:
            return [kept]
        before_m2 = abs(signed_area_m2(kept[0])) - sum(abs(signed_area_m2(hole)) for hole in kept[1:])
        parts = [part for part in made_valid(*kept) if ground_m2(*part) >= VALID_SHARE * before_m2]
        if abs(sum(ground_m2(*part) for part in parts) - before_m2) < VALID_SHARE * before_m2:
            self.counts["repaired"] += 1
            return parts
        where = "({:.2f}, {:.2f}) m".format(*defect.point_m)
        if self.origin_deg is not None:
            latitude, longitude = to_geodetic_deg(*defect.point_m, self.origin_deg)
            where = f"longitude {longitude:.7f}, latitude {latitude:.7f}, which is {where}"
        expected = "a ring that neither crosses nor touches itself, holes within the outline and apart from one another"
        raise self.source.error(of.location, f"{_title(defect.ring, of)} {defect.message} at {where}", expected)

    def notes(self, **others: tuple[str, str]) -> list[str]:
        """Sentences on what was left out and repaired; `others` are counted too, as `_CHANGED`."""
        small = "polygon", f"of less than {self.smallest_m2:g} m² left out"
        named, counts = {"small": small} | others | _CHANGED, self.counts
        return [f"{counted(counts[key], noun)} {what}" for key, (noun, what) in named.items() if counts[key]]


def _tidied(ring: Line) -> tuple[Point, ...]:
    """A ring that is open, without vertices on the line of the others; one of too many vertices is simplified."""
    from eadp.core.geometry.polygons import TOLERANCE_M, simplified

    count = len(ring)
    while count > 1 and math.dist(ring[0], ring[count - 1]) < TOLERANCE_M:
        count -= 1
    return simplified(ring[:count], TOLERANCE_M if len(ring) <= RING_LIMIT else COARSE_M) if ring else ()


_CHANGED = {
    "coarse": ("ring", f"of more than {RING_LIMIT} vertices simplified within {COARSE_M:g} m"),
    "repaired": ("outline", "that crossed or touched itself repaired, by less than 0.1 % of the area"),
}
"""What is counted, and what was done with it."""


def _title(ring: int, of: Feature) -> str:
    return (f"hole {ring}" if ring else "the outline") + (f" of {printable(of.name, 40)}" if of.name else "")


# --- a field


def read_field(text: Text, *, metres: bool = False, feature: str | None = None) -> tuple[Field, list[str]]:
    """Read the outline and the holes of a field.

    Parameters
    ----------
    text : Text
        GeoJSON, KML, or a CSV of an outline's vertices with columns `x_m,y_m` or `lon,lat`.
    metres : bool, optional
        The file is in metres, x east and y north, whatever it states; default: as it states, or WGS-84 degrees.
    feature : str, optional
        Of several features, the one to read: its id, its name, its number from 1 among those
        with polygons; or `all`.

    Returns
    -------
    field : Field
        Metres; the vertices in the order of the file, without those that were dropped, some rings reversed.
    repaired : list of str
        The repairs that change the ground, a sentence each.

    Raises
    ------
    InputError
        With the faults of the file, or of the options.
    """
    from eadp.core.geometry.polygons import ground_m2, joined, near

    if mission_fences(text) is not None:
        expected = "a field; the fences of a mission belong to --inside FILE and --avoid FILE"
        raise text.error((1, 1), "is a mission or a fence, not a field", expected)
    found = read_features(text, metres=metres)
    areas = found.areas(text)
    chosen = _chosen([each for each in areas if not each.avoided] or areas, feature, text)
    local, origin_deg = _in_metres([_Polygon(rings, each) for each in chosen for rings in each.polygons], found, text)
    outlines = _Outlines(text, SMALLEST_M2, origin_deg)
    parts = [part for rings, of in local for part in outlines.parts(rings, of)]
    notes = outlines.notes()
    if len(parts) > 1 and (union := joined(parts, SMALLEST_M2)) is not None:
        parts = union
        notes.append("polygons that overlap joined: ground counts once")
    if (corners := max(len(set(rings[0])) for each in chosen for rings in each.polygons)) < 3:
        raise text.error(chosen[0].location, f"an outline of {corners} different vertices", "three or more")
    if sum(ground_m2(*part) for part in parts) < SMALLEST_M2:
        expected = _or(f"{SMALLEST_M2:g} m² or more", found.remedy)
        raise text.error(chosen[0].location, f"an area of less than {SMALLEST_M2:g} m²", expected)
    vertices = max(len(ring) for part in parts for ring in part)
    if vertices > RING_LIMIT:
        what = f"a ring of {vertices} vertices to be right within {COARSE_M:g} m"
        raise text.error(chosen[0].location, what, f"at most {RING_LIMIT}")
    frame = _Frame(origin_deg, _middle(parts[0][0]))
    taken = [id(each.names) for each in chosen]  # of closed lines, which stand twice, too
    avoided = [each for each in found.features if each.avoided and id(each.names) not in taken]
    obstacles = _obstacles(avoided, frame, found.degrees, text, notes)
    thin = tuple(Obstacle(outline, "hole") for ring in outlines.thin for outline, *_ in near(ring, THIN_M))
    if thin:
        holes = counted(len(outlines.thin), "obstacle")
        notes.append(f"{holes} without an area kept, with what lies within {THIN_M:g} m")
    airspace = Airspace((*obstacles, *thin))
    name = _one_line("".join(chosen[0].names[:1])) if len(chosen) == 1 else ""
    return Field((), (), name, origin_deg, airspace).with_parts([tuple(part) for part in parts]), notes


def limited_field(
    file: str, *, metres: bool, feature: str | None, avoid: str | None, inside: str | None
) -> tuple[Field, list[str]]:
    """A field as `read_field` reads it, with the obstacles and the boundary of other files; notes on all of them."""
    field, notes = read_field(read_field_text(file), metres=metres, feature=feature)
    avoided, boundary = (None if path is None else read_field_text(path) for path in (avoid, inside))
    given, said = read_airspace(avoided, boundary, field.origin_deg, field.middle_m, metres=metres)
    airspace = Airspace((*field.airspace.obstacles, *given.obstacles), given.boundary)
    return replace(field, airspace=airspace), [*notes, *(f"{printable(each.file)}: {each.message}" for each in said)]


ALL = "all"
"""In the place of a feature's name: all of them, as parts of one field."""
NAMES_SHOWN = 10
"""Most names that a message lists."""


def _chosen(features: Sequence[Feature], asked: str | None, source: Text) -> list[Feature]:
    """The feature that was asked for, by a name, by its number from 1, or the only one.

    Raises
    ------
    InputError
        Of the file if there are several and none was asked for; of `--feature` if none or several have the name.
    """
    if asked is None and len(features) == 1:
        return list(features)
    names = [printable(each.names[0], 40) if each.names else "without a name" for each in features[:NAMES_SHOWN]]
    known = "; ".join(f"{i} {name}" for i, name in enumerate(names, 1))
    known += f"; and {len(features) - NAMES_SHOWN} more" if len(features) > NAMES_SHOWN else ""
    if asked is None:
        expected = f"one, or --feature with a name or number of {known}"
        raise source.error(features[1].location, f"{len(features)} features with polygons", expected)
    asked = asked.strip()
    if asked == ALL and len(features) > 1:
        return list(features)
    found = [each for each in features if asked in each.names]
    if not found and asked.isascii() and asked.isdecimal() and len(asked) < 8 and 1 <= int(asked) <= len(features):
        found = [features[int(asked) - 1]]
    if len(found) == 1:
        return found
    message = f"no feature {printable(asked, 80)} with a polygon"
    if found:
        message = f"{len(found)} features have the name {printable(asked, 80)}"
    raise InputError.at("--feature", 1, 1, message, f"a name or number of {known}", printable(asked, 80))


class _Polygon(NamedTuple):
    """An outline and its holes, of degrees or metres, and the feature that has them."""

    rings: list[Line]
    of: Feature

    @property
    def vertices(self) -> list[Point]:
        """Of all its rings."""
        return [*chain(*self.rings)]


def _in_metres(polygons: list[_Polygon], found: Features, text: Text) -> tuple[list[_Polygon], Point | None]:
    """Polygons in metres, checked; of those in degrees also the place of their origin [°], the middle of the first."""
    polygons = [each for each in polygons if each.rings[0]]
    origin_deg, smaller = None, _or(f"a field of at most {EXTENT_LIMIT_M / 1000:g} km either way", found.remedy)
    if not polygons:
        return polygons, None
    if found.degrees:
        _check_degrees(polygons, found, text)
        first = polygons[0].rings[0]
        # longitudes are counted on from the first, across the antimeridian
        longitude, latitude = _middle([(first[0][0] + math.remainder(x - first[0][0], 360), y) for x, y in first])
        origin_deg = (round(latitude, 7) + 0.0, round(math.remainder(longitude, 360), 7) + 0.0)
        polygons = [_placed(each, origin_deg, text, smaller) for each in polygons]
    west, east, south, north = _extent([*chain(*(each.vertices for each in polygons))])
    at = polygons[0].of.location
    if (largest_m := max(-west, east, -south, north)) > LARGEST_M:
        raise text.error(at, f"a coordinate of {largest_m:.3g} m", f"at most {LARGEST_M:g} m")
    if max(east - west, north - south) > EXTENT_LIMIT_M:
        what = f"{(east - west) / 1000:.4g} km by {(north - south) / 1000:.4g} km"
        raise text.error(at, what, smaller)
    return polygons, origin_deg


def _check_degrees(polygons: list[_Polygon], found: Features, text: Text) -> None:
    """Refuse vertices that are no longitude and latitude, or near a pole."""
    for longitude, latitude, of in [(*vertex, each.of) for each in polygons for vertex in each.vertices]:
        if abs(longitude) > 360 or abs(latitude) > LATITUDE_LIMIT_DEG:
            what = f"a vertex at longitude {longitude:.10g}, latitude {latitude:.10g}"
            limits = f"longitude within ±360 and latitude within ±{LATITUDE_LIMIT_DEG:g} degrees, {_ORDER}"
            raise text.error(of.location, what, _or(limits, found.remedy))


def _placed(polygon: _Polygon, origin_deg: Point, text: Text, expected: str) -> _Polygon:
    """A polygon of degrees in metres round an origin; raises InputError where that is far."""
    rings: list[Line] = []
    for ring in polygon.rings:
        placed = [to_near_local_m(latitude, longitude, origin_deg) for longitude, latitude in ring]
        if None in placed:
            median = [statistics.median(each) for each in zip(*ring, strict=True)]  # that of the right ones
            longitude, latitude = max(ring, key=lambda vertex: math.dist(vertex, median))
            what = f"the vertex at longitude {longitude:.10g}, latitude {latitude:.10g} is farther than "
            what += f"{FARTHEST_M / 1000:g} km from the middle of the first outline"
            raise text.error(polygon.of.location, what, expected)
        rings.append([point for point in placed if point is not None])
    return _Polygon(rings, polygon.of)


def _one_line(name: str) -> str:
    """A name, as it stands in a line of text."""
    return printable(" ".join(name.split()), NAME_LIMIT)


def _or(expected: str, remedy: str) -> str:
    return f"{expected}, or {remedy}" if remedy else expected


def _extent(vertices: Sequence[Point]) -> tuple[float, float, float, float]:
    """The smallest and the largest x, the smallest and the largest y."""
    x, y = zip(*vertices, strict=True)
    return min(x), max(x), min(y), max(y)


def _middle(vertices: Sequence[Point]) -> Point:
    """The middle of the box around them."""
    west, east, south, north = _extent(vertices)
    return (west + east) / 2, (south + north) / 2


# --- obstacles and boundaries


class _Frame(NamedTuple):
    """The metres of a field: where they are from, latitude and longitude [°], or None; and the field's middle there."""

    origin_deg: Point | None
    middle_m: Point

    def is_near(self, corners: Sequence[Point], within_m: float = ZONES_M) -> bool:
        """Whether the box around corners comes so near to the middle [m]."""
        west, east, south, north = _extent(corners)
        x, y = self.middle_m
        return west <= x + within_m and east >= x - within_m and south <= y + within_m and north >= y - within_m

    @property
    def window(self) -> tuple[Point, ...]:
        """The square within `ZONES_M` of the middle."""
        x, y = self.middle_m
        return tuple((x + i * ZONES_M, y + j * ZONES_M) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))

    def near(self, ring: Line, of: Feature, source: Text) -> Line | None:
        """The corners of an outline in the metres of the field; None where all are far away to one side."""
        corners = ring
        if self.origin_deg is not None:
            if beyond := [(x, y) for x, y in ring if abs(x) > 360 or abs(y) > 90]:
                message = "a vertex at longitude {:.6g}, latitude {:.6g}".format(*beyond[0])
                raise source.error(of.location, message, _DEGREES)
            # the plane is that of the field, where it is far the scale of its parallel
            latitude, longitude = self.origin_deg
            east_m = DEGREE_M * math.cos(math.radians(latitude))
            rough = [(east_m * ((x - longitude + 180) % 360 - 180), DEGREE_M * (y - latitude)) for x, y in ring]
            if not self.is_near(rough):
                return None
            corners = [
                to_local_m(y, x, self.origin_deg) if max(map(abs, point)) < 5 * ZONES_M else point
                for (x, y), point in zip(ring, rough, strict=True)
            ]
        return corners if self.is_near(corners) else None


def read_airspace(
    avoid: Text | None, inside: Text | None, origin_deg: Point | None, middle_m: Point, *, metres: bool = False
) -> tuple[Airspace, list[Fault]]:
    """Read obstacles and a boundary, each from a file of its own, in the metres round an origin; with notes.

    Obstacles may be points and lines, too. Of fences those to keep out of are read, or those to keep inside. The
    boundary's holes, and what is named as an obstacle in its file, are obstacles. What lies farther than `ZONES_M` from
    the middle of a field, or of what the files lie beside, is left out, which the notes say.

    Raises
    ------
    InputError
        With the faults of the file; also if it is in degrees and there is no origin, or the other way round, if
        nothing is left of a boundary, or if no obstacle is near.
    """
    frame, obstacles, boundary, notes = _Frame(origin_deg, middle_m), list[Obstacle](), list[Obstacle](), list[Fault]()
    for text, within in ((avoid, False), (inside, True)):
        if text is None:
            continue
        said: list[str] = []
        found, bounds = _zones(text, within=within, metres=metres)
        own = [each for each in found.features if each.avoided and each not in bounds] if within else []
        holes = (hole for each in bounds for _, *inner in each.polygons for hole in inner)
        own += [Feature(bounds[0].location, ("hole",), [[hole]]) for hole in holes] if within else []
        zones = _obstacles(bounds, frame, found.degrees, text, said, inside=within)
        (boundary if within else obstacles).extend(zones)
        obstacles += _obstacles(own, frame, found.degrees, text, said)
        notes += [Fault(text.name, 1, 1, note, severity="note") for note in said]
    return Airspace(tuple(obstacles), tuple(each.outline for each in boundary)), notes


def _zones(source: Text, *, within: bool, metres: bool) -> tuple[Features, list[Feature]]:
    """All features of a file, and those that are zones to keep out of, or to stay `within`."""
    fences = mission_fences(source)
    if fences is None:
        found = read_features(source, metres=metres)
        if not within:
            if not any(each.outlines for each in found.features):
                found.areas(source)
            return found, found.features
        areas = found.areas(source)
        return found, [each for each in areas if not each.avoided] or areas
    if metres:
        raise InputError.at("--metres", 1, 1, "a fence is in degrees (WGS-84)", "a fence without --metres")
    kept = [
        Feature(location, polygons=[[[(lon, lat) for lat, lon in corners]]])
        for inclusion, corners, location in fences
        if inclusion is within
    ]
    if not kept:
        other = "--avoid" if within else "--inside"
        expected = f"a fence; those of this file belong to {other}" if fences else "a fence; places to rally are none"
        raise source.error((1, 1), f"no fence to keep {'inside' if within else 'out of'}", expected)
    return Features(kept, degrees=True), kept


def _obstacles(
    features: Sequence[Feature], frame: _Frame, degrees: bool, source: Text, notes: list[str], *, inside: bool = False
) -> tuple[Obstacle, ...]:
    """Obstacles, or a boundary, in the metres of a field, checked; what is far away is left out, with notes.

    An obstacle without an area, as a mast or a power line, becomes what lies within `THIN_M` of it. Those that have no
    name are numbered.

    Raises
    ------
    InputError
        Where one has no place, nothing is near, or the units are not those of the field.
    """
    from eadp.core.geometry.polygons import clipped, near

    outlines, found = _Outlines(source, NO_AREA_M2, frame.origin_deg), list[Obstacle]()
    rings = [(ring, each) for each in features for ring in each.outlines or [[]]]
    if empty := [of for ring, of in rings if not ring]:
        what = f"{printable(empty[0].name, 40) or 'a feature'} has no place"
        raise source.error(empty[0].location, what, "a polygon, a line or a point of all that is to be kept out of")
    if rings and degrees != (frame.origin_deg is not None):
        units = ("metres", "degrees")
        message = f"is in {units[degrees]}, and what it lies beside is in {units[not degrees]}"
        raise source.error(rings[0][1].location, message, "the units of the field or plan")
    counts = outlines.counts
    for number, (ring, of) in enumerate(rings, 1):
        if (corners := frame.near(ring, of, source)) is None:
            counts["far"] += 1
            continue
        may_cross = not inside and not frame.is_near(corners, BROKEN_M)
        parts = _parts_of(corners, of, outlines, notes, may_cross=may_cross)
        if not parts and not inside:
            _check_thin(ring, of, frame, source)
            counts["small"], counts["thin"] = counts["small"] - 1, counts["thin"] + 1
            parts = near(corners, THIN_M)
        own = [outline for outline, *_ in parts]
        if any(abs(x - frame.middle_m[0]) > ZONES_M or abs(y - frame.middle_m[1]) > ZONES_M for x, y in chain(*own)):
            own = [outline for outline, *_ in clipped([[each] for each in own], [frame.window])]
            counts["far"] += not own
        name = _one_line(of.name.replace(",", " ")) or f"obstacle {number}"
        found += [Obstacle(outline, name, of.height_m) for outline in own]
    far = "polygon", f"farther than {ZONES_M / 1000:g} km left out"
    thin = "obstacle", f"without an area kept, with what lies within {THIN_M:g} m"
    said = outlines.notes(far=far, thin=thin)
    if rings and not found:
        expected = f"a polygon within {ZONES_M / 1000:g} km, in the units, grid and order of the field or plan"
        raise source.error(rings[0][1].location, "; ".join(said), expected)
    notes += said
    return tuple(found)


def _parts_of(corners: Line, of: Feature, outlines: _Outlines, notes: list[str], *, may_cross: bool) -> list[Part]:
    """The parts of an outline. One that crosses itself is refused; or taken, with a note, as the parts it has so."""
    from eadp.core.geometry.polygons import made_valid

    try:
        return outlines.parts([corners], of)
    except InputError:
        if not may_cross:
            raise
        notes.append(f"{_title(ring=0, of=of)} crosses itself, far away: taken as the parts that it has so")
        return [list(part) for part in made_valid(_tidied(corners))]


def _check_thin(ring: Line, of: Feature, frame: _Frame, source: Text) -> None:
    """Refuse an outline in metres whose numbers may be degrees."""
    west, east, south, north = _extent(ring)
    if frame.origin_deg is None and 0 < max(east - west, north - south) < 1:
        message = f"an obstacle of {east - west:.3g} m by {north - south:.3g} m, if these are metres and not degrees"
        raise source.error(of.location, message, "the units of the field or plan, or a point")


# --- what `eadp plan --avoid` and `--inside` change


def avoid(plan: Plan, file: File) -> tuple[Plan, list[Fault]]:
    """A plan with the obstacles of a file besides its own, and notes. Raises InputError as `_fenced`."""
    return _fenced(plan, read_field_text(str(file)), None)


def inside(plan: Plan, file: File) -> tuple[Plan, list[Fault]]:
    """A plan with the boundary of a file besides its own, and notes; both hold. Raises InputError as `_fenced`."""
    return _fenced(plan, None, read_field_text(str(file)))


def _fenced(plan: Plan, avoided: Text | None, boundary_file: Text | None) -> tuple[Plan, list[Fault]]:
    """A plan beside files of obstacles and of a boundary.

    Raises
    ------
    InputError
        As `read_airspace`; or where the boundaries have no ground in common.
    """
    starts_m = plan.stages[0].trigger_at(parameters_of(plan, ()))
    own, (given, notes) = plan.site.airspace, read_airspace(avoided, boundary_file, plan.site.origin_deg, starts_m)
    boundary = own.boundary or given.boundary
    if own.boundary and given.boundary:
        assert boundary_file is not None
        from eadp.core.geometry.polygons import clipped

        # two outlines have no hole in common, as their unions may have
        pairs = ((mine, each) for mine in own.boundary for each in given.boundary)
        boundary = tuple(part[0] for mine, each in pairs for part in clipped([[mine]], [each]))
        if not boundary:
            message = "no ground in common with the plan's own boundary"
            raise InputError.at(boundary_file.name, 1, 1, message, "a boundary round the plan")
    airspace = Airspace((*own.obstacles, *given.obstacles), boundary)
    return replace(plan, site=plan.site._replace(airspace=airspace)), notes


# --- files


def read_field_text(path: str) -> Text:
    """Read a text file, standard input for `-`, or the KML of a KMZ file.

    Raises
    ------
    InputError
        As `read_text`; or if an archive is damaged, has no KML, or its KML is too large.
    """
    if not (os.path.isfile(path) and zipfile.is_zipfile(path)):  # a pipe is read once
        return read_text(path)
    try:
        with zipfile.ZipFile(path) as archive:
            # the first is the document that is shown, as doc.kml
            name = next((each for each in archive.namelist() if each.lower().endswith(".kml")), None)
            if name is None:
                raise InputError.at(path, 1, 1, "an archive without a KML document", "a KMZ file")
            with archive.open(name) as document:
                return text_of(path, document.read(LIMIT_BYTES + 1))
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise InputError.at(path, 1, 1, f"cannot be read as an archive: {error}", "a KMZ file") from None

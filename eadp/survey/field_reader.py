"""Fields, obstacles and boundaries from files, in the metres of a field: read, repaired and checked."""

from __future__ import annotations

import math
import os
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import FARTHEST_M, to_geodetic_deg, to_local_m
from eadp.errors import FAULTS_SHOWN, Fault, InputError, printable, refuse
from eadp.io.text.streams import HEAD, Location, SourceText, Text, limit_bytes, read_text
from eadp.models.airspace import Airspace, Field, Obstacle
from eadp.models.doubts import NEAR_DEG
from eadp.plug_ins import plug_ins
from eadp.survey.field import NAME_LIMIT, FieldDraft, Ring, Vertex, Zones, counted
from eadp.survey.geojson import GEOJSON, is_geojson
from eadp.survey.kml import KML, read_table

HOLES_LIMIT = 1_000
"""Most holes of a field."""
EXTENT_LIMIT_M = 50_000.0
"""Largest width and height [m]: beyond it the tangent plane is distorted."""
_SMALLER = f"a field of at most {EXTENT_LIMIT_M / 1000:g} km either way"
_WIDEST_DEG, _HIGHEST_DEG = 10.0, 1.0
"""Longitudes and latitudes [°] that are always more than `EXTENT_LIMIT_M` apart, up to `LATITUDE_LIMIT_DEG`."""
LATITUDE_LIMIT_DEG = 85.0
"""Largest latitude [°], north or south."""
LARGEST_M = 1e8
"""Largest coordinate in metres: grids have numbers of seven or eight digits."""
SMALLEST_M2 = 1.0
"""Smallest area of a field and of its parts [m²]."""
NO_AREA_M2 = 0.01
"""A hole or an obstacle that is smaller has no area [m²]."""
DEGREE_M = 111_000.0
"""Length of a degree of latitude, roughly [m]."""
ZONES_M = FARTHEST_M
"""How far from a field, or from the start of a plan, obstacles and boundaries are read [m]."""
THIN_M = 10.0
"""How far around an obstacle without an area, as a mast or a power line, nothing is flown [m]."""
_FAR = f"farther than {ZONES_M / 1000:g} km left out"
VALID_SHARE = 1e-3
"""Share of its area by which a polygon that crosses or touches itself may change where it is made valid."""

RING_LIMIT = 1000
"""Most vertices of a ring: the time to find a path grows with their number."""
_TOLERANCES_M = (0.01, 0.03, 0.1, 0.3, 1.0)
"""Tolerances within which a ring of more vertices is simplified [m]."""

_MIRRORED = "longitude and latitude are swapped"
_SWAPPED = "longitude and latitude seem to be swapped"
_DEGREES = "longitude within ±180 and latitude within ±90 degrees"


Fences = Sequence[tuple[bool, Sequence[Point], Location]]
"""Whether to keep in or out of each, its corners as latitude and longitude [°], and where it stands in its file."""


@dataclass(frozen=True)
class FieldFormat:
    """A format of fields: its name, whether a text that starts so has it, and its reader."""

    name: str
    recognise: Callable[[str], bool]
    read: Callable[[SourceText, bool, str | None], FieldDraft]
    zones: Callable[[SourceText, bool, bool], Zones]


def _table_zones(source: SourceText, metres: bool, inside: bool) -> Zones:
    draft = read_table(source, metres, None)
    outlines = draft.rings[:1] if inside else draft.rings
    return Zones(outlines, draft.degrees, [replace(hole, name="hole") for hole in draft.rings[len(outlines) :]])


FORMATS = (
    FieldFormat("GeoJSON", is_geojson, GEOJSON.read, GEOJSON.zones),
    FieldFormat("KML", lambda head: head[0] == "<", KML.read, KML.zones),
    FieldFormat("CSV of vertices", lambda head: True, read_table, _table_zones),
)
"""Formats of fields; the first that recognises a text reads it."""


def read_field(text: Text, *, metres: bool = False, feature: str | None = None) -> tuple[Field, list[str]]:
    """Read the outline and the holes of a field.

    Parameters
    ----------
    text : Text
        GeoJSON (a Polygon, a MultiPolygon, or a Feature, FeatureCollection or GeometryCollection with one), KML
        (a Placemark with a Polygon), or a CSV of vertices: columns `x_m,y_m` or `lon,lat` and perhaps `ring` (0 the
        outline, 1.. the holes), or two columns without names.
    metres : bool, optional
        The file is in metres, x east and y north, whatever it states; default: as it states, or WGS-84 degrees.
    feature : str, optional
        Of several features, the one to read: its id, its name, or its number from 1 among those with polygons.

    Returns
    -------
    field : Field
        Metres; the vertices in the order of the file, without those that were dropped, some rings reversed.
    repaired : list of str
        The repairs, a sentence each.

    Raises
    ------
    InputError
        With the faults of the file, each at its line and column, or of the options.
    """
    source = SourceText(text)
    if _fences(source) is not None:
        expected = "a field; the fences of a mission belong to --inside FILE and --avoid FILE"
        raise source.error((1, 1), "is a mission or a fence, not a field", expected)
    return _field(_format(source).read(source, metres, feature), source)


def read_airspace(
    avoid: Text | None,
    inside: Text | None,
    origin_deg: tuple[float, float] | None,
    middle_m: Point,
    *,
    metres: bool = False,
) -> tuple[Airspace, list[Fault]]:
    """Read obstacles and a boundary, each from a file of its own, in the metres round an origin; with notes.

    The boundary's holes, and what is named as an obstacle in its file, are obstacles, too.

    Raises
    ------
    InputError
        As `read_zones`.
    """
    frame = _Frame(origin_deg, middle_m)
    (obstacles, _, notes), (outlines, own, more) = (
        ((), (), []) if text is None else _zones(text, frame, metres=metres, inside=within)
        for text, within in ((avoid, False), (inside, True))
    )
    return Airspace((*obstacles, *own), tuple(each.outline for each in outlines)), [*notes, *more]


def read_zones(
    text: Text,
    origin_deg: tuple[float, float] | None,
    middle_m: Point = (0.0, 0.0),
    *,
    metres: bool = False,
    inside: bool = False,
) -> tuple[tuple[Obstacle, ...], list[Fault]]:
    """Read the outlines of all polygons of a file, as obstacles or as a boundary, in the metres round an origin.

    Obstacles may be points and lines, too; those that have no name are numbered. Of fences, those to keep inside are
    read, or those to keep out of. What lies farther than `ZONES_M` from the middle of a field, or of what the file lies
    beside, is left out, which the notes say. Without an origin, latitude and longitude, that is in metres.

    Raises
    ------
    InputError
        With the faults of the file; also if it is in degrees and there is no origin, or the other way round, if
        nothing is left of a boundary, or if no obstacle in metres is near.
    """
    obstacles, _, notes = _zones(text, _Frame(origin_deg, middle_m), metres=metres, inside=inside)
    return obstacles, notes


def _zones(
    text: Text, frame: _Frame, *, metres: bool, inside: bool
) -> tuple[tuple[Obstacle, ...], tuple[Obstacle, ...], list[Fault]]:
    """As `read_zones`, and the obstacles within a boundary: its holes, and what is named so."""
    source = SourceText(text)
    fences = _fences(source)
    if fences is None:
        rings, degrees, within = _format(source).zones(source, metres, inside)
    else:
        rings, degrees, within = _fence_zones(fences, source, metres, inside)
    if degrees != (frame.origin_deg is not None):
        units = ("metres", "degrees")
        message = f"is in {units[degrees]}, and what it lies beside is in {units[not degrees]}"
        raise source.error(rings[0].location, message, "the units of the field or plan")
    notes: list[str] = []
    found = _obstacles(rings, frame, source, notes, inside=inside)
    own = _obstacles(within, frame, source, notes)
    return found, own, [Fault(source.name, 1, 1, note, severity="note") for note in notes]


class _Frame(NamedTuple):
    """The metres of a field: where they are from, latitude and longitude [°], or None; and the field's middle there."""

    origin_deg: tuple[float, float] | None
    middle_m: Point

    def is_near(self, corners: Sequence[Point]) -> bool:
        """Whether the box around corners comes within `ZONES_M` of the middle."""
        return all(
            min(values) <= middle + ZONES_M and max(values) >= middle - ZONES_M
            for values, middle in zip(zip(*corners, strict=True), self.middle_m, strict=True)
        )

    def is_within(self, corners: Sequence[Point]) -> bool:
        """Whether all corners are within `ZONES_M` of the middle, to the east and to the north."""
        return all(abs(x - self.middle_m[0]) <= ZONES_M and abs(y - self.middle_m[1]) <= ZONES_M for x, y in corners)

    @property
    def window(self) -> tuple[Point, ...]:
        """The square within `ZONES_M` of the middle."""
        x, y = self.middle_m
        return tuple((x + i * ZONES_M, y + j * ZONES_M) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1)))


def _obstacles(
    rings: Sequence[Ring], frame: _Frame, source: SourceText, notes: list[str], *, inside: bool = False
) -> tuple[Obstacle, ...]:
    """Obstacles, or a boundary, in the metres of a field, checked; what is far away is left out, with notes.

    An obstacle without an area, as a mast or a power line, becomes what lies within `THIN_M` of it.

    Raises
    ------
    InputError
        Where nothing is near that can be meant.
    """
    from eadp.core.geometry.polygons import clipped, near

    found: list[Obstacle] = []
    counts: Counter[str] = Counter()
    for number, ring in enumerate(rings, 1):
        corners = _near_corners(ring, frame, source) if ring.vertices else []
        outlines: list[tuple[Point, ...]] = []
        if not corners:
            counts["far" if corners is None else "small"] += 1
        else:
            parts = _solid_parts([corners], ring, source, counts, NO_AREA_M2)
            if not parts and not inside:
                _check_thin(ring, frame, source)
                counts["small"], counts["thin"] = counts["small"] - 1, counts["thin"] + 1
                parts = near(corners, THIN_M)
            outlines = [outline for outline, *_ in parts]
            if not all(map(frame.is_within, outlines)):
                outlines = [outline for outline, *_ in clipped([[each] for each in outlines], [frame.window])]
                counts["far"] += not outlines
        name = printable(" ".join(ring.name.replace(",", " ").split()), NAME_LIMIT) or f"obstacle {number}"
        found += [Obstacle(outline, name, ring.height_m) for outline in outlines]
    _note(
        counts,
        notes,
        far=("polygon", "polygons", _FAR),
        small=_small(NO_AREA_M2),
        thin=("obstacle", "obstacles", f"without an area kept, with what lies within {THIN_M:g} m"),
    )
    if rings and not found:
        at = rings[0].location
        if any(_near_if_swapped(ring, frame, source) for ring in rings):
            expected = "the order of the field or plan, in which they may be swapped instead"
            raise source.error(at, f"lies near the field or plan if {_MIRRORED}", expected)
        if inside or frame.origin_deg is None:  # in degrees a file may have the obstacles of a country
            expected = f"a polygon within {ZONES_M / 1000:g} km, in the units and the grid of the field or plan"
            raise source.error(at, "; ".join(notes), expected)
    return tuple(found)


def _check_thin(ring: Ring, frame: _Frame, source: SourceText) -> None:
    """Refuse a polygon in metres whose numbers may be degrees."""
    west, east, south, north = _extent(ring.vertices)
    if frame.origin_deg is None and 0 < max(east - west, north - south) < 1:
        message = f"an obstacle of {east - west:.3g} m by {north - south:.3g} m, if these are metres and not degrees"
        raise source.error(ring.location, message, "the units of the field or plan, or a point")


def _near_corners(ring: Ring, frame: _Frame, source: SourceText) -> list[Point] | None:
    """The corners of a polygon in the metres of a field; None where all are far away to one side."""
    origin_deg = frame.origin_deg
    if origin_deg is None:
        corners = [(vertex.x, vertex.y) for vertex in ring.vertices]
    else:
        for vertex in ring.vertices:
            if not (abs(vertex.x) <= 180 and abs(vertex.y) <= 90):
                raise source.error(vertex.location, f"a vertex at {vertex.y:.6g}, {vertex.x:.6g}", _DEGREES)
        # the plane is that of the field, where it is far the scale of its parallel
        latitude, longitude = origin_deg
        east_m = DEGREE_M * math.cos(math.radians(latitude))
        rough = [
            (east_m * ((vertex.x - longitude + 180) % 360 - 180), DEGREE_M * (vertex.y - latitude))
            for vertex in ring.vertices
        ]
        if not frame.is_near(rough):
            return None
        corners = [
            to_local_m(vertex.y, vertex.x, origin_deg) if max(map(abs, point)) < 5 * ZONES_M else point
            for vertex, point in zip(ring.vertices, rough, strict=True)
        ]
    return corners if frame.is_near(corners) else None


def _near_if_swapped(ring: Ring, frame: _Frame, source: SourceText) -> bool:
    """Whether a polygon that is far from a field is near it with its longitudes and latitudes swapped."""
    if frame.origin_deg is None or any(abs(vertex.x) > 90 for vertex in ring.vertices):
        return False
    mirrored = replace(ring, vertices=[vertex._replace(x=vertex.y, y=vertex.x) for vertex in ring.vertices])
    far, near = (_near_corners(each, frame, source) for each in (ring, mirrored))
    return far is None and near is not None


def _solid_parts(
    corners: Sequence[Sequence[Point]], ring: Ring, source: SourceText, counts: Counter[str], smallest_m2: float
) -> list[list[tuple[Point, ...]]]:
    """A polygon's outline and holes as parts without flaws; none where it has no area. Counts what is left out.

    Raises
    ------
    InputError
        Where they cross or touch one another, or themselves, so that repairing them would change the area.
    """
    from eadp.core.geometry.polygons import flaws, ground_m2, tidy

    kept: list[tuple[Point, ...]] = []
    for k, closed in enumerate(corners):
        open_ring = closed[:-1] if len(closed) > 1 and closed[0] == closed[-1] else closed
        indices = tidy(open_ring).kept
        outline = tuple(open_ring[i] for i in indices)
        if len(indices) < 3 or ground_m2(outline) < (NO_AREA_M2 if k else smallest_m2):
            counts["holes" if k else "small"] += 1
            if k == 0:
                return []
        else:
            kept.append(outline)
    parts = _made_valid(kept, counts)
    if parts is None:
        flaw = next(flaws(kept[0], kept[1:]))
        message = f"a polygon {flaw.message} at ({flaw.point_m[0]:.2f}, {flaw.point_m[1]:.2f}) m"
        raise source.error(ring.location, message, "a ring that neither crosses nor touches itself")
    return parts


def _made_valid(rings: Sequence[tuple[Point, ...]], counts: Counter[str]) -> list[list[tuple[Point, ...]]] | None:
    """Rings without flaws, made valid if need be, as parts; None where that would change their area."""
    from eadp.core.geometry.polygons import flaws, ground_m2, made_valid, signed_area_m2

    if next(flaws(rings[0], rings[1:]), None) is None:
        return [list(rings)]
    outline_m2, *holes_m2 = (abs(signed_area_m2(ring)) for ring in rings)
    before_m2 = outline_m2 - sum(holes_m2)
    parts = [part for part in made_valid(*rings) if ground_m2(*part) >= VALID_SHARE * before_m2]
    after_m2 = sum(ground_m2(*part) for part in parts)
    if not abs(after_m2 - before_m2) < VALID_SHARE * before_m2:
        return None
    counts["repaired"] += 1
    return parts


_DROPPED = {
    "repeated": ("repeated vertex", "repeated vertices", "dropped"),
    "in_line": ("vertex in line with its neighbours", "vertices in line with their neighbours", "dropped"),
    "spikes": ("spike", "spikes", "dropped"),
    "holes": ("hole", "holes", "without an area left out"),
    "repaired": ("outline", "outlines", "that crossed or touched itself repaired, by less than 0.1 % of the area"),
}
"""What is counted, one and several, and what was done with it."""


def _note(counts: Counter[str], notes: list[str], **others: tuple[str, str, str]) -> None:
    """Add sentences on what was left out and repaired; `others` are counted too, as `_DROPPED`."""
    for key, (one, several, what) in (others | _DROPPED).items():
        if counts[key]:
            notes.append(f"{counted(counts[key], one, several)} {what}")


def _small(smallest_m2: float) -> tuple[str, str, str]:
    return "polygon", "polygons", f"of less than {smallest_m2:g} m² left out"


def _fences(source: SourceText) -> Fences | None:
    """The fences of a mission; None where a text is none."""
    found: Iterator[Fences | None] = (read(source) for read in plug_ins("fences"))
    return next((each for each in found if each is not None), None)


def _fence_zones(fences: Fences, source: SourceText, metres: bool, inside: bool) -> Zones:
    """The fences to keep in or out of; raises InputError."""
    if metres:
        raise InputError.at("--metres", 1, 1, "a fence is in degrees (WGS-84)", "a fence without --metres")
    wanted = [(corners, location) for inclusion, corners, location in fences if inclusion is inside]
    if not wanted:
        other = "--avoid" if inside else "--inside"
        expected = f"a fence; those of this file belong to {other}" if fences else "a fence; places to rally are none"
        raise source.error((1, 1), f"no fence to keep {'inside' if inside else 'out of'}", expected)
    rings = [Ring([Vertex(lon, lat, location) for lat, lon in corners], location) for corners, location in wanted]
    return Zones(rings, degrees=True)


def _format(source: SourceText) -> FieldFormat:
    head = source.body.lstrip()[:HEAD]
    if not head:
        raise source.error((1, 1), "is empty", "a field as GeoJSON, KML or a CSV of vertices")
    return next(each for each in FORMATS if each.recognise(head))


def _field(draft: FieldDraft, source: SourceText) -> tuple[Field, list[str]]:
    """The field of a draft, repaired and checked, and the repairs."""
    from eadp.core.geometry.polygons import joined, signed_area_m2

    notes = list(draft.notes)
    draft = _without_small(draft, notes)
    _check_counts(draft, source)
    rings, origin_deg = _in_metres([ring.vertices for ring in draft.rings], draft, source, notes)
    rings = _simplified(rings, source, notes)
    rings = _repaired(rings, draft, source, notes)
    counts: Counter[str] = Counter()
    parts = _sound(rings, origin_deg, source, counts)
    frame = _Frame(origin_deg, _middle(rings[0]))
    for part in draft.others:
        parts += _part(part, frame, source, counts)
    _note(counts, notes, small=_small(SMALLEST_M2))
    if len(parts) > 1 and (union := joined(parts, SMALLEST_M2)) is not None:
        parts = union
        notes.append("polygons that overlap joined: ground counts once")
    counter_clockwise = [signed_area_m2(ring) > 0 for ring in parts[0]]
    # the outline runs counter-clockwise, the holes clockwise
    wound = [
        ring if up == (i == 0) else (ring[0], *ring[:0:-1])
        for i, (ring, up) in enumerate(zip(parts[0], counter_clockwise, strict=True))
    ]
    airspace = Airspace(_obstacles(draft.obstacles, frame, source, notes))
    others = tuple(map(tuple, parts[1:]))
    result = Field(wound[0], tuple(wound[1:]), printable(draft.name), origin_deg, airspace, others)
    if result.area_m2 < SMALLEST_M2:
        message = f"an area of {result.area_m2:.3g} m²"
        raise source.error(rings[0][0].location, message, f"{SMALLEST_M2:g} m² or more")
    if not counter_clockwise[0]:
        notes.append("winding of the outline reversed")
    if holes := sum(counter_clockwise[1:]):
        notes.append(f"winding of {counted(holes, 'hole', 'holes')} reversed")
    return result, notes


def _without_small(draft: FieldDraft, notes: list[str]) -> FieldDraft:
    """The draft without polygons that have no area, where another one has; holes without one become obstacles."""
    counts: Counter[str] = Counter()
    parts, thin = [], list[Ring]()
    for part in (draft.rings, *draft.others):
        if _is_small(part[0], draft.degrees, SMALLEST_M2):
            counts["small"] += 1
            continue
        small = [ring for ring in part[1:] if _is_small(ring, draft.degrees, NO_AREA_M2)]
        thin += [replace(ring, name="hole") for ring in small if ring.vertices]
        parts.append([ring for ring in part if ring not in small])
    if not parts:
        return draft
    _note(counts, notes, small=_small(SMALLEST_M2))
    return replace(draft, rings=parts[0], others=parts[1:], obstacles=[*draft.obstacles, *thin])


def _is_small(ring: Ring, degrees: bool, smallest_m2: float) -> bool:
    """Whether a ring encloses less than an area."""
    from eadp.core.geometry.polygons import ground_m2

    if len({vertex[:2] for vertex in ring.vertices}) < 3:
        return True
    if max(max(abs(vertex.x), abs(vertex.y)) for vertex in ring.vertices) > LARGEST_M:
        return False  # which is refused later
    x, y, _ = ring.vertices[0]
    north = DEGREE_M if degrees else 1.0
    east = north * math.cos(math.radians(y)) if degrees else 1.0
    return ground_m2([(east * (vertex.x - x), north * (vertex.y - y)) for vertex in ring.vertices]) < smallest_m2


def _sound(
    rings: Sequence[Sequence[Vertex]], origin_deg: tuple[float, float] | None, source: SourceText, counts: Counter[str]
) -> list[list[tuple[Point, ...]]]:
    """An outline and its holes without flaws, made valid if that hardly changes their area; else raises the flaws."""
    corners = [tuple((vertex.x, vertex.y) for vertex in ring) for ring in rings]
    parts = _made_valid(corners, counts)
    if parts is None:
        _check_shape(rings, origin_deg, source)
    return parts or [corners]


def _part(
    part: Sequence[Ring], frame: _Frame, source: SourceText, counts: Counter[str]
) -> list[list[tuple[Point, ...]]]:
    """Another polygon of a field in its metres, as parts without flaws."""
    moved = []
    for ring in part:
        corners = _near_corners(ring, frame, source)
        if corners is None:
            swapped = f", and near it if {_MIRRORED}" if _near_if_swapped(ring, frame, source) else ""
            raise source.error(ring.location, f"is far from the field{swapped}", f"within {ZONES_M / 1000:g} km")
        moved.append([Vertex(x, y, vertex.location) for (x, y), vertex in zip(corners, ring.vertices, strict=True)])
    rings = _simplified(moved, source, [])
    return _solid_parts(
        [[(vertex.x, vertex.y) for vertex in ring] for ring in rings], part[0], source, counts, SMALLEST_M2
    )


def _simplified(rings: list[list[Vertex]], source: SourceText, notes: list[str]) -> list[list[Vertex]]:
    """The rings, each of more than `RING_LIMIT` vertices within the smallest tolerance that is enough."""
    from eadp.core.geometry.polygons import simplified

    result = list(rings)
    for i, ring in enumerate(rings):
        if len(ring) <= RING_LIMIT:
            continue
        for tolerance_m in _TOLERANCES_M:
            kept = simplified([(vertex.x, vertex.y) for vertex in ring], tolerance_m)
            if len(kept) <= RING_LIMIT:
                break
        else:
            what = f"{_title(i)} has {len(ring)} vertices, and needs {len(kept)} to be right within {tolerance_m:g} m"
            raise source.error(ring[0].location, what, f"at most {RING_LIMIT}")
        result[i] = [ring[j] for j in kept]
        notes.append(f"{_title(i)} simplified within {tolerance_m:g} m: {len(kept)} of {len(ring)} vertices")
    return result


def _check_counts(draft: FieldDraft, source: SourceText) -> None:
    """Refuse rings without three vertices, and more holes than there may be."""
    if len(draft.rings) - 1 > HOLES_LIMIT:
        location = draft.rings[HOLES_LIMIT + 1].location
        raise source.error(location, f"more than {HOLES_LIMIT} holes", f"at most {HOLES_LIMIT}")
    faults = []
    for i, ring in enumerate(draft.rings):
        count = len({vertex[:2] for vertex in ring.vertices})
        if count < 3:
            location = ring.vertices[0].location if ring.vertices else ring.location
            message = f"{_title(i)} has {counted(count, 'vertex', 'vertices')}"
            faults.append(source.fault(location, message, "three or more that differ"))
    refuse(faults)


def _title(ring: int) -> str:
    return f"hole {ring}" if ring else "the outline"


def _in_metres(
    rings: list[list[Vertex]], draft: FieldDraft, source: SourceText, notes: list[str]
) -> tuple[list[list[Vertex]], tuple[float, float] | None]:
    """The rings of a draft in metres, checked; of one in degrees also the place of its origin [°]."""
    origin_deg: tuple[float, float] | None = None
    if draft.degrees:
        rings, origin_deg = _localised(rings, draft, source, notes)
    else:
        _check_metres(rings, draft, source)
    _check_extent(rings, draft, source)
    return rings, origin_deg


def _localised(
    rings: Sequence[Sequence[Vertex]], draft: FieldDraft, source: SourceText, notes: list[str]
) -> tuple[list[list[Vertex]], tuple[float, float]]:
    """Metres east and north of the middle of the outline, and that middle as latitude and longitude [°]."""
    _check_degrees(rings, draft, source)
    rings = [list(ring) for ring in rings]
    west, east, south, north = _extent(rings[0])
    if east - west > 180:
        moved = [[v._replace(x=v.x + 360) if v.x < 0 else v for v in ring] for ring in rings]
        from_west, to_east, *_ = _extent(moved[0])
        if to_east - from_west < _WIDEST_DEG:
            rings, west, east = moved, from_west, to_east
            notes.append("longitudes counted on across the antimeridian")
    middle = (west + east) / 2
    origin = (round((south + north) / 2, 7) + 0.0, round(middle - 360 if middle > 180 else middle, 7) + 0.0)
    start = rings[0][0]
    for vertex in chain.from_iterable(rings):
        # refused before the projection, which maps both sides of the earth to the same plane
        dx, dy = abs(vertex.x - start.x), abs(vertex.y - start.y)
        if dx > _WIDEST_DEG or dy > _HIGHEST_DEG:
            message = f"{dx:.6g}° of longitude and {dy:.6g}° of latitude from the first vertex"
            here = start.x, start.y
            if all(min(math.dist(each, here) for each in (v[:2], v[1::-1])) < NEAR_DEG for v in chain(*rings)):
                message += f": {_SWAPPED} in some vertices"
            raise source.error(vertex.location, message, _or(_SMALLER, draft.remedy))
    return [
        [Vertex(*to_local_m(vertex.y, vertex.x, origin), vertex.location) for vertex in ring] for ring in rings
    ], origin


def _or(expected: str, remedy: str) -> str:
    return f"{expected}, or {remedy}" if remedy else expected


def _extent(vertices: Sequence[Vertex]) -> tuple[float, float, float, float]:
    """The smallest and the largest x, the smallest and the largest y."""
    x, y, _ = zip(*vertices, strict=True)
    return min(x), max(x), min(y), max(y)


def _middle(vertices: Sequence[Vertex]) -> Point:
    """The middle of the box around them."""
    west, east, south, north = _extent(vertices)
    return (west + east) / 2, (south + north) / 2


def _check_degrees(rings: Sequence[Sequence[Vertex]], draft: FieldDraft, source: SourceText) -> None:
    """Refuse what cannot be degrees: metres, or longitude and latitude swapped."""
    vertices = [vertex for ring in rings for vertex in ring]
    beyond = [vertex for vertex in vertices if abs(vertex.x) > 180 or abs(vertex.y) > 90]
    if beyond:
        first = beyond[0]
        which, value, limit = ("longitude", first.x, 180) if abs(first.x) > 180 else ("latitude", first.y, 90)
        message = f"a {which} of {value:.10g} is beyond ±{limit}, as in {len(beyond)} of {len(vertices)} vertices"
        if all(abs(vertex.x) <= 90 and abs(vertex.y) <= 180 for vertex in vertices):
            message = f"a latitude of {value:.10g} is beyond ±90: {_SWAPPED}"
        raise source.error(first.location, message, _or(_DEGREES, draft.remedy))
    for vertex in vertices:
        if abs(vertex.y) > LATITUDE_LIMIT_DEG:
            message = f"a latitude of {vertex.y:.10g}, near a pole"
            if all(abs(each.x) <= LATITUDE_LIMIT_DEG for each in vertices):
                message += f": {_SWAPPED}"
            raise source.error(vertex.location, message, f"latitudes within ±{LATITUDE_LIMIT_DEG:g}")


def _check_metres(rings: Sequence[Sequence[Vertex]], draft: FieldDraft, source: SourceText) -> None:
    """Refuse what cannot be metres: very large numbers, and degrees."""
    far = [vertex for ring in rings for vertex in ring if max(abs(vertex.x), abs(vertex.y)) > LARGEST_M]
    if far:
        message = f"a vertex at ({far[0].x:.3g}, {far[0].y:.3g}) m"
        raise source.error(far[0].location, message, f"coordinates of at most {LARGEST_M:g} m")
    west, east, south, north = _extent(rings[0])
    degrees = max(abs(west), abs(east)) <= 180 and max(abs(south), abs(north)) <= 90
    if degrees and max(east - west, north - south) < 1:
        message = f"a field of {east - west:.3g} m by {north - south:.3g} m, if these are metres and not degrees"
        raise source.error(rings[0][0].location, message, _or("a larger field", draft.remedy))


def _check_extent(rings: Sequence[Sequence[Vertex]], draft: FieldDraft, source: SourceText) -> None:
    """Refuse a field that is too large, at the vertex furthest from the first."""
    vertices = [vertex for ring in rings for vertex in ring]
    west, east, south, north = _extent(vertices)
    if max(east - west, north - south) > EXTENT_LIMIT_M:
        start = vertices[0]
        furthest = max(vertices, key=lambda vertex: math.dist(vertex[:2], start[:2]))
        message = f"{(east - west) / 1000:.4g} km by {(north - south) / 1000:.4g} km"
        raise source.error(furthest.location, message, _or(_SMALLER, draft.remedy))


def _repaired(
    rings: Sequence[Sequence[Vertex]], draft: FieldDraft, source: SourceText, notes: list[str]
) -> list[list[Vertex]]:
    """The rings open and without superfluous vertices; raises the faults of those without an area."""
    from eadp.core.geometry.polygons import TOLERANCE_M, tidy

    counts: Counter[str] = Counter()
    faults: list[Fault] = []
    result = []
    for i, ring in enumerate(rings):
        closed = len(ring) > 1 and math.dist(ring[0][:2], ring[-1][:2]) < TOLERANCE_M
        vertices = list(ring[:-1] if closed else ring)
        counts["closed" if closed else "open"] += 1
        tidied = tidy([(vertex.x, vertex.y) for vertex in vertices])
        if len(tidied.kept) < 3:
            message = f"{_title(i)} has no area"
            faults.append(source.fault(ring[0].location, message, "vertices that do not lie on one line"))
        counts.update(repeated=tidied.repeated, in_line=tidied.in_line, spikes=tidied.spikes)
        result.append([vertices[j] for j in tidied.kept])
    refuse(faults)
    if draft.closes:
        _note(counts, notes, open=("open ring", "open rings", "closed"))
    else:
        _note(counts, notes, closed=("closing vertex", "closing vertices", "dropped"))
    return result


def _check_shape(rings: Sequence[Sequence[Vertex]], origin_deg: tuple[float, float] | None, source: SourceText) -> None:
    """Refuse rings that cross themselves or one another, at the nearest vertex of the ring."""
    from eadp.core.geometry.polygons import flaws

    outline, *holes = [[(vertex.x, vertex.y) for vertex in ring] for ring in rings]
    faults = []
    for flaw in islice(flaws(outline, holes), FAULTS_SHOWN):
        x, y = flaw.point_m
        where = f"({x:.2f}, {y:.2f}) m"
        if origin_deg is not None:
            latitude, longitude = to_geodetic_deg(x, y, origin_deg)
            where = f"longitude {longitude:.7f}, latitude {latitude:.7f}, which is {where}"
        nearest = min(rings[flaw.ring], key=lambda vertex: math.dist(vertex[:2], (x, y)))
        expected = "holes within the outline and apart from one another"
        if flaw.message.endswith("itself"):
            expected = "a ring that neither crosses nor touches itself"
        faults.append(source.fault(nearest.location, f"{_title(flaw.ring)} {flaw.message} at {where}", expected))
    refuse(faults)


_ZIP, _SHAPEFILE = b"PK\x03\x04", b"\x00\x00\x27\x0a"
_AS_GEOJSON = "GeoJSON, as by ogr2ogr -t_srs EPSG:4326 field.geojson {}"


def read_field_text(path: str) -> Text:
    """Read a text file, standard input for `-`, or the KML of a KMZ file.

    Raises
    ------
    InputError
        As `read_text`; or of a shapefile, and if an archive is damaged, has no KML, or its KML is too large.
    """
    head = _head(path)
    if head == _SHAPEFILE:
        raise InputError.at(path, 1, 1, "is a shapefile, which is not read", _AS_GEOJSON.format(path))
    if head != _ZIP:
        return read_text(path)
    try:
        with zipfile.ZipFile(path) as archive:
            # the first is the document that is shown, as doc.kml
            names = {os.path.splitext(name)[1].lower(): name for name in reversed(archive.namelist())}
            if ".kml" in names:
                with archive.open(names[".kml"]) as stream:
                    return _kml_text(path, stream.read(limit_bytes() + 1))
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        message = f"cannot be read as an archive: {error}"
        raise InputError.at(path, 1, 1, message, "a KMZ file") from None
    if ".shp" in names:
        message, expected = "is an archive of a shapefile, which is not read", _AS_GEOJSON.format(f"/vsizip/{path}")
        raise InputError.at(path, 1, 1, message, expected)
    raise InputError.at(path, 1, 1, "an archive without a KML document", "a KMZ file")


def _kml_text(path: str, data: bytes) -> Text:
    if len(data) > limit_bytes():
        raise InputError.at(path, 1, 1, "its KML is too large", f"at most {limit_bytes()} bytes")
    try:
        body = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError.at(path, 1, 1, "its KML is not UTF-8 text", "UTF-8 text") from None
    return Text(path, body.replace("\r\n", "\n").replace("\r", "\n"))


def _head(path: str) -> bytes:
    """The first bytes of a regular file; none where there is no such, whose reading as a text raises it."""
    if not os.path.isfile(path):
        return b""
    try:
        with open(path, "rb") as stream:
            return stream.read(len(_ZIP))
    except OSError:
        return b""

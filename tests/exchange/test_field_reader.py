"""Fields: what is read and what is mended, and every refusal with its feature's line; archives."""

import json
import math
import zipfile

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.core.geometry.polygons import TOLERANCE_M, signed_area_m2, simplified
from eadp.errors import FAULTS_SHOWN, InputError
from eadp.exchange.features import VERTICES_LIMIT
from eadp.exchange.field_reader import RING_LIMIT, ZONES_M, read_airspace, read_field, read_field_text
from eadp.io.text.json import NESTING_LIMIT
from eadp.io.text.streams import Text
from eadp.models.airspace import Field

MICROMETRE, MILLIMETRE = 1e-6, 1e-3
ODENSE = (55.37, 10.43)
BOX = ((0.0, 0.0), (100.0, 0.0), (100.0, 80.0), (0.0, 80.0))
POND = ((20.0, 20.0), (20.0, 40.0), (40.0, 40.0), (40.0, 20.0))  # clockwise, as holes are
WIDE = "a field of at most 50 km either way"


def read_zones(text, origin_deg, *, inside=False):
    """The outlines of a file of obstacles, or of a boundary, and the notes."""
    found, notes = read_airspace(*((None, text) if inside else (text, None)), origin_deg, (0.0, 0.0))
    return found.boundary if inside else tuple(each.outline for each in found.obstacles), notes


def read(body, **options) -> tuple[Field, list[str]]:
    return read_field(Text("f", body), **options)


def field_of(body, **options) -> Field:
    """The field of a file that nothing had to be mended in."""
    field, mended = read(body, **options)
    assert mended == []
    return field


def faults_of(body, **options) -> list[str]:
    with pytest.raises(InputError) as caught:
        read(body, **options)
    return [str(fault).splitlines()[0].removeprefix("f:") for fault in caught.value.faults]


def fault_of(body, **options) -> str:
    (fault,) = faults_of(body, **options)
    return fault


def polygon(*rings, **members) -> str:
    """A Polygon with a vertex in each line, its first ring's first in line 2; a line between two rings."""
    bodies = [",\n".join(json.dumps(position) for position in ring) for ring in rings]
    more = "".join(f", {json.dumps(key)}: {json.dumps(value)}" for key, value in members.items())
    return '{"type": "Polygon", "coordinates": [[\n' + "\n],\n[".join(bodies) + "\n]]" + more + "}\n"


def in_metres(*rings) -> str:
    return polygon(*([*ring, ring[0]] for ring in rings), units="m, local frame")


def table(ring, header="x_m,y_m") -> str:
    return "\n".join([header, *(f"{x!r},{y!r}" for x, y in ring)]) + "\n"


def around(ring, origin=ODENSE) -> list[tuple[float, float]]:
    """Longitudes and latitudes of points of the plane, closed."""
    degrees = [to_geodetic_deg(x, y, origin)[::-1] for x, y in ring]
    return [*degrees, degrees[0]]


def kml(*placemarks) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        + "\n".join(placemarks)
        + "\n</Document></kml>\n"
    )


def placemark(*rings, name="") -> str:
    """A Placemark: the outline's coordinates begin two lines below it, those of a hole two lines after."""
    text = f"<Placemark><name>{name}</name><Polygon>"
    for i, ring in enumerate(rings):
        tag = "innerBoundaryIs" if i else "outerBoundaryIs"
        text += f"\n<{tag}><LinearRing><coordinates>\n" + " ".join(",".join(map(repr, vertex)) for vertex in ring)
        text += f"\n</coordinates></LinearRing></{tag}>"
    return text + "</Polygon></Placemark>"


def same_ring(left, right) -> bool:
    """Whether two rings are the same up to the vertex they start at."""
    return any(tuple(left[i:] + left[:i]) == tuple(right) for i in range(len(left)))


@st.composite
def stars(draw):
    """A ring that does not cross itself, counter-clockwise, each of its vertices a corner: to a centimetre."""
    n = draw(st.integers(3, 10))
    angles = [2 * math.pi * (i + draw(st.floats(0.05, 0.45))) / n for i in range(n)]
    radii = [draw(st.floats(20, 200)) for _ in angles]
    ring = tuple(
        (round(r * math.cos(a), 2) + 0.0, round(r * math.sin(a), 2) + 0.0) for r, a in zip(radii, angles, strict=True)
    )
    assume(len(simplified(ring, TOLERANCE_M)) == n)
    return ring


# --- the formats ------------------------------------------------------------------------------------------------------


def test_a_field_is_read_from_each_format():
    rings = [[(x - 50, y - 40) for x, y in ring] for ring in (BOX, POND)]
    degrees = [around(ring) for ring in rings]
    for body in (polygon(*degrees), kml(placemark(*degrees))):
        field = field_of(body)
        assert field.origin_deg == ODENSE
        for ring, expected in zip((field.outline, *field.holes), rings, strict=True):
            assert sum(ring, ()) == pytest.approx(sum(expected, ()), abs=MICROMETRE)
    for body in (
        "lon,lat\n" + "".join(f"{lon!r},{lat!r}\n" for lon, lat in degrees[0]),
        "Latitude [deg];Longitude [deg]\n" + "".join(f"{lat!r};{lon!r}\n" for lon, lat in degrees[0]),
    ):
        assert sum(field_of(body).outline, ()) == pytest.approx(sum(rings[0], ()), abs=MICROMETRE)
    assert field_of(in_metres(BOX, POND)) == Field(BOX, (POND,))
    assert Field(BOX, (POND,)).area_m2 == 100 * 80 - 20 * 20


@given(stars(), st.data())
def test_the_same_polygon_reads_to_the_same_field(ring, data):
    start = data.draw(st.integers(0, len(ring) - 1))
    written = [*ring[start:], *ring[:start]]
    for i in sorted(data.draw(st.lists(st.integers(0, len(ring) - 1), max_size=4)), reverse=True):
        written.insert(i, written[i])
    written += written[:1] * data.draw(st.integers(0, 2))
    written = written[:: data.draw(st.sampled_from([1, -1]))]
    for body in (table(written), polygon(written, units="m"), "x y\n" + "".join(f"{x} {y}\n" for x, y in written)):
        assert same_ring(read(body)[0].outline, ring)


@given(stars(), st.floats(-80, 80), st.one_of(st.floats(-180, 180), st.sampled_from([-180.0, 179.9999, -179.9999])))
def test_degrees_are_those_of_the_vertices(ring, latitude, longitude):
    degrees = around(ring, (latitude, longitude))
    field, _ = read(polygon(degrees))
    assert abs(field.origin_deg[1]) <= 180
    assert field.origin_deg == tuple(round(value, 7) for value in field.origin_deg)
    assert len(field.outline) == len(ring)
    for (x, y), (lon, lat) in zip(field.outline, degrees, strict=False):
        back = to_geodetic_deg(x, y, field.origin_deg)
        # 400 m from the origin the way back is d³/2R² = 1 µm short
        assert to_local_m(*back, (lat, lon)) == pytest.approx((0, 0), abs=2 * MICROMETRE)


@pytest.mark.parametrize(
    "wrap",
    [
        '{"type": "MultiPolygon", "coordinates": [%s]}',
        '{"type": "Feature", "properties": null, "geometry": {"type": "Polygon", "coordinates": %s}}',
        '{"type": "FeatureCollection", "features": [{"type": "Feature", "geometry": null}, {"type": "Feature", '
        '"geometry": {"type": "MultiPolygon", "coordinates": [%s]}}]}',
        '{"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [1, 2]}, '
        '{"type": "Polygon", "coordinates": %s}]}',
    ],
)
def test_geojson_of_every_type(wrap):
    coordinates = json.loads(polygon([*BOX, BOX[0]]))["coordinates"]
    assert field_of(wrap % json.dumps(coordinates), metres=True).outline == BOX


@pytest.mark.parametrize(
    "body",
    [
        "x,y\n0,0\n100,0\n100,80\n0,80\n",
        "Y [m];id;X [m]\n0;a;0\n0;b;100\n80;c;100\n80;d;0\n",
        '"East"\t"North"\n0\t0\n"100"\t0\n100\t80\n0\t 80\n',
        "# a box\n\nx_m y_m\n 0   0\n1e2 0\n\n# half\n100 80\n0 80",
    ],
)
def test_tables(body):
    assert same_ring(field_of(body).outline, BOX)


def test_kml_of_any_namespace_with_entities_and_comments():
    body = kml(placemark(around(BOX), name="Søndre &amp; &#78;ord"))
    plain = body.replace("<kml xmlns", "<k:kml xmlns:k").replace("</kml>", "</k:kml>")
    field = field_of(plain)
    assert field.name == "Søndre & Nord"
    start = body.index("<coordinates>") + len("<coordinates>\n")
    comma = body.index(",", start)
    odd = body[:start] + "<!-- , -->" + body[start:comma] + "&#44;" + body[comma + 1 :]
    odd = odd.replace("\n</coordinates>", "<![CDATA[ ]]></coordinates>")
    assert field_of(odd) == field
    assert field_of(body.replace(" ", "\n" * (VERTICES_LIMIT + 1)).replace("<kml\n", "<kml ")).outline == field.outline


# --- units ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("units", ["m", " Metre ", "m, local frame"])
def test_units_in_metres(units):
    plain = polygon([*BOX, BOX[0]])
    feature = f'{{"type": "Feature", "properties": {{"units": {json.dumps(units)}}}, "geometry": {plain}}}'
    collection = f'{{"type": "FeatureCollection", "units": {json.dumps(units)}, "features": [{feature}]}}'
    for body in (polygon([*BOX, BOX[0]], units=units), feature, collection):
        assert field_of(body).outline == BOX


@pytest.mark.parametrize("units", ["m/s", 5])
@pytest.mark.parametrize("name", [None, "urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326"])
def test_what_does_not_say_metres_is_in_degrees(units, name):
    given = {"units": units} if name is None else {"crs": named(name)}
    assert field_of(polygon(around(BOX), **given)) == field_of(polygon(around(BOX)))


def named(name):
    return {"type": "name", "properties": {"name": name}}


@pytest.mark.parametrize(("crs", "named_so"), [(named("EPSG:25899"), "EPSG:25899"), (12, "without a name")])
def test_an_unknown_system_asks_for_metres(crs, named_so):
    body = polygon([*BOX, BOX[0]], crs=crs)
    expected = "degrees, as by ogr2ogr -t_srs EPSG:4326 field.geojson f, or --metres"
    assert fault_of(body) == f"7:12: error: the reference system {named_so} is not read; expected {expected}"
    assert field_of(body, metres=True).outline == BOX
    # the units of a feature below the system's object say so, too
    feature = json.dumps({"type": "Feature", "properties": {"units": "m"}, "geometry": json.loads(polygon(BOX))})
    collection = f'{{"type": "FeatureCollection", "crs": {json.dumps(crs)}, "features": [{feature}]}}'
    assert field_of(collection).outline == BOX


@pytest.mark.parametrize(
    ("body", "options", "fault"),
    [
        (polygon([(10.43, 55.37), (10.44, 55.37), (10.43, 55.38)]), {"metres": True}, "1 m² or more, or no --metres"),
        # Web Mercator is not in metres
        (polygon(BOX, crs=named("EPSG:3857")), {"metres": True}, "the reference system EPSG:3857 is not read"),
        (polygon([(x + 550_000, y) for x, y in BOX]), {}, "longitude 550000, latitude 0; expected longitude within"),
        (polygon([*BOX, BOX[0]]), {}, "latitude 80 is farther than 100 km from the middle of the first outline"),
        (polygon([(lat, lon) for lon, lat in around(BOX, (-33.9, 151.2))]), {}, "longitude before latitude"),
        (table(BOX, header="lon,lat"), {}, "or columns called x_m and y_m"),
        (in_metres(BOX), {"feature": "4"}, "no feature 4 with a polygon; expected a name or number of 1 without"),
    ],
)
def test_units_and_names_that_are_others(body, options, fault):
    assert fault in fault_of(body, **options)


@pytest.mark.parametrize(
    "body",
    [
        table([*BOX, BOX[0]]),
        polygon(BOX, POND, units="m"),
        table([BOX[0], (50, 0), (60, 0.0004), *BOX[1:]]),
        in_metres((BOX[0], *BOX[:0:-1]), POND[::-1]),
    ],
)
def test_rings_are_open_and_wound_without_superfluous_vertices(body):
    field = field_of(body)
    assert field.outline == BOX
    assert all(signed_area_m2(hole) < 0 for hole in field.holes)


def test_zones_with_swapped_coordinates_are_far():
    field = field_of(polygon(around(BOX)))
    swapped = polygon([place[::-1] for place in around(BOX)])
    for inside in (False, True):
        with pytest.raises(
            InputError, match="1 polygon farther than 100 km left out; expected a polygon within 100 km"
        ):
            read_zones(Text("z", swapped), field.origin_deg, inside=inside)


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("lat,y\n0,0\n", "no columns of vertices; expected a header such as x_m,y_m or lon,lat"),
        ("x,y,lon,lat\n", "more columns of vertices than two; expected a header"),
        ("x,y\n", "an outline of 0 different vertices"),
        ("x,y\n0,0\n9,9\n0,0\n", "an outline of 2 different vertices; expected three or more"),
        ("# nothing\n\n", "no vertices; expected a header such as x_m,y_m or lon,lat, and a row for each"),
        (" \n\n", "is empty; expected a field as GeoJSON, KML or a CSV of vertices"),
    ],
)
def test_tables_that_cannot_be_told(body, fault):
    assert fault_of(body).startswith(f"1:1: error: {fault}")


# --- the options ------------------------------------------------------------------------------------------------------


def features(*members, kind="Polygon") -> str:
    """A collection with a feature in each line, from line 2."""
    lines = []
    for i, more in enumerate(members):
        ring = [[x + 1000 * i, y] for x, y in (*BOX, BOX[0])]
        geometry = {"type": kind, "coordinates": [ring]}
        lines.append(json.dumps({"type": "Feature", **more, "geometry": geometry}))
    return '{"type": "FeatureCollection", "units": "m", "features": [\n' + ",\n".join(lines) + "\n]}"


THREE = features(
    {"id": 7, "properties": {"name": "North", "id": "n1"}}, {"id": "s", "properties": {"name": " 1 "}}, {"id": 2.5}
)


@pytest.mark.parametrize(
    ("asked", "index", "name"),
    [((" North ", "n1", "7"), 0, "North"), (("s", "1", "2"), 1, "1"), ((" 3 ", "2.5"), 2, "2.5")],
)
def test_a_feature_by_its_name_its_id_or_its_number(asked, index, name):
    """In this order: 1 is a name, and no number."""
    for feature in asked:
        field = field_of(THREE, feature=feature)
        assert (field.name, field.outline[0]) == (name, (1000 * index, 0))


def test_one_of_several_features_has_to_be_asked_for():
    listed = "1 North; 2 1; 3 2.5"
    message = f"3:1: error: 3 features with polygons; expected one, or --feature with a name or number of {listed}"
    assert fault_of(THREE) == message
    many = features(*({"properties": {"name": f"field {i}"}} if i % 2 else {} for i in range(12)))
    listed = "; ".join(f"{i + 1} " + (f"field {i}" if i % 2 else "without a name") for i in range(10))
    assert fault_of(many).endswith(f"--feature with a name or number of {listed}; and 2 more")


def test_features_of_kml():
    one, two = placemark(around(BOX), name="one"), placemark(around(POND[::-1]), name="two")
    point = "<Placemark><name>home</name><Point><coordinates>1,2</coordinates></Point></Placemark>"
    both = kml(point, one.replace("<Placemark>", '<Placemark id="p7">'), two)
    assert field_of(both, feature="two") == field_of(both, feature="2")
    assert field_of(both, feature="two").area_m2 == pytest.approx(400, abs=0.01)
    assert field_of(both, feature="p7").name == "one"
    expected = "expected one, or --feature with a name or number of 1 one; 2 two"
    assert fault_of(both) == f"8:1: error: 2 features with polygons; {expected}"
    assert fault_of(both, feature="home").startswith("--feature:1:1: error: no feature home with a polygon")


def test_options_that_do_not_go_with_the_format():
    degrees = kml(placemark(around(BOX)))
    expected = "a KML file is in degrees (WGS-84); expected KML without --metres"
    assert fault_of(degrees, metres=True) == f"--metres:1:1: error: {expected}"
    assert fault_of("lat,lon\n", metres=True) == "1:5: error: a column of degrees; expected x_m,y_m, as --metres asks"
    assert field_of(in_metres(BOX), feature="1").outline == BOX


def test_a_name_is_fit_for_a_line_of_text():
    field = field_of(features({"properties": {"name": "a\nb\x00\ud800" + "c" * 500}}))
    assert field.name == "a b\\x00\\ud800" + "c" * 87 + "…"
    field.name.encode()


# --- faults of shape --------------------------------------------------------------------------------------------------

APART = "expected a ring that neither crosses nor touches itself, holes within the outline and apart from one another"


@pytest.mark.parametrize(
    ("rings", "fault"),
    [
        ([BOX[:1]], "an outline of 1 different vertices; expected three or more"),
        ([[*BOX[:2], BOX[0]]], "an outline of 2 different vertices; expected three or more"),
        ([[(0, 0), (1.5, 0), (0, 1)]], "an area of less than 1 m²; expected 1 m² or more, or a file without units"),
        ([[(0, 0), (100, 80), (99, 0), (1, 70)]], f"the outline crosses itself at (46.70, 37.36) m; {APART}"),
        ([BOX, POND, [(20, 50), (41, 70), (40, 50), (20, 70)]], f"hole 2 crosses itself at (30.24, 59.76) m; {APART}"),
        ([BOX, POND, [(90, 30), (90, 50), (110, 50), (110, 30)]], "hole 2 crosses, meets or is beyond another ring"),
    ],
)
def test_rings_that_are_none(rings, fault):
    assert fault_of(polygon(*rings, units="m")).startswith(f"1:1: error: {fault}")


def moved(ring, dx, dy):
    return [(x + dx, y + dy) for x, y in ring]


def test_a_crossing_is_told_in_degrees_too():
    found = fault_of(polygon(around([(0, 0), (100, 100), (100, 0), (0, 90)])))
    assert found.startswith("1:1: error: the outline crosses itself at longitude ")
    longitude, latitude = found.split("longitude ")[1].split(", which")[0].split(", latitude ")
    crossing = (9000 / 190, 9000 / 190)  # y = x and y = 0.9 (100 − x)
    assert to_local_m(float(latitude), float(longitude), ODENSE) == pytest.approx(crossing, abs=0.01)
    # the field's own origin is at (50, 50)
    assert found.endswith(f", which is (-2.63, -2.63) m; {APART}")


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        (table([(0, 0), (60_000, 0), (60_000, 10)]), f"60 km by 0.01 km; expected {WIDE}, or columns called lon"),
        (polygon([(10, 55), (11, 55), (11, 55.1)]), f"63.99 km by 11.13 km; expected {WIDE}, or --metres"),
        # the far side of the earth, which the plane would fold onto the field
        (
            polygon(around(BOX), [(-169.57, -55.37), (-169.57, -55.3701), (-169.5701, -55.3701)]),
            "the vertex at longitude -169.57, latitude -55.37 is farther than 100 km from the middle",
        ),
        (table([*BOX[:3], (1e300, -1e300)]), "a coordinate of 1e+300 m; expected at most 1e+08"),
        (polygon([(10, 84.9999), (10.01, 85.0001), (10, 85.0001)]), "a vertex at longitude 10.01, latitude 85.0001; "),
    ],
)
def test_fields_that_are_too_large_or_too_far(body, fault):
    assert fault_of(body).startswith(f"1:1: error: {fault}")


def ring_of(n):
    angles = (2 * math.pi * i / n for i in range(n))
    return [(round(5000 * math.cos(angle), 4), round(5000 * math.sin(angle), 4)) for angle in angles]


@pytest.mark.slow
def test_as_many_vertices_as_allowed_and_one_more():
    ring = ring_of(VERTICES_LIMIT)
    field, repaired = read(table(ring))
    # a chord's height is at most the tolerance: 1 m of 5 km
    assert field.area_m2 == pytest.approx(math.pi * 5000**2, rel=2 * 1 / 5000)
    assert repaired == ["1 ring of more than 1000 vertices simplified within 1 m"]
    assert len(field.outline) <= RING_LIMIT
    expected = f"more than {VERTICES_LIMIT} vertices; expected at most {VERTICES_LIMIT}: a simpler outline"
    assert fault_of(table([*ring, ring[0]])) == f"1:1: error: {expected}"
    assert fault_of(polygon([*ring, ring[0]], units="m")) == f"1:1: error: {expected}"
    words = "1,2\n" * (VERTICES_LIMIT + 100)
    body = kml(placemark(around(BOX))).replace("<coordinates>\n", f"<coordinates>\n{words}")
    assert fault_of(body) == f"3:1: error: {expected}"


def test_a_ring_that_needs_too_many_vertices():
    saw = [*[(x, 40 * (x % 2)) for x in range(RING_LIMIT - 1)], (RING_LIMIT, 900), (0, 900)]
    assert len(field_of(table(saw[1:])).outline) == RING_LIMIT
    what = f"a ring of {len(saw)} vertices to be right within 1 m"
    assert fault_of(table(saw)) == f"1:1: error: {what}; expected at most {RING_LIMIT}"


MENDED = "1 outline that crossed or touched itself repaired, by less than 0.1 % of the area"


@pytest.mark.parametrize(
    ("rings", "areas_m2", "notes"),
    [
        ([[(0, 0), (100, 0), (100, 80), (50, 0), (0, 80)]], [2000, 2000], [MENDED]),
        ([BOX, [(0, 40), (50, 45), (100, 40), (50, 35)]], [3750, 3750], [MENDED]),
        ([[(0, 0), (100, 0), (100, 80), (0, 80), (0.1, -1), (-1, 1)]], [8000], [MENDED]),
    ],
)
def test_what_hardly_changes_the_area_is_mended(rings, areas_m2, notes):
    field, found = read(polygon(*([*ring, ring[0]] for ring in rings), units="m"))
    assert found == notes
    assert sorted(abs(signed_area_m2(part[0])) for part in field.parts) == pytest.approx(areas_m2, rel=1e-3)


def parts(*rings) -> str:
    return json.dumps({"type": "MultiPolygon", "coordinates": [[[*r, r[0]]] for r in rings], "units": "m"})


def test_parts_that_overlap_count_once_and_those_without_an_area_are_left_out():
    field, found = read(parts(BOX[:2], moved(POND, 0.5, 0), BOX, moved(BOX, 50, 0), [(0, 0), (1, 0), (0, 1)]))
    assert found == ["2 polygons of less than 1 m² left out", "polygons that overlap joined: ground counts once"]
    assert field.area_m2 == pytest.approx(150 * 80)
    beside, found = read(parts(BOX, moved(BOX, 100, 0)))
    assert (len(beside.parts), found) == (2, [])


@pytest.mark.parametrize("form", ["kml", "geojson"])
def test_closed_lines_are_outlines_where_there_is_no_polygon(form):
    def body(line):
        if form == "geojson":
            return json.dumps({"type": "LineString", "coordinates": line})
        places = " ".join(f"{x},{y},0" for x, y in line)
        return f"<kml><Placemark><LineString><coordinates>{places}</coordinates></LineString></Placemark></kml>"

    ring = [(10.0, 55.0), (10.01, 55.0), (10.01, 55.01), (10.0, 55.0)]
    assert field_of(body(ring)).outline == field_of(polygon(ring)).outline
    assert "no polygon, only" in fault_of(body(ring[:3]))


def test_zones_far_from_the_field_are_left_out_and_large_ones_cut():
    field = field_of(polygon(around([(0, 0), (900, 0), (900, 900), (0, 900)])))
    latitude, longitude = ODENSE
    far = [(longitude + 30 + x / 100, latitude + y / 100) for x, y in ((0, 0), (1, 0), (0, 1), (0, 0))]
    wide = [(longitude + x, latitude + y) for x, y in ((-40, -20), (40, -20), (40, 0.05), (-40, 0.05), (-40, -20))]
    both = json.dumps({"type": "MultiPolygon", "coordinates": [[wide], [far]]})
    near, notes = read_zones(Text("z", both), field.origin_deg)
    assert [str(note) for note in notes] == ["z:1:1: note: 1 polygon farther than 100 km left out"]
    x, y = zip(*near[0], strict=True)
    assert (min(x), max(x), min(y)) == pytest.approx((-ZONES_M, ZONES_M, -ZONES_M))
    assert max(y) == pytest.approx(5600, rel=0.2)
    for within in (False, True):
        with pytest.raises(InputError, match=r"1 polygon farther than 100 km left out; expected a polygon within"):
            read_zones(Text("z", polygon(far)), field.origin_deg, inside=within)


def test_fences_are_zones():
    rows = "QGC WPL 110\n" + "".join(
        f"{i}\t0\t0\t{5001 if i < 4 else 5004}\t{4 if i < 4 else 20}\t0\t0\t0\t{lat}\t{lon}\t0\t1\n"
        for i, (lat, lon) in enumerate([(55, 10), (55, 10.01), (55.01, 10.01), (55.01, 10), (55.005, 10.005)])
    )
    field = field_of(polygon([(10, 55), (10.01, 55), (10.01, 55.01), (10, 55.01), (10, 55)]))
    (inside,), _ = read_zones(Text("z", rows), field.origin_deg, inside=True)
    assert np.array(sorted(inside)) == pytest.approx(np.array(sorted(field.outline)), abs=MILLIMETRE)
    (circle,), _ = read_zones(Text("z", rows), field.origin_deg)
    assert len(circle) == 32
    plan = {"fileType": "Plan", "geoFence": {"version": 2, "polygons": [], "circles": [
        {"inclusion": False, "circle": {"center": [55.005, 10.005], "radius": 20}}]}}  # fmt: skip
    (same,), _ = read_zones(Text("z", json.dumps(plan)), field.origin_deg)
    assert np.array(sorted(same)) == pytest.approx(np.array(sorted(circle)), abs=MILLIMETRE)
    with pytest.raises(InputError, match=r"no fence to keep inside; expected a fence; those of this file belong to"):
        read_zones(Text("z", json.dumps(plan)), field.origin_deg, inside=True)
    assert "is a mission or a fence" in fault_of(rows)
    rally = "QGC WPL 110\n0\t0\t0\t5100\t8\t0\t0\t0\t55\t10\t0\t1\n"
    with pytest.raises(InputError, match=r"no fence to keep out of; expected a fence; places to rally are none"):
        read_zones(Text("z", rally), field.origin_deg)


def test_faults_beyond_the_twentieth_are_counted_or_left_out():
    rows = "x,y\n" + "0,a\n" * 50
    faults = faults_of(rows)
    assert len(faults) == FAULTS_SHOWN + 1
    assert faults[0] == "2:3: error: a is not a number; expected a number"
    assert faults[-1] == "22:3: error: 30 more faults from here on"


# --- faults of text ---------------------------------------------------------------------------------------------------


NO_POSITION = "3:1: error: no position; expected longitude, latitude and perhaps altitude, or x and y in metres"


@pytest.mark.parametrize(
    ("position", "fault"),
    [
        *((each, NO_POSITION) for each in ("[1]", "[1, 2, 3, 4]", "[1, true]", "[1, [2, 3]]", "{}")),
        ("[NaN, 2]", "3:2: error: NaN is no number of JSON; expected a finite number"),
        ("[1e999, 2]", "3:2: error: 1e999 is no number of JSON; expected a finite number"),
        ("[1, 02]", "3:6: error: is not JSON: expecting ',' delimiter"),
        ("[1, 2", "4:9: error: is not JSON: expecting ',' delimiter"),
        ("[1, 2]\x00", "3:7: error: is not JSON: expecting ',' delimiter"),
    ],
)
def test_faults_of_a_position(position, fault):
    body = f'{{"type": "Polygon", "coordinates": [[\n[0, 0],\n{position},\n[5, 5]]]}}'
    assert fault_of(body).startswith(fault)


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        *((each, "1:1: error: no object of GeoJSON with a type; expected a Polygon, F") for each in ("[]", "{}")),
        ('{"type": "Point", "coordinates": [1, 2]}', "1:1: error: no polygon, only open lines and points; expected a "),
        ('{"type": "FeatureCollection", "features": []}', "1:1: error: no polygon; expected a polygon"),
        ('{"type": "FeatureCollection",\n"features": {}}', "1:1: error: no list of features; expected features with"),
        ('{"type": "FeatureCollection", "features": [\n3]}', "2:1: error: no object of GeoJSON with a type"),
        ('{"type": "Feature", "geometry":\n [1, 2]}', "2:2: error: no geometry; expected Point, MultiPoint"),
        ('{"type": "GeometryCollection", "geometries": [\n{}]}', "2:1: error: no geometry"),
        ('{"type": "Polygon", "coordinates": null}', "1:1: error: no list of positions; expected a list of positions"),
        ('{"type": "Polygon", "coordinates": []}', "1:1: error: a polygon without rings; expected a ring of "),
        ('{"type": "Polygon", "coordinates": [\n"a"]}', "2:1: error: no list of positions"),
        ('{"type": "MultiPolygon", "coordinates": [[],\n[]]}', "1:1: error: a polygon without rings"),
        ('{"type": "Polygon", "type": "Polygon"}', "1:21: error: the key type stands twice; expected each key once"),
    ],
)
def test_faults_of_geojson(body, fault):
    assert fault_of(body).startswith(fault)


@pytest.mark.parametrize(
    ("body", "faults"),
    [
        ("x,y\n0,0\n1\n", ["3:2: error: 1 field; expected 2, as in the first row"]),
        ("x,y\n0,0\n1,2,3\n1,2,,\n", ["3:5: error: 3 fields; expected 2, as in the first row"]),
        ("x y\n0 0\n 1  b\n", ["3:5: error: b is not a number; expected a number"]),
        ("x;y\n0;0\n1;\n", ["3:3: error: an empty field is not a number; expected a number"]),
        ("x\ty\nnan\t0\n", ["2:1: error: nan is not finite; expected a finite number"]),
        ("x\ty\n0\t1e999\n", ["2:3: error: 1e999 is too large; expected a finite number"]),
    ],
)
def test_faults_of_rows(body, faults):
    assert faults_of(body) == faults


RING = "<LinearRing><coordinates>10,55 10.001,55 10.001,55.001</coordinates></LinearRing>"
OUTLINE = "<Polygon><outerBoundaryIs>{}</outerBoundaryIs></Polygon>"


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("<kml>\n</kml>", "1:1: error: no polygon; expected a polygon, or a closed line: "),
        ("<kml>\n<a></b>", "2:6: error: is not XML: mismatched tag; expected a KML file"),
        (OUTLINE.format(RING.replace("10,55 ", "<Polygon/>1")), "1:1: error: an element within coordinates; expected"),
        ("<Polygon/>", "1:1: error: a Polygon without an outline; expected one outerBoundaryIs with a LinearRing of "),
        (OUTLINE.format(RING).replace("outer", "inner"), "1:1: error: a Polygon without an outline"),
        (OUTLINE.format(f"{RING}\n{RING}"), "1:1: error: a second outline; expected one outerBoundaryIs"),
        (kml(placemark([])), "3:1: error: an outline of 0 different vertices"),
    ],
)
def test_faults_of_kml(body, fault):
    assert fault_of(body).startswith(fault)


# --- hostile texts ----------------------------------------------------------------------------------------------------


def test_a_document_type_is_refused_before_it_is_read():
    for doctype in ('<!DOCTYPE a [<!ENTITY m "lol">]>', '<!DOCTYPE a SYSTEM "http://localhost/a.dtd">'):
        found = fault_of(f'<?xml version="1.0"?>\n{doctype}\n<a>&m;</a>')
        line, column, rest = found.split(":", 2)
        assert (line, 1 <= int(column) <= len(doctype)) == ("2", True)
        assert rest.startswith(" error: a document type, which may refer to other files; expected a KML file without")


def test_depth_is_limited():
    deep = '{"type": "Polygon", "coordinates": '
    for text in (deep + "[" * 100_000, '{"a":' * 100_000):
        assert fault_of(text) == f"1:1: error: nested deeper than {NESTING_LIMIT} levels"
    deep += "[" * 60 + "]" * 60 + "}"
    # the document is the first level, so that the list at column 36 is the second
    assert fault_of(deep) == f"1:{36 + NESTING_LIMIT - 1}: error: nested deeper than {NESTING_LIMIT} levels"
    inner = '{"type": "GeometryCollection", "geometries": [' * 10 + polygon([*BOX, BOX[0]]) + "]}" * 10
    assert field_of(inner, metres=True).outline == BOX
    assert fault_of("<a>" * 100_000) == "1:300001: error: is not XML: no element found; expected a KML file"


@pytest.mark.quick(4)
@pytest.mark.parametrize(
    "body",
    [
        '{"type": "Polygon", "coordinates": [[[' + "1" * 1_000_000 + "x",
        "<Placemark><name>" + "a\n" * 500_000,
        "x" * 1_000_000,
        "x,y\n" + "1" * 1_000_000,
        "x,y\n" + "," * 1_000_000,
        "x;y\n" + " " * 1_000_000 + ";",
    ],
    ids=lambda body: f"{body[:12]!r}…",
)
def test_long_texts_are_refused_as_fast_as_short_ones(body):
    """Each would take minutes where time grew with the square of the length."""
    with pytest.raises(InputError):
        read(body)


words = ['"type"', '"Polygon"', '"coordinates"', "[[[0, 0], [9, 0], [9, 9]]]", "x,y", "lon lat", "0 0\n", "5,5\n"]
words += ["<kml>", "<Polygon>", "<coordinates>", "nan"]
pieces = st.sampled_from('{}[]<>/,:1-&"\n\x00') | st.sampled_from(words)
texts = st.text(max_size=40) | st.lists(pieces, max_size=30).map("".join)


@given(texts, st.booleans(), st.none() | st.text())
def test_any_text_is_a_field_or_a_named_fault(body, metres, feature):
    try:
        field, mended = read(body, metres=metres, feature=feature)
    except InputError as error:
        lines = body.split("\n")
        for fault in error.faults:
            assert fault.message
            if fault.file == "f":
                assert 1 <= fault.line <= len(lines)
                assert 1 <= fault.column <= len(lines[fault.line - 1]) + 1
    else:
        assert field.area_m2 >= 1
        assert all(mended)


def test_decimal_commas_between_semicolons():
    field, _ = read("x_m;y_m\n0,0;0\n100,5;0\n100,5;80,25\n")
    assert field.outline == ((0.0, 0.0), (100.5, 0.0), (100.5, 80.25))


def test_all_features_are_the_parts_of_one_field():
    text = features(*({"properties": {"name": name}} for name in ("west", "avoid a mast", "east")))
    field, _ = read(text, metres=True, feature="all")
    assert [part[0][0] for part in field.parts] == [(0.0, 0.0), (2000.0, 0.0)]
    assert [(each.name, each.outline[0]) for each in field.airspace.obstacles] == [("a mast", (1000.0, 0.0))]
    assert len(read(text, metres=True, feature="east")[0].parts) == 1
    with pytest.raises(InputError, match="2 features with polygons"):
        read(text, metres=True)


def test_a_far_obstacle_that_crosses_itself_costs_itself_alone():
    bow = [(0.5, 0.5), (0.53, 0.53), (0.53, 0.5), (0.5, 0.53)]
    far, near = (Text("a.geojson", polygon([(8 + x * by, 47 + y * by) for x, y in bow])) for by in (1, 0.01))
    found, notes = read_airspace(far, None, (47.0, 8.0), (0.0, 0.0))
    assert len(found.obstacles) == 2
    assert "crosses itself, far away" in notes[0].message
    with pytest.raises(InputError, match="crosses itself"):
        read_airspace(near, None, (47.0, 8.0), (0.0, 0.0))


KML = """<kml><Placemark><name>meadow</name><Polygon><outerBoundaryIs><LinearRing><coordinates>
10.0,55.0 10.01,55.0 10.01,55.004 10.0,55.004 10.0,55.0
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"""


def archive(path, **files):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as stream:
        for name, text in files.items():
            stream.writestr(name.replace("_", "."), text)
    return str(path)


def test_the_kml_of_an_archive(tmp_path):
    path = archive(tmp_path / "field.kmz", icon_png="no", doc_kml="\ufeff" + KML.replace("\n", "\r\n"))
    text = read_field_text(path)
    assert text.name == path
    assert read_field(text)[0].name == "meadow"
    (tmp_path / "plain.kml").write_text(KML)
    assert read_field_text(str(tmp_path / "plain.kml")).body == KML


def test_covered(eadp, tmp_path):
    path = archive(tmp_path / "field.kmz", doc_kml=KML)
    assert eadp("cover", path, "--min-radius", "40", "--swath", "60", "--format", "text").code == 0


def test_what_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "field.kmz"
    with pytest.raises(InputError, match="an archive without a KML document"):
        read_field_text(archive(path, doc_txt=KML))
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="UTF-8"):
        read_field_text(str(path))
    # a few kilobytes that unpack to more than the limit
    for module in ("eadp.exchange.field_reader", "eadp.io.text.streams"):
        monkeypatch.setattr(f"{module}.LIMIT_BYTES", 100_000)
    with pytest.raises(InputError, match="is too large; expected at most 100000 bytes"):
        read_field_text(archive(path, doc_kml=" " * 5_000_000))
    with pytest.raises(InputError, match="cannot be read"):
        read_field_text(str(tmp_path / "nosuch.kmz"))


def collection(*features):
    return json.dumps({"type": "FeatureCollection", "features": features})


POLE = {"type": "Feature", "properties": {"name": "pole"}, "geometry": {"type": "Point", "coordinates": [8.01, 47.01]}}


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        (collection(POLE, POLE | {"geometry": None}), "pole has no place; expected a polygon, a line or a point"),
        (collection(POLE, {"type": "Feature", "properties": {}, "geomtry": {}}), "a feature has no place"),
        (collection(POLE, {"type": "MultiPolygon", "coordinates": []}), "a feature has no place"),
        (collection(POLE, {"type": "Polygon", "coordinates": [[]]}), "a feature has no place"),
        (kml(placemark([(8, 47), (8.1, 47), (8, 47.1)]), placemark([])), "has no place"),
        (kml("<Placemark><name>wood</name><Poligon/></Placemark>", placemark([(8, 47)])), "wood has no place"),
    ],
)
def test_an_obstacle_that_cannot_be_placed_is_refused(body, fault):
    with pytest.raises(InputError) as caught:
        read_airspace(Text("o", body), None, (47.0, 8.0), (0.0, 0.0))
    assert fault in str(caught.value)

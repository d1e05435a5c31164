"""An obstacle in a field stays one: in every format and reference system, wherever on the earth the field is."""

import json
import math

import numpy as np
import pytest

from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.core.geometry.polygons import signed_area_m2
from eadp.errors import InputError
from eadp.exchange.field_reader import THIN_M, read_airspace, read_field
from eadp.io.text.streams import Text

pyproj = pytest.importorskip("pyproj")

FIELD = [(-300.0, -200.0), (300.0, -200.0), (300.0, 200.0), (-300.0, 200.0)]
POLE = [(92.0, 42.0), (108.0, 42.0), (108.0, 58.0), (92.0, 58.0)]
MIDDLE_M = (100.0, 50.0)


def read_zones(text, origin_deg, middle_m=(0.0, 0.0), *, metres=False):
    """The obstacles of a file, and the notes."""
    found, notes = read_airspace(text, None, origin_deg, middle_m, metres=metres)
    return found.obstacles, notes


CENTIMETRES_M = 0.02  # of an origin in whole 1e-7 degrees
PLACES = {  # latitude, longitude, a UTM zone
    "Germany": ((48.7, 8.9), "EPSG:25832"),
    "at 0, 0": ((0.0, 0.0), "EPSG:32631"),
    "across zones": ((51.2, 6.0), "EPSG:32631"),
    "in the other zone": ((51.2, 6.0), "EPSG:32632"),
    "date line": ((-17.0, 180.0), "EPSG:32760"),
    "from the east": ((-17.0, -179.9995), "EPSG:32701"),
    "far south": ((-54.8, -68.3), "EPSG:32719"),
}


def degrees(ring, origin):
    """Positions of a ring, longitude first and the first again; beyond the date line from the other side."""
    places = [to_geodetic_deg(x, y, origin)[::-1] for x, y in (*ring, ring[0])]
    return [((lon + 180) % 360 - 180, lat) for lon, lat in places]


def in_system(positions, system):
    transform = pyproj.Transformer.from_crs(4326, system, always_xy=True).transform
    return [transform(*position) for position in positions]


def geojson(rings, crs=None):
    features = [
        {"type": "Feature", "properties": {"name": name}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
        for name, ring in rings.items()
    ]
    stated = {} if crs is None else {"crs": {"type": "name", "properties": {"name": crs}}}
    return Text("f", json.dumps({"type": "FeatureCollection", **stated, "features": features}))


def kml(rings):
    shapes = "".join(
        f"<Placemark><name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
        f"{' '.join(f'{x!r},{y!r}' for x, y in ring)}"
        "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark>"
        for name, ring in rings.items()
    )
    return Text("f", f"<kml><Document>{shapes}</Document></kml>")


def table(ring, header):
    return Text("f", "".join(f"{row}\n" for row in (header, *(f"{x!r},{y!r}" for x, y in ring))))


def texts(origin, system):
    """A file of the field with its pole for each format, or of either; and whether it is read by --metres."""
    rings = {"field": degrees(FIELD, origin), "avoid pole": degrees(POLE, origin)}
    field, pole = rings.values()
    yield geojson(rings), None, False
    yield kml(rings), None, False
    yield geojson(rings, "urn:ogc:def:crs:OGC:1.3:CRS84"), kml({"pole": pole}), False
    utm = {name: in_system(ring, system) for name, ring in rings.items()}
    yield geojson(utm), None, True
    yield table(field, "lon,lat"), table(pole, "lon,lat"), False
    yield table(utm["field"], "easting,northing"), table(utm["avoid pole"], "x_m,y_m"), False
    yield table(utm["field"], "easting,northing"), geojson({"pole": utm["avoid pole"]}), True


@pytest.mark.quick(4)
@pytest.mark.parametrize(("origin", "system"), PLACES.values(), ids=PLACES)
def test_an_obstacle_in_the_field_is_kept(origin, system):
    for field_text, zones, metres in texts(origin, system):
        field, _ = read_field(field_text, metres=metres)
        (obstacle,) = (
            field.airspace.obstacles
            or read_zones(zones, field.origin_deg, field.middle_m, metres=metres or field.origin_deg is None)[0]
        )
        corners, outline = np.array(obstacle.outline), np.array(field.outline)
        at_m = corners.mean(axis=0) - outline.mean(axis=0)
        # metres of a grid are scaled and turned a little
        near_m = 5.0 if field.origin_deg is None else CENTIMETRES_M
        assert at_m == pytest.approx(MIDDLE_M, abs=near_m), (field_text.body[:100], zones)
        assert abs(signed_area_m2(obstacle.outline)) == pytest.approx(256, rel=0.01)
        if field.origin_deg is not None:
            # a datum is known to metres
            east = abs(field.origin_deg[1] - origin[1])
            assert math.hypot(field.origin_deg[0] - origin[0], min(east, 360 - east)) < 5e-5


def test_metres_without_an_obstacle_near_are_another_grid():
    field = Text("f", "x_m,y_m\n0,0\n600,0\n600,400\n0,400\n")
    pole = table([(x + 492_000, y + 5_393_000) for x, y in POLE], "x_m,y_m")
    read, _ = read_field(field)
    with pytest.raises(InputError, match="farther than 100 km left out; expected a polygon within 100 km, in the uni"):
        read_zones(pole, None, read.middle_m)
    rings = {"field": FIELD, "avoid pole": [(x + 492_000, y) for x, y in POLE]}
    with pytest.raises(InputError, match="in the units, grid and order of the field"):
        read_field(geojson(rings), metres=True)


LINE = [(-100.0, 0.0), (0.0, 40.0), (100.0, 0.0)]


def thin(kind, positions):
    nested = {"Point": positions[0], "MultiPoint": positions, "LineString": positions, "MultiLineString": [positions]}
    return {"type": kind, "coordinates": nested[kind]}


def beside(geometry, name="avoid it"):
    """A file of the field and something in it."""
    origin = PLACES["Germany"][0]
    features = [
        {"type": "Feature", "properties": {"name": label}, "geometry": each}
        for label, each in (("field", {"type": "Polygon", "coordinates": [degrees(FIELD, origin)]}), (name, geometry))
    ]
    return Text("f", json.dumps({"type": "FeatureCollection", "features": features}))


@pytest.mark.parametrize("kind", ["Point", "MultiPoint", "LineString", "MultiLineString"])
def test_points_and_lines_are_obstacles_with_a_distance(kind):
    from shapely import LineString, MultiPoint, Polygon, union_all

    origin = PLACES["Germany"][0]
    positions = degrees(LINE, origin)[:-1]
    geometry = thin(kind, positions)
    field, notes = read_field(beside(geometry))
    obstacles = field.airspace.obstacles
    assert [each.name for each in obstacles] == ["it"] * (3 if kind == "MultiPoint" else 1)
    assert notes[-1].endswith("without an area kept, with what lies within 10 m")
    given = MultiPoint(LINE[: 1 if kind == "Point" else 3]) if "Point" in kind else LineString(LINE)
    within = union_all([Polygon(each.outline) for each in obstacles])
    assert given.buffer(THIN_M - CENTIMETRES_M).within(within)
    assert within.within(given.buffer(1.02 * THIN_M + CENTIMETRES_M))
    # a file of obstacles needs no names
    own, _ = read_zones(Text("z", json.dumps(geometry)), field.origin_deg)
    assert [each.outline for each in own] == [each.outline for each in obstacles]
    # what is not named so is none, and no field
    assert read_field(beside(geometry, "tea house"))[0].airspace.obstacles == ()
    with pytest.raises(InputError, match="no polygon, only "):
        read_field(Text("f", json.dumps(geometry)))
    with pytest.raises(InputError, match="no polygon"):
        read_airspace(None, Text("z", json.dumps(geometry)), field.origin_deg, (0.0, 0.0))
    if kind in ("Point", "LineString"):
        texts = " ".join(f"{x!r},{y!r}" for x, y in positions[: 1 if kind == "Point" else 3])
        shape = f"<Placemark><name>avoid it</name><{kind}><coordinates>{texts}</coordinates></{kind}></Placemark>"
        both = kml({"field": degrees(FIELD, origin)}).body.replace("</Document>", shape + "</Document>")
        assert read_field(Text("f", both))[0].airspace == field.airspace
        assert len(read_zones(Text("z", f"<kml>{shape}</kml>"), field.origin_deg)[0]) == 1


@pytest.mark.parametrize(
    "hole", [[(10, 20)], [(10, 20), (10, 20), (10, 20)], [(10, 20), (40, 20)], [(10, 20), (40, 50), (30, 40), (20, 30)]]
)
def test_a_hole_without_an_area_is_an_obstacle(hole):
    from shapely import Point, Polygon

    rings = [[*ring, ring[0]] for ring in (FIELD, hole)]
    field, notes = read_field(Text("f", json.dumps({"type": "Polygon", "coordinates": rings, "units": "m"})))
    (mast,) = field.airspace.obstacles
    assert (mast.name, mast.height_m, field.holes) == ("hole", None, ())
    assert notes == ["1 obstacle without an area kept, with what lies within 10 m"]
    small = json.dumps({"type": "Polygon", "coordinates": [[(10, 20), (10.01, 20), (10, 20.01)]]})
    with pytest.raises(InputError, match=r"an obstacle of 0.01 m by 0.01 m, if these are metres and not degrees"):
        read_zones(Text("z", small), None, metres=True)
    assert all(Polygon(mast.outline).contains(Point(place).buffer(0.999 * THIN_M)) for place in hole)


@pytest.mark.parametrize(
    ("inside", "altitude", "height_m"),
    [
        ("<ExtendedData><Data name='height'><value>35</value></Data></ExtendedData>", "", 35.0),
        ("<ExtendedData><SchemaData><SimpleData name='height'>35.5</SimpleData></SchemaData></ExtendedData>", "", 35.5),
        ("", ",42", None),
    ],
)
def test_the_height_of_an_obstacle_in_kml(inside, altitude, height_m):
    rings = {"field": degrees(FIELD, (48, 9)), "avoid pole": degrees(POLE, (48, 9))}
    head, pole = kml(rings).body.split("<name>avoid pole</name>")
    pole = pole.replace(" ", f"{altitude} ").replace("</coord", f"{altitude}</coord")
    field, _ = read_field(Text("f", f"{head}<name>avoid pole</name>{inside}{pole}"))
    assert field.airspace.obstacles[0].height_m == height_m


@pytest.mark.parametrize("height", ["tall", "-1", "1e5", "nan"])
def test_heights_in_kml_that_are_none(height):
    body = kml({"field": degrees(FIELD, (48, 9)), "avoid pole": degrees(POLE, (48, 9))}).body
    data = f"<ExtendedData><Data name='height'><value>{height}</value></Data></ExtendedData>"
    with pytest.raises(InputError, match=f"a height of {height}; expected metres above the field, from 0 to 10000"):
        read_field(Text("f", body.replace("pole</name>", f"pole</name>{data}")))


def test_a_boundary_and_obstacles_beside_each_other():
    """A plan in metres of a grid, beside files in the same."""
    moved = [[(x + 492_000, y + 5_393_000) for x, y in ring] for ring in (FIELD, POLE)]
    inside, avoid = (table(ring, "x_m,y_m") for ring in moved)
    airspace, notes = read_airspace(avoid, inside, None, moved[0][0])
    assert (len(airspace.obstacles), len(airspace.boundary), notes) == (1, 1, [])


def test_a_hole_without_an_area_lies_where_it_is_in_degrees_too():
    ring, hole = ((10, 55), (10.01, 55), (10.01, 55.01), (10, 55.01)), ((10.002, 55.002), (10.0020004, 55.002))
    body = {"type": "Polygon", "coordinates": [[*ring, ring[0]], [*hole, (10.0020004, 55.0020003), hole[0]]]}
    field, notes = read_field(Text("f", json.dumps(body)))
    (x, y), (obstacle,) = to_local_m(55.002, 10.002, field.origin_deg), field.airspace.obstacles
    assert max(math.dist((x, y), corner) for corner in obstacle.outline) < 20
    assert notes == ["1 obstacle without an area kept, with what lies within 10 m"]


def test_holes_of_a_boundary_are_obstacles():
    origin = PLACES["Germany"][0]
    outline, pole = degrees(FIELD, origin), degrees(POLE, origin)
    own = json.dumps({"type": "Polygon", "coordinates": [outline, pole]})
    named = geojson({"property": outline, "avoid pole": pole}).body
    for body in (own, named, kml({"property": outline, "avoid pole": pole}).body):
        airspace, _ = read_airspace(None, Text("z", body), origin, (0, 0))
        (obstacle,), (boundary,) = airspace
        assert np.mean(obstacle.outline, axis=0) == pytest.approx(MIDDLE_M, abs=CENTIMETRES_M)
        assert abs(signed_area_m2(boundary)) == pytest.approx(600 * 400, rel=1e-3)

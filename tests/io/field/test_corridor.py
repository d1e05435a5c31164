"""Lines of corridors, of each format; what is no line, or more than one, is refused at its place."""

from __future__ import annotations

import itertools
import json
import math

import pytest

from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.errors import InputError
from eadp.io.field.reader import read_corridor, read_field
from eadp.io.text.streams import Text

ORIGIN = (47.5, 8.5)
POINTS = [(0.0, 0.0), (600.0, 0.0), (600.0, 400.0)]
DEGREES = [[*reversed(to_geodetic_deg(*point, ORIGIN))] for point in POINTS]
LINE = {"type": "LineString", "coordinates": DEGREES}
SQUARE = {"type": "Polygon", "coordinates": [[[0, 0], [1e-3, 0], [1e-3, 1e-3], [0, 1e-3], [0, 0]]]}
KML = "<kml><Placemark><name>brook</name><LineString><coordinates>{}</coordinates></LineString></Placemark></kml>"
PAIRS = " ".join(f"{lon},{lat}" for lon, lat in DEGREES)


def feature(geometry, name="brook"):
    return {"type": "Feature", "properties": {"name": name}, "geometry": geometry}


def collection(*features):
    return json.dumps({"type": "FeatureCollection", "features": features})


@pytest.mark.parametrize(
    ("body", "given", "name"),
    [
        (json.dumps(LINE), {}, ""),
        (json.dumps(feature(LINE)), {}, "brook"),
        (collection(feature(SQUARE, "pond"), feature(LINE)), {}, "brook"),
        (collection(feature(LINE, "road"), feature(LINE)), {"feature": "brook"}, "brook"),
        (json.dumps({"type": "MultiLineString", "coordinates": [DEGREES]}), {}, ""),
        (KML.format(PAIRS), {}, "brook"),
        ("lon,lat\n" + "".join(f"{lon},{lat}\n" for lon, lat in DEGREES), {}, ""),
        ("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in POINTS), {}, ""),
        (json.dumps({"type": "LineString", "coordinates": POINTS}), {"metres": True}, ""),
    ],
)
def test_a_line_of_each_format(body, given, name):
    field, line, _ = read_corridor(Text("line", body), 100.0, **given)
    assert field.name == name
    assert [math.dist(a, b) for a, b in itertools.pairwise(line)] == pytest.approx([600, 400], rel=1e-6)
    # two rectangles less the corner that they share, and the mitre beyond it
    assert field.area_m2 == pytest.approx(100 * (600 + 400), rel=1e-4)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (json.dumps(SQUARE), "line:1:1: error: no line, only a Polygon; expected a LineString; a polygon is covered"),
        (collection(feature(LINE), feature(LINE, "b")), "2 features with lines"),
        (json.dumps({"type": "MultiLineString", "coordinates": [DEGREES, DEGREES]}), "a second line; expected one"),
        (json.dumps({"type": "LineString", "coordinates": [DEGREES[0]] * 3}), "a line of one place"),
        (json.dumps({"type": "LineString", "coordinates": [DEGREES[0], ["a", 1]]}), "a string is no number"),
        (json.dumps({"type": "LineString", "coordinates": [[8.5, 47.5], [8.5, 1e9]]}), "beyond ±90"),
        (json.dumps({"type": "LineString", "coordinates": [[8.5, 47.5], [9.5, 47.5]]}), "75.34 km by"),
        (KML.replace("LineString", "Point").format(PAIRS), "no line; expected KML with a LineString"),
        (KML.format("8.5,47.5 8.6,x"), "x is not a number"),
        ("x_m,y_m\n0,0\n", "a line of one place"),
        ("x_m,y_m,ring\n0,0,0\n9,0,0\n5,5,1\n", "a second line"),
        ("", "is empty"),
    ],
)
def test_what_is_no_line_is_refused(body, words):
    with pytest.raises(InputError) as caught:
        read_corridor(Text("line", body), 100.0)
    assert words in str(caught.value)


def test_a_line_without_a_width_is_told_of_it():
    for body in (json.dumps(LINE), KML.format(PAIRS)):
        with pytest.raises(InputError, match="of a line, --corridor WIDTH"):
            read_field(Text("line", body))

"""KMZ, a zip archive with a KML document, and shapefiles."""

from __future__ import annotations

import zipfile

import pytest

from eadp.errors import InputError
from eadp.io.field.files import read_field_text
from eadp.io.field.reader import read_field

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


UTM_32 = (
    'PROJCS["WGS_1984_UTM_Zone_32N",GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["False_Easting",500000.0],PARAMETER["False_Northing",0.0],PARAMETER["Central_Meridian",9.0],'
    'PARAMETER["Scale_Factor",0.9996],PARAMETER["Latitude_Of_Origin",0.0],UNIT["Meter",1.0]]'
)
PARCEL = [(590_000.0, 6_137_000.0), (590_000.0, 6_137_300.0), (590_500.0, 6_137_300.0), (590_500.0, 6_137_000.0)]


def shapefile(folder):
    library = pytest.importorskip("shapefile")
    with library.Writer(str(folder / "parcels"), shapeType=library.POLYGON) as writer:
        writer.field("PLOT", "C")
        writer.record("ØST 1")
        writer.poly([[(x + 5000, y) for x, y in PARCEL]])
        writer.record("ØST 2")
        writer.poly([PARCEL, [(590_100.0, 6_137_100.0), (590_150.0, 6_137_100.0), (590_100.0, 6_137_150.0)]])
    (folder / "parcels.prj").write_text(UTM_32)
    return folder / "parcels.shp"


def test_a_shapefile_by_its_reference_system(tmp_path):
    pyproj = pytest.importorskip("pyproj")
    path = shapefile(tmp_path)
    field, _ = read_field(read_field_text(str(path)), feature="PLOT=ØST 2")
    # the area on the ellipsoid of the parcel's corners, by another program
    longitudes, latitudes = pyproj.Transformer.from_crs(32632, 4326, always_xy=True).transform(
        *zip(*PARCEL, strict=True)
    )
    area_m2 = abs(pyproj.Geod(ellps="WGS84").polygon_area_perimeter(longitudes, latitudes)[0])
    assert len(field.holes) == 1
    assert field.area_m2 == pytest.approx(area_m2 * (1 - 1250 / 150_000), rel=1e-5)
    with zipfile.ZipFile(tmp_path / "parcels.zip", "w") as stream:
        for ending in ("shp", "dbf", "prj"):
            stream.write(path.with_suffix(f".{ending}"), f"data/parcels.{ending}")
    assert read_field_text(str(tmp_path / "parcels.zip")).body == read_field_text(str(path)).body
    with pytest.raises(InputError, match=r"2 features with polygons; expected .* 1 PLOT=ØST 1; 2 PLOT=ØST 2"):
        read_field(read_field_text(str(path)))


def test_a_shapefile_that_cannot_be_read(tmp_path):
    path = shapefile(tmp_path)
    path.with_suffix(".prj").write_text("none")
    with pytest.raises(InputError, match=r"the reference system of its \.prj, none, is not known"):
        read_field_text(str(path))
    path.write_bytes(path.read_bytes()[:120])
    with pytest.raises(InputError, match="cannot be read as a shapefile"):
        read_field_text(str(path))


def test_what_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "field.kmz"
    with pytest.raises(InputError, match="an archive without a KML document or a shapefile"):
        read_field_text(archive(path, doc_txt=KML))
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match="cannot be read as an archive"):
        read_field_text(str(path))
    # a few kilobytes that unpack to more than the limit
    monkeypatch.setenv("EADP_LIMIT_BYTES", "100000")
    with pytest.raises(InputError, match="its KML is too large; expected at most 100000 bytes"):
        read_field_text(archive(path, doc_kml=" " * 5_000_000))
    with pytest.raises(InputError, match="cannot be read"):
        read_field_text(str(tmp_path / "nosuch.kmz"))


def test_a_library_that_finds_a_shapefile_odd_says_nothing(tmp_path, recwarn, capfd):
    """A header with another size, and a hole without an outline."""
    library = pytest.importorskip("shapefile")
    path = tmp_path / "odd.shp"
    with library.Writer(str(path), shapeType=library.POLYGON) as writer:
        writer.field("PLOT", "C")
        writer.record("1")
        writer.poly([[(10, 55), (10.01, 55), (10.01, 55.004), (10, 55.004)]])
    data = bytearray(path.read_bytes())
    data[24:28] = (1000).to_bytes(4, "big")
    path.write_bytes(bytes(data))
    assert read_field(read_field_text(str(path)))[0].area_m2 == pytest.approx(640 * 445, rel=0.01)
    assert not [one for one in recwarn if "shp" in str(one.message)]
    assert capfd.readouterr().err == ""

"""KMZ, a zip archive with a KML document; shapefiles are refused."""

import zipfile

import pytest
from common.answers import refused

from eadp.errors import InputError
from eadp.survey.field_reader import read_field, read_field_text

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
    monkeypatch.setattr("eadp.survey.field_reader.LIMIT_BYTES", 100_000)
    with pytest.raises(InputError, match="its KML is too large; expected at most 100000 bytes"):
        read_field_text(archive(path, doc_kml=" " * 5_000_000))
    with pytest.raises(InputError, match="cannot be read"):
        read_field_text(str(tmp_path / "nosuch.kmz"))


def test_a_shapefile_is_refused_with_what_converts_it(eadp, tmp_path):
    path = tmp_path / "parcels.shp"
    path.write_bytes(b"\x00\x00\x27\x0a" + bytes(96))
    words = "error: is a shapefile, which is not read; expected GeoJSON, as by ogr2ogr -t_srs EPSG:4326 field.geojson "
    assert refused(eadp("cover", path, "--min-radius", "40", "--swath", "60"), f"{words}{path}")
    zipped = archive(tmp_path / "parcels.zip", parcels_shp="", parcels_dbf="")
    assert refused(eadp("cover", zipped, "--min-radius", "40", "--swath", "60"), "archive of a shapefile", "/vsizip/")

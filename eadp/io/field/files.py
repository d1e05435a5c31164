"""Field files as texts: also a KML document in a zip archive."""

from __future__ import annotations

import os
import zipfile
import zlib

from eadp.errors import InputError
from eadp.io.text.streams import Text, limit_bytes, read_text

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

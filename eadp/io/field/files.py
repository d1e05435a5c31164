"""Field files as texts: also those in a zip archive, a KML document or a shapefile, and shapefiles."""

from __future__ import annotations

import os
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from eadp.errors import InputError
from eadp.io.field.shp import MAGIC, shapefile_text
from eadp.io.text.streams import Text, limit_bytes, read_text

_ZIP = b"PK\x03\x04"


def read_field_text(path: str) -> Text:
    """Read a text file, standard input for `-`, the KML of a KMZ file, or a shapefile as GeoJSON, zipped or not.

    Raises
    ------
    InputError
        As `read_text`; or if an archive is damaged or has neither, what is in it is too large, or as `shapefile_text`.
    """
    head = _head(path)
    if head == MAGIC:
        return shapefile_text(path, lambda ending: _beside(Path(path), ending))
    if head != _ZIP:
        return read_text(path)
    try:
        with zipfile.ZipFile(path) as archive:
            # the first is the document that is shown, as doc.kml
            for ending in (".kml", ".shp"):
                member = next((name for name in archive.namelist() if name.lower().endswith(ending)), None)
                if member is not None:
                    read = _member(path, archive, member[: -len(ending)])
                    return shapefile_text(path, read) if ending == ".shp" else _kml_text(path, read)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        message = f"cannot be read as an archive: {error}"
        raise InputError.at(path, 1, 1, message, "a KMZ file or a zip archive") from None
    message = "an archive without a KML document or a shapefile"
    raise InputError.at(path, 1, 1, message, "a KMZ file, or one with a .shp")


def _kml_text(path: str, read: Callable[[str], bytes | None]) -> Text:
    try:
        body = (read(".kml") or b"").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError.at(path, 1, 1, "its KML is not UTF-8 text", "UTF-8 text") from None
    return Text(path, body.replace("\r\n", "\n").replace("\r", "\n"))


def _member(path: str, archive: zipfile.ZipFile, stem: str) -> Callable[[str], bytes | None]:
    """Reads the members of an archive that have a name, by their endings."""
    members = {name.lower(): name for name in archive.namelist()}

    def read(ending: str) -> bytes | None:
        name = members.get(stem.lower() + ending)
        if name is None:
            return None
        with archive.open(name) as stream:
            return _limited(path, f"its {ending[1:].upper()}", stream.read(limit_bytes() + 1))

    return read


def _beside(path: Path, ending: str) -> bytes | None:
    """The content of a shapefile's file, whatever the case of its ending."""
    for name in (path.with_suffix(ending), path.with_suffix(ending.upper())):
        if name.is_file():
            with open(name, "rb") as stream:
                return _limited(str(name), "it", stream.read(limit_bytes() + 1))
    if ending == ".shp":
        with open(path, "rb") as stream:
            return _limited(str(path), "it", stream.read(limit_bytes() + 1))
    return None


def _limited(name: str, what: str, data: bytes) -> bytes:
    if len(data) > limit_bytes():
        raise InputError.at(name, 1, 1, f"{what} is too large", f"at most {limit_bytes()} bytes")
    return data


def _head(path: str) -> bytes:
    """The first bytes of a regular file; none where there is no such, whose reading as a text raises it."""
    if not os.path.isfile(path):
        return b""
    try:
        with open(path, "rb") as stream:
            return stream.read(len(_ZIP))
    except OSError:
        return b""

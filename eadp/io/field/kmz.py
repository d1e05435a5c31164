"""Field files as texts: a KMZ is a zip archive with a KML document."""

from __future__ import annotations

import os
import zipfile
import zlib

from eadp.errors import InputError
from eadp.io.text.streams import Text, limit_bytes, read_text

_ZIP = b"PK\x03\x04"


def read_field_text(path: str) -> Text:
    """Read a text file, standard input for `-`, or the KML of a KMZ file.

    Raises
    ------
    InputError
        As `read_text`; or if an archive is damaged, has no KML, or its KML is too large.
    """
    if not _is_archive(path):
        return read_text(path)
    limit = limit_bytes()
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.lower().endswith(".kml")]
            if not names:
                raise InputError.at(path, 1, 1, "an archive without a KML document", "a KMZ file")
            # the first is the document that is shown, as doc.kml
            with archive.open(names[0]) as stream:
                data = stream.read(limit + 1)
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        raise InputError.at(path, 1, 1, f"cannot be read as KMZ: {error}", "a KMZ file") from None
    if len(data) > limit:
        raise InputError.at(path, 1, 1, "its KML is too large", f"at most {limit} bytes")
    try:
        body = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError.at(path, 1, 1, "its KML is not UTF-8 text", "UTF-8 text") from None
    return Text(path, body.replace("\r\n", "\n").replace("\r", "\n"))


def _is_archive(path: str) -> bool:
    if not os.path.isfile(path):
        return False
    try:
        with open(path, "rb") as stream:
            return stream.read(len(_ZIP)) == _ZIP
    except OSError:
        return False  # reading the text raises it as an InputError

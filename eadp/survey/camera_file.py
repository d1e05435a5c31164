"""The camera file: a sensor, a lens and the shortest time between pictures; and the cameras that are shipped."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from os.path import exists
from typing import Literal

from eadp.errors import InputError, one_of, printable
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import STRICT, keys_document, validated, without_nulls
from eadp.survey.camera import Camera

SCHEMA = "eadp.camera/1"
FOLDER = files("eadp") / "presets" / "cameras"
CAMERAS = tuple(sorted(file.name.removesuffix(".yaml") for file in FOLDER.iterdir()))
"""Names of the cameras that are shipped."""


@dataclass(frozen=True)
class CameraFile(Camera):
    """A camera file."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.camera/1"] = "eadp.camera/1"
    """Name and version of the format."""

    source: str = ""
    """Where the values are from."""


def read_camera(name: str) -> Camera:
    """A camera by its name, or of a file.

    Raises
    ------
    InputError
        If there is neither, or with every fault of the file.
    """
    if name in CAMERAS:
        text = Text(f"{name}.yaml", (FOLDER / f"{name}.yaml").read_text("utf-8"))
    elif name.endswith((".yaml", ".yml")) or exists(name):
        text = read_text(name)
    else:
        expected = f"a camera file (.yaml), or {one_of(CAMERAS, name)}"
        raise InputError.at("--camera", 1, 1, f"no camera {printable(name, 60)}", expected, name)
    document = keys_document(text, SCHEMA)
    expected = "the picture's width and height in the order of the sensor's"
    return validated(
        CameraFile,
        document,
        without_nulls(document.value),
        lambda keys: [document.fault((key,), message, expected) for key, message in keys.faults()],
    )

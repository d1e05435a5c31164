"""Telemetry and autopilots' logs as tracks over the ground."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from eadp.api.given import Warn
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import to_near_local_m
from eadp.errors import InputError
from eadp.live.recorded import CAMERA, PICTURE, form_of, log_values
from eadp.live.telemetry import TelemetryReader, open_telemetry
from eadp.live.telemetry_log import telemetry_lines
from eadp.models.plan.trace import PictureTrack


def flown_track(source: str, origin_deg: Point | None, warn: Warn) -> PictureTrack:
    """The track of a flight, in a frame with an origin; of telemetry, which has no camera, all of it.

    Raises
    ------
    InputError
        If the source is no flight, or has no positions.
    """
    form = None  # of a log; None for telemetry
    path = Path(source)
    if path.is_file() and os.access(path, os.R_OK):
        with path.open("rb") as stream:
            head = stream.read(16)
        form = form_of(head)
        if form is None and head.strip() and not head.lstrip().startswith(b"{"):
            expected = "a folder of eadp simulate -o DIR, telemetry as JSON lines, or a log"
            raise InputError.at(source, 1, 1, "is no flight", expected)
    return _of_telemetry(source, origin_deg, warn) if form is None else _of_log(source, form, origin_deg)


def _of_telemetry(source: str, origin_deg: Point | None, warn: Warn) -> PictureTrack:
    reader, rows = TelemetryReader(source, origin_deg=origin_deg), []
    with open_telemetry(source) as stream:
        for number, raw in telemetry_lines(stream, source):
            sample, _, found, _ = reader.read(number, raw)
            warn([each for each in found if "missing" not in each.message])
            if sample is not None and sample.position_m is not None:
                rows.append((sample.time_s, *sample.position_m))
    if len(rows) < 2:
        raise InputError.at(source, 1, 1, "has no positions", "telemetry with x_m and y_m, or lat_deg and lon_deg")
    return PictureTrack(rows, [True] * len(rows))


def _of_log(source: str, form: str, origin_deg: Point | None) -> PictureTrack:
    if origin_deg is None:
        raise InputError.at(source, 1, 1, "has positions on the earth, and the field has none", "a field in degrees")
    rows: list[tuple[float, float, float]] = []
    camera, pictures = list[bool | None](), list[int]()  # whether it is on at each row; rows at which it took a picture
    known: dict[str, Any] = {}  # the last value of each key
    for values in log_values(source, form):
        known |= {key: value for key, value in values.items() if value is not None}
        if PICTURE in values:
            pictures.append(max(len(rows) - 1, 0))
        lat_deg, lon_deg = values.get("lat_deg"), values.get("lon_deg")
        if lat_deg is not None and lon_deg is not None and known.get("in_air", known.get("armed", True)):
            point = to_near_local_m(lat_deg, lon_deg, origin_deg)
            if point is not None:
                rows.append((values["time_s"], *point))
                camera.append(known.get(CAMERA))
    if len(rows) < 2:
        raise InputError.at(source, 1, 1, "has no positions in the air", "a log of a flight")
    # on throughout where the log does not say; else off until it is switched on
    return PictureTrack(rows, [CAMERA not in known if each is None else each for each in camera], pictures)

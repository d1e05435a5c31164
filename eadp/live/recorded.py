"""Recorded flights as the values of messages: topics of a ULog, messages of DataFlash and telemetry logs; and tracks.

Source: docs.px4.io, "uORB Message Reference"; ardupilot.org, "Onboard Message Log Messages".
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from eadp.api.given import Warn
from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import to_near_local_m
from eadp.errors import InputError
from eadp.live.mavlink import is_tlog, require_pymavlink, tlog_messages
from eadp.live.messages import (
    COPTER_MISSION,
    PICTURES,
    PLANE_GUIDED,
    PLANE_MISSION,
    PLANE_RETURNS,
    READERS,
    Values,
    finite,
    is_autopilot,
    values_of,
)
from eadp.live.replanner import telemetry_lines
from eadp.live.telemetry import TelemetryReader, open_telemetry
from eadp.models.plan.stage import TRIGGER_DISTANCE
from eadp.models.plan.trace import PictureTrack
from eadp.plug_ins import plug_in

Row = dict[str, float]
Table = dict[str, FloatArray]

TLOG = "tlog"
_MAGICS = {b"ULog": "ulog", b"\xa3\x95": "dataflash"}
"""First bytes of autopilots' own logs, and the names of their formats."""

_ARMED, _NAV_LAST = 2, 95
"""PX4's state of an armed aircraft; the last of the commands that move it."""
_NAV_MISSION, _NAV_RETURNS, _NAV_OFFBOARD = 3, 5, 14
"""PX4's states of navigation: AUTO_MISSION, AUTO_RTL, OFFBOARD."""
_INSTANCES = ("Instance", "Inst", "C", "I")
_UNKNOWN = float("nan")
PICTURE, CAMERA = "picture", "camera"
"""Keys of a picture that was taken, and of whether pictures are taken from then on."""
_TRIGGER_CONTROL = 2003
"""The command that switches a camera's trigger."""


def _battery(row: Row, volts: str, amps: str, consumed_mah: str, remaining: str, full: float) -> Values:
    """What a row says of the battery, by the labels of its columns; `full` is what remains of a full battery.

    None is what the autopilot did not know. NaN is a column that the log does not have; `finite` makes it None.
    """
    volts_v, current_a, mah, share = (row.get(label, _UNKNOWN) for label in (volts, amps, consumed_mah, remaining))
    return {
        "voltage_v": volts_v if volts_v > 0 else None,
        "current_a": None if current_a == -1 else current_a,
        "consumed_ah": mah / 1e3 if mah >= 0 else None,
        "remaining": share / full if share >= 0 else None,
    }


def _position(latitude: str, longitude: str) -> Callable[[Row], Values]:
    """A function that reads a row of positions, by the labels of its columns; see `_moving` for what it adds."""

    def read(row: Row) -> Values:
        """What the row says; 0, 0 is no position yet."""
        found: Values = {"time_s": row["time_s"]}
        if row[latitude] or row[longitude]:
            found |= {"lat_deg": row[latitude], "lon_deg": row[longitude]}
            found["velocity_mps"] = [row.get("east_mps", _UNKNOWN), row.get("north_mps", _UNKNOWN)]
            found["altitude_m"] = row.get("altitude_m", row.get("RelHomeAlt", _UNKNOWN))
        return found | {"heading_deg": row.get("heading_deg", _UNKNOWN)}

    return read


def _item(row: Row) -> Values:
    """What the row of a command that starts says: whether pictures are taken, and the item flown to if it is one."""
    switched = _switched(row["CId"], row.get("Prm1", _UNKNOWN))
    return switched | ({"item": int(row["CNum"])} if row["CId"] <= _NAV_LAST else {})


def _switched(command: float, value: float) -> Values:
    """Whether pictures are taken from a command on: its value, a distance or a switch, is above 0. Empty for others."""
    return {CAMERA: value > 0} if command in (TRIGGER_DISTANCE, _TRIGGER_CONTROL) else {}


def form_of(head: bytes) -> str | None:
    """The format of a recorded flight by its first bytes; None where it is of another kind."""
    own = next((form for magic, form in _MAGICS.items() if head.startswith(magic)), None)
    return own or (TLOG if is_tlog(head) else None)


def _nav_state(row: Row) -> Values:
    """What PX4 flies, as `values_of` a heartbeat has it; empty where the log does not say it."""
    state = row.get("nav_state")
    if state is None:
        return {}
    return {"automatic": state == _NAV_MISSION, "returns": state == _NAV_RETURNS, "guided": state == _NAV_OFFBOARD}


def _mode(row: Row) -> Values:
    """What ArduPilot flies, of the row of a mode; a log does not say whether of a plane or a copter."""
    mode = row["ModeNum"]
    return {
        "automatic": mode in (PLANE_MISSION, COPTER_MISSION),
        "returns": mode in PLANE_RETURNS,
        "guided": mode == PLANE_GUIDED,
    }


def _flown(row: Row) -> Values:
    """The item that PX4 flies to, and the number of items."""
    return {"item": int(row["seq_current"]), "item_count": int(row.get("seq_total", 0)) or None}


_ULOG: dict[str, Callable[[Row], Values]] = {
    "vehicle_status": lambda row: {"armed": row["arming_state"] == _ARMED, **_nav_state(row)},
    "vehicle_land_detected": lambda row: {"in_air": not row["landed"]},
    "mission_result": _flown,
    "vehicle_command": lambda row: _switched(row["command"], row["param1"]),
    "camera_trigger": lambda row: {PICTURE: True},
    "camera_capture": lambda row: {PICTURE: True},
    "battery_status": lambda row: _battery(row, "voltage_v", "current_a", "discharged_mah", "remaining", 1.0),
    "airspeed": lambda row: {"true_mps": row["true_airspeed_m_s"]},
    "airspeed_validated": lambda row: {"true_mps": row["true_airspeed_m_s"]},
    "wind_estimate": lambda row: {"wind_mps": [row["windspeed_east"], row["windspeed_north"]]},
    "wind": lambda row: {"wind_mps": [row["windspeed_east"], row["windspeed_north"]]},
    "vehicle_global_position": _position("lat", "lon"),
}
_DATAFLASH: dict[str, Callable[[Row], Values]] = {
    "ARM": lambda row: {"armed": bool(row["ArmState"]), "active": True},
    "STAT": lambda row: {"in_air": bool(row["isFlying"])},
    "MODE": _mode,
    "CMD": lambda row: {"item_count": int(row["CTot"]) - 1},  # home aside
    "MISE": _item,
    "CAM": lambda row: {PICTURE: True},
    "TRIG": lambda row: {PICTURE: True},
    "CURR": lambda row: _battery(row, "Volt", "Curr", "CurrTot", "RemPct", 100.0),
    "BAT": lambda row: _battery(row, "Volt", "Curr", "CurrTot", "RemPct", 100.0),
    "ARSP": lambda row: {"airspeed_mps": row["Airspeed"]},
    "NKF2": lambda row: {"wind_mps": [row["VWE"], row["VWN"]]},
    "XKF2": lambda row: {"wind_mps": [row["VWE"], row["VWN"]]},
    "POS": _position("Lat", "Lng"),
}
"""What a row of each topic says. Rows of one time are taken in this order: positions, which make lines, are last."""
_POSITIONS = ("vehicle_global_position", "POS")

_MOTION = {
    "ulog": (("vehicle_local_position", "vy", "vx", "heading", np.degrees(1.0)),),
    "dataflash": (("NKF1", "VE", "VN", "Yaw", 1.0), ("XKF1", "VE", "VN", "Yaw", 1.0)),
}
"""Topics of the velocity: the labels of east, north and the heading, and the heading's unit [°]. The last topic that a
log has is taken."""


def log_values(path: str, form: str) -> Iterator[Values]:
    """What a recorded flight says, as `values_of` of messages, in the order of time.

    Parameters
    ----------
    path : str
    form : str
        As of `form_of`.

    Raises
    ------
    InputError
        If it cannot be read, its library is not installed, or the file is none that can be read twice.
    """
    if not os.path.isfile(path):
        raise InputError.at(path, 1, 1, "is not a regular file", "an autopilot's log as a file")
    if form == TLOG:
        yield from _tlog_values(path)
        return
    readers = _ULOG if form == "ulog" else _DATAFLASH
    topics = [*readers, *(topic for topic, *_ in _MOTION[form])]
    columns = plug_in("log_tables", "autopilot")(path, path, form, topics).columns
    tables = {topic.removesuffix(" 0"): first for topic, table in columns.items() if (first := _first_instance(table))}
    yield {"home_is_item": form == "dataflash"}
    # a log that does not say when the aircraft flies counts as in the air
    if not tables.keys() & {"vehicle_status", "vehicle_land_detected", "ARM", "STAT"}:
        yield {"armed": True, "active": True}
    # rows of all topics, by time and the order of their topics
    rows = []
    for order, (topic, reader) in enumerate(readers.items()):
        table = tables.get(topic, {})
        if topic in _POSITIONS:
            table = _moving(table, tables, form)
        names = list(table)
        rows += [
            (values[names.index("time_s")], order, reader, dict(zip(names, values, strict=True)))
            for values in zip(*(table[name].tolist() for name in names), strict=True)
        ]
    for _, _, reader, row in sorted(rows, key=lambda each: each[:2]):
        try:
            yield {key: finite(value) for key, value in reader(row).items()}
        except (ArithmeticError, LookupError, ValueError):
            continue


def _tlog_values(path: str) -> Iterator[Values]:
    """What the messages of the first autopilot in a telemetry log say, and the pictures of its aircraft."""
    require_pymavlink(path, "")
    source: tuple[int, int] | None = None
    for kind, system, component, fields in tlog_messages(Path(path).read_bytes(), frozenset((*READERS, *PICTURES))):
        if source is None and is_autopilot(kind, fields):
            source = system, component
        if source is not None and system == source[0] and kind in PICTURES:
            yield {PICTURE: True}
        elif (system, component) == source:
            try:
                yield values_of(kind, fields)
            except (ArithmeticError, LookupError, TypeError, ValueError):
                continue


def _first_instance(table: Table) -> Table:
    """The rows of a topic that are of its first instance, with a column `time_s`; empty where it has no times."""
    times = next((table[label] for label in ("timestamp", "TimeUS") if label in table), None)
    if times is None:
        return {}
    instances = next((table[label] for label in _INSTANCES if label in table), None)
    kept = np.isfinite(times) if instances is None else np.isfinite(times) & (instances == 0)
    return {label: values[kept] for label, values in {**table, "time_s": times / 1e6}.items()}


def _moving(positions: Table, tables: dict[str, Table], form: str) -> Table:
    """A table of positions, to which the velocity, heading and altitude at their times are added, by `_MOTION`."""
    for topic, east, north, heading, unit_deg in _MOTION[form]:
        motion = tables.get(topic, {})
        if positions and {east, north, heading} <= motion.keys() and len(motion["time_s"]):
            order = np.argsort(motion["time_s"], kind="stable")
            at_s = motion["time_s"][order]
            for key, label in (("east_mps", east), ("north_mps", north)):
                positions[key] = np.interp(positions["time_s"], at_s, motion[label][order])
            if "z" in motion:  # down from where the estimate started
                positions["altitude_m"] = np.interp(positions["time_s"], at_s, -motion["z"][order])
            # headings are not interpolated, as they jump from 360 to 0: the last one before
            last = np.clip(np.searchsorted(at_s, positions["time_s"], side="right") - 1, 0, None)
            positions["heading_deg"] = motion[heading][order][last] * unit_deg % 360
    return positions


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
    """The track of a log: its positions in the air, and the pictures taken there, each at the position before it."""
    if origin_deg is None:
        raise InputError.at(source, 1, 1, "has positions on the earth, and the field has none", "a field in degrees")
    rows: list[tuple[float, float, float]] = []
    camera, pictures = list[bool | None](), list[int]()  # whether it is on at each row; rows at which it took a picture
    known: dict[str, Any] = {}  # the last value of each key
    for values in log_values(source, form):
        known |= {key: value for key, value in values.items() if value is not None}
        if not known.get("in_air", known.get("armed", True)):
            continue
        if PICTURE in values:
            pictures.append(max(len(rows) - 1, 0))
        lat_deg, lon_deg = values.get("lat_deg"), values.get("lon_deg")
        if lat_deg is not None and lon_deg is not None:
            point = to_near_local_m(lat_deg, lon_deg, origin_deg)
            if point is not None:
                rows.append((values["time_s"], *point))
                camera.append(known.get(CAMERA))
    if len(rows) < 2:
        raise InputError.at(source, 1, 1, "has no positions in the air", "a log of a flight")
    # on throughout where the log does not say; else off until it is switched on
    at_first = CAMERA not in known
    return PictureTrack(rows, [at_first if on is None else on for on in camera], pictures)

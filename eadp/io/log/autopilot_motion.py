"""The motion in an autopilot's log, at the times of its battery: airspeed, bank and rate of climb."""

from __future__ import annotations

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.io.log.messages import Tables, at_times
from eadp.io.log.power_log import AIRSPEED, BANK, CLIMB

_AIRSPEEDS = (
    ("airspeed_validated", "true_airspeed_m_s"),
    ("airspeed", "true_airspeed_m_s"),
    ("airspeed_validated", "calibrated_airspeed_m_s"),
    ("airspeed", "indicated_airspeed_m_s"),
    ("ARSP", "Airspeed"),
)
_CLIMBS = (
    ("vehicle_local_position", "vz", -1.0),
    ("XKF1", "VD", -1.0),
    ("NKF1", "VD", -1.0),
    ("BARO", "CRt", 1.0),
    ("GPS", "VZ", -1.0),
)
"""Topics and fields, the first that a log has is taken; −1 turns down into up."""

MOTION_TOPICS = ("vehicle_attitude", "ATT", *(topic for topic, *_ in (*_AIRSPEEDS, *_CLIMBS)))


def autopilot_motion(tables: Tables, time_us: FloatArray) -> dict[str, FloatArray]:
    """Columns of the motion that a log has, by their names; NaN before its first message and after its last.

    Parameters
    ----------
    tables : Tables
        Messages of `MOTION_TOPICS`.
    time_us : array, shape (n,)
        Times [µs].
    """
    found = {}
    for topic, label in _AIRSPEEDS:
        table = _table(tables, topic, label)
        if table and (table[label] > 0).any():
            found[AIRSPEED] = at_times(table["time_us"], table[label], time_us)
            break
    attitude = _table(tables, "vehicle_attitude", "q[3]")
    if attitude:
        w, x, y, z = (attitude[f"q[{i}]"] for i in range(4))
        # roll of a quaternion, body to earth
        found[BANK] = at_times(attitude["time_us"], np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)), time_us)
    elif table := _table(tables, "ATT", "Roll"):
        found[BANK] = at_times(table["time_us"], np.radians(table["Roll"]), time_us)
    for topic, label, sign in _CLIMBS:
        if table := _table(tables, topic, label):
            found[CLIMB] = at_times(table["time_us"], sign * table[label], time_us)
            break
    return found


def _table(tables: Tables, topic: str, label: str) -> dict[str, FloatArray]:
    """A topic's first instance that has a field; empty if there is none."""
    for name, table in tables.columns.items():
        times = [time for time in ("timestamp", "TimeUS") if time in table]
        if name.split(" ")[0] == topic and label in table and times and len(table[label]) > 1:
            instances = next((table[key] for key in ("C", "I", "Instance") if key in table), None)
            first = slice(None) if instances is None else instances == instances[0]
            return {"time_us": table[times[0]][first]} | {key: values[first] for key, values in table.items()}
    return {}

"""The motion in an autopilot's log, at the times of its battery: airspeed, bank and rate of climb."""

from __future__ import annotations

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.aerodynamics import SEA_LEVEL_KGPM3, air_density_kgpm3, calibrated_share
from eadp.io.log.messages import Tables, at_times
from eadp.io.log.power_log import AIRSPEED, BANK, CLIMB, DENSITY

_TRUE = (("airspeed_validated", "true_airspeed_m_s"), ("airspeed", "true_airspeed_m_s"))
_CALIBRATED = (
    ("airspeed_validated", "calibrated_airspeed_m_s"),
    ("airspeed", "indicated_airspeed_m_s"),
    ("ARSP", "Airspeed"),
    ("CTUN", "As"),
    ("VFR_HUD", "airspeed"),
)
_TRUE_OVER_CALIBRATED = (("CTUN", "E2T"),)
_HEIGHTS = (("vehicle_global_position", "alt"), ("POS", "Alt"), ("GPS", "Alt"))
"""Above the sea [m]."""
_CLIMBS = (
    ("vehicle_local_position", "vz", -1.0),
    ("XKF1", "VD", -1.0),
    ("NKF1", "VD", -1.0),
    ("BARO", "CRt", 1.0),
    ("GPS", "VZ", -1.0),
)
"""Topics and fields, the first that a log has is taken; −1 turns down into up."""

_OF_THE_AIR = (*_TRUE, *_CALIBRATED, *_TRUE_OVER_CALIBRATED, *_HEIGHTS)
MOTION_TOPICS = ("vehicle_attitude", "ATT", *dict.fromkeys(topic for topic, *_ in (*_OF_THE_AIR, *_CLIMBS)))


def autopilot_motion(tables: Tables, time_us: FloatArray) -> dict[str, FloatArray]:
    """Columns of the motion that a log has, by their names; NaN before its first message and after its last.

    Parameters
    ----------
    tables : Tables
        Messages of `MOTION_TOPICS`.
    time_us : array, shape (n,)
        Times [µs].
    """
    found = _air(tables, time_us)
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


def _air(tables: Tables, time_us: FloatArray) -> dict[str, FloatArray]:
    """True airspeed and density of the air, by which a calibrated airspeed becomes true; without a density it is."""

    def first(fields: tuple[tuple[str, str], ...]) -> FloatArray | None:
        for topic, label in fields:
            table = _table(tables, topic, label)
            if table and (table[label] > 0).any():
                return at_times(table["time_us"], table[label], time_us)
        return None

    true, calibrated, ratio, height_m = map(first, (_TRUE, _CALIBRATED, _TRUE_OVER_CALIBRATED, _HEIGHTS))
    share = None  # calibrated over true
    if ratio is not None:
        share = 1 / np.maximum(ratio, 0.1)
    elif true is not None and calibrated is not None:
        share = np.where(true > 1.0, calibrated / np.maximum(true, 1.0), np.nan)
    elif height_m is not None:
        share = calibrated_share(air_density_kgpm3(height_m))
    if true is None and calibrated is not None:
        true = calibrated if share is None else calibrated / share
    found = {} if true is None else {AIRSPEED: true}
    # ρ = ρ0 (V_c/V)²
    return found if share is None else found | {DENSITY: SEA_LEVEL_KGPM3 * share**2}


def _table(tables: Tables, topic: str, label: str) -> dict[str, FloatArray]:
    """A topic's first instance that has a field; empty if there is none."""
    for name, table in tables.columns.items():
        times = [time for time in ("timestamp", "TimeUS") if time in table]
        if name.split(" ")[0] == topic and label in table and times and len(table[label]) > 1:
            instances = next((table[key] for key in ("C", "I", "Instance") if key in table), None)
            first = slice(None) if instances is None else instances == instances[0]
            return {"time_us": table[times[0]][first]} | {key: values[first] for key, values in table.items()}
    return {}

"""Files that others made: read right, or refused with a reason; their missions, and random ones, as forecast and flown.

    python benchmarks/real.py [--real FOLDER …] [--hunt FOLDER] [--random 60] [--write]

Every mission of the folders that can be flown, and random ones of a fixed seed, with corners of any angle, legs of 1 to
20 m among those of 20 to 400 m, and waypoints that stand twice, are forecast, and flown in the simulation, without wind
and in winds. A forecast is right within two standard deviations, or 2 %, of the time and of the energy.
Missions that never end are forecast to circle for ever somewhere; miss/σ is the root mean square of the time's error
over its standard deviation. The σ of overshoots is 1.48 times the median of the time's error in gusts, as a share of
what the turns add that are flown off their paths, see `eadp.planning.forecast.evaluate.OVERSHOOT_SHARE`.

The first table has all files of the first folder by their class. A file is right that is read as other software reads
it: the area of a field by shapely, the mean power of a log and of a profile's trace by numpy or pymavlink, and a
mission's forecast by its flight. A warning is true where a mission with one is right. Refusals are expected by file. The second table has an invented example, or several, of each
kind of fault that was seen in other public files.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import math
import random
import re
import shlex
import statistics
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measured import options, recorded, rms, table
from pymavlink import mavutil
from shapely import make_valid, unary_union
from shapely.geometry import shape

from eadp.api.flight import forecast_values
from eadp.api.inputs import Files, load_flight
from eadp.cli.main import main as main_of
from eadp.core import compiled
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.errors import EadpError, InputError
from eadp.exchange.field_reader import read_field, read_field_text
from eadp.io.plan.sources import PlanReader, is_mission
from eadp.io.text.streams import read_text
from eadp.measure.formats import read_power_log
from eadp.measure.power_log import Columns
from eadp.measure.recordings import read_recording
from eadp.planning.forecast.evaluate import OVERSHOOT_SHARE
from eadp.simulation.loop import Outcome, fly

# ruff: noqa: E501
SHARED = Path(__file__).resolve().parents[2] / "shared/reference"
FOLDERS = SHARED / "real", SHARED / "missions"
HOME = (47.0, 8.0)
SHARE = 0.02
REFUSED = {
    "ArduPilot_77972_regions_11_april_2023.kmz": "293 features with polygons",
    "ArduPilot_ace97_fence-110.txt": "fences or places to rally, and no mission",
    "ArduPilot_ce1e8_rally-110.txt": "fences or places to rally, and no mission",
    "CubePilot_e2b1b_OldFileFormat.mission": "fileType: without a value; expected fileType Plan",
    "UCM-237_f748d_MAV08_no_fly_boundaries.kml": "no polygon, only open lines and points",
    "brainstable_8b436_forestbelts.geojson": "no columns of vertices",
    "click-lhwan_f96b9_parcels.geojson": "5 features with polygons",
    "jschall_d5e63_test.tlog": "is not UTF-8 text",
    "mavlink_57f7f_qgroundcontrol_sample_with_structured_scan.plan": "StructureScan is not known",
    "qgroundcontrol_sample_wrong_mission_version.plan": "mission.version: 7 is not known",
}
"""Files that are refused, and why: lines are no fields, of several fields one is named, …"""
HUNT = (
    ("H1 a battery that was not full", "replan voltage_low.waypoints --scenario S.yaml --telemetry voltage_low.jsonl", 0, "voltage is far below"),
    ("H2 zones", "plan zone.waypoints --avoid no_fly.geojson", 0, "through tower, first on the way to item 2"),
    ("H2 zones", "plan zone.waypoints --inside boundary.geojson", 0, "beyond the boundary, first on the way to item 2"),
    ("H2 zones", "plan own_fence.plan", 0, "leads beyond the boundary"),
    ("H2 zones", "export own_fence.plan --to qgc -o OUT/o.plan", 0, "leads beyond the boundary"),
    ("H3 speeds", "plan speed_default.waypoints", 0, "6 stages"),
    ("H3 speeds", "plan speed_zero.waypoints", 0, "changes nothing"),
    ("H4 a far polygon", "cover field.geojson --avoid country.geojson --camera sony-qx1-16mm --gsd 2.5", 0, "far away: taken"),
    ("H4 a far polygon", "cover field.geojson --avoid country2.kml --camera sony-qx1-16mm --gsd 2.5", 0, "far away: taken"),
    ("H5 a capacity that is disproved", "fit bat_capacity_unset.log --battery --cells 4 -o OUT/o.json", 2, "expected --soc"),
    ("H6 DJI", "plan template.kml", 2, "a mission of DJI"),
    ("H6 DJI", "cover template.kml --swath 20", 2, "a mission of DJI"),
    ("H7 fences alone", "plan fence_only.plan", 2, "fences or places to rally, and no mission"),
    ("H7 fences alone", "plan fence_home.waypoints", 2, "fences or places to rally, and no mission"),
    ("H8 WPL 120", "plan wpl120.txt", 0, "5 stages"),
    ("H9 longitudes and latitudes", "cover dateline.geojson --swath 20", 0, "28 lines"),
    ("H9 longitudes and latitudes", "cover north.geojson --swath 20", 2, "above 85° nothing is planned"),
    ("H10 tables of other programs", "cover field.poly --swath 20", 0, "%: swath 20"),
    ("H10 tables of other programs", "cover wkt.csv --swath 20", 2, "geometries as WKT"),
    ("H11 degrees or metres", "cover degrees.csv --swath 20", 2, "may be degrees or metres"),
    ("H12 computers", "profile agx_slow.log agx_fast.log --config fps=2 --config fps=10", 0, "(?s)2 +6.37.*10 +12.2"),
    ("H12 computers", "profile tegrastats.log", 2, "--config fps=2"),
    ("H12 computers", "fit smi.csv --power 'power.draw [W]' -o OUT/o.json", 0, "mean +11.45"),
    ("H12 computers", "fit jtop.csv --power 'Power VDD_IN' -o OUT/o.json", 1, "mean +5.199"),
    ("H12 computers", "profile rails.csv -o OUT/o.yaml", 0, "6 +5.6995"),
    ("H12 computers", "profile tx_rails.csv -o OUT/o.yaml", 0, "9 +8.0045"),
    ("H13 too many items", "cover long_lines.geojson --swath 5.6 -o OUT/o1.plan", 0, "lines"),
    ("H13 too many items", "export OUT/o1.plan --to ardupilot -o OUT/o.waypoints", 0, "items, where an ArduPilot holds"),
    ("H14 a home far away", "plan home_far.waypoints --check", 2, "103 km: home may be another place"),
    ("H14 a home far away", "plan axis_far.plan --check", 2, "km: home may be another place"),
    ("H15 home's height", "export home_height.waypoints --to qgc -o -", 0, r"8.4,\s+584.0"),
    ("H16 a rally point outside", "plan rally_outside.plan", 0, "a place to rally is beyond the boundary"),
    ("H17 four parameters", "plan four_params.plan", 0, "4 stages"),
    ("H18 3.84 V a cell", "fit not_full.csv --battery --cells 4 --soc 1 -o OUT/o.json", 0, "3.84 V a cell"),
    ("H19 jumps", "plan jumps.waypoints", 2, "item 32 jumps back 240 times"),
    ("H21 a count that is off", "fit count_off.csv --battery --cells 4 --soc 1 -o OUT/o.json", 0, "rises by 1.24 Ah"),
    ("H22 on the ground", "plan ground.waypoints --check", 0, "0 m above home"),
)  # fmt: skip
"""Kinds of faults that real files had: a command on an example, its exit code, and what it says."""
SUFFIXES = {"fields": (".geojson", ".kml", ".kmz"), "logs": (".bin", ".tlog", ".csv"), "profiles": (".log",)}
NEAR, EQUATOR_M, SQUARED_ECCENTRICITY = 1e-3, 6_378_137.0, 0.00669438
"""Relative error of a right area or power; the ellipsoid WGS-84."""
WARNED = "right, with a true warning"
VERDICTS = ("right", WARNED, "refused, with the reason", "refused wrongly", "wrong")
WINDS: dict[str, dict[str, Any]] = {
    "no wind": {},
    "5 m/s": {"wind.speed_mps": 5.0, "wind.from_deg": 250.0},
    "gusts": {"wind.speed_mps": 3.0, "wind.from_deg": 30.0, "wind.gust_std_mps": 1.0, "seed": 1},
}


class Compared(NamedTuple):
    """A mission's forecast and its flight."""

    forecast: Mapping[str, Any]
    outcome: Outcome
    power_w: float
    """The greatest mean power of a stage that is forecast [W]."""
    limit_w: float
    took_s: float
    excess_s: float
    """Root of the sum of squares of what overshot turns add [s]."""
    warned: bool

    @property
    def right(self) -> bool:
        """Time and energy within two standard deviations, or `SHARE`."""
        flown = {"time": (self.outcome.duration_s, "s"), "energy": (self.outcome.energy_j / 3600, "wh")}
        return all(
            abs(self.forecast[f"{key}_{unit}"] - value) <= max(2 * self.forecast[f"{key}_std_{unit}"], SHARE * value)
            for key, (value, unit) in flown.items()
        )

    @property
    def misses(self) -> float:
        """Standard deviations by which the time is off."""
        return (self.outcome.duration_s - self.forecast["time_s"]) / self.forecast["time_std_s"]


def compared(path: Path, keys: Mapping[str, Any]) -> Compared | None:
    """A mission forecast, and flown on a battery that lasts; None where the forecast is that it never ends."""
    given = {"battery.capacity_ah": 100.0, **keys}
    known = Files().scenario(None, given).keys
    plan, _ = replace(PlanReader.of(known.vehicle.airframe, known.battery), laps=1)(read_text(str(path)))
    inputs = load_flight(plan, overrides=given)
    before = time.perf_counter()
    expected = inputs.preflight()
    took_s = time.perf_counter() - before
    if expected is None:
        return None
    outcome = Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    # of stages that last longer than a step of the flight
    powers_w = [3600 * energy / seconds for seconds, energy in expected.stages.values() if seconds > 0.05]
    excess_s = math.hypot(*(one.seconds for one in inputs.mission.excess.values()))
    warned = any(fault.severity == "warning" for fault in inputs.warnings)
    limit_w = inputs.mission.vehicle.max_motion_w
    return Compared(forecast_values(expected), outcome, max(powers_w), limit_w, took_s, excess_s, warned)


def area_m2(path: Path) -> float:
    """Area of the polygons of a GeoJSON by shapely, valid and together, of a square metre or more each."""
    found = json.loads(path.read_text())
    shapes = [shape(one["geometry"]) for one in found.get("features", [{"geometry": found}])]
    latitude = math.radians(shapes[0].centroid.y)
    flat = 1 - SQUARED_ECCENTRICITY * math.sin(latitude) ** 2
    radii_m2 = EQUATOR_M**2 * (1 - SQUARED_ECCENTRICITY) / flat**2
    return float(make_valid(unary_union(shapes)).area * math.cos(latitude) * radii_m2 * math.radians(1) ** 2)


def mean_w(path: Path) -> float:
    """Mean power of the readings of a log or a recording."""
    if path.suffix == ".log":
        return statistics.fmean(float(own) / 1e3 for own in re.findall(r"VDD_IN (\d+)mW", path.read_text()))
    if path.suffix == ".csv":
        rows = np.genfromtxt(path, delimiter=",", names=True)
        return float(np.mean((rows["voltage_v"] * rows["current_a"])[rows["current_a"] != -1]))
    rows, log = [], mavutil.mavlink_connection(str(path))
    with log.filehandle:
        while (one := log.recv_match(type="CURR")) is not None:
            rows.append(one.Volt * one.Curr / 1e4)  # in hundredths, as ArduPilot 3.1 has them
    return statistics.fmean(rows)


def recorded_w(path: Path) -> list[float]:
    """The readings of a recording of a computer's power [W]."""
    found = read_recording(read_text(str(path)))
    return [] if found is None else [each for each in found.powers_w() if each is not None]


def judged(path: Path) -> tuple[str, str]:
    """The class of a file, and what became of it: right, right with a warning, refused, or wrong."""
    kinds = {suffix: kind for kind, own in SUFFIXES.items() for suffix in own}
    kind = kinds.get(path.suffix, "missions")
    try:
        if kind == "missions":
            one = compared(path, {})
            return kind, "wrong" if one is None or not one.right else WARNED if one.warned else "right"
        if kind == "fields":
            found, truth = read_field(read_field_text(str(path)))[0].area_m2, lambda: area_m2(path)
        elif kind == "logs":
            found, truth = float(read_power_log(str(path), Columns()).power_w.mean()), lambda: mean_w(path)
        else:
            found, truth = statistics.fmean(recorded_w(path)), lambda: mean_w(path)
        return kind, "right" if math.isclose(found, truth(), rel_tol=NEAR) else "wrong"
    except InputError as error:
        reason = REFUSED.get(path.name)
        return kind, "refused, with the reason" if reason is not None and reason in str(error) else "refused wrongly"


def files_table(folder: Path) -> None:
    """A row for each class of the files of a folder."""
    found = [judged(path) for path in sorted(folder.iterdir()) if path.name != "SOURCES.txt"]
    kinds = ("missions", *SUFFIXES)
    table(("files", *VERDICTS), ([kind, *(found.count((kind, one)) for one in VERDICTS)] for kind in kinds))


def hunt_table(folder: Path) -> None:
    """A row for each kind of fault that real files had: an example, invented, and its answer."""
    rows, out = dict[str, list[bool]](), io.StringIO()
    with contextlib.chdir(folder), tempfile.TemporaryDirectory() as made:
        for kind, command, code, words in HUNT:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
                found = main_of([word.replace("OUT", made) for word in shlex.split(command)])
            said = out.getvalue()
            out.seek(0)
            out.truncate()
            rows.setdefault(kind, []).append(found == code and re.search(words, said) is not None)
    table(("kind", "cases", "right or asked rightly"), ([kind, len(own), sum(own)] for kind, own in rows.items()))


def random_mission(seed: int) -> str:
    """A mission with sharp corners, short legs and waypoints that stand twice."""
    rng = random.Random(seed)
    x = y = 0.0
    rows = ["QGC WPL 110", f"0\t1\t0\t16\t0\t0\t0\t0\t{HOME[0]}\t{HOME[1]}\t0\t1"]
    for index in range(1, rng.randint(5, 25)):
        kind = rng.random()
        length_m = 0.0 if kind < 0.1 and index > 1 else rng.uniform(1, 20) if kind < 0.4 else rng.uniform(20, 400)
        course = rng.uniform(0, 2 * math.pi)
        x, y = x + length_m * math.cos(course), y + length_m * math.sin(course)
        latitude, longitude = to_geodetic_deg(x, y, HOME)
        rows.append(f"{index}\t0\t3\t16\t0\t0\t0\t0\t{latitude:.8f}\t{longitude:.8f}\t60\t1")
    return "\n".join([*rows, ""])


def missions(folders: Sequence[Path]) -> list[Path]:
    """The files of folders that are missions."""
    found = []
    for folder in folders:
        for path in sorted(folder.iterdir()) if folder.is_dir() else []:
            try:
                if is_mission(read_text(str(path))):
                    found.append(path)
            except EadpError:
                continue
    return found


def flights(title: str, paths: Sequence[Path], shares: list[float]) -> Iterator[list[object]]:
    """A row for each wind, and the missions that are forecast wrongly; adds misses in gusts over what turns add."""
    for wind, keys in WINDS.items():
        found, endless = dict[str, Compared](), 0
        for path in paths:
            with contextlib.suppress(InputError):  # no mission for this wind
                one = compared(path, keys)
                if one is None:
                    endless += 1
                else:
                    found[path.name] = one
        all_ = list(found.values())
        if wind == "gusts":
            shares += [
                abs(one.outcome.duration_s - one.forecast["time_s"]) / one.excess_s for one in all_ if one.excess_s
            ]
        yield [
            *(title, wind, len(all_), sum(one.right for one in all_), sum(one.power_w > one.limit_w for one in all_)),
            *(endless, f"{rms(one.misses for one in all_):.2f}" if all_ else ""),
            *(f"{1000 * max((one.took_s for one in all_), default=0):.0f}",),
            ", ".join(name for name, one in found.items() if not one.right),
        ]


TITLES = "missions", "wind", "flown", "right", "impossible power", "never end", "miss/σ", "slowest [ms]", "wrong"


def main() -> None:
    parser = options(__doc__, "real")
    parser.add_argument("--real", nargs="*", type=Path, default=list(FOLDERS))
    parser.add_argument("--hunt", type=Path, default=SHARED / "hunt")
    parser.add_argument("--random", type=int, default=60)
    asked = parser.parse_args()
    compiled.enable()
    with tempfile.TemporaryDirectory() as folder, recorded("real", write=asked.write):
        made = []
        for seed in range(asked.random):
            made.append(Path(folder) / f"random-{seed:02}.waypoints")
            made[-1].write_text(random_mission(seed), encoding="utf-8")
        if asked.real and asked.real[0].is_dir():
            files_table(asked.real[0])
            print()
        if asked.hunt.is_dir():
            hunt_table(asked.hunt)
            print()
        shares: list[float] = []
        rows = flights("real", missions(asked.real), shares), flights("random", made, shares)
        table(TITLES, itertools.chain(*rows))
        share = f"{1.48 * statistics.median(shares):.2f}" if shares else "-"
        print(f"σ of overshoots: {share} of what they add in {len(shares)} flights in gusts; taken {OVERSHOOT_SHARE}")


if __name__ == "__main__":
    main()

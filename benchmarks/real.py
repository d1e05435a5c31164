"""Missions that others made, and random ones with sharp corners: what was forecast beside what was flown.

    python benchmarks/real.py [--real FOLDER …] [--random 60] [--write]

Every mission of the folders that can be flown, and random ones of a fixed seed, with corners of any angle, legs of 1 to
20 m among those of 20 to 400 m, and waypoints that stand twice, are forecast, and flown in the simulation, without wind
and in winds. A forecast is right within two standard deviations, or 2 %, of the time and of the energy.
Missions that never end are forecast to circle for ever somewhere; miss/σ is the root mean square of the time's error
over its standard deviation.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import random
import statistics
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from measured import add_option, head, line, recorded

from eadp.api.flight import forecast_values
from eadp.api.inputs import load_flight
from eadp.core import compiled
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.errors import EadpError, InputError
from eadp.io.mission.reader import is_mission
from eadp.io.text.streams import read_text
from eadp.simulation.loop import Outcome, fly

SHARED = Path(__file__).resolve().parents[2] / "shared/reference"
FOLDERS = SHARED / "real", SHARED / "missions"
HOME = (47.0, 8.0)
SHARE = 0.02
WINDS: dict[str, dict[str, Any]] = {
    "calm": {},
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

    @property
    def right(self) -> bool:
        """Time and energy within two standard deviations, or `SHARE`."""
        flown = {"time": (self.outcome.duration_s, "s"), "energy": (self.outcome.totals.energy_j / 3600, "wh")}
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
    inputs = load_flight(path, overrides={"laps": 1, "battery.capacity_ah": 100.0, **keys})
    before = time.perf_counter()
    expected = inputs.preflight()
    took_s = time.perf_counter() - before
    if expected is None:
        return None
    outcome = Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    powers_w = [3600 * energy / seconds for seconds, energy in expected.stages.values() if seconds > 0]
    return Compared(forecast_values(expected), outcome, max(powers_w), inputs.world.vehicle.max_motion_w, took_s)


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


def flights(title: str, paths: Sequence[Path]) -> None:
    """A row for each wind, and the missions that are forecast wrongly."""
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
        right, impossible = sum(one.right for one in all_), sum(one.power_w > one.limit_w for one in all_)
        spread = math.sqrt(statistics.fmean(one.misses**2 for one in all_))
        wrong = ", ".join(name for name, one in found.items() if not one.right)
        slowest = f"{1000 * max(one.took_s for one in all_):.0f}"
        print(line(title, wind, len(all_), right, impossible, endless, f"{spread:.2f}", slowest, wrong))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--real", nargs="*", type=Path, default=list(FOLDERS))
    parser.add_argument("--random", type=int, default=60)
    add_option(parser, "real")
    args = parser.parse_args()
    compiled.enable()
    with tempfile.TemporaryDirectory() as folder, recorded("real", write=args.write):
        made = []
        for seed in range(args.random):
            made.append(Path(folder) / f"random-{seed:02}.waypoints")
            made[-1].write_text(random_mission(seed), encoding="utf-8")
        print(
            head(
                "missions", "wind", "flown", "right", "impossible power", "never end", "miss/σ", "slowest [ms]", "wrong"
            )
        )
        flights("real", missions(args.real))
        flights("random", made)


if __name__ == "__main__":
    main()

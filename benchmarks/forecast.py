"""How well the charge at the end of a flight is forecast on its way, beside what a pilot has today.

    python benchmarks/forecast.py [--flights 16] [--seed 0] [--jobs 2] [--write]

The plant, the missions and what their owner knows are those of benchmarks/twin.py, without losses of charge, at the
highest parameters throughout, with a pack of which a fifth is left at the end. `eadp replan` reads a line a second, and
`static` holds the parameters: its `soc_end_forecast` is ours. The others start from the same gauge, and are given what
a pilot has not, the metres that are flown to the end:

- amps × time: the current of the plan's cruise by the owner's wattmeter, and the metres at the cruise speed, as
  QGroundControl plans a mission;
- mean of 50 s: the mean current of the last 50 s, as PX4 has for its time that remains, and the mean speed so far;
- mean since take-off: the mean current since take-off, as INAV has, and the mean speed so far;
- charge a metre: that of the last 120 s.

Prints the mean absolute error of the charge at the end, in points (hundredths of the capacity), and its standard error.

Needs jsbsim: pip install 'eadp[bench]'.
"""

from __future__ import annotations

import dataclasses
import json
import math
import multiprocessing
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from measured import options, recorded, table
from plant import AIRSPEED_MPS, SAMPLE_S, battery_w
from twin import LEVELS_W, PER_LINE, Mission, Telemetry, ends, missions, owner, plan_flight, plans

from eadp import read_plan

AT = (0.1, 0.3, 0.6, 0.9)
LEFT, LEVEL_W, VOLTS = 0.2, 70.0, 15.2
"""Charge that is left at the end; power of level flight by the owner's wattmeter [W], and voltage under it."""
WAYS = ("eadp", "amps × time", "mean of 50 s", "mean since take-off", "charge a metre")


def flown(task: tuple[Mission, str]) -> tuple[str, np.ndarray]:
    """A mission's place, and the errors of its forecasts [points], shape (times, ways)."""
    mission, folder = task
    plan = read_plan(mission.plan_file, warn=lambda _: None)
    highest = (ends(plan, 0)[1], ends(plan, 1)[1])
    samples = list(plan_flight(mission, plan, highest).samples())
    shafts_w, running = (
        np.array([get(s) for s in samples]) for get in (lambda s: s.shaft_w, lambda s: s.parameters[1])
    )
    power_w = battery_w(shafts_w) + LEVELS_W[-1] * mission.noise(len(samples)) * (running > 0)
    # a bisection for the capacity of which `LEFT` is left
    low_ah, high_ah = 0.3, 6.0
    for _ in range(20):
        capacity_ah = (low_ah + high_ah) / 2
        pack = mission.lipo(capacity_ah)
        for power in power_w:
            pack.step(power, SAMPLE_S)
        low_ah, high_ah = (low_ah, capacity_ah) if pack.soc > LEFT else (capacity_ah, high_ah)
    pack, telemetry, lines, amps = mission.lipo(high_ah), Telemetry(mission, plan.names), [], []
    for k, sample in enumerate(samples):
        pack.step(power_w[k], SAMPLE_S)
        telemetry.gauge(pack, 0.0)
        amps.append(float(pack.current_a))
        if (k + 1) % PER_LINE == 0:
            lines.append(telemetry.line(sample, float(power_w[k]), float(pack.voltage_v)))
    scenario, efficiency = owner(mission, high_ah)
    file = Path(folder) / f"{mission.index}.yaml"
    file.write_text(json.dumps(scenario))
    command = [
        sys.executable,
        "-m",
        "eadp",
        "replan",
        mission.plan_file,
        "--scenario",
        str(file),
        "--planner",
        "static",
    ]
    command += ["--set", f"vehicle.airframe.propulsive_efficiency={efficiency}"]
    done = subprocess.run(
        command, input="".join(json.dumps(line) + "\n" for line in lines), capture_output=True, text=True, check=False
    )
    decisions = [json.loads(line) for line in done.stdout.splitlines()]
    ground_mps = np.array([math.hypot(each.east_mps, each.north_mps) for each in samples])
    stated_ah, cruise_a = scenario["battery"]["capacity_ah"], (LEVEL_W * mission.level_factor + LEVELS_W[-1]) / VOLTS
    errors = []
    for share in AT:
        k = round(share * len(samples))
        line = [each for each in lines if each["time_s"] <= k * SAMPLE_S][-1]
        decision = [each for each in decisions if each["time_s"] <= line["time_s"]][-1]
        left_m = float(ground_mps[k:].sum()) * SAMPLE_S
        left_s = left_m / float(ground_mps[:k].mean())
        drawn = np.array(amps[:k]) * SAMPLE_S / 3600 / stated_ah
        recent = round(120 / SAMPLE_S)
        a_metre = drawn[-recent:].sum() / (ground_mps[max(k - recent, 0) : k].sum() * SAMPLE_S)
        per_s = drawn[-round(50 / SAMPLE_S) :].mean() / SAMPLE_S, drawn.mean() / SAMPLE_S
        uses = (
            cruise_a / 3600 / stated_ah * left_m / AIRSPEED_MPS,
            per_s[0] * left_s,
            per_s[1] * left_s,
            a_metre * left_m,
        )
        found = [decision["soc_end_forecast"], *(line["soc"] - used for used in uses)]
        errors.append([100 * abs(each - float(pack.soc)) for each in found])
    print(f"{mission.index} {mission.place}: {np.round(errors, 1).tolist()}", file=sys.stderr, flush=True)
    return mission.place, np.array(errors)


def main() -> None:
    parser = options(__doc__, "forecast")
    parser.add_argument("--flights", type=int, default=16)
    parser.add_argument("--seed", type=int, default=0, help="of the missions")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, multiprocessing.Pool(asked.jobs) as pool:
        made = missions(asked.flights, asked.seed, plans(Path(folder)))
        tasks = [(dataclasses.replace(mission, losses=()), folder) for mission in made]
        errors = np.array([found for _, found in pool.imap(flown, tasks)])
    with recorded("forecast", write=asked.write):
        print(f"n = {len(errors)} flights, seed {asked.seed}; mean absolute error of the charge at the end [points]")
        table(("forecast", *(f"at {share:.0%}" for share in AT)), rows(errors))


def rows(errors: np.ndarray) -> Iterator[list[str]]:
    """The ways' errors at each time, shape (flights, times, ways), and the best of the others at each."""
    for j, way in enumerate(WAYS):
        means = [(statistics.fmean(each), statistics.stdev(each) / math.sqrt(len(each))) for each in errors[:, :, j].T]
        yield [way, *(f"{mean:.1f} ± {error:.1f}" for mean, error in means)]
    yield ["best of the others", *(f"{mean:.1f}" for mean in errors.mean(axis=0)[:, 1:].min(axis=1))]


if __name__ == "__main__":
    main()

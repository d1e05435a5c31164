"""The published survey with a battery that the flight drains: `joint` beside `paper` and the best constant parameters.

    python benchmarks/drained.py [--write]

`scenarios/paper-drained.yaml` without wind and drops, and with its drops in wind towards 0° and 90°. `paper` follows
the published rules, and once with the corrected remaining time and steps of 250 of c1. The best constants are those of
21 × 5 that complete with the largest U, with wind and drops known beforehand. U is by ground, as in every summary.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from measured import add_option, head, line, recorded

from eadp.api.inputs import load_flight
from eadp.core.compiled import enable
from eadp.simulation.loop import Outcome, fly

ROOT = Path(__file__).resolve().parents[1]
WINDS: Mapping[str, Mapping[str, Any]] = {
    "0 m/s, no drops": {"wind.speed_mps": 0.0, "faults": []},
    "5 m/s towards 0°, drops": {},
    "5 m/s towards 90°, drops": {"wind.towards_deg": 90.0},
}
CORRECTED = {"planner.paper.remaining_time": "corrected", "planner.paper.delta.c1": 250.0}
C1, C2 = np.linspace(-1000.0, 0.0, 21), (2.0, 4.0, 6.0, 8.0, 10.0)


def quality(keys: Mapping[str, Any]) -> float:
    """U of a flight that completes, else 0."""
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/paper-drained.yaml"), overrides=keys
    )
    outcome = Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    assert outcome.parameters is not None
    return (outcome.parameters.quality(inputs.scenario.planner.weights) or 0.0) if outcome.completed else 0.0


def main() -> None:
    """Fly, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_option(parser, "drained")
    with recorded("drained", write=parser.parse_args().write):
        enable()
        print(head("U; 0 where the battery is empty", "highest", "`paper`", "corrected", "`joint`", "best constants"))
        for name, wind in WINDS.items():
            static = {**wind, "planner.name": "static"}
            joint = {**wind, "planner.name": "joint", "battery.letter_crate_per_h": None}
            flights = quality(static), quality(wind), quality({**wind, **CORRECTED}), quality(joint)
            pairs = itertools.product(C1.tolist(), C2)
            best = max(quality({**static, "parameters": {"c1": c1, "c2": c2}}) for c1, c2 in pairs)
            print(line(name, *(f"{u:.3f}" for u in (*flights, best))))


if __name__ == "__main__":
    main()

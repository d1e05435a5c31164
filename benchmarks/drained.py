"""The published survey with a battery that the flight drains: `joint` beside `paper` and the best constant parameters.

    python benchmarks/drained.py [--write]

`scenarios/paper-drained.yaml` without wind and drops, and with its drops in wind towards 0° and 90°. `paper` follows
the published rules, and once with the corrected remaining time and steps of 250 of c1. The best constants are those of
21 × 5 that complete with the largest U, with wind and drops known beforehand. U is by ground, as in every summary;
the mean share, ½(mean c̃1 + mean c̃2) over time, is the figure of the published flights.
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
SHARES = ("mean share: `paper`", "mean share: corrected")
C1, C2 = np.linspace(-1000.0, 0.0, 21), (2.0, 4.0, 6.0, 8.0, 10.0)


def quality(keys: Mapping[str, Any]) -> tuple[float, float]:
    """U and mean share of a flight that completes, else 0."""
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/paper-drained.yaml"), overrides=keys
    )
    outcome = Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    assert outcome.parameters is not None
    if not outcome.completed:
        return 0.0, 0.0
    share = float(np.mean([outcome.parameters.mean_share(i) for i in range(2)]))
    return outcome.parameters.quality(inputs.scenario.planner.weights) or 0.0, share


def main() -> None:
    """Fly, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_option(parser, "drained")
    with recorded("drained", write=parser.parse_args().write):
        enable()
        print(
            head(
                "U; 0 where the battery is empty",
                "highest",
                "`paper`",
                "corrected",
                "`joint`",
                "best constants",
                *SHARES,
            )
        )
        for name, wind in WINDS.items():
            static = {**wind, "planner.name": "static"}
            joint = {**wind, "planner.name": "joint", "battery.letter_crate_per_h": None}
            highest, paper, corrected = quality(static), quality(wind), quality({**wind, **CORRECTED})
            pairs = itertools.product(C1.tolist(), C2)
            best = max(quality({**static, "parameters": {"c1": c1, "c2": c2}}) for c1, c2 in pairs)[0]
            values = (highest[0], paper[0], corrected[0], quality(joint)[0], best, paper[1], corrected[1])
            print(line(name, *(f"{value:.3f}" for value in values)))


if __name__ == "__main__":
    main()

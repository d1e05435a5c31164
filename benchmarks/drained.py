"""The published survey with a battery that the flight drains: `joint` beside `paper` and the best constant parameters.

    python benchmarks/drained.py [--write]

`scenarios/paper-drained.yaml` without wind and drops, with its drops in wind towards 0° and 90°, and with one drop of
8 %. `paper` follows the published rules, and once with the corrected remaining time and steps of 250 of c1. `joint`
flies without the letter's limit of power, and with it. The best constants are those of 21 × 5 that complete with the
largest U, with wind and drops known beforehand. U is by ground, as in every summary; the mean share,
½(mean c̃1 + mean c̃2) over time, is the figure of the published flights; SoC is the charge at the end.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

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
    "0 m/s, 8 % at 90 s": {"wind.speed_mps": 0.0, "faults": [{"at_s": 90.0, "soc_drop": 0.08}]},
    "5 m/s towards 0°, 8 % at 90 s": {"faults": [{"at_s": 90.0, "soc_drop": 0.08}]},
}
CORRECTED = {"planner.paper.remaining_time": "corrected", "planner.paper.delta.c1": 250.0}
SHARES = ("mean share: `paper`", "mean share: corrected")
CHARGES = ("SoC: `paper`", "SoC: `joint`", "SoC: `joint` with the limit")
C1, C2 = np.linspace(-1000.0, 0.0, 21), (2.0, 4.0, 6.0, 8.0, 10.0)


class Flown(NamedTuple):
    """What came of a flight: U and mean share, 0 where it does not complete, and the charge at its end."""

    u: float
    share: float
    soc: float


def flown(keys: Mapping[str, Any]) -> Flown:
    """A flight with some keys of its scenario."""
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/paper-drained.yaml"), overrides=keys
    )
    outcome = Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    assert outcome.parameters is not None
    if not outcome.completed:
        return Flown(0.0, 0.0, outcome.soc_final)
    share = float(np.mean([outcome.parameters.mean_share(i) for i in range(2)]))
    u = outcome.parameters.quality(inputs.scenario.planner.weights) or 0.0
    return Flown(u, share, outcome.soc_final)


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
                "`joint` with the limit",
                "best constants",
                *SHARES,
                *CHARGES,
            )
        )
        for title, wind in WINDS.items():
            static, limited = ({**wind, "planner.name": name} for name in ("static", "joint"))
            joint = flown({**limited, "battery.letter_crate_per_h": None})
            highest, paper, corrected, limit = map(flown, (static, wind, {**wind, **CORRECTED}, limited))
            pairs = itertools.product(C1.tolist(), C2)
            best = max(flown({**static, "parameters": {"c1": c1, "c2": c2}}).u for c1, c2 in pairs)
            us = (*(each.u for each in (highest, paper, corrected, joint, limit)), best)
            values = (*us, paper.share, corrected.share, paper.soc, joint.soc, limit.soc)
            print(line(title, *(f"{value:.3f}" for value in values)))


if __name__ == "__main__":
    main()

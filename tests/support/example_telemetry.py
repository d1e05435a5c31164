"""Fly the survey in simulation and rewrite scenarios/example-telemetry.jsonl.

Run `python tests/support/example_telemetry.py` from anywhere: telemetry once a second, and at the flight's end.
"""

import json
import math

from common import ROOT
from common.recorder import watched

from eadp.api.inputs import load_flight
from eadp.simulation.loop import Outcome, fly

LINES_APART = 100
"""Steps of 0.01 s."""


def example():
    """The lines of telemetry of a flight by the joint planner."""
    scenario = str(ROOT / "scenarios/survey.yaml")
    inputs = load_flight(str(ROOT / "plans/survey.plan"), scenario=scenario, overrides={"planner.name": "joint"})
    flight = watched(inputs, every_step=True)
    for _ in fly(inputs.world, flight, Outcome()):
        pass
    seen = flight.planner.seen
    for k, o in enumerate(seen, 1):
        if k % LINES_APART and k != len(seen):
            continue
        yield {
            "time_s": round(o.time_s, 3),
            "x_m": round(o.position_m[0], 2),
            "y_m": round(o.position_m[1], 2),
            "power_w": round(o.sample.power_w, 2),
            "soc": round(o.soc, 5),
            "velocity_mps": [round(value, 2) for value in o.sample.velocity_mps],
            "heading_deg": round(90 - math.degrees(o.sample.heading_rad), 1) % 360,
            "parameters": {name: round(value, 3) for name, value in zip(("c1", "c2"), o.parameters, strict=True)},
        }


if __name__ == "__main__":
    lines = "".join(json.dumps(line) + "\n" for line in example())
    (ROOT / "scenarios/example-telemetry.jsonl").write_text(lines, encoding="utf-8")

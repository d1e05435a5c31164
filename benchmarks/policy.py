"""What a pilot sees of `joint`: changes of parameters, the probability stated, and when nothing changes any more.

    python benchmarks/policy.py [--flights 40] [--write]

The survey with random batteries and winds, noisy sensors: in gusts, in gusts that last for two minutes, with a
slow leak, and with sudden losses. A re-planning is feasible where the reserve can be kept; it is to state 0.945 or more
where 0.95 is asked for. A computation is not to fall and rise again within 60 s, and nothing is to change
in the last 30 s unless charge was lost within the 30 s before.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measured import add_option, head, line, recorded

from eadp.api.inputs import load_flight
from eadp.core.compiled import enable
from eadp.planning.base import INFEASIBLE
from eadp.simulation.loop import Outcome, fly

ROOT = Path(__file__).resolve().parents[1]
STATED, AGAIN_S, LAST_S = 0.945, 60.0, 30.0
NOISY = {"sensors.power_noise_w": 1.0, "sensors.soc_noise": 0.003, "sensors.position_noise_m": 1.0}
Keys = Mapping[str, Any]


def weathers(rng: np.random.Generator) -> Mapping[str, Callable[[], Keys]]:
    """What the flights of a row have beside wind and battery."""

    def losses() -> Keys:
        count = int(rng.integers(0, 4))
        drawn = [(float(rng.uniform(30, 500)), float(rng.uniform(0.02, 0.12))) for _ in range(count)]
        return {"faults": [{"at_s": at_s, "soc_drop": drop} for at_s, drop in drawn], "wind.gust_std_mps": 0.5}

    leak = [{"at_s": 30.0 + 15 * j, "soc_drop": 0.004} for j in range(40)]
    return {
        "gusts": lambda: {"wind.gust_std_mps": float(rng.uniform(0, 1.2))},
        "gusts of 120 s": lambda: {"wind.gust_std_mps": float(rng.uniform(0.5, 2.0)), "wind.gust_time_s": 120},
        "leak": lambda: {"faults": leak, "wind.gust_std_mps": 0.5},
        "losses": losses,
    }


def flown(keys: Keys) -> tuple[Outcome, list[float]]:
    """A flight of the survey, and when it lost charge [s]."""
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"),
        profile=str(ROOT / "profiles/pednet-jetson-nano.yaml"),
        overrides={"vehicle.airframe.model": "fixed-wing", "planner.name": "joint", "step_s": 0.05, **NOISY, **keys},
    )
    outcome = Outcome()
    for _ in fly(
        replace(inputs.world, clock=inputs.world.clock._replace(log_every_s=float("inf"))), inputs.flight(), outcome
    ):
        pass
    return outcome, [fault.at_s for fault in inputs.world.faults]


def again(history: list[tuple[float, float]], first: float) -> int:
    """How often a value fell and rose again within `AGAIN_S`."""
    steps = zip([(0.0, first), *history], history, history[1:], strict=False)
    return sum(b < a and c > b and then - since < AGAIN_S for (_, a), (since, b), (then, c) in steps)


def main() -> None:
    """Fly, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=40, help="flights of each row")
    add_option(parser, "policy")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    with recorded("policy", write=options.write):
        enable()
        rng = np.random.default_rng(11)
        titles = "flights with", "completed", "changes: median", "mean", "most", "above 6", "feasible re-plannings"
        print(head(*titles, "below 0.945", "down and up again", "changes in the last 30 s"))
        for name, more in weathers(rng).items():
            print(row(name, rng, more, options.flights))


def row(name: str, rng: np.random.Generator, more: Callable[[], Keys], count: int) -> str:
    """A row of the table."""
    changes, low, feasible, falls, late, completed = list[int](), 0, 0, 0, 0, 0
    for seed in range(count):
        wind = {"wind.speed_mps": float(rng.uniform(0, 7)), "wind.from_deg": float(rng.uniform(0, 360)), "seed": seed}
        outcome, losses = flown({"battery.capacity_ah": float(rng.uniform(0.45, 0.75)), **wind, **more()})
        assert outcome.parameters is not None
        completed += outcome.completed
        logs = outcome.parameters.records
        changes.append(sum(log.changes for log in logs))
        kept = [record for record in outcome.records if record.status != INFEASIBLE]
        feasible += len(kept)
        low += sum((record.ending.reserve_probability or 0.0) < STATED for record in kept)
        falls += again(logs[1].history, logs[1].first)
        times = itertools.chain.from_iterable(log.history for log in logs)
        ended_s = outcome.duration_s - LAST_S
        late += sum(t > ended_s and not any(0 <= t - lost < LAST_S for lost in losses) for t, _ in times)
    median, mean, above = statistics.median(changes), statistics.mean(changes), sum(n > 6 for n in changes)
    counted = f"{median:g}", f"{mean:.1f}", max(changes), above
    return line(name, f"{completed} of {count}", *counted, feasible, low, falls, late)


if __name__ == "__main__":
    main()

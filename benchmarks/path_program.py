"""The letter's Eq. 16 with the path among its controls: what a program over path and computations gains over the rule.

    python benchmarks/path_program.py [--write]

The letter writes its optimal control over all parameters and then changes the path by a rule (Alg. 2 l. 17-27). Here a
program takes both at each re-planning of the path: it maximises the letter's controls û = ν c + τ of path and
computations, scaled to their sets, within the remaining time t_r ≤ t_b, both linearised about the parameters in force,
and a path that moves by its δ at most. Computations of the horizon stay below those of the program. It replaces the
rule of `paper` in flights I, II, i and ii, and in those with a battery that the flight drains. U is by ground, 0 where
the battery is empty.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from measured import add_option, head, line, recorded
from scipy.optimize import linprog

from eadp.core.compiled import enable
from eadp.io.flight.inputs import load_flight
from eadp.models.plan.cursor import Vector
from eadp.planning.base import DecisionRecord, Observation
from eadp.planning.paper.planner import PaperPlanner
from eadp.simulation.loop import Outcome, fly

ROOT = Path(__file__).resolve().parents[1]
CORRECTED = {"planner.paper.remaining_time": "corrected", "planner.paper.raise_path": True}
FLIGHTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "i": ("paper-i-dynamic", {}),
    "ii": ("paper-ii-dynamic", {}),
    "drained, no wind or drops": ("paper-drained", {"wind.speed_mps": 0.0, "faults": []}),
    "drained, 5 m/s towards 0°": ("paper-drained", {}),
    "drained, 5 m/s towards 90°": ("paper-drained", {"wind.towards_deg": 90.0}),
}
STEP = 0.01
"""Share of the sets by which computations are changed for a slope."""


class ProgramPlanner(PaperPlanner):
    """The letter's planner with path and computations in one linearised program."""

    most: Vector = ()
    """Computations of the last program; those of the horizon stay below."""

    def _ruled(self, o: Observation, path: Vector, coverage: Any) -> Vector:
        rho, boxes = self._rho, [*coverage.boxes, *self._mission.plan.stages[o.stage - 1].sets[self._rho :]]
        if any(box.fixed for box in boxes[rho:]):
            return path
        now = (*path, *(self.most or tuple(box.hi for box in boxes[rho:])))
        low, span = np.array([box.lo for box in boxes]), np.array([box.hi - box.lo for box in boxes])
        share = (np.array(now) - low) / span
        spare_s = self._lasts_s(o, now) - self._remaining_s(path, o.time_s, coverage)
        slopes = np.zeros(len(boxes))  # of t_r − t_b over the shares
        for i in range(len(boxes)):
            by = -STEP if share[i] > 0.5 else STEP
            other = tuple(now[k] + by * span[k] * (k == i) for k in range(len(now)))
            left_s = self._remaining_s(other[:rho], o.time_s, coverage) - self._lasts_s(o, other)
            slopes[i] = (left_s + spare_s) / by
        reach = np.array(
            [*(delta / each for delta, each in zip(self._deltas, span[:rho], strict=False)), *[1.0] * len(now)]
        )
        limits = [
            (max(-s, -r), min(1 - s, r)) for s, r in zip(share.tolist(), reach[: len(boxes)].tolist(), strict=True)
        ]
        found = linprog(-np.ones(len(boxes)), A_ub=[slopes], b_ub=[spare_s], bounds=limits)
        # where nothing suffices, all go down as far as they may
        change = found.x if found.status == 0 else np.array([low for low, _ in limits])
        values = (low + span * (share + change)).tolist()
        self.most = tuple(values[rho:])
        return tuple(values[:rho])

    def _lasts_s(self, o: Observation, parameters: Vector) -> float:
        """t_b with computations held at values, and the path of others."""
        stage = self._mission.plan.stages[o.stage - 1]
        own = tuple(box.clip(value) for box, value in zip(stage.sets, parameters, strict=True))
        self._computing_plan_w = np.full(self._steps(), self._mission.computing.power_w(own, stage.sets))
        return min(self._time_to_reserve_s(o, self._gained_w(parameters[: self._rho])), 1e6)

    def _computations(self, o: Observation, decided: Vector) -> tuple[Vector, DecisionRecord]:
        chosen, record = super()._computations(o, decided)
        if self.most:
            levels = [max((x for x in LEVELS if x <= most + 1e-6), default=LEVELS[0]) for most in self.most]
            computations = [min(value, most) for value, most in zip(chosen[self._rho :], levels, strict=True)]
            chosen = (*chosen[: self._rho], *computations)
        return chosen, record


LEVELS = (2.0, 4.0, 6.0, 8.0, 10.0)


def quality(scenario: str, keys: Mapping[str, Any], *, program: bool = False) -> float:
    """U of a flight that completes, else 0."""
    path = ROOT / f"scenarios/{scenario}.yaml"
    inputs = load_flight(str(ROOT / "plans/survey.plan"), scenario_path=str(path), overrides=keys)
    settings = inputs.scenario.planner
    planner = inputs.planner()
    if program:
        planner = ProgramPlanner(settings, inputs.scenario.estimator, inputs.mission, settings.own)
    outcome = Outcome()
    for _ in fly(inputs.world, planner, outcome):
        pass
    assert outcome.parameters is not None
    return (outcome.parameters.quality(settings.weights) or 0.0) if outcome.completed else 0.0


def main() -> None:
    """Fly, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_option(parser, "path_program")
    with recorded("path_program", write=parser.parse_args().write):
        enable()
        print(
            head("U; 0 where the battery is empty", "rule", "rule, t_r corrected", "program, t_r corrected", "`joint`")
        )
        for name, (scenario, keys) in FLIGHTS.items():
            joint = {**keys, "planner.name": "joint", "battery.letter_crate_per_h": None}
            values = [quality(scenario, keys), quality(scenario, {**keys, **CORRECTED})]
            values.append(quality(scenario, {**keys, **CORRECTED}, program=True))
            free = "drained" in name
            print(line(name, *(f"{u:.3f}" for u in values), f"{quality(scenario, joint):.3f}" if free else "–"))


if __name__ == "__main__":
    main()

"""When to change what: the hysteresis between a plan that is optimal now and the parameters that are flown.

A pilot changes little. Path parameters change for a least gain, which grows with each change. Computations fall when
the plan needs it, stay down for a while, and rise when they can stay up.
"""

from __future__ import annotations

import math

import numpy as np

from eadp.models.plan.cursor import Vector
from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.joint.program import Solution

SETTLED_S = 60.0
"""Computations do not rise again for this long after a fall. Of the two configurations around the sustained power, the
upper one is flown first, and the lower one for the rest: it rises to the upper one if that can be flown for as long
[s]."""

EARLY_S, NO_TIME_S = 30.0, 1e-3
"""Time from the start in which computations do not fall for the margin alone, unless charge was lost: the deviation of
the forecast halves in it; and a time that is rounding [s]."""


class Policy:
    """The hysteresis of one flight."""

    def __init__(self, min_gain: float) -> None:
        self._min_gain = min_gain
        self._path_changes = 0
        self._fell_s = -SETTLED_S

    @property
    def path_gain(self) -> float:
        """Least gain of the objective for which a path parameter changes; each change before adds half of it."""
        return self._min_gain * (1 + self._path_changes / 2)

    def count_path_change(self) -> None:
        """Count a change of a path parameter."""
        self._path_changes += 1

    def note_fall(self, time_s: float) -> None:
        """Note that computations fall at a time [s]."""
        self._fell_s = time_s

    def computations(
        self, time_s: float, now_w: float, evaluation: Evaluation, solution: Solution, *, lost: bool
    ) -> tuple[Vector, float]:
        """The computations to fly with now, and for how long [s], infinite for to the end; asking changes nothing.

        One of the two configurations around the power that can be sustained to the end, or the configuration in force
        where a rise or a fall has to wait; see `SETTLED_S` and `EARLY_S`.

        Parameters
        ----------
        time_s : float
            Time of the flight [s].
        now_w : float
            Power of the computations in force [W].
        evaluation : Evaluation
            Of one place.
        solution : Solution
        lost : bool
            Whether charge was lost in this flight.
        """
        kind = int(evaluation.kinds[0])
        envelope = evaluation.evaluator.envelopes[kind]
        powers_w = envelope.powers_w
        # numbers of the envelope's vertices, from 0: `held` is in force; the sustained power lies between `below` and
        # the next one
        held = int(np.clip(np.searchsorted(powers_w, now_w + 1e-9, side="right") - 1, 0, len(powers_w) - 1))
        chosen, lasts_s = 0, math.inf  # of an infeasible plan: minimum power
        if solution.feasible:
            below, share = _vertex(powers_w, sustained_w(evaluation, kind, solution))
            # the upper one can be flown for this share of the time left, then the lower one
            if share < 1:
                lasts_s = share * float(evaluation.totals.seconds[0])
            # the highest vertex to rise to, and the highest to stay at: none is flown for a moment only
            rises_to = below + 1 if lasts_s > SETTLED_S else below
            stays_to = below + 1 if lasts_s > NO_TIME_S else below
            chosen = below
            if rises_to > held:
                waits = time_s - self._fell_s < SETTLED_S
                chosen = held if waits else rises_to
            elif held <= stays_to:
                chosen = held
            # the lower one lasts to the end
            lasts_s = lasts_s if chosen > below else math.inf
        # early in the flight no fall for the margin alone: the expected final charge keeps the reserve
        if chosen < held and time_s < EARLY_S and not lost:
            expected_soc = evaluation.final_charge(0, solution.filling).mean
            if expected_soc >= evaluation.evaluator.objective.reserve_soc:
                chosen, lasts_s = held, EARLY_S - time_s
        return tuple(envelope.configurations[chosen].tolist()), lasts_s


def _vertex(powers_w: np.ndarray, target_w: float) -> tuple[int, float]:
    """Number of the vertex at or below a power [W], from 0, and the power's share of the way to the next vertex.

    Where the power is at the last vertex or above, the last vertex but one, with a share of 1 or more.
    """
    below = int(np.clip(np.searchsorted(powers_w, target_w + 1e-9, side="right") - 1, 0, max(len(powers_w) - 2, 0)))
    if len(powers_w) == 1:
        return 0, 0.0
    return below, float((target_w - powers_w[below]) / (powers_w[below + 1] - powers_w[below]))


def sustained_w(evaluation: Evaluation, kind: int, solution: Solution) -> float:
    """Mean power of the computations over the legs of a kind, as the solution allocates it [W].

    Held constant, it uses as much charge as the solution's mix over time, and the charge that is left over.
    """
    envelope = evaluation.evaluator.envelopes[kind]
    mine, steps = evaluation.kinds == kind, len(envelope.powers_w) - 1
    use, shares = evaluation.knapsack.use[mine, :steps], solution.filling.shares[mine, :steps]
    # of each increment, summed over the legs: the share of its charge that is taken
    whole = use.sum(axis=0)
    taken = (use * shares).sum(axis=0)
    mix = np.divide(taken, whole, out=np.zeros(steps), where=whole > 0)
    power_w = float(envelope.powers_w[0] + mix @ np.diff(envelope.powers_w))
    # charge left over, and the charge that a watt more takes to the end
    left_over = evaluation.left_over(solution.filling)
    soc_per_w = float(evaluation.totals.soc_per_j[0] * evaluation.totals.seconds[0])
    return power_w + max(left_over, 0.0) / max(soc_per_w, 1e-12)

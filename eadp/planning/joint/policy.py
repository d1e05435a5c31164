"""When to change what: the hysteresis between a plan that is optimal now and the parameters that are flown.

A pilot changes little. Path parameters change for a least gain, which grows with each change. Computations fall when
the plan needs it, with some charge to spare so that they need not fall again soon, and rise when they can stay up.
"""

from __future__ import annotations

import numpy as np

from eadp.models.plan.cursor import Vector
from eadp.planning.base import JUMPED
from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.joint.program import Solution

RISE, FALL, MAX_RISE = 0.25, 0.10, 0.97
"""Of the two configurations around the sustained power, the upper one is flown first if it can be for more than this
share of the remaining time: thresholds to rise to it, once more of it for each fall, to stay with it, and to rise at
most. The variance of the forecast shrinks in flight, and its margin with it: charge saved at first is spent later."""

RISE_GAIN = 0.002
"""Least gain of U over what is left for which computations rise, times one more for each change."""

SETTLED_S, LAST_S = 60.0, 40.0
"""Time after a fall in which computations do not rise again; and time before the end in which nothing changes, unless
charge was lost [s]."""

MARGIN, MAX_MARGIN = 0.3, 1.5
"""Standard deviations of the final charge that a change keeps to spare, half as much more for each change before it,
and at most: a plan in force is left where it no longer keeps the reserve with its probability, and not before."""


class Policy:
    """The hysteresis of one flight."""

    def __init__(self, min_gain: float) -> None:
        self._min_gain = min_gain
        self._falls = self._changes = self._path_changes = 0
        self._fell_s = -SETTLED_S

    @property
    def path_gain(self) -> float:
        """Gain of U for which a path parameter changes."""
        return self._min_gain * (1 + self._path_changes / 2)

    @property
    def margin(self) -> float:
        """Standard deviations of the final charge that a change keeps to spare."""
        return min(MARGIN * (1 + self._changes / 2), MAX_MARGIN)

    def closes(self, cause: str, remaining_s: float) -> bool:
        """Whether the flight is so near its end that nothing changes."""
        return remaining_s < LAST_S and cause != JUMPED

    def path_changed(self) -> None:
        """A path parameter has changed."""
        self._path_changes += 1
        self._changes += 1

    def computations(
        self, time_s: float, now: Vector, now_w: float, evaluation: Evaluation, place: int, solution: Solution
    ) -> Vector:
        """The computations to fly with now: those sustained to the end.

        Parameters
        ----------
        time_s : float
            [s].
        now, now_w : tuple of float, float
            Computations in force, and their power [W].
        evaluation : Evaluation
        place : int
        solution : Solution
        """
        legs = evaluation.legs
        kind = int(evaluation.kinds[legs.first[place]])
        envelope = evaluation.evaluator.envelopes[kind]
        powers_w, values = envelope.powers_w, envelope.values
        remaining_s = float(evaluation.totals.seconds[place])
        held = int(np.clip(np.searchsorted(powers_w, now_w + 1e-9, side="right") - 1, 0, len(powers_w) - 1))
        if not solution.feasible:
            return self._fly(time_s, held, 0, envelope.configurations)
        target_w = sustained_w(evaluation, place, kind, solution)
        per_w = max(float(evaluation.totals.soc_per_j[place]) * remaining_s, 1e-12)
        sure, sure_share = _vertex(powers_w, target_w - self.margin * float(evaluation.std[place]) / per_w)
        below, share = _vertex(powers_w, target_w)
        rises = sure + (sure_share > min(RISE * (1 + self._falls), MAX_RISE))
        if rises > held:
            gain = (values[rises] - values[held]) * evaluation.ground_ahead(place)
            on_vertex = tuple(envelope.configurations[held].tolist()) == now
            waits = time_s - self._fell_s < SETTLED_S or (gain < RISE_GAIN * (1 + self._changes) and on_vertex)
            return self._fly(time_s, held, held if waits else int(rises), envelope.configurations)
        stays = held <= below + (share > FALL)
        return self._fly(time_s, held, held if stays else min(sure, held), envelope.configurations)

    def _fly(self, time_s: float, held: int, chosen: int, configurations: np.ndarray) -> Vector:
        if chosen < held:
            self._falls += 1
            self._fell_s = time_s
        self._changes += chosen != held
        return tuple(configurations[chosen].tolist())


def _vertex(powers_w: np.ndarray, target_w: float) -> tuple[int, float]:
    """The vertex at or below a power [W], and the share of the way to the next one."""
    below = int(np.clip(np.searchsorted(powers_w, target_w + 1e-9, side="right") - 1, 0, max(len(powers_w) - 2, 0)))
    if len(powers_w) == 1:
        return 0, 0.0
    return below, float((target_w - powers_w[below]) / (powers_w[below + 1] - powers_w[below]))


def sustained_w(evaluation: Evaluation, place: int, kind: int, solution: Solution) -> float:
    """Mean power of the computations over the legs of a kind, as allocated [W].

    Held constant, it uses as much charge as the optimal mix over time. Charge that is left over counts.
    """
    envelope = evaluation.evaluator.envelopes[kind]
    mine = (evaluation.kinds == kind) & (evaluation.legs.place == place)
    steps = len(envelope.powers_w) - 1
    use = evaluation.knapsack.use[mine, :steps]
    shares = solution.filling.shares[evaluation.kinds[evaluation.legs.place == place] == kind, :steps]
    whole = use.sum(axis=0)
    taken = (use * shares).sum(axis=0)
    mix = np.divide(taken, whole, out=np.zeros(steps), where=whole > 0)
    power_w = float(envelope.powers_w[0] + mix @ np.diff(envelope.powers_w))
    over = float(evaluation.knapsack.available[place]) - float(solution.filling.use[0])
    per_w = float(evaluation.totals.soc_per_j[place]) * float(evaluation.totals.seconds[place])
    return power_w + max(over, 0.0) / max(per_w, 1e-12)

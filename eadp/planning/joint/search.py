"""Search for the best path parameters over places, which are shares of their sets, many evaluated at a time.

At a place the best computations follow in closed form. The charge that a place needs is a step function, one step per
whole lap, and rises on each step; U is concave but for these steps. So a grid finds the best neighbourhood, and rounds
of halvings the edges of steps in it. Two or three parameters compete for charge: a grid over all finds the best
combination, and a search along each in turn its edges.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eadp.planning.forecast.evaluate import Evaluation
from eadp.planning.forecast.knapsack import fill_greedy

Shares = tuple[float, ...]
"""Path parameters as shares of their sets."""

POINTS = {1: 9, 2: 11, 3: 5}
"""Points per side of the grid, by the number of path parameters; more are searched one after the other."""

HALVED, ROUNDS, MIN_STEP = 4, 6, 1e-3
"""Most cells halved in a round; most rounds; and the narrowest cell halved, also the least gain to look for."""


class Place(NamedTuple):
    """A place, evaluated: its value, and the charge that it is short of.

    Attributes
    ----------
    shares : tuple of float
    feasible : bool
        Whether the reserve is kept with its probability.
    value : float
        Of the best computations.
    shortfall : float
        State of charge missing; 0 where it suffices.
    steps : int
        Number of legs left to fly: places with the same number are on the same step.
    """

    shares: Shares
    feasible: bool
    value: float
    shortfall: float
    steps: int

    @property
    def rank(self) -> tuple[bool, float]:
        """Greater for the better place: a feasible one, then the greater value or the smaller shortfall.

        Rounded, so that sums in another order do not choose another place.
        """
        return self.feasible, round(self.value if self.feasible else -self.shortfall, 11)


Evaluate = Callable[[list[Shares]], tuple[list[Shares], Evaluation | None]]
"""Evaluates places; returns those that can be flown, and their evaluation."""


@dataclass
class Search:
    """One search; `best` runs it.

    Parameters
    ----------
    evaluate : function
    slope : float
        Greatest change of the objective for a share more: the weight of the path parameters.
    threshold : float
        Value that a place has to exceed to be of use.
    ahead : bool
        Whether the airspeed is decided, and places are evaluated at the slowest: with lines as dense as that allows,
        nothing could answer a loss. So places leave the charge of one, see `Evaluation.with_loss`; and what is in reach
        is noted.

    Attributes
    ----------
    known : dict
        Places evaluated so far, by their shares; None for those that cannot be flown.
    in_reach : float
        With `ahead`, the greatest value of a place by the smaller margin of what can still change, see
        `Evaluation.later`; −inf where there is none.
    """

    evaluate: Evaluate
    slope: float = 1.0
    threshold: float = -math.inf
    ahead: bool = False
    known: dict[Shares, Place | None] = field(default_factory=dict)
    in_reach: float = -math.inf

    def places_at(self, wanted: Iterable[Shares]) -> list[Place]:
        """The places at some shares, without those that cannot be flown; those not known yet are evaluated together."""
        wanted = list(dict.fromkeys(wanted))
        new = [shares for shares in wanted if shares not in self.known]
        if new:
            self.known.update(dict.fromkeys(new))  # None: cannot be flown, unless found below
            flyable, evaluation = self.evaluate(new)
            if evaluation is not None:
                knapsack = evaluation.with_loss if self.ahead else evaluation.knapsack
                filling, spare = fill_greedy(knapsack), knapsack.spare
                if self.ahead:
                    later = fill_greedy(evaluation.later)
                    self.in_reach = max(self.in_reach, float(later.value[later.feasible].max(initial=-math.inf)))
                legs = evaluation.legs.last - evaluation.legs.first + 1
                for i, shares in enumerate(flyable):
                    feasible, value = bool(filling.feasible[i]), float(filling.value[i])
                    self.known[shares] = Place(shares, feasible, value, max(0.0, -float(spare[i])), int(legs[i]))
        return [place for shares in wanted if (place := self.known[shares]) is not None]

    def best(self, start: Shares) -> Place | None:
        """The best place found; None if the plan cannot be flown at any.

        One parameter is searched along its axis; two or three on a grid over all, then along each axis in turn, through
        the best place so far; more along each axis alone.

        Parameters
        ----------
        start : tuple of float
            The place in force.
        """
        if len(start) == 1:
            return _best(self._along(start, 0))
        grid = np.linspace(0.0, 1.0, POINTS.get(len(start), 0)).tolist()
        found = self.places_at([start, *itertools.product(grid, repeat=len(start))])
        for axis in range(len(start)):
            best = _best(found)
            found += self._along(start if best is None else best.shares, axis)
        return _best(found)

    def _along(self, base: Shares, axis: int) -> list[Place]:
        """The places found along an axis through `base`: a grid over the whole set, and halvings of its best cells."""

        def at(share: float) -> Shares:
            """The place with this share on the axis."""
            return (*base[:axis], share, *base[axis + 1 :])

        grid = sorted({*np.linspace(0.0, 1.0, POINTS[1]).tolist(), base[axis]})
        found = self.places_at(map(at, grid))
        cells = list(itertools.pairwise(grid))
        for _ in range(ROUNDS):
            best = _best(found)
            if best is None:
                break
            wide = [(low, high) for low, high in cells if high - low > MIN_STEP]
            if best.feasible:  # those whose bound is the highest, if it is above the best place by enough
                bounds = sorted(((self._bound(at(low), at(high)), low, high) for low, high in wide), reverse=True)
                limit = max(best.value + MIN_STEP, self.threshold)
                chosen = [(low, high) for bound, low, high in bounds if bound > limit][:HALVED]
            else:  # those on both sides of the best place, which is the least short of charge
                chosen = [(low, high) for low, high in wide if best.shares in (at(low), at(high))]
            if not chosen:
                break
            # halve each of them
            middles = [(low + high) / 2 for low, high in chosen]
            found += self.places_at(map(at, middles))
            cells = [cell for cell in cells if cell not in chosen]
            cells += [
                half
                for (low, high), middle in zip(chosen, middles, strict=True)
                for half in ((low, middle), (middle, high))
            ]
        return found

    def _bound(self, low: Shares, high: Shares) -> float:
        """What the value may reach between two known places on one axis.

        −inf where both are on one step: its best place is at its edge, just before a whole lap more is too much. −inf,
        too, where neither is feasible.
        """
        a, b = self.known[low], self.known[high]
        same_step = a is not None and b is not None and a.steps == b.steps and a.feasible == b.feasible
        # from a feasible place the value rises by at most `slope` for a share of 1
        values = [place.value for place in (a, b) if place is not None and place.feasible]
        if not values or same_step:
            return -math.inf
        return max(values) + self.slope * max(abs(y - x) for x, y in zip(low, high, strict=True))


def _best(places: Iterable[Place]) -> Place | None:
    """The first of the best places; None where there is none."""
    return max(places, key=lambda place: place.rank, default=None)

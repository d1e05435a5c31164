"""The design of a sweep: its runs, their order, and what makes them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import NormalDist
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from annotated_types import Ge, Le, Len, Lt

RUNS_LIMIT = 1_000_000
Count = Annotated[int, Ge(1), Le(RUNS_LIMIT)]
Two = Annotated[Sequence[float], Len(2, 2)]
_STANDARD = NormalDist()


# --- runs


@dataclass(frozen=True)
class Law:
    """The distribution of a key: one of the three."""

    uniform: Two | None = None
    """[low, high]"""

    normal: Two | None = None
    """[mean, standard deviation]"""

    choice: Annotated[Sequence[Any], Len(1)] | None = None
    """any of these values, each as likely"""

    @property
    def given(self) -> list[str]:
        """The distributions that it has: one, unless it is faulty."""
        return [name for name, values in vars(self).items() if values is not None]

    def at(self, share: float) -> Any:
        """The quantile of a share in (0, 1)."""
        if self.choice is not None:
            return self.choice[min(int(share * len(self.choice)), len(self.choice) - 1)]
        if self.uniform is not None:
            low, high = self.uniform
            return low + (high - low) * share
        mean, std = self.normal or (0.0, 0.0)
        return mean + std * _STANDARD.inv_cdf(share)


@dataclass(frozen=True)
class SampleDesign:
    """Keys drawn at random together, `runs` times: independently, or as a Latin hypercube.

    Every key has a generator of its own: another key does not change the draws of the keys before it, nor do more runs
    of method random.
    """

    runs: Count
    """number of runs"""

    keys: Annotated[Mapping[str, Law], Len(1)]
    """distributions by varied key"""

    seed: Annotated[int, Ge(0), Lt(2**63)] = 0
    """seed of the draws"""

    method: Literal["random", "latin"] = "random"
    """latin: a Latin hypercube"""

    @cached_property
    def draws(self) -> dict[str, list[Any]]:
        """Each key's value in each run."""
        return {name: [law.at(u) for u in self._shares(j)] for j, (name, law) in enumerate(self.keys.items())}

    def _shares(self, column: int) -> list[float]:
        """A number in (0, 1) for each run; of a Latin hypercube, one in each of `runs` equal parts, in random order."""
        generator = np.random.default_rng([self.seed, column])
        if self.method == "latin":
            parts = generator.permutation(self.runs)
            shares = (parts + generator.random(self.runs)) / self.runs
        else:
            shares = generator.random(self.runs)
        # a normal's quantiles are infinite at 0 and 1
        values: list[float] = np.clip(shares, 2.0**-54, 1 - 2.0**-53).tolist()
        return values


@dataclass(frozen=True)
class DesignPoint:
    """One run of a design: the varied keys' values, and the seed if the design sets one."""

    index: int
    values: Mapping[str, Any]
    seed: int | None


@dataclass(frozen=True)
class Design:
    """The product of a grid, of zipped values, of a sample, and of seeds; the last changes fastest.

    Its points are computed on demand: a design of a million takes no memory.
    """

    grid: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    zipped: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    sample: SampleDesign | None = None
    seeds: int | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The varied keys."""
        return (*self.grid, *self.zipped, *(self.sample.keys if self.sample else ()))

    @cached_property
    def _sizes(self) -> tuple[int, ...]:
        together = min((len(values) for values in self.zipped.values()), default=1)
        drawn = self.sample.runs if self.sample else 1
        return (*(len(values) for values in self.grid.values()), together, drawn, self.seeds or 1)

    def __len__(self) -> int:
        return math.prod(self._sizes)

    def point(self, index: int) -> DesignPoint:
        """The point of an index, from 0."""
        *axes, together, drawn, seed = (int(i) for i in np.unravel_index(index, self._sizes))
        values = {name: choices[i] for (name, choices), i in zip(self.grid.items(), axes, strict=True)}
        values |= {name: choices[together] for name, choices in self.zipped.items()}
        if self.sample:
            values |= {name: draws[drawn] for name, draws in self.sample.draws.items()}
        return DesignPoint(index, values, None if self.seeds is None else seed)


# --- engines


@dataclass(frozen=True)
class Run:
    """One flight to make: a hash of all that it depends on, files by kind, and overrides of the scenario's keys."""

    key: str
    files: Mapping[str, str]
    overrides: Mapping[str, Any]


@dataclass(frozen=True)
class Result:
    """The summary of a run, or the error that prevented it, and the time it took [s]."""

    summary: Mapping[str, Any] | None
    error: str | None = None
    took_s: float = 0.0


class Engine(Protocol):
    """Makes runs somewhere."""

    @property
    def workers(self) -> int:
        """The number of runs made at a time."""

    @property
    def room(self) -> int:
        """The number of runs that it takes now."""

    @property
    def busy(self) -> int:
        """The number of runs taken and not given back."""

    def submit(self, run: Run) -> None:
        """Take a run."""

    def finished(self) -> list[tuple[Run, Result | None]]:
        """Wait for results, maybe in vain; None for a run whose process died twice."""

    def close(self) -> None:
        """End the work at once."""

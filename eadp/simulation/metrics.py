"""Metrics of a flight: parameters over time and the quality U."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box


@dataclass
class FlightTotals:
    """Sums over a flight, added to at every step and at every change of parameters."""

    energy_j: float = 0.0
    distance_m: float = 0.0
    power_min_w: float = math.inf
    power_max_w: float = -math.inf


@dataclass
class ParameterRecord:
    """A parameter over a flight: first and last value, time integrals as commanded and as it was, and changes."""

    first: float
    last: float
    integral: float = 0.0
    actual_integral: float = 0.0
    changes: int = 0
    history: list[tuple[float, float]] = field(default_factory=list)


class ParameterLog:
    """Parameters over time: means, changes, the quality U, and the energy of computations. Updated at changes only.

    U is Σ weight · c̃ over the parameters whose set has more than one value, averaged over the time in which it has; the
    sets are those of `Plan.quality_sets`. Weights are equal by default, and scaled to sum to 1. c̃ is that of the rates
    at which the computations run, which `actual` gives. Source: letter, Sec. V.
    """

    def __init__(
        self,
        plan: Plan,
        parameters: Vector,
        sets: tuple[Box, ...],
        actual: Callable[[Vector], Vector] = tuple,
        computing_w: float = 0.0,
    ) -> None:
        self._plan, self._actual = plan, actual
        self.computing_j = 0.0
        self._computing_w = computing_w
        self._since_s = 0.0
        self._values = parameters
        self._sets = sets
        self.records = [ParameterRecord(value, value) for value in parameters]
        self._share_integral = [0.0] * len(parameters)
        self._share_time_s = [0.0] * len(parameters)

    def change(self, time_s: float, parameters: Vector, sets: tuple[Box, ...], computing_w: float = 0.0) -> None:
        """Record new values or sets, and the power of the computations [W], from a time on [s]."""
        self._advance(time_s)
        for record, old, new in zip(self.records, self._values, parameters, strict=True):
            if new != old:
                record.changes += 1
                record.last = new
                record.history.append((round(time_s, 6), new))
        self._values, self._sets, self._computing_w = parameters, sets, computing_w

    def close(self, time_s: float) -> None:
        """End the flight."""
        self._advance(time_s)

    def _advance(self, time_s: float) -> None:
        duration = time_s - self._since_s
        self._since_s = time_s
        self.computing_j += self._computing_w * duration
        for i, (value, run) in enumerate(zip(self._values, self._actual(self._values), strict=True)):
            self.records[i].integral += value * duration
            self.records[i].actual_integral += run * duration
            share = self._sets[i].share(run) if self._sets else None
            if share is not None:
                self._share_integral[i] += share * duration
                self._share_time_s[i] += duration

    def mean(self, index: int) -> float:
        """Time average of a parameter."""
        record = self.records[index]
        return record.integral / self._since_s if self._since_s > 0 else record.first

    def actual_mean(self, index: int) -> float:
        """Time average of the rate at which a computation ran."""
        record = self.records[index]
        return record.actual_integral / self._since_s if self._since_s > 0 else self._actual(self._values)[index]

    def mean_share(self, index: int) -> float | None:
        """Time average of c̃; None if its box never had more than one value."""
        time_s = self._share_time_s[index]
        return self._share_integral[index] / time_s if time_s > 0 else None

    def quality(self, weights: Mapping[str, float]) -> float | None:
        """U; None without a free parameter."""
        shares = [(name, self.mean_share(i)) for i, name in enumerate(self._plan.names)]
        free = [(weights.get(name, 0.0) if weights else 1.0, share) for name, share in shares if share is not None]
        total = sum(weight for weight, _ in free)
        return sum(weight * share for weight, share in free) / total if total > 0 else None

    def paper_metric(self, soc_final: float) -> float | None:
        """Σ_t ½(c̃1 + c̃2)/(|T| SoC(t_f)), for any number of parameters; None where SoC(t_f) is not above 0.

        Source: letter, Sec. V.
        """
        shares = [share for i in range(len(self.records)) if (share := self.mean_share(i)) is not None]
        if not shares or soc_final <= 0:
            return None
        return sum(shares) / len(shares) / soc_final

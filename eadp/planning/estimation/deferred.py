"""An estimator whose readings and laps wait until the estimate is asked for.

Where it is not, as in a sweep with held parameters, they are never processed. What it answers does not depend on when
it is asked.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray
from eadp.planning.estimation.estimator import Estimator, PowerEstimate

MOST_WAITING = 10_000
"""Most batches of readings, laps and steps of the level that wait."""

SAME_INSTANT_S = 1e-9


class _Readings(NamedTuple):
    """A batch of readings of the motion [W], NaN where there is none, beside one power of the computations [W]."""

    times_s: FloatArray
    motion_w: FloatArray
    beside_w: float


class DeferredEstimator:
    """Readings and laps in; an estimator's answers out, and the forecasts beside the power of the computations.

    Parameters
    ----------
    estimator : ExactEstimator or PublishedEstimator
        Owned from here on.
    """

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._waiting: deque[_Readings | Callable[[], None]] = deque()
        self._forecast_w = 0.0
        self._period_s, self._lap_from_s = estimator.period_s, math.inf

    @property
    def period_s(self) -> float | None:
        """The estimator's period [s]."""
        # that of the last lap does not wait
        return self._period_s if self._estimator.follows_laps else self.now.period_s

    @property
    def now(self) -> Estimator:
        """The estimator with everything processed; only to be asked."""
        self._process()
        return self._estimator

    def observe(self, times_s: Column, powers_w: Sequence[float | None] | FloatArray, beside_w: float) -> None:
        """Take readings [W] in order, None where there is none; `beside_w` of each is the computations' power."""
        motion_w = np.array(powers_w, dtype=float) - beside_w
        self._wait(_Readings(np.array(times_s, dtype=float), motion_w, beside_w))

    def lap(self, time_s: float) -> None:
        """See `ExactEstimator.lap`."""
        self._wait(partial(self._estimator.lap, time_s))
        if time_s > self._lap_from_s:
            self._period_s = time_s - self._lap_from_s
        self._lap_from_s = time_s

    def start_lap(self, time_s: float) -> None:
        """See `ExactEstimator.start_lap`."""
        self._wait(partial(self._estimator.start_lap, time_s))
        self._lap_from_s = time_s

    def shift_level(self, by_w: float) -> None:
        """See `ExactEstimator.shift_level`."""
        self._wait(partial(self._estimator.shift_level, by_w))

    def estimates(
        self, times_s: Sequence[float], computing_w: float, horizon_s: Callable[[float | None], float]
    ) -> tuple[list[float], list[PowerEstimate]]:
        """Forecast of the last reading [W] and the estimate, at instants since anything was asked last.

        Parameters
        ----------
        times_s : sequence of float
            In order [s].
        computing_w : float
            Power of the computations in force [W].
        horizon_s : function
            How far the planner looks ahead, by the period [s].
        """
        forecasts_w, estimates = [], []
        for time_s in times_s:
            self._process(time_s + SAME_INSTANT_S)
            forecasts_w.append(self._forecast_w)
            estimates.append(self._estimator.estimate(computing_w, horizon_s(self._estimator.period_s)))
        return forecasts_w, estimates

    def _wait(self, item: _Readings | Callable[[], None]) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self._process()  # without this one: the next instants that are asked for may lie in it
        self._waiting.append(item)

    def _process(self, until_s: float = math.inf) -> None:
        """Process what waits up to a time, in order."""
        while self._waiting:
            item = self._waiting.popleft()
            if not isinstance(item, _Readings):
                item()
                continue
            times_s, motion_w, beside_w = item
            end = int(np.searchsorted(times_s, until_s, "right"))
            for time_s, value in zip(times_s[:end].tolist(), motion_w[:end].tolist(), strict=True):
                self._forecast_w = self._estimator.observe(time_s, None if math.isnan(value) else value) + beside_w
            if end < len(times_s):
                self._waiting.appendleft(_Readings(times_s[end:], motion_w[end:], beside_w))
                return

"""An estimator whose readings and laps wait until the estimate is asked for.

Where it is not, as in a sweep with held parameters, they are never processed. What it answers does not depend on when
it is asked.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain

import numpy as np

from eadp.core.arrays import Column, FloatArray
from eadp.planning.estimation.estimator import Estimates, Estimator, ExactEstimator, PowerEstimate

MOST_WAITING = 100_000
"""Most readings that wait."""

SAME_INSTANT_S = 1e-9


class DeferredEstimator:
    """Readings and laps in; an estimator's answers out, and the forecasts beside the power of the computations.

    Parameters
    ----------
    estimator : ExactEstimator or PublishedEstimator
        Owned from here on.
    """

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._times_s, self._motion_w = array("d"), array("d")
        self._beside: list[tuple[int, float]] = []
        self._events: list[tuple[int, Callable[[], None]]] = []
        self._forecast_w = 0.0
        # the exact estimator's period is that of the last lap, which does not wait
        self._follows_laps = isinstance(estimator, ExactEstimator) and estimator.follows_laps
        self._period_s, self._lap_from_s = estimator.period_s, math.inf

    @property
    def period_s(self) -> float | None:
        """The estimator's period [s]."""
        return self._period_s if self._follows_laps else self.now.period_s

    @property
    def now(self) -> Estimator:
        """The estimator with everything processed; only to be asked."""
        self._process()
        return self._estimator

    @property
    def state_w(self) -> FloatArray:
        """The energy state q [W]."""
        return self.now.state_w

    def estimate(self, computing_w: float, horizon_s: float) -> PowerEstimate:
        """See `ExactEstimator.estimate`."""
        return self.now.estimate(computing_w, horizon_s)

    def forecast(self, ahead_s: FloatArray) -> FloatArray:
        """See `ExactEstimator.forecast`."""
        return self.now.forecast(ahead_s)

    def observe(self, times_s: Column, powers_w: Sequence[float | None] | FloatArray, beside_w: float) -> None:
        """Take readings [W] in order, None where there is none; `beside_w` of each is the computations' power."""
        if len(self._times_s) + len(times_s) > MOST_WAITING:
            self._process()  # before: the next instants that are asked for may lie among the new ones
        self._times_s.frombytes(np.array(times_s, dtype=float).tobytes())
        self._motion_w.frombytes((np.array(powers_w, dtype=float) - beside_w).tobytes())
        self._beside.append((len(times_s), beside_w))

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
        record: list[Estimates] = []
        self._process(record)
        known_s = np.concatenate([each.times_s for each in record])
        at = np.maximum(np.searchsorted(known_s, np.array(times_s) + SAME_INSTANT_S, "right") - 1, 0)
        forecasts_w, states = (np.concatenate([each[i] for each in record])[at] for i in (3, 4))
        periods_s = list(chain.from_iterable(each.periods_s for each in record))
        disturbances_s = np.repeat([each.disturbance_s for each in record], [len(each.times_s) for each in record])
        estimates = [
            PowerEstimate(time_s, periods_s[i], state, disturbance_s, computing_w, horizon_s(periods_s[i]))
            for i, time_s, disturbance_s, state in zip(
                at.tolist(), known_s[at].tolist(), disturbances_s[at].tolist(), states, strict=True
            )
        ]
        return forecasts_w.tolist(), estimates

    def _wait(self, event: Callable[[], None]) -> None:
        self._events.append((len(self._times_s), event))

    def _process(self, record: list[Estimates] | None = None) -> None:
        """Process what waits, in order; record the estimates before it, and after each reading and each event."""
        times_s, motion_w, beside, events = self._times_s, self._motion_w, self._beside, self._events
        if record is None and not times_s and not events:
            return
        self._times_s, self._motion_w, self._beside, self._events = array("d"), array("d"), [], []
        if record is not None:
            beside_w = np.repeat([power_w for _, power_w in beside], [count for count, _ in beside])
        done = 0
        for end, event in ((0, None), *events, (len(times_s), None)):
            if end > done:
                readings = times_s[done:end], motion_w[done:end]
                if record is None:
                    self._forecast_w = self._estimator.observe_batch(*readings) + beside[-1][1]
                else:
                    found: list[Estimates] = []
                    self._estimator.observe_batch(*readings, found)
                    record += _beside(found, beside_w[done:end])
                    self._forecast_w = float(record[-1].forecasts_w[-1])
                done = end
            if event is not None:
                event()
            if record is not None:
                record.append(self._estimator.estimates(self._forecast_w))


def _beside(estimates: list[Estimates], beside_w: FloatArray) -> Iterator[Estimates]:
    """Estimates with the power of the computations at each [W] in their forecasts."""
    n = 0
    for each in estimates:
        end = n + len(each.times_s)
        yield each._replace(forecasts_w=each.forecasts_w + beside_w[n:end])
        n = end

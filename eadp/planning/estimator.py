"""From power readings to an energy state, a period, and a forecast.

Readings are of the motion alone: the computations' known power is taken off first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eadp.core.harmonics import output_row, rotation_matrix
from eadp.core.kalman import predict, update

FloatArray = NDArray[np.float64]
EXACT, PUBLISHED = "exact", "published"


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """`gate_w` is draft 002's ε; `every_s` how often the sensor is read; noises are of the motion power."""

    kind: str = EXACT
    order: int = 3
    gate_w: float = 0.0
    every_s: float = 0.1
    noise_w: float = 0.5
    level_drift_w_per_sqrt_s: float = 0.05
    harmonic_drift_w_per_sqrt_s: float = 0.05


class Estimator(Protocol):
    """What planners need of an estimator."""

    period_s: float | None

    def observe(self, time_s: float, motion_w: float | None) -> float:
        """Take a reading [W], or None where there is none; return what was forecast for it [W]."""

    def lap(self, time_s: float) -> None:
        """A lap has ended."""

    def begin_lap(self, time_s: float) -> None:
        """A lap begins that follows no other: what went before is no lap's time."""

    def forecast(self, ahead_s: FloatArray) -> FloatArray:
        """Motion power [W], `ahead_s` [s] after the last reading."""

    @property
    def state_w(self) -> FloatArray:
        """The energy state q [W], shape (2·order + 1,)."""


class LapClock:
    """Period from the laps flown: the last lap's time, or the running lap's once it is longer.

    Source: the published flights' period (docs/reproduction.md).
    """

    def __init__(self, first_s: float) -> None:
        self._started_s = 0.0
        self.period_s = first_s
        self.laps: list[float] = []

    def tick(self, time_s: float) -> float:
        """The period now [s]."""
        self.period_s = max(self.period_s, time_s - self._started_s)
        return self.period_s

    def begin(self, time_s: float) -> None:
        """Start the clock anew without a lap's time."""
        self._started_s = time_s

    def lap(self, time_s: float) -> None:
        """Start the clock anew."""
        self.period_s = time_s - self._started_s
        self.laps.append(self.period_s)
        self._started_s = time_s


class ExactEstimator:
    """Kalman filter on q with the exact step, Joseph form and a gate; see `eadp.core.kalman`.

    Source: letter, Alg. 2 l. 28-29; draft 002 l. 9-16 for the gate. Starts from the first reading in α0, zeros
    elsewhere and a wide covariance, as draft 002's Thm. III.1 does not sum to the reading.
    """

    def __init__(self, settings: EstimatorSettings, period_s: float | None, state_w: FloatArray | None = None) -> None:
        self._settings = settings
        self._order = settings.order if period_s else 0
        self._output = output_row(self._order)
        self._state = np.zeros(2 * self._order + 1) if state_w is None else np.array(state_w[: 2 * self._order + 1])
        self._known = state_w is not None
        self._covariance = np.diag([100.0] + [25.0] * (2 * self._order))
        self._time_s: float | None = None
        self._lap_started_s = 0.0
        self._laps = 0
        self._step: tuple[float, float, FloatArray, FloatArray] | None = None
        self.period_s = period_s

    @property
    def state_w(self) -> FloatArray:
        """The energy state q [W]."""
        return self._state

    def observe(self, time_s: float, motion_w: float | None) -> float:
        """Predict to `time_s`, and correct with the reading unless the gate holds; see `Estimator.observe`."""
        if self._time_s is None:
            if motion_w is not None and not self._known:
                self._state[0] = motion_w
        elif time_s > self._time_s:
            transition, noise = self._transition(time_s - self._time_s)
            self._state, self._covariance = predict(self._state, self._covariance, transition, noise)
        self._time_s = time_s
        expected = float(self._output @ self._state)
        if motion_w is not None and abs(motion_w - expected) > self._settings.gate_w:
            variance = self._settings.noise_w**2
            self._state, self._covariance = update(self._state, self._covariance, self._output, motion_w, variance)
        return expected

    def lap(self, time_s: float) -> None:
        """Take the lap's time as the period, the first one apart: it may have begun anywhere."""
        if self._laps and self._order:
            self.period_s = time_s - self._lap_started_s
        self._laps += 1
        self._lap_started_s = time_s

    def begin_lap(self, time_s: float) -> None:
        """Start a lap that follows no other."""
        self._laps = max(self._laps, 1)
        self._lap_started_s = time_s

    def forecast(self, ahead_s: FloatArray) -> FloatArray:
        """C e^{At} q; see `Estimator.forecast`."""
        if self.period_s is None:
            return np.full(len(ahead_s), self._state[0])
        return _forecast_w(self._state, self.period_s, ahead_s)

    def _transition(self, step_s: float) -> tuple[FloatArray, FloatArray]:
        period_s = self.period_s or 1.0
        if self._step is None or abs(step_s - self._step[0]) > 1e-9 or period_s != self._step[1]:
            s = self._settings
            drift = [s.level_drift_w_per_sqrt_s**2] + [s.harmonic_drift_w_per_sqrt_s**2] * (2 * self._order)
            self._step = (
                step_s,
                period_s,
                rotation_matrix(self._order, period_s, step_s),
                np.diag(drift) * step_s,
            )
        return self._step[2], self._step[3]


class PublishedEstimator:
    """The filter as the published flights ran it.

    All-ones covariances that are never carried forward, Euler's step I + AΔt, measurement noise 1, a state of ones at
    the start, and a period that grows with the running lap from 1 s on.

    Source: the published flights (docs/reproduction.md); kept for reproduction, not for use.
    """

    def __init__(self, settings: EstimatorSettings) -> None:
        self._order = settings.order
        self._state = [1.0] * (2 * settings.order + 1)
        self._clock = LapClock(1.0)
        self._time_s = 0.0
        self._gain_for = (0.0, 0.0)
        self._gain: list[float] = []
        self.period_s: float | None = 1.0

    @property
    def state_w(self) -> FloatArray:
        """The energy state q [W]."""
        return np.array(self._state)

    def observe(self, time_s: float, motion_w: float | None) -> float:
        """One step of the published filter; see `Estimator.observe`."""
        period_s = self.period_s = self._clock.tick(time_s)
        step_s = round(time_s - self._time_s, 9)
        self._time_s = time_s
        turn = 2 * math.pi / period_s * step_s
        old = self._state
        state = [old[0]]
        expected = old[0]
        for j in range(1, self._order + 1):
            a, b = old[2 * j - 1], old[2 * j]
            alpha = a + turn * j * b  # q⁺ = (I + AΔt) q
            state.append(alpha)
            state.append(b - turn * j * a)
            expected += alpha
        if motion_w is not None:
            if (period_s, step_s) != self._gain_for:
                self._gain_for = (period_s, step_s)
                self._gain = self._published_gain(turn)
            error = motion_w - expected
            state = [q + k * error for q, k in zip(state, self._gain, strict=True)]
        self._state = state
        return expected

    def _published_gain(self, turn: float) -> list[float]:
        # P⁻ = A 1 Aᵀ + 1 with 1 all ones: A·1 has every row's sum, so P⁻ = s sᵀ + 1
        sums = np.array([1.0] + [sign for j in range(1, self._order + 1) for sign in (1 + turn * j, 1 - turn * j)])
        output = output_row(self._order)
        shared = sums * (sums @ output) + output.sum()
        gain: list[float] = (shared / (output @ shared + 1.0)).tolist()
        return gain

    def lap(self, time_s: float) -> None:
        """Restart the clock."""
        self._clock.lap(time_s)

    def begin_lap(self, time_s: float) -> None:
        """Restart the clock without a lap's time."""
        self._clock.begin(time_s)

    def forecast(self, ahead_s: FloatArray) -> FloatArray:
        """Exact from the filter's state: Euler's step would grow the harmonics; see `Estimator.forecast`."""
        assert self.period_s is not None
        return _forecast_w(np.array(self._state), self.period_s, ahead_s)


def _forecast_w(state_w: FloatArray, period_s: float, ahead_s: FloatArray) -> FloatArray:
    """`eadp.core.harmonics.forecast_w`, for planners that ask for the same instants again and again."""
    power: FloatArray = state_w[0] + _waves(len(state_w) // 2, period_s, ahead_s.tobytes()) @ state_w[1:]
    return power


@lru_cache(maxsize=16)
def _waves(order: int, period_s: float, ahead: bytes) -> FloatArray:
    """Cosine and sine of each harmonic at instants ahead [s], given as bytes: what the state is multiplied by."""
    ahead_s = np.frombuffer(ahead)
    angle = 2 * math.pi / period_s * ahead_s[:, None] * np.arange(1, order + 1)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1).reshape(len(ahead_s), 2 * order)

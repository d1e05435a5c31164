"""The Kalman filter behind the exact estimator: a Fourier state and a disturbance, moved by the exact step.

The covariance does not depend on the values of the readings. Once the gain has converged (`SETTLED`), it is held for a
block of evenly spaced readings, and the covariance passes the block in one map (`eadp.core.signals.riccati`), which is
exact except that the gain is up to a block old. A drop-out, a gated reading, an irregular step or a new model is
processed step by step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.core.compiled import in_loops, jitted
from eadp.core.signals import forecasting
from eadp.core.signals.kalman import predict, product, update
from eadp.core.signals.riccati import MAPPING, applied, composed, step_map

BLOCK_DOUBLINGS = 4
BLOCK = 2**BLOCK_DOUBLINGS
"""Readings of a block: 1.6 s at the usual tenth of a second."""

SETTLED = 2e-4
"""Change of the correlation of any state with a reading, from one reading to the next, at which the gain is held."""

SAME_STEP_S = 1e-9
STEPPING = -1


@dataclass(frozen=True, slots=True, eq=False)
class EnergyDynamics:
    """State-space model of the motion power; units as in `eadp.core.signals.forecasting`."""

    order: int
    period_s: float
    drift_w2_per_s: FloatArray
    std_w: float
    time_s: float
    noise_w: float

    def transition(self, step_s: float) -> FloatArray:
        """e^{A Δt}."""
        return forecasting.step_matrix(self.order, self.period_s, self.time_s, step_s)

    def process_noise(self, step_s: float) -> FloatArray:
        """Q of a step."""
        return forecasting.step_noise(self.drift_w2_per_s, self.std_w, self.time_s, step_s)


class EnergyFilter:
    """State and covariance, step by step or in blocks.

    Source: letter, Alg. 2 l. 28-29; draft 002 l. 9-16; see `eadp.core.signals.kalman`.
    """

    def __init__(self, state: FloatArray, covariance: FloatArray, dynamics: EnergyDynamics) -> None:
        self.state = state
        self._covariance = covariance
        self._dynamics = dynamics
        self._output = forecasting.output(dynamics.order)
        self._step_s = 0.0
        self._transition = np.eye(len(state))
        self._noise = np.zeros_like(covariance)
        self._gain = np.zeros(len(state))
        self._maps: tuple[FloatArray, ...] = ()
        self._held = STEPPING
        self._blocks = jitted(_in_blocks, _held, _gain, applied, *MAPPING)

    @property
    def covariance(self) -> FloatArray:
        """P after every reading taken."""
        self._catch_up()
        return self._covariance

    @property
    def dynamics(self) -> EnergyDynamics:
        """The state-space model."""
        return self._dynamics

    @dynamics.setter
    def dynamics(self, dynamics: EnergyDynamics) -> None:
        """Switch to another model; the state keeps its meaning, so phases continue."""
        self._step_by_step()
        self._dynamics = dynamics
        self._step_s = 0.0

    def restart(self, state: FloatArray, covariance: FloatArray) -> None:
        """Replace state and covariance."""
        self._step_by_step()
        self.state, self._covariance = state, covariance

    def widen(self, factor: float) -> None:
        """Scale the covariance by a factor."""
        self._step_by_step()
        self._covariance = factor * self._covariance

    def expected_w(self) -> float:
        """The power now [W]."""
        return float(self._output @ self.state)

    def predict(self, step_s: float) -> None:
        """Predict over a step without a reading."""
        self._step_by_step()
        self._prepare(step_s)
        self.state, self._covariance = predict(self.state, self._covariance, self._transition, self._noise)

    def correct(self, measured_w: float) -> None:
        """Update with a reading."""
        self._step_by_step()
        variance = self._dynamics.noise_w**2
        self.state, self._covariance = jitted(update)(self.state, self._covariance, self._output, measured_w, variance)

    def follow(self, step_s: float, measured_w: float) -> float:
        """Predict over a step, update with a reading, and return its forecast [W]."""
        return float(self.follow_batch(0.0, [step_s], [measured_w])[0][0])

    def follow_batch(
        self, before_s: float, times_s: Sequence[float], measured_w: ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """`follow` readings at some times [s], the first after `before_s`.

        Returns
        -------
        forecasts_w, states : array, shapes (n,) and (n, m)
            Forecast of each reading [W], and the state after it.
        """
        steps, measured = np.diff(np.array([before_s, *times_s])), np.asarray(measured_w, dtype=float)
        n, count = 0, len(steps)
        forecasts_w, states = np.empty(count), np.empty((count, len(self.state)))
        while n < count:
            other = abs(steps[n] - self._step_s) >= SAME_STEP_S
            if other:
                self._step_by_step()
                self._prepare(float(steps[n]))
            irregular = np.flatnonzero(np.abs(steps[n:] - self._step_s) >= SAME_STEP_S)
            end = n + int(irregular[0]) if len(irregular) else count
            self._follow_evenly(measured[n:end], forecasts_w[n:end], states[n:end], settling=not other)
            n = end
        return forecasts_w, states

    def _follow_evenly(
        self, measured_w: FloatArray, forecasts_w: FloatArray, states: FloatArray, *, settling: bool
    ) -> None:
        """Take evenly spaced readings, the first of them as far from the one before it if `settling`."""
        n = 0
        while self._held == STEPPING and n < len(measured_w):
            forecasts_w[n] = self._take(float(measured_w[n]))
            states[n] = self.state
            n += 1
            before, self._gain = self._gain, self._gain_now()
            if (settling or n > 1) and self._change(before) < SETTLED:
                self._hold()
        if n < len(measured_w):
            moving = self.state, self._covariance, self._gain, self._held
            model = self._transition, self._output, self._dynamics.noise_w**2, self._maps[-1]
            self._covariance, self._gain, self._held = self._blocks(
                *moving, *model, measured_w[n:], forecasts_w[n:], states[n:]
            )
            self.state = states[-1].copy()

    def _take(self, measured_w: float) -> float:
        """Predict and correct with a reading; return its forecast [W]."""
        self.state, self._covariance = jitted(predict, product)(
            self.state, self._covariance, self._transition, self._noise
        )
        expected = self.expected_w()
        self.correct(measured_w)
        return expected

    def _prepare(self, step_s: float) -> None:
        if abs(step_s - self._step_s) >= SAME_STEP_S:
            self._step_s = step_s
            self._transition, self._noise = self._dynamics.transition(step_s), self._dynamics.process_noise(step_s)

    def _gain_now(self) -> FloatArray:
        return _gain(self._covariance, self._output, self._dynamics.noise_w**2)

    def _change(self, before: FloatArray) -> float:
        """Largest change of the correlation of a state with a reading."""
        std = np.sqrt(np.maximum(np.diagonal(self._covariance), 1e-18))
        return float(np.max(np.abs(self._gain - before) / std)) * self._dynamics.noise_w

    def _hold(self) -> None:
        """Hold the gain, and compose the maps of 1, 2, 4, … steps."""
        maps = [step_map(self._transition, self._noise, self._output, self._dynamics.noise_w**2)]
        for _ in range(BLOCK_DOUBLINGS):
            maps.append(jitted(composed, *MAPPING)(maps[-1], maps[-1]))
        self._maps, self._held = tuple(maps), 0

    def _catch_up(self) -> None:
        """Update the covariance for the readings that the state has already taken."""
        for k, powers in enumerate(self._maps):
            if self._held > 0 and self._held >> k & 1:
                self._covariance = jitted(applied, *MAPPING)(powers, self._covariance)
        self._held = min(self._held, 0)

    def _step_by_step(self) -> None:
        self._catch_up()
        self._held = STEPPING


def _in_blocks(
    state: FloatArray,
    covariance: FloatArray,
    gain: FloatArray,
    held: int,
    transition: FloatArray,
    output: FloatArray,
    variance: float,
    block: FloatArray,
    measured_w: FloatArray,
    forecasts_w: FloatArray,
    states: FloatArray,
) -> tuple[FloatArray, FloatArray, int]:
    """Take evenly spaced readings with the gain held, `block` the map of one, and fill in forecasts and states.

    `held` is how many readings of its block the covariance has still to pass; returns what else changes.
    """
    n, count = 0, len(measured_w)
    while n < count:
        end = min(count, n + BLOCK - held)
        _held(
            transition,
            output,
            gain,
            state if n == 0 else states[n - 1],
            measured_w[n:end],
            forecasts_w[n:end],
            states[n:end],
        )
        held, n = held + end - n, end
        if held == BLOCK:
            covariance, held = applied(block, covariance), 0
            gain = _gain(covariance, output, variance)
    return covariance, gain, held


def _gain_in_loops(covariance: FloatArray, output: FloatArray, variance: float) -> FloatArray:
    gain = np.zeros(len(output))
    for i in range(len(output)):
        for k in range(len(output)):
            gain[i] += covariance[i, k] * output[k]
        gain[i] /= variance
    return gain


@in_loops(_gain_in_loops)
def _gain(covariance: FloatArray, output: FloatArray, variance: float) -> FloatArray:
    # K = P⁻ Cᵀ S⁻¹ = P⁺ Cᵀ R⁻¹
    return covariance @ output / variance


def _held_in_loops(
    transition: FloatArray,
    output: FloatArray,
    gain: FloatArray,
    state: FloatArray,
    measured_w: FloatArray,
    forecasts_w: FloatArray,
    states: FloatArray,
) -> None:
    """`_held` for a transition of one number and blocks of two, which is what `EnergyDynamics` has."""
    before = state
    for n in range(len(measured_w)):
        now = states[n]
        now[0] = transition[0, 0] * before[0]
        expected = output[0] * now[0]
        for i in range(1, len(now), 2):
            a, b = before[i], before[i + 1]
            now[i] = transition[i, i] * a + transition[i, i + 1] * b
            now[i + 1] = transition[i + 1, i] * a + transition[i + 1, i + 1] * b
            expected += output[i] * now[i] + output[i + 1] * now[i + 1]
        error = measured_w[n] - expected
        for i in range(len(now)):
            now[i] += gain[i] * error
        forecasts_w[n], before = expected, now


@in_loops(_held_in_loops)
def _held(
    transition: FloatArray,
    output: FloatArray,
    gain: FloatArray,
    state: FloatArray,
    measured_w: FloatArray,
    forecasts_w: FloatArray,
    states: FloatArray,
) -> None:
    """Fill in the forecasts of readings with the gain held [W], and the states after them."""
    for n, value in enumerate(measured_w):
        state = transition @ state
        forecasts_w[n] = expected = np.dot(output, state)
        states[n] = state = state + gain * (value - expected)

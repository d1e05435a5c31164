"""The Kalman filter behind the exact estimator: a Fourier state and a disturbance, moved by the exact step.

The covariance does not depend on the values of the readings. Once the gain has converged (`SETTLED`), it is held for a
block of evenly spaced readings, and the covariance passes the block in one map (`eadp.core.signals.kalman`), which is
exact except that the gain is up to a block old. A drop-out, a gated reading, an irregular step or a new model is
processed step by step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.signals import forecasting
from eadp.core.signals.kalman import applied, composed, predict, step_map, update

BLOCK_DOUBLINGS = 4
BLOCK = 2**BLOCK_DOUBLINGS
"""Readings of a block: 1.6 s at the usual tenth of a second."""

SETTLED = 2e-4
"""Change of the correlation of any state with a reading, from one reading to the next, at which the gain is held."""

SAME_STEP_S = 1e-9
STEPPING = -1
"""In place of a number of steps: the gain is not held."""


@dataclass(frozen=True, slots=True, eq=False)
class EnergyDynamics:
    """State-space model of the motion power: harmonics of a period that drift, a disturbance, and a sensor's noise.

    Units are as in `eadp.core.signals.forecasting`.
    """

    order: int
    period_s: float
    drift_w2_per_s: FloatArray
    std_w: float
    time_s: float
    noise_w: float

    def transition(self, step_s: float) -> FloatArray:
        """e^{A Δt}, which moves the state over a step [s]."""
        return forecasting.step_matrix(self.order, self.period_s, self.time_s, step_s)

    def process_noise(self, step_s: float) -> FloatArray:
        """Q, the covariance that a step [s] adds."""
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
        # the last step [s], and what it does to state and covariance; the gain of the last correction
        self._step_s = 0.0
        self._transition = np.eye(len(state))
        self._noise = np.zeros_like(covariance)
        self._gain = np.zeros(len(state))
        self._maps: tuple[FloatArray, ...] = ()  # of the covariance over 1, 2, 4, … steps, while the gain is held
        # STEPPING, or by how many readings the covariance is behind the state, the gain held
        self._held = STEPPING

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

    def widen(self, factor: float) -> None:
        """Scale the covariance by a factor."""
        self._step_by_step()
        self._covariance = factor * self._covariance

    def follow(self, step_s: float, measured_w: float | None, gate_w: float = 0.0) -> float:
        """Predict over a step, update with a reading, and return its forecast [W].

        None is no reading, and one no farther than `gate_w` from its forecast corrects nothing. A step of 0 s is a
        second reading at one time.
        """
        # the gain is held where steps are even, readings come without a gate, and it has settled
        even = abs(step_s - self._step_s) < SAME_STEP_S
        if even and self._held != STEPPING and measured_w is not None:
            return self._follow_held(measured_w)
        self._step_by_step()
        if step_s > 0:
            if not even:
                self._step_s = step_s
                self._transition, self._noise = self._dynamics.transition(step_s), self._dynamics.process_noise(step_s)
            self.state, self._covariance = predict(self.state, self._covariance, self._transition, self._noise)
        expected = float(self._output @ self.state)
        # draft 002's ε: no update where |y − C q| ≤ ε
        if measured_w is None or (gate_w and abs(measured_w - expected) <= gate_w):
            return expected
        variance = self._dynamics.noise_w**2
        self.state, self._covariance = update(self.state, self._covariance, self._output, measured_w, variance)
        if step_s > 0 and not gate_w:
            before, self._gain = self._gain, self._gain_now()
            if even and self._gain_change(before) < SETTLED:
                self._hold()
        return expected

    def _follow_held(self, measured_w: float) -> float:
        """As `follow`, for a reading at the usual step while the gain is held; the covariance follows a block later."""
        state = self._transition.dot(self.state)
        expected = self._output.dot(state)
        self.state = state + self._gain * (measured_w - expected)
        self._held += 1
        if self._held == BLOCK:
            self._covariance, self._held = applied(self._maps[-1], self._covariance), 0
            self._gain = self._gain_now()
        return float(expected)

    def _gain_now(self) -> FloatArray:
        """The gain of the last correction, by the covariance after it."""
        # K = P⁻ Cᵀ S⁻¹ = P⁺ Cᵀ R⁻¹
        return self._covariance @ self._output / self._dynamics.noise_w**2

    def _gain_change(self, before: FloatArray) -> float:
        """Largest change of the correlation of a state with a reading, from the gain before."""
        # |K_i − K_i⁻| √R / √P_ii
        std = np.sqrt(np.maximum(np.diagonal(self._covariance), 1e-18))
        return float(np.max(np.abs(self._gain - before) / std)) * self._dynamics.noise_w

    def _hold(self) -> None:
        """Hold the gain, and compose the maps of 1, 2, 4, … steps."""
        maps = [step_map(self._transition, self._noise, self._output, self._dynamics.noise_w**2)]
        for _ in range(BLOCK_DOUBLINGS):
            maps.append(composed(maps[-1], maps[-1]))
        self._maps, self._held = tuple(maps), 0

    def _catch_up(self) -> None:
        """Update the covariance for the readings that the state has taken since the covariance was updated last."""
        # map k is of 2ᵏ steps: those of the number's binary digits are applied
        for k, covariance_map in enumerate(self._maps):
            if self._held > 0 and self._held >> k & 1:
                self._covariance = applied(covariance_map, self._covariance)
        self._held = min(self._held, 0)  # STEPPING stays

    def _step_by_step(self) -> None:
        """Go back from a gain that is held to one that each step computes."""
        self._catch_up()
        self._held = STEPPING

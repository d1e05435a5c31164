"""Simulated sensors: noise, delay and drop-outs between the true state and what is measured."""

from __future__ import annotations

import numpy as np

from eadp.models.sensors import Sensors

BATCH = 2000
"""Steps for which noise is drawn at once."""
OF_POWER, OF_X, OF_Y, OF_SOC = CHANNELS = range(4)
"""Channels of noise."""

NEVER_STEPS = 1 << 62
"""A duration that no flight reaches, in steps."""


class SensorSuite:
    """The sensors of one flight. The measurement of a step does not depend on which other steps are measured.

    Drop-outs are a Markov chain of two states. The durations of both are geometric: `drop_out_s` on average without a
    reading, and with one the duration that gives the share of drop-outs.

    Steps are measured in order, from 1 on; the last one may be measured again. `_noise` holds the batch of steps that
    ends with step `_noise_ends`; the present state, in a drop-out or not, ends with step `_state_ends`.
    """

    def __init__(self, sensors: Sensors, step_s: float, rng: np.random.Generator) -> None:
        self._sensors = sensors
        self._rng, self._durations = rng.spawn(2)
        self.late = round(sensors.delay_s / step_s)
        """The delay in steps."""
        self._noise: list[list[float]] = []
        self._noise_ends = 0
        share = sensors.drop_out_share
        # the chance that a drop-out ends at a step, and, of `_fail`, that one starts
        self._recover = min(1.0, step_s / sensors.drop_out_s) if share < 1 else 0.0
        # in balance: share · recover = (1 − share) · fail
        self._fail = min(1.0, self._recover * share / (1 - share)) if share < 1 else 1.0
        self._out = float(self._durations.random()) < share  # whether it starts in a drop-out
        self._state_ends = self._duration()

    def power_w(self, step: int, power_w: float) -> float | None:
        """A measured power [W]; None in a drop-out. Advances the drop-outs to the step."""
        sensors = self._sensors
        if sensors.drop_out_share:
            while step > self._state_ends:
                self._out = not self._out
                self._state_ends += self._duration()
            if self._out:
                return None
        return power_w + sensors.power_noise_w * self._row(step)[OF_POWER] if sensors.power_noise_w else power_w

    def soc(self, step: int, soc: float) -> float:
        """A measured state of charge."""
        noise = self._sensors.soc_noise
        return min(1.0, max(0.0, soc + noise * self._row(step)[OF_SOC])) if noise else soc

    def position_m(self, step: int, x_m: float, y_m: float) -> tuple[float, float]:
        """A measured position [m]."""
        std_m = self._sensors.position_noise_m
        if not std_m:
            return x_m, y_m
        row = self._row(step)
        return x_m + std_m * row[OF_X], y_m + std_m * row[OF_Y]

    def measured(
        self, step: int, x_m: float, y_m: float, power_w: float, soc: float
    ) -> tuple[tuple[float, float], float | None, float]:
        """Position [m], power [W], None in a drop-out, and state of charge, as measured at a step."""
        return self.position_m(step, x_m, y_m), self.power_w(step, power_w), self.soc(step, soc)

    def _row(self, step: int) -> list[float]:
        """Standard normal numbers of a step, one for each channel."""
        while step > self._noise_ends:
            self._noise = self._rng.standard_normal((BATCH, len(CHANNELS))).tolist()
            self._noise_ends += BATCH
        return self._noise[step - self._noise_ends - 1]  # from the end: the last row is that of step `_noise_ends`

    def _duration(self) -> int:
        """Draw the duration of the present state, in steps."""
        chance = self._recover if self._out else self._fail
        return int(self._durations.geometric(chance)) if chance > 0 else NEVER_STEPS

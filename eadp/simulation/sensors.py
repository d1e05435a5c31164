"""From what happens to what a planner is told: sensors with noise, delay and drop-outs."""

from __future__ import annotations

import numpy as np

from eadp.models.sensors import Sensors
from eadp.planning.base import Observation

BATCH = 2000
CHANNELS = 4
"""Noise of each step: of power, x, y and charge."""

FOREVER = 1 << 62


class SensorSuite:
    """The sensors of one flight. What they tell of a step does not depend on which others they are asked of.

    Drop-outs are a chain of two states that is left with a fixed probability at each step, so that spells of both are
    geometric: of `drop_out_s` on average without a reading, and as long as makes the share right with one.

    Steps are asked of in order, from 1 on; one may be asked of again.
    """

    def __init__(self, sensors: Sensors, step_s: float, rng: np.random.Generator) -> None:
        self._sensors = sensors
        self._rng, self._spells = rng.spawn(2)
        self.late = round(sensors.delay_s / step_s)
        """How many steps old what is told is."""
        self._noisy = bool(sensors.power_noise_w or sensors.position_noise_m or sensors.soc_noise)
        self._noise: list[list[float]] = []
        self._noise_ends = 0
        share = sensors.drop_out_share
        self._recover = min(1.0, step_s / sensors.drop_out_s) if share < 1 else 0.0
        # in balance: share · recover = (1 − share) · fail
        self._fail = min(1.0, self._recover * share / (1 - share)) if share < 1 else 1.0
        self._out = float(self._spells.random()) < share
        self._spell_ends = self._spell()

    def power_w(self, step: int, power_w: float) -> float | None:
        """What is told of a power [W]; None in a drop-out."""
        sensors = self._sensors
        if sensors.drop_out_share:
            while step > self._spell_ends:
                self._out = not self._out
                self._spell_ends += self._spell()
            if self._out:
                return None
        return power_w + sensors.power_noise_w * self._row(step)[0] if sensors.power_noise_w else power_w

    def soc(self, step: int, soc: float) -> float:
        """What is told of a state of charge."""
        noise = self._sensors.soc_noise
        return min(1.0, max(0.0, soc + noise * self._row(step)[3])) if noise else soc

    def place_m(self, step: int, x_m: float, y_m: float) -> tuple[float, float]:
        """What is told of a position [m]."""
        spread_m = self._sensors.position_noise_m
        if not spread_m:
            return x_m, y_m
        _, of_x, of_y, _ = self._row(step)
        return x_m + spread_m * of_x, y_m + spread_m * of_y

    def observe(self, step: int, truth: Observation) -> Observation:
        """What is told of an observation that is true but for being late."""
        assert truth.power_w is not None
        x, y = self.place_m(step, truth.x_m, truth.y_m)
        return truth._replace(x_m=x, y_m=y, power_w=self.power_w(step, truth.power_w), soc=self.soc(step, truth.soc))

    def _row(self, step: int) -> list[float]:
        """Standard normal numbers of a step."""
        while step > self._noise_ends:
            self._noise = self._rng.standard_normal((BATCH, CHANNELS)).tolist()
            self._noise_ends += BATCH
        return self._noise[step - self._noise_ends - 1]

    def _spell(self) -> int:
        """Steps of a spell in the present state."""
        chance = self._recover if self._out else self._fail
        return int(self._spells.geometric(chance)) if chance > 0 else FOREVER

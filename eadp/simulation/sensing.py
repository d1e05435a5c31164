"""From what happens to what a planner is told: sensors with noise, delay and drop-outs."""

from __future__ import annotations

from collections import deque

import numpy as np

from eadp.models.sensors import Sensors
from eadp.planning.planners import Observation

BATCH = 2000


class SensorSuite:
    """The sensors of one flight, read at every step.

    Drop-outs are a chain of two states that is left with a fixed probability at each step, so that spells of both are
    geometric: of `drop_out_s` on average without a reading, and as long as makes the share right with one.
    """

    def __init__(self, sensors: Sensors, step_s: float, rng: np.random.Generator) -> None:
        self._sensors = sensors
        self._rng = rng
        self._noise: list[float] = []
        self._chances: list[float] = []
        self._late: deque[Observation] = deque()
        self._delay_steps = round(sensors.delay_s / step_s)
        share = sensors.drop_out_share
        self._recover = min(1.0, step_s / sensors.drop_out_s) if share < 1 else 0.0
        # in balance: share · recover = (1 − share) · fail
        self._fail = min(1.0, self._recover * share / (1 - share)) if share < 1 else 1.0
        self._out = float(rng.random()) < share

    def observe(self, truth: Observation) -> Observation:
        """What is told at the moment of a true observation; before the delay is over, the first one."""
        sensors = self._sensors
        if self._delay_steps:
            self._late.append(truth)
            old = self._late.popleft() if len(self._late) > self._delay_steps else self._late[0]
            # what the planner itself keeps count of is not late: the time, the stage and the parameters in force
            truth = truth._replace(
                x_m=old.x_m,
                y_m=old.y_m,
                power_w=old.power_w,
                soc=old.soc,
                velocity_mps=old.velocity_mps,
                heading_rad=old.heading_rad,
            )
        power = truth.power_w
        if sensors.drop_out_share:
            self._out = self._chance() >= self._recover if self._out else self._chance() < self._fail
            if self._out:
                power = None
        if power is not None and sensors.power_noise_w:
            power += sensors.power_noise_w * self._normal()
        x, y, soc = truth.x_m, truth.y_m, truth.soc
        if sensors.position_noise_m:
            x += sensors.position_noise_m * self._normal()
            y += sensors.position_noise_m * self._normal()
        if sensors.soc_noise:
            soc = min(1.0, max(0.0, soc + sensors.soc_noise * self._normal()))
        return truth._replace(x_m=x, y_m=y, power_w=power, soc=soc)

    def _normal(self) -> float:
        if not self._noise:
            self._noise = self._rng.standard_normal(BATCH).tolist()
        return self._noise.pop()

    def _chance(self) -> float:
        if not self._chances:
            self._chances = self._rng.random(BATCH).tolist()
        return self._chances.pop()

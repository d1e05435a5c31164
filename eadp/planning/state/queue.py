"""The queue of what a flight has read, until the filters of its state are asked."""

from __future__ import annotations

import math
from typing import NamedTuple

from eadp.planning.base import Observation, Readings

SAME_TIME_S = 1e-9


class Seen(NamedTuple):
    """An observation that a state has taken.

    `stages_before` is how many stages had started before it; `is_reading` whether it is a reading, too; `computing_w`
    the power of the computations in force [W].
    """

    observation: Observation
    stages_before: int
    is_reading: bool
    computing_w: float


class ReadingQueue:
    """Takes readings and observations, and counts stages at once.

    Parameters
    ----------
    every_s : float
        Least time between readings [s]: an observation sooner after one is none.

    Attributes
    ----------
    now : Observation
        The last observation; there is none before the first.
    next_reading_s : float
        From when the next reading may be taken [s].
    """

    now: Observation

    def __init__(self, every_s: float) -> None:
        self.every_s, self.next_reading_s = every_s, -math.inf
        self.stages_started = 1
        self._waiting: list[Readings | Seen] = []

    def ingest(self, readings: Readings) -> None:
        """Take a batch of readings; they wait."""
        self._waiting.append(readings)
        self.next_reading_s = float(readings.times_s[-1]) + self.every_s

    def observe(self, o: Observation, computing_w: float) -> Seen:
        """Take an observation, beside the power of the computations [W]: its stage is counted, the rest of it waits."""
        seen = Seen(o, self.stages_started, o.time_s >= self.next_reading_s - SAME_TIME_S, computing_w)
        self._waiting.append(seen)
        self.stages_started = o.stages_started
        if seen.is_reading:
            self.next_reading_s = o.time_s + self.every_s
        self.now = o
        return seen

    def take(self) -> list[Readings | Seen]:
        """What waits, in order; it does no more."""
        waiting, self._waiting = self._waiting, []
        return waiting

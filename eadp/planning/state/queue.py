"""The queue of what a flight has read: the filters and the estimator each take it when they are asked.

Each has its own position in the one list of what waits; what both have taken is dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from eadp.planning.base import Observation, Readings
from eadp.planning.state.power import Powers, PowerTracker

MAX_WAITING = 10_000
"""Most batches of readings and observations that wait for the estimator."""

SAME_TIME_S = 1e-9


class Batch(NamedTuple):
    """Readings that wait, and what the estimator takes of them."""

    readings: Readings
    powers: Powers


class Seen(NamedTuple):
    """An observation that waits.

    `stages_before` is how many stages had started before it; `is_reading` whether it is a reading, too; `powers` what
    the estimator takes of it.
    """

    observation: Observation
    stages_before: int
    is_reading: bool
    powers: Powers


class LevelStep(NamedTuple):
    """A known change of the motion's power that waits [W]."""

    by_w: float


class ReadingQueue:
    """Takes readings and observations, and counts stages and laps at once.

    Parameters
    ----------
    power : PowerTracker
        Counts laps, and takes what waits.
    every_s : float
        Least time between readings [s]: an observation sooner after one is none.

    Attributes
    ----------
    now : Observation
        The last observation; there is none before the first.
    soc_before : float or None
        The gauge's reading before it; None where it is the first.
    next_reading_s : float
        From when the next reading may be taken [s].
    """

    now: Observation

    def __init__(self, power: PowerTracker, every_s: float) -> None:
        self.every_s, self.next_reading_s = every_s, -math.inf
        self.stages_started = 1
        self.soc_before: float | None = None
        self._soc: float | None = None
        self._power = power
        self._waiting: list[Batch | Seen | LevelStep] = []
        # how many of what waits the filters, and the estimator, have taken
        self._filtered = self._estimated = 0
        # the readings that the estimator has taken in part, and how many of them
        self._begun: Powers | None = None
        self._within = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def full(self) -> bool:
        """Whether the estimator is to take what waits before more comes."""
        return len(self._waiting) - self._estimated >= MAX_WAITING

    def ingest(self, readings: Readings) -> None:
        """Take a batch of readings; they wait."""
        self._waiting.append(Batch(readings, Powers(readings.times_s, readings.powers_w, self._power.computing_w)))
        self.next_reading_s = float(readings.times_s[-1]) + self.every_s
        self._soc = float(readings.charges[-1])

    def observe(self, o: Observation) -> None:
        """Take an observation: its stage and lap are counted at once, the rest of it waits."""
        before, self.stages_started = self.stages_started, o.stages_started
        is_reading = o.time_s >= self.next_reading_s - SAME_TIME_S
        lap = self._power.locate(o, entered=o.stages_started != before)
        # a take-off has a power of its own, which the estimator does not learn
        times_s, powers_w = ([o.time_s], [o.sample.power_w if o.on_plan else None]) if is_reading else ([], [])
        powers = Powers(times_s, powers_w, self._power.computing_w, lap, o.time_s)
        self._waiting.append(Seen(o, before, is_reading, powers))
        if is_reading:
            self.next_reading_s = o.time_s + self.every_s
        self.now, self.soc_before, self._soc = o, self._soc, o.soc

    def step_level(self, by_w: float) -> None:
        """Take a known change of the motion's power [W]; it waits in its order, for the estimator alone."""
        self._waiting.append(LevelStep(by_w))

    def take_unfiltered(self) -> Iterator[Batch | Seen]:
        """Return what the filters have not taken yet, in order, and count it as taken by them."""
        new, self._filtered = self._waiting[self._filtered :], len(self._waiting)
        self._drop_taken()
        return (each for each in new if not isinstance(each, LevelStep))

    def estimate(self, until_s: float = math.inf) -> None:
        """Pass what waits to the estimator of the power, in order, up to a time [s], be it within a batch."""
        while self._estimated < len(self._waiting):
            each = self._waiting[self._estimated]
            if isinstance(each, LevelStep):
                self._power.estimator.shift_level(each.by_w)
            else:
                if self._begun is None:
                    self._begun, self._within = self._power.begin(each.powers), 0
                self._within = self._power.observe(self._begun, self._within, until_s)
                if self._within < len(self._begun.times_s):
                    break  # the rest of its readings is later
                self._begun = None
            self._estimated += 1
        self._drop_taken()

    def _drop_taken(self) -> None:
        """Drop what the filters and the estimator have both taken."""
        taken = min(self._filtered, self._estimated)
        if taken:
            del self._waiting[:taken]
            self._filtered, self._estimated = self._filtered - taken, self._estimated - taken

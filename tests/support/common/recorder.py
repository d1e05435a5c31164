"""A planner that is watched."""

from __future__ import annotations


class Recorder:
    """Passes everything on to a planner, and keeps what it is shown and what it decides.

    `every_step`: it is shown every step, not only those that the planner wants to see.
    """

    takes_arrays = False

    def __init__(self, planner, *, every_step=False):
        self._planner, self._every_step = planner, every_step
        self.report = planner.report
        self.seen, self.decided = [], []

    @property
    def period_s(self):
        return self._planner.period_s

    @property
    def reading_every_s(self):
        return self._planner.reading_every_s

    @property
    def next_update_s(self):
        return 0.0 if self._every_step else self._planner.next_update_s

    def flight_state(self):
        return self._planner.flight_state()

    def hold(self, held):
        self._planner.hold(held)

    def ingest(self, readings):
        return self._planner.ingest(readings)

    def estimates(self, times_s):
        return self._planner.estimates(times_s)

    def update(self, observation):
        decision = self._planner.update(observation)
        self.seen.append(observation)
        self.decided.append(decision)
        return decision

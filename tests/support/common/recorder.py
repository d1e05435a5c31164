"""A planner that is watched."""


class Recorder:
    """Passes everything on to a planner, and keeps what it is shown and what it decides.

    `every_step`: it is shown every step, not only those that the planner wants to see.
    """

    def __init__(self, planner, *, every_step=False):
        self._planner, self._every_step = planner, every_step
        self.report = planner.report
        self.seen, self.decided = [], []

    @property
    def next_update_s(self):
        return 0.0 if self._every_step else self._planner.next_update_s

    def hold(self, held):
        self._planner.hold(held)

    def update(self, state):
        decision = self._planner.update(state)
        self.seen.append(state.now)
        self.decided.append(decision)
        return decision


def watched(inputs, make=Recorder, **keys):
    """A flight whose planner is watched."""
    flight = inputs.flight()
    flight.planner = make(flight.planner, **keys)
    return flight

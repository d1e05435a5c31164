"""A planner of another package: computations fall as the charge does, and the path stays."""

from dataclasses import dataclass

from eadp.extend import Decision, Planner


@dataclass(frozen=True)
class ThriftSettings:
    """Section `planner.thrift` of a scenario."""

    full_soc: float = 1.0
    """Charge down to which the computations are at their maxima."""


class ThriftPlanner(Planner):
    """Has each computation at the share of its range that the charge has of `full_soc`."""

    own_settings = ThriftSettings
    next_update_s = 0.0

    def update(self, state):
        """Decide at `state.now`, the last observation, each `every_s` of the settings."""
        now, path = state.now, self.mission.plan.path_count
        if now.time_s >= self.next_update_s:
            self.next_update_s = now.time_s + self.settings.every_s
            share = min(1.0, now.soc / self.own.full_soc)
            computations = [box.lo + share * (box.hi - box.lo) for box in now.cursor.stage.sets[path:]]
            self._decision = Decision((*now.parameters[:path], *computations), f"computations at {share:.0%}")
        return self._decision

"""Power of the plan's computations: its parameters joined with a measured profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from eadp.errors import EadpError, Infeasible
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box
from eadp.models.profile import Profile


@dataclass(frozen=True)
class Computing:
    """Power of the computations at the parameters of a plan.

    `profile` may be None where no computation can run. `order` gives, for each column of the profile, which of the
    plan's computations it is. Where some may run, one that may not is at 0, which must have been measured. `load_w` is
    a constant load [W], of computations that the plan does not decide.
    """

    path_count: int
    profile: Profile | None
    order: tuple[int, ...] = ()
    load_w: float = 0.0

    def power_w(self, parameters: Sequence[float], sets: Sequence[Box]) -> float:
        """Power [W] at parameters c1, c2, … within a stage's sets; `load_w` if no computation may run.

        Raises
        ------
        Infeasible
            If the configuration lies outside what was measured.
        """
        values = parameters[self.path_count :]
        if not values or self.profile is None or all(box.inhibited for box in sets[self.path_count :]):
            return self.load_w
        return self.load_w + self.profile.power_w_at([values[i] for i in self.order])

    def min_power_w(self, plan: Plan) -> float:
        """Least power [W] on any stage, but on those where no computation may run, unless that is all of them."""
        rho = self.path_count
        running = [stage.sets for stage in plan.stages if not all(box.inhibited for box in stage.sets[rho:])]
        return min(self.power_w([box.lo for box in sets], sets) for sets in running or [plan.stages[0].sets])

    def levels(self, index: int, box: Box, *, measured: bool = False) -> tuple[float, ...]:
        """The values that computation `index` (from 0) may take within a set, lowest first; see `Profile.levels`."""
        if box.fixed or self.profile is None:
            return (box.lo,)
        return self.profile.levels(self.order.index(index), box.lo, box.hi, measured=measured)


def may_compute(plan: Plan) -> bool:
    """Whether a plan has computations that may run on any of its stages."""
    return any(not box.inhibited for stage in plan.stages for box in stage.sets[plan.path_count :])


def load_configuration(profile: Profile) -> tuple[float, ...]:
    """Configuration of a constant load: the highest values, or the nearest inside."""
    return profile.interpolant.nearest(profile.interpolant.upper)


def join_profile(plan: Plan, profile: Profile | None) -> Computing:
    """Join a plan and a profile by the names of the computations, or in order if the plan has no names.

    Beside a plan without computations that may run, the profile is a constant load, at its highest configuration.

    Raises
    ------
    EadpError
        If they disagree in number, names or units, or a set leaves what was measured.
    """
    rho = plan.path_count
    computations = plan.parameters[rho:]
    running = may_compute(plan)
    if profile is None:
        if running:
            raise EadpError("the plan has computations that may run, and there is no profile of their power")
        return Computing(rho, None)
    if not running:
        # what the profile measures runs all the same, and the plan does not decide it
        return Computing(rho, None, load_w=profile.power_w_at(load_configuration(profile)))
    measures = ", ".join(profile.names)
    if len(profile.names) != len(computations):
        numbers = f"the plan has {len(computations)} computations, the profile measures {len(profile.names)}"
        raise EadpError(f"{numbers}: {measures}")
    titles = [parameter.title for parameter in computations]
    order = tuple(range(len(titles)))
    if all(titles):
        if sorted(titles) != sorted(profile.names):
            raise EadpError(f"the plan's computations are {', '.join(titles)}, the profile's {measures}")
        order = tuple(titles.index(name) for name in profile.names)
    for column, i in enumerate(order):
        unit, measured = computations[i].unit, profile.units[column]
        if unit and measured and unit != measured:
            raise EadpError(f"{profile.names[column]} is in {unit} in the plan and in {measured} in the profile")
    computing = Computing(rho, profile, order)
    for stage in plan.stages:
        try:
            computing.power_w([box.lo for box in stage.sets], stage.sets)
            computing.power_w([box.hi for box in stage.sets], stage.sets)
        except Infeasible as error:
            raise EadpError(f"stage {stage.index}: {error}") from None
    return computing

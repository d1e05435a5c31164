"""Vocabulary of planning: missions, observations, decisions, settings.

A planner maps what is known of a flight to a Decision. It knows the plan, the models and its settings, and nothing of
the simulated world, so that the same object serves a simulation and a telemetry stream.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

from annotated_types import Ge, Le, Len

from eadp.core.arrays import FloatArray, NotNegative, Reserve
from eadp.core.geometry.curves import Point
from eadp.models.autopilot import Autopilot
from eadp.models.battery import LIMITS
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box
from eadp.models.world import Mission
from eadp.plug_ins import plug_in

Levels = Annotated[tuple[NotNegative, ...], Len(1, 1000)]


class Mode(NamedTuple):
    """What flies an aircraft.

    Attributes
    ----------
    flies_mission : bool or None
        Whether an autopilot flies a mission laid out before, so that its end is certain; False where it holds, returns,
        or a pilot flies, None where that is not known.
    returns_home : bool
        Whether it flies home.
    autopilot : Autopilot or None
        The autopilot and its parameters, where they are read anew.
    """

    flies_mission: bool | None = None
    returns_home: bool = False
    autopilot: Autopilot | None = None


class Sample(NamedTuple):
    """One sample of telemetry; None where a quantity is not measured.

    Attributes
    ----------
    time_s : float
        Time of any clock that rises [s].
    position_m : (float, float) or None
        Position in the local frame [m].
    power_w : float or None
        Measured power of motion and computations [W].
    soc : float or None
        State of charge, 0 to 1.
    stage : int or None
        Stage being flown, from 1 within the plan's stages; None if the autopilot does not report it.
    wind_mps, velocity_mps : (float, float) or None
        Vector that the wind blows towards, and ground velocity [m/s].
    heading_rad : float or None
        Heading of the nose, 0 east, counter-clockwise [rad].
    parameters : mapping of name to value
        Reported to be in force; not a number where a value is on its way to the aircraft.
    stages_started : int or None
        Stages started over the whole flight, the first included.
    warnings : tuple of str
        Codes of what is wrong with it.
    airspeed_mps : float or None
        Airspeed [m/s].
    altitude_m : float or None
        Altitude above the place of take-off [m].
    voltage_v : float or None
        The battery's voltage [V].
    mode : Mode
        What flies the aircraft.
    """

    time_s: float
    position_m: Point | None
    power_w: float | None
    soc: float | None
    stage: int | None = None
    wind_mps: Point | None = None
    velocity_mps: Point | None = None
    heading_rad: float | None = None
    parameters: Mapping[str, float] = {}
    stages_started: int | None = None
    warnings: tuple[str, ...] = ()
    airspeed_mps: float | None = None
    altitude_m: float | None = None
    voltage_v: float | None = None
    mode: Mode = Mode()

    @property
    def reading(self) -> tuple[object, ...]:
        """What is read in flight, by which one is known again: its time, position, power and charge."""
        return self.time_s, self.position_m, self.power_w, self.soc

    @property
    def course_rad(self) -> float | None:
        """Direction of the ground velocity, 0 east, counter-clockwise [rad]."""
        return None if self.velocity_mps is None else math.atan2(self.velocity_mps[1], self.velocity_mps[0])


class Observation(NamedTuple):
    """A sample, and the position in the plan at its time.

    Attributes
    ----------
    sample : Sample
        Its position is known.
    soc : float
        State of charge: the sample's, or as estimated since the last one that had it.
    cursor : PlanCursor
        The stage being flown and the parameters in force.
    joined_m : (float, float)
        Point at which the stage was joined [m].
    stages_started : int
        Over the whole flight, the first included.
    through_gap : bool
        Whether the start of the stage, or the end of the one before, may be unknown: neither is to be learned from.
    on_plan : bool
        Whether the aircraft flies the plan: it does not take off any more, no pilot flies it, and it does not return.
    returns_home : bool
        Whether it flies home, and its plan no longer.
    rejoins_at_start : bool or None
        Whether a plan that is taken up again is joined at the start of the leg that was left, and not flown straight to
        its end; None where the aircraft is on its path.
    """

    sample: Sample
    soc: float
    cursor: PlanCursor
    joined_m: Point
    stages_started: int
    through_gap: bool = False
    on_plan: bool = True
    returns_home: bool = False
    rejoins_at_start: bool | None = None

    @property
    def time_s(self) -> float:
        """Time of the sample [s]."""
        return self.sample.time_s

    @property
    def position_m(self) -> Point:
        """Position [m]."""
        assert self.sample.position_m is not None
        return self.sample.position_m

    @property
    def stage(self) -> int:
        """Index of the stage being flown, from 1 within the plan's stages."""
        return self.cursor.stage.index

    @property
    def parameters(self) -> Vector:
        """Parameters in force."""
        return self.cursor.parameters


class Readings(NamedTuple):
    """A batch of one or more consecutive sensor readings: power, charge, ground velocity, heading, airspeed.

    Quantities are as in `Sample`, each an array of shape (n,), NaN where they are not measured.
    """

    times_s: FloatArray
    powers_w: FloatArray
    charges: FloatArray
    vx_mps: FloatArray
    vy_mps: FloatArray
    headings_rad: FloatArray
    airspeeds_mps: FloatArray


class Decision(NamedTuple):
    """The parameters to fly with, and the reason.

    `record` describes the last re-planning, a new object for each; None from planners without records. `returns_home`
    is whether to give the plan up and fly home. `airspeeds_mps` are to be held on each stage that has none of its own
    [m/s]; empty for that of cruise.
    """

    parameters: Vector
    reason: str = ""
    record: DecisionRecord | None = None
    returns_home: bool = False
    airspeeds_mps: Vector = ()


class Ending(NamedTuple):
    """Forecast of the end of the plan; None where it is unknown.

    Attributes
    ----------
    remaining_s, remaining_std_s : float or None
        Time to it, and its standard deviation [s].
    energy_wh, energy_std_wh : float or None
        Energy to it, and its standard deviation [Wh].
    soc_end, soc_end_std : float or None
        State of charge, negative by the shortfall of charge; and its standard deviation.
    completes_probability, reserve_probability : float or None
        Probabilities that the battery is not empty before, and that the reserve is kept.
    quality_forecast : float or None
        U of the whole flight, the flown part included.
    """

    remaining_s: float | None = None
    remaining_std_s: float | None = None
    energy_wh: float | None = None
    energy_std_wh: float | None = None
    soc_end: float | None = None
    soc_end_std: float | None = None
    completes_probability: float | None = None
    reserve_probability: float | None = None
    quality_forecast: float | None = None

    @property
    def finite(self) -> Ending:
        """The same; numbers that are not finite are unknown."""
        return Ending(*[value if value is not None and math.isfinite(value) else None for value in self])


class HomeRecord(NamedTuple):
    """The way home, as known at a re-planning.

    Attributes
    ----------
    home_reachable : bool or None
        Whether home can be reached from here with the reserve kept, with its probability; None without a home.
    point_of_no_return_s : float or None
        Last time at which it could be reached [s], if it cannot; in a live flight, else, up to when it can as planned.
    home_by_s : float or None
        When home is reached at the latest, from there or at the plan's end [s]; of a live flight.
    """

    home_reachable: bool | None = None
    point_of_no_return_s: float | None = None
    home_by_s: float | None = None


class DecisionRecord(NamedTuple):
    """One re-planning, as `decisions.jsonl` holds it.

    Attributes
    ----------
    time_s : float
    cause : str
        Cause of the re-planning.
    stage, lap : int
        Position in the plan, from 1 and from 0.
    parameters : tuple of float
        Parameters decided.
    status : str
        `solved` by OSQP, `kept` because proven to be optimal still, `fallback` after failed runs, `closed form` where
        that was better, `infeasible`, or `nothing to choose`.
    calls : int
        Runs of OSQP.
    gap : float or None
        Relative distance of the solution to a bound that no solution exceeds; for `joint`, in units of U.
    reason : str
        The decision and its reason, in words.
    battery_limit : str or None
        Limit of the battery's power that binds: `letter`, `current`, `cut-off voltage` or `deliverable power`.
    ending : Ending
        Forecast of the end with them; its quantities are keys of the line.
    wind_mps : (float, float) or None
        Estimated wind [m/s].
    home : HomeRecord
        The way home; its quantities are keys of the line.
    airspeed_mps : float or None
        Airspeed decided for this stage [m/s]; None where it is not.
    """

    time_s: float
    cause: str
    stage: int
    lap: int
    parameters: Vector
    status: str
    calls: int
    gap: float | None
    reason: str
    battery_limit: str | None = None
    ending: Ending = Ending()
    wind_mps: Point | None = None
    home: HomeRecord = HomeRecord()
    airspeed_mps: float | None = None


TURNS_BACK = "home: "
"""Beginning of the reason of the decision to fly home."""


def with_limit(reason: str, battery_limit: str | None) -> str:
    """A decision's reason, and the limit of the battery that binds."""
    return reason if battery_limit is None else f"{reason}; {LIMITS[battery_limit]} binds"


@dataclass(frozen=True)
class TradeOff:
    """One row R c − r ≥ 0 that the parameters keep to."""

    coefficients: Mapping[str, float]
    """R: coefficients by the parameters' names."""

    at_least: float
    """r: the minimum of the weighted sum."""

    stages: tuple[Annotated[int, Ge(1)], ...] = ()
    """Stages in which it holds; by default in all."""

    def holds_in(self, stage: int) -> bool:
        """Whether it holds in a stage, from 1."""
        return not self.stages or stage in self.stages


@dataclass(frozen=True)
class SharedSettings:
    """The planner and its settings; sections of planners that do not fly are checked and unused."""

    name: str = ""
    """Name of the planner in the registry."""

    every_s: Annotated[float, Ge(1e-3), Le(1e6)] = 1.0
    """Time between re-plannings [s]."""

    weights: Mapping[str, NotNegative] = field(default_factory=dict)
    """Weight of each parameter in the quality U, by name; equal if none is given."""

    levels: Mapping[str, Levels] = field(default_factory=dict)
    """Values that a computation may take, by name; by default those of the profile."""


@dataclass(frozen=True)
class PlannerSettings(SharedSettings):
    """Settings that a planner is made of."""

    reserve_soc: Reserve = 0.05
    """State of charge to keep at the end of the flight, as a share of the full charge."""

    own: Any = None
    """The planner's own settings; None where it has none."""

    estimator: Any = field(default_factory=lambda: plug_in("estimators", "power").own_settings())
    """Settings of the estimator of the power."""


TIME, NEW_STAGE, JUMPED = "time", "new stage", "the charge has jumped"
"""Causes of a re-planning."""

SOLVED, KEPT, FALLBACK, CLOSED_FORM = "solved", "kept", "fallback", "closed form"
SHORT, TOO_WINDY = "battery short", "too windy"
"""How the reasons of decisions begin where the plan cannot be flown to its end."""
INFEASIBLE, NOTHING_TO_CHOOSE, LOWERED = "infeasible", "nothing to choose", "lowered"
"""Statuses of a re-planning, see `DecisionRecord`."""


BY_FALLBACK = "fallback, "
"""In the reason of a decision that was made without OSQP, which failed; how it was made follows."""


@dataclass
class SolverReport:
    """Counts of a planner's re-plannings and of the runs of OSQP in them.

    Attributes
    ----------
    replans : int
        Re-plannings in which OSQP ran.
    skipped : int
        Re-plannings that kept the last solution, proven to be optimal still.
    calls, solved, failed : int
        Runs of OSQP, those whose solution was verified, and those without one.
    retried : int
        Runs that were repeated after a failure.
    fallbacks : int
        Re-plannings whose runs failed: the decision is the planner's fallback.
    by_status : dict
        Runs by the status that they ended with.
    gaps : list of float
        Of each solution: relative distance to a bound that no solution exceeds.
    solve_ms : list of float
        Time of each re-planning [ms].
    """

    replans: int = 0
    skipped: int = 0
    calls: int = 0
    solved: int = 0
    retried: int = 0
    failed: int = 0
    fallbacks: int = 0
    by_status: dict[str, int] = field(default_factory=dict)
    gaps: list[float] = field(default_factory=list)
    solve_ms: list[float] = field(default_factory=list)


def allowed_levels(
    settings: PlannerSettings, mission: Mission, index: int, box: Box, *, measured: bool = False
) -> tuple[float, ...]:
    """Values that a computation may take in a set: the settings' within it, else the profile's, or those measured."""
    levels = settings.levels.get(mission.plan.names[index])
    if levels is None:
        return mission.computing.levels(index - mission.plan.path_count, box, measured=measured)
    return tuple(sorted(level for level in levels if box.lo <= level <= box.hi)) or (box.lo,)


def trade_off_faults(rows: Sequence[TradeOff], plan: Plan) -> list[tuple[str, str, str]]:
    """Trade-offs of stages that the plan has not, or that no parameters within its sets meet; see `Planner.faults`."""
    boxes = {name: plan.hull(i) for i, name in enumerate(plan.names)} if plan.has_sets else {}
    faults = []
    for i, row in enumerate(rows):
        beyond = [stage for stage in row.stages if stage > len(plan.stages)]
        if beyond:
            expected = f"stages from 1 to {len(plan.stages)}"
            faults.append((f"trade_offs.{i}.stages", f"the plan has no stage {beyond[0]}", expected))
        # R c is greatest at an end of each set
        greatest = sum(
            max(weight * boxes[name].lo, weight * boxes[name].hi)
            for name, weight in row.coefficients.items()
            if name in boxes
        )
        if greatest < row.at_least:
            message = f"no parameters meet the trade-off: R c is at most {greatest:g}, and r is {row.at_least:g}"
            faults.append((f"trade_offs.{i}.at_least", message, f"at most {greatest:g}"))
    return faults


def thinned(levels: Sequence[tuple[float, ...]], limit: int) -> list[tuple[float, ...]]:
    """Levels with at most `limit` combinations: drops every second one of the longest list while it has over two."""
    kept = list(levels)
    while math.prod(map(len, kept)) > limit and max(map(len, kept)) > 2:
        k = max(range(len(kept)), key=lambda i: len(kept[i]))
        kept[k] = (*kept[k][:-1:2], kept[k][-1])  # its lowest and highest levels stay
    return kept


def next_multiple(time_s: float, every_s: float) -> float:
    """The first multiple of a period after a time [s]."""
    # a time within rounding of a multiple is at it
    return (math.floor(time_s / every_s + 1e-6) + 1) * every_s

"""What planners share: observations, decisions, settings, and the base class that tracks laps and power.

A planner sees Observations and returns Decisions; it knows the plan, the models and its settings, and nothing of the
world it flies in, so that the same object serves a simulation and a telemetry stream.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar, NamedTuple, Protocol

from annotated_types import Ge, Le, Len

from eadp.core.bounds import NotNegative, Reserve
from eadp.core.geometry.curves import Point
from eadp.errors import PathUndefined
from eadp.models.battery import Battery
from eadp.models.computing import Computing
from eadp.models.energy import EnergyModel
from eadp.models.plan.cursor import PlanCursor, Rules, Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.trace import nominal_legs
from eadp.planning.estimation.estimator import (
    MIN_NOISE_W,
    ONE_LAP_SHARE,
    PUBLISHED,
    SHORTEST_DISTURBANCE_S,
    Estimator,
    EstimatorSettings,
    ExactEstimator,
    PublishedEstimator,
)

SOC_JUMP = 0.01
Levels = Annotated[tuple[NotNegative, ...], Len(1, 1000)]


class Observation(NamedTuple):
    """What is known in flight at one time.

    Attributes
    ----------
    time_s, x_m, y_m : float
        Time [s]; position [m].
    cursor : PlanCursor
        The stage being flown and the parameters in force.
    joined_m : (float, float)
        Where the stage was joined in the plan [m].
    stages_started : int
        Over the whole flight, the first included.
    power_w : float or None
        Measured, motion and computations [W]; None where the sensor has no reading.
    soc : float
        State of charge.
    wind_mps : (float, float) or None
        Where the wind is measured [m/s].
    velocity_mps : (float, float) or None
        Over ground [m/s].
    heading_rad : float or None
        Where the nose points [rad].
    """

    time_s: float
    x_m: float
    y_m: float
    cursor: PlanCursor
    joined_m: Point
    stages_started: int
    power_w: float | None
    soc: float
    wind_mps: Point | None = None
    velocity_mps: Point | None = None
    heading_rad: float | None = None

    @property
    def stage(self) -> int:
        """Index of the stage being flown, from 1 within the plan's stages."""
        return self.cursor.stage.index

    @property
    def parameters(self) -> Vector:
        """Parameters in force."""
        return self.cursor.parameters


class Readings(NamedTuple):
    """Consecutive readings of the sensors, one or more: position, power, charge and motion.

    Velocities and headings are as in `Observation`, NaN where they are not measured; there is no wind among them.
    """

    times_s: Sequence[float]
    x_m: Sequence[float]
    y_m: Sequence[float]
    powers_w: Sequence[float | None]
    charges: Sequence[float]
    vx_mps: Sequence[float]
    vy_mps: Sequence[float]
    headings_rad: Sequence[float]


class Decision(NamedTuple):
    """The parameters to fly with, the power forecast for the last reading [W], and why.

    `record` is what a planner says of its last re-planning, where it keeps such records: a new object for each.
    """

    parameters: Vector
    power_forecast_w: float
    reason: str = ""
    record: DecisionRecord | None = None


@dataclass(frozen=True, slots=True)
class DecisionRecord:
    """One re-planning, as `decisions.jsonl` holds it.

    Attributes
    ----------
    time_s : float
    why : str
        Cause of the re-planning.
    stage, lap : int
        Where in the plan, from 1 and from 0.
    parameters : tuple of float
        Chosen, to fly with from now on.
    remaining_s, remaining_std_s : float
        Time to the end of the mission with them, and its standard deviation [s].
    energy_wh, energy_std_wh : float
        Energy to the end, and its standard deviation [Wh].
    available_wh : float
        Energy that takes the battery down to the reserve [Wh].
    soc_end, soc_end_std : float
        State of charge forecast for the end, and its standard deviation.
    completes_probability, reserve_probability : float
        That the battery is not empty before the end; that the reserve is kept.
    quality_ahead : float or None
        U forecast for the whole flight, what has been flown included.
    wind_mps : (float, float) or None
        As estimated [m/s].
    passes : int
        QPs solved.
    status : str
        `solved`, `closed form`, `scanned` or `infeasible`.
    reason : str
        The decision and its cause, in words.
    home_reachable : bool or None
        Whether home could be reached from here with the reserve kept; None where there is none.
    point_of_no_return_s : float or None
        When it last could be [s], where it cannot.
    """

    time_s: float
    why: str
    stage: int
    lap: int
    parameters: Vector
    remaining_s: float
    remaining_std_s: float
    energy_wh: float
    energy_std_wh: float
    available_wh: float
    soc_end: float
    soc_end_std: float
    completes_probability: float
    reserve_probability: float
    quality_ahead: float | None
    wind_mps: Point | None
    passes: int
    status: str
    reason: str
    home_reachable: bool | None = None
    point_of_no_return_s: float | None = None


@dataclass(frozen=True)
class TradeOff:
    """One row R c − r ≥ 0 that the parameters keep to."""

    coefficients: Mapping[str, float]
    """R: coefficients by the parameters' names."""

    at_least: float
    """r: the least value of the weighted sum."""


@dataclass(frozen=True)
class PlannerSettings:
    """Settings that planners share; each planner's own settings stand beside it."""

    name: str = ""
    """Name of the planner in the registry."""

    every_s: Annotated[float, Ge(1e-3), Le(1e6)] = 1.0
    """Time between re-plannings [s]."""

    weights: Mapping[str, NotNegative] = field(default_factory=dict)
    """Weight of each parameter in the quality U, by name; equal if none is given."""

    levels: Mapping[str, Levels] = field(default_factory=dict)
    """Values that a computation may take, by name; by default those of the profile."""

    reserve_soc: Reserve = 0.05
    """State of charge to keep at the end of the flight, as a share of the full charge."""


@dataclass
class SolverReport:
    """Counts of a planner's work: what is solved, what failed, what had no answer, and the gaps of integer answers.

    `solves` counts optimal control problems, `qps` what OSQP was given for them.
    """

    replans: int = 0
    solves: int = 0
    failures: int = 0
    infeasible: int = 0
    solve_ms: list[float] = field(default_factory=list)
    gaps: list[float] = field(default_factory=list)
    qps: int = 0


@dataclass(frozen=True)
class Mission:
    """What a planner knows before take-off.

    `motion_w` is the power of straight level flight [W], if it is known; `home_m` is where the aircraft can return
    to [m].
    """

    plan: Plan
    computing: Computing
    battery: Battery
    cruise_mps: float
    parameters: Vector
    start_m: Point | None = None
    energy: EnergyModel | None = None
    motion_w: float | None = None
    home_m: Point | None = None
    rules: Rules = field(default_factory=Rules)


class Planner(Protocol):
    """The interface of a planner."""

    report: SolverReport

    @property
    def period_s(self) -> float | None:
        """The period of the power [s], where there is one."""

    @property
    def reading_every_s(self) -> float:
        """Time between readings of the power sensor [s]; infinite for none."""

    @property
    def next_update_s(self) -> float:
        """Time [s] before which `update` decides nothing, except at a new stage or a drop of charge."""

    def update(self, observation: Observation) -> Decision:
        """Take an observation and decide."""

    def ingest(self, readings: Readings) -> Decision:
        """Take readings since the last observation, of its stage and parameters."""


class TrackingPlanner:
    """Base class of planners: it tracks laps and power with its estimator, and keeps the parameters of take-off.

    It takes every reading, unless a subclass overrides `next_update_s`.
    """

    own_settings: ClassVar[type | None] = None
    """Dataclass of this planner's own settings, if it has any."""

    optimises_to_end: ClassVar[bool] = False
    """Whether the planner chooses its parameters so that they last to the end of the mission."""

    def __init__(
        self, settings: PlannerSettings, estimator: EstimatorSettings, mission: Mission, own: Any = None
    ) -> None:
        self.report = SolverReport()
        self._settings = settings
        self._mission = mission
        self._decision = Decision(mission.parameters, 0.0)
        self._lap_stages = mission.plan.primitive_stages
        self._estimator = _estimator(estimator, mission, self._lap_stages)
        self._sensor_every_s = estimator.every_s
        self._next_reading_s = 0.0
        self._stages_started = 1
        self._segment = 0
        self._laps = 0
        self._computing_for: tuple[Vector, int] | None = None
        self._computing_w = 0.0

    @property
    def period_s(self) -> float | None:
        """The estimator's period [s]."""
        return self._estimator.period_s

    @property
    def reading_every_s(self) -> float:
        """Time between readings of the estimator [s]."""
        return self._sensor_every_s

    @property
    def next_update_s(self) -> float:
        """At every reading."""
        return self._next_reading_s

    def ingest(self, readings: Readings) -> Decision:
        """Take readings all at once; the parameters stay."""
        motion = [None if power_w is None else power_w - self._computing_w for power_w in readings.powers_w]
        expected = self._estimator.observe_batch(readings.times_s, motion) + self._computing_w
        self._next_reading_s = readings.times_s[-1] + self._sensor_every_s
        self._decision = self._decision._replace(power_forecast_w=expected)
        return self._decision

    def update(self, observation: Observation) -> Decision:
        """Take an observation; the parameters stay."""
        self._track(observation)
        return self._decision

    def _count_laps(self, o: Observation) -> None:
        """A stage has started: perhaps a lap has ended with it, or the stages before the first lap."""
        before, self._segment = self._segment, o.cursor.segment
        segment = o.cursor.table.segments[self._segment]
        lap_stages = None if self._mission.plan.parts else self._lap_stages
        if segment.repeats:
            lap_stages = segment.count
        if lap_stages is None or (o.stage - 1 - segment.first) % lap_stages:
            return
        if self._segment != before:
            self._estimator.start_lap(o.time_s)
            return
        self._laps += 1
        self._estimator.lap(o.time_s)

    def _track(self, o: Observation) -> None:
        """Feed the estimator: laps as they end, readings as often as the sensor is read."""
        if o.stages_started != self._stages_started:
            self._stages_started = o.stages_started
            self._count_laps(o)
        if self._computing_for != (o.parameters, o.stage):
            self._computing_for = (o.parameters, o.stage)
            self._computing_w = self._mission.computing.power_w(o.parameters, o.cursor.stage.sets)
        if o.time_s < self._next_reading_s - 1e-9:
            return
        self._next_reading_s = o.time_s + self._sensor_every_s
        motion = None if o.power_w is None else o.power_w - self._computing_w
        expected = self._estimator.observe(o.time_s, motion) + self._computing_w
        self._decision = self._decision._replace(power_forecast_w=expected)


def next_multiple(time_s: float, every_s: float) -> float:
    return (math.floor(time_s / every_s + 1e-6) + 1) * every_s


def _estimator(settings: EstimatorSettings, mission: Mission, lap_stages: int | None) -> Estimator:
    if settings.kind == PUBLISHED:
        return PublishedEstimator(settings)
    if mission.energy is not None:
        return _of_fit(settings, mission.energy)
    if not lap_stages:
        return ExactEstimator(settings, None)
    return ExactEstimator(settings, _nominal_lap_s(mission))


def _of_fit(settings: EstimatorSettings, fitted: EnergyModel) -> ExactEstimator:
    """An estimator that starts from a model fitted to a log, whose noise replaces the settings'."""
    std_s, disturbance = None, fitted.disturbance
    if fitted.period_s is not None and fitted.period_std_s is not None:
        std_s = max(fitted.period_std_s, ONE_LAP_SHARE * fitted.period_s)  # it was another flight's
    if disturbance is not None:
        white_w = math.sqrt(max(fitted.noise_std_w**2 - disturbance.std_w**2, 0.0))
        settings = replace(
            settings,
            noise_w=max(white_w, MIN_NOISE_W),
            disturbance_std_w=disturbance.std_w,
            disturbance_time_s=max(disturbance.time_s, SHORTEST_DISTURBANCE_S),
        )
    return ExactEstimator(settings, fitted.period_s, fitted.state_w(settings.order), period_std_s=std_s)


def _nominal_lap_s(mission: Mission) -> float | None:
    """The time of a lap flown exactly at cruise speed, without wind: the first guess of the period."""
    try:
        legs = nominal_legs(mission.plan, mission.parameters, mission.start_m)
    except PathUndefined:
        return None
    whole = max(legs[-1].lap - 1, 0)  # the last lap may be cut short, the first starts anywhere
    length = sum(leg.length_m for leg in legs if leg.lap == whole)
    return length / mission.cruise_mps if length > 0 and math.isfinite(length) else None

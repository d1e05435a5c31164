"""What planners share: what they see and decide, their settings, and a planner that keeps its parameters.

A planner sees Observations and returns Decisions; it knows the plan, the models and its settings, and nothing of the
world it flies in, so that the same object serves a simulation and a telemetry stream.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol

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
from eadp.planning.paper.horizon import CONTROL

STATIC, PAPER, JOINT = "static", "paper", "joint"
SOC_JUMP = 0.01


class Observation(NamedTuple):
    """What is known in flight at one moment.

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
    """What sensors have told one after the other, one or more of each: place, power, charge, and motion.

    Velocities and headings are as `Observation` has them, no number where nothing tells them; no wind is told.
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
        What has brought it about.
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
        What has been decided and why, in words.
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
class PlannerSettings:
    """Settings of every planner; each uses those that concern it. Times in seconds.

    `reserve_probability` is how surely `joint` keeps the reserve, `keep_gain` the quality U that a change of a
    parameter has to gain. `horizon_s` None is one period. `solver` is `qp`, or `auto`: a closed form where it is
    proven, else QPs. `trade_offs` are rows (coefficient per parameter name, least value). `objective` is what
    `joint` maximises: `quality`, or `total`, the sum of the computations over time.
    """

    name: str = JOINT
    every_s: float = 1.0
    horizon_s: float | None = 6.0
    weights: Mapping[str, float] = field(default_factory=dict)
    delta: Mapping[str, float] = field(default_factory=dict)
    levels: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    cost: str = CONTROL
    cost_weights: tuple[float, float] = (1.0, 1.0)
    solver: str = "auto"
    constraint_at: str = "worst"
    remaining_time: str = "corrected"
    path_search: str = "delta"
    raise_path: bool = True
    path_every_s: float | None = None
    start_after_s: float = 0.0
    min_periods: int = 2
    longest_s: float | None = None
    shortest_s: float | None = None
    trade_offs: tuple[tuple[Mapping[str, float], float], ...] = ()
    reserve_soc: float = 0.05
    reserve_probability: float = 0.95
    keep_gain: float = 0.01
    objective: str = "quality"


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
    """What a planner is told before take-off.

    `motion_w` is the power of straight level flight [W], where the maker or an earlier flight tells it; `home_m`
    is where to be able to return to [m].
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
    """What a flight needs of a planner."""

    report: SolverReport

    @property
    def period_s(self) -> float | None:
        """The period of the power [s], where there is one."""

    @property
    def reading_every_s(self) -> float:
        """How often it wants the power sensor read [s]; infinite for never."""

    @property
    def next_look_s(self) -> float:
        """The time [s] before which `update` would decide nothing, but for a new stage or a drop of charge."""

    def update(self, observation: Observation) -> Decision:
        """Take an observation and decide."""

    def listen(self, readings: Readings) -> Decision:
        """Take readings since the last observation, of its stage and parameters."""


class TrackingPlanner:
    """What every planner does: it follows laps and power with its estimator, and keeps the parameters of take-off.

    One that decides is made of this one; it is shown every reading, unless it says otherwise.
    """

    def __init__(self, settings: PlannerSettings, estimator: EstimatorSettings, mission: Mission) -> None:
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
        """As the estimator's settings say [s]."""
        return self._sensor_every_s

    @property
    def next_look_s(self) -> float:
        """At every reading."""
        return self._next_reading_s

    def listen(self, readings: Readings) -> Decision:
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


class StaticPlanner(TrackingPlanner):
    """Keeps the parameters of take-off; estimates all the same, so that its flights tell a forecast.

    Source: flights I and II of the letter.
    """

    @property
    def next_look_s(self) -> float:
        """Never: there is nothing to decide."""
        return math.inf


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
    """An estimator that starts from what a log has told: its noise takes the place of the settings'."""
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
    whole = max(legs[-1].lap - 1, 0)  # the last lap may be cut short, the first begins anywhere
    length = sum(leg.length_m for leg in legs if leg.lap == whole)
    return length / mission.cruise_mps if length > 0 and math.isfinite(length) else None

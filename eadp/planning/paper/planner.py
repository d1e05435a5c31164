"""The letter's planner: computations by a receding horizon, then the path by the remaining time."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le

from eadp.core.arrays import FloatArray
from eadp.core.bounds import NotNegative, Positive
from eadp.core.flight.battery import currents_a
from eadp.core.signals.scaling import path_scaling
from eadp.errors import Infeasible, PathUndefined, SolverFailed
from eadp.models.plan.cursor import Vector
from eadp.models.plan.trace import nominal_legs
from eadp.planning.base import (
    SOC_JUMP,
    Decision,
    Mission,
    Observation,
    PlannerSettings,
    Readings,
    TrackingPlanner,
    TradeOff,
    allowed_levels,
    next_multiple,
)
from eadp.planning.estimation.estimator import EstimatorSettings
from eadp.planning.paper.horizon import ComputationLevels, Horizon, HorizonForecast

LOOK_AHEAD_STEP_S = 1.0
SAMPLES_PER_STEP = 10


@dataclass(frozen=True)
class PaperSettings:
    """Settings of planner `paper`."""

    horizon_s: Positive | Literal["period"] = 6.0
    """Length of the horizon [s], or `period`: one period of the power."""

    cost: Literal["control", "power", "quadratic", "output"] = "control"
    """What the horizon maximises: the computations, their power, a quadratic form, or ½y² of the whole power."""

    cost_weights: tuple[NotNegative, NotNegative] = (1.0, 1.0)
    """Q and R of cost `quadratic`."""

    constraint_at: Literal["end", "worst"] = "worst"
    """Where in each step the power is bounded: at its end, or where the motion's power is greatest."""

    remaining_time: Literal["corrected", "published"] = "corrected"
    """Formula of the remaining time: corrected, or with the letter's misprint."""

    delta: Mapping[str, Positive] = field(default_factory=dict)
    """Step of each parameter, by name; by default a tenth of a path parameter's set, and 1 for a computation."""

    path_rule: Literal["delta", "largest"] = "delta"
    """How a path parameter changes: by its delta, or to the largest value for which the time suffices."""

    raise_path: bool = True
    """Whether a path parameter may also rise while time is left."""

    path_every_s: Positive | None = None
    """Time between re-plannings of the path [s]; by default `every_s`."""

    start_after_s: NotNegative = 0.0
    """Time before which nothing is re-planned [s]."""

    min_periods: Annotated[int, Ge(0), Le(1000)] = 2
    """Number of periods to fly before anything is re-planned."""

    longest_s: Positive | None = None
    """Time of the whole coverage at the highest path parameters [s]; by default from the plan's geometry."""

    shortest_s: Positive | None = None
    """Time of the whole coverage at the lowest path parameters [s]; by default from the plan's geometry."""

    trade_offs: tuple[TradeOff, ...] = ()
    """Rows R c − r ≥ 0 that the computations keep to."""


class PaperPlanner(TrackingPlanner):
    """The letter's Algorithm 2: computations by a receding horizon, then the path by the remaining time.

    Source: letter, Alg. 2, with misprint 5 corrected unless `remaining_time` is `published`; drafts 003 and 004 for the
    subroutine that is the fallback of a failed solve.
    """

    own_settings = PaperSettings

    def __init__(
        self,
        settings: PlannerSettings,
        estimator: EstimatorSettings,
        mission: Mission,
        own: PaperSettings | None = None,
    ) -> None:
        super().__init__(settings, estimator, mission)
        self._own = own = own or PaperSettings()
        self._rho = mission.plan.path_count
        self._next_s = own.start_after_s
        self._next_path_s = own.start_after_s
        self._soc: float | None = None
        self._horizons: dict[tuple[object, ...], Horizon] = {}
        self._times = _coverage_times_s(own, mission)
        self._boxes = [mission.plan.hull(i) for i in range(self._rho)] if self._times else []
        self._computing_plan_w: FloatArray = np.zeros(0)
        self._instants_s: FloatArray = np.zeros(0)

    @property
    def next_update_s(self) -> float:
        """Time of the next re-planning; infinite before the first periods are flown."""
        return self._next_s if self._laps_known() else math.inf

    @property
    def horizon_s(self) -> float:
        """Length of the horizon [s]."""
        own_s = self._own.horizon_s
        return super().horizon_s if own_s == "period" else own_s

    def ingest(self, readings: Readings) -> Decision:
        """Take a batch of readings; the fall of the charge within it is no jump."""
        self._soc = readings.charges[-1]
        return super().ingest(readings)

    def update(self, observation: Observation) -> Decision:
        """Update with an observation; re-plan when due, and at once when the state of charge jumps."""
        o = observation
        self._track(o)
        jumped = self._soc is not None and abs(o.soc - self._soc) > SOC_JUMP
        self._soc = o.soc
        if not self._started(o):
            return self._decision
        if jumped or o.time_s >= self._next_s - 1e-9:
            self._next_s = next_multiple(o.time_s, self._settings.every_s)
            parameters, reason = self._computations(o)
            if jumped or o.time_s >= self._next_path_s - 1e-9:
                every_s = self._own.path_every_s or self._settings.every_s
                self._next_path_s = next_multiple(o.time_s, every_s)
                parameters = self._path(o, parameters)
            self.report.replans += 1
            self._decision = Decision(parameters, self._decision.power_forecast_w, reason)
        return self._decision

    def _started(self, o: Observation) -> bool:
        return self._laps_known() and o.time_s >= self._own.start_after_s - 1e-9

    def _laps_known(self) -> bool:
        return self._lap_stages is None or self._laps >= self._own.min_periods

    # --- computations

    def _computations(self, o: Observation) -> tuple[Vector, str]:
        """The parameters with new computations, and the reason; sets the computations' power over the horizon."""
        decided = self._decision.parameters
        sets = self._mission.plan.stages[o.stage - 1].sets
        free = [i for i in range(self._rho, len(decided)) if not sets[i].fixed]
        steps = self._steps()
        if not free:
            self._computing_plan_w = np.full(steps, self._computing_w)
            return decided, "nothing to choose"
        horizon = self._horizon(o, free, steps)
        forecast = self._horizon_forecast(o, steps)
        now = np.array([decided[i] for i in free])
        reason = "planned"
        try:
            values = self._solve(horizon, forecast)
        except Infeasible as error:
            self.report.infeasible += 1
            values, reason = np.array([[sets[i].lo for i in free]] * steps), f"infeasible: {error}"
        except SolverFailed as error:
            self.report.failures += 1
            deltas = np.array([self._delta(i) for i in free])
            try:
                values, reason = horizon.lowered(now, deltas, forecast), f"fallback, lowered by δ: {error}"
            except Infeasible:
                values, reason = np.array([[sets[i].lo for i in free]] * steps), f"fallback, minimum: {error}"
        chosen = list(decided)
        powers = []
        for row in values:
            for i, value in zip(free, row.tolist(), strict=True):
                chosen[i] = value
            powers.append(self._mission.computing.power_w(chosen, sets))
        self._computing_plan_w = np.array(powers)
        for i, value in zip(free, values[0].tolist(), strict=True):
            chosen[i] = value
        return tuple(chosen), reason

    def _solve(self, horizon: Horizon, forecast: HorizonForecast) -> FloatArray:
        started = time.perf_counter()
        self.report.solves += 1
        try:
            plan = horizon.solve(forecast)
        finally:
            self.report.solve_ms.append(1e3 * (time.perf_counter() - started))
        self.report.gaps.append(plan.gap)
        self.report.qps += plan.qp_solves
        return plan.chosen

    def _steps(self) -> int:
        return max(1, round(self.horizon_s / self._settings.every_s))

    def _horizon(self, o: Observation, free: list[int], steps: int) -> Horizon:
        """The problem for the sets of this stage, built once for each."""
        plan, own = self._mission.plan, self._own
        sets = plan.stages[o.stage - 1].sets
        fixed = tuple(o.parameters[: self._rho]) if own.trade_offs else ()
        battery = self._mission.battery.near(o.soc)
        key = (steps, fixed, battery.voltage_v, *(sets[i] for i in free))
        if key not in self._horizons:
            base = list(o.parameters)

            def power(values: Sequence[float]) -> float:
                for i, value in zip(free, values, strict=True):
                    base[i] = value
                return self._mission.computing.power_w(base, sets)

            levels = [allowed_levels(self._settings, self._mission, i, sets[i]) for i in free]
            computations = ComputationLevels(
                np.array([sets[i].lo for i in free]), np.array([sets[i].hi for i in free]), levels, power
            )
            names = plan.names
            rows = []
            for row in own.trade_offs:
                weights = [row.coefficients.get(name, 0.0) for name in names]
                rest = sum(weights[i] * o.parameters[i] for i in range(len(names)) if i not in free)
                rows.append(([weights[i] for i in free], row.at_least - rest))
            self._horizons[key] = Horizon(computations, battery, steps, own.cost, rows, own.cost_weights)
        return self._horizons[key]

    def _horizon_forecast(self, o: Observation, steps: int) -> HorizonForecast:
        every_s = self._settings.every_s
        if len(self._instants_s) != steps * SAMPLES_PER_STEP:
            self._instants_s = np.arange(1.0, steps * SAMPLES_PER_STEP + 1) * (every_s / SAMPLES_PER_STEP)
        motion = self._estimator.forecast(self._instants_s).reshape(steps, SAMPLES_PER_STEP)
        limit = motion.max(axis=1) if self._own.constraint_at == "worst" else motion[:, -1]
        mean = np.maximum(motion.sum(axis=1) / SAMPLES_PER_STEP, 0.0)
        state = self._estimator.state_w
        ripple = float(state[1:] @ state[1:])
        return HorizonForecast(limit, mean, o.soc, every_s, float(state[0]), ripple)

    # --- path

    def _path(self, o: Observation, parameters: Vector) -> Vector:
        """Path parameters from the remaining time and the time to an empty battery. Source: letter, Alg. 2 l. 17-27."""
        if not self._rho or self._times is None:
            return parameters
        last_s = self._time_to_reserve_s(o)
        shortest, longest = self._times
        if self._own.path_rule == "largest":
            share = self._largest_share(o.time_s, last_s)
            chosen = (*(box.lo + share * (box.hi - box.lo) for box in self._boxes), *parameters[self._rho :])
            longer = self._coverage_s(chosen) >= self._coverage_s(parameters)
            return parameters if longer and not self._own.raise_path else chosen
        down = -1 if longest >= shortest else 1
        if self._remaining_s(parameters, o.time_s) > last_s:
            return self._moved(parameters, down)
        if self._own.raise_path:
            raised = self._moved(parameters, -down)
            if self._remaining_s(raised, o.time_s) <= last_s:
                return raised
        return parameters

    def _moved(self, parameters: Vector, direction: int) -> Vector:
        moved = [
            box.clip(value + direction * self._delta(i))
            for i, (value, box) in enumerate(zip(parameters[: self._rho], self._boxes, strict=True))
        ]
        return (*moved, *parameters[self._rho :])

    def _delta(self, index: int) -> float:
        """δ of a parameter: the settings', else a tenth of its set (a path) or one step (a computation)."""
        own = self._own.delta.get(self._mission.plan.names[index])
        if own is not None:
            return own
        box = self._mission.plan.hull(index)
        return (box.hi - box.lo) / 10 if index < self._rho else 1.0

    def _coverage_s(self, parameters: Vector) -> float:
        """t_s = Σ(ν c + τ) over the path parameters. Source: letter, Alg. 2 l. 24."""
        assert self._times is not None
        total = 0.0
        for box, value in zip(self._boxes, parameters[: self._rho], strict=True):
            nu, tau = path_scaling(box.lo, box.hi, *self._times, self._rho)
            total += nu * value + tau
        return total

    def _remaining_s(self, parameters: Vector, time_s: float) -> float:
        """t_r at given path parameters. Source: letter, Alg. 2 l. 25, as printed or corrected."""
        assert self._times is not None
        total_s = self._coverage_s(parameters)
        if self._own.remaining_time == "published":
            longest = max(self._times)
            return total_s / longest * (longest - time_s)
        return total_s - time_s

    def _largest_share(self, time_s: float, last_s: float) -> float:
        """The largest share of their sets, in 0..1, at which all path parameters have t_r ≤ t_b."""
        assert self._times is not None
        shortest, longest = self._times
        limit_s = last_s + time_s
        if self._own.remaining_time == "published":
            whole = max(self._times)
            limit_s = last_s * whole / (whole - time_s) if time_s < whole else math.inf
        if math.isinf(limit_s) or longest == shortest:
            return 1.0 if longest >= shortest else 0.0
        return min(1.0, max(0.0, (limit_s - shortest) / (longest - shortest)))

    def _time_to_reserve_s(self, o: Observation) -> float:
        """t_b: time until the predicted battery reaches the reserve [s].

        The horizon's computations, then its last one held. The motion is periodic: whole periods are divided out, and
        one period is predicted. A voltage that falls with the charge is taken half way.
        """
        spare = o.soc - self._settings.reserve_soc
        if spare <= 0:
            return 0.0
        b = self._mission.battery.near((o.soc + self._settings.reserve_soc) / 2)
        step_s = LOOK_AHEAD_STEP_S
        head = max(1, round(len(self._computing_plan_w) * self._settings.every_s / step_s))
        period = max(1, round((self.period_s or step_s) / step_s))
        motion = np.maximum(self._estimator.forecast(np.arange(0.5, head + period) * step_s), 0.0)
        repeat = max(1, round(self._settings.every_s / step_s))
        computing = np.full(head + period, self._computing_plan_w[-1])
        early = np.repeat(self._computing_plan_w, repeat)[:head]
        computing[: len(early)] = early
        try:
            current = currents_a(motion + computing, b.voltage_v, b.resistance_ohm)
        except Infeasible:
            return 0.0
        drops = np.cumsum(current * (b.k_b_per_s * step_s / b.capacity_ah))
        if drops[-1] >= spare:
            return _crossing_s(drops, spare, step_s)
        first = float(drops[head - 1])
        one_period = float(drops[-1]) - first
        if one_period <= 0:
            return math.inf
        whole = math.floor((spare - first) / one_period)
        rest = spare - first - whole * one_period
        return head * step_s + whole * period * step_s + _crossing_s(drops[head:] - first, rest, step_s)


def _crossing_s(drops: FloatArray, spare: float, step_s: float) -> float:
    """Time at which a growing sum, given after each step, reaches a value: linear within the step [s]."""
    i = int(np.searchsorted(drops, spare))
    before = float(drops[i - 1]) if i else 0.0
    if i == len(drops):
        return len(drops) * step_s
    return (i + (spare - before) / (float(drops[i]) - before)) * step_s


def _coverage_times_s(settings: PaperSettings, mission: Mission) -> tuple[float, float] | None:
    """Time of the whole coverage at the minimum and at the maximum path parameters, t̲ and t̄ [s].

    From the settings, else nominal at cruise speed without wind. None if no path parameter is free, or the nominal path
    is undefined.
    """
    plan = mission.plan
    rho = plan.path_count
    if not rho or all(plan.hull(i).fixed for i in range(rho)):
        return None
    times = []
    for given, end in ((settings.shortest_s, "lo"), (settings.longest_s, "hi")):
        if given is not None:
            times.append(given)
            continue
        corner = (*(getattr(plan.hull(i), end) for i in range(rho)), *mission.parameters[rho:])
        try:
            length = sum(leg.distance_m for leg in nominal_legs(plan, corner, mission.start_m))
        except PathUndefined:
            return None
        if not math.isfinite(length):
            return None
        times.append(length / mission.cruise_mps)
    return times[0], times[1]

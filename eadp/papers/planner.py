"""The letter's planner: computations by a receding horizon, then the path by the remaining time."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le

from eadp.core.arrays import Finite, FloatArray, NotNegative, Positive
from eadp.errors import Infeasible, PathUndefined, SolverFailed
from eadp.models.battery import Battery
from eadp.models.plan.cursor import Vector
from eadp.models.plan.stage import Box
from eadp.models.plan.trace import nominal_legs
from eadp.models.world import Mission
from eadp.papers.forecasting import scaling_factors
from eadp.papers.horizon import ComputationLevels, Horizon, HorizonCost, HorizonForecast
from eadp.papers.power import PowerTracker
from eadp.planning.base import (
    BY_FALLBACK,
    FALLBACK,
    INFEASIBLE,
    JUMPED,
    KEPT,
    LOWERED,
    NOTHING_TO_CHOOSE,
    SOLVED,
    TIME,
    Decision,
    DecisionRecord,
    Observation,
    PlannerSettings,
    TradeOff,
    allowed_levels,
    next_multiple,
    with_limit,
)
from eadp.planning.qp import require_osqp
from eadp.planning.registry import Planner
from eadp.planning.state.flight_state import FlightState

Matrix = tuple[tuple[float, ...], ...]
Weight = NotNegative | Matrix

SUBROUTINE = "subroutine"

LOOK_AHEAD_STEP_S = 1.0
SAMPLES_PER_STEP = 10
MAX_STEPS = 400
"""Maximum number of steps of a horizon; a longer period is planned for in part."""

SOC_JUMP = 0.01
"""Change of the state of charge between two readings that is a jump."""

MAX_LOWERED = 1000
"""Maximum number of δ by which path parameters are lowered at once."""

ROUNDING = 1e-9
"""Relative asymmetry and negative eigenvalue of a matrix that count as rounding."""

VOLTAGE_STEP_V = 0.05
"""Steps of the voltage for which the horizon's problem is built anew [V]."""


@dataclass(frozen=True)
class PaperSettings:
    """Settings of planner `paper`: how it chooses the path, when it plans, and the computations over its horizon."""

    gains: Mapping[str, Finite] = field(default_factory=dict)
    """Change of the motion's power by a unit of a path parameter, by name [W per unit]."""

    remaining_time: Literal["corrected", "published"] = "corrected"
    """Formula of the remaining time: corrected, or with the letter's misprint."""

    delta: Mapping[str, Positive] = field(default_factory=dict)
    """Step of each parameter, by name; by default a tenth of a path parameter's set, and 1 for a computation."""

    path_rule: Literal["delta", "largest", "subroutine"] = "delta"
    """How a path parameter changes: by its delta; to the largest value for which the time suffices; or from its maximum
    down by its delta until the time suffices."""

    raise_path: bool = True
    """Whether a path parameter may also rise while time is left."""

    path_every_s: Positive | None = None
    """Time between re-plannings of the path [s]; by default `every_s`."""

    longest_s: Positive | None = None
    """Time of the whole coverage at the highest path parameters [s]; by default from the plan's geometry."""

    shortest_s: Positive | None = None
    """Time of the whole coverage at the lowest path parameters [s]; by default from the plan's geometry."""

    horizon_s: Annotated[float, Gt(0), Le(1e5)] | Literal["period"] = 6.0
    """Length of the horizon [s], or `period`: one period of the power."""

    cost: Literal["control", "power", "quadratic", "output"] = "control"
    """What the horizon maximises: the computations, their power, a quadratic form, or ½y² of the whole power."""

    cost_weights: tuple[Weight, Weight] = (1.0, 1.0)
    """Q and R of cost `quadratic`, symmetric and positive semidefinite: a matrix over the coefficients q, and one over
    the parameters in the plan's order; a number multiplies the identity."""

    terminal_weight: Annotated[float, Ge(0), Le(1e6)] = 0.0
    """Weight of the terminal cost ½ qᵀ diag(C) q at the end of the horizon."""

    constraint_at: Literal["end", "worst"] = "worst"
    """Where in each step the power is bounded: at its end, or where the motion's power is greatest."""

    solver: Literal["qp", "subroutine"] = "qp"
    """What finds the parameters: a quadratic program of the computations, and the path rule; or the drafts' subroutine,
    computations and path from their maximum down by `delta` until the constraints hold."""

    trade_offs: tuple[TradeOff, ...] = ()
    """Rows R c − r ≥ 0 that the parameters keep to."""

    start_after_s: NotNegative = 0.0
    """Time before which nothing is re-planned [s]."""

    min_periods: Annotated[int, Ge(0), Le(1000)] = 2
    """Number of periods to fly before anything is re-planned."""


class PaperPlanner(Planner):
    """The letter's Algorithm 2: computations by a receding horizon, then the path by the remaining time.

    Source: letter, Alg. 2, with misprint 5 corrected unless `remaining_time` is `published`; draft 002 for the gains
    Ω; drafts 003 and 004 for the trade-offs, and for the subroutine that is a path rule and the fallback of a failed
    solve.
    """

    own_settings = PaperSettings
    own: PaperSettings
    power: PowerTracker

    def __init__(self, settings: PlannerSettings, mission: Mission, own: PaperSettings | None = None) -> None:
        super().__init__(settings, mission, own or PaperSettings())
        own = self.own
        horizon_s = None if own.horizon_s == "period" else own.horizon_s
        self.power = PowerTracker(settings.estimator, mission, horizon_s)
        if own.solver != SUBROUTINE:
            require_osqp()
        self._rho = mission.plan.path_count
        self._next_s = own.start_after_s
        self._next_path_s = own.start_after_s
        self._laps = 0
        self._horizons: dict[tuple[object, ...], Horizon] = {}
        self._coverage = _coverage(own, mission)
        hulls = [mission.plan.hull(i) for i in range(self._rho)]
        steps = [(box.hi - box.lo) / 10 for box in hulls] + [1.0] * (len(mission.plan.names) - self._rho)
        self._deltas = [own.delta.get(name, step) for name, step in zip(mission.plan.names, steps, strict=True)]
        self._gains = [own.gains.get(name, 0.0) for name in mission.plan.names[: self._rho]]
        self._flown_path = mission.parameters[: self._rho]
        self._computing_plan_w: FloatArray = np.zeros(0)

    @classmethod
    def faults(cls, settings: PlannerSettings, mission: Mission) -> list[tuple[str, str, str]]:
        """Settings that the mission contradicts; see `Planner.faults`."""
        found, own = super().faults(settings, mission), settings.own
        if own.horizon_s != "period" and own.horizon_s > MAX_STEPS * settings.every_s:
            message = f"more than {MAX_STEPS} steps of {settings.every_s:g} s in {own.horizon_s:g} s"
            found.append(
                ("horizon_s", message, f"at most {MAX_STEPS * settings.every_s:g} s, or a larger planner.every_s")
            )
        sizes = (2 * settings.estimator.order + 1, len(mission.plan.names))
        for i, (name, weight, size) in enumerate(zip("QR", own.cost_weights, sizes, strict=True)):
            problem = "" if isinstance(weight, float | int) else _matrix_fault(weight, size)
            if problem:
                expected = f"a number, or a symmetric positive semidefinite {size} × {size} matrix"
                found.append((f"cost_weights.{i}", f"{name} {problem}", expected))
        return found

    @property
    def next_update_s(self) -> float:
        """Time of the next re-planning; infinite before the first periods are flown."""
        return self._next_s if self._laps_known() else math.inf

    def update(self, state: FlightState) -> Decision:
        """Re-plan when due, and at once when the state of charge jumps."""
        self._laps, o = self.power.laps, state.now
        path = o.parameters[: self._rho]
        if path != self._flown_path:
            # α0 steps by Ω (c − c⁻): 002, Eq. 7
            self.power.shift_level(self._gained_w(path))
            self._flown_path = path
        jumped = self.power.soc_before is not None and abs(o.soc - self.power.soc_before) > SOC_JUMP
        if not self._laps_known() or o.time_s < self.own.start_after_s - 1e-9:
            return self._decision
        if jumped or o.time_s >= self._next_s - 1e-9:
            self._next_s = next_multiple(o.time_s, self.settings.every_s)
            self._replan(o, jumped=jumped)
        return self._decision

    def _replan(self, o: Observation, *, jumped: bool) -> None:
        """Plan the computations, and the path where it is due or the charge has jumped; decide on both, and count."""
        report, decided = self.report, self._decision.parameters
        calls, started = report.calls, time.perf_counter()
        parameters, record = self._plan_computations(o, decided)
        if jumped or o.time_s >= self._next_path_s - 1e-9:
            every_s = self.own.path_every_s or self.settings.every_s
            self._next_path_s = next_multiple(o.time_s, every_s)
            parameters = self._path(o, parameters)
            if self.own.trade_offs and parameters[: self._rho] != decided[: self._rho]:
                # the computations keep to the rows with the new path, too
                parameters, record = self._plan_computations(o, parameters)
        ran = report.calls - calls
        report.replans += ran > 0
        report.skipped += record.status == KEPT and not ran
        report.fallbacks += record.status == FALLBACK
        if record.gap is not None:
            report.gaps.append(record.gap)
        report.solve_ms.append(1e3 * (time.perf_counter() - started))
        cause, reason = JUMPED if jumped else TIME, with_limit(record.reason, record.battery_limit)
        record = record._replace(cause=cause, parameters=parameters, calls=ran, reason=reason)
        self._decision = Decision(parameters, reason, record)

    def _gained_w(self, path: Vector) -> float:
        """Change of the motion's power by another path than the one flown [W]: Ω (c − c⁻)."""
        return sum(gain * (new - old) for gain, new, old in zip(self._gains, path, self._flown_path, strict=True))

    def _laps_known(self) -> bool:
        """Whether `min_periods` are flown, where there are any."""
        return self.mission.plan.primitive_stages is None or self._laps >= self.own.min_periods

    # --- computations

    def _plan_computations(self, o: Observation, decided: Vector) -> tuple[Vector, DecisionRecord]:
        """Plan the computations, and set their power over the horizon, `_computing_plan_w`.

        Returns `decided` with the computations to fly with now, and the record of how they were found.
        """
        sets, free = self.mission.plan.stages[o.stage - 1].sets, self._free(o)
        if not free:
            self._computing_plan_w = np.full(self._steps(), self.power.computing_w)
            return decided, self._record(o, decided, NOTHING_TO_CHOOSE, NOTHING_TO_CHOOSE)
        horizon, forecast = self._horizon(o, decided[: self._rho]), self._horizon_forecast(o)
        chosen, powers_w, record = self._found(o, decided, horizon, forecast)
        parameters = list(decided)
        for i, value in zip(free, chosen, strict=True):
            parameters[i] = value
        if powers_w is None:  # values that hold over the whole horizon
            powers_w = np.full(self._steps(), self.mission.computing.power_w(parameters, sets))
        self._computing_plan_w = powers_w
        return tuple(parameters), record

    def _record(self, o: Observation, decided: Vector, status: str, reason: str) -> DecisionRecord:
        """A record without a run of the solver."""
        return DecisionRecord(o.time_s, TIME, o.stage, o.cursor.lap, decided, status, 0, None, reason)

    def _found(
        self, o: Observation, decided: Vector, horizon: Horizon, forecast: HorizonForecast
    ) -> tuple[list[float], FloatArray | None, DecisionRecord]:
        """The free computations, their power over the horizon where they change in it, and how they were found."""
        deltas = np.array([self._deltas[i] for i in self._free(o)])
        try:
            if self.own.solver == SUBROUTINE:
                lowered = horizon.lowered(deltas, forecast)[0].tolist()
                return lowered, None, self._record(o, decided, LOWERED, "planned")
            solution = horizon.solve(forecast)
        except Infeasible as error:
            limit = horizon.battery_limit(forecast) if len(horizon.choices) else None
            record = self._record(o, decided, INFEASIBLE, f"infeasible: {error}")
            return horizon.lowest, None, record._replace(battery_limit=limit)
        except SolverFailed as error:
            values, how = horizon.lowest, "minimum"
            with suppress(Infeasible):
                values, how = horizon.lowered(deltas, forecast)[0].tolist(), "lowered by δ"
            return values, None, self._record(o, decided, FALLBACK, f"{BY_FALLBACK}{how}: {error}")
        record = self._record(o, decided, KEPT if solution.kept else SOLVED, "planned")
        record = record._replace(gap=solution.gap, battery_limit=solution.battery_limit)
        return solution.chosen[0].tolist(), solution.chosen_w, record

    def _free(self, o: Observation) -> list[int]:
        """Computations of the stage that have more than one value."""
        sets = self.mission.plan.stages[o.stage - 1].sets
        return [i for i in range(self._rho, len(sets)) if not sets[i].fixed]

    def _steps(self) -> int:
        """Number of steps of the horizon."""
        return min(max(1, round(self.power.horizon_s / self.settings.every_s)), MAX_STEPS)

    def _horizon(self, o: Observation, path: Vector) -> Horizon:
        """The optimal control problem on the stage being flown, built once for each key.

        Trade-offs have to hold with the path in force and with the one decided, `path`.
        """
        plan, own, steps = self.mission.plan, self.own, self._steps()
        sets = plan.stages[o.stage - 1].sets
        trade_offs = [row for row in own.trade_offs if row.holds_in(o.stage)]
        paths = frozenset({o.parameters[: self._rho], path} if trade_offs else ())
        battery = battery_near(self.mission.battery, o.soc)
        key = (steps, battery.voltage_v, paths, sets[self._rho :], tuple(map(id, trade_offs)))
        if key not in self._horizons:
            free = self._free(o)
            base = [*o.parameters[: self._rho], *(box.lo for box in sets[self._rho :])]

            def power(values: Sequence[float]) -> float:
                """Power of the computations with these values of the free ones [W]."""
                for i, value in zip(free, values, strict=True):
                    base[i] = value
                return self.mission.computing.power_w(base, sets)

            levels = [allowed_levels(self.settings, self.mission, i, sets[i]) for i in free]
            computations = ComputationLevels(
                np.array([sets[i].lo for i in free]), np.array([sets[i].hi for i in free]), levels, power
            )
            rows = []
            for row in trade_offs:
                weights = [row.coefficients.get(name, 0.0) for name in plan.names]
                for parameters in ((*some, *base[self._rho :]) for some in paths):
                    rest = sum(weights[i] * parameters[i] for i in range(len(weights)) if i not in free)
                    rows.append(([weights[i] for i in free], row.at_least - rest))
            cost = self._cost(free, o.parameters)
            self._horizons[key] = Horizon(computations, battery, steps, cost, rows, self.report)
        return self._horizons[key]

    def _cost(self, free: list[int], parameters: Vector) -> HorizonCost:
        """The cost over the free computations; the path's parameters, constant over the horizon, become its offsets."""
        own = self.own
        q, r = (np.array(weight) if isinstance(weight, tuple) else weight for weight in own.cost_weights)
        offsets: FloatArray | float = 0.0
        if isinstance(r, np.ndarray):
            fixed = range(self._rho)
            u = self._coverage.controls_s(parameters) if self._coverage else np.zeros(self._rho)
            offsets, r = r[np.ix_(free, fixed)] @ np.array(u), r[np.ix_(free, free)]
        return HorizonCost(own.cost, q, r, offsets, own.terminal_weight)

    def _horizon_forecast(self, o: Observation) -> HorizonForecast:
        """The charge, and the forecast of the motion's power over the horizon, by samples within each step."""
        steps, every_s = self._steps(), self.settings.every_s
        instants_s = np.arange(1.0, steps * SAMPLES_PER_STEP + 1) * (every_s / SAMPLES_PER_STEP)
        worst = self.own.constraint_at == "worst"
        motion = self.power.estimator.forecast(instants_s).reshape(steps, SAMPLES_PER_STEP)
        limit = motion.max(axis=1) if worst else motion[:, -1]
        mean = np.maximum(motion.sum(axis=1) / SAMPLES_PER_STEP, 0.0)
        return HorizonForecast(limit, mean, o.soc, every_s, self.power.estimator.state_w, self.power.period_s)

    # --- path

    def _path(self, o: Observation, parameters: Vector) -> Vector:
        """The parameters with the path chosen by the remaining time and the time to the reserve.

        With trade-offs the path goes only as far towards the rule's, in tenths, as some computations satisfy them.

        Source: letter, Alg. 2 l. 17-27.
        """
        coverage = self._coverage
        if coverage is None:
            return parameters
        path = parameters[: self._rho]
        chosen = self._path_by_rule(o, path, coverage)
        if self.own.trade_offs and chosen != path:
            shorter = (
                tuple(old + tenths / 10 * (new - old) for old, new in zip(path, chosen, strict=True))
                for tenths in range(9, 0, -1)
            )
            ways = itertools.chain([chosen], shorter)
            chosen = next((way for way in ways if len(self._horizon(o, way).choices)), path)
        return (*chosen, *parameters[self._rho :])

    def _path_by_rule(self, o: Observation, path: Vector, coverage: _Coverage) -> Vector:
        """The path parameters to fly, by the rule of the settings.

        A path suffices if the time left at it, t_r, is at most the time to the reserve, t_b. "largest": the same share
        of every set, the largest that suffices. "subroutine": lowered by δ until it suffices. "delta": one δ down where
        the path in force does not suffice; one up, if rises are allowed and that still suffices.
        """
        own, boxes = self.own, coverage.boxes
        # "down" is the direction in which the path parameters shorten the coverage
        down = -1 if coverage.at_highest_s >= coverage.at_lowest_s else 1
        found_s: dict[float, float] = {}

        def lasts_s(path: Vector) -> float:
            """The time t_b at a path [s], computed once for each power that it adds."""
            gained_w = self._gained_w(path)
            if gained_w not in found_s:
                found_s[gained_w] = self._time_to_reserve_s(o, gained_w)
            return found_s[gained_w]

        def suffices(path: Vector) -> bool:
            return self._remaining_s(path, o.time_s, coverage) <= lasts_s(path)

        if own.path_rule == "largest":
            share = self._largest_share(o.time_s, lasts_s(path), coverage)
            chosen = tuple(box.lo + share * (box.hi - box.lo) for box in boxes)
            longer = sum(coverage.controls_s(chosen)) >= sum(coverage.controls_s(path))
            return path if longer and not own.raise_path else chosen
        if SUBROUTINE in (own.solver, own.path_rule):
            # drafts 003 and 004: lowered by δ until the time suffices
            if own.raise_path:
                path = tuple(box.hi if down < 0 else box.lo for box in boxes)
            for _ in range(MAX_LOWERED):
                lowered = self._moved(path, down, coverage)
                if lowered == path or suffices(path):
                    break
                path = lowered
            return path
        if not suffices(path):
            return self._moved(path, down, coverage)
        raised = self._moved(path, -down, coverage)
        return raised if own.raise_path and raised != path and suffices(raised) else path

    def _moved(self, path: Vector, direction: int, coverage: _Coverage) -> Vector:
        """Path parameters moved by one δ each, to greater (1) or smaller (−1) values, within their sets."""
        boxes = enumerate(zip(path, coverage.boxes, strict=True))
        return tuple(box.clip(value + direction * self._deltas[i]) for i, (value, box) in boxes)

    def _remaining_s(self, path: Vector, time_s: float, coverage: _Coverage) -> float:
        """The time t_r that the coverage takes from now on at given path parameters [s].

        Source: letter, Alg. 2 l. 25, as printed or corrected.
        """
        # t_s = Σ(ν c + τ), the time of the whole coverage: l. 24
        total_s = sum(coverage.controls_s(path))
        if self.own.remaining_time == "published":
            return total_s / coverage.whole_s * (coverage.whole_s - time_s)
        return total_s - time_s

    def _largest_share(self, time_s: float, last_s: float, coverage: _Coverage) -> float:
        """The largest share of their sets, 0 to 1, at which the path parameters have t_r ≤ t_b; `last_s` is t_b."""
        shortest, longest = coverage.at_lowest_s, coverage.at_highest_s
        # t_r ≤ t_b solved for t_s, the time of the whole coverage, which is linear in the share
        limit_s = last_s + time_s
        if self.own.remaining_time == "published":
            whole = coverage.whole_s
            limit_s = last_s * whole / (whole - time_s) if time_s < whole else math.inf
        if math.isinf(limit_s) or longest == shortest:
            return 1.0 if longest >= shortest else 0.0
        return min(1.0, max(0.0, (limit_s - shortest) / (longest - shortest)))

    def _time_to_reserve_s(self, o: Observation, gained_w: float) -> float:
        """The time t_b until the predicted battery reaches the reserve [s], with `gained_w` more power of the motion.

        The computations are those of the horizon, and after it those of its last step. The motion is periodic, so that
        one period is predicted. A voltage that falls with the charge is taken halfway to the reserve.
        """
        spare = o.soc - self.settings.reserve_soc
        if spare <= 0:
            return 0.0
        every_s, step_s, computing_w = self.settings.every_s, LOOK_AHEAD_STEP_S, self._computing_plan_w
        # `head` steps of the horizon, then the steps of one period; `of_step` is the horizon's step that gives each one
        # its computations
        head = max(1, round(len(computing_w) * every_s / step_s))
        count = head + max(1, round((self.power.period_s or step_s) / step_s))
        at_s = np.arange(count, dtype=np.float64) * step_s
        of_step = np.minimum(at_s // every_s, len(computing_w) - 1).astype(int)
        motion_w = self.power.estimator.forecast(at_s + 0.5 * step_s)
        power_w = np.maximum(motion_w + gained_w, 0.0) + computing_w[of_step]
        battery = battery_near(self.mission.battery, (o.soc + self.settings.reserve_soc) / 2)
        return _lasting_s(power_w, head, step_s, spare, battery)


def _matrix_fault(rows: Matrix, size: int) -> str:
    """What is wrong with a weight matrix that is to have a size, in words; empty if nothing is."""
    if len(rows) != size or any(len(row) != size for row in rows):
        return f"is no {size} × {size} matrix"
    matrix = np.array(rows)
    if not np.isfinite(matrix).all():
        return "is not finite"
    scale = float(np.abs(matrix).max(initial=0.0))
    if np.abs(matrix - matrix.T).max(initial=0.0) > ROUNDING * scale:
        return "is not symmetric"
    lowest = float(np.linalg.eigvalsh(matrix).min())
    return f"has the eigenvalue {lowest:.4g}, below 0" if lowest < -ROUNDING * scale else ""


def battery_near(battery: Battery, soc: float) -> Battery:
    """A battery of one voltage, that of one near a state of charge: a step of `VOLTAGE_STEP_V` or less below.

    The horizon is short, and its problem is built anew only where the voltage has changed.
    """
    if battery.voltage_empty_v is None:
        return battery
    volts = math.floor(battery.voltage_at(soc) / VOLTAGE_STEP_V) * VOLTAGE_STEP_V
    return replace(battery, voltage_v=max(volts, VOLTAGE_STEP_V), voltage_empty_v=None, cells=None, chemistry=None)


def _lasting_s(power_w: FloatArray, head: int, step_s: float, spare: float, battery: Battery) -> float:
    """Time that a state of charge, `spare`, lasts [s] under a power at each step [W], shape (n,).

    The first `head` steps are flown once, and the steps after them, which are one period, again and again. 0 where a
    power is more than the battery delivers; infinite where a period takes no charge.

    Source: letter, Eq. 22 and Lem. III.3.
    """
    if (power_w > battery.max_power_w(battery.voltage_v)).any():
        return 0.0
    drops = (battery.drain_per_s(power_w, battery.voltage_v) * step_s).cumsum()
    # charge taken by the first steps, and by one period; whole periods are divided out, so that the rest of the charge
    # runs out within the steps
    first, one_period = float(drops[head - 1]), float(drops[-1] - drops[head - 1])
    if spare > drops[-1] and one_period <= 0:
        return math.inf
    whole = (spare - first) // one_period if spare > drops[-1] else 0.0
    return whole * (len(power_w) - head) * step_s + _crossing_s(drops, spare - whole * one_period, step_s)


def _crossing_s(sums: FloatArray, value: float, step_s: float) -> float:
    """Time at which a growing sum reaches a value [s]; `sums` are at the ends of the steps, and linear in between."""
    ends_s = np.arange(len(sums) + 1) * step_s
    return float(np.interp(value, np.concatenate([[0.0], sums]), ends_s))


class _Coverage(NamedTuple):
    """The whole coverage: its times t̲ and t̄ at the lowest and the highest path parameters [s], and their sets."""

    at_lowest_s: float
    at_highest_s: float
    boxes: list[Box]

    @property
    def whole_s(self) -> float:
        """The longer one of its times [s]."""
        return max(self.at_lowest_s, self.at_highest_s)

    def controls_s(self, parameters: Vector) -> list[float]:
        """The coverage time that each path parameter stands for, û = ν c + τ [s]: their sum is that of the coverage.

        Linear from t̲/ρ at the parameter's lowest value to t̄/ρ at its highest, with ρ path parameters.

        Source: letter, Eq. 10.
        """
        rho = len(self.boxes)
        ends_s = self.at_lowest_s / rho, self.at_highest_s / rho
        scalings = [scaling_factors(box.lo, box.hi, *ends_s) for box in self.boxes]
        return [nu * value + tau for (nu, tau), value in zip(scalings, parameters[:rho], strict=True)]


def _coverage(settings: PaperSettings, mission: Mission) -> _Coverage | None:
    """The whole coverage of a mission: its times by the settings, else nominal at cruise speed without wind.

    None if no path parameter is free, or the nominal path is undefined or without end.
    """
    boxes = [mission.plan.hull(i) for i in range(mission.plan.path_count)]
    if all(box.fixed for box in boxes):
        return None
    times_s = []
    for time_s, end in ((settings.shortest_s, "lo"), (settings.longest_s, "hi")):
        if time_s is None:
            parameters = (*(getattr(box, end) for box in boxes), *mission.parameters[len(boxes) :])
            try:
                length_m = sum(leg.distance_m for leg in nominal_legs(mission.plan, parameters, mission.start_m))
            except PathUndefined:
                return None
            time_s = length_m / mission.cruise_mps
        if not math.isfinite(time_s):
            return None
        times_s.append(time_s)
    return _Coverage(times_s[0], times_s[1], boxes)

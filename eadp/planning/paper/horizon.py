"""Optimal control of the computations over a receding horizon: continuous relaxation and integer solution.

The periodic motion power is exogenous (B touches α0 only), so the states drop out of the problem. The variables are
the computations' parameters at each step of the horizon, z ∈ [0, 1] of their sets, coupled by the state of charge.

    maximise   Σ_m l(c_m)                                     convex in c: linearised round a plan, repeated
    subject to y_m = h_m + g(c_m) ≤ b_m · Q_c V crate         the output constraint, at each step
               b_m = b_0 − Σ_{j≤m} k_b I(h̄_j + g(c_j)) Δ/Q_c  the battery
               R c_m − r ≥ 0                                  trade-offs

y ≥ 0 needs no row: computations only add power.

The relaxation is solved by sequential QPs. For one computation a closed form is often optimal, certified by its
multipliers: then it is the bound at which the QPs from the last plan stop, and the solution if they fail. Steps are
coupled by the charge only, so branch and bound finds the integer solution: each choice has a power, a use of charge and
a value.

Source: letter, Eq. 16 and Def. III.3; drafts 003 and 004 for the trade-offs and for the subroutine that
lowers by δ.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.flight.battery import current_slope_a_per_w, currents_a
from eadp.core.signals.scaling import computation_scaling
from eadp.errors import Infeasible, SolverFailed
from eadp.models.battery import Battery
from eadp.planning.base import thinned
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

Table = list[list[float]]
Numbers = Any

CONTROL, POWER, QUADRATIC, OUTPUT = "control", "power", "quadratic", "output"
COSTS = (CONTROL, POWER, QUADRATIC, OUTPUT)
PROXIMAL = (0.03, 0.3)
"""Proximal weights for a gradient scaled to 1: the first needs few QPs, the second is used if OSQP fails."""

MAX_QPS = 25
"""Maximum number of QPs of one ascent."""

MAX_CHORD_QPS = 4
"""Maximum number of QPs of the ascent along chords that finds a starting point."""

STATIONARY = 1e-7
"""Movement, as a share of its set, below which a plan is stationary."""

REACHED = 1e-7
"""Relative tolerance within which QPs have reached the certified optimum."""

SAME = 1e-10
"""Relative tolerance of equal objectives."""

FEASIBLE_W = 1e-6
"""Excess of power that counts as rounding [W]."""

FLOOR_SLACK = 1e-4
"""Tolerance, as a share of the span of power, within which a relaxed value counts as its next level above."""

CHOICES = 4096
"""Maximum number of combinations of levels; above it, every second level of the longest list is dropped."""

WORK = 20_000
"""Maximum number of steps that branch and bound visits; its first descent is feasible and nearly always optimal."""

TIGHTEST = 1e-5
"""Smallest scaling of a parameter, as a share of its set."""

DELIVERED = 0.99
"""Limit of a starting point, as a share of the current of maximum power, where slopes are infinite."""

BEND = 1e-9
"""Relative tolerance of collinear knots."""

DIFFERENCE = 1e-4
"""Step of finite differences, as a share of the set."""


@dataclass(frozen=True)
class ComputationLevels:
    """Sets, levels and power of the computations.

    Parameters
    ----------
    low, high : array, shape (σ,)
        Their sets.
    levels : sequence of σ tuples
        Levels of each, in ascending order.
    power : function (c of shape (σ,)) → g(c) [W]

    Attributes
    ----------
    knots, values : list of float
        One computation: knots and values [W] of g, piecewise linear between its levels and the ends of its set.
        Several: empty.
    """

    low: FloatArray
    high: FloatArray
    levels: Sequence[tuple[float, ...]]
    power: Callable[[Sequence[float]], float]
    knots: list[float] = field(init=False)
    values: list[float] = field(init=False)

    def __post_init__(self) -> None:
        points: list[float] = []
        if len(self.low) == 1:
            points = sorted({float(self.low[0]), *map(float, self.levels[0]), float(self.high[0])})
        knots, values = _bends(points, [self.power([point]) for point in points])
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "values", values)

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray]:
        return np.array(self.knots), np.array(self.values)

    @cached_property
    def _slopes(self) -> FloatArray:
        """Of each linear piece [W per unit]."""
        return np.diff(self.values) / np.diff(self.knots)

    @property
    def count(self) -> int:
        """σ."""
        return len(self.low)

    def power_w(self, c: FloatArray) -> FloatArray:
        """g [W], shape (M,), at parameters of shape (M, σ)."""
        if self.count == 1:
            return np.interp(c[:, 0], *self._table)
        return np.array([self.power(row) for row in c.tolist()])

    def slopes_w(self, c: FloatArray, side: int = 1) -> FloatArray:
        """∂g/∂c [W per unit], shape (M, σ), at parameters of that shape.

        Where g bends: of the piece above for side 1, of the piece below for side −1.
        """
        if self.count > 1:
            return self._differences(c, side)
        if len(self._slopes) < 2:
            return np.full_like(c, self._slopes[0] if len(self._slopes) else 0.0)
        return self._slopes[self.pieces(c, side), None]

    def pieces(self, c: FloatArray, side: int = 1) -> IntArray:
        """One computation: index of each step's linear piece, shape (M,); at a knot, of the one on a side."""
        nudge = side * BEND * (self.knots[-1] - self.knots[0])
        return np.clip(np.searchsorted(self.knots, c[:, 0] + nudge, "right") - 1, 0, len(self.knots) - 2)

    def _differences(self, c: FloatArray, side: int) -> FloatArray:
        step = DIFFERENCE * (self.high - self.low)
        power, slopes = self.power_w(c), np.zeros_like(c)
        for k in np.flatnonzero(step):
            there = c[:, k] + side * step[k]
            by = np.where((there < self.low[k]) | (there > self.high[k]), -side, side) * step[k]
            moved = c.copy()
            moved[:, k] += by
            slopes[:, k] = (self.power_w(moved) - power) / by
        return slopes


@dataclass(frozen=True)
class HorizonForecast:
    """Forecast of motion power and charge over the horizon.

    Parameters
    ----------
    limit_motion_w, mean_motion_w : array, shape (M,)
        Motion power at the instant of each step where the output constraint is checked, and its mean over the
        step, 0 or more [W].
    soc : float
    step_s : float
        Length of a step [s].
    level_w, ripple_w2 : float
        α0 of the motion [W] and the sum of its squared harmonics [W²], which costs `power` and `quadratic`
        count; the second only shifts them.
    """

    limit_motion_w: FloatArray
    mean_motion_w: FloatArray
    soc: float
    step_s: float
    level_w: float = 0.0
    ripple_w2: float = 0.0


@dataclass(frozen=True)
class HorizonSolution:
    """A solution: the parameters at each step, shape (M, σ), relaxed and on their levels.

    `qp_solves` is the number of QPs, 0 where the certified closed form is the solution.
    """

    relaxed: FloatArray
    chosen: FloatArray
    objective: float
    relaxed_objective: float
    qp_solves: int

    @property
    def gap(self) -> float:
        """Relative gap between the relaxed and the integer objective."""
        return (self.relaxed_objective - self.objective) / max(abs(self.relaxed_objective), 1e-12)


class Horizon:
    """The optimal control problem for one set of computations and one number of steps: built once, solved many times.

    Parameters
    ----------
    computations : Computations
    battery : Battery
    steps : int
        M.
    cost : str
        `control`, `power`, `quadratic` or `output`.
    trade_offs : sequence of (R row of shape (σ,), r)
        Rows R c − r ≥ 0; contributions of other parameters are in r.
    weights : (float, float)
        Q and R of cost `quadratic`, as multiples of the identity.
    """

    def __init__(
        self,
        computations: ComputationLevels,
        battery: Battery,
        steps: int,
        cost: str = CONTROL,
        trade_offs: Sequence[tuple[Sequence[float], float]] = (),
        weights: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        self._c = computations
        self._battery = battery
        self._steps = steps
        self._cost = cost
        self._weights = weights
        self._rows = np.array([row for row, _ in trade_offs], dtype=float).reshape(-1, computations.count)
        self._min_rows = np.array([r for _, r in trade_offs], dtype=float)
        self._width = computations.high - computations.low
        # the minimum parameters, and each alone at its maximum
        ends = computations.low + np.vstack([np.zeros(computations.count), np.diag(self._width)])
        self._end_powers = np.array([computations.power(end.tolist()) for end in ends])
        self._nu, self._tau = _separate(computations.low, self._width, self._end_powers)
        self._end_controls = ((self._nu * ends + self._tau) ** 2).sum(axis=1)
        self._last: FloatArray | None = None
        self._list_choices()
        values = computations.values
        self._increasing = len(values) > 1 and all(a < b for a, b in itertools.pairwise(values))
        powers = [*values, *self._powers.tolist(), 0.0]
        self._span_w = max(powers) - min(powers) or 1.0
        self._build_program()

    def _list_choices(self) -> None:
        """Every combination of levels that satisfies the trade-offs, in order of power."""
        choices = np.array(list(itertools.product(*thinned(self._c.levels, CHOICES))), dtype=float)
        choices = choices[(choices @ self._rows.T >= self._min_rows - _slack(self._min_rows)).all(axis=1)]
        powers = np.array([self._c.power(choice.tolist()) for choice in choices], dtype=float)
        order = np.argsort(powers, kind="stable")
        self._choices: FloatArray = choices[order]
        self._powers: FloatArray = powers[order]
        self._controls = ((self._nu * self._choices + self._tau) ** 2).sum(axis=1)

    def _build_program(self) -> None:
        """Constant rows of the QP: boxes, then powers (each with every step until then), then trade-offs."""
        steps, count, extra = self._steps, self._c.count, len(self._rows)
        size = steps * count
        self._until = np.repeat(np.tril(np.ones((steps, steps))), count, axis=1)
        self._at = np.repeat(np.eye(steps), count, axis=1)
        balances = np.kron(np.eye(steps), self._rows * self._width)
        self._matrix = np.vstack([np.eye(size), np.zeros((steps, size)), balances])
        trades = np.kron(np.eye(steps), np.ones_like(self._rows))
        filled = np.vstack([np.eye(size), self._until, trades]) > 0
        self._programs = [(proximal, QuadraticProgram(filled, proximal)) for proximal in PROXIMAL]
        minimum = np.tile(self._min_rows - self._rows @ self._c.low, steps)
        self._lower = np.concatenate([np.zeros(size), np.full(steps, -UNBOUNDED), minimum])
        self._upper = np.concatenate([np.ones(size), np.zeros(steps), np.full(steps * extra, UNBOUNDED)])

    # --- the model

    def objective(self, c: FloatArray, forecast: HorizonForecast) -> float:
        """Σ_m l(c_m) at parameters of shape (M, σ)."""
        controls = ((self._nu * c + self._tau) ** 2).sum(axis=1)
        return float(self._stage_value(controls, self._c.power_w(c), forecast.limit_motion_w, forecast).sum())

    def excess_w(self, c: FloatArray, forecast: HorizonForecast) -> FloatArray:
        """How far each step's power is above what the battery allows [W], shape (M,); no trade-offs.

        Raises
        ------
        Infeasible
            If the battery cannot deliver the power at all.
        """
        g = self._c.power_w(c)
        b = self._battery
        current = currents_a(forecast.mean_motion_w + g, b.voltage_v, b.resistance_ohm)
        allowed = b.power_per_soc_w * (forecast.soc - self._soc_per_a(forecast) * np.cumsum(current))
        result: FloatArray = forecast.limit_motion_w + g - allowed
        return result

    def feasible(self, c: FloatArray, forecast: HorizonForecast) -> bool:
        """Whether every constraint holds at parameters of shape (M, σ), to 1e-6 W."""
        try:
            powers = bool((self.excess_w(c, forecast) <= FEASIBLE_W).all())
        except Infeasible:
            return False
        return powers and bool((c @ self._rows.T >= self._min_rows - _slack(self._min_rows)).all())

    def _soc_per_a(self, forecast: HorizonForecast) -> float:
        """What a step takes off the state of charge for each ampere: k_b Δ/Q_c [1/A]."""
        return self._battery.k_b_per_s * forecast.step_s / self._battery.capacity_ah

    def _stage_value(self, controls: Numbers, g: Numbers, limit: Numbers, forecast: HorizonForecast) -> Numbers:
        """l from Σû² of the computations [W²], their power and the motion's [W]; numbers, or arrays that fit."""
        if self._cost == OUTPUT:
            # l = ½y²
            return 0.5 * (limit + g) ** 2
        if self._cost == CONTROL:
            return controls
        # l = ½(q + Bu)ᵀ diag(C) (q + Bu), or with Q for diag(C) and ½uᵀRu beside it
        power = 0.5 * ((forecast.level_w + g) ** 2 + forecast.ripple_w2)
        q, r = self._weights
        return power if self._cost == POWER else q * power + 0.5 * r * controls

    def _gain(
        self, nu: Numbers, control: Numbers, g: Numbers, slope: Numbers, limit: Numbers, forecast: HorizonForecast
    ) -> Numbers:
        """∂l/∂c from ν, û, g and ∂g/∂c; numbers, or arrays that fit."""
        if self._cost == OUTPUT:
            return (limit + g) * slope
        if self._cost == CONTROL:
            return 2 * nu * control
        power = (forecast.level_w + g) * slope
        q, r = self._weights
        return power if self._cost == POWER else q * power + r * nu * control

    # --- solution

    def solve(self, forecast: HorizonForecast) -> HorizonSolution:
        """The integer solution and the relaxation.

        Raises
        ------
        Infeasible
            If the levels of minimum power are infeasible.
        SolverFailed
            If the solver failed; the caller's fallback is `lowered`.
        """
        made, objective, whole = self._search(forecast)
        chosen = self._choices[made]
        relaxed, best, qp_solves = self._reals(chosen, objective, forecast)
        if not whole:
            chosen, objective = self._floored(relaxed, chosen, objective, forecast)
        if objective > best:
            relaxed, best = chosen, objective
        return HorizonSolution(relaxed, chosen, objective, best, qp_solves)

    def _reals(self, chosen: FloatArray, objective: float, forecast: HorizonForecast) -> tuple[FloatArray, float, int]:
        """The relaxed solution, its objective and the number of QPs."""
        starts = [chosen]
        if self._increasing and not len(self._rows):
            steps = self._fill_greedy(forecast)
            filled, value = np.array([[step.c] for step in steps]), sum(step.value for step in steps)
            if value >= objective - SAME * abs(objective) and _is_optimal(steps):
                return self._ascent_to(value, filled, chosen, forecast)
            starts.append(filled)
        return self._best_ascent(starts, forecast)

    def _ascent_to(
        self, value: float, filled: FloatArray, chosen: FloatArray, forecast: HorizonForecast
    ) -> tuple[FloatArray, float, int]:
        """The relaxed solution by QPs from the last plan, given a certified optimum.

        The ascent stops at the optimum. If it ends below, or OSQP fails, the certified plan is the solution.
        """
        target = value - REACHED * abs(value)
        start = chosen if self._last is None or not self.feasible(self._last, forecast) else self._last
        relaxed, best, qp_solves = filled, value, 0
        with contextlib.suppress(SolverFailed, Infeasible):
            top, reached, qp_solves = self._ascent(start, forecast, target=target)
            if reached >= target:
                relaxed, best = top, reached
        self._last = relaxed
        return relaxed, best, qp_solves

    def _best_ascent(self, starts: list[FloatArray], forecast: HorizonForecast) -> tuple[FloatArray, float, int]:
        """The best of the local maxima reached from several plans: with little charge there are many.

        Raises
        ------
        SolverFailed
            If OSQP fails from each.
        """
        qp_solves, maxima, failures = 0, [], []
        minimum = np.tile(self._choices[0], (self._steps, 1))
        for start, chords in (*((start, None) for start in starts), (minimum, self._chords(forecast))):
            try:
                first, _, chord_qps = (start, 0.0, 0) if chords is None else self._ascent(start, forecast, chords)
                top, value, more = self._ascent(first, forecast)
            except (SolverFailed, Infeasible) as error:  # a QP around a feasible plan is feasible
                failures.append(str(error))
                continue
            maxima.append((value, top))
            qp_solves += chord_qps + more
        if not maxima:
            raise SolverFailed(failures[0])
        best, relaxed = max(maxima, key=lambda top: top[0])
        return relaxed, best, qp_solves

    # --- integer solution

    def _search(self, forecast: HorizonForecast) -> tuple[list[int], float, bool]:
        """The best choice for each step, their value, and whether the search completed.

        Charge is relative to choices of minimum power at every step so far, so that the charge needed by a choice does
        not depend on the choices before it.
        """
        if not len(self._choices):
            raise Infeasible("no values of the computations satisfy the trade-offs")
        b, limit = self._battery, forecast.limit_motion_w[:, None]
        total = forecast.mean_motion_w[:, None] + self._powers
        under_root = b.voltage_v**2 - 4 * b.resistance_ohm * total
        # Δb = k_b I(y) Δ/Q_c
        drop = total / (b.voltage_v + np.sqrt(np.maximum(under_root, 0.0))) * (2 * self._soc_per_a(forecast))
        beyond = drop - drop[:, :1]
        needed = (limit + (self._powers - FEASIBLE_W)) / b.power_per_soc_w + beyond
        needed += np.cumsum(drop[:, 0])[:, None]
        needed[under_root < 0] = math.inf
        # minimum power must stay feasible: a choice needs the charge of the later steps, and its own use
        later = np.maximum.accumulate(needed[::-1, 0])[::-1]
        if not later[0] <= forecast.soc:
            if math.isnan(later[0] + forecast.soc):
                raise SolverFailed("a forecast that is not finite")
            raise Infeasible("even the computations of minimum power exceed what the battery allows")
        needed[:-1] = np.maximum(needed[:-1], later[1:, None] + beyond[:-1])
        stage_values = np.asarray(self._stage_value(self._controls, self._powers, limit, forecast))
        top = np.maximum.accumulate(stage_values, axis=-1).tolist()
        maxima = top if stage_values.ndim == 2 else [top] * self._steps
        return _Search(needed.tolist(), beyond.tolist(), maxima).best(forecast.soc)

    def _floored(
        self, relaxed: FloatArray, chosen: FloatArray, objective: float, forecast: HorizonForecast
    ) -> tuple[FloatArray, float]:
        """After an incomplete search: the best choices within the relaxed power, if better than those found."""
        limit = forecast.limit_motion_w[:, None]
        stage_values = np.asarray(self._stage_value(self._controls, self._powers, limit, forecast))
        power = self._c.power_w(relaxed)[:, None]
        for slack in (FLOOR_SLACK * self._span_w, 0.0):
            made = np.where(self._powers <= power + slack, stage_values, -math.inf).argmax(axis=1)
            plan = self._choices[made]
            value = self.objective(plan, forecast)
            if value > objective and self.feasible(plan, forecast):
                return plan, value
        return chosen, objective

    # --- continuous relaxation

    def _fill_greedy(self, forecast: HorizonForecast) -> list[_Step]:
        """Greedy filling for one computation: each step uses the power left by its limit and the later minimum.

        Exact for the nonlinear battery: with I the current, y = V I − R I², so the limit is a quadratic in I.
        """
        b, knots, values = self._battery, self._c.knots, self._c.values
        volt, ohm, rate, per_soc = b.voltage_v, b.resistance_ohm, self._soc_per_a(forecast), b.power_per_soc_w
        nu, tau, sag = float(self._nu[0]), float(self._tau[0]), per_soc * rate
        soc, steps = forecast.soc, []
        limits, means = forecast.limit_motion_w.tolist(), forecast.mean_motion_w.tolist()
        for limit, mean, rest in zip(limits, means, self._rests(limits, means, rate), strict=True):
            # g + sag·I = b Q_c V crate − h =: left  →  R I² − (V + sag) I + left + h̄ = 0
            left = per_soc * soc - limit
            under_root = max((volt + sag) ** 2 - 4 * ohm * (left + mean), 0.0)
            amps = own = 2 * (left + mean) / (volt + sag + math.sqrt(under_root))
            if rate * amps > soc - rest:
                amps = (soc - rest) / rate
            if 2 * ohm * amps > DELIVERED * volt:
                amps = DELIVERED * volt / (2 * ohm)
            power = max(amps * (volt - ohm * amps) - mean, values[0])
            full = power >= values[-1]
            power = min(power, values[-1])
            i = bisect_right(values, power, hi=len(values) - 1) - 1
            slope = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
            c = knots[i] + (power - values[i]) / slope
            control = nu * c + tau
            value = self._stage_value(control * control, power, limit, forecast)
            gain = self._gain(nu, control, power, slope, limit, forecast) / slope
            root = math.sqrt(volt * volt - 4 * ohm * (mean + power))
            # κ = Q_c V crate · k_b Δ/Q_c · dI/dy
            steps.append(_Step(c, value, gain, sag / root, full, full or amps == own))
            soc -= rate * 2 * (mean + power) / (volt + root)
        return steps

    def _rests(self, limits: list[float], means: list[float], rate: float) -> list[float]:
        """The charge that must remain after each step for minimum power in the later ones."""
        b, minimum, per_soc = self._battery, self._c.values[0], self._battery.power_per_soc_w
        rest, rests = -math.inf, []
        for limit, mean in zip(reversed(limits), reversed(means), strict=True):
            rests.append(rest)
            rest = max(rest, (limit + minimum) / per_soc) + rate * b.current_a(mean + minimum)
        return rests[::-1]

    def _chords(self, forecast: HorizonForecast) -> FloatArray:
        """Chord slope of l over each parameter's set, the others at their minimum, shape (M, σ).

        A convex l is nowhere above its chord: an ascent along chords does not stop at the nearest local maximum.
        """
        limit = forecast.limit_motion_w[:, None]
        ends = np.asarray(self._stage_value(self._end_controls, self._end_powers, limit, forecast))
        ends = np.broadcast_to(ends, (self._steps, self._c.count + 1))
        chords: FloatArray = (ends[:, 1:] - ends[:, :1]) / np.where(self._width > 0, self._width, math.inf)
        return chords

    def _ascent(
        self, c: FloatArray, forecast: HorizonForecast, chords: FloatArray | None = None, target: float = math.inf
    ) -> tuple[FloatArray, float, int]:
        """Ascent by QPs from a feasible plan to a stationary one, or to the objective `target`: plan, value, QPs.

        Slopes above and below alternate, so that a plan leaves a knot of g on the better side. With chords, a few QPs
        along them.
        """

        def value_of(plan: FloatArray) -> float:
            return self.objective(plan, forecast) if chords is None else float((chords * plan).sum())

        max_qps = MAX_QPS if chords is None else MAX_CHORD_QPS
        sides = 1 if len(self._c.knots) == 2 else 2
        value = value_of(c)
        still = qp_solves = 0
        while still < sides and qp_solves < max_qps:
            qp_solves += 1
            new = self._qp_step(c, 1 if qp_solves % 2 else -1, forecast, chords)
            before = value
            c, value = self._line_search(c, new, value, value_of, forecast)
            if value >= target:
                break
            still = still + 1 if value - before <= SAME * abs(value) else 0
        return c, value, qp_solves

    def _qp_step(self, c: FloatArray, side: int, forecast: HorizonForecast, chords: FloatArray | None) -> FloatArray:
        """One QP around a plan: linearised rows and gradient, and a proximal term."""
        z = np.divide(c - self._c.low, self._width, out=np.zeros_like(c), where=self._width > 0).ravel()
        gradient, rows, left = self._linearised(c, z, side, forecast)
        lower, upper = self._bounds(c, side)
        if chords is not None:
            gradient = (chords * self._width).ravel()
            lower, upper = self._lower.copy(), self._upper.copy()
        upper[z.size : z.size + len(left)] = left
        matrix = self._matrix.copy()
        matrix[z.size : z.size + len(left)] = rows
        # each parameter is scaled by its reach, each row then by its largest entry
        reach = _reach(rows, left)
        matrix *= reach
        units = np.abs(matrix).max(axis=1)
        units[units == 0] = 1.0
        gradient *= reach
        gradient /= max(float(np.abs(gradient).max()), 1e-12)
        solution = self._nearest(gradient, matrix / units[:, None], lower / units, upper / units, z / reach)
        return self._c.low + np.clip(solution * reach, 0.0, 1.0).reshape(c.shape) * self._width

    def _linearised(
        self, c: FloatArray, z: FloatArray, side: int, forecast: HorizonForecast
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gradient by z, shape (Mσ,), and power rows, shape (M, Mσ), with their slack, in shares of g's span."""
        b = self._battery
        g, slopes = self._c.power_w(c), self._c.slopes_w(c, side)
        control, limit = self._nu * c + self._tau, forecast.limit_motion_w[:, None]
        gain = np.asarray(self._gain(self._nu, control, g[:, None], slopes, limit, forecast))
        total = forecast.mean_motion_w + g
        # ∂y_m/∂z_m, and κ_m ∂y_m/∂z_m: its reduction of its own limit and every later one
        sag = b.power_per_soc_w * self._soc_per_a(forecast)
        own = slopes * self._width / self._span_w
        drain = sag * current_slope_a_per_w(total, b.voltage_v, b.resistance_ohm)[:, None] * own
        rows = self._at * own.ravel() + self._until * drain.ravel()
        used = sag * np.cumsum(currents_a(total, b.voltage_v, b.resistance_ohm))
        left = (b.power_per_soc_w * forecast.soc - forecast.limit_motion_w - g - used) / self._span_w
        return (gain * self._width).ravel(), rows, left + rows @ z

    def _nearest(
        self, gradient: FloatArray, matrix: FloatArray, lower: FloatArray, upper: FloatArray, point: FloatArray
    ) -> FloatArray:
        """The QP's minimiser with the smallest proximal weight that OSQP solves."""
        for proximal, program in self._programs:
            try:
                return program.solve(-gradient - proximal * point, matrix, lower, upper, point)
            except SolverFailed as error:
                failure = error
        raise failure

    def _bounds(self, c: FloatArray, side: int) -> tuple[FloatArray, FloatArray]:
        """Bounds of the rows; each step stays on its linear piece of g."""
        lower, upper = self._lower.copy(), self._upper.copy()
        if len(self._c.knots) > 2:
            share = (np.array(self._c.knots) - self._c.low) / self._width
            piece = self._c.pieces(c, side)
            lower[: self._steps], upper[: self._steps] = share[piece], share[piece + 1]
        return lower, upper

    def _line_search(
        self,
        c: FloatArray,
        new: FloatArray,
        value: float,
        value_of: Callable[[FloatArray], float],
        forecast: HorizonForecast,
    ) -> tuple[FloatArray, float]:
        """Line search from the plan c to the QP's solution: a feasible plan of greater value, else c."""
        if np.abs(new - c).max() <= STATIONARY * self._width.max():
            return c, value
        # slightly less power compensates for the solver's tolerance and the battery's curvature
        less = (new + share * (self._choices[0] - new) for share in (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4))
        nearer = (c + share * (new - c) for share in (0.5, 0.2, 0.05, 0.01))
        for trial in itertools.chain(less, nearer):
            found = value_of(trial)
            if found > value and self.feasible(trial, forecast):
                return np.asarray(trial), found
        return c, value

    # --- the fallback

    def lowered(self, now: FloatArray, deltas: FloatArray, forecast: HorizonForecast) -> FloatArray:
        """Fallback of a failed solve: lower the parameters in force by δ until every constraint holds.

        Parameters
        ----------
        now, deltas : array, shape (σ,)

        Returns
        -------
        array, shape (M, σ)
            The same values at every step.

        Raises
        ------
        Infeasible
            If the minimum parameters are infeasible.

        Source: drafts 003 and 004, the subroutine of their algorithms.
        """
        c = np.clip(now, self._c.low, self._c.high)
        while True:
            value = np.array([_round_down(levels, x) for levels, x in zip(self._c.levels, c, strict=True)])
            plan = np.tile(value, (self._steps, 1))
            if self.feasible(plan, forecast):
                return plan
            if (c <= self._c.low).all():
                raise Infeasible("even the minimum parameters are infeasible")
            c = np.maximum(c - deltas, self._c.low)


class _Step(NamedTuple):
    """A filled step: computation, l, ∂l/∂y, κ; whether it is at its maximum, and whether at its own limit."""

    c: float
    value: float
    gain: float
    takes: float
    full: bool
    free: bool


def _is_optimal(steps: Sequence[_Step]) -> bool:
    """Whether steps at their maximum or at their own limits have multipliers of 0 or more: a local optimum.

    Backwards: one more watt at step m gains ∂l/∂y, and lowers its own limit and every later one by κ_m.
    """
    later = 0.0
    for step in reversed(steps):
        net = step.gain - step.takes * later
        if net < 0 or not step.free:
            return False
        if not step.full:
            later += net / (1 + step.takes)
    return True


class _Search:
    """Branch and bound over the choices at each step.

    Parameters
    ----------
    needed, beyond, top : tables of M rows, one entry for each choice, in order of power
        Charge that each needs, and its use of that; running maximum of the value. The first two ascend along a row.

    A choice of no greater value than one of less power is dominated: `top` shows which are not.
    """

    def __init__(self, needed: Table, beyond: Table, top: Table) -> None:
        self._needed, self._beyond, self._top = needed, beyond, top

    def best(self, charge: float) -> tuple[list[int], float, bool]:
        """One index for each step, their value, and whether it is certified as optimal.

        The usual case ends with the first descent, which meets the bound.
        """
        made, value = self._descent(charge)
        enough = value + SAME * abs(value)
        if self._bound(0, charge, enough) <= enough:
            return made, value, True
        return self._branched(charge, made, value)

    def _descent(self, charge: float) -> tuple[list[int], float]:
        """Greedy: at each step the choice of greatest value that the charge admits."""
        made, value = [], 0.0
        for needed, beyond, top in zip(self._needed, self._beyond, self._top, strict=True):
            i = bisect_left(top, top[bisect_right(needed, charge) - 1])
            made.append(i)
            value += top[i]
            charge -= beyond[i]
        return made, value

    def _bound(self, first: int, charge: float, enough: float) -> float:
        """Upper bound of the value of the steps from `first` on, or a number up to `enough` if that is less.

        At first each step is bounded as if those before it had used nothing. A plan better than `enough` forgoes at
        most the difference and so uses almost as much charge, which tightens the bound.
        """
        steps = range(first, len(self._needed))
        bound = spared = math.inf
        while True:
            total, left = 0.0, charge
            for k in steps:
                needed, top = self._needed[k], self._top[k]
                i = bisect_right(needed, min(charge, left + spared)) - 1
                if i < 0:
                    return -math.inf
                total += top[i]
                left -= self._beyond[k][bisect_left(top, top[i])]
            if total <= enough or bound - total < 1e-3 * (bound - enough):
                return total
            bound, spared = total, self._charge_per_value * (total - enough)

    @cached_property
    def _charge_per_value(self) -> float:
        """Largest charge saved per value forgone, at any step."""
        rate = 0.0
        for beyond, top in zip(self._beyond, self._top, strict=True):
            last = 0
            for i in range(1, len(top)):
                if top[i] > top[last]:
                    rate = max(rate, (beyond[i] - beyond[last]) / (top[i] - top[last]))
                    last = i
        return rate

    def _branched(self, charge: float, made: list[int], best: float) -> tuple[list[int], float, bool]:
        """A plan of greater value, if there is one: depth first, from the choices of greatest value down."""
        steps, work = len(self._needed), 0
        stack: list[tuple[tuple[int, ...], float, float]] = [((), charge, 0.0)]
        while stack and work < WORK:
            work += steps
            chain, charge, value = stack.pop()
            m = len(chain)
            enough = best + SAME * abs(best) - value
            if self._bound(m, charge, enough) <= enough:
                continue
            if m == steps:
                made, best = [*chain], value
                continue
            top, branches = self._top[m], []
            i = bisect_right(self._needed[m], charge) - 1
            while i >= 0:
                i = bisect_left(top, top[i])
                branches.append(((*chain, i), charge - self._beyond[m][i], value + top[i]))
                i -= 1
            stack.extend(reversed(branches))
        return made, best, not stack


def _bends(points: list[float], values: list[float]) -> tuple[list[float], list[float]]:
    """Knots and values of a piecewise linear function without collinear ones."""
    knots, kept = points[:1], values[:1]
    for i in range(1, len(points)):
        if i < len(points) - 1:
            share = (points[i] - knots[-1]) / (points[i + 1] - knots[-1])
            straight = kept[-1] + share * (values[i + 1] - kept[-1])
            if abs(values[i] - straight) <= BEND * max(abs(value) for value in values):
                continue
        knots.append(points[i])
        kept.append(values[i])
    return knots, kept


def _reach(rows: FloatArray, left: FloatArray) -> FloatArray:
    """Reach of each column: the share of its set by which it could move if it alone used the slack of the rows.

    With little charge the reach is small; without this scaling OSQP stalls.
    """
    shares = np.divide(left[:, None], rows, out=np.ones_like(rows), where=rows > 0)
    reach: FloatArray = np.clip(shares.min(axis=0), TIGHTEST, 1.0)
    return reach


def _slack(rows: FloatArray) -> FloatArray:
    return 1e-9 * (1 + np.abs(rows))


def _round_down(levels: Sequence[float], value: float) -> float:
    below = [level for level in levels if level <= value + 1e-9]
    return below[-1] if below else levels[0]


def _separate(low: FloatArray, width: FloatArray, end_powers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ν and τ of each computation (letter, Eq. 11), the others at their lowest.

    Their common power there is shared evenly.
    """
    share = end_powers[0] / len(low)
    scaled = [
        computation_scaling(bottom, bottom + span, share, share + (end - end_powers[0]))
        for bottom, span, end in zip(low, width, end_powers[1:], strict=True)
    ]
    return np.array([nu for nu, _ in scaled]), np.array([tau for _, tau in scaled])

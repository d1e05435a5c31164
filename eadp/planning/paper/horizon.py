"""The computations over a receding horizon: the optimal control problem, as reals and as integers.

The periodic motion power is exogenous (B touches α0 only), so the states drop out of the problem: what is
left are the computations' parameters at each step of the horizon, z ∈ [0, 1] of their sets, coupled by the
state of charge alone.

    maximise   Σ_m l(c_m)                                     convex in c: linearised round a plan, repeated
    subject to y_m = h_m + g(c_m) ≤ b_m · Q_c V crate         the output constraint, at each step
               b_m = b_0 − Σ_{j≤m} k_b I(h̄_j + g(c_j)) Δ/Q_c  the battery
               R c_m − r ≥ 0                                  trade-offs

y ≥ 0 needs no row: no choice of computations makes a power negative that is not so without them.

The reals come from a sequence of QPs that climbs to them. For one computation a closed form often tells them, with
multipliers that prove it: then it is taken, or, where QPs are asked for, their climb from the last plan ends there.
Steps share nothing but charge, so values that computations may take are searched, not only rounded to: of each
choice only its power, its charge and its worth matter.

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
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

Table = list[list[float]]
Numbers = Any

CONTROL, POWER, QUADRATIC, OUTPUT = "control", "power", "quadratic", "output"
COSTS = (CONTROL, POWER, QUADRATIC, OUTPUT)
PROXIMAL = (0.03, 0.3)
"""Of a gradient scaled to 1: little takes few QPs, more is for those that OSQP does not solve then."""

PASSES = 25
"""Most QPs of a climb."""

SKETCHES = 4
"""Most QPs that find where to climb from."""

STILL = 1e-7
"""Share of its set that a parameter may move in a plan that stands still."""

REACHED = 1e-7
"""Share of an objective by which QPs may end below what is proven to be the best."""

SAME = 1e-10
"""Share of an objective that makes no difference."""

FEASIBLE_W = 1e-6
"""Power above the limit that is taken for rounding."""

FLOOR_SLACK = 1e-4
"""Share of the span of power that the solver's reals may lie below a level that they mean."""

CHOICES = 4096
"""Most combinations of levels that are looked at; of more, every second level of the longest is left out."""

WORK = 20_000
"""Steps that a search may look at; its first descent is feasible, and nearly always the best."""

TIGHTEST = 1e-5
"""Smallest share of its set that a parameter is measured in."""

DELIVERED = 0.99
"""Share of the current of greatest power that the climb starts from at most: slopes are infinite there."""

BEND = 1e-9
"""Share of a function's range below which it does not bend."""

DIFFERENCE = 1e-4
"""Share of its set by which a parameter is moved to tell a slope."""


@dataclass(frozen=True)
class ComputationLevels:
    """The computations that may be chosen now.

    Parameters
    ----------
    low, high : array, shape (σ,)
        Their sets.
    levels : sequence of σ tuples
        The values each may take, lowest first.
    power : function (c of shape (σ,)) → g(c) [W]

    Attributes
    ----------
    knots, values : list of float
        One computation: where g bends and what it is there [W]; g is taken as linear between its levels and
        the ends of its set. Several: empty.
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
        """One computation: which linear piece each step is on, shape (M,); at a knot, the one on a side."""
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
    """What the horizon looks like from now.

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
    """An answer: the parameters at each step, shape (M, σ), as reals and as values that may be taken.

    `passes` is how many QPs it took, 0 where the closed form was proven and taken.
    """

    relaxed: FloatArray
    chosen: FloatArray
    objective: float
    relaxed_objective: float
    passes: int

    @property
    def gap(self) -> float:
        """How far the integer objective lies below the real one, as a share of it."""
        return (self.relaxed_objective - self.objective) / max(abs(self.relaxed_objective), 1e-12)


class Horizon:
    """The problem for one set of computations and one number of steps: built once, solved many times.

    Parameters
    ----------
    computations : Computations
    battery : Battery
    steps : int
        M.
    cost : str
        `control`, `power`, `quadratic` or `output`.
    trade_offs : sequence of (R row of shape (σ,), r)
        Rows R c − r ≥ 0; what other parameters add is in r already.
    weights : (float, float)
        Q and R of cost `quadratic`, as multiples of the identity.
    closed_form : bool
        Take the closed form as the reals where its multipliers prove it; without, QPs climb there.
    """

    def __init__(
        self,
        computations: ComputationLevels,
        battery: Battery,
        steps: int,
        cost: str = CONTROL,
        trade_offs: Sequence[tuple[Sequence[float], float]] = (),
        weights: tuple[float, float] = (1.0, 1.0),
        *,
        closed_form: bool = True,
    ) -> None:
        self._closed_form = closed_form
        self._c = computations
        self._battery = battery
        self._steps = steps
        self._cost = cost
        self._weights = weights
        self._rows = np.array([row for row, _ in trade_offs], dtype=float).reshape(-1, computations.count)
        self._least = np.array([r for _, r in trade_offs], dtype=float)
        self._width = computations.high - computations.low
        # the lowest parameters, and each raised to its highest alone
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
        """Every combination of levels that keeps the trade-offs, the least power first."""
        choices = np.array(list(itertools.product(*_thinned(self._c.levels))), dtype=float)
        choices = choices[(choices @ self._rows.T >= self._least - _slack(self._least)).all(axis=1)]
        powers = np.array([self._c.power(choice.tolist()) for choice in choices], dtype=float)
        order = np.argsort(powers, kind="stable")
        self._choices: FloatArray = choices[order]
        self._powers: FloatArray = powers[order]
        self._controls = ((self._nu * self._choices + self._tau) ** 2).sum(axis=1)

    def _build_program(self) -> None:
        """Rows of the QP that stay: boxes, then powers (each with every step until then), then trade-offs."""
        steps, count, extra = self._steps, self._c.count, len(self._rows)
        size = steps * count
        self._until = np.repeat(np.tril(np.ones((steps, steps))), count, axis=1)
        self._at = np.repeat(np.eye(steps), count, axis=1)
        balances = np.kron(np.eye(steps), self._rows * self._width)
        self._matrix = np.vstack([np.eye(size), np.zeros((steps, size)), balances])
        trades = np.kron(np.eye(steps), np.ones_like(self._rows))
        filled = np.vstack([np.eye(size), self._until, trades]) > 0
        self._programs = [(proximal, QuadraticProgram(filled, proximal)) for proximal in PROXIMAL]
        least = np.tile(self._least - self._rows @ self._c.low, steps)
        self._lower = np.concatenate([np.zeros(size), np.full(steps, -UNBOUNDED), least])
        self._upper = np.concatenate([np.ones(size), np.zeros(steps), np.full(steps * extra, UNBOUNDED)])

    # --- the model

    def objective(self, c: FloatArray, outlook: HorizonForecast) -> float:
        """Σ_m l(c_m) at parameters of shape (M, σ)."""
        controls = ((self._nu * c + self._tau) ** 2).sum(axis=1)
        return float(self._worth(controls, self._c.power_w(c), outlook.limit_motion_w, outlook).sum())

    def excess_w(self, c: FloatArray, outlook: HorizonForecast) -> FloatArray:
        """How far each step's power is above what the battery allows [W], shape (M,); no trade-offs.

        Raises
        ------
        Infeasible
            If the battery cannot deliver the power at all.
        """
        g = self._c.power_w(c)
        b = self._battery
        current = currents_a(outlook.mean_motion_w + g, b.voltage_v, b.resistance_ohm)
        allowed = b.power_per_soc_w * (outlook.soc - self._soc_per_a(outlook) * np.cumsum(current))
        result: FloatArray = outlook.limit_motion_w + g - allowed
        return result

    def feasible(self, c: FloatArray, outlook: HorizonForecast) -> bool:
        """Whether every constraint holds at parameters of shape (M, σ), to 1e-6 W."""
        try:
            powers = bool((self.excess_w(c, outlook) <= FEASIBLE_W).all())
        except Infeasible:
            return False
        return powers and bool((c @ self._rows.T >= self._least - _slack(self._least)).all())

    def _soc_per_a(self, outlook: HorizonForecast) -> float:
        """What a step takes off the state of charge for each ampere: k_b Δ/Q_c [1/A]."""
        return self._battery.k_b_per_s * outlook.step_s / self._battery.capacity_ah

    def _worth(self, controls: Numbers, g: Numbers, limit: Numbers, outlook: HorizonForecast) -> Numbers:
        """l from Σû² of the computations [W²], their power and the motion's [W]; numbers, or arrays that fit."""
        if self._cost == OUTPUT:
            # l = ½y²
            return 0.5 * (limit + g) ** 2
        if self._cost == CONTROL:
            return controls
        # l = ½(q + Bu)ᵀ diag(C) (q + Bu), or with Q for diag(C) and ½uᵀRu beside it
        power = 0.5 * ((outlook.level_w + g) ** 2 + outlook.ripple_w2)
        q, r = self._weights
        return power if self._cost == POWER else q * power + 0.5 * r * controls

    def _gain(
        self, nu: Numbers, control: Numbers, g: Numbers, slope: Numbers, limit: Numbers, outlook: HorizonForecast
    ) -> Numbers:
        """∂l/∂c from ν, û, g and ∂g/∂c; numbers, or arrays that fit."""
        if self._cost == OUTPUT:
            return (limit + g) * slope
        if self._cost == CONTROL:
            return 2 * nu * control
        power = (outlook.level_w + g) * slope
        q, r = self._weights
        return power if self._cost == POWER else q * power + r * nu * control

    # --- an answer

    def solve(self, outlook: HorizonForecast) -> HorizonSolution:
        """The best values that computations may take, and the best reals.

        Raises
        ------
        Infeasible
            If not even the values of least power are admissible.
        SolverFailed
            If the solver gave no answer; the caller's fallback is `lowered`.
        """
        made, objective, whole = self._search(outlook)
        chosen = self._choices[made]
        relaxed, best, passes = self._reals(chosen, objective, outlook)
        if not whole:
            chosen, objective = self._floored(relaxed, chosen, objective, outlook)
        if objective > best:
            relaxed, best = chosen, objective
        return HorizonSolution(relaxed, chosen, objective, best, passes)

    def _reals(self, chosen: FloatArray, least: float, outlook: HorizonForecast) -> tuple[FloatArray, float, int]:
        """The best reals, their objective and the QPs it took."""
        starts = [chosen]
        if self._increasing and not len(self._rows):
            steps = self._filled(outlook)
            filled, value = np.array([[step.c] for step in steps]), sum(step.worth for step in steps)
            if value >= least - SAME * abs(least) and _proven(steps):
                if self._closed_form:
                    return filled, value, 0
                return self._climbed_to(value, filled, chosen, outlook)
            starts.append(filled)
        return self._highest(starts, outlook)

    def _climbed_to(
        self, value: float, filled: FloatArray, chosen: FloatArray, outlook: HorizonForecast
    ) -> tuple[FloatArray, float, int]:
        """The reals by QPs from the last plan, where multipliers have proven what the best are worth.

        The climb ends as soon as it is there. Where it ends lower, or OSQP fails on the way, the proven plan is the
        answer.
        """
        enough = value - REACHED * abs(value)
        begin = chosen if self._last is None or not self.feasible(self._last, outlook) else self._last
        relaxed, best, passes = filled, value, 0
        with contextlib.suppress(SolverFailed, Infeasible):
            top, worth, passes = self._climbed(begin, outlook, enough=enough)
            if worth >= enough:
                relaxed, best = top, worth
        self._last = relaxed
        return relaxed, best, passes

    def _highest(self, starts: list[FloatArray], outlook: HorizonForecast) -> tuple[FloatArray, float, int]:
        """Where charge is short, tops are many: the highest of those climbed to from several plans.

        Raises
        ------
        SolverFailed
            If OSQP failed on the way from each.
        """
        passes, tops, failures = 0, [], []
        least = np.tile(self._choices[0], (self._steps, 1))
        for start, chords in (*((start, None) for start in starts), (least, self._chords(outlook))):
            try:
                begin, _, sketches = (start, 0.0, 0) if chords is None else self._climbed(start, outlook, chords)
                top, value, more = self._climbed(begin, outlook)
            except (SolverFailed, Infeasible) as error:  # a QP round an admissible plan has an answer
                failures.append(str(error))
                continue
            tops.append((value, top))
            passes += sketches + more
        if not tops:
            raise SolverFailed(failures[0])
        best, relaxed = max(tops, key=lambda top: top[0])
        return relaxed, best, passes

    # --- values that computations may take

    def _search(self, outlook: HorizonForecast) -> tuple[list[int], float, bool]:
        """The best choice for each step, what they are worth, and whether the search came to its end.

        Charge is counted as if every step so far had made the choice of least power, less what the choices
        made took beyond that: then what a choice needs does not depend on those before.
        """
        if not len(self._choices):
            raise Infeasible("no values of the computations keep the trade-offs")
        b, limit = self._battery, outlook.limit_motion_w[:, None]
        total = outlook.mean_motion_w[:, None] + self._powers
        under_root = b.voltage_v**2 - 4 * b.resistance_ohm * total
        # Δb = k_b I(y) Δ/Q_c
        drop = total / (b.voltage_v + np.sqrt(np.maximum(under_root, 0.0))) * (2 * self._soc_per_a(outlook))
        beyond = drop - drop[:, :1]
        needed = (limit + (self._powers - FEASIBLE_W)) / b.power_per_soc_w + beyond
        needed += np.cumsum(drop[:, 0])[:, None]
        needed[under_root < 0] = math.inf
        # the rest at its least must remain possible: a choice needs what later steps do, and what it takes
        later = np.maximum.accumulate(needed[::-1, 0])[::-1]
        if not later[0] <= outlook.soc:
            if math.isnan(later[0] + outlook.soc):
                raise SolverFailed("an outlook that is not finite")
            raise Infeasible("not even the computations of least power keep to what the battery allows")
        needed[:-1] = np.maximum(needed[:-1], later[1:, None] + beyond[:-1])
        worth = np.asarray(self._worth(self._controls, self._powers, limit, outlook))
        top = np.maximum.accumulate(worth, axis=-1).tolist()
        tops = top if worth.ndim == 2 else [top] * self._steps
        return _Search(needed.tolist(), beyond.tolist(), tops).best(outlook.soc)

    def _floored(
        self, relaxed: FloatArray, chosen: FloatArray, objective: float, outlook: HorizonForecast
    ) -> tuple[FloatArray, float]:
        """For a search cut short: the best choices within the power of the reals, if better than those it made."""
        limit = outlook.limit_motion_w[:, None]
        worth = np.asarray(self._worth(self._controls, self._powers, limit, outlook))
        power = self._c.power_w(relaxed)[:, None]
        for slack in (FLOOR_SLACK * self._span_w, 0.0):
            made = np.where(self._powers <= power + slack, worth, -math.inf).argmax(axis=1)
            plan = self._choices[made]
            value = self.objective(plan, outlook)
            if value > objective and self.feasible(plan, outlook):
                return plan, value
        return chosen, objective

    # --- reals

    def _filled(self, outlook: HorizonForecast) -> list[_Step]:
        """One computation: every step in turn takes all that its own limit and the rest at its least leave.

        Exact for the nonlinear battery: with I the current, y = V I − R I², so the limit is a quadratic in I.
        """
        b, knots, values = self._battery, self._c.knots, self._c.values
        volt, ohm, rate, per_soc = b.voltage_v, b.resistance_ohm, self._soc_per_a(outlook), b.power_per_soc_w
        nu, tau, sag = float(self._nu[0]), float(self._tau[0]), per_soc * rate
        soc, steps = outlook.soc, []
        limits, means = outlook.limit_motion_w.tolist(), outlook.mean_motion_w.tolist()
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
            worth = self._worth(control * control, power, limit, outlook)
            gain = self._gain(nu, control, power, slope, limit, outlook) / slope
            root = math.sqrt(volt * volt - 4 * ohm * (mean + power))
            # κ = Q_c V crate · k_b Δ/Q_c · dI/dy
            steps.append(_Step(c, worth, gain, sag / root, full, full or amps == own))
            soc -= rate * 2 * (mean + power) / (volt + root)
        return steps

    def _rests(self, limits: list[float], means: list[float], rate: float) -> list[float]:
        """The charge that must be left after each step, for those after it at their least."""
        b, least, per_soc = self._battery, self._c.values[0], self._battery.power_per_soc_w
        rest, rests = -math.inf, []
        for limit, mean in zip(reversed(limits), reversed(means), strict=True):
            rests.append(rest)
            rest = max(rest, (limit + least) / per_soc) + rate * b.current_a(mean + least)
        return rests[::-1]

    def _chords(self, outlook: HorizonForecast) -> FloatArray:
        """What each parameter gains on its way from end to end, the others at their lowest, shape (M, σ).

        Over its set a convex l is nowhere above its chord: who climbs by these does not end at the nearest top.
        """
        limit = outlook.limit_motion_w[:, None]
        ends = np.asarray(self._worth(self._end_controls, self._end_powers, limit, outlook))
        ends = np.broadcast_to(ends, (self._steps, self._c.count + 1))
        chords: FloatArray = (ends[:, 1:] - ends[:, :1]) / np.where(self._width > 0, self._width, math.inf)
        return chords

    def _climbed(
        self, c: FloatArray, outlook: HorizonForecast, chords: FloatArray | None = None, enough: float = math.inf
    ) -> tuple[FloatArray, float, int]:
        """From an admissible plan, QP by QP, to one that none betters or that is worth enough; its worth, and how many.

        Slopes are taken above and below in turn, so that a bend of g is left on whichever side is better. With
        chords, a few QPs that climb by them.
        """

        def worth(plan: FloatArray) -> float:
            return self.objective(plan, outlook) if chords is None else float((chords * plan).sum())

        most = PASSES if chords is None else SKETCHES
        sides = 1 if len(self._c.knots) == 2 else 2
        value = worth(c)
        still = passes = 0
        while still < sides and passes < most:
            passes += 1
            new = self._pass(c, 1 if passes % 2 else -1, outlook, chords)
            before = value
            c, value = self._bettered(c, new, value, worth, outlook)
            if value >= enough:
                break
            still = still + 1 if value - before <= SAME * abs(value) else 0
        return c, value, passes

    def _pass(self, c: FloatArray, side: int, outlook: HorizonForecast, chords: FloatArray | None) -> FloatArray:
        """One QP round a plan: rows and gradient there, and a proximal term that holds it near."""
        z = np.divide(c - self._c.low, self._width, out=np.zeros_like(c), where=self._width > 0).ravel()
        gradient, rows, left = self._linearised(c, z, side, outlook)
        lower, upper = self._bounds(c, side)
        if chords is not None:
            gradient = (chords * self._width).ravel()
            lower, upper = self._lower.copy(), self._upper.copy()
        upper[z.size : z.size + len(left)] = left
        matrix = self._matrix.copy()
        matrix[z.size : z.size + len(left)] = rows
        # each parameter in units of what it can reach, each row then in units of its largest entry
        reach = _reach(rows, left)
        matrix *= reach
        units = np.abs(matrix).max(axis=1)
        units[units == 0] = 1.0
        gradient *= reach
        gradient /= max(float(np.abs(gradient).max()), 1e-12)
        answer = self._nearest(gradient, matrix / units[:, None], lower / units, upper / units, z / reach)
        return self._c.low + np.clip(answer * reach, 0.0, 1.0).reshape(c.shape) * self._width

    def _linearised(
        self, c: FloatArray, z: FloatArray, side: int, outlook: HorizonForecast
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gradient by z, shape (Mσ,), and power rows, shape (M, Mσ), with what they leave, in shares of g's span."""
        b = self._battery
        g, slopes = self._c.power_w(c), self._c.slopes_w(c, side)
        control, limit = self._nu * c + self._tau, outlook.limit_motion_w[:, None]
        gain = np.asarray(self._gain(self._nu, control, g[:, None], slopes, limit, outlook))
        total = outlook.mean_motion_w + g
        # ∂y_m/∂z_m, and κ_m ∂y_m/∂z_m: what it takes off its own limit and every later one
        sag = b.power_per_soc_w * self._soc_per_a(outlook)
        own = slopes * self._width / self._span_w
        drain = sag * current_slope_a_per_w(total, b.voltage_v, b.resistance_ohm)[:, None] * own
        rows = self._at * own.ravel() + self._until * drain.ravel()
        used = sag * np.cumsum(currents_a(total, b.voltage_v, b.resistance_ohm))
        left = (b.power_per_soc_w * outlook.soc - outlook.limit_motion_w - g - used) / self._span_w
        return (gain * self._width).ravel(), rows, left + rows @ z

    def _nearest(
        self, gradient: FloatArray, matrix: FloatArray, lower: FloatArray, upper: FloatArray, point: FloatArray
    ) -> FloatArray:
        """The QP's minimiser, held near the point as little as OSQP can do with."""
        for proximal, program in self._programs:
            try:
                return program.solve(-gradient - proximal * point, matrix, lower, upper, point)
            except SolverFailed as error:
                failure = error
        raise failure

    def _bounds(self, c: FloatArray, side: int) -> tuple[FloatArray, FloatArray]:
        """Bounds of the rows; where g bends, a step stays on its linear piece."""
        lower, upper = self._lower.copy(), self._upper.copy()
        if len(self._c.knots) > 2:
            share = (np.array(self._c.knots) - self._c.low) / self._width
            piece = self._c.pieces(c, side)
            lower[: self._steps], upper[: self._steps] = share[piece], share[piece + 1]
        return lower, upper

    def _bettered(
        self,
        c: FloatArray,
        new: FloatArray,
        value: float,
        worth: Callable[[FloatArray], float],
        outlook: HorizonForecast,
    ) -> tuple[FloatArray, float]:
        """The solver's answer, made admissible, and its value; the plan c and its own where that betters nothing."""
        if np.abs(new - c).max() <= STILL * self._width.max():
            return c, value
        # the solver's tolerance and the battery's curvature are made up for by a little less power
        less = (new + share * (self._choices[0] - new) for share in (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4))
        nearer = (c + share * (new - c) for share in (0.5, 0.2, 0.05, 0.01))
        for trial in itertools.chain(less, nearer):
            found = worth(trial)
            if found > value and self.feasible(trial, outlook):
                return np.asarray(trial), found
        return c, value

    # --- the fallback

    def lowered(self, now: FloatArray, deltas: FloatArray, outlook: HorizonForecast) -> FloatArray:
        """The fallback of a failed solve: from those in force, lower all by δ until every constraint holds.

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
            If not even the lowest parameters are admissible.

        Source: drafts 003 and 004, the subroutine of their algorithms.
        """
        c = np.clip(now, self._c.low, self._c.high)
        while True:
            value = np.array([_floor(levels, x) for levels, x in zip(self._c.levels, c, strict=True)])
            plan = np.tile(value, (self._steps, 1))
            if self.feasible(plan, outlook):
                return plan
            if (c <= self._c.low).all():
                raise Infeasible("not even the lowest parameters are admissible")
            c = np.maximum(c - deltas, self._c.low)


class _Step(NamedTuple):
    """A step that took all it could: the computation, its l, ∂l/∂y, κ; whether at its top, or its own limit."""

    c: float
    worth: float
    gain: float
    takes: float
    full: bool
    free: bool


def _proven(steps: Sequence[_Step]) -> bool:
    """Whether steps at their top or at their own limits have multipliers of 0 or more: no plan near is better.

    From the last step back: a watt more at step m gains ∂l/∂y, and takes κ_m off its own limit and every later.
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
    """The best choice at each step, by branch and bound.

    Parameters
    ----------
    needed, beyond, top : tables of M rows, one entry for each choice, the least power first
        Charge that must be left for it, and what it takes of that; the most worth of it and those before it.
        The first two rise along a row.

    A choice that is worth no more than one of less power is never made: `top` tells which are worth more.
    """

    def __init__(self, needed: Table, beyond: Table, top: Table) -> None:
        self._needed, self._beyond, self._top = needed, beyond, top

    def best(self, charge: float) -> tuple[list[int], float, bool]:
        """One index for each step, what they are worth, and whether it is certain that none are worth more.

        It ends where the first descent meets the bound: the usual case.
        """
        made, value = self._descent(charge)
        enough = value + SAME * abs(value)
        if self._bound(0, charge, enough) <= enough:
            return made, value, True
        return self._branched(charge, made, value)

    def _descent(self, charge: float) -> tuple[list[int], float]:
        """At each step the choice of most worth that the charge admits."""
        made, value = [], 0.0
        for needed, beyond, top in zip(self._needed, self._beyond, self._top, strict=True):
            i = bisect_left(top, top[bisect_right(needed, charge) - 1])
            made.append(i)
            value += top[i]
            charge -= beyond[i]
        return made, value

    def _bound(self, first: int, charge: float, enough: float) -> float:
        """What the steps from the first on are worth at most, or some number up to `enough` if that is less.

        At first each step counts as if those before it had taken nothing. Who does better than `enough` can
        have forgone of that no more than the difference, so takes almost as much charge: count again with it.
        """
        steps = range(first, len(self._needed))
        bound = spared = math.inf
        while True:
            worth, left = 0.0, charge
            for k in steps:
                needed, top = self._needed[k], self._top[k]
                i = bisect_right(needed, min(charge, left + spared)) - 1
                if i < 0:
                    return -math.inf
                worth += top[i]
                left -= self._beyond[k][bisect_left(top, top[i])]
            if worth <= enough or bound - worth < 1e-3 * (bound - enough):
                return worth
            bound, spared = worth, self._charge_per_worth * (worth - enough)

    @cached_property
    def _charge_per_worth(self) -> float:
        """The most charge that a little less worth can spare, at any step."""
        most = 0.0
        for beyond, top in zip(self._beyond, self._top, strict=True):
            last = 0
            for i in range(1, len(top)):
                if top[i] > top[last]:
                    most = max(most, (beyond[i] - beyond[last]) / (top[i] - top[last]))
                    last = i
        return most

    def _branched(self, charge: float, made: list[int], most: float) -> tuple[list[int], float, bool]:
        """A plan worth more than the one made, if there is any: from the choices of most worth down."""
        steps, work = len(self._needed), 0
        stack: list[tuple[int, float, float, _Link | None]] = [(0, charge, 0.0, None)]
        while stack and work < WORK:
            work += steps
            m, charge, value, chain = stack.pop()
            enough = most + SAME * abs(most) - value
            if self._bound(m, charge, enough) <= enough:
                continue
            if m == steps and chain is not None:
                made, most = chain.choices(), value
                continue
            top, branches = self._top[m], []
            i = bisect_right(self._needed[m], charge) - 1
            while i >= 0:
                i = bisect_left(top, top[i])
                branches.append((m + 1, charge - self._beyond[m][i], value + top[i], _Link(i, chain)))
                i -= 1
            stack.extend(reversed(branches))
        return made, most, not stack


class _Link(NamedTuple):
    """The last choice of a sequence, and those before it."""

    choice: int
    before: _Link | None

    def choices(self) -> list[int]:
        """The whole sequence, in order."""
        found = []
        link: _Link | None = self
        while link is not None:
            found.append(link.choice)
            link = link.before
        return found[::-1]


def _bends(points: list[float], values: list[float]) -> tuple[list[float], list[float]]:
    """Points and values of a piecewise linear function without those where it does not bend."""
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
    """The share of its set that each column could move by if it alone used what the rows leave.

    Where charge is short this is little for all that must share it; OSQP stalls unless it is told.
    """
    shares = np.divide(left[:, None], rows, out=np.ones_like(rows), where=rows > 0)
    reach: FloatArray = np.clip(shares.min(axis=0), TIGHTEST, 1.0)
    return reach


def _thinned(levels: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Levels of which there are at most CHOICES combinations, if all but two of each are enough for that."""
    kept = list(levels)
    while math.prod(map(len, kept)) > CHOICES and max(map(len, kept)) > 2:
        k = max(range(len(kept)), key=lambda i: len(kept[i]))
        kept[k] = (*kept[k][:-1:2], kept[k][-1])
    return kept


def _slack(least: FloatArray) -> FloatArray:
    return 1e-9 * (1 + np.abs(least))


def _floor(levels: Sequence[float], value: float) -> float:
    below = [level for level in levels if level <= value + 1e-9]
    return below[-1] if below else levels[0]


def _separate(low: FloatArray, width: FloatArray, end_powers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """ν and τ of each computation (letter, Eq. 11), the others at their lowest.

    What all cost there is shared evenly.
    """
    share = end_powers[0] / len(low)
    scaled = [
        computation_scaling(bottom, bottom + span, share, share + (end - end_powers[0]))
        for bottom, span, end in zip(low, width, end_powers[1:], strict=True)
    ]
    return np.array([nu for nu, _ in scaled]), np.array([tau for _, tau in scaled])


__all__ = ["COSTS", "ComputationLevels", "Horizon", "HorizonForecast", "HorizonSolution", "SolverFailed"]

"""The computations over a receding horizon: the optimal control problem, as reals and as integers.

The periodic motion power is exogenous (B touches α0 only), so the states drop out of the problem: what is left
are the computations' parameters at each step of the horizon, z ∈ [0, 1] of their sets, coupled by the state of
charge alone.

    maximise   Σ_m l(c_m)                                     convex in c: linearised round the last plan, repeated
    subject to y_m = h_m + g(c_m) ≤ b_m · Q_c V crate         the output constraint, at each step
               b_m = b_0 − Σ_{j≤m} k_b I(h̄_j + g(c_j)) Δ/Q_c  the battery
               R c_m − r ≥ 0                                  trade-offs

y ≥ 0 needs no row: no choice of computations makes a power negative that is not so without them.

Steps share nothing but charge, so values that computations may take are searched, not rounded to: of each choice
only its power, its charge and its worth matter. Reals are found from there, by a closed form where its
multipliers prove it, else by a sequence of QPs.

Source: letter, Eq. 16 and Def. III.3; drafts 003 and 004 for the trade-offs and for the subroutine that lowers
by δ.
"""

from __future__ import annotations

import itertools
import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eadp.core.battery import current_slope_a_per_w, currents_a
from eadp.errors import Infeasible, SolverFailed
from eadp.models.battery import Battery
from eadp.planning.qp import UNBOUNDED, QuadraticProgram, pattern

FloatArray = NDArray[np.float64]
Table = list[list[float]]

CONTROL, POWER, QUADRATIC, OUTPUT = "control", "power", "quadratic", "output"
COSTS = (CONTROL, POWER, QUADRATIC, OUTPUT)
PROXIMAL = 0.1
PASSES = 40
STILL = 1e-7
FEASIBLE_W = 1e-6
WORK = 20_000
CHOICES = 4096
BEND = 1e-9
DIFFERENCE = 1e-4
TIGHTEST = 1e-3
SAME = 1e-10


@dataclass(frozen=True)
class Computations:
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
        One computation: where g bends and what it is there [W]; g is taken as linear between its levels and the ends
        of its set. Several: empty.
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

    @property
    def count(self) -> int:
        """σ."""
        return len(self.low)

    def power_w(self, c: FloatArray) -> FloatArray:
        """g [W], shape (M,), at parameters of shape (M, σ)."""
        if self.count == 1:
            return np.interp(c[:, 0], self.knots, self.values)
        return np.array([self.power(row) for row in c.tolist()])

    def slopes_w(self, c: FloatArray, side: int = 1) -> FloatArray:
        """∂g/∂c [W per unit], shape (M, σ), at parameters of that shape; where g bends, above for side 1, below for −1."""
        if self.count > 1:
            return self._differences(c, side)
        if len(self.knots) == 1:
            return np.zeros_like(c)
        slopes: FloatArray = (np.diff(self.values) / np.diff(self.knots))[self.pieces(c, side)]
        return slopes[:, None]

    def pieces(self, c: FloatArray, side: int = 1) -> NDArray[np.intp]:
        """One computation: which linear piece each step is on, shape (M,); at a knot, the one on that side."""
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
class Outlook:
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
        α0 of the motion [W] and the sum of its squared harmonics [W²], which costs `power` and `quadratic` count;
        the second only shifts them.
    """

    limit_motion_w: FloatArray
    mean_motion_w: FloatArray
    soc: float
    step_s: float
    level_w: float = 0.0
    ripple_w2: float = 0.0


@dataclass(frozen=True)
class Plan:
    """An answer: the parameters at each step, shape (M, σ), as reals and as the values that computations may take.

    `passes` is how many QPs it took, 0 where the closed form was proven.
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
    """

    def __init__(
        self,
        computations: Computations,
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
        self._least = np.array([r for _, r in trade_offs], dtype=float)
        self._width = computations.high - computations.low
        self._nu, self._tau = _separate(computations)
        self._list_choices()
        powers = [*computations.values, *self._powers.tolist()]
        self._scale = max(max(powers, default=0.0) - min(powers, default=0.0), 1e-6)
        values = computations.values
        self._increasing = len(values) > 1 and all(a < b for a, b in itertools.pairwise(values))
        self._build_program()

    def _list_choices(self) -> None:
        """Every combination of levels that keeps the trade-offs, the least power first."""
        choices = np.array(list(itertools.product(*_thinned(self._c.levels))), dtype=float)
        choices = choices[(choices @ self._rows.T >= self._least - _slack(self._least)).all(axis=1)]
        powers = np.array([self._c.power(choice.tolist()) for choice in choices], dtype=float)
        order = np.argsort(powers, kind="stable")
        self._choices, self._powers = choices[order], powers[order]
        self._controls = ((self._nu * self._choices + self._tau) ** 2).sum(axis=1)

    def _build_program(self) -> None:
        """The QP's pattern: box rows, power rows (lower triangular in the steps), trade-off rows."""
        steps, count, extra = self._steps, self._c.count, len(self._rows)
        size = steps * count
        columns = []
        for m, k in itertools.product(range(steps), range(count)):
            trade_rows = range(size + steps + m * extra, size + steps + (m + 1) * extra)
            columns.append([m * count + k, *range(size + m, size + steps), *trade_rows])
        shape = pattern(columns, size + steps + steps * extra)
        column_of = np.repeat(np.arange(size), np.diff(shape.indptr))
        step_of_row = np.concatenate([np.repeat(np.arange(steps), count), np.arange(steps)])
        power_entry = (shape.indices >= size) & (shape.indices < size + steps)
        # what stays: 1 in box rows, R in trade-off rows
        self._entries = np.zeros(len(shape.indices))
        self._entries[shape.indices < size] = 1.0
        trade_entry = shape.indices >= size + steps
        row, column = (shape.indices[trade_entry] - size - steps) % max(extra, 1), column_of[trade_entry] % count
        self._entries[trade_entry] = self._rows[row, column] * self._width[column]
        # what a pass writes: at step m of a power row, its drain; at its own step, its power too
        self._power_entries = np.flatnonzero(power_entry)
        self._power_columns = column_of[power_entry]
        self._own_entries = np.flatnonzero(power_entry & (shape.indices - size == column_of // count))
        self._scaled_entries = np.flatnonzero(~trade_entry)
        self._scaled_steps = step_of_row[shape.indices[~trade_entry]]
        self._program = QuadraticProgram(shape, PROXIMAL)
        balance = np.tile(self._least - self._rows @ self._c.low, steps)
        self._lower = np.concatenate([np.zeros(size), np.full(steps, -UNBOUNDED), balance])
        self._upper = np.concatenate([np.ones(size), np.zeros(steps), np.full(steps * extra, UNBOUNDED)])

    # --- the model

    def objective(self, c: FloatArray, outlook: Outlook) -> float:
        """Σ_m l(c_m) at parameters of shape (M, σ)."""
        g = self._c.power_w(c)
        return self._objective(c, g, outlook)

    def excess_w(self, c: FloatArray, outlook: Outlook) -> FloatArray:
        """How far each step's power is above what the battery allows [W], shape (M,); trade-offs not looked at.

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

    def feasible(self, c: FloatArray, outlook: Outlook) -> bool:
        """Whether every constraint holds at parameters of shape (M, σ), to 1e-6 W."""
        try:
            powers = bool((self.excess_w(c, outlook) <= FEASIBLE_W).all())
        except Infeasible:
            return False
        return powers and bool((c @ self._rows.T >= self._least - _slack(self._least)).all())

    def _soc_per_a(self, outlook: Outlook) -> float:
        """What a step takes off the state of charge for each ampere: k_b Δ/Q_c [1/A]."""
        return self._battery.k_b_per_s * outlook.step_s / self._battery.capacity_ah

    def _objective(self, c: FloatArray, g: FloatArray, outlook: Outlook) -> float:
        controls = ((self._nu * c + self._tau) ** 2).sum(axis=1)
        return float(self._costs(controls, g, outlook.limit_motion_w, outlook).sum())

    def _costs(self, controls: FloatArray, g: FloatArray, limit: FloatArray, outlook: Outlook) -> FloatArray:
        """l from Σû² of the computations [W²], their power and the motion's [W]; whatever shapes go together."""
        if self._cost == OUTPUT:
            # l = ½y²
            return np.asarray(0.5 * (limit + g) ** 2)
        if self._cost == CONTROL:
            return controls
        # l = ½(q + Bu)ᵀ diag(C) (q + Bu), or with Q for diag(C) and ½uᵀRu beside it
        power = 0.5 * ((outlook.level_w + g) ** 2 + outlook.ripple_w2)
        q, r = self._weights
        return np.asarray(power if self._cost == POWER else q * power + 0.5 * r * controls)

    def _gradient(self, c: FloatArray, g: FloatArray, slopes: FloatArray, outlook: Outlook) -> FloatArray:
        """∂l/∂c at each step, shape (M, σ)."""
        if self._cost == OUTPUT:
            return (outlook.limit_motion_w + g)[:, None] * slopes
        control = 2 * self._nu * (self._nu * c + self._tau)
        if self._cost == CONTROL:
            return control
        power = (outlook.level_w + g)[:, None] * slopes
        q, r = self._weights
        return power if self._cost == POWER else q * power + 0.5 * r * control

    # --- an answer

    def solve(self, outlook: Outlook) -> Plan:
        """The best values that computations may take, and the best reals.

        Raises
        ------
        Infeasible
            If not even the values of least power are admissible.
        SolverFailed
            If the solver gave no answer; the caller's fallback is `lowered`.
        """
        chosen = self._choices[self._search(outlook)]
        objective = self.objective(chosen, outlook)
        relaxed, passes = self._filled(outlook), 0
        best = -math.inf if relaxed is None else self.objective(relaxed, outlook)
        if relaxed is None or best < objective:
            relaxed, passes = self._climbed(chosen, outlook)
            best = self.objective(relaxed, outlook)
        return Plan(relaxed, chosen, objective, best, passes)

    # --- values that computations may take

    def _search(self, outlook: Outlook) -> list[int]:
        """The best choice for each step.

        Charge is counted as what would be left if every step so far had made the choice of least power, less what
        the choices made took beyond that; then the charge a choice needs does not depend on those before.
        """
        if not len(self._choices):
            raise Infeasible("no values of the computations keep the trade-offs")
        b = self._battery
        total = outlook.mean_motion_w[:, None] + self._powers
        under_root = b.voltage_v**2 - 4 * b.resistance_ohm * total
        current = 2 * total / (b.voltage_v + np.sqrt(np.maximum(under_root, 0.0)))
        drop = current * self._soc_per_a(outlook)
        beyond = drop - drop[:, :1]
        wanted = (outlook.limit_motion_w[:, None] + self._powers - FEASIBLE_W) / b.power_per_soc_w
        needed = wanted + beyond + np.cumsum(drop[:, 0])[:, None]
        needed[under_root < 0] = math.inf
        # the rest at its least must remain possible: a choice needs what any later step does, beside what it takes
        later = np.maximum.accumulate(needed[::-1, 0])[::-1]
        if not later[0] <= outlook.soc:
            raise Infeasible("not even the computations of least power keep to what the battery allows")
        needed[:-1] = np.maximum(needed[:-1], later[1:, None] + beyond[:-1])
        worth = self._costs(self._controls, self._powers, outlook.limit_motion_w[:, None], outlook)
        top = np.maximum.accumulate(np.broadcast_to(worth, needed.shape), axis=1)
        return _Search(needed.tolist(), beyond.tolist(), top.tolist()).best(outlook.soc)

    # --- reals

    def _filled(self, outlook: Outlook) -> FloatArray | None:
        """One computation: every step takes all that its own limit leaves; None unless that is proven the best.

        Exact for the nonlinear battery: with I the current, y = V I − R I², so the limit is a quadratic in I.
        """
        if not self._increasing or len(self._rows):
            return None
        b, knots, values = self._battery, self._c.knots, self._c.values
        volt, ohm, rate = b.voltage_v, b.resistance_ohm, self._soc_per_a(outlook)
        sag = b.power_per_soc_w * rate
        soc, taken = outlook.soc, []
        for limit, mean in zip(outlook.limit_motion_w.tolist(), outlook.mean_motion_w.tolist(), strict=True):
            # g + sag·I = b·Q_c V crate − h =: left  →  R I² − (V + sag) I + left + h̄ = 0
            left = b.power_per_soc_w * soc - limit
            root = (volt + sag) ** 2 - 4 * ohm * (left + mean)
            current = 2 * (left + mean) / (volt + sag + math.sqrt(max(root, 0.0)))
            power = min(left - sag * current, values[-1])
            under_root = volt**2 - 4 * ohm * (mean + power)
            if power < values[0] or under_root < 0 or 2 * ohm * current > volt:
                return None
            i = min(bisect_right(values, power), len(values) - 1) - 1
            taken.append(knots[i] + (power - values[i]) * (knots[i + 1] - knots[i]) / (values[i + 1] - values[i]))
            soc -= rate * 2 * (mean + power) / (volt + math.sqrt(under_root))
        c = np.array(taken)[:, None]
        return c if self._proven(c, outlook) else None

    def _proven(self, c: FloatArray, outlook: Outlook) -> bool:
        """Whether the multipliers of steps that are at their own limit, or at the top, are all 0 or more.

        From the last step back: a watt more at step m is worth its gradient, and takes κ_m off each later limit.
        """
        g, slopes = self._c.power_w(c), self._c.slopes_w(c)
        b = self._battery
        worth = self._gradient(c, g, slopes, outlook)[:, 0] / slopes[:, 0]
        # κ_m = Q_c V crate · k_b Δ/Q_c · dI/dy
        kappa = (b.power_per_soc_w * self._soc_per_a(outlook)) * current_slope_a_per_w(
            outlook.mean_motion_w + g, b.voltage_v, b.resistance_ohm
        )
        at_top = c[:, 0] >= self._c.high[0]
        later = 0.0
        for value, takes, full in zip(worth[::-1].tolist(), kappa[::-1].tolist(), at_top[::-1].tolist(), strict=True):
            net = value - takes * later
            if net < 0:
                return False
            if not full:
                later += net / (1 + takes)
        return True

    def _climbed(self, start: FloatArray, outlook: Outlook) -> tuple[FloatArray, int]:
        """From an admissible plan, QP by QP, to one that no QP betters; and how many it took.

        Slopes are taken above and below in turn, so that a plan at a bend of g is left on whichever side is better.
        """
        c, value = start, self.objective(start, outlook)
        smooth = len(self._c.knots) == 2
        still = 0
        for passes in range(1, PASSES + 1):
            new = self._pass(c, 1 if passes % 2 else -1, outlook)
            c, before = self._bettered(c, new, value, outlook), value
            value = self.objective(c, outlook)
            still = still + 1 if value - before <= SAME * abs(value) else 0
            if still == 2 or (still and smooth):
                return c, passes
        return c, PASSES

    def _pass(self, c: FloatArray, side: int, outlook: Outlook) -> FloatArray:
        """One QP round a plan: rows and gradient there, and a proximal term that holds it near."""
        b = self._battery
        g, slopes = self._c.power_w(c), self._c.slopes_w(c, side)
        gradient = self._gradient(c, g, slopes, outlook) * self._width
        total = outlook.mean_motion_w + g
        # in shares of the span of g: ∂y_m/∂z_m, and κ_m ∂y_m/∂z_m which it takes off its own limit and every later
        sag = b.power_per_soc_w * self._soc_per_a(outlook)
        own = slopes * self._width / self._scale
        drain = sag * current_slope_a_per_w(total, b.voltage_v, b.resistance_ohm)[:, None] * own
        used = np.cumsum(sag * currents_a(total, b.voltage_v, b.resistance_ohm))
        left = (b.power_per_soc_w * outlook.soc - outlook.limit_motion_w - g - used) / self._scale
        z = (c - self._c.low) / np.maximum(self._width, 1e-300)
        left += (own * z).sum(axis=1) + np.cumsum((drain * z).sum(axis=1))
        lower, upper = self._bounds(c, side)
        size = z.size
        upper[size : size + self._steps] = left
        entries = self._entries.copy()
        entries[self._power_entries] = drain.ravel()[self._power_columns]
        entries[self._own_entries] += own.ravel()
        # a step that is left little has its rows in units of that: OSQP stalls on the tight ones otherwise
        tight = np.clip(left / np.maximum((own + drain).sum(axis=1), 1e-9), TIGHTEST, 1.0)
        entries[self._scaled_entries] /= tight[self._scaled_steps]
        units = np.concatenate([np.repeat(tight, self._c.count), tight])
        lower[: len(units)] /= units
        upper[: len(units)] /= units
        top = max(float(np.abs(gradient).max()), 1e-12)
        answer = self._program.solve(-gradient.ravel() / top - PROXIMAL * z.ravel(), entries, lower, upper, z.ravel())
        return self._c.low + np.clip(answer, 0.0, 1.0).reshape(z.shape) * self._width

    def _bounds(self, c: FloatArray, side: int) -> tuple[FloatArray, FloatArray]:
        """Bounds of the rows; where g bends, a step stays on its linear piece."""
        lower, upper = self._lower.copy(), self._upper.copy()
        if len(self._c.knots) > 2:
            share = (np.array(self._c.knots) - self._c.low) / self._width
            piece = self._c.pieces(c, side)
            lower[: self._steps], upper[: self._steps] = share[piece], share[piece + 1]
        return lower, upper

    def _bettered(self, c: FloatArray, new: FloatArray, value: float, outlook: Outlook) -> FloatArray:
        """The solver's answer or what it takes to make it admissible; the plan c itself where that betters nothing."""
        if np.abs(new - c).max() <= STILL * self._width.max():
            return c
        # the solver's tolerance and the battery's curvature are made up for by a little less power
        trials = [new, *(new + share * (self._choices[0] - new) for share in (1e-8, 1e-7, 1e-6, 1e-5, 1e-4))]
        trials += [c + share * (new - c) for share in (0.5, 0.2, 0.05, 0.01)]
        for trial in trials:
            if self.objective(trial, outlook) > value and self.feasible(trial, outlook):
                return trial
        return c

    # --- the fallback

    def lowered(self, now: FloatArray, deltas: FloatArray, outlook: Outlook) -> FloatArray:
        """The fallback of a failed solve: from the parameters in force, lower all by δ until the constraints hold.

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

    def best(self, charge: float) -> list[int]:
        """One index for each step. The search ends where the first descent meets the bound: the usual case."""
        made, value = self._descent(charge)
        enough = value + SAME * abs(value)
        if self._bound(0, charge, enough) <= enough:
            return made
        return self._branched(charge, made, enough)

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

        At first each step counts as if those before it had taken nothing. Who does better than `enough` can have
        forgone of that no more than the difference, so takes almost as much charge: with this, count again.
        """
        steps = range(first, len(self._needed))
        bound = math.inf
        spared = math.inf
        while True:
            worth, left = 0.0, charge
            for k in steps:
                needed, top = self._needed[k], self._top[k]
                i = bisect_right(needed, min(charge, left + spared)) - 1
                if i < 0:
                    return -math.inf
                worth += top[i]
                left -= self._beyond[k][bisect_left(top, top[i])]
            if worth <= enough or worth > bound - 1e-3 * (bound - enough):
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

    def _branched(self, charge: float, made: list[int], enough: float) -> list[int]:
        """A plan worth more than `enough`, else the one made: from the choices of most worth down."""
        steps, link, work = len(self._needed), None, 0
        stack: list[tuple[int, float, float, Link | None]] = [(0, charge, 0.0, None)]
        while stack and work < WORK:
            m, charge, value, chain = stack.pop()
            if value + self._bound(m, charge, enough - value) <= enough:
                continue
            if m == steps:
                enough, link = value + SAME * abs(value), chain
                continue
            work += steps
            top, branches = self._top[m], []
            i = bisect_right(self._needed[m], charge) - 1
            while i >= 0:
                i = bisect_left(top, top[i])
                branches.append((m + 1, charge - self._beyond[m][i], value + top[i], Link(i, chain)))
                i -= 1
            stack.extend(reversed(branches))
        return made if link is None else link.choices()


class Link(NamedTuple):
    """The last choice of a sequence, and those before it."""

    choice: int
    before: Link | None

    def choices(self) -> list[int]:
        """The whole sequence, in order."""
        found, link = [], self
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


def _thinned(levels: Sequence[tuple[float, ...]]) -> list[tuple[float, ...]]:
    """Levels of which there are at most CHOICES combinations: of the longest, every second one but the ends is left out."""
    kept = list(levels)
    while math.prod(map(len, kept)) > CHOICES:
        k = max(range(len(kept)), key=lambda i: len(kept[i]))
        kept[k] = (*kept[k][:-1:2], kept[k][-1])
    return kept


def _slack(least: FloatArray) -> FloatArray:
    return 1e-9 * (1 + np.abs(least))


def _floor(levels: Sequence[float], value: float) -> float:
    below = [level for level in levels if level <= value + 1e-9]
    return below[-1] if below else levels[0]


def _separate(computations: Computations) -> tuple[FloatArray, FloatArray]:
    """ν and τ of each computation (letter, Eq. 11), the others at their lowest.

    What all cost there is shared evenly.
    """
    low, high = computations.low, computations.high
    base = computations.power(low.tolist())
    nu, tau = np.zeros(len(low)), np.zeros(len(low))
    for k in range(len(low)):
        raised = low.copy()
        raised[k] = high[k]
        if high[k] > low[k]:
            nu[k] = (computations.power(raised.tolist()) - base) / (high[k] - low[k])
        tau[k] = base / len(low) - nu[k] * low[k]
    return nu, tau


__all__ = ["COSTS", "Computations", "Horizon", "Outlook", "Plan", "SolverFailed"]

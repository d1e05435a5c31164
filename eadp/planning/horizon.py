"""The computations over a receding horizon: the optimal control problem, its linearisation, its integer answer.

The periodic motion power is exogenous (B touches α0 only), so the states drop out of the problem: what is left are the
computations' parameters at each step of the horizon, z ∈ [0, 1] of their sets, coupled by the state of charge alone.

    maximise   Σ_m l(c_m)                                       convex in c: linearised round the last plan, repeated
    subject to y_m = h_m + g(c_m) ≤ b_m · Q_c V crate           the output constraint, at each step
               b_m = b_0 − Σ_{j≤m} k_b I(h̄_j + g(c_j)) Δ/Q_c    the battery
               R c_m − r ≥ 0                                    trade-offs

y ≥ 0 needs no row: no choice of computations makes a power negative that is not so without them.

Source: letter, Eq. 16 and Def. III.3; drafts 003 and 004 for the trade-offs and for the subroutine that lowers by δ.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eadp.core.battery import current_a, current_slope_a_per_w, currents_a
from eadp.errors import Infeasible, SolverFailed
from eadp.models.battery import Battery
from eadp.planning.qp import UNBOUNDED, QuadraticProgram, pattern

FloatArray = NDArray[np.float64]

CONTROL, POWER, QUADRATIC, OUTPUT = "control", "power", "quadratic", "output"
COSTS = (CONTROL, POWER, QUADRATIC, OUTPUT)
PROXIMAL = 1e-4
PASSES = 8
STILL = 1e-7
FEASIBLE_W = 1e-6
NODES = 4000
FLOOR_SLACK = 1e-4


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
    knots : array, shape (σ, K), optional
        Where g bends along each computation; between two it is linear. Without, g is taken as linear between levels.
    """

    low: FloatArray
    high: FloatArray
    levels: Sequence[tuple[float, ...]]
    power: Callable[[Sequence[float]], float]
    table: tuple[FloatArray, FloatArray] = field(init=False)

    def __post_init__(self) -> None:
        # one computation: g tabled at its levels, so that a solve makes no calls
        points = np.array(self.levels[0]) if len(self.levels) == 1 else np.zeros(1)
        if len(self.levels) == 1 and points[-1] < self.high[0]:
            points = np.append(points, self.high[0])
        values = [self.power([c]) for c in points] if len(self.levels) == 1 else [0.0]
        object.__setattr__(self, "table", (points, np.array(values)))

    @property
    def count(self) -> int:
        """σ."""
        return len(self.low)

    def evaluate(self, c: FloatArray) -> tuple[FloatArray, FloatArray]:
        """g [W], shape (M,), and its slopes [W per unit], shape (M, σ), at parameters of shape (M, σ)."""
        if self.count == 1:
            points, values = self.table
            if len(points) == 1:
                return np.full(len(c), values[0]), np.zeros_like(c)
            place = np.clip(np.searchsorted(points, c[:, 0], side="right") - 1, 0, len(points) - 2)
            slope = (values[place + 1] - values[place]) / (points[place + 1] - points[place])
            return values[place] + slope * (c[:, 0] - points[place]), slope[:, None]
        step = 1e-4 * (self.high - self.low)
        power, slopes = np.empty(len(c)), np.empty_like(c)
        for m, row in enumerate(c):
            power[m] = self.power(row.tolist())
            for k in range(self.count):
                up, down = row.copy(), row.copy()
                up[k] = min(row[k] + step[k], self.high[k])
                down[k] = max(row[k] - step[k], self.low[k])
                slopes[m, k] = (self.power(up.tolist()) - self.power(down.tolist())) / (up[k] - down[k])
        return power, slopes


@dataclass(frozen=True)
class Outlook:
    """What the horizon looks like from now.

    Parameters
    ----------
    limit_motion_w, mean_motion_w : array, shape (M,)
        Motion power at the instant of each step where the output constraint is checked, and its mean over the step [W].
    soc : float
    step_s : float
        Length of a step [s].
    level_w, ripple_w2 : float
        α0 of the motion [W], and Σ of the squared α_j for cost `power`, of all for `quadratic` [W²].
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

    `gap` is how far the integer objective lies below the real one, as a share of it; `passes` how many QPs it took.
    """

    relaxed: FloatArray
    chosen: FloatArray
    objective: float
    relaxed_objective: float
    passes: int

    @property
    def gap(self) -> float:
        """Relative distance of the two objectives."""
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
        self._rows = np.array([row for row, _ in trade_offs], dtype=np.float64).reshape(-1, computations.count)
        self._least = np.array([r for _, r in trade_offs], dtype=np.float64)
        self._width = computations.high - computations.low
        self._last = np.ones((steps, computations.count))
        self._nu, self._tau = _separate(computations)
        spread = computations.power(computations.high.tolist()) - computations.power(computations.low.tolist())
        self._scale = max(abs(spread), 1e-6)
        self._build_pattern()

    def _build_pattern(self) -> None:
        steps, count, extra = self._steps, self._c.count, len(self._rows)
        size = steps * count
        columns = []
        fixed, step_of, own = [], [], []  # entries that stay; of power rows: which column's step, and whether its own row
        for m in range(steps):
            for k in range(count):
                power_rows = [size + j for j in range(m, steps)]
                trade_rows = [size + steps + m * extra + i for i in range(extra)]
                columns.append([m * count + k, *power_rows, *trade_rows])
                fixed += [1.0, *[0.0] * len(power_rows), *(self._rows[:, k] * self._width[k]).tolist()]
                step_of += [-1, *[m * count + k] * len(power_rows), *[-1] * extra]
                own += [False, True, *[False] * (len(power_rows) - 1), *[False] * extra]
        self._entries = np.array(fixed)
        self._power_entries = np.flatnonzero(np.array(step_of) >= 0)
        self._power_columns = np.array(step_of)[self._power_entries]
        self._own_entries = np.flatnonzero(np.array(own))
        rows = size + steps + steps * extra
        self._program = QuadraticProgram(pattern(columns, rows), PROXIMAL)
        self._lower = np.concatenate([np.zeros(size), np.full(steps, -UNBOUNDED), np.zeros(steps * extra)])
        self._upper = np.concatenate([np.ones(size), np.zeros(steps), np.full(steps * extra, UNBOUNDED)])
        if extra:
            self._lower[size + steps :] = np.tile(self._least - self._rows @ self._c.low, steps)

    # --- the model

    def values(self, z: FloatArray) -> FloatArray:
        """Parameters c of shape (M, σ) for shares z of their sets."""
        return self._c.low + z * self._width

    def objective(self, c: FloatArray, outlook: Outlook) -> float:
        """Σ_m l(c_m) at parameters of shape (M, σ)."""
        g, _ = self._c.evaluate(c)
        return float(self._stage_costs(c, g, outlook).sum())

    def excess_w(self, c: FloatArray, outlook: Outlook) -> FloatArray:
        """How far each step's power is above what the battery allows [W], shape (M,); trade-offs not looked at.

        Raises
        ------
        Infeasible
            If the battery cannot deliver the power at all.
        """
        g, _ = self._c.evaluate(c)
        allowed = self._battery.power_per_soc_w * (outlook.soc - np.cumsum(self._drops(g, outlook)))
        result: FloatArray = outlook.limit_motion_w + g - allowed
        return result

    def feasible(self, c: FloatArray, outlook: Outlook) -> bool:
        """Whether every constraint holds at parameters of shape (M, σ), to 1e-6 W."""
        try:
            powers = bool((self.excess_w(c, outlook) <= FEASIBLE_W).all())
        except Infeasible:
            return False
        return powers and all(self._balanced(row) for row in c)

    def _balanced(self, row: FloatArray) -> bool:
        return bool((self._rows @ row - self._least >= -1e-9 * (1 + np.abs(self._least))).all())

    def _drops(self, g: FloatArray, outlook: Outlook) -> FloatArray:
        b = self._battery
        current = currents_a(outlook.mean_motion_w + g, b.voltage_v, b.resistance_ohm)
        return current * (b.k_b_per_s * outlook.step_s / b.capacity_ah)

    def _stage_costs(self, c: FloatArray, g: FloatArray, outlook: Outlook) -> FloatArray:
        if self._cost == OUTPUT:
            return 0.5 * (outlook.limit_motion_w + g) ** 2
        if self._cost == POWER:
            return 0.5 * ((outlook.level_w + g) ** 2 + outlook.ripple_w2)
        controls = ((self._nu * c + self._tau) ** 2).sum(axis=1)
        if self._cost == CONTROL:
            return np.asarray(controls)
        q, r = self._weights
        return np.asarray(0.5 * (q * ((outlook.level_w + g) ** 2 + outlook.ripple_w2) + r * controls))

    def _gradient(self, c: FloatArray, g: FloatArray, slopes: FloatArray, outlook: Outlook) -> FloatArray:
        """∂l/∂c at each step, shape (M, σ)."""
        control = 2 * self._nu * (self._nu * c + self._tau)
        if self._cost == CONTROL:
            return control
        if self._cost == OUTPUT:
            return (outlook.limit_motion_w + g)[:, None] * slopes
        power = (outlook.level_w + g)[:, None] * slopes
        if self._cost == POWER:
            return power
        q, r = self._weights
        return q * power + 0.5 * r * control

    # --- the sequence of QPs

    def solve(self, outlook: Outlook) -> Plan:
        """Linearise, solve, repeat until the plan stops moving; then choose values that computations may take.

        Raises
        ------
        Infeasible
            If not even the lowest parameters are admissible.
        SolverFailed
            If the solver gave no answer; the caller's fallback is `lowered`.
        """
        floor = self.values(np.zeros_like(self._last))
        if not len(self._rows) and not self.feasible(floor, outlook):
            raise Infeasible("not even the lowest parameters keep the power within what the battery allows")
        relaxed, passes = self._relaxed(outlook)
        best = self.objective(relaxed, outlook)
        chosen = self._whole(relaxed, outlook)
        return Plan(relaxed, chosen, self.objective(chosen, outlook), best, passes)

    def _relaxed(self, outlook: Outlook) -> tuple[FloatArray, int]:
        z = self._last
        for passes in range(1, PASSES + 1):
            new = self._pass(z, outlook)
            moved = float(np.abs(new - z).max())
            z = new
            if moved < STILL:
                break
        self._last = z
        return self.values(z), passes

    def _pass(self, z: FloatArray, outlook: Outlook) -> FloatArray:
        """One QP round a plan z: rows and gradient at z, and a proximal term that holds it near."""
        b = self._battery
        c = self.values(z)
        g, slopes = self._c.evaluate(c)
        reach = slopes * self._width  # dg/dz
        gradient = self._gradient(c, g, slopes, outlook) * self._width
        top = max(float(np.abs(gradient).max()), 1e-12)
        total = outlook.mean_motion_w + g
        # κ_m = d(drop)/dg, in watts of allowed power
        rate = b.k_b_per_s * outlook.step_s / b.capacity_ah * b.power_per_soc_w
        kappa = rate * current_slope_a_per_w(total, b.voltage_v, b.resistance_ohm)
        used = rate * currents_a(total, b.voltage_v, b.resistance_ohm)
        own = reach / self._scale
        drain = kappa[:, None] * own
        flat = z.ravel()
        entries = self._entries.copy()
        entries[self._power_entries] = drain.ravel()[self._power_columns]
        entries[self._own_entries] += own.ravel()
        # y_m + Σ_{j≤m} used_j at z, less what the linear rows already count there
        linear = (own * z).sum(axis=1) + np.cumsum((drain * z).sum(axis=1))
        slack = (b.power_per_soc_w * outlook.soc - outlook.limit_motion_w - g - np.cumsum(used)) / self._scale
        size = len(flat)
        self._upper[size : size + self._steps] = slack + linear
        q = -gradient.ravel() / top - PROXIMAL * flat
        answer = self._program.solve(q, entries, self._lower, self._upper, flat)
        return np.clip(answer, 0.0, 1.0).reshape(z.shape)

    # --- values that computations may take

    def _whole(self, relaxed: FloatArray, outlook: Outlook) -> FloatArray:
        if self._c.count == 1 and not len(self._rows):
            return self._whole_single(relaxed, outlook)
        rows: list[FloatArray] = []
        floor = self.values(np.zeros_like(relaxed))
        for m in range(self._steps):
            rest = floor[m + 1 :]
            for candidate in self._neighbours(relaxed[m], outlook, m):
                trial = np.vstack([*rows, candidate, rest])
                if self._balanced(candidate) and self._fits(trial, outlook, m):
                    rows.append(candidate)
                    break
            else:
                raise Infeasible("no values of the computations near the plan keep every constraint")
        return np.array(rows)

    def _fits(self, trial: FloatArray, outlook: Outlook, m: int) -> bool:
        """Whether the powers hold: up to step m as tried, and after it at the lowest parameters."""
        return bool((self.excess_w(trial, outlook) <= FEASIBLE_W).all())

    def _neighbours(self, row: FloatArray, outlook: Outlook, m: int) -> list[FloatArray]:
        """Combinations of the levels next to a plan's step, best first; then every other one, if they are few."""
        sides = []
        for k, levels in enumerate(self._c.levels):
            below = [level for level in levels if level <= row[k] + FLOOR_SLACK * self._width[k]]
            above = [level for level in levels if level > row[k] + FLOOR_SLACK * self._width[k]]
            sides.append([*below[-2:], *above[:1]] or [levels[0]])
        near = [np.array(values, dtype=np.float64) for values in itertools.product(*sides)]
        many = 1
        for levels in self._c.levels:
            many *= len(levels)
        every = []
        if many <= 1000:
            every = [np.array(values, dtype=np.float64) for values in itertools.product(*self._c.levels)]

        def worth(values: FloatArray) -> float:
            c = values[None, :]
            g, _ = self._c.evaluate(c)
            here = Outlook(
                outlook.limit_motion_w[m : m + 1],
                outlook.mean_motion_w[m : m + 1],
                outlook.soc,
                outlook.step_s,
                outlook.level_w,
                outlook.ripple_w2,
            )
            return float(self._stage_costs(c, g, here)[0])

        return sorted(near, key=worth, reverse=True) + sorted(every, key=worth, reverse=True)

    def _whole_single(self, relaxed: FloatArray, outlook: Outlook) -> FloatArray:
        """One computation: the best levels, by branch and bound from the highest level down.

        The bound at a step counts each later step at its best, as if only the lowest parameters had drained the
        battery. The search ends at once where the first descent already meets the bound, which is the usual case.
        """
        levels = self._c.levels[0]
        powers = [self._c.power([level]) for level in levels]
        order = sorted(range(len(levels)), key=lambda i: -powers[i])
        costs = [
            self._stage_costs(np.full((self._steps, 1), level), np.full(self._steps, power), outlook).tolist()
            for level, power in zip(levels, powers, strict=True)
        ]
        b = self._battery
        per_soc, steps = b.power_per_soc_w, self._steps
        rate = b.k_b_per_s * outlook.step_s / b.capacity_ah
        limit, mean = outlook.limit_motion_w.tolist(), outlook.mean_motion_w.tolist()
        least = min(powers)
        # the most charge there can be after each step, and with it the best cost of each step
        best_after = [0.0] * (steps + 1)
        charge = outlook.soc
        ceilings = []
        for m in range(steps):
            charge -= rate * current_a(mean[m] + least, b.voltage_v, b.resistance_ohm)
            ceilings.append(charge)
        for m in reversed(range(steps)):
            fits = [costs[i][m] for i in order if limit[m] + powers[i] <= per_soc * ceilings[m] + FEASIBLE_W]
            best_after[m] = best_after[m + 1] + max(fits, default=0.0)
        best, best_value, nodes = None, -np.inf, 0
        stack: list[tuple[int, float, float, tuple[int, ...]]] = [(0, outlook.soc, 0.0, ())]
        while stack:
            m, soc, value, path = stack.pop()
            if m == steps:
                if value > best_value:
                    best, best_value = path, value
                continue
            nodes += 1
            if value + best_after[m] <= best_value + 1e-9 * abs(best_value) or (nodes > NODES and best is not None):
                continue
            branches = []
            for i in order:
                after = soc - rate * current_a(mean[m] + powers[i], b.voltage_v, b.resistance_ohm)
                if limit[m] + powers[i] <= per_soc * after + FEASIBLE_W:
                    branches.append((m + 1, after, value + costs[i][m], (*path, i)))
            stack.extend(reversed(branches))
        if best is None:
            raise Infeasible("no values of the computations keep the power within what the battery allows")
        return np.array([[levels[i]] for i in best])

    # --- the fallback

    def lowered(self, now: FloatArray, deltas: FloatArray, outlook: Outlook) -> FloatArray:
        """The fallback of a failed solve: from the parameters in force, lower all by δ until every constraint holds.

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


def _floor(levels: Sequence[float], value: float) -> float:
    below = [level for level in levels if level <= value + 1e-9]
    return below[-1] if below else levels[0]


def _separate(computations: Computations) -> tuple[FloatArray, FloatArray]:
    """ν and τ of each computation (letter, Eq. 11), the others at their lowest; what all cost there is shared evenly."""
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

"""Optimal control of the computations over a receding horizon, as a quadratic program.

The periodic motion power is exogenous (B touches α0 only), so the states drop out of the problem. What remains are the
levels of the computations at each step of the horizon, coupled by the state of charge:

    maximise   Σ_m l(q_m, c_m) + l_f(q_M)
    subject to (h_m + g(c_m)) / (Q_c V crate) ≤ b_m              the output constraint, or 0 ≤ b_m without a crate
               b_m = b_0 − Σ_{j≤m} k_b I(h̄_j + g(c_j)) Δ/Q_c     the battery
               R c_m − r ≥ 0                                     trade-offs

y ≥ 0 needs no row: computations only add power.

l is convex and maximised, so its tangents are no bounds. The problem is linearised along the concave envelope of l over
the power of the levels instead: at each step the QP mixes neighbouring vertices of the envelope, and value, power and
use of charge are linear in the mixture. OSQP solves it, close to the last solution (a proximal term). The solution is
rounded to levels within its power and verified against the constraints above. The QP's multipliers give a bound that no
choice of levels exceeds: the reported gap is the distance to it.

Source: letter, Eq. 16 and Def. III.3; draft 002, Eq. 15; drafts 003 and 004, Eq. 9, for the costs, the trade-offs and
the subroutine that lowers by δ.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray, upper_envelope
from eadp.core.signals import output_row
from eadp.errors import Infeasible, SolverFailed
from eadp.models.battery import LETTER, Battery
from eadp.papers.forecasting import rotated, scaling_factors
from eadp.planning.base import SolverReport, thinned
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

CONTROL, POWER, QUADRATIC, OUTPUT = "control", "power", "quadratic", "output"

PROXIMAL = 1e-5
"""Weight of the proximal term, for a gradient scaled to 1."""

OPTIMAL = 1e-6
"""Relative distance to the bound below which the last solution is proven to be optimal still."""

FEASIBLE_W = 1e-6
"""Excess of power that counts as rounding [W]."""

FLOOR_SLACK = 1e-4
"""Tolerance, as a share of the span of power, within which a relaxed power counts as its next level above."""

MIN_REACH = 1e-5
"""Smallest scaling of a variable."""

UNDELIVERABLE = 1e6
"""Charge that a power takes which the battery cannot deliver: more than there is."""

CHOICES = 4096
"""Maximum number of combinations of levels; above it, every second level of the longest list is dropped."""


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
    """

    low: FloatArray
    high: FloatArray
    levels: Sequence[tuple[float, ...]]
    power: Callable[[Sequence[float]], float]


@dataclass(frozen=True)
class HorizonCost:
    """What the horizon maximises, and its weights.

    Parameters
    ----------
    kind : str
        `control`, `power`, `quadratic` or `output`.
    state_weights : array, shape (m, m), or float
        Q of `quadratic`; a number multiplies the identity.
    control_weights : array, shape (σ, σ), or float
        R of `quadratic`; a number multiplies the identity.
    control_offsets : array, shape (σ,), optional
        What fixed parameters add to R û: the rows of R that name them, times their û.
    terminal_weight : float
        Weight of l_f = ½ qᵀ diag(C) q at the end of the horizon.
    """

    kind: str = CONTROL
    state_weights: FloatArray | float = 1.0
    control_weights: FloatArray | float = 1.0
    control_offsets: FloatArray | float = 0.0
    terminal_weight: float = 0.0


class HorizonForecast(NamedTuple):
    """Forecast of motion power and charge over the horizon.

    Parameters
    ----------
    limit_motion_w, mean_motion_w : array, shape (M,)
        Motion power at the instant of each step where the output constraint is checked, and its mean over the
        step, 0 or more [W].
    soc : float
    step_s : float
        Length of a step [s].
    state_w : array, shape (m,)
        Energy state q of the motion at the start [W], which the costs of the state count.
    period_s : float or None
        T [s].
    """

    limit_motion_w: FloatArray
    mean_motion_w: FloatArray
    soc: float
    step_s: float
    state_w: FloatArray
    period_s: float | None


class HorizonSolution(NamedTuple):
    """A solution.

    Attributes
    ----------
    chosen : array, shape (M, σ)
        Levels at each step.
    chosen_w : array, shape (M,)
        Their power [W].
    objective, bound : float
        Value of the levels, and a bound that no feasible levels exceed.
    kept : bool
        Whether the last solution was proven to be optimal still, and OSQP did not run.
    battery_limit : str or None
        Limit of the battery's power that excludes the next choice above at some step.
    """

    chosen: FloatArray
    chosen_w: FloatArray
    objective: float
    bound: float
    kept: bool
    battery_limit: str | None

    @property
    def gap(self) -> float:
        """Relative distance between the objective and its bound."""
        return (self.bound - self.objective) / max(abs(self.bound), 1e-12)


class _Table(NamedTuple):
    """Of each step and choice, shape (M, J): its value, the charge `drop` that it takes, and the charge `limit`.

    Charges are states of charge. A choice is feasible where at least `limit` is left after it.
    """

    value: FloatArray
    drop: FloatArray
    limit: FloatArray


class _Relaxed(NamedTuple):
    """A solution of the QP: the mixtures, and the multipliers of its power rows."""

    z: FloatArray
    multipliers: FloatArray


class _Mixture:
    """The variables of the QP: at each step, shares of the way from a vertex of the envelope to the next.

    Parameters
    ----------
    vertices : sequence of M tuples
        Choices on the envelope at each step, in ascending order of power.
    powers_w : array, shape (J,)
    report : SolverReport
    """

    def __init__(self, vertices: Sequence[tuple[int, ...]], powers_w: FloatArray, report: SolverReport) -> None:
        pairs = [(m, low, high) for m, own in enumerate(vertices) for low, high in itertools.pairwise(own)]
        variables: IntArray = np.array(pairs, dtype=np.intp).reshape(-1, 3).T
        self.step, low, high = variables
        # flat indices of both vertices in arrays of shape (M, J)
        self.below, self.above = self.step * len(powers_w) + low, self.step * len(powers_w) + high
        self.rises_w = powers_w[high] - powers_w[low]
        self.steps, self.size = len(vertices), len(pairs)
        # shape (M, variables): 1 where a variable's step is not after the row's, so that its charge is missing there
        self.until = (self.step <= np.arange(self.steps)[:, None]).astype(float)
        # shape (M, variables): 1 at a variable's own step
        self._own = (self.step == np.arange(self.steps)[:, None]).astype(float)
        # A: the variables themselves, then the power rows, which `solved` fills in
        self._matrix = np.vstack([np.eye(self.size), self.until])
        self._lower = np.repeat([0.0, -UNBOUNDED], [self.size, self.steps])
        self.program = QuadraticProgram(self._matrix > 0, PROXIMAL, report) if pairs else None
        # whether all steps have the same vertices, so that a solution can be moved by a step
        self.shifts = len(set(vertices)) == 1

    def problem(self, table: _Table) -> tuple[FloatArray, FloatArray]:
        """What each variable gains, and the power rows, shape (M, variables)."""
        # differences from a vertex to the next; the charge required, `limit`, counts at the variable's own step
        gain, drop, limit = [array.take(self.above) - array.take(self.below) for array in table]
        return gain, self.until * drop + self._own * limit

    def shifted(self, last: _Relaxed) -> _Relaxed | None:
        """A solution moved by a step, with its last step repeated; None where steps have different vertices."""
        z, each = last.z, self.size // self.steps
        if not self.shifts:
            return None
        return _Relaxed(np.concatenate([z[each:], z[-each:]]), np.concatenate([last.multipliers[1:], [0.0]]))

    def solved(self, gain: FloatArray, rows: FloatArray, spare: FloatArray, last: _Relaxed | None) -> _Relaxed:
        """The solution of the QP near the last one: max gain·z subject to rows z ≤ spare, 0 ≤ z ≤ 1.

        Each variable is scaled by its reach: how far it could rise if it alone used the slack of the rows, `spare`.
        With little charge this is small; without this scaling OSQP stalls.
        """
        if self.program is None:
            return _Relaxed(np.zeros(0), np.zeros(self.steps))
        shares = np.divide(spare[:, None], rows, out=np.ones_like(rows), where=rows > 0)
        reach = _between(np.minimum.reduce(shares), MIN_REACH)
        # z = reach · x; each row in units of its largest entry, the gain in units of its largest
        rows, gain = rows * reach, gain * reach
        units, largest = np.maximum.reduce(rows, axis=1) + 1e-300, float(np.maximum.reduce(gain))
        np.divide(rows, units[:, None], out=self._matrix[self.size :])
        upper = np.concatenate([1.0 / reach, spare / units])
        centre = np.zeros(self.size) if last is None else last.z / reach
        found = self.program.solve(gain / -largest, self._matrix, self._lower, upper, centre)
        multipliers = np.maximum(found.multipliers[self.size :], 0.0) * (largest / units)
        return _Relaxed(_between(found.x * reach, 0.0), multipliers)


class Horizon:
    """The optimal control problem for one set of computations and one number of steps: built once, solved many times.

    Parameters
    ----------
    computations : ComputationLevels
    battery : Battery
    steps : int
        M.
    cost : HorizonCost
    trade_offs : sequence of (R row of shape (σ,), r)
        Rows R c − r ≥ 0; contributions of other parameters are in r.
    report : SolverReport, optional
        Counts the runs of OSQP.
    """

    def __init__(
        self,
        computations: ComputationLevels,
        battery: Battery,
        steps: int,
        cost: HorizonCost | None = None,
        trade_offs: Sequence[tuple[Sequence[float], float]] = (),
        report: SolverReport | None = None,
    ) -> None:
        self._c = computations
        self._battery = battery
        self._steps = steps
        self._delivered_w = float(battery.max_power_w(battery.voltage_v))
        self._cost = cost or HorizonCost()
        self._report = report or SolverReport()
        self.choices, self.powers_w = self._feasible_choices(trade_offs)
        self._span_w = float(self.powers_w[-1] - self.powers_w[0]) if len(self.powers_w) > 1 else 0.0
        u = self._controls()
        r = _square(self._cost.control_weights, u.shape[1])
        # l of the controls alone: Σû², or ½ ûᵀ R û
        if self._cost.kind == QUADRATIC:
            values = 0.5 * np.einsum("ji,ik,jk->j", u, r, u) + (u * self._cost.control_offsets).sum(axis=1)
        else:
            values = (u * u).sum(axis=1)
        self._control_values = np.repeat(values[None], steps, axis=0)
        # flat indices of each step's first choice in arrays of shape (M, J)
        self._at = np.arange(steps) * len(self.choices)
        self._vertices = (self._envelope(values),) * steps
        self._mixtures: dict[tuple[tuple[int, ...], ...], _Mixture] = {}
        self._last: tuple[_Mixture, _Relaxed] | None = None

    def _feasible_choices(self, trade_offs: Sequence[tuple[Sequence[float], float]]) -> tuple[FloatArray, FloatArray]:
        """The J combinations of levels that satisfy the trade-offs, shape (J, σ), and their powers [W], shape (J,).

        In ascending order of power. Of more than `CHOICES` combinations some levels are left out first.
        """
        choices = np.array(list(itertools.product(*thinned(self._c.levels, CHOICES))), dtype=float)
        rows = np.array([row for row, _ in trade_offs], dtype=float).reshape(-1, len(self._c.low))
        least = np.array([r for _, r in trade_offs], dtype=float)
        choices = choices[(choices @ rows.T >= least - 1e-9 * (1 + np.abs(least))).all(axis=1)]
        powers = np.array([self._c.power(choice.tolist()) for choice in choices], dtype=float)
        order = np.argsort(powers, kind="stable")
        return choices[order], powers[order]

    def _controls(self) -> FloatArray:
        """The power that each computation stands for, û = ν c + τ [W], at each choice: shape (J, σ).

        From its share of the minimum power, an even one, at its lowest level, to that and what it adds at its highest.

        Source: letter, Eq. 11.
        """
        c, count = self._c, len(self._c.low)
        base_w = c.power(c.low.tolist())
        controls = np.empty_like(self.choices)
        for k in range(count):
            raised = c.low.copy()
            raised[k] = c.high[k]
            share_w = base_w / count
            nu, tau = scaling_factors(c.low[k], c.high[k], share_w, share_w + c.power(raised.tolist()) - base_w)
            controls[:, k] = nu * self.choices[:, k] + tau
        return controls

    # --- the model

    def table(self, forecast: HorizonForecast) -> _Table:
        """Value, use of charge and limit of every choice at every step; see `_Table`."""
        b, p = self._battery, self.powers_w
        power = forecast.mean_motion_w[:, None] + p
        drop = b.drain_per_s(power, b.voltage_v) * forecast.step_s
        drop[power > self._delivered_w] = UNDELIVERABLE
        limit = (forecast.limit_motion_w[:, None] + (p - FEASIBLE_W)) / b.power_per_soc_w
        return _Table(self._values(forecast), drop, limit)

    def _values(self, forecast: HorizonForecast) -> FloatArray:
        """The objective l of each choice at each step, shape (M, J), with the terminal cost l_f at the last."""
        cost, p = self._cost, self.powers_w
        if cost.kind == CONTROL and not cost.terminal_weight:
            return self._control_values
        times_s = np.arange(self._steps + 1, dtype=np.float64) * forecast.step_s
        states = rotated(forecast.state_w, forecast.period_s, times_s)
        output = np.diag(output_row(len(forecast.state_w) // 2))
        values = self._control_values.copy()
        if cost.kind == OUTPUT:
            values = 0.5 * (forecast.limit_motion_w[:, None] + p) ** 2
        elif cost.kind == POWER:
            values = _state_values(states[:-1], p, output)
        elif cost.kind == QUADRATIC:
            values += _state_values(states[:-1], p, _square(cost.state_weights, len(output)))
        values[-1] += cost.terminal_weight * _state_values(states[-1:], p, output)[0]
        return values

    def _violated(self, made: IntArray, table: _Table, soc: float) -> int | None:
        """The first step whose choice requires more charge than is left; None if all are feasible.

        `made`, shape (M,), is the choice of each step, an index to `choices`.
        """
        # feasible: limit ≤ charge after the drops up to this step; NaN is a violation, too
        at = self._at + made
        short = ~(table.limit.take(at) <= soc - table.drop.take(at).cumsum())
        step = int(short.argmax())
        return step if short[step] else None

    # --- solution

    def solve(self, forecast: HorizonForecast) -> HorizonSolution:
        """Choose the levels of each step: by the QP, then rounded to levels.

        Raises
        ------
        Infeasible
            If the levels of minimum power are infeasible.
        SolverFailed
            If OSQP failed; the caller's fallback is `lowered`.
        """
        if not len(self.choices):
            raise Infeasible("no values of the computations satisfy the trade-offs")
        table, soc = self.table(forecast), forecast.soc
        if not math.isfinite(soc + table.limit.sum() + table.drop.sum()):
            raise SolverFailed("a forecast that is not finite")
        # what minimum power leaves of the charge
        spare = soc - table.drop[:, 0].cumsum() - table.limit[:, 0]
        if spare.min() < 0:
            raise Infeasible("even the computations of minimum power exceed what the battery allows")
        mixture = self._mixture(table)
        gain, rows = mixture.problem(table)
        # the last solution, a step later: kept where it is proven to be optimal still, else the centre of the QP
        found = last = mixture.shifted(self._last[1]) if self._last and self._last[0] is mixture else None
        bound = None if last is None else self._proof(last, gain, rows, spare, table, soc)
        kept = bound is not None
        if found is None or bound is None:
            found = mixture.solved(gain, rows, spare, last)
            bound = _bound(found.multipliers, table, soc)
        self._last = mixture, found
        # the QP's power at each step, and the levels within it
        power_w = self.powers_w[0] + np.bincount(mixture.step, found.z * mixture.rises_w, self._steps)
        made = self._rounded(power_w, table, soc)
        objective = float(table.value.take(self._at + made).sum())
        limit = self._battery_limit(np.minimum(made + 1, len(self.choices) - 1), made, table, soc)
        chosen, chosen_w = self.choices[made], self.powers_w[made]
        return HorizonSolution(chosen, chosen_w, objective, bound, kept, limit)

    def battery_limit(self, forecast: HorizonForecast) -> str | None:
        """The battery's limit of power that the levels of minimum power exceed at some step; None if they do not."""
        lowest = np.zeros(self._steps, dtype=np.intp)
        return self._battery_limit(lowest, lowest, self.table(forecast), forecast.soc)

    def _battery_limit(self, above: IntArray, made: IntArray, table: _Table, soc: float) -> str | None:
        """The battery's limit that a choice of `above` exceeds, put at its step in place of the one made; None without.

        `above` and `made`, shape (M,), are choices of each step; only one step is changed at a time.
        """
        at = self._at + above
        drop = table.drop.take(at)
        if (drop >= UNDELIVERABLE).any():
            return self._battery.limit_at(self._battery.voltage_v)
        if self._battery.letter_crate_per_h is None:
            return None
        # the charge after each step with its choice above, those before it as made
        taken = table.drop.take(self._at + made)
        short = table.limit.take(at) > soc - (taken.cumsum() - taken + drop)
        return LETTER if short.any() else None

    def _envelope(self, values: FloatArray) -> tuple[int, ...]:
        """Choices on the concave envelope of value over power; `values` are those of the first choices, or of all."""
        tolerance = 1e-12 * abs(float(values[0])) if len(values) else 0.0
        return tuple(upper_envelope(self.powers_w[: len(values)], values, tolerance))

    def _mixture(self, table: _Table) -> _Mixture:
        """The variables of the QP: mixtures of the deliverable choices on the concave envelope at each step."""
        vertices, delivered = self._vertices, table.drop < UNDELIVERABLE
        if table.value is not self._control_values or not delivered.all():
            counts = delivered.sum(axis=1).tolist()
            vertices = tuple(self._envelope(row[:count]) for row, count in zip(table.value, counts, strict=True))
        if vertices not in self._mixtures:
            self._mixtures[vertices] = _Mixture(vertices, self.powers_w, self._report)
        return self._mixtures[vertices]

    def _proof(
        self, last: _Relaxed, gain: FloatArray, rows: FloatArray, spare: FloatArray, table: _Table, soc: float
    ) -> float | None:
        """The bound on the objective if it proves the last solution to be optimal still; None if it does not.

        None, too, where the last solution violates a constraint now.
        """
        if (rows @ last.z > spare).any():
            return None
        value = float(table.value[:, 0].sum()) + float(gain @ last.z)
        bound = _bound(last.multipliers, table, soc)
        return bound if bound - value <= OPTIMAL * abs(bound) else None

    def _rounded(self, power_w: FloatArray, table: _Table, soc: float) -> IntArray:
        """The best choice of each step within the QP's power, verified; shape (M,).

        `power_w`, shape (M,), is the QP's power [W]. A choice is an index to `powers_w`, which rise, and to the columns
        of the table. Steps that exceed a constraint are lowered; charge that is left over goes to the steps left below
        the QP's power.
        """
        # a power just below a level counts as that level, unless this violates a constraint
        for slack in (FLOOR_SLACK * self._span_w, 0.0):
            within = self.powers_w <= np.maximum(power_w + slack, self.powers_w[0])[:, None]
            made: IntArray = np.where(within, table.value, -math.inf).argmax(axis=1)
            violated = self._violated(made, table, soc)
            if violated is None:
                break
        while violated is not None:
            # the last step up to the violation that is not at minimum power yet, which is feasible everywhere
            step = int(np.flatnonzero(made[: violated + 1])[-1])
            made[step] = table.value[step, : made[step]].argmax()
            violated = self._violated(made, table, soc)
        below_qp = power_w > self.powers_w[made] + FLOOR_SLACK * self._span_w
        while below_qp.any() and (raised := self._raised(made, below_qp, table, soc)) is not None:
            made = raised
        return made

    def _raised(self, made: IntArray, below_qp: np.ndarray, table: _Table, soc: float) -> IntArray | None:
        """The choices with one step raised to its next better choice; None where no raise is better and feasible.

        `made`, shape (M,), is the choice of each step. Only steps left below the QP's power are raised: `below_qp`,
        shape (M,). Raises are tried by gain, the greatest first. Where the charge does not suffice, an earlier step
        that frees what is missing, and loses less than is gained, is lowered. Charges are states of charge.
        """
        at = self._at + made
        used, value = table.drop.take(at), table.value.take(at)
        # of each step its next better choice above, and the charge missing for it
        better = (table.value > value[:, None]) & (np.arange(len(self.choices)) > made[:, None])
        above = better.argmax(axis=1)
        at += above - made
        missing = table.limit.take(at) - (soc - used.cumsum() + used - table.drop.take(at))
        # the most that lowering a single step, this one or an earlier one, frees
        freed = np.maximum.accumulate(used - np.minimum.reduce(table.drop, axis=1))
        steps = np.flatnonzero(below_qp & (table.value.take(at) > value) & (missing <= freed))
        losses = value - table.value.take(at)
        raises = (each.take(steps).tolist() for each in (losses, np.arange(self._steps), above, missing))
        for minus_gain, step, choice, lack in sorted(zip(*raises, strict=True)):
            trial = made.copy()
            trial[step] = choice
            # without a lack, the raise alone is tried first
            if lack <= 0 and self._violated(trial, table, soc) is None:
                return trial
            # of every choice at every earlier step: the value lost by it, and whether it frees enough; shape (step, J)
            loss = value[:step, None] - table.value[:step]
            enough = used[:step, None] - table.drop[:step] >= max(lack, 1e-15)
            places = np.flatnonzero(enough & (loss < -minus_gain))
            for place in places[loss.take(places).argsort(kind="stable")].tolist():
                earlier, lower = divmod(place, len(self.choices))
                trial[:step] = made[:step]
                trial[earlier] = lower
                if self._violated(trial, table, soc) is None:
                    return trial
        return None

    @property
    def lowest(self) -> list[float]:
        """The lowest level of each computation."""
        return [levels[0] for levels in self._c.levels]

    # --- the drafts' subroutine, also the fallback

    def lowered(self, deltas: FloatArray, forecast: HorizonForecast) -> FloatArray:
        """The maximum parameters c̄, lowered by δ until every constraint holds.

        Parameters
        ----------
        deltas : array, shape (σ,)
            δ.
        forecast : HorizonForecast

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
        table = self.table(forecast)
        c = self._c.high
        while True:
            # the greatest levels up to c
            values = [
                max((level for level in levels if level <= x + 1e-9), default=levels[0])
                for levels, x in zip(self._c.levels, c, strict=True)
            ]
            found = np.flatnonzero((self.choices == values).all(axis=1))
            if len(found) and self._violated(np.full(self._steps, found[0]), table, forecast.soc) is None:
                return np.tile(values, (self._steps, 1))
            if (c <= self._c.low).all():
                raise Infeasible("even the minimum parameters are infeasible")
            # as many times δ as lower one of the levels
            above = [(x + 1e-9 - value) // delta for x, value, delta in zip(c, values, deltas, strict=True)]
            times = 1 + min(n for n, x, low in zip(above, c, self._c.low, strict=True) if x > low)
            c = np.maximum(c - max(times, 1.0) * deltas, self._c.low)


def _between(shares: FloatArray, least: float) -> FloatArray:
    """Shares within a least one and 1, as numpy's clip in a third of its time."""
    within: FloatArray = np.minimum(np.maximum(shares, least), 1.0)
    return within


def _bound(multipliers: FloatArray, table: _Table, soc: float) -> float:
    """Lagrangian bound of the value of any feasible levels, for multipliers of 0 or more, shape (M,).

    A choice at step m requires its limit at m, and takes its drop off the charge at m and at every later step.
    """
    # Σ_m max_c [l_m − λ_m limit_m − Σ_{j≥m} λ_j drop_m] + Σ_m λ_m b₀
    later = multipliers[::-1].cumsum()[::-1]
    net = table.value - multipliers[:, None] * table.limit - later[:, None] * table.drop
    return float(np.add.reduce(np.maximum.reduce(net, axis=1)) + np.add.reduce(multipliers) * soc)


def _square(weights: FloatArray | float, size: int) -> FloatArray:
    """A weight matrix of a size; a number multiplies the identity."""
    return weights if isinstance(weights, np.ndarray) else weights * np.eye(size)


def _state_values(states_w: FloatArray, powers_w: FloatArray, weights: FloatArray) -> FloatArray:
    """½ xᵀ Q x [W²], shape (n, J): x is an energy state q with the power of each of J choices added to its α0.

    `states_w`, shape (n, 2r + 1), are the states q; `weights` is Q, symmetric.
    """
    # x = q + p e₀: ½ (qᵀ Q q + 2 p (Q q)₀ + Q₀₀ p²)
    weighted = states_w @ weights
    without_computing = (states_w * weighted).sum(axis=1)[:, None]
    values: FloatArray = 0.5 * (without_computing + powers_w * (2 * weighted[:, :1] + weights[0, 0] * powers_w))
    return values

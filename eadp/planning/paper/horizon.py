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

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.envelope import upper_envelope
from eadp.core.flight.battery import drain_per_s
from eadp.core.signals.harmonics import rotated
from eadp.core.signals.scaling import computation_scaling
from eadp.errors import Infeasible, SolverFailed
from eadp.models.battery import LETTER, Battery
from eadp.planning.base import SolverReport, thinned
from eadp.planning.qp import UNBOUNDED, QuadraticProgram

CONTROL, POWER, QUADRATIC, OUTPUT = "control", "power", "quadratic", "output"

PROXIMAL = 1e-5
"""Weight of the proximal term, for a gradient scaled to 1."""

OPTIMAL = 1e-6
"""Relative distance to the bound below which the last solution is proven to be optimal still."""

LAST_MULTIPLIER = np.zeros(1)
"""Multiplier of the step that a horizon gains at its end."""

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
    power_w : array, shape (M,)
        Power of the QP's solution at each step [W].
    objective, bound : float
        Value of the levels, and a bound that no feasible levels exceed.
    iterations : int
        Iterations of OSQP; 0 where the last solution was kept.
    kept : bool
        Whether the last solution was proven to be optimal still, and OSQP did not run.
    battery_limit : str or None
        Limit of the battery's power that excludes the next choice above at some step.
    """

    chosen: FloatArray
    chosen_w: FloatArray
    power_w: FloatArray
    objective: float
    bound: float
    iterations: int
    kept: bool
    battery_limit: str | None

    @property
    def gap(self) -> float:
        """Relative distance between the objective and its bound."""
        return (self.bound - self.objective) / max(abs(self.bound), 1e-12)


class _Table(NamedTuple):
    """Every choice at every step: value, charge that it takes, and power limit; arrays of shape (M, J).

    `limit` is the state of charge that the power of a choice requires. `deliverable`: the battery delivers all powers.
    `spare`, of shape (M,), is the charge that minimum power leaves above its limit, `least` its minimum: NaN if any of
    this is not finite.
    """

    value: FloatArray
    drop: FloatArray
    limit: FloatArray
    deliverable: bool
    spare: FloatArray
    least: float


class _Shape(NamedTuple):
    """Whether values rise with every choice, and whether the chord from first to last is their concave envelope."""

    rising: bool
    straight: bool


class _Problem(NamedTuple):
    """The QP's data before scaling: an entry for each variable, and the power rows, shape (M, variables)."""

    gain: FloatArray
    rows: FloatArray


class _Scaled(NamedTuple):
    """The QP's data, and its scaling; the rows are in the mixture's matrix."""

    gradient: FloatArray
    upper: FloatArray
    reach: FloatArray
    units: FloatArray
    largest: float


class _Mixture:
    """The variables of the QP: at each step, shares of the way from a vertex of the envelope to the next.

    Parameters
    ----------
    vertices : sequence of M lists
        Choices on the envelope at each step, in ascending order of power.
    powers_w : array, shape (J,)
    report : SolverReport
    """

    def __init__(self, vertices: Sequence[Sequence[int]], powers_w: FloatArray, report: SolverReport) -> None:
        steps = len(vertices)
        pairs = [(m, low, high) for m, own in enumerate(vertices) for low, high in itertools.pairwise(own)]
        variables: IntArray = np.ascontiguousarray(np.array(pairs, dtype=np.intp).reshape(-1, 3).T)
        self.step, low, high = variables
        self.size, each = len(pairs), np.arange(len(pairs))
        # entries of the table and of the rows, by their places
        self.below, self.above = (self.step * len(powers_w) + end for end in (low, high))
        self.own = self.step * len(pairs) + each
        self.rises_w = powers_w[high] - powers_w[low]
        self.until = (self.step <= np.arange(steps)[:, None]).astype(float)
        filled = np.vstack([np.eye(self.size), self.until]) > 0
        self.program = QuadraticProgram(filled, PROXIMAL, report) if pairs else None
        self.matrix = np.vstack([np.eye(self.size), np.zeros((steps, self.size))])
        self.lower = np.concatenate([np.zeros(self.size), np.full(steps, -UNBOUNDED)])
        # the same variables a step later
        self.shifts = all(list(own) == list(vertices[0]) for own in vertices)
        per_step = self.size // steps
        self.later = np.minimum(each + per_step, each % max(per_step, 1) + self.size - per_step)

    def problem(self, table: _Table) -> _Problem:
        """The data of the QP."""
        gain, drop, limit = (array.take(self.above) - array.take(self.below) for array in table[:3])
        rows = self.until * drop
        rows.ravel()[self.own] += limit
        return _Problem(gain, rows)

    def power_w(self, z: FloatArray) -> FloatArray:
        """What mixtures add to the minimum power at each step [W]."""
        added: FloatArray = np.bincount(self.step, z * self.rises_w, len(self.until)).astype(np.float64)
        return added


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
        self.choices, self.powers_w = self._listed(trade_offs)
        self._span_w = float(self.powers_w[-1] - self.powers_w[0]) if len(self.powers_w) > 1 else 0.0
        u = self._controls()
        r = _square(self._cost.control_weights, u.shape[1])
        # l of the controls alone: Σû², or ½ ûᵀ R û
        if self._cost.kind == QUADRATIC:
            self._control_values = 0.5 * np.einsum("ji,ik,jk->j", u, r, u) + u @ np.broadcast_to(
                np.asarray(self._cost.control_offsets, dtype=float), u.shape[1]
            )
        else:
            self._control_values = (u * u).sum(axis=1)
        # places of the steps' rows in the table
        self._at = np.arange(steps) * len(self.choices)
        self._constant = np.repeat(self._control_values[None], steps, axis=0)
        self._constant_shape = self._shape_of(self._constant) if len(self.choices) else _Shape(True, True)
        self._mixtures: dict[tuple[tuple[int, ...], ...] | None, _Mixture] = {}
        self._last: tuple[_Mixture, FloatArray, FloatArray] | None = None

    def _listed(self, trade_offs: Sequence[tuple[Sequence[float], float]]) -> tuple[FloatArray, FloatArray]:
        """Every combination of levels that satisfies the trade-offs, and its power [W], in ascending order of power."""
        choices = np.array(list(itertools.product(*thinned(self._c.levels, CHOICES))), dtype=float)
        rows = np.array([row for row, _ in trade_offs], dtype=float).reshape(-1, len(self._c.low))
        least = np.array([r for _, r in trade_offs], dtype=float)
        choices = choices[(choices @ rows.T >= least - 1e-9 * (1 + np.abs(least))).all(axis=1)]
        powers = np.array([self._c.power(choice.tolist()) for choice in choices], dtype=float)
        order = np.argsort(powers, kind="stable")
        return choices[order], powers[order]

    def _controls(self) -> FloatArray:
        """û = ν c + τ of each computation at each choice [W], shape (J, σ): their minimum power is shared evenly.

        Source: letter, Eq. 11.
        """
        c, count = self._c, len(self._c.low)
        base_w = c.power(c.low.tolist())
        controls = np.empty_like(self.choices)
        for k in range(count):
            raised = c.low.copy()
            raised[k] = c.high[k]
            share_w = base_w / count
            nu, tau = computation_scaling(c.low[k], c.high[k], share_w, share_w + c.power(raised.tolist()) - base_w)
            controls[:, k] = nu * self.choices[:, k] + tau
        return controls

    # --- the model

    def table(self, forecast: HorizonForecast) -> _Table:
        """Value, use of charge and limit of every choice at every step."""
        b, p, values = self._battery, self.powers_w, self._values(forecast)
        power = forecast.mean_motion_w[:, None] + p
        drop = drain_per_s(power, b.voltage_v, b.resistance_ohm, b.drain_per_as) * forecast.step_s
        deliverable = bool(power.max(initial=0.0) <= self._delivered_w)
        if not deliverable:
            drop[power > self._delivered_w] = UNDELIVERABLE
        limit = (forecast.limit_motion_w[:, None] + (p - FEASIBLE_W)) / b.power_per_soc_w
        spare = forecast.soc - drop[:, 0].cumsum() - limit[:, 0]
        finite = math.isfinite(forecast.soc + limit.sum() + drop.sum())
        return _Table(values, drop, limit, deliverable, spare, float(spare.min()) if finite else math.nan)

    def _values(self, forecast: HorizonForecast) -> FloatArray:
        """l of each choice at each step, with l_f at the last."""
        cost, p = self._cost, self.powers_w
        values: FloatArray
        if cost.kind == OUTPUT:
            values = 0.5 * (forecast.limit_motion_w[:, None] + p) ** 2
        elif cost.kind == CONTROL:
            values = self._constant
        else:
            q = self._states(forecast, 0, self._steps)
            if cost.kind == POWER:
                values = _output_value(q, p)
            else:
                # ½ (q + e₁ g)ᵀ Q (q + e₁ g) + ½ ûᵀ R û
                weights = _square(cost.state_weights, q.shape[1])
                forces = q @ weights
                values = 0.5 * ((q * forces).sum(axis=1)[:, None] + p * (2 * forces[:, :1] + weights[0, 0] * p))
                values += self._control_values
        if cost.terminal_weight:
            values = values.copy()
            values[-1] += cost.terminal_weight * _output_value(self._states(forecast, self._steps, 1), p)[0]
        return values

    def _states(self, forecast: HorizonForecast, first: int, count: int) -> FloatArray:
        """Energy state of the motion [W] at the start of steps, shape (count, m)."""
        times_s: FloatArray = (first + np.arange(count, dtype=np.float64)) * forecast.step_s
        return rotated(forecast.state_w, forecast.period_s, times_s)

    def feasible(self, made: IntArray, table: _Table, soc: float) -> bool:
        """Whether a choice for each step, shape (M,), keeps to the constraints."""
        return self._violated(made, table, soc) is None

    def _violated(self, made: IntArray, table: _Table, soc: float) -> int | None:
        """The first step whose power requires more charge than is left."""
        at = self._at + made
        short = ~(table.limit.take(at) <= soc - table.drop.take(at).cumsum())
        step = int(short.argmax())
        return step if short[step] else None

    # --- solution

    def solve(self, forecast: HorizonForecast) -> HorizonSolution:
        """The levels of each step.

        Raises
        ------
        Infeasible
            If the levels of minimum power are infeasible.
        SolverFailed
            If OSQP failed; the caller's fallback is `lowered`.
        """
        if not len(self.choices):
            raise Infeasible("no values of the computations satisfy the trade-offs")
        table = self.table(forecast)
        _require(table.least)
        shape = self._constant_shape if table.value is self._constant else self._shape_of(table.value)
        mixture = self._mixture(table, shape.straight)
        iterations, kept = 0, self._kept(mixture, table, forecast.soc)
        if kept is not None:
            z, multipliers = kept
        else:
            z, multipliers, iterations = self._solved(mixture, table)
        self._last = mixture, z, multipliers
        power_w = self.powers_w[0] + mixture.power_w(z)
        made = self._rounded(power_w, table, shape.rising, forecast.soc)
        objective = float(table.value.take(self._at + made).sum())
        limit = self._battery_limit(np.minimum(made + 1, len(self.choices) - 1), made, table, forecast.soc)
        bound = _bound(multipliers, table, forecast.soc)
        chosen, chosen_w = self.choices[made], self.powers_w[made]
        return HorizonSolution(chosen, chosen_w, power_w, objective, bound, iterations, kept is not None, limit)

    def _follows(self, mixture: _Mixture) -> bool:
        """Whether the last solution mixed the same levels, and may be shifted by a step."""
        return self._last is not None and self._last[0] is mixture and mixture.shifts

    def battery_limit(self, forecast: HorizonForecast) -> str | None:
        """Limit of the battery's power that the levels of minimum power exceed."""
        lowest = np.zeros(self._steps, dtype=np.intp)
        return self._battery_limit(lowest, lowest, self.table(forecast), forecast.soc)

    def _battery_limit(self, above: IntArray, made: IntArray, table: _Table, soc: float) -> str | None:
        """Limit that choices exceed at some step, each alone in place of those made."""
        at = self._at + above
        drop = table.drop.take(at)
        if not table.deliverable and (drop >= UNDELIVERABLE).any():
            return self._battery.limit_at(self._battery.voltage_v)
        if self._battery.letter_crate_per_h is None:
            return None
        taken = table.drop.take(self._at + made)
        short = table.limit.take(at) > soc - (taken.cumsum() - taken + drop)
        return LETTER if short.any() else None

    def _shape_of(self, value: FloatArray) -> _Shape:
        p = self.powers_w
        rises = value[:, -1:] - value[:, :1]
        chord = value[:, :1] + rises * ((p - p[0]) / max(self._span_w, 1e-12))
        straight = len(p) > 1 and rises.min() > 0 and (value - chord).max() <= 1e-12 * chord.max()
        return _Shape(bool((value[:, 1:] > value[:, :-1]).all()), bool(straight))

    def _mixture(self, table: _Table, straight: bool) -> _Mixture:
        """The mixtures of the choices on the concave envelope of value over power at each step."""
        p, value, key = self.powers_w, table.value, None
        vertices: Sequence[Sequence[int]] = [[0, len(p) - 1]] * self._steps
        if not (straight and table.deliverable):
            vertices = [
                upper_envelope(p[:count], row[:count], 1e-12 * abs(float(row[0])))
                for row, count in zip(value, (table.drop < UNDELIVERABLE).sum(axis=1).tolist(), strict=True)
            ]
            key = tuple(map(tuple, vertices))
        if key not in self._mixtures:
            self._mixtures[key] = _Mixture(vertices, p, self._report)
        return self._mixtures[key]

    def _solved(self, mixture: _Mixture, table: _Table) -> tuple[FloatArray, FloatArray, int]:
        """The mixtures z of the QP, the multipliers of the power rows, and the iterations."""
        size = mixture.size
        if mixture.program is None:
            return np.zeros(0), np.zeros(self._steps), 0
        scaled = self._scaled(mixture, table)
        last = self._shifted(mixture)
        centre = np.zeros(size) if last is None else last / scaled.reach
        found = mixture.program.solve(scaled.gradient, mixture.matrix, mixture.lower, scaled.upper, centre)
        return (
            np.clip(found.x * scaled.reach, 0.0, 1.0),
            np.maximum(found.multipliers[size:], 0.0) * (scaled.largest / scaled.units),
            found.iterations,
        )

    def _scaled(self, mixture: _Mixture, table: _Table) -> _Scaled:
        """The data of the QP: each variable is scaled by its reach, each row then by its largest entry."""
        problem = mixture.problem(table)
        reach = _reach(problem.rows, table.spare)
        rows = problem.rows * reach
        units = rows.max(axis=1) + 1e-300
        gain = problem.gain * reach
        largest = float(gain.max())
        mixture.matrix[mixture.size :] = rows / units[:, None]
        upper = np.concatenate([1.0 / reach, table.spare / units])
        return _Scaled(gain / -largest, upper, reach, units, largest)

    def _shifted(self, mixture: _Mixture) -> FloatArray | None:
        """The last solution, a step later; None if it mixed other levels."""
        return self._last[1].take(mixture.later) if self._last and self._follows(mixture) else None

    def _kept(self, mixture: _Mixture, table: _Table, soc: float) -> tuple[FloatArray, FloatArray] | None:
        """The last solution, if it satisfies the new constraints and its multipliers prove that it is optimal."""
        z = self._shifted(mixture)
        if z is None or self._last is None:
            return None
        multipliers = np.concatenate([self._last[2][1:], LAST_MULTIPLIER])
        problem = mixture.problem(table)
        if (problem.rows @ z > table.spare).any():
            return None
        value = float(table.value[:, 0].sum()) + float(problem.gain @ z)
        bound = _bound(multipliers, table, soc)
        return (z, multipliers) if bound - value <= OPTIMAL * abs(bound) else None

    def _rounded(self, power_w: FloatArray, table: _Table, rising: bool, soc: float) -> IntArray:
        """The best choice of each step within the QP's power, verified.

        Steps that exceed a constraint are lowered; charge that rounding has left over goes to the steps that the QP
        mixed.
        """
        for slack in (FLOOR_SLACK * self._span_w, 0.0):
            made: IntArray = np.maximum(self.powers_w.searchsorted(power_w + slack, "right") - 1, 0)
            if not rising:
                within = np.arange(len(self.choices)) <= made[:, None]
                made = np.where(within, table.value, -math.inf).argmax(axis=1)
            violated = self._violated(made, table, soc)
            if violated is None:
                break
        while violated is not None:
            step = int(np.flatnonzero(made[: violated + 1])[-1])  # minimum power everywhere is feasible
            made[step] = table.value[step, : made[step]].argmax()
            violated = self._violated(made, table, soc)
        mixed = power_w > self.powers_w[made] + FLOOR_SLACK * self._span_w
        while mixed.any() and (raised := self._raised(made, mixed, table, soc)) is not None:
            made = raised
        return made

    def _raised(self, made: IntArray, mixed: np.ndarray, table: _Table, soc: float) -> IntArray | None:
        """Better choices with one mixed step raised to its next choice, if need be with an earlier step lowered.

        None if the constraints admit none.
        """
        at = self._at + made
        now, value = table.drop.take(at), table.value.take(at)
        left, most = soc - now.cumsum() + now, np.maximum.accumulate(now - table.drop[:, 0])
        raises = []
        for step in np.flatnonzero(mixed).tolist():
            better = np.flatnonzero(table.value[step, made[step] + 1 :] > value[step])
            if len(better):
                above = made[step] + 1 + better[0]
                short = table.limit[step, above] - (left[step] - table.drop[step, above])
                if short <= most[step]:
                    raises.append((value[step] - table.value[step, above], step, above, short))
        for loss, step, above, short in sorted(raises):
            losses = value[:step, None] - table.value[:step]
            enough = now[:step, None] - table.drop[:step] >= max(short, 1e-15)
            places = np.flatnonzero(enough & (losses < -loss))
            others = [
                divmod(place, len(self.choices))
                for place in places[np.argsort(losses.take(places), kind="stable")].tolist()
            ]
            for other, choice in [(step, above), *others] if short <= 0 else others:
                trial = made.copy()
                trial[other] = choice
                trial[step] = above
                if self.feasible(trial, table, soc):
                    return trial
        return None

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
        table = self.table(forecast)
        c = np.clip(now, self._c.low, self._c.high)
        while True:
            values = [_round_down(levels, x) for levels, x in zip(self._c.levels, c, strict=True)]
            found = np.flatnonzero((self.choices == values).all(axis=1))
            if len(found) and self.feasible(np.full(self._steps, found[0]), table, forecast.soc):
                return np.tile(values, (self._steps, 1))
            if (c <= self._c.low).all():
                raise Infeasible("even the minimum parameters are infeasible")
            c = np.maximum(c - deltas, self._c.low)


def _require(least: float) -> None:
    """Refuse a forecast that is not finite, or whose lowest powers leave less charge than their limits require."""
    if math.isnan(least):
        raise SolverFailed("a forecast that is not finite")
    if least < 0:
        raise Infeasible("even the computations of minimum power exceed what the battery allows")


def _reach(rows: FloatArray, spare: FloatArray) -> FloatArray:
    """Reach of each variable: how far it could rise if it alone used the slack of the rows.

    With little charge the reach is small; without this scaling OSQP stalls.
    """
    shares = np.divide(spare[:, None], rows, out=np.ones_like(rows), where=rows > 0)
    reach: FloatArray = np.clip(shares.min(axis=0), MIN_REACH, 1.0)
    return reach


def _bound(multipliers: FloatArray, table: _Table, soc: float) -> float:
    """Lagrangian bound of the value of any feasible levels, for multipliers of 0 or more, shape (M,).

    A choice at step m requires its limit at m, and takes its drop off the charge at m and at every later step.
    """
    if not multipliers.any():
        return float(table.value.max(axis=1).sum())
    later = np.cumsum(multipliers[::-1])[::-1]
    net = table.value - multipliers[:, None] * table.limit - later[:, None] * table.drop
    return float(net.max(axis=1).sum() + multipliers.sum() * soc)


def _square(weights: FloatArray | float, size: int) -> FloatArray:
    """A weight matrix; a number multiplies the identity."""
    return weights if isinstance(weights, np.ndarray) else weights * np.eye(size)


def _output_value(states_w: FloatArray, powers_w: FloatArray) -> FloatArray:
    """½ (q + Bu)ᵀ diag(C) (q + Bu) [W²], of states of shape (n, m) and powers of shape (J,): shape (n, J)."""
    alphas = states_w[:, 1::2]
    values: FloatArray = 0.5 * ((states_w[:, :1] + powers_w) ** 2 + (alphas * alphas).sum(axis=1)[:, None])
    return values


def _round_down(levels: Sequence[float], value: float) -> float:
    below = [level for level in levels if level <= value + 1e-9]
    return below[-1] if below else levels[0]

"""The computations over a horizon: integers against brute force, reals against other solvers, in a model of its own.

Gap to brute force, measured here: none in 300 instances of one computation, none in 128 of two computations with and
without trade-offs (the search is exact up to its limit of work). The reals lie below the best of SLSQP's answers from
several starts by less than 1e-6 in every instance whose closed form was proven, and in all but a few where charge is
short and g bends upwards: there tops are many.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from eadp.errors import Infeasible, SolverFailed
from eadp.models.battery import Battery
from eadp.planning.paper import horizon as module
from eadp.planning.paper.horizon import COSTS, ComputationLevels, Horizon, HorizonForecast
from eadp.planning.qp import QuadraticProgram

EXACT = 1e-9
SAME_OBJECTIVE = 1e-6
WITHIN_W = 2e-6
WEIGHTS = (0.7, 1.9)
SHAPES = ("linear", "convex", "concave")


@pytest.fixture(autouse=True)
def quiet(capfd):
    """Nothing is printed, by Python or by the solver's C code."""
    yield
    assert capfd.readouterr().out == ""


# --- a model independent of the package


class ClosedFormHorizon(Horizon):
    """Takes a certified closed form as the solution, without QPs."""

    def _ascent_to(self, value, filled, chosen, forecast):
        return filled, value, 0


@dataclass
class Case:
    """A problem, and the functions that say what is right of it."""

    battery: Battery
    computations: ComputationLevels
    forecast: HorizonForecast
    cost: str
    trade_offs: list
    power: Callable

    @property
    def steps(self):
        return len(self.forecast.limit_motion_w)

    def horizon(self, closed_form=True):
        problem = (self.computations, self.battery, self.steps, self.cost, self.trade_offs, WEIGHTS)
        return (ClosedFormHorizon if closed_form else Horizon)(*problem)

    def current_a(self, power_w):
        """The smaller root of R I² − V I + y = 0, inf where the battery cannot deliver y."""
        b = self.battery
        if b.resistance_ohm == 0:
            return power_w / b.voltage_v
        roots = np.roots([b.resistance_ohm, -b.voltage_v, power_w])
        return float(roots.real.min()) if np.all(np.abs(roots.imag) < 1e-12) else np.inf

    def drop(self, m, power_w):
        """What step m takes off the state of charge."""
        b, o = self.battery, self.forecast
        return b.k_b_per_s * o.step_s * self.current_a(o.mean_motion_w[m] + power_w) / b.capacity_ah

    def allowed_w(self, soc):
        b = self.battery
        return soc * b.capacity_ah * b.voltage_v * b.letter_crate_per_h

    def excess_w(self, plan):
        """The most by which a plan is above its limits [W], trade-offs counted as watts."""
        soc, worst = self.forecast.soc, -np.inf
        for m, c in enumerate(plan):
            power_w = self.power(c)
            soc -= self.drop(m, power_w)
            if not np.isfinite(soc):
                return np.inf
            worst = max(worst, self.forecast.limit_motion_w[m] + power_w - self.allowed_w(soc))
            worst = max([worst, *(least - np.dot(row, c) for row, least in self.trade_offs)])
        return worst

    def control2(self, c):
        """Σû² with û = νc + τ, the power of all at their lowest shared evenly."""
        low, high = self.computations.low, self.computations.high
        base, total = self.power(low), 0.0
        for k in range(len(low)):
            raised = low.copy()
            raised[k] = high[k]
            share = (c[k] - low[k]) / (high[k] - low[k])
            total += (base / len(low) + (self.power(raised) - base) * share) ** 2
        return total

    def stage_cost(self, m, c):
        o, power_w = self.forecast, self.power(c)
        quadratic = 0.5 * ((o.level_w + power_w) ** 2 + o.ripple_w2)
        return {
            "output": 0.5 * (o.limit_motion_w[m] + power_w) ** 2,
            "control": self.control2(c),
            "power": quadratic,
            "quadratic": WEIGHTS[0] * quadratic + 0.5 * WEIGHTS[1] * self.control2(c),
        }[self.cost]

    def objective(self, plan):
        return sum(self.stage_cost(m, c) for m, c in enumerate(plan))

    def brute_force(self):
        """The best objective over every sequence of levels, −inf where none is admissible; all sequences at once."""
        choices = [np.array(c) for c in itertools.product(*self.computations.levels)]
        choices = [c for c in choices if all(np.dot(row, c) >= least for row, least in self.trade_offs)]
        if not choices:
            return -np.inf
        sequences = np.array(list(itertools.product(range(len(choices)), repeat=self.steps)))
        powers = np.array([self.power(c) for c in choices])
        soc, value = np.full(len(sequences), self.forecast.soc), np.zeros(len(sequences))
        for m in range(self.steps):
            made = sequences[:, m]
            soc = soc - np.array([self.drop(m, power_w) for power_w in powers])[made]
            value += np.array([self.stage_cost(m, c) for c in choices])[made]
            with np.errstate(invalid="ignore"):
                held = self.forecast.limit_motion_w[m] + powers[made] <= self.allowed_w(soc) + 1e-6
            value[~held] = -np.inf
        return float(value.max())


def one_computation(rng, shape, levels):
    """Levels of uneven distance from a lowest one, and a power that rises with them."""
    low = float(rng.integers(0, 3))
    steps = np.r_[0.0, np.sort(rng.choice(np.arange(1.0, 12.0), levels - 1, replace=False))]
    watts = {
        "linear": 2.0 + rng.uniform(0.3, 1.0) * steps,
        "convex": 1.0 + 0.08 * steps**2 + 0.2 * steps,
        "concave": 1.0 + 2.5 * np.sqrt(steps) + 0.05 * steps,
    }[shape]
    places = low + steps

    def power(c):
        return float(np.interp(c[0], places, watts))

    return ComputationLevels(places[:1], places[-1:], [tuple(places.tolist())], power)


def two_computations(rng, levels=3):
    """Two, whose powers depend on each other."""
    slopes, both = rng.uniform(0.2, 1.0, 2), rng.uniform(0.0, 0.1)
    low = rng.integers(0, 2, 2).astype(float)
    sets = [tuple((low[k] + np.r_[0.0, np.cumsum(rng.integers(1, 4, levels - 1))]).tolist()) for k in range(2)]

    def power(c):
        return float(1.0 + slopes @ c + both * c[0] * c[1])

    return ComputationLevels(low, np.array([levels[-1] for levels in sets]), sets, power)


def case(rng, computations, steps, cost, trade_offs=(), tight=True):
    """A case whose charge is short for the whole horizon, or for some of its steps, or for none."""
    battery = Battery(
        voltage_v=rng.uniform(10.0, 20.0),
        resistance_ohm=float(rng.choice([0.0, 0.0012, 0.05, 0.3])),
        capacity_ah=rng.uniform(1.0, 5.0),
        k_b_per_s=float(rng.choice([1 / 3600, 0.00183, 0.02, 0.1])) if tight else 0.00183,
        letter_crate_per_h=float(rng.choice([1.0, 2.0])),
    )
    swing = rng.choice([0.5, 3.0, 6.0])
    mean = np.maximum(20.0 + swing * rng.normal(size=steps), 0.0)
    limit = mean + swing * rng.uniform(0.0, 0.5, steps)
    forecast = HorizonForecast(limit, mean, 1.0, float(rng.choice([1.0, 2.0])), float(mean.mean()), 3.0)
    found = Case(battery, computations, forecast, cost, list(trade_offs), computations.power)
    least, most = computations.power(computations.low), computations.power(computations.high)
    spare = rng.uniform(0.0, 1.0) ** 2 * (most - least + swing)
    soc = (limit.max() + least + spare) / battery.power_per_soc_w
    soc += sum(found.drop(m, least) for m in range(steps)) * rng.choice([0.9, 1.0, 1.2])
    found.forecast = HorizonForecast(limit, mean, soc, forecast.step_s, forecast.level_w, forecast.ripple_w2)
    return found


def check_solution(found, plan):
    """What holds of every answer: both plans admissible, their objectives as said, the gap not negative."""
    assert found.excess_w(plan.chosen) <= WITHIN_W
    assert found.excess_w(plan.relaxed) <= WITHIN_W
    assert found.objective(plan.chosen) == pytest.approx(plan.objective, rel=EXACT)
    assert found.objective(plan.relaxed) == pytest.approx(plan.relaxed_objective, rel=EXACT)
    assert plan.gap >= -EXACT
    low, high = found.computations.low, found.computations.high
    assert np.all(plan.relaxed >= low - EXACT)
    assert np.all(plan.relaxed <= high + EXACT)
    for k, levels in enumerate(found.computations.levels):
        assert set(plan.chosen[:, k].tolist()) <= set(levels)


# --- integers


@pytest.mark.parametrize("cost", COSTS)
@pytest.mark.parametrize("shape", SHAPES)
def test_integers_of_one_computation_equal_brute_force(shape, cost):
    rng = np.random.default_rng([SHAPES.index(shape), COSTS.index(cost)])
    answered = 0
    for _ in range(25):
        computations = one_computation(rng, shape, int(rng.integers(2, 6)))
        found = case(rng, computations, int(rng.integers(4, 6)), cost)
        best = found.brute_force()
        if best == -np.inf:
            with pytest.raises(Infeasible):
                found.horizon().solve(found.forecast)
            continue
        plan = found.horizon().solve(found.forecast)
        check_solution(found, plan)
        assert plan.objective == pytest.approx(best, rel=EXACT)
        answered += 1
    assert answered > 15


@pytest.mark.parametrize("traded", [False, True], ids=["free", "trade-offs"])
@pytest.mark.parametrize("cost", COSTS)
def test_integers_of_two_computations_against_brute_force(cost, traded, record_property):
    rng = np.random.default_rng([7, COSTS.index(cost), traded])
    gaps = []
    for _ in range(16):
        computations = two_computations(rng)
        least = float((computations.low + (computations.high - computations.low) / 4).sum())
        trade_offs = [([1.0, 1.0], least), ([1.0, -1.0], -4.0)] if traded else []
        found = case(rng, computations, 4, cost, trade_offs)
        best = found.brute_force()
        if best == -np.inf:
            with pytest.raises(Infeasible):
                found.horizon().solve(found.forecast)
            continue
        plan = found.horizon().solve(found.forecast)
        check_solution(found, plan)
        gaps.append((best - plan.objective) / best)
    record_property("median gap to brute force", float(np.median(gaps)))
    record_property("worst gap to brute force", float(np.max(gaps)))
    assert len(gaps) > 5
    assert max(gaps) <= EXACT


def test_a_power_that_falls_is_no_reason_to_give_up():
    """The lowest level is not that of least power: it is the least power that must be admissible."""
    rng = np.random.default_rng(0)
    computations = ComputationLevels(
        np.array([1.0]),
        np.array([4.0]),
        [(1.0, 2.0, 3.0, 4.0)],
        lambda c: float(np.interp(c[0], [1, 2, 3, 4], [6, 2, 3, 7])),
    )
    for cost in COSTS:
        found = case(rng, computations, 4, cost, tight=False)
        spare = (found.forecast.limit_motion_w.max() + 3.5) / found.battery.power_per_soc_w
        found.forecast = HorizonForecast(
            *(getattr(found.forecast, name) for name in ("limit_motion_w", "mean_motion_w")), spare, 1.0
        )
        plan = found.horizon().solve(found.forecast)
        check_solution(found, plan)
        assert plan.objective == pytest.approx(found.brute_force(), rel=EXACT)


def test_many_combinations_are_thinned_and_still_admissible():
    rng = np.random.default_rng(2)
    levels = tuple(np.arange(0.0, 31.0).tolist())
    weights = np.array([0.1, 0.07, 0.15])
    computations = ComputationLevels(np.zeros(3), np.full(3, 30.0), [levels] * 3, lambda c: 1.0 + float(weights @ c))
    found = case(rng, computations, 4, "control", [([1.0, 1.0, 1.0], 20.0)], tight=False)
    soc = (found.forecast.limit_motion_w.max() + 6.0) / found.battery.power_per_soc_w
    found.forecast = HorizonForecast(found.forecast.limit_motion_w, found.forecast.mean_motion_w, soc, 1.0)
    plan = found.horizon().solve(found.forecast)
    check_solution(found, plan)
    assert plan.gap < 0.1


# --- reals


def slsqp(found, horizon, starts):
    """The best objective of SLSQP from several starts, −inf where it finds nothing admissible."""
    low, high = found.computations.low[0], found.computations.high[0]
    scale = max(horizon.objective(np.full((found.steps, 1), high), found.forecast), 1e-9)

    def value(c):
        return -horizon.objective(np.clip(c, low, high)[:, None], found.forecast) / scale

    def spare(c):
        try:
            return -horizon.excess_w(np.clip(c, low, high)[:, None], found.forecast)
        except Infeasible:
            return np.full(found.steps, -100.0)

    best = -np.inf
    for start in starts:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it says that it clips to the bounds
            answer = minimize(
                value,
                start,
                bounds=[(low, high)] * found.steps,
                constraints={"type": "ineq", "fun": spare},
                method="SLSQP",
                options={"ftol": 1e-12, "maxiter": 200},
            )
        c = np.clip(answer.x, low, high)[:, None]
        if found.excess_w(c) <= WITHIN_W:
            best = max(best, found.objective(c))
    return best


@pytest.mark.parametrize("shape", SHAPES)
def test_reals_equal_those_of_another_solver(shape):
    rng = np.random.default_rng([3, SHAPES.index(shape)])
    below = []
    for i in range(24):
        computations = one_computation(rng, shape, int(rng.integers(2, 6)))
        found = case(rng, computations, 3, COSTS[i % 4])
        horizon = found.horizon()
        try:
            plan = horizon.solve(found.forecast)
        except Infeasible:
            continue
        check_solution(found, plan)
        low, high = computations.low[0], computations.high[0]
        starts = [plan.relaxed[:, 0], *(rng.uniform(low, high, found.steps) for _ in range(4))]
        best = slsqp(found, horizon, starts)
        below.append((best - plan.relaxed_objective) / plan.relaxed_objective)
        if module._is_optimal(horizon._fill_greedy(found.forecast)):
            assert below[-1] <= SAME_OBJECTIVE
    assert len(below) > 15
    assert np.mean(np.array(below) <= SAME_OBJECTIVE) >= 0.9
    assert max(below) <= 0.02


@pytest.mark.parametrize("shape", SHAPES)
def test_no_point_of_a_fine_grid_is_better(shape):
    """Two steps, every pair of 401 values each."""
    rng = np.random.default_rng([4, SHAPES.index(shape)])
    for i in range(12):
        found = case(rng, one_computation(rng, shape, 4), 2, COSTS[i % 4])
        try:
            plan = found.horizon().solve(found.forecast)
        except Infeasible:
            continue
        values = np.linspace(found.computations.low[0], found.computations.high[0], 401)
        powers = np.array([found.power([c]) for c in values])
        first, second = (np.array([found.drop(m, power_w) for power_w in powers]) for m in range(2))
        worth = [np.array([found.stage_cost(m, np.array([c])) for c in values]) for m in range(2)]
        limit = found.forecast.limit_motion_w
        held = limit[0] + powers <= found.allowed_w(found.forecast.soc - first)
        left = found.forecast.soc - first[:, None] - second
        total = worth[0][:, None] + worth[1]
        total[~held[:, None] | (limit[1] + powers > found.allowed_w(left))] = -np.inf
        assert total.max() <= plan.relaxed_objective * (1 + SAME_OBJECTIVE)


def linear_gain(found, plan):
    """What a linear program round the reals could still gain: 0 where they meet the first-order conditions.

    Slopes of the model by central differences, in the independent model.
    """
    steps, o = found.steps, found.forecast
    c, width = plan.relaxed[:, 0], found.computations.high[0] - found.computations.low[0]
    move = 1e-5 * width

    def slope(function):
        at = np.clip([c - move, c + move], found.computations.low[0], found.computations.high[0])
        return np.array([(function(m, at[1, m]) - function(m, at[0, m])) / (at[1, m] - at[0, m]) for m in range(steps)])

    gain = slope(lambda m, value: found.stage_cost(m, np.array([value])))
    power_slope = slope(lambda m, value: found.power([value]))
    drop_slope = slope(lambda m, value: found.drop(m, found.power([value])))
    rows = np.diag(power_slope) + found.allowed_w(1.0) * np.tril(np.tile(drop_slope, (steps, 1)))
    used = np.cumsum([found.drop(m, found.power([value])) for m, value in enumerate(c)])
    left = found.allowed_w(o.soc - used) - o.limit_motion_w - [found.power([value]) for value in c]
    bounds = list(zip(found.computations.low[0] - c, found.computations.high[0] - c, strict=True))
    return -linprog(-gain, A_ub=rows, b_ub=np.maximum(left, 0.0), bounds=bounds).fun


@pytest.mark.parametrize("cost", COSTS)
def test_reals_meet_the_first_order_conditions(cost):
    """For a linear g, where there are no bends to be on."""
    rng = np.random.default_rng([5, COSTS.index(cost)])
    for _ in range(25):
        found = case(rng, one_computation(rng, "linear", 3), 6, cost)
        try:
            plan = found.horizon().solve(found.forecast)
        except Infeasible:
            continue
        check_solution(found, plan)
        assert linear_gain(found, plan) <= SAME_OBJECTIVE * plan.relaxed_objective


@pytest.mark.parametrize("cost", COSTS)
def test_the_closed_form_and_the_qps_agree(cost, monkeypatch):
    """What the closed form proves is what the QPs reach alone, and what is answered where OSQP fails."""
    rng = np.random.default_rng([6, COSTS.index(cost)])
    proven = []
    for _ in range(15):
        found = case(rng, one_computation(rng, "linear", 3), 8, cost, tight=False)
        try:
            plan = found.horizon().solve(found.forecast)
        except Infeasible:
            continue
        steps = found.horizon()._fill_greedy(found.forecast)
        if module._is_optimal(steps):
            proven.append(found)
            best = found.objective(np.array([[step.c] for step in steps]))
            assert plan.relaxed_objective == pytest.approx(best, rel=SAME_OBJECTIVE)
    assert len(proven) > 8
    for found in proven:
        horizon = found.horizon(closed_form=False)
        best = sum(step.value for step in horizon._fill_greedy(found.forecast))
        towards = horizon.solve(found.forecast)  # the QPs know what there is to reach
        with monkeypatch.context() as patch:
            patch.setattr(module, "_is_optimal", lambda steps: False)
            alone = horizon.solve(found.forecast)
        assert alone.qp_solves > 0
        with monkeypatch.context() as patch:
            patch.setattr(QuadraticProgram, "solve", failing)
            without = found.horizon(closed_form=False).solve(found.forecast)
        for plan in (towards, alone, without):
            check_solution(found, plan)
            assert plan.relaxed_objective == pytest.approx(best, rel=SAME_OBJECTIVE)


def failing(*_):
    """In the place of a solve that OSQP gives up."""
    raise SolverFailed("OSQP: maximum iterations reached")


@pytest.mark.parametrize("closed_form", [True, False], ids=["closed form", "QPs"])
@pytest.mark.parametrize("cost", COSTS)
def test_solutions_of_a_flight_do_not_depend_on_the_last(cost, closed_form):
    """One horizon for instance after instance, each from the last plan, and a new one for each."""
    rng = np.random.default_rng([11, COSTS.index(cost)])
    found = easy(cost, steps=10)
    horizon = found.horizon(closed_form)
    for _ in range(30):
        motion = 24.0 + 3.0 * rng.normal(size=10)
        soc = float((motion.max() + 5.0 + 4.0 * rng.random()) / found.allowed_w(1.0) + 0.02)
        found.forecast = HorizonForecast(motion, motion, soc, 1.0, 24.0)
        plan, fresh = horizon.solve(found.forecast), found.horizon(closed_form).solve(found.forecast)
        check_solution(found, plan)
        assert np.array_equal(plan.chosen, fresh.chosen)
        assert plan.relaxed_objective == pytest.approx(fresh.relaxed_objective, rel=SAME_OBJECTIVE)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_long_horizon_short_of_charge(shape):
    """46 steps of a periodic power, hardly more charge than the lowest levels need."""
    rng = np.random.default_rng([8, SHAPES.index(shape)])
    found = case(rng, one_computation(rng, shape, 5), 46, "output", tight=False)
    motion = 26.0 + 4.0 * np.sin(2 * np.pi * np.arange(46) / 46)
    least = found.power(found.computations.low)
    for spare_w in (0.01, 0.5, 2.0):
        found.forecast = HorizonForecast(motion, motion, 1.0, 1.0, 26.0)
        drops = np.cumsum([found.drop(m, least) for m in range(46)])
        soc = float(np.max((motion + least + spare_w) / found.allowed_w(1.0) + drops))
        found.forecast = HorizonForecast(motion, motion, soc, 1.0, 26.0)
        check_solution(found, found.horizon().solve(found.forecast))


def test_like_steps_do_not_share_what_is_better_not_shared():
    """Three equal steps with charge for little more than the lowest, as the fourth needs the rest.

    The worth is convex: one of them should take it all, and sharing it is a stationary point that is not a maximum.
    """
    found = easy(steps=4)
    found.battery = Battery(14.8, 0.0012, 3.2, 0.02, 1.0, 1.0)
    motion = np.array([20.0, 20.0, 20.0, 26.0])
    found.forecast = HorizonForecast(motion, motion, 1.0, 1.0, 20.0)
    least = found.power(found.computations.low)
    used = sum(found.drop(m, least) for m in range(4))
    found.forecast = HorizonForecast(
        motion, motion, (motion[3] + least + 0.05) / found.allowed_w(1.0) + used, 1.0, 20.0
    )
    plan = found.horizon().solve(found.forecast)
    check_solution(found, plan)
    assert np.sum(plan.relaxed[:3, 0] > found.computations.low[0] + 1e-3) == 1


# --- what fails


def easy(cost="control", steps=5, soc=0.7):
    """The letter's computation and battery."""
    computations = ComputationLevels(
        np.array([2.0]), np.array([10.0]), [(2.0, 4.0, 6.0, 8.0, 10.0)], lambda c: 4.75376 + 0.6251075 * (c[0] - 2.0)
    )
    motion = 24.0 + 3.0 * np.sin(np.arange(steps))
    battery = Battery(14.8, 0.0012, 3.2, 0.00183, 1.0, 1.0)
    forecast = HorizonForecast(motion, motion, soc, 1.0, 24.0)
    return Case(battery, computations, forecast, cost, [], computations.power)


def test_too_little_charge_is_infeasible():
    found = easy(soc=0.5)
    with pytest.raises(Infeasible, match="minimum power"):
        found.horizon().solve(found.forecast)


def test_trade_offs_that_no_values_keep_are_infeasible():
    found = easy()
    found.trade_offs = [([1.0], 11.0)]
    with pytest.raises(Infeasible, match="trade-offs"):
        found.horizon().solve(found.forecast)


def test_power_that_the_battery_cannot_deliver_is_not_planned():
    """V²/4R lies between the lowest and the highest computations' power."""
    found = easy(soc=1.0)
    found.battery = Battery(14.8, 14.8**2 / 4 / 32.0, 3.2, 0.00183, 1.0, 10.0)
    plan = found.horizon().solve(found.forecast)
    check_solution(found, plan)
    assert plan.objective == pytest.approx(found.brute_force(), rel=EXACT)
    found.battery = Battery(14.8, 14.8**2 / 4 / 25.0, 3.2, 0.00183, 1.0, 10.0)
    with pytest.raises(Infeasible):
        found.horizon().solve(found.forecast)


@pytest.mark.parametrize("part", ["limit_motion_w", "mean_motion_w", "soc"])
def test_a_forecast_that_is_not_a_number_is_a_failure(part):
    found = easy()
    horizon = found.horizon()
    before = horizon.solve(found.forecast)
    spoilt = {name: getattr(found.forecast, name) for name in ("limit_motion_w", "mean_motion_w", "soc", "step_s")}
    spoilt[part] = np.nan if part == "soc" else np.r_[spoilt[part][:-1], np.nan]
    with pytest.raises(SolverFailed):
        horizon.solve(HorizonForecast(**spoilt))
    assert horizon.solve(found.forecast).relaxed == pytest.approx(before.relaxed)


def test_a_solver_that_always_fails_is_told(monkeypatch):
    found = easy()
    found.trade_offs = [([1.0], 3.0)]  # with trade-offs there is no closed form
    horizon = found.horizon()

    with monkeypatch.context() as patch:
        patch.setattr(QuadraticProgram, "solve", failing)
        with pytest.raises(SolverFailed, match="iterations"):
            horizon.solve(found.forecast)
    check_solution(found, horizon.solve(found.forecast))


@pytest.mark.parametrize("cost", COSTS)
def test_nothing_to_gain_is_no_trouble(cost):
    """A computation whose power is the same at every level, and one with a single level."""
    flat = ComputationLevels(np.array([1.0]), np.array([3.0]), [(1.0, 2.0, 3.0)], lambda c: 5.0)
    single = ComputationLevels(np.array([2.0]), np.array([2.0]), [(2.0,)], lambda c: 5.0)
    for computations in (flat, single):
        found = easy(cost, soc=0.9)
        plan = Horizon(computations, found.battery, found.steps, cost).solve(found.forecast)
        assert plan.gap == pytest.approx(0.0, abs=EXACT)


# --- the fallback


def test_lowered_lowers_by_delta_until_the_constraints_hold():
    rng = np.random.default_rng(10)
    lowered = 0
    for i in range(60):
        computations = one_computation(rng, SHAPES[i % 3], 5) if i % 2 else two_computations(rng, 4)
        found = case(rng, computations, 4, "control", tight=False)
        horizon = found.horizon()
        deltas = rng.uniform(0.5, 3.0, computations.count)
        now = rng.uniform(computations.low, computations.high)
        # every set of values on the way down, taken down to levels
        way, c = [], now.copy()
        while True:
            way.append(
                [max(x for x in levels if x <= v + 1e-9) for levels, v in zip(computations.levels, c, strict=True)]
            )
            if np.all(c <= computations.low):
                break
            c = np.maximum(c - deltas, computations.low)
        admissible = [values for values in way if found.excess_w([np.array(values)] * 4) <= 1e-6]
        if not admissible:
            with pytest.raises(Infeasible):
                horizon.lowered(now, deltas, found.forecast)
            continue
        plan = horizon.lowered(now, deltas, found.forecast)
        assert plan.shape == (4, computations.count)
        assert plan == pytest.approx(np.tile(admissible[0], (4, 1)))
        lowered += admissible[0] != way[0]
    assert lowered > 10


def test_lowered_keeps_what_is_admissible():
    found = easy(soc=0.95)
    plan = found.horizon().lowered(np.array([10.0]), np.array([2.0]), found.forecast)
    assert plan == pytest.approx(np.full((5, 1), 10.0))

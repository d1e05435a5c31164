"""The hysteresis: when computations fall and rise, and what a change of the path has to gain."""

from dataclasses import replace

import numpy as np
import pytest
from common import few
from common.forecasts import CALM, Forecasting, survey_inputs

from eadp.planning.forecast.evaluate import Evaluator, Objective
from eadp.planning.forecast.knapsack import fill_greedy
from eadp.planning.joint.policy import EARLY_S, SETTLED_S, Policy, sustained_w
from eadp.planning.joint.program import Solution

MIN_GAIN = 0.01


@pytest.fixture(scope="module")
def evaluation():
    """The survey at its widest spacing, before take-off, without a margin for the unknown."""
    inputs = survey_inputs(**CALM, **{"parameters.c1": -1000.0, "battery.capacity_ah": 0.5})
    return Forecasting(inputs, objective=Objective(0.05, 0.5)).at(0.0)


def with_share(evaluation, share):
    """The evaluation and solution with a share of the charge that all computations take."""
    knapsack = evaluation.knapsack
    knapsack = knapsack._replace(available=knapsack.base_use + share * knapsack.use.sum())
    found = replace(evaluation, knapsack=knapsack)
    return found, Solution(fill_greedy(knapsack), "")


def envelope_of(evaluation):
    return evaluation.evaluator.envelopes[int(evaluation.kinds[0])]


def flown(policy, evaluation, share, time_s, now):
    """Computations decided with a share of the charge, from those in force."""
    envelope = envelope_of(evaluation)
    rows = [tuple(row) for row in envelope.configurations.tolist()]
    now_w = float(envelope.powers_w[rows.index(now)])
    found, solution = with_share(evaluation, share)
    chosen, lasts_s = policy.computations(time_s, now_w, found, solution)
    again = policy.computations(time_s, now_w, found, solution)
    assert (chosen, lasts_s) == again, "asking changes nothing"
    if rows.index(chosen) < rows.index(now):
        policy.fell_s = time_s
    return chosen


def rows_of(evaluation):
    return [tuple(row) for row in envelope_of(evaluation).configurations.tolist()]


def test_charge_for_all_flies_the_highest_and_none_the_lowest(evaluation):
    lowest, *_, highest = rows_of(evaluation)
    assert flown(Policy(MIN_GAIN), evaluation, 1.5, 100.0, lowest) == highest
    assert flown(Policy(MIN_GAIN), evaluation, 0.0, 100.0, highest) == lowest
    assert flown(Policy(MIN_GAIN), evaluation, -0.1, 100.0, highest) == lowest, "infeasible"


def test_computations_do_not_fall_at_once_for_the_margin_alone(evaluation):
    lowest, *_, highest = rows_of(evaluation)

    def with_reserve(soc):
        found = replace(evaluation, evaluator=Evaluator.__new__(Evaluator))
        vars(found.evaluator).update(vars(evaluation.evaluator), objective=Objective(soc, 0.5))
        return found

    assert flown(Policy(MIN_GAIN), with_reserve(-10.0), 0.0, EARLY_S - 1, highest) == highest
    assert flown(Policy(MIN_GAIN), with_reserve(-10.0), 0.0, EARLY_S + 1, highest) == lowest
    assert flown(Policy(MIN_GAIN), with_reserve(1.0), 0.0, EARLY_S - 1, highest) == lowest, "less is expected"
    assert flown(Policy(MIN_GAIN), evaluation, 1.5, EARLY_S - 1, lowest) == highest, "they may rise"


def test_sustained_power_uses_as_much_as_the_optimal_mix(evaluation):
    """Against bisection of the power that, held on every leg, uses what is planned."""
    battery = evaluation.evaluator.mission.battery
    envelope = envelope_of(evaluation)
    kind = int(evaluation.kinds[0])
    assert (evaluation.kinds == kind).all()
    for share in (0.1, 0.35, 0.6, 0.9):
        found, solution = with_share(evaluation, share)
        power_w = sustained_w(found, kind, solution)
        target = float(solution.filling.use[0] - found.knapsack.base_use[0])

        def used(watts, found=found):
            """By interpolation between the envelope's vertices: the use of each increment is what it is."""
            levels = np.clip((watts - envelope.powers_w[:-1]) / np.diff(envelope.powers_w), 0, 1)
            return float((found.knapsack.use[:, : len(levels)] * levels).sum())

        # sums of shares of increments: within the curvature of the current over an increment
        assert used(power_w) == pytest.approx(target, rel=0.03)
    assert battery.resistance_ohm > 0


def test_charge_that_is_left_over_counts(evaluation):
    kind, powers_w = int(evaluation.kinds[0]), envelope_of(evaluation).powers_w
    found, solution = with_share(evaluation, 1.2)
    left = 0.2 * float(evaluation.knapsack.use.sum())
    per_w = float(found.totals.soc_per_j[0] * found.totals.seconds[0])
    assert sustained_w(found, kind, solution) == pytest.approx(powers_w[-1] + left / per_w)


def test_computations_rise_to_what_can_be_flown_for_a_while(evaluation):
    lowest, above, *_ = rows_of(evaluation)
    first = float(np.diff(envelope_of(evaluation).powers_w)[0] / np.ptp(envelope_of(evaluation).powers_w))
    remaining_s = float(evaluation.totals.seconds[0])
    for lasts_s, expected in ((0.8 * SETTLED_S, lowest), (1.3 * SETTLED_S, above)):
        share = first * lasts_s / remaining_s
        assert flown(Policy(MIN_GAIN), evaluation, share, 100.0, lowest) == expected


@pytest.mark.parametrize("after_s", [0.0, 0.5 * SETTLED_S, 0.99 * SETTLED_S])
def test_computations_do_not_rise_within_a_time_after_a_fall(evaluation, after_s):
    lowest, *_, highest = rows_of(evaluation)
    policy = Policy(MIN_GAIN)
    assert flown(policy, evaluation, 0.0, 200.0, highest) == lowest
    assert flown(policy, evaluation, 1.5, 200.0 + after_s, lowest) == lowest
    assert flown(policy, evaluation, 1.5, 200.0 + SETTLED_S + 1, lowest) == highest


@pytest.mark.parametrize("seed", few(range(8), 3))
def test_no_sequence_of_charges_makes_them_rise_soon_after_a_fall(evaluation, seed):
    rng, policy, now, time_s, fell_s = np.random.default_rng(seed), Policy(MIN_GAIN), rows_of(evaluation)[-1], 0.0, None
    powers_w = dict(zip(rows_of(evaluation), envelope_of(evaluation).powers_w.tolist(), strict=True))
    changes = 0
    for _ in range(60):
        time_s += float(rng.uniform(2, 40))
        then = flown(policy, evaluation, float(rng.uniform(-0.1, 1.2)), time_s, now)
        assert then in powers_w
        if powers_w[then] > powers_w[now]:
            assert fell_s is None or time_s - fell_s >= SETTLED_S
        if powers_w[then] < powers_w[now]:
            fell_s = time_s
        changes, now = changes + (then != now), then
    assert changes >= 2


def test_the_gain_for_which_a_path_changes_grows_with_changes():
    policy, gains = Policy(MIN_GAIN), []
    for _ in range(30):
        gains.append(policy.path_gain)
        policy.path_changes += 1
    assert gains[0] == MIN_GAIN
    assert (np.diff(gains) > 0).all()
    assert np.diff(gains) == pytest.approx(gains[1] - gains[0])

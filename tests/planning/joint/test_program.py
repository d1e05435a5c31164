"""The mission program against brute force over the path parameters, with the exact best of the computations at each."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
import pytest
from broken_osqp import BROKEN
from common import ROOT
from eadp.planning.joint.forecaster import Forecaster
from eadp.planning.joint.knapsack import FULL, Increments, allocation_of
from scipy.optimize import linprog

from eadp.errors import Infeasible
from eadp.io.flight.inputs import load_flight
from eadp.planning.base import CLOSED_FORM, FALLBACK, INFEASIBLE, KEPT, NOTHING_TO_CHOOSE, SOLVED, SolverReport
from eadp.planning.joint import program as module
from eadp.planning.joint.program import Candidate, MissionProgram, best_at
from eadp.planning.qp import OsqpSolver

PLACES, PLACES_EACH = 400, 32
MEDIAN_GAP, WORST_GAP = 1e-4, 1e-2
QP_GAP = 1e-5
LP = 1e-8
SLOPE = 1e-2
"""Of differences over one step and over two."""
INSTANCES = {1: 100, 2: 16}
"""By the number of path parameters."""
SCAN_GAP = 5e-2
PAYS = 0.05
"""What a change has to gain."""


class Mission:
    """Whole laps of a few legs each: how many is a staircase in p, how long they take is smooth on each step."""

    def __init__(self, seed, dimensions, tight=None):
        rng = np.random.default_rng(seed)
        self.dimensions = dimensions
        self.first, self.rise = rng.uniform(3, 7), rng.uniform(1, 12, dimensions)
        kinds = int(rng.integers(2, 5))
        self.legs_s = rng.uniform(5, 20, kinds)
        self.bends = rng.uniform(-0.3, 0.6, (dimensions, kinds))
        self.motion = rng.uniform(30, 45, kinds)
        self.powers, self.values = [], []
        for _ in range(kinds):
            count = int(rng.integers(0, 5))
            widths, slopes = rng.uniform(0.2, 3, count), np.sort(rng.uniform(0.02, 1, count))[::-1]
            self.powers.append(np.cumsum([rng.uniform(0, 4), *widths]))
            self.values.append(np.cumsum([0, *(widths * slopes)]))
        top = max(values[-1] for values in self.values) or 1.0
        self.values = [values / top for values in self.values]
        self.weight = rng.uniform(0.2, 0.8)
        self.margin = rng.uniform(0, 0.03, dimensions)
        least, most = (self.candidate((end,) * dimensions, 1.0).increments for end in (0.0, 1.0))
        share = rng.uniform(0.05, 1.05) if tight is None else tight
        self.available = least.base_use + share * (most.base_use + most.use.sum() - least.base_use)

    def candidate(self, shares, available):
        p = np.array(shares)
        laps = math.ceil(self.first + self.rise @ p - 1e-12)
        # within a step the last leg shortens, as a plan is cut where it is over
        over = laps - (self.first + self.rise @ p)
        times = np.tile(self.legs_s * (1 + (p @ self.bends) ** 2), laps)
        times[-1] *= 1 - 0.8 * over
        total = times.sum()
        kinds = len(self.legs_s)
        segment, level, use, gain = [], [], [], []
        base_use = base_value = 0.0
        for kind in range(kinds):
            own = times[kind::kinds]
            powers = (self.motion[kind] + self.powers[kind]) * 1e-5
            base_use += own.sum() * powers[0]
            base_value += own.sum() * self.values[kind][0]
            count = len(powers) - 1
            segment.append(np.repeat(np.arange(kind, len(times), kinds), count))
            level.append(np.tile(np.arange(count), laps))
            use.append(np.outer(own, np.diff(powers)).ravel())
            gain.append(np.outer(own, np.diff(self.values[kind])).ravel())
        value_rates = (1 - self.weight) / total
        increments = Increments(
            np.concatenate(segment),
            np.concatenate(level),
            np.concatenate(use),
            np.concatenate(gain) * value_rates,
            base_use,
            base_value * value_rates + self.weight * float(p.mean()),
        )
        return Candidate(tuple(shares), (laps,), increments, available - float(self.margin @ p**2))

    def __call__(self, shares):
        assert len(shares) == self.dimensions
        assert all(0 <= share <= 1 for share in shares)
        return self.candidate(shares, self.available)

    def by_brute_force(self):
        """The best value over a fine grid, and None where nothing is feasible."""
        axis = np.linspace(0, 1, PLACES if self.dimensions == 1 else PLACES_EACH).tolist()
        found = (best_at(self(point)) for point in itertools.product(axis, repeat=self.dimensions))
        return max((solution.value for solution in found if solution.allocation.feasible), default=None)


@dataclass
class Compared:
    """An instance with what brute force finds."""

    mission: Mission
    best: float | None


@pytest.fixture(scope="module")
def compared():
    missions = [Mission(seed, dimensions) for dimensions in (1, 2) for seed in range(INSTANCES[dimensions])]
    return [Compared(mission, mission.by_brute_force()) for mission in missions]


def checked(mission, solution):
    """The answer is what it says: within its boxes and its charge, at its value."""
    candidate = mission(solution.candidate.shares)
    x = solution.allocation.shares
    assert ((x >= 0) & (x <= 1)).all()
    assert solution.allocation.use <= candidate.available + FULL
    again = allocation_of(candidate.increments, x)
    assert solution.value == pytest.approx(again.value)
    assert solution.shortfall <= FULL


def solve(mission, method, dimensions, report=None):
    """By the scan alone, or by OSQP from its best point."""
    program, warm = MissionProgram(dimensions, report), (0.5,) * dimensions
    return program.solve(mission, warm) if method == "qp" else program.scanned(mission, warm)


def gaps(compared, dimensions, method):
    found = []
    for each in compared:
        mission = each.mission
        if mission.dimensions != dimensions:
            continue
        solution = solve(mission, method, dimensions)
        if each.best is None:
            continue
        assert solution.allocation.feasible, "brute force has found something"
        checked(mission, solution)
        found.append(each.best - solution.value)
    assert len(found) > INSTANCES[dimensions] / 2
    return found


@pytest.mark.parametrize(("method", "worst"), [("qp", WORST_GAP), ("scan", SCAN_GAP)])
def test_one_path_parameter_against_brute_force(compared, method, worst):
    found = gaps(compared, 1, method)
    assert median(found) <= MEDIAN_GAP
    assert max(found) <= worst


def test_osqp_finds_a_solution_where_there_is_one(compared):
    report = SolverReport()
    for each in compared:
        if each.mission.dimensions == 1 and each.best is not None:
            solve(each.mission, "qp", 1, report)
    assert report.fallbacks == report.outdone == 0
    assert max(report.gaps) <= module.OUTDONE
    assert report.retried == report.failed <= 3
    assert report.by_status["solved"] == report.solved == report.calls - report.failed


@pytest.mark.parametrize("method", ["qp", "scan"])
def test_two_path_parameters_are_never_infeasible_where_brute_force_is_not(compared, method):
    assert max(gaps(compared, 2, method)) < 0.3


@pytest.mark.parametrize("method", ["qp", "scan"])
def test_two_path_parameters_against_brute_force(compared, method):
    found = gaps(compared, 2, method)
    assert median(found) <= 1e-3, "brute force sees a 32nd of each box"
    assert max(found) <= WORST_GAP


def test_osqp_loses_nothing_of_the_scan(compared):
    for each in compared[::7]:
        values = [solve(each.mission, method, each.mission.dimensions).value for method in ("scan", "qp")]
        assert values[1] >= values[0] - module.OUTDONE


def test_the_closed_form_is_the_linear_programs(compared):
    for each in compared[::7]:
        candidate = each.mission((0.37,) * each.mission.dimensions)
        solution = best_at(candidate)
        if not solution.allocation.feasible or not len(candidate.increments.use):
            continue
        spare = candidate.available - candidate.increments.base_use
        exact = linprog(
            -candidate.increments.gain, A_ub=candidate.increments.use[None, :] * 100, b_ub=[spare * 100], bounds=(0, 1)
        )
        assert solution.value == pytest.approx(candidate.increments.base_value - exact.fun, abs=LP)
        assert solution.status == CLOSED_FORM


def test_qps_find_the_computations_of_a_fixed_path(compared):
    found = []
    for each in compared[::3]:
        program = MissionProgram(1)
        start = best_at(each.mission((0.42,) * each.mission.dimensions))
        if not start.allocation.feasible or not len(start.candidate.increments.use):
            continue
        solution = program.decided(each.mission, start, movable=False)
        assert solution.status in (SOLVED, CLOSED_FORM)
        checked(each.mission, solution)
        found.append(start.value - solution.value)
        assert found[-1] == pytest.approx(solution.gap if solution.status == SOLVED else 0.0, abs=1e-12)
    assert min(found) >= -LP
    assert max(found) <= module.OUTDONE


def test_a_solution_is_kept_while_its_multiplier_proves_that_it_is_optimal():
    mission, report = feasible_mission(), SolverReport()
    here = mission((0.42,))
    binding = here._replace(available=here.increments.base_use + 0.6 * float(here.increments.use.sum()))
    program, start = MissionProgram(1, report), best_at(binding)
    first = program.decided(mission, start, movable=False)
    assert report.skipped == 0
    again = program.decided(mission, start, movable=False)
    assert (first.status, again.status, report.skipped) == (SOLVED, KEPT, 1)
    assert again.allocation.shares.tolist() == first.allocation.shares.tolist()
    # less charge than it uses, more charge to use, another order of what is worth most: none is kept
    increments, available = start.candidate.increments, start.candidate.available
    others = [
        start.candidate._replace(available=available - 1e-4),
        start.candidate._replace(available=available + 1e-4),
        start.candidate._replace(increments=increments._replace(gain=increments.gain[::-1].copy())),
    ]
    for candidate in others:
        calls = report.calls
        solution = program.decided(mission, best_at(candidate), movable=False)
        assert solution.status in (SOLVED, CLOSED_FORM)
        assert report.calls > calls
        assert best_at(candidate).value - solution.value <= module.OUTDONE
        program.decided(mission, start, movable=False)


def test_flown_legs_leave_the_last_solution():
    mission, report = feasible_mission(), SolverReport()
    program, start = MissionProgram(1, report), best_at(mission((0.42,)))
    program.decided(mission, start, movable=False)
    i = start.candidate.increments
    rest = Increments(*(array[1:] for array in (i.segment, i.level, i.use, i.gain)), i.base_use, i.base_value)
    spare = float(i.use[1:] @ start.allocation.shares[1:])
    shorter = start.candidate._replace(increments=rest, available=i.base_use + spare)
    solution = program.decided(mission, best_at(shorter), movable=False)
    assert best_at(shorter).value - solution.value <= module.OUTDONE
    longer = program.decided(mission, start, movable=False)
    assert longer.status == SOLVED, "with more increments than before there is nothing to keep"


@pytest.mark.parametrize("spare", [0.1, 0.5, 0.9, 1.2, 5.0])
def test_shares_of_a_qp_fill_what_is_spare_and_no_more(spare):
    """Three increments that gain alike for their charge: as much is taken as fits, of each all at most."""
    use = np.array([0.2, 0.3, 0.4])
    increments = Increments(np.zeros(3, int), np.arange(3), use, 2 * use, 0.05, 0.0)
    shares = module._fitted(increments, np.full(3, 0.4), 2.0, 0.05 + spare)
    assert np.all((shares >= 0) & (shares <= 1))
    assert use @ shares == pytest.approx(min(spare, use.sum()))


@pytest.mark.parametrize(("available", "best"), [(1.0, 0.7), (0.55, 0.55)])
def test_a_climb_finds_the_best_share_of_a_step(available, best):
    """A value of 1 − (p − 0.7)² and a use of p, without computations: the peak, or as far as the charge goes."""
    none = np.zeros(0)
    points = none.astype(np.intp)

    def candidate_at(shares):
        increments = Increments(points, points, none, none, shares[0], 1 - (shares[0] - 0.7) ** 2)
        return Candidate(tuple(shares), (1,), increments, available)

    start = best_at(candidate_at((0.3,)))
    solution = MissionProgram(1).decided(candidate_at, start, movable=True)
    assert solution.candidate.shares[0] == pytest.approx(best, abs=0.02)
    assert solution.value == pytest.approx(1 - (best - 0.7) ** 2, abs=1e-2)
    assert MissionProgram(1).decided(candidate_at, start, movable=False).candidate.shares == (0.3,)


@pytest.mark.parametrize("dimensions", [1, 2])
def test_slopes_are_those_of_value_and_of_use_less_what_is_available(dimensions):
    mission, program = feasible_mission(dimensions), MissionProgram(dimensions)
    mission.margin = np.full(dimensions, 0.2)
    checked_axes = 0
    for point in itertools.product((0.13, 0.37, 0.61, 0.88), repeat=dimensions):
        solution = best_at(mission(point))
        for axis in range(dimensions):
            near = [
                mission(tuple(p + d * (i == axis) for i, p in enumerate(point))) for d in (-2 * module.DIFFERENCE, 0.0)
            ]
            if near[0].shape != near[1].shape:
                continue
            one, other = (allocation_of(candidate.increments, solution.allocation.shares) for candidate in near)
            span = 2 * module.DIFFERENCE
            spare = [near[0].available - one.use, near[1].available - other.use]
            found = program._slope(mission, solution, axis)
            assert found[0] == pytest.approx((other.value - one.value) / span, rel=SLOPE, abs=SLOPE)
            assert found[1] == pytest.approx((spare[0] - spare[1]) / span, rel=SLOPE, abs=SLOPE)
            checked_axes += 1
    assert checked_axes > 1


# --- what can go wrong ------------------------------------------------------------------------------------------------


def feasible_mission(dimensions=1):
    return Mission(4, dimensions, tight=0.5)


@pytest.mark.parametrize("broken", BROKEN)
def test_a_broken_solver_is_counted_and_answered_by_the_closed_form(monkeypatch, broken):
    mission, report = feasible_mission(), SolverReport()
    scanned = solve(mission, "scan", 1)
    monkeypatch.setattr(OsqpSolver, "run", BROKEN[broken])
    solution = solve(mission, "qp", 1, report)
    assert (solution.status, solution.gap) == (FALLBACK, None)
    assert solution.value == scanned.value
    assert (report.calls, report.failed, report.retried, report.fallbacks) == (2, 2, 1, 1)


def test_a_qp_that_fails_later_is_counted(monkeypatch):
    mission, report, true_solve, calls = feasible_mission(2), SolverReport(), OsqpSolver.run, []

    def sometimes(solver, start):
        calls.append(1)
        return (BROKEN["failing"] if len(calls) > 1 else true_solve)(solver, start)

    monkeypatch.setattr(OsqpSolver, "run", sometimes)
    solution = solve(mission, "qp", 2, report)
    assert solution.status == FALLBACK
    assert (report.calls, report.solved, report.failed) == (3, 1, 2)
    checked(mission, solution)


def test_a_plan_that_cannot_be_flown_anywhere():
    with pytest.raises(Infeasible, match="at any path parameters"):
        MissionProgram(1).solve(lambda shares: None, (0.5,))


@pytest.mark.parametrize("until", [0.05, 0.45, 0.95])
@pytest.mark.parametrize("warm", [0.0, 0.5, 1.0])
def test_a_plan_that_cannot_be_flown_at_some_parameters(until, warm):
    mission = Mission(5, 1, tight=0.9)

    def candidate_at(shares):
        return mission(shares) if shares[0] <= until else None

    solution = MissionProgram(1).solve(candidate_at, (warm,))
    axis = [point for point in np.linspace(0, 1, 1000).tolist() if point <= until]
    best = max(found.value for point in axis if (found := best_at(mission((point,)))).allocation.feasible)
    assert best - solution.value <= WORST_GAP


def test_too_little_charge_everywhere_says_what_lacks_least():
    mission = Mission(6, 1, tight=-0.5)
    solution = MissionProgram(1).solve(mission, (0.7,))
    assert solution.status == INFEASIBLE
    assert not solution.allocation.feasible
    shorts = [best_at(mission((point,))).shortfall for point in np.linspace(0, 1, 1000).tolist()]
    assert solution.shortfall == pytest.approx(min(shorts), abs=1e-3)


@pytest.mark.parametrize("tolerance", [0.0, 0.004, 0.02])
def test_of_plans_that_lack_alike_the_best_is_taken(tolerance):
    mission = Mission(6, 1, tight=-0.5)

    def candidate_at(shares):
        return mission(shares)._replace(tolerance=tolerance)

    solution = MissionProgram(1).solve(candidate_at, (0.7,))
    least = MissionProgram(1).solve(mission, (0.7,))
    assert solution.shortfall <= least.shortfall + tolerance
    points = [best_at(mission((point,))) for point in np.linspace(0, 1, 13).tolist()]
    for other in points:
        assert other.shortfall > least.shortfall + tolerance or other.value <= solution.value
    assert (solution.value > least.value) == (tolerance > 0)


def test_without_path_parameters_osqp_decides_the_computations():
    mission = feasible_mission()
    solution = MissionProgram(0).solve(lambda shares: mission((0.5,)), ())
    assert solution.status == SOLVED
    assert solution.value == pytest.approx(best_at(mission((0.5,))).value, abs=module.OUTDONE)


def test_without_anything_to_choose_nothing_runs():
    report, none = SolverReport(), np.zeros(0)
    points = none.astype(np.intp)
    candidate = Candidate((), (1,), Increments(points, points, none, none, 0.4, 0.2), 0.9)
    solution = MissionProgram(0, report).solve(lambda shares: candidate, ())
    assert (solution.status, report.calls) == (NOTHING_TO_CHOOSE, 0)


def test_a_step_that_is_feasible_at_its_edge_alone():
    """Charge that is enough below 0.31 only, where the path is worth the more the higher p."""
    none = np.zeros(0)

    def candidate_at(shares):
        (p,) = shares
        points = none.astype(np.intp)
        return Candidate(shares, (int(p * 5),), Increments(points, points, none, none, 0.4 + (p > 0.31), p), 0.9)

    solution = MissionProgram(1).solve(candidate_at, (1.0,))
    assert solution.value == pytest.approx(0.31, abs=5e-4)


def test_a_search_for_what_pays_decides_as_one_for_the_best(compared):
    searched = {True: 0, False: 0}
    decided = 0
    for each in compared:
        mission, here = each.mission, best_at(each.mission((0.5,) * each.mission.dimensions))
        if mission.dimensions != 1 or not here.allocation.feasible:
            continue
        found = {}
        for bounded in (False, True):

            def candidate_at(shares, mission=mission, bounded=bounded):
                searched[bounded] += 1
                return mission(shares)

            least = here.value + PAYS if bounded else -math.inf
            found[bounded] = MissionProgram(1).solve(candidate_at, (0.5,), least)
        best, useful = found[False].value, found[True].value
        if abs(best - here.value - PAYS) > WORST_GAP / 10:
            decided += best > here.value + PAYS
            assert (useful > here.value + PAYS) == (best > here.value + PAYS)
        if useful > here.value + PAYS:
            assert useful == pytest.approx(best, abs=MEDIAN_GAP)
    assert decided > 10
    assert searched[True] < searched[False]


def test_power_beyond_the_battery_is_a_finite_shortfall_and_the_cheapest_wins():
    """A peak that no battery delivers: every candidate is short, by a number, and the least is taken."""
    inputs = load_flight(str(ROOT / "plans/survey.plan"), scenario_path=str(ROOT / "scenarios/survey.yaml"))
    settings = inputs.scenario.planner
    forecaster = Forecaster(settings, replace(inputs.mission, max_motion_w=np.inf), settings.joint)
    forecaster.gate._state = forecaster.gate._state._replace(max_motion_w=6000.0)
    forecaster.assume((0.0, 0.0), 0.0, 1.0)
    forecaster.start_at(0.0, inputs.world.start_m, lambda: 6000.0)
    shorts = {share: best_at(forecaster.candidate((share,))).shortfall for share in (0.0, 0.3, 0.6, 1.0)}
    assert all(0 < short < np.inf for short in shorts.values())
    assert shorts[0.0] < shorts[1.0], "fewer laps are flown at the lowest path parameter"
    best = MissionProgram(1).scanned(forecaster.candidate, (1.0,))
    assert best.status == INFEASIBLE
    assert best.shortfall <= min(shorts.values()) + best.candidate.tolerance


def test_a_worse_solution_of_the_qp_is_replaced_by_the_closed_form_and_counted(monkeypatch):
    report, mission = SolverReport(), Mission(4, 1, tight=0.5)
    program, start = MissionProgram(1, report), best_at(mission((0.5,)))

    def nothing_taken(at, kept):
        increments = at.candidate.increments
        return at._replace(allocation=allocation_of(increments, np.zeros(len(increments.use))), status=SOLVED)

    monkeypatch.setattr(program, "_allocation", nothing_taken)
    solution = program.decided(mission, start, movable=False)
    assert (solution.status, report.outdone) == (CLOSED_FORM, 1)
    assert solution.value == start.value
    assert solution.gap == report.gaps[-1] == pytest.approx(start.value - start.candidate.increments.base_value)


def test_rounding_does_not_choose_between_places():
    place = module.Place((0.2,), (1,), True, 0.0, True, 1.0, 0.5, 0.6)
    short = place._replace(feasible=False, available=0.4)
    assert module._better(place._replace(shares=(0.7,), value=1.0 + 3e-16), place) is place
    assert module._better(short._replace(shares=(0.7,), available=0.4 + 3e-16), short) is short
    more = place._replace(value=1.0 + 1e-9)
    assert module._better(more, place) is more


def test_a_bracket_is_part_of_the_way_to_the_next_places_that_differ_in_one_share():
    known = [(0.5, 0.2), (0.4, 0.2), (0.3, 0.2), (0.52, 0.2), (0.5, 0.9), (0.51, 0.21)]
    (first, second) = module._bracket((0.5, 0.2), known)
    assert first == pytest.approx((0.1 * module.WITHIN, 0.02 * module.WITHIN))
    assert second == (module.FIRST_REACH, module.FIRST_REACH), "none below, and one above that is farther"


@pytest.mark.parametrize("rises", [True, False])
def test_a_scan_does_not_look_between_places_that_are_short_by_more_than_a_lap(rises):
    """A value and a use that rise with a share, or fall, and charge for 0.3 of its set; a lap is a tenth of the use."""
    none, looked = np.zeros(0, dtype=np.intp), []

    def candidate_at(shares):
        looked.append(shares[0])
        p = shares[0] if rises else 1 - shares[0]
        increments = Increments(none, none, np.zeros(0), np.zeros(0), 0.4 + 2 * p, p)
        return Candidate(shares, (1, 2, 3, 4) * 10, increments, 1.0)

    solution = MissionProgram(1).scanned(candidate_at, (0.0 if rises else 1.0,))
    assert solution.value == pytest.approx(0.3, abs=1e-3)
    lap_share = 0.05  # where the use is a lap more than the charge, 0.4 + 2 p = 1 + (0.4 + 2 p) / 10
    short = [p for p in (looked if rises else [1 - p for p in looked]) if p > 0.3 + lap_share + 1 / 12]
    assert len(short) <= 3, short

"""What a flight's rest is forecast to take, at several moments of simulated flights, against what it then took."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from statistics import NormalDist
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from common import ROOT
from common.plans import TWO_BLOCKS
from eadp.planning.joint.forecaster import MIN_STD, FinalCharge, Forecast, Forecaster, ripple_w

from eadp.io.flight.inputs import load_flight
from eadp.planning.base import TrackingPlanner
from eadp.planning.joint.program import MissionProgram, best_at
from eadp.planning.joint.settings import JointSettings
from eadp.simulation.loop import Outcome, fly

SEEDS = range(12)
MOMENTS_S = (30.0, 100.0, 180.0, 250.0, 300.0)
CALM = {"wind.speed_mps": 0.0}
GUSTS = {"wind.speed_mps": 6.0, "wind.towards_deg": 30.0, "wind.gust_std_mps": 1.5}
SURE = NormalDist().inv_cdf(0.95)


def inputs_of(**overrides):
    """The survey at its widest spacing."""
    fixed = {"planner.name": "static", "parameters.c1": -1000.0, "step_s": 0.05, "faults": [], **overrides}
    return load_flight(
        str(ROOT / "plans/survey.plan"), scenario_path=str(ROOT / "scenarios/survey.yaml"), overrides=fixed
    )


class Evaluated(NamedTuple):
    """A forecast, and when it was made."""

    time_s: float
    soc: float
    forecast: Forecast
    home_spare: float | None
    wind_mps: tuple[float, float]
    of_stages: dict[int, tuple[float, float]]


class Following(TrackingPlanner):
    """Keeps its parameters, and has the rest forecast at some moments."""

    def __init__(self, settings, estimator, mission, moments_s):
        super().__init__(settings, estimator, mission)
        held = {name: (value,) for name, value in zip(mission.plan.names, mission.parameters, strict=True)}
        self.forecaster = Forecaster(replace(settings, levels=held), mission)
        self.evaluated = []
        self._moments_s = list(moments_s)

    def update(self, observation):
        o = observation
        self.forecaster.update_stage(o)
        read = o.time_s >= self._next_reading_s - 1e-9
        decision = super().update(o)
        if read:
            self.forecaster.observe(o, self._computing_w)
        if self._moments_s and o.time_s >= self._moments_s[0]:
            self._moments_s.pop(0)
            ripple = ripple_w(self._estimator.state_w) if self.period_s else 0.0
            self.forecaster.start_at(o.time_s, (o.x_m, o.y_m), lambda: ripple)
            solution = best_at(self.forecaster.candidate(self.forecaster.shares))
            forecast = self.forecaster.forecast(solution)
            spare, wind_mps = self.forecaster.home_spare(solution), self.forecaster.wind_mps
            stages = self.forecaster.of_stages(solution)
            self.evaluated.append(Evaluated(o.time_s, o.soc, forecast, spare, wind_mps, stages))
        return decision


class SweepFlight(NamedTuple):
    """What was told on the way, and what came."""

    inputs: object
    outcome: Outcome
    evaluated: list
    steps: list

    def energy_wh(self, from_s):
        """Energy from a moment to the end, from the log."""
        powers = [(step.time_s, step.power_w) for step in self.steps if step.time_s >= from_s]
        pairs = itertools.pairwise(powers)
        return sum((p + q) / 2 * (later - now) for (now, p), (later, q) in pairs) / 3600


def flown(moments_s=MOMENTS_S, **overrides):
    inputs = inputs_of(**overrides)
    scenario = inputs.scenario
    pilot, outcome = Following(scenario.planner, scenario.estimator, inputs.mission, moments_s), Outcome()
    steps = list(fly(inputs.world, pilot, outcome))
    return SweepFlight(inputs, outcome, pilot.evaluated, steps)


@pytest.fixture(scope="module")
def calm():
    return flown(**CALM)


@pytest.fixture(scope="module")
def gusty():
    return [flown(seed=seed, **GUSTS) for seed in SEEDS]


def errors(flight):
    """What came less what was told, of time, energy and charge at the end, with the spreads that were told."""
    for one in flight.evaluated:
        f = one.forecast
        yield (
            (flight.outcome.duration_s - one.time_s - f.remaining_s, f.remaining_std_s),
            (flight.energy_wh(one.time_s) - f.energy_wh, f.energy_std_wh),
            (flight.outcome.soc_final - f.soc_end, f.soc_end_std),
        )


def test_in_calm_air_time_energy_and_charge_are_told(calm):
    assert calm.outcome.completed
    assert len(calm.evaluated) == len(MOMENTS_S)
    for one, (time, energy, soc) in zip(calm.evaluated, errors(calm), strict=True):
        f = one.forecast
        assert abs(time[0]) < max(0.01 * f.remaining_s, 1.0)
        assert abs(energy[0]) < 0.03 * f.energy_wh + 0.01
        assert abs(soc[0]) < 0.01


@pytest.mark.parametrize(
    ("which", "within", "spread", "most"), [(0, 0.7, 1.8, 5), (1, 0.75, 1.5, 4), (2, 0.75, 1.5, 4)]
)
def test_spreads_hold_in_gusts(gusty, which, within, spread, most):
    """Of errors over the spreads told: nine in ten would be within 1.64 and their mean square 1, were they normal."""
    scores = np.array([each[which][0] / each[which][1] for flight in gusty for each in errors(flight)])
    assert np.mean(np.abs(scores) < SURE) >= within
    assert 0.5 < np.sqrt(np.mean(scores**2)) < spread
    assert np.abs(scores).max() < most


def test_spreads_shrink_on_the_way(calm, gusty):
    for name in ("remaining_std_s", "energy_std_wh", "soc_end_std"):
        for flights in ([calm], gusty):
            spreads = np.array([[getattr(one.forecast, name) for one in flight.evaluated] for flight in flights])
            assert (spreads > 0).all()
            first, last = spreads.mean(axis=0)[[0, -1]]
            assert last < first / 2


def test_gusts_make_forecasts_less_sure(calm, gusty):
    for one, other in zip(calm.evaluated, gusty[0].evaluated, strict=True):
        assert other.forecast.remaining_std_s > one.forecast.remaining_std_s


def test_the_wind_is_found(calm, gusty):
    assert calm.evaluated[-1].wind_mps == pytest.approx((0, 0), abs=0.2)
    true = (6 * math.cos(math.radians(30)), 6 * math.sin(math.radians(30)))
    found = np.array([flight.evaluated[-1].wind_mps for flight in gusty])
    assert found.mean(axis=0) == pytest.approx(true, abs=0.6)
    assert np.abs(found - true).max() < 1.5


def test_stages_add_up_to_the_rest(calm):
    for one in calm.evaluated:
        f, stages = one.forecast, one.of_stages
        assert sum(seconds for seconds, _ in stages.values()) == pytest.approx(f.remaining_s)
        assert sum(energy for _, energy in stages.values()) == pytest.approx(f.energy_wh)
        assert set(stages) <= {1, 2, 3, 4}


def test_each_stage_takes_its_share(calm):
    """Time and energy of each of the four stages from the first moment on, all laps together."""
    started = [(0.0, 1), *((time_s, i % 4 + 1) for i, time_s in enumerate(calm.outcome.stage_times_s, 1))]
    first_s = calm.evaluated[0].time_s
    ends = [*(time_s for time_s, _ in started[1:]), calm.outcome.duration_s]
    for stage, (seconds, energy_wh) in calm.evaluated[0].of_stages.items():
        spans = [
            (max(a, first_s), b) for (a, own), b in zip(started, ends, strict=True) if own == stage and b > first_s
        ]
        took_s = sum(b - a for a, b in spans)
        took_wh = sum(calm.energy_wh(a) - calm.energy_wh(b) for a, b in spans)
        # triggers fire 20 m early: legs begin and end so much sooner, the first and the last alone are shorter
        assert seconds == pytest.approx(took_s, abs=6)
        assert energy_wh == pytest.approx(took_wh, abs=0.1)


@pytest.mark.parametrize(("soc_end", "std", "reserve"), [(0.2, 0.1, 0.05), (-0.03, 0.02, 0.05), (0.05, 0.01, 0.05)])
def test_probabilities_are_those_of_a_normal_distribution(soc_end, std, reserve):
    f = Forecast(100.0, 1.0, 1.0, 0.1, soc_end, std, reserve, ends=FinalCharge(std, (1.0,), (soc_end,)))
    # by counting draws
    ends = soc_end + std * np.random.default_rng(0).standard_normal(100_000)
    assert f.completes_probability == pytest.approx(np.mean(ends > 0), abs=0.006)
    assert f.reserve_probability == pytest.approx(np.mean(ends > reserve), abs=0.006)


def test_a_forecast_without_a_spread_is_sure():
    assert FinalCharge(0.0, means=(0.1,)).probability_above(0.05) == 1
    assert FinalCharge(0.0, means=(0.04,)).probability_above(0.05) == 0
    assert FinalCharge(MIN_STD / 9, means=(0.04,)).probability_above(0.0) == 1


def test_the_margin_is_z_standard_deviations(calm):
    """What may be used is the charge less the reserve and a margin of the quantile that is asked for."""
    inputs = calm.inputs
    evaluated = []
    for probability in (0.5, 0.95):
        forecaster = Forecaster(inputs.scenario.planner, inputs.mission, JointSettings(reserve_probability=probability))
        forecaster.assume((0.0, 0.0), 0.0, 1.0)
        forecaster.start_at(0.0, inputs.mission.start_m)
        candidate = forecaster.candidate(forecaster.shares)
        evaluated.append((candidate.available, forecaster.forecast(best_at(candidate)).soc_end_std))
    (even, _), (sure, std) = evaluated
    assert even == pytest.approx(1.0 - inputs.scenario.planner.reserve_soc)
    assert even - sure == pytest.approx(SURE * std)


# --- home -------------------------------------------------------------------------------------------------------------


def test_without_a_home_nothing_is_told_of_it(calm):
    assert all(one.home_spare is None for one in calm.evaluated)


def test_home_is_reached_until_the_point_of_no_return():
    """The charge that is spare at home, by the current of the two equations of the battery, V I = P and V = U − R I."""
    moments_s = tuple(range(10, 200, 10))
    flight = flown(moments_s, **CALM, **{"battery.capacity_ah": 0.2, "home.position_m": [0.0, -2500.0]})
    mission, reserve = flight.inputs.mission, flight.inputs.scenario.planner.reserve_soc
    base_w = mission.motion_w + mission.computing.power_w((-1000.0, 2.0), mission.plan.stages[0].sets)
    points = {round(step.time_s, 1): (step.x_m, step.y_m) for step in flight.steps}
    reached = []
    for one in flight.evaluated:
        way_m = math.dist(points[round(one.time_s, 1)], mission.home_m) + 3 * math.pi * mission.turn_radius_m
        volts, ohm = mission.battery.voltage_v, mission.battery.resistance_ohm
        current = min(np.roots([ohm, -volts, base_w]))
        takes = current * way_m / mission.cruise_mps / 3600 / mission.battery.capacity_ah
        assert one.soc - one.home_spare - reserve == pytest.approx(takes, rel=0.25)
        assert one.soc - one.home_spare - reserve > 0.97 * takes
        reached.append(one.home_spare >= 0)
    assert reached == sorted(reached, reverse=True), "once it is too far it stays too far"
    assert len(set(reached)) == 2


def test_against_a_wind_as_strong_as_the_airspeed_there_is_no_way_home():
    inputs = inputs_of(**{"home.position_m": [-2000.0, 0.0]})
    forecaster = Forecaster(inputs.scenario.planner, inputs.mission)
    reached = []
    for speed in (0.0, 14.0):
        forecaster.assume((speed, 0.0), 0.0, 0.5)
        forecaster.start_at(0.0, (0.0, 0.0))
        reached.append(forecaster.home_spare(best_at(forecaster.candidate(forecaster.shares))) > 0)
    assert reached == [True, False]


# --- ripple -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(5))
def test_the_ripple_is_the_highest_of_the_harmonics(seed):
    state = np.random.default_rng(seed).normal(0, 3, 7)
    turns = np.linspace(0, 2 * math.pi, 20_000)
    wave = sum(
        state[2 * k - 1] * np.cos(k * turns) + state[2 * k] * np.sin(k * turns) for k in range(1, len(state) // 2 + 1)
    )
    assert ripple_w(state) == pytest.approx(wave.max(), rel=0.02)
    assert ripple_w(state[:1]) == 0


# --- ends -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_the_charge_at_several_ends_is_a_mixture(seed):
    """Probabilities and moments beside draws; the level is the one that they leave below."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    shares, means = rng.dirichlet(np.ones(count)), rng.uniform(0, 0.3, count)
    ends = FinalCharge(float(rng.uniform(0.005, 0.05)), tuple(shares.tolist()), tuple(means.tolist()))
    drawn = means[rng.choice(count, 400_000, p=shares)] + ends.std * rng.standard_normal(400_000)
    assert ends.mean == pytest.approx(drawn.mean(), abs=1e-3)
    assert ends.variance == pytest.approx(drawn.var(), rel=0.02)
    for soc in (0.0, 0.05, 0.15):
        assert ends.probability_above(soc) == pytest.approx(np.mean(drawn > soc), abs=0.004)
    for probability in (0.5, 0.8, 0.95):
        assert np.mean(drawn > ends.level(probability)) == pytest.approx(probability, abs=0.004)


def at_take_off(c1, objective="quality", **overrides):
    inputs = inputs_of(**{"parameters.c1": c1, **CALM, **overrides})
    levels = {"c2": (10.0,)}
    own = JointSettings(objective=objective)
    forecaster = Forecaster(replace(inputs.scenario.planner, levels=levels), inputs.mission, own)
    forecaster.assume((0.0, 0.0), 0.0, 1.0)
    forecaster.start_at(0.0, inputs.world.start_m)
    return forecaster


def test_a_lap_that_may_be_the_last_is_two_outcomes():
    """At c1 = 0 the plan ends, to a hair, on stage 61 or a lap later: beside both, as plans of their own."""
    forecaster = at_take_off(0.0)
    candidate = forecaster.candidate(forecaster.shares)
    forecast = forecaster.forecast(best_at(candidate))
    route = forecaster.route(forecaster.shares)
    (end,) = route.ends
    likely = NormalDist(0, 0.25).cdf(end.clearance_m)
    times, _ = route.times_s(15.0, (0.0, 0.0))
    early_s = times[: end.leg].sum() + times[end.leg] * end.flown_m / route.legs[end.leg].length_m
    mean_s = likely * early_s + (1 - likely) * times.sum()
    assert forecast.ends.shares == pytest.approx((1 - likely, likely))
    assert forecast.remaining_s == pytest.approx(mean_s)
    between_s2 = likely * (1 - likely) * (times.sum() - early_s) ** 2
    terms, load = forecaster.terms(forecaster.shares)
    assert forecast.remaining_std_s == pytest.approx(math.sqrt(load.time_std_s**2 + between_s2))
    rest_wh = (times.sum() - early_s) * 46 / 3600
    own_wh = math.hypot(load.energy_std_j, 46 * load.time_std_s) / 3600
    spread_wh = math.hypot(own_wh, math.sqrt(likely * (1 - likely)) * rest_wh)
    assert spread_wh > 1.2 * own_wh
    assert forecast.energy_std_wh == pytest.approx(spread_wh, rel=0.1)
    early, late = sorted(forecast.ends.means, reverse=True)
    rest_j = (forecast.ends.means[1] - forecast.ends.means[0]) / terms.soc_per_j
    assert early > late
    assert rest_j == pytest.approx((times.sum() - early_s) * 46, rel=0.1)
    # the program keeps the reserve with its probability over both
    spare = forecast.ends._replace(means=tuple(b - late for b in forecast.ends.means))
    margin = forecaster.soc - forecaster._settings.reserve_soc - candidate.available
    assert spare.probability_above(-margin) == pytest.approx(0.95, abs=1e-3)


def test_parameters_whose_last_lap_is_uncertain_are_no_candidates_for_the_total():
    counted = 0
    for share in np.linspace(0, 1, 101).tolist():
        quality, total = (at_take_off(-900.0, objective) for objective in ("quality", "total"))
        candidate = quality.candidate((share,))
        uncertain = bool(quality.route((share,)).ends)
        counted += uncertain
        assert (total.candidate((share,)) is None) == (candidate is None or uncertain)
    assert 3 < counted < 60
    in_force = at_take_off(0.0, "total")
    assert in_force.candidate(in_force.shares) is not None, "what is in force stays"


def test_gusts_that_last_make_a_forecast_wider():
    stds = []
    for gust_time_s in (5.0, 30.0):
        inputs = inputs_of(**{"wind.gust_time_s": gust_time_s})
        forecaster = Forecaster(inputs.scenario.planner, inputs.mission)
        forecaster.assume((3.0, 0.0), 1.5, 1.0)
        forecaster.start_at(0.0, inputs.world.start_m)
        stds.append(forecaster.forecast(best_at(forecaster.candidate(forecaster.shares))).remaining_std_s)
    assert stds[1] > 1.3 * stds[0]


def test_an_uncertain_wind_makes_the_time_uncertain_by_its_gradient():
    """Var ln t = gᵀ P g, with the gradient as last computed."""
    inputs = inputs_of(**CALM)
    forecaster = Forecaster(inputs.scenario.planner, inputs.mission)
    forecaster._wind = SimpleNamespace(covariance=(0.04, 0.09, -0.03))
    forecaster._time_s, forecaster._sensitivity = 5.0, (0.0, (0.02, -0.01))
    gradient = np.array([0.02, -0.01])
    expected = gradient @ np.array([[0.04, -0.03], [-0.03, 0.09]]) @ gradient
    assert forecaster._wind_share(None) == pytest.approx(expected)
    forecaster._measured_wind = (1.0, 0.0)
    assert forecaster._wind_share(None) == 0.0


def test_expected_losses_are_kept_back_as_a_poisson_process_takes_them():
    ends = []
    for rate in (0.0, 6.0):
        inputs = inputs_of(**CALM)
        own = JointSettings(loss_rate_per_h=rate)
        forecaster = Forecaster(inputs.scenario.planner, inputs.mission, own)
        forecaster.assume((0.0, 0.0), 0.0, 1.0)
        forecaster.start_at(0.0, inputs.world.start_m)
        candidate = forecaster.candidate(forecaster.shares)
        ends.append(forecaster.forecast(best_at(candidate._replace(available=candidate.increments.base_use))))
    without, with_losses = ends
    rng = np.random.default_rng(0)
    counts = rng.poisson(6.0 * with_losses.remaining_s / 3600, 100_000)
    lost = np.array([rng.uniform(0.02, 0.12, count).sum() for count in counts])
    assert without.soc_end - with_losses.soc_end == pytest.approx(lost.mean(), rel=0.02)
    assert with_losses.ends.variance - without.ends.variance == pytest.approx(lost.var(), rel=0.03)


# --- blocks -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def two_blocks(tmp_path_factory):
    """A forecaster before take-off of a plan with two segments of laps, whose charge does not last for all of it."""
    path = tmp_path_factory.mktemp("blocks") / "two.plan"
    path.write_text(TWO_BLOCKS)
    inputs = load_flight(
        str(path),
        profile_path=str(ROOT / "profiles/pednet-jetson-nano.yaml"),
        overrides={"battery.capacity_ah": 0.47, "planner.name": "joint"},
    )
    forecaster = Forecaster(inputs.scenario.planner, inputs.mission, inputs.scenario.planner.joint)
    forecaster.assume((0.0, 0.0), 0.0, 1.0)
    forecaster.start_at(0.0, inputs.world.start_m)
    return forecaster


def test_a_path_parameter_has_a_value_for_each_of_two_blocks(two_blocks):
    """Each block's legs have its own value, and are as long as those of a plan flown at that value throughout."""
    assert two_blocks.by_blocks
    routes = {shares: two_blocks._route(shares) for shares in ((0.2, 0.2), (0.8, 0.8), (0.2, 0.8))}
    stages = {shares: np.array(route.shape) for shares, route in routes.items()}
    lengths = {shares: np.array([leg.distance_m for leg in route.legs]) for shares, route in routes.items()}
    mixed = routes[0.2, 0.8]
    first = [own[0] for own, stage in zip(mixed.parameters, mixed.shape, strict=True) if 2 <= stage <= 5]
    later = [own[0] for own, stage in zip(mixed.parameters, mixed.shape, strict=True) if 7 <= stage <= 10]
    assert set(first[4:]) == {-720.0}  # the first lap starts as decided at take-off
    assert set(later) == {-180.0}
    for shares, low, high in (((0.2, 0.2), 1, 5), ((0.8, 0.8), 7, 11)):
        inside = (stages[0.2, 0.8] >= low) & (stages[0.2, 0.8] <= high)
        alike = (stages[shares] >= low) & (stages[shares] <= high)
        assert lengths[0.2, 0.8][inside] == pytest.approx(lengths[shares][alike])


def test_values_by_blocks_are_those_of_a_fine_grid(two_blocks):
    def best(pairs):
        found = [best_at(each) for shares in pairs if (each := two_blocks.candidate(shares)) is not None]
        return max(solution.value for solution in found if solution.allocation.feasible)

    places = np.linspace(0, 1, 41).tolist()
    solution = MissionProgram(1).scanned(two_blocks.candidate, two_blocks.shares, by_blocks=True)
    one, two = best((share, share) for share in places), best(itertools.product(places, repeat=2))
    assert two > one + 0.01
    assert solution.allocation.feasible
    assert solution.value > two - 0.004


def test_the_value_of_later_blocks_is_decided_once_the_other_alters_nothing(two_blocks):
    assert two_blocks.settled((0.2, 0.8)) == (0.2, 0.8)
    assert two_blocks.settled((0.4, 0.4)) == (0.4, 0.4)
    cursor = two_blocks._cursor
    while cursor.segment < 1 or cursor.next().segment == 1:  # to the last stage of the first block
        cursor = cursor.next()
    before, two_blocks._cursor = two_blocks._cursor, cursor
    two_blocks._clear_routes()
    assert two_blocks.settled((0.2, 0.8)) == (0.8, 0.8)
    two_blocks._cursor = cursor.next()
    two_blocks._clear_routes()
    assert two_blocks._route((0.2, 0.8)).legs[-1].stage.index == 11
    two_blocks._cursor = cursor.next().next()
    assert not two_blocks.by_blocks
    two_blocks._cursor = before
    two_blocks._clear_routes()


def test_a_replayed_charge_is_believed_as_it_is_read():
    """No drain is predicted: a charge that falls is followed within 3 s, and a loss at the next reading."""
    inputs = load_flight(str(ROOT / "plans/survey.plan"), scenario_path=str(ROOT / "scenarios/paper-I-static.yaml"))
    forecaster, battery = Forecaster(inputs.scenario.planner, inputs.mission), inputs.mission.battery
    late = 0
    for k in range(300):
        charge = battery.prescribed_soc(float(k))
        forecaster._observe_charge(float(k), 36.0, charge)
        late += abs(forecaster.soc - charge) > 3 * 0.0022
    assert late <= 2
    assert forecaster.warnings == ()


# --- what a forecast expects ------------------------------------------------------------------------------------------


class Expecting(TrackingPlanner):
    """Keeps its parameters, and forecasts once; looks at every second thereafter by how much it is off."""

    def __init__(self, settings, estimator, mission, since_s):
        super().__init__(settings, estimator, mission)
        self.forecaster = Forecaster(settings, mission)
        self.seen, self._since_s = [], since_s

    def update(self, observation):
        o, forecaster = observation, self.forecaster
        forecaster.update_stage(o)
        read = o.time_s >= self._next_reading_s - 1e-9
        decision = super().update(o)
        if read:
            forecaster.observe(o, self._computing_w)
        if read and o.time_s >= self._since_s and not self.seen:
            forecaster.start_at(o.time_s, (o.x_m, o.y_m))
            self.solution = best_at(forecaster.candidate(forecaster.shares))
            forecaster.forecast(self.solution)
            forecaster.expect(self.solution)
        if read and o.time_s >= self._since_s:
            self.seen.append((o.time_s, forecaster.surprise(o.time_s, (o.x_m, o.y_m), self._computing_w)))
        return decision

    ingest = TrackingPlanner.ingest


def expecting(seconds=30.0, since_s=100.0, **overrides):
    inputs = inputs_of(**CALM, **{"time_limit_s": since_s + seconds, **overrides})
    pilot = Expecting(inputs.scenario.planner, inputs.scenario.estimator, inputs.mission, since_s)
    for _ in fly(inputs.world, pilot, Outcome()):
        pass
    return pilot


def test_a_flight_that_goes_as_forecast_is_no_surprise():
    """Over a new stage, too; a new forecast is as far from the first one as the surprise said."""
    pilot = expecting()
    errors = np.array([error for _, error in pilot.seen])
    assert len(errors) > 200
    assert errors[0] == pytest.approx(0.0, abs=1e-9)
    assert np.isfinite(errors).all()
    forecaster, shares = pilot.forecaster, pilot.forecaster.shares
    before = pilot.solution.candidate
    time_s = pilot.seen[-1][0]
    forecaster.start_at(time_s, forecaster._position)
    after = forecaster.candidate(shares)
    more = (after.available - after.increments.base_use) - (before.available - before.increments.base_use)
    flown = best_at(before).allocation.use - before.increments.base_use  # of the computations, while it flew
    per_s = flown / forecaster.terms(shares)[1].times_s.sum()
    assert errors[-1] == pytest.approx(more + per_s * 30.0, abs=0.25 * abs(per_s * 30.0) + 2e-4)


@pytest.mark.parametrize("lost", [0.02, 0.1])
def test_charge_that_is_lost_is_a_surprise_as_large(lost):
    as_forecast, off = expecting(), expecting(faults=[{"at_s": 115.0, "soc_drop": lost}])
    assert off.seen[-1][1] - as_forecast.seen[-1][1] == pytest.approx(-lost, rel=0.15)


def test_wind_that_is_not_the_one_expected_is_a_surprise():
    pilot = expecting()
    forecaster, (time_s, _) = pilot.forecaster, pilot.seen[-1]
    forecaster._sensitivity = (time_s, (0.01, 0.0))
    wx, wy = forecaster.wind_mps
    forecaster._measured_wind = (wx + 1.0, wy)
    forecaster._wind_variance = lambda: 0.0
    left_s = float(forecaster._expected.times_s.sum()) - 30.0
    still = forecaster._measured_wind
    moved = forecaster.surprise(time_s, forecaster._position, pilot._computing_w)
    forecaster._measured_wind = (still[0] - 1.0, still[1])
    back = forecaster.surprise(time_s, forecaster._position, pilot._computing_w)
    expected = forecaster._expected
    assert back - moved == pytest.approx(0.01 * left_s * expected.mean_w * expected.soc_per_j, rel=0.05)


# --- bounds -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("at_s", [5.0, 60.0, 150.0, 250.0])
@pytest.mark.parametrize("overrides", [CALM, GUSTS, {"battery.capacity_ah": 0.3}])
def test_no_place_is_worth_more_than_its_bound(at_s, overrides):
    inputs = inputs_of(**{**overrides, "parameters.c1": -400.0, "time_limit_s": at_s})
    pilot = Expecting(inputs.scenario.planner, inputs.scenario.estimator, inputs.mission, at_s - 1.0)
    for _ in fly(inputs.world, pilot, Outcome()):
        pass
    forecaster = pilot.forecaster
    places = np.linspace(0.0, 1.0, 101).tolist()
    values, bounds = [], []
    for share in places:
        candidate = forecaster.candidate((share,))
        values.append(best_at(candidate).value if candidate is not None else -math.inf)
        bounds.append(forecaster.bound((share,)))
    assert all(value <= bound + 1e-9 for value, bound in zip(values, bounds, strict=True))
    if overrides is CALM:
        assert min(bounds) < max(values), "it rules something out"
    # between two places, it is at most the greater of theirs
    assert np.all(np.array(bounds[1:-1]) <= np.maximum(bounds[:-2], bounds[2:]) + 1e-12)
    program = MissionProgram(1)
    found = [
        program.scanned(forecaster.candidate, forecaster.shares, bound=bound)
        for bound in (forecaster.bound, lambda _: math.inf)
    ]
    assert found[0].value == pytest.approx(found[1].value, abs=1e-4)

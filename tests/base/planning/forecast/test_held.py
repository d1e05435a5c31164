"""Forecasts at parameters that are held: against flights with them, in calm air and in gusts, before and in flight."""

import itertools
import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
import pytest
from common.forecasts import CALM, survey_inputs

from eadp.planning.base import Ending
from eadp.planning.forecast.held import HeldForecast, before_take_off
from eadp.planning.registry import Planner
from eadp.simulation.loop import Outcome, fly

MOMENTS_S = (30.0, 100.0, 180.0, 250.0, 300.0)
GUSTS = {"wind.speed_mps": 6.0, "wind.towards_deg": 30.0, "wind.gust_std_mps": 1.5}
SURE = NormalDist().inv_cdf(0.95)


class Evaluated(NamedTuple):
    """A forecast, and when it was made."""

    time_s: float
    forecast: Ending
    wind_mps: tuple[float, float]
    of_stages: dict[int, float]


class Following(Planner):
    """Keeps its parameters, and has the rest forecast at some moments."""

    def __init__(self, inputs, moments_s):
        scenario = inputs.scenario
        super().__init__(scenario.planner, inputs.mission)
        self.held = HeldForecast(scenario.planner, inputs.mission)
        self.evaluated, self._moments_s = [], list(moments_s)

    @property
    def next_update_s(self):
        return next(iter(self._moments_s), math.inf)

    def update(self, state):
        o, decision = state.now, super().update(state)
        if self._moments_s and o.time_s >= self._moments_s[0]:
            self._moments_s.pop(0)
            known = state.known(o.time_s, o.position_m)
            found = self.held.evaluation(known, self.mission.parameters)
            forecast = found.forecast(found.filled())
            assert forecast == self.held.at(known, self.mission.parameters)
            stages = np.bincount(found.routes[0].stages, found.load.times_s)
            of_stages = {i: float(seconds) for i, seconds in enumerate(stages.tolist()) if i}
            self.evaluated.append(Evaluated(o.time_s, forecast, known.wind.mps, of_stages))
        return decision


class Flight(NamedTuple):
    """What was forecast on the way, and what came."""

    outcome: Outcome
    evaluated: list
    steps: list

    def energy_wh(self, from_s):
        """Energy from a moment to the end, from the log."""
        powers = [(step.time_s, step.power_w) for step in self.steps if step.time_s >= from_s]
        pairs = itertools.pairwise(powers)
        return sum((p + q) / 2 * (later - now) for (now, p), (later, q) in pairs) / 3600


def flown(moments_s=MOMENTS_S, **overrides):
    inputs = survey_inputs("static", **{"parameters.c1": -1000.0, **overrides})
    flight, outcome = inputs.flight(), Outcome()
    flight.planner = Following(inputs, moments_s)
    steps = list(fly(inputs.world, flight, outcome))
    assert outcome.completed
    return Flight(outcome, flight.planner.evaluated, steps)


@pytest.fixture(scope="module")
def calm():
    return flown(**CALM)


@pytest.fixture(scope="module")
def gusty():
    return [flown(seed=seed, **GUSTS) for seed in range(4)]


def errors(flight):
    """What came less what was forecast, of time, energy and charge at the end, with the deviations forecast."""
    for one in flight.evaluated:
        f = one.forecast
        yield (
            (flight.outcome.duration_s - one.time_s - f.remaining_s, f.remaining_std_s),
            (flight.energy_wh(one.time_s) - f.energy_wh, f.energy_std_wh),
            (flight.outcome.soc_final - f.soc_end, f.soc_end_std),
        )


def test_in_calm_air_time_energy_and_charge_come_as_forecast(calm):
    assert len(calm.evaluated) == len(MOMENTS_S)
    for one, (time, energy, soc) in zip(calm.evaluated, errors(calm), strict=True):
        f = one.forecast
        assert abs(time[0]) < max(0.01 * f.remaining_s, 1.0)
        assert abs(energy[0]) < 0.03 * f.energy_wh + 0.01
        assert abs(soc[0]) < 0.01


@pytest.mark.parametrize(
    ("which", "within", "spread", "most"), [(0, 0.7, 1.8, 5), (1, 0.75, 1.5, 4), (2, 0.75, 1.5, 4)]
)
def test_standard_deviations_hold_in_gusts(gusty, which, within, spread, most):
    """Of errors over their deviations: nine in ten would be within 1.64 and their mean square 1, were they normal."""
    scores = np.array([each[which][0] / each[which][1] for flight in gusty for each in errors(flight)])
    assert np.mean(np.abs(scores) < SURE) >= within
    assert 0.5 < np.sqrt(np.mean(scores**2)) < spread
    assert np.abs(scores).max() < most


def test_standard_deviations_shrink_on_the_way(calm, gusty):
    for name in ("remaining_std_s", "energy_std_wh", "soc_end_std"):
        for flights in ([calm], gusty):
            stds = np.array([[getattr(one.forecast, name) for one in flight.evaluated] for flight in flights])
            assert (stds > 0).all()
            first, last = stds.mean(axis=0)[[0, -1]]
            assert last < first / 2


# --- before take-off --------------------------------------------------------------------------------------------------


@pytest.mark.quick(2)
@pytest.mark.parametrize("wind", [CALM, {"wind.speed_mps": 5.0, "wind.towards_deg": 60.0}])
@pytest.mark.parametrize("c1", [-1000.0, -400.0])
def test_before_take_off_time_and_energy_are_those_flown_without_gusts(wind, c1):
    keys = {"parameters.c1": c1, "battery.capacity_ah": 1.0, "wind.gust_std_mps": 0.0, **wind}
    inputs = survey_inputs("static", **keys)
    expected, outcome = inputs.preflight(), Outcome()
    for _ in fly(inputs.world, inputs.flight(), outcome):
        pass
    assert outcome.completed
    assert expected.forecast.remaining_s == pytest.approx(outcome.duration_s, rel=0.01)
    assert expected.forecast.energy_wh == pytest.approx(outcome.energy_j / 3600, rel=0.01)
    assert expected.quality == pytest.approx(outcome.parameters.quality({}), abs=0.02)


def test_a_preflight_is_the_held_forecast_before_take_off():
    inputs = survey_inputs("static", **{"parameters.c1": -700.0})
    settings, mission = inputs.scenario.planner, inputs.mission
    wind_mps, gusts = (3.0, -2.0), 1.0
    expected = Planner.preflight(settings, mission, wind_mps, gusts)
    known = before_take_off(settings, mission, wind_mps, gusts)
    assert expected.forecast == HeldForecast(settings, mission).at(known, mission.parameters)
    assert [*expected.parameters] == [*mission.plan.names]
    assert [*expected.parameters.values()] == pytest.approx([*mission.parameters])
    assert sum(seconds for seconds, _ in expected.stages.values()) == pytest.approx(expected.forecast.remaining_s)
    assert sum(energy for _, energy in expected.stages.values()) == pytest.approx(expected.forecast.energy_wh)


def test_other_computations_are_held_too():
    inputs = survey_inputs("static", **CALM)
    known = before_take_off(inputs.scenario.planner, inputs.mission, (0.0, 0.0), 0.0)
    held = HeldForecast(inputs.scenario.planner, inputs.mission)
    low, high = (held.at(known, (-500.0, rate)) for rate in (2.0, 10.0))
    assert low.remaining_s == high.remaining_s
    sets = inputs.mission.plan.stages[0].sets
    powers_w = [inputs.mission.computing.power_w((-500.0, rate), sets) for rate in (2.0, 10.0)]
    more_wh = (powers_w[1] - powers_w[0]) * low.remaining_s / 3600
    assert high.energy_wh - low.energy_wh == pytest.approx(more_wh, rel=1e-6)
    assert high.soc_end < low.soc_end


def test_a_plan_that_cannot_be_flown_has_no_forecast():
    inputs = survey_inputs("static")
    settings, mission = inputs.scenario.planner, inputs.mission
    assert Planner.preflight(settings, mission, (40.0, 0.0), 0.0) is None
    known = before_take_off(settings, mission, (40.0, 0.0), 0.0)
    assert HeldForecast(settings, mission).at(known, mission.parameters) is None

"""A route found in one function against the steps: load, terms, final charge and the filling of the knapsack."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from common import ROOT

from eadp.core import compiled
from eadp.io.flight.inputs import load_flight
from eadp.planning.joint import forecaster as module
from eadp.planning.joint.knapsack import Increments, fill_greedy
from eadp.planning.joint.place_kernel import FEASIBLE, SHORT, UNFLYABLE, UNKNOWN, optimal_gain
from eadp.planning.joint.program import place_of
from eadp.simulation.loop import Outcome, fly

ROUNDING = 1e-12
BASE = {"vehicle.airframe.model": "fixed-wing", "step_s": 0.1, "log_every_s": 1e6}
FLIGHTS = {
    "survey": ("plans/survey.plan", {"wind.speed_mps": 3}),
    "short": ("plans/survey.plan", {"battery.capacity_ah": 0.3}),
    "losses": ("plans/survey.plan", {"planner.joint.loss_rate_per_h": 2.0, "battery.capacity_ah": 0.45}),
    "current": ("plans/survey.plan", {"battery.max_c_rate": 6.25, "battery.capacity_ah": 0.6}),
    "voltage": ("plans/survey.plan", {"battery.voltage_empty_v": 12.4, "battery.cutoff_voltage_v": 12.3}),
    "weights": ("plans/survey.plan", {"planner.weights": {"c1": 0.2, "c2": 1.0}}),
    "two": ("two.plan", {"profile": "two.yaml", "battery.capacity_ah": 0.6}),
}
TWO = """schema: eadp.profile/1
parameters: [{name: fps}, {name: size}]
points:
"""


def two_computations(folder):
    """The survey with a second computation that does not run on its turns, and a profile of both."""
    parts = (
        (ROOT / "plans/survey.plan")
        .read_text()
        .replace("computations fps", "computations fps, size")
        .split("[2, 10]\n")
    )
    sets = ("[2, 10]\n[0, 0]\n", "[2, 10]\n[1, 3]\n") * 2
    text = parts[0] + "".join(own + part for own, part in zip(sets, parts[1:], strict=True))
    (folder / "two.plan").write_text(text)
    points = [
        f"  - {{at: [{rate}, {size}], power_w: {3 + 0.5 * rate + 0.9 * size + 0.03 * rate * size}}}\n"
        for rate in (2, 5, 10)
        for size in (0, 1, 2, 3)
    ]
    (folder / "two.yaml").write_text(TWO + "".join(points))


def by_steps(forecaster, shares, monkeypatch):
    """The place, the terms and the load by steps in plain Python."""
    monkeypatch.setattr(module, "enabled", lambda: False)
    forecaster._evaluated.pop(shares, None)
    candidate = forecaster.candidate(shares)
    return (None, None, None) if candidate is None else (place_of(candidate), *forecaster._evaluated.pop(shares))


def at_once(forecaster, shares, monkeypatch):
    """The same in one function: in plain Python here, since compiled code is off."""
    monkeypatch.setattr(module, "enabled", lambda: True)
    forecaster._found.clear()
    forecaster._now, forecaster._in_steps = None, False
    found = forecaster._find(shares)
    if found is None:
        return UNKNOWN, (None, None, None)
    kind = found.numbers.kind
    if kind == UNFLYABLE:
        return kind, (None, None, None)
    return kind, (forecaster.place(shares), *forecaster._evaluation(found, forecaster.route(shares)))


def compared(forecaster, rng, monkeypatch, seen):
    for share in (*forecaster.shares, *rng.uniform(0, 1, 5)):
        shares = (float(share),)
        kind, (place, terms, load) = at_once(forecaster, shares, monkeypatch)
        seen[kind] += 1
        expected, other, other_load = by_steps(forecaster, shares, monkeypatch)
        if kind == UNKNOWN:
            continue
        assert (place is None) == (expected is None)
        if expected is None:
            continue
        seen["ends"] += not place.certain
        assert (place.shares, place.shape) == (expected.shares, expected.shape)
        assert (place.certain, place.feasible) == (expected.certain, expected.feasible)
        for name in ("value", "use", "available", "tolerance"):
            assert getattr(place, name) == pytest.approx(getattr(expected, name), abs=ROUNDING)
        for name in ("soc_per_j", "mean_w", "scale", "beyond_w", "letter_soc", "delivered_soc"):
            assert getattr(terms, name) == pytest.approx(getattr(other, name), rel=1e-9, abs=ROUNDING)
        assert terms.volts == pytest.approx(other.volts, rel=ROUNDING)
        assert (terms.kind_of == other.kind_of).all()
        assert terms.relative == other.relative
        for name in Increments._fields:
            assert getattr(terms.increments, name) == pytest.approx(getattr(other.increments, name), abs=ROUNDING)
        for name in ("times_s", "motion_w", "peak_w", "time_std_s", "energy_std_j", "use_ratio", "charge_std"):
            assert getattr(load, name) == pytest.approx(getattr(other_load, name), rel=1e-9)
        assert len(load.ends) == len(other_load.ends)


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_route_at_once_is_that_by_steps(name, monkeypatch, tmp_path):
    two_computations(tmp_path)
    plan, changes = FLIGHTS[name]
    folder = tmp_path if name == "two" else ROOT
    if "profile" in changes:
        changes = changes | {"profile": str(folder / changes["profile"])}
    scenario = str(ROOT / "scenarios/survey.yaml")
    inputs = load_flight(str(folder / plan), scenario_path=scenario, overrides={**BASE, **changes})
    planner, seen, rng = inputs.planner(), Counter(), np.random.default_rng(0)
    replan = planner._replan

    def replanned(o, cause):
        replan(o, cause)
        planner._forecaster._ripple_w = min(planner._forecaster._ripple_w, 5.0)
        compared(planner._forecaster, rng, monkeypatch, seen)
        monkeypatch.setattr(module, "enabled", compiled.enabled)

    planner._replan = replanned
    for _ in fly(replace(inputs.world, time_limit_s=260), planner, Outcome()):
        pass
    assert seen[FEASIBLE] + seen[SHORT] > 20, seen
    assert seen["ends"] > 0 or name in ("voltage", "two"), seen
    if name in ("current", "voltage", "two"):
        assert seen[UNKNOWN] > 0, seen
    if name == "short":
        assert seen[SHORT] > 30, seen


@pytest.mark.parametrize("seed", range(60))
def test_the_optimal_gain_is_that_of_filling_in_order(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 40))
    use, gain = rng.integers(0, 6, count) / 8, rng.integers(0, 9, count) / 16  # with ties, and some without use
    amounts = np.zeros((4, count))
    amounts[0], amounts[1] = use, gain
    places = np.zeros(count, dtype=np.intp)
    for spare in (0.0, *rng.uniform(0, max(use.sum(), 1.0), 5).tolist(), float(use.sum()), math.inf):
        expected = fill_greedy(Increments(places, places, use, gain, 0.0, 0.0), spare).value
        assert optimal_gain(amounts, count, spare) == pytest.approx(expected, abs=ROUNDING)
        assert (amounts[:2] == [use, gain]).all()

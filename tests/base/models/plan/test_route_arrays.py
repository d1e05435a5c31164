"""Several routes in flat arrays against loops over each route and over cursors."""

from functools import lru_cache

import numpy as np
import pytest
from common import ROOT
from common.plans import PARTS, TWO_BLOCKS

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import FlownGround, RunTally, lap_scale
from eadp.models.plan.route import RouteArrays, RoutePredictor

ALGEBRA = 1e-9
SHARES = (0.0, 0.21, 0.5, 0.83, 1.0)
PLANS = ("survey", "parts", "two blocks")


@lru_cache
def plan_of(name):
    texts = {"parts": PARTS, "two blocks": TWO_BLOCKS}
    text = Text(name, texts[name]) if name in texts else read_text(str(ROOT / f"plans/{name}.plan"))
    return read_plan(text)[0]


def start_of(name, share, started=0):
    """A cursor after some stages at a share of c1's set, and where its stage is joined."""
    plan = plan_of(name)
    box = plan.hull(0)
    parameters = (box.lo + share * (box.hi - box.lo), *[plan.hull(i).lo for i in range(1, len(plan.names))])
    cursor = PlanCursor.start(plan, parameters)
    joined = (35.0, 100.0) if name == "survey" else (10.0, 0.0)
    for _ in range(started):
        joined, cursor = cursor.trigger_m(), cursor.next()
    return cursor, joined


def routes_of(name, started=0):
    cursor, joined = start_of(name, 0.4, started)
    predictor, box = RoutePredictor(), plan_of(name).hull(0)
    decided = [(box.lo + share * (box.hi - box.lo), *cursor.decided[1:]) for share in SHARES]
    return [predictor.route(cursor.decide(own), joined) for own in decided]


@pytest.mark.parametrize("name", PLANS)
def test_flat_arrays_are_the_routes_one_after_the_other(name):
    routes = routes_of(name)
    legs = RouteArrays.of(routes)
    values = np.random.default_rng(0).uniform(1, 9, len(legs.order))
    first = run = 0
    for i, route in enumerate(routes):
        own = slice(first, first + len(route.order))
        assert legs.order[own].tolist() == route.order.tolist()
        assert set(legs.place[own].tolist()) == {i}
        assert (legs.first[i], legs.last[i]) == (own.start, own.stop - 1)
        assert legs.stages[own].tolist() == [stage.index for stage in route.of_legs]
        assert legs.run[own].tolist() == [run + number for number in route.runs.tolist()]
        assert legs.first_run[i] == run
        assert legs.scales[run : run + len(route.scales)].tolist() == route.scales.tolist()
        assert legs.beyond_m[run + len(route.scales) - 1] == route.beyond_m
        assert legs.sums(values)[i] == pytest.approx(sum(values[own].tolist()))
        assert legs.running(values)[own] == pytest.approx([sum(values[own][: k + 1]) for k in range(len(route.order))])
        first, run = own.stop, run + len(route.scales)
    assert first == len(legs.order)
    assert np.count_nonzero(legs.beyond_m) <= len(routes)


def by_cursors(name, started, share):
    """Laps of a route with their scale, moving a cursor stage by stage: (place of each leg, scales, last scale)."""
    cursor, _ = start_of(name, 0.4, started)
    box = plan_of(name).hull(0)
    following = cursor.decide((box.lo + share * (box.hi - box.lo), *cursor.decided[1:]))
    last_of = {}
    while following is not None:
        last_of.setdefault((following.segment, following.lap), []).append(following)
        following = following.next()
        if sum(map(len, last_of.values())) > 2000:
            break
    return last_of


@pytest.mark.quick(4)
@pytest.mark.parametrize("started", [0, 1, 6])
@pytest.mark.parametrize("name", PLANS)
def test_runs_and_scales_against_cursors_moved_stage_by_stage(name, started):
    for share, route in zip(SHARES, routes_of(name, started), strict=True):
        laps = by_cursors(name, started, share)
        places = list(laps)[: len(route.scales)]
        expected, runs = [], []
        counts = np.bincount(route.runs, minlength=len(route.scales)).tolist()
        for number, place in enumerate(places):
            is_last = number == len(route.scales) - 1
            own = laps[place][: counts[number]]
            assert is_last or len(own) == len(laps[place]), "all legs of a lap but the last"
            expected.append(lap_scale(own[-1], last=is_last))
            runs += [number] * len(own)
        assert route.runs.tolist() == runs
        assert route.scales == pytest.approx(expected, abs=ALGEBRA)


def ground_by_loops(route, flown, times_s):
    """Ground of each leg, and of each second flown in the run being flown: from the definition."""
    ground, per_s = np.zeros(len(times_s)), 0.0
    for run, scale in enumerate(route.scales.tolist()):
        own = [i for i in range(len(times_s)) if route.runs[i] == run]
        length = sum(route.legs[i].distance_m for i in own)
        seconds = sum(times_s[i] for i in own)
        if run == 0:
            length, seconds = length + flown.run.flown_m, seconds + flown.run.flown_s
        if run == len(route.scales) - 1:
            length += route.beyond_m
        for i in own:
            ground[i] = scale * length * times_s[i] / seconds if seconds else 0.0
        if run == 0:
            per_s = scale * length / seconds if seconds else 0.0
    return ground, per_s


@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize("started", [0, 2])
def test_ground_against_a_loop_over_laps(name, started):
    routes, rng = routes_of(name, started), np.random.default_rng(started)
    legs = RouteArrays.of(routes)
    flown = FlownGround(300.0, 100.0, RunTally(150.0, 11.0, 10.0, 4.0))
    for wind_mps in ((0.0, 0.0), (6.0, -4.0)):
        times_s = np.concatenate([route.times_s(15.0, wind_mps)[0] for route in routes])
        times_s[legs.first] *= rng.uniform(0.2, 1.0)
        ground, per_s = legs.ground(flown, times_s)
        for i, route in enumerate(routes):
            expected, flown_per_s = ground_by_loops(route, flown, times_s[legs.place == i])
            assert ground[legs.place == i] == pytest.approx(expected, abs=1e-6)
            assert per_s[i] == pytest.approx(flown_per_s, abs=1e-6)

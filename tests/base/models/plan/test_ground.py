"""Ground and the quality U: what it is to be, of laps on paper, and the same from a log that is kept in flight."""

import math

import numpy as np
import pytest
from common.plans import TWO_BLOCKS, plan_of, survey

from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import FlownGround, GroundLog, QualityShares, lap_scale
from eadp.models.plan.route import RouteArrays, RoutePredictor
from eadp.simulation.metrics import ParameterLog

SPEED_MPS = 15.0
GROUND = 0.05
"""Ground of a mission over the whole set of c1: the last lap counts whole."""
ALGEBRA = 1e-9


def parameters_of(plan, share):
    """c1 at a share of its set, the computations at the highest values of theirs."""
    box = plan.hull(0)
    return (box.lo + share * (box.hi - box.lo), *[plan.hull(i).hi for i in range(1, len(plan.names))])


def on_paper(plan, start, decide):
    """Fly legs at a constant speed; `decide` maps (time, cursor) to parameters: log and time."""
    cursor, joined, time_s = PlanCursor.start(plan, decide(0.0, None)), start, 0.0
    log, predictor = ParameterLog(plan, cursor, joined), RoutePredictor()
    while True:
        route = predictor.route(cursor, joined)
        leg = route.legs[0]
        time_s += leg.distance_m / SPEED_MPS
        if len(route.order) == 1:
            log.close(time_s)
            return log, time_s
        joined, cursor = leg.end_m, cursor.decide(decide(time_s, cursor)).next()
        log.change(time_s, cursor, joined)


def start_of(plan):
    return (35.0, 146.0) if plan.repeats else (10.0, 0.0)


@pytest.mark.parametrize("weights", [{}, {"c1": 5.0}, {"c2": 0.0}])
def test_the_highest_parameters_throughout_are_1(weights):
    for plan in (survey(), plan_of(TWO_BLOCKS)):
        log, _ = on_paper(plan, start_of(plan), lambda *_, plan=plan: parameters_of(plan, 1.0))
        assert log.quality(weights) == pytest.approx(1.0, abs=ALGEBRA)


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_parameters_that_stay_are_seen_with_their_mean_share(share):
    plan = survey()
    c1, c2 = parameters_of(plan, share)[0], 4.0
    log, _ = on_paper(plan, start_of(plan), lambda *_: (c1, c2))
    assert log.quality({}) == pytest.approx((share + 0.25) / 2, abs=ALGEBRA)
    assert log.quality({"c1": 3.0}) == pytest.approx((3 * share + 0.25) / 4, abs=ALGEBRA)


@pytest.mark.parametrize("stage", [3, 4])
@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_change_that_alters_nothing_flown_earns_nothing(stage, share):
    """c1 waits for the last line of a lap, which does not depend on it: in the last lap it alters nothing."""
    plan = survey()
    route = RoutePredictor().route(PlanCursor.start(plan, parameters_of(plan, 0.35)), start_of(plan))
    stages = [leg.stage.index for leg in route.legs]
    times_s = np.cumsum([leg.distance_m / SPEED_MPS for leg in route.legs])
    late_s = times_s[len(stages) - 1 - stages[::-1].index(stage)] - 1e-6  # the last leg of this stage is flown

    def late(time_s, _):
        return parameters_of(plan, share if time_s > late_s else 0.35)

    kept, kept_s = on_paper(plan, start_of(plan), lambda *_: parameters_of(plan, 0.35))
    changed, changed_s = on_paper(plan, start_of(plan), late)
    assert changed_s == pytest.approx(kept_s)
    assert changed.quality({"c2": 0.0}) == pytest.approx(kept.quality({"c2": 0.0}), abs=ALGEBRA)


def ground_of(plan, start, parameters):
    route = RoutePredictor().route(PlanCursor.start(plan, parameters), start)
    legs = RouteArrays.of([route])
    return float(legs.ground(FlownGround(), route.times_s(SPEED_MPS, (0.0, 0.0))[0])[0].sum())


def test_ground_of_a_mission_is_the_same_over_the_set_of_c1():
    plan = survey()
    found = np.array([ground_of(plan, start_of(plan), parameters_of(plan, share)) for share in np.linspace(0, 1, 41)])
    assert np.abs(found / found.mean() - 1).max() < GROUND


@pytest.mark.parametrize("seed", range(3))
def test_a_log_that_is_kept_in_flight_is_the_one_of_the_metrics(seed):
    """What has been seen up to a stage, and what is left at the parameters then in force, is U of the whole flight."""
    plan, rng = survey(), np.random.default_rng(seed)
    start, values = start_of(plan), {}

    def decide(time_s, _):
        return values.setdefault(round(time_s, 3), parameters_of(plan, float(rng.choice([0.1, 0.5, 0.9]))))

    log, whole_s = on_paper(plan, start, decide)
    cursor, joined, time_s = PlanCursor.start(plan, decide(0.0, None)), start, 0.0
    kept, predictor = GroundLog(plan, {}), RoutePredictor()
    seen = 0
    while True:
        route = predictor.route(cursor, joined)
        leg = predictor.leg(cursor, joined).legs[0]
        kept.start_leg(time_s, cursor, leg.length_m)
        kept.hold(time_s, cursor, cursor.parameters)
        seen += 1
        if len(route.order) == 1:
            break
        time_s, joined = time_s + route.legs[0].distance_m / SPEED_MPS, route.legs[0].end_m
        cursor = cursor.decide(decide(time_s, cursor)).next()
    flown_ground = kept.until(time_s)
    times_s, _ = route.times_s(SPEED_MPS, (0.0, 0.0))
    legs = RouteArrays.of([route])
    ground, per_s = legs.ground(flown_ground, times_s)
    own = kept.shares.of(cursor.stage.index, cursor.parameters)
    run = flown_ground.run
    total = flown_ground.ground + per_s[0] * run.free_s + float(ground.sum())
    value = flown_ground.value + per_s[0] * run.area_s + float(ground.sum()) * own
    assert seen > 8
    assert time_s < whole_s
    assert log.quality({}) == pytest.approx(value / total, abs=ALGEBRA)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8, 1.0])
def test_a_laps_scale_is_its_advance_by_that_of_the_highest(share):
    plan = survey()
    c1 = parameters_of(plan, share)[0]
    cursor = PlanCursor.start(plan, (c1, 10.0))
    radius = math.sqrt(4900 + c1)
    advance = math.hypot(150 - 2 * radius, (75 - radius) / 5)
    assert lap_scale(cursor) == pytest.approx(advance / math.hypot(10, 1))


def test_shares_of_stages_sum_to_1_over_what_has_a_choice():
    text = "0.1; 90; x-c1\nc1, 400\n[-1000, 0]\n[2, 10]\n0.1; 90; x-c1\nc1, 800\n[-1000, 0]\n[0, 0]\n"
    text += "0.1; 90; x-c1\nc1, 900\n[-300, -300]\n[0, 0]\n"
    plan = plan_of(text)
    shares = QualityShares(plan, {"c1": 3.0})
    assert shares.scaled(1) == pytest.approx([0.75, 0.25])
    for stage in range(1, 4):
        own = shares.scaled(stage)
        sets = plan.quality_sets[stage - 1]
        weights = [w if box.lo < box.hi else 0.0 for w, box in zip((3.0, 1.0), sets, strict=True)]
        assert own == pytest.approx([w / (sum(weights) or 1.0) for w in weights])
        if any(weights):
            expected = sum(
                w * (v - box.lo) / (box.hi - box.lo)
                for w, v, box in zip(weights, (-500.0, 4.0), sets, strict=True)
                if box.lo < box.hi
            )
            assert shares.of(stage, (-500.0, 4.0)) == pytest.approx(expected / sum(weights))
        else:
            assert shares.of(stage, (-500.0, 4.0)) is None

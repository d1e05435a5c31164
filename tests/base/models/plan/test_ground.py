"""Ground and the quality U: what it is to be, and the same from laps flown on paper and from rows of a flight."""

from __future__ import annotations

import contextlib
import io
import itertools
import math

import numpy as np
import pytest
from common import ROOT, few_rows
from common.forecasts import survey_inputs
from common.plans import TWO_BLOCKS

from eadp.api.inputs import load_flight
from eadp.cli.main import main
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.ground import FlownGround, GroundLog, QualityShares, lap_scale
from eadp.models.plan.route import RouteArrays, RoutePredictor
from eadp.simulation.loop import Outcome, fly
from eadp.simulation.metrics import ParameterLog

SPEED_MPS = 15.0
GROUND = 0.05
"""Ground of a mission over the whole set of c1: the last lap, and the sides of a field, are of whole laps."""
FLOWN = 0.01
ALGEBRA = 1e-9


def survey():
    return read_plan(read_text(str(ROOT / "plans/survey.plan")))[0]


FIELDS = {"lines of 30 m": ("--swath", "30"), "lines of 22 m at 70°": ("--swath", "22", "--heading", "70")}


@pytest.fixture(scope="module")
def covered(tmp_path_factory):
    """Plans of laps over a real field, with c1 of 0 for the densest lines."""
    profile, found = str(ROOT / "profiles/pednet-jetson-nano.yaml"), {}
    field = "cover", str(ROOT / "plans/meadow.geojson"), "--pattern", "zamboni", "--min-radius", "30"
    for name, flags in FIELDS.items():
        path, out = tmp_path_factory.mktemp("fields") / "field.plan", io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
            assert main([*field, *flags, "--profile", profile]) == 0
        path.write_text(out.getvalue())
        found[name] = load_flight(str(path), overrides={"planner.name": "static"}, profile=profile)
    return found


def parameters_of(plan, share):
    """c1 at a share of its set, the computations at the highest values of theirs."""
    box = plan.hull(0)
    return (box.lo + share * (box.hi - box.lo), *[plan.hull(i).hi for i in range(1, len(plan.names))])


def on_paper(plan, start, decide, stop=None):
    """Fly legs at a constant speed; `decide` maps (time, cursor) to parameters; ends short at `stop`: log and time."""
    cursor, joined, time_s = PlanCursor.start(plan, decide(0.0, None)), start, 0.0
    log, predictor = ParameterLog(plan, cursor, joined), RoutePredictor()
    while True:
        route = predictor.route(cursor, joined)
        leg = route.first
        if stop is not None and time_s + leg.distance_m / SPEED_MPS > stop:
            flown_m = (stop - time_s) * SPEED_MPS
            (x, y), (ox, oy) = leg.start_m, leg.offset_m
            share = flown_m / leg.length_m
            *_, ((px, py), _) = leg.track.points((x - ox, y - oy), flown_m, share, max(1, int(flown_m)))
            log.close(stop, ((px + ox, py + oy), SPEED_MPS))
            return log, stop
        time_s += leg.distance_m / SPEED_MPS
        if len(route.order) == 1:
            log.close(time_s)
            return log, time_s
        joined, cursor = leg.end_m, cursor.decide(decide(time_s, cursor)).next()
        log.change(time_s, cursor, joined)


def start_of(plan):
    return (35.0, 146.0) if plan.repeats else (10.0, 0.0)


# --- what U is to be --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("weights", [{}, {"c1": 5.0}, {"c2": 0.0}])
def test_the_highest_parameters_throughout_are_1(weights):
    for plan in (survey(), read_plan(Text("p", TWO_BLOCKS))[0]):
        log, _ = on_paper(plan, start_of(plan), lambda *_, plan=plan: parameters_of(plan, 1.0))
        assert log.quality(weights) == pytest.approx(1.0, abs=ALGEBRA)


def test_the_lowest_parameters_throughout_are_0():
    plan = survey()
    lowest = tuple(plan.hull(i).lo for i in range(2))
    assert on_paper(plan, start_of(plan), lambda *_: lowest)[0].quality({}) == pytest.approx(0.0, abs=ALGEBRA)


@pytest.mark.parametrize("share", [0.2, 0.6, 0.9])
def test_parameters_that_stay_are_seen_with_their_mean_share(share):
    plan = survey()
    c1, c2 = parameters_of(plan, share)[0], 4.0
    log, _ = on_paper(plan, start_of(plan), lambda *_: (c1, c2))
    assert log.quality({}) == pytest.approx((share + 0.25) / 2, abs=ALGEBRA)
    assert log.quality({"c1": 3.0}) == pytest.approx((3 * share + 0.25) / 4, abs=ALGEBRA)


def times_at(plan, start, parameters, shares):
    """When a flight on paper has seen shares of the ground at parameters that stay [s]: from the route's legs."""
    route = RoutePredictor().route(PlanCursor.start(plan, parameters), start)
    times_s, _ = route.times_s(SPEED_MPS, (0.0, 0.0))
    ground, _ = RouteArrays.of([route]).ground(FlownGround(), times_s)
    seen = np.concatenate(([0.0], np.cumsum(ground))) / ground.sum()
    return np.interp(shares, seen, np.concatenate(([0.0], np.cumsum(times_s))))


@pytest.mark.parametrize("name", ["survey", "two blocks"])
@pytest.mark.parametrize("share", [0.1, 0.3, 0.6, 0.9])
def test_ground_that_is_not_reached_counts_0(name, share):
    plan = survey() if name == "survey" else read_plan(Text("p", TWO_BLOCKS))[0]
    start, highest = start_of(plan), parameters_of(plan, 1.0)
    (stop_s,) = times_at(plan, start, highest, [share])
    found = on_paper(plan, start, lambda *_: highest, stop_s)[0].quality({})
    assert found == pytest.approx(share, abs=2e-3)
    lower = (*highest[:1], 6.0)
    assert on_paper(plan, start, lambda *_: lower, stop_s)[0].quality({}) < found


@pytest.mark.slow
def test_a_flight_whose_battery_is_empty_at_a_share_of_the_ground_has_no_more():
    inputs = survey_inputs("static", **{"wind.speed_mps": 0.0, "battery.capacity_ah": 0.4})
    outcome, _ = flown(inputs)
    assert not outcome.completed
    whole, _ = flown(survey_inputs("static", **{"wind.speed_mps": 0.0, "battery.capacity_ah": 3.0}))
    assert whole.completed
    assert whole.parameters.quality({}) == pytest.approx(1.0, abs=1e-6)
    shares = np.linspace(0, 1, 2001)
    reached_s = times_at(inputs.world.plan, inputs.world.start.position_m, inputs.mission.parameters, shares)
    reached = float(np.interp(outcome.duration_s, reached_s, shares))
    assert 0.3 < reached < 0.8
    assert outcome.parameters.quality({}) == pytest.approx(reached, abs=0.01)


def test_uniform_spacing_beats_half_fine_half_coarse_at_equal_charge():
    """At one speed and constant power, charge goes with time."""
    plan = survey()

    def halves(first, then, half_s):
        return lambda time_s, _: parameters_of(plan, first if time_s < half_s else then)

    start, fine, coarse = start_of(plan), 0.9, 0.2
    fine_s, coarse_s = (on_paper(plan, start, lambda *_, s=s: parameters_of(plan, s))[1] for s in (fine, coarse))
    uniform = [on_paper(plan, start, lambda *_, s=s: parameters_of(plan, s)) for s in np.linspace(0, 1, 41)]
    for first, then, half_s in ((fine, coarse, fine_s / 2), (coarse, fine, coarse_s / 2)):
        log, mixed_s = on_paper(plan, start, halves(first, then, half_s))
        mixed = log.quality({"c2": 0.0})
        best = max(log.quality({"c2": 0.0}) for log, seconds in uniform if seconds <= mixed_s)
        assert best > mixed + 0.01


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


# --- the ground of a mission does not depend on its parameters --------------------------------------------------------


def ground_of(plan, start, parameters):
    route = RoutePredictor().route(PlanCursor.start(plan, parameters), start)
    legs = RouteArrays.of([route])
    return float(legs.ground(FlownGround(), route.times_s(SPEED_MPS, (0.0, 0.0))[0])[0].sum())


def test_ground_of_a_mission_is_the_same_over_the_set_of_c1():
    plan = survey()
    found = np.array([ground_of(plan, start_of(plan), parameters_of(plan, share)) for share in np.linspace(0, 1, 41)])
    assert np.abs(found / found.mean() - 1).max() < GROUND


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", FIELDS)
def test_ground_of_a_covered_field_is_the_same_over_the_set_of_c1(covered, name):
    inputs = covered[name]
    plan, start = inputs.world.plan, inputs.world.start.position_m
    found = [ground_of(plan, start, parameters_of(plan, share)) for share in np.linspace(0, 1, 21)]
    assert np.abs(np.array(found) / np.mean(found) - 1).max() < GROUND


# --- the log of a flight ----------------------------------------------------------------------------------------------


def flown(inputs):
    outcome = Outcome()
    return outcome, list(fly(inputs.world, inputs.flight(), outcome))


def from_rows(rows):
    """U of the survey from rows alone: of each lap its length over ground times its advance, shared by time."""
    ground = value = 0.0
    laps, before = [[]], 1
    for row in rows:
        if row.stage == 1 and before == 4:
            laps.append([])
        before = row.stage
        laps[-1].append(row)
    for number, lap in enumerate(laps):
        if len(lap) < 2:
            continue
        # the shift to the next lap is that of the lap's own c1, as in force at its end
        c1 = lap[-1].parameters[0]
        radius = math.sqrt(4900 + c1)
        advance = math.hypot(150 - 2 * radius, (75 - radius) / 5) / math.hypot(10, 1)
        metres = sum(math.dist((a.x_m, a.y_m), (b.x_m, b.y_m)) for a, b in itertools.pairwise(lap))
        seen = [((row.parameters[0] + 1000) / 1000 + (row.parameters[1] - 2) / 8) / 2 for row in lap]
        if number == len(laps) - 1:
            return ground, value, (advance, metres, float(np.mean(seen)))
        ground += advance * metres
        value += advance * metres * float(np.mean(seen))
    return ground, value, (0.0, 0.0, 0.0)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("wind", "capacity_ah"),
    few_rows(
        itertools.product([{"wind.speed_mps": 0.0}, {"wind.speed_mps": 6.0, "wind.gust_std_mps": 1.0}], [0.36, 0.45]), 2
    ),
)
def test_quality_of_a_flight_against_its_rows(wind, capacity_ah):
    outcome, rows = flown(survey_inputs("joint", **wind, **{"battery.capacity_ah": capacity_ah}))
    assert outcome.completed
    assert outcome.parameters.records[0].changes or outcome.parameters.records[1].changes
    ground, value, (advance, metres, seen) = from_rows(rows)
    # of the last lap, which is cut short, what may be of its strip: nothing to all of a lap as long as the others
    found = outcome.parameters.quality({})
    whole = max(metres, 730.0) * advance
    bounds = [value / ground, (value + whole * seen) / (ground + whole)]
    assert min(bounds) - FLOWN <= found <= max(bounds) + FLOWN


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
        leg = predictor.leg(cursor, joined).first
        kept.start_leg(time_s, cursor, leg.length_m)
        kept.hold(time_s, cursor, cursor.parameters)
        seen += 1
        if len(route.order) == 1:
            break
        time_s, joined = time_s + route.first.distance_m / SPEED_MPS, route.first.end_m
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


# --- parts ------------------------------------------------------------------------------------------------------------


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
    plan = read_plan(Text("p", text))[0]
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

"""Evaluations against plain loops, fine integration, stepped batteries and draws."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from common.forecasts import CALM, Forecasting, survey_inputs

from eadp.errors import PathUndefined
from eadp.models.battery import LOSS
from eadp.models.plan.ground import FlownGround, RunTally
from eadp.models.vehicle import FixedWing
from eadp.planning.forecast import evaluate as module
from eadp.planning.forecast.battery_limits import LOSS_SQUARE
from eadp.planning.forecast.evaluate import Objective
from eadp.planning.forecast.knapsack import fill_greedy
from eadp.planning.state.charge import after_drain
from eadp.planning.state.known import MotionKnown, TimeKnown, WindKnown

SAME = 1e-12
ALGEBRA = 1e-9
Z95 = NormalDist().inv_cdf(0.95)
SHARES = (0.0, 0.13, 0.4, 0.62, 0.9, 1.0)
WIND = (4.0, -3.0)
BATTERIES = {
    "constant voltage": {},
    "falling voltage": {"voltage_v": 16.8, "voltage_empty_v": 12.8},
    "letter": {"letter_crate_per_h": 8.0},
    "current": {"max_c_rate": 3.6, "capacity_ah": 1.0},
    "cut-off": {"voltage_v": 16.8, "voltage_empty_v": 12.8, "cutoff_voltage_v": 13.6},
}


def own_parts(evaluation, place):
    """Everything that an evaluation has of a place, as arrays."""
    e, mine = evaluation, evaluation.legs.place == place
    yield from (array[mine] for array in e.load)
    yield from (e.kinds[mine], e.limits.volts[mine], e.limits.room_w[mine], e.limits.truncated[mine])
    for array in (*e.totals, e.limits.beyond_w, e.limits.letter_soc, e.limits.delivered_soc, e.std):
        yield array[place : place + 1]
    yield from (e.knapsack.use[mine], e.knapsack.gain[mine])
    yield from (column[place : place + 1] for column in e.knapsack[3:])


@pytest.mark.quick(3)
@pytest.mark.parametrize("battery", BATTERIES)
def test_many_places_at_once_are_those_one_by_one(battery):
    inputs = survey_inputs()
    forecasting = Forecasting(inputs, wind_mps=WIND, gust_std_mps=1.0, battery=BATTERIES[battery])
    # the effect of an uncertain wind is that of the first route
    forecasting.known = uncertain(forecasting.known)._replace(wind=WindKnown(WIND))
    together, widths = forecasting.at(*SHARES), set()
    for place, share in enumerate(SHARES):
        alone = forecasting.at(share)
        width = min(together.knapsack.use.shape[1], alone.knapsack.use.shape[1])
        widths.add(width)
        for one, other in zip(own_parts(together, place), own_parts(alone, 0), strict=True):
            if one.ndim == 2:  # where fewer envelopes are known there may be fewer columns, the others are empty
                assert not np.any(one[:, width:])
                assert not np.any(other[:, width:])
                one, other = one[:, :width], other[:, :width]
            assert one.shape == other.shape
            assert one == pytest.approx(other, rel=SAME, abs=SAME)
    assert max(widths) > 0


def uncertain(known):
    """The same with covariances of everything."""
    return known._replace(
        wind=WindKnown(known.wind.mps, (0.3, 0.2, -0.1)),
        time=TimeKnown(1.03, 1e-4, 0.01),
        motion=MotionKnown(38.0, 40.0, 0.2, -0.3, 30.0, 60.0, 60.0, 20.0, FixedWing()),
    )


def test_routes_in_a_wind_that_none_can_be_flown_in():
    forecasting = Forecasting(survey_inputs())
    forecasting.known = forecasting.known._replace(wind=WindKnown((20.0, 0.0)))
    with pytest.raises(PathUndefined):
        forecasting.at(*SHARES)


# --- times ------------------------------------------------------------------------------------------------------------


def test_the_first_leg_counts_as_far_as_it_is_left_and_the_ratio_of_times_scales_all():
    forecasting = Forecasting(survey_inputs(), wind_mps=WIND)
    whole = forecasting.at(0.3)
    leg, known = whole.routes[0].legs[0], forecasting.known
    forecasting.known = known._replace(time=known.time._replace(ratio=1.07))
    scaled = forecasting.at(0.3)
    assert scaled.load.times_s == pytest.approx(1.07 * whole.load.times_s)
    # a quarter of the way round the first circle
    (x, y), (ox, oy) = leg.start_m, leg.offset_m
    px, py, _ = leg.track.points((x - ox, y - oy), leg.distance_m, 1.0, 4)[1]
    position, flown_s = (px + ox, py + oy), float(whole.load.times_s[0]) / 4
    forecasting.known = known._replace(time_s=flown_s, position_m=position)
    later = forecasting.evaluator.evaluate(forecasting.known, whole.routes)
    assert later.load.times_s[0] == pytest.approx(0.75 * whole.load.times_s[0], rel=1e-3)
    assert later.load.times_s[1:] == pytest.approx(whole.load.times_s[1:], abs=ALGEBRA)


@pytest.mark.parametrize("at_start", [True, False])
def test_a_leg_that_is_taken_up_again_is_joined_in_a_straight_line(at_start):
    """At its start, as PX4 does, or flown to its end, as ArduPilot does: from 300 m away."""
    forecasting = Forecasting(survey_inputs())
    whole = forecasting.at(0.3)
    leg = whole.routes[0].legs[0]
    aim = leg.start_m if at_start else leg.end_m
    position = aim[0] + 180.0, aim[1] - 240.0
    joined = forecasting.known.joined._replace(rejoins_at_start=at_start)
    forecasting.known = forecasting.known._replace(position_m=position, joined=joined)
    back = forecasting.evaluator.evaluate(forecasting.known, whole.routes)
    flown_m = 300.0 + (leg.distance_m if at_start else 0.0)
    assert back.load.times_s[0] == pytest.approx(flown_m / leg.distance_m * whole.load.times_s[0])
    assert back.load.times_s[1:] == pytest.approx(whole.load.times_s[1:], abs=ALGEBRA)


# --- charge -----------------------------------------------------------------------------------------------------------


def stepped_soc(forecasting, found, powers_w, increments=400):
    """The state of charge at the end of a place's legs, the battery drained in small steps at the voltage it has."""
    battery, known = forecasting.mission.battery, forecasting.known
    soc = known.soc
    for seconds, power_w in zip(found.load.times_s, powers_w, strict=True):
        for _ in range(increments):
            soc -= battery.drain_per_s(power_w, battery.voltage_at(max(soc, 0.0))) * seconds / increments
    return soc


@pytest.mark.parametrize("battery", ["constant voltage", "falling voltage"])
@pytest.mark.parametrize("share", [0.0, 0.5])
def test_charge_against_a_battery_that_is_stepped(battery, share):
    """At the reserve's charge the voltages are those of the flight: planned for maximum power down to the reserve."""
    changes = {"capacity_ah": 0.6, **BATTERIES[battery]}
    forecasting = Forecasting(survey_inputs(**CALM), battery=changes, objective=Objective(0.05, 0.5))
    found = forecasting.at(share)
    filling = found.filled()
    powers_w = found.load.motion_w + found.computing_w(filling.shares)
    soc = stepped_soc(forecasting, found, powers_w)
    within = 1e-4 if battery == "constant voltage" else 0.02
    assert found.known.soc - float(filling.use[0]) == pytest.approx(soc, abs=within)
    forecast = found.forecast(filling)
    assert forecast.energy_wh == pytest.approx(float(powers_w @ found.load.times_s) / 3600, rel=1e-9)
    assert forecast.soc_end == pytest.approx(soc, abs=within)


# --- standard deviations ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_standard_deviations_against_draws(seed):
    """Times, energies and charges with the estimates drawn from their covariances, a flight's noise beside them."""
    rng = np.random.default_rng(seed)
    forecasting = Forecasting(survey_inputs(), wind_mps=WIND)
    known = uncertain(forecasting.known)
    known = known._replace(wind=WindKnown(known.wind.mps), time=known.time._replace(ratio=1.0))
    forecasting.known = known
    found = forecasting.at(0.3)
    filling = fill_greedy(found.knapsack._replace(available=found.knapsack.base_use))
    forecast, draws = found.forecast(filling), 20_000
    seconds, powers_w = float(found.totals.seconds[0]), found.load.motion_w + found.computing_w(filling.shares)
    # T = Σ t β + noise;  E = Σ t (a + b s + g) + noise, with a mean power for a time that is off
    ratio = 1 + math.sqrt(known.time.variance) * rng.standard_normal(draws)
    late_s = seconds * (ratio - 1) + math.sqrt(known.time.noise_s * seconds) * rng.standard_normal(draws)
    assert forecast.remaining_std_s == pytest.approx(late_s.std(), rel=0.03)
    m = known.motion
    matrix = [[m.var_level, m.cov_level_slope], [m.cov_level_slope, m.var_slope]]
    levels = rng.multivariate_normal((0, 0), matrix, draws)
    _, turning_s = found.routes[0].times_s(known.airspeed_mps, known.wind.mps)
    more_j = levels @ (seconds, float(turning_s.sum())) + math.sqrt(m.noise * seconds) * rng.standard_normal(draws)
    energy_j = more_j + float(powers_w @ found.load.times_s) / seconds * late_s
    assert forecast.energy_std_wh == pytest.approx(energy_j.std() / 3600, rel=0.03)
    # charge: the energy at the current's slope, κ and the charge of now, and the gauge's gain
    c = known.charge.filtered
    soc = [c.var_soc, c.cov_soc_ratio, c.cov_soc_slope]
    covariance = np.array([soc, [soc[1], c.var_ratio, c.cov_ratio_slope], [soc[2], c.cov_ratio_slope, c.var_slope]])
    state = rng.multivariate_normal((c.soc, c.use_ratio, c.use_slope), covariance, draws)
    drain = float(filling.use[0]) / float(found.totals.use_ratio[0])
    row = np.array([1.0, -drain, -(drain**2) / 2])
    # κ's random walk, and what a drain adds
    walk = after_drain(c, drain).var_soc - float(row @ covariance @ row)
    assert walk > 0
    gain = known.charge.gain_std * max(known.charge.gain_from - forecast.soc_end, 0.0)
    late_j = more_j + float(found.totals.mean_w[0]) * late_s
    spread = state @ row - float(found.totals.soc_per_j[0]) * late_j
    std = math.sqrt(spread.var() + walk + gain**2)
    assert forecast.soc_end_std == pytest.approx(std, rel=0.05)


@pytest.mark.quick(1)
@pytest.mark.parametrize("share", [0.0, 0.7])
@pytest.mark.parametrize("wind_mps", [(0.0, 0.0), (5.0, 0.0), (0.0, -6.0), (4.0, 4.0)])
def test_an_uncertain_wind_against_draws_of_winds(wind_mps, share):
    """Mean and variance of the time, to second order, at winds drawn from the covariance."""
    forecasting = Forecasting(survey_inputs(), wind_mps=wind_mps)
    covariance = (0.8, 0.5, 0.2)
    route, speed = forecasting.route(share), forecasting.mission.cruise_mps
    forecasting.known = forecasting.known._replace(wind=WindKnown(wind_mps, covariance))
    found = forecasting.at(share)
    prior = module.WIND_PRIOR_MPS**2 * np.eye(2)
    matrix = np.array([[covariance[0], covariance[2]], [covariance[2], covariance[1]]])
    matrix = matrix @ np.linalg.inv(matrix + prior) @ prior
    winds = np.random.default_rng(0).multivariate_normal(wind_mps, matrix, 1500)
    times = np.array([route.times_s(speed, tuple(wind))[0].sum() for wind in winds])
    assert found.totals.seconds[0] == pytest.approx(times.mean(), rel=0.004)
    std = math.sqrt(found.totals.time_var_s2[0] - forecasting.known.time.noise_s * found.totals.seconds[0])
    std = math.sqrt(max(std**2 - found.totals.seconds[0] ** 2 * forecasting.known.time.variance, 0.0))
    assert std == pytest.approx(times.std(), rel=0.12)


def test_losses_are_expected_as_a_poisson_process_takes_them():
    rate = 6.0 / 3600
    objectives = [Objective(0.05, 0.95, each) for each in (0.0, rate)]
    without, losing = (Forecasting(survey_inputs(**CALM), objective=each).at(0.0) for each in objectives)
    filling = fill_greedy(losing.knapsack._replace(available=losing.knapsack.base_use))
    ends = [found.forecast(filling) for found in (without, losing)]
    rng = np.random.default_rng(0)
    counts = rng.poisson(rate * ends[1].remaining_s, 100_000)
    lost = np.array([rng.uniform(0.02, 0.12, count).sum() for count in counts])
    assert ends[0].soc_end - ends[1].soc_end == pytest.approx(lost.mean(), rel=0.02)
    # the gauge's gain at a lower end is a trace more
    assert ends[1].soc_end_std ** 2 - ends[0].soc_end_std ** 2 == pytest.approx(lost.var(), rel=0.04)
    assert losing.evaluator.losses(losing.known, 100.0) == pytest.approx(rate * 100)
    assert LOSS_SQUARE > LOSS**2


def test_a_loss_that_was_seen_raises_the_rate_as_bayes_has_it():
    """Against flights whose rates are drawn from the prior: their mean rate, of those with as many losses so far."""
    rate, seconds = 0.5 / 3600, 60.0
    found = Forecasting(survey_inputs(**CALM), objective=Objective(0.05, 0.95, rate)).at(0.0)
    rng = np.random.default_rng(1)
    rates = rng.exponential(rate, 10_000_000)
    counts = rng.poisson(rates * seconds)
    for seen in (0, 1):
        known = found.known._replace(charge=found.known.charge._replace(losses=seen))
        assert found.evaluator.losses(known, 1.0) == pytest.approx(rates[counts == seen].mean(), rel=0.02)
    later = replace(found, known=found.known._replace(charge=found.known.charge._replace(losses=1)))
    filling = found.filled()
    assert later.forecast(filling).soc_end < found.forecast(filling).soc_end


def test_computations_that_can_fall_keep_the_margin_of_what_is_never_learned():
    """All but the gauge's gain is learned until the last change, 30 s before the end; none where the plan is short."""
    cases = [survey_inputs(**CALM, **{"battery.capacity_ah": ah}) for ah in (0.31, 0.2)]
    long, short = (Forecasting(inputs, objective=Objective(0.05, 0.95)).at(0.1) for inputs in cases)
    gain, seconds = long.known.charge.gain_std * (long.known.charge.gain_from - 0.05), float(long.totals.seconds[0])
    assert seconds > 30
    expected = math.sqrt(gain**2 + (30 / seconds) ** 2 * (float(long.std[0]) ** 2 - gain**2))
    assert long.final_std[0] == pytest.approx(expected)
    assert gain < expected < long.std[0]
    more = long.adaptive.available[0] - long.knapsack.available[0]
    assert more == pytest.approx(Z95 * (float(long.std[0]) - expected))
    assert not short.filled().feasible[0]
    assert short.adaptive.available[0] == short.knapsack.available[0]
    # stated is the probability of the least computations
    filling = long.filled()
    assert 1 - long.final_charge(filling).cdf(0.05) == pytest.approx(0.95, abs=1e-3)
    assert long.forecast(filling).reserve_probability > 0.951


# --- limits of the power ----------------------------------------------------------------------------------------------


def test_the_letters_limit_excludes_configurations_late_in_the_flight():
    """b Q V crate falls with the charge: each leg's largest configuration is below it at the end of the leg."""
    battery = {"capacity_ah": 0.6, "letter_crate_per_h": 8.5}
    forecasting = Forecasting(survey_inputs(**CALM), battery=battery, objective=Objective(0.05, 0.5))
    found, b = forecasting.at(0.2), forecasting.mission.battery
    # drained at maximum power, as the limits are taken
    powers_w = found.load.motion_w + found.load.max_w
    taken = found.load.times_s * [b.drain_per_s(power_w, b.voltage_v) for power_w in powers_w]
    slower = min(1.0, (found.known.soc - 0.05) / taken.sum())
    socs = found.known.soc - np.cumsum(taken) * slower
    allowed = np.maximum(socs, 0) * b.capacity_ah * b.voltage_v * 8.5 - found.load.peak_w
    # 0.999 of the most that a battery without other limits delivers, V²/4R, less the motion's peak
    limited = allowed < 0.999 * b.voltage_v**2 / (4 * b.resistance_ohm) - found.load.peak_w
    assert found.limits.by_letter.tolist() == limited.tolist()
    assert found.limits.room_w[limited] == pytest.approx(allowed[limited], abs=1e-6)
    for leg in np.flatnonzero(found.limits.truncated).tolist():
        powers_w = forecasting.evaluator.envelopes[int(found.kinds[leg])].powers_w
        assert powers_w[-1] <= max(found.limits.room_w[leg], powers_w[0])
    assert found.limits.truncated.any()


@pytest.mark.parametrize("limit", ["current", "cut-off"])
def test_a_configuration_that_is_planned_can_be_delivered(limit):
    """Where the pack's current, or its cut-off voltage, binds: V I at the terminals with I = (V − U)/R."""
    battery = {"current": {"max_c_rate": 3.4, "capacity_ah": 1.0}, "cut-off": {"cutoff_voltage_v": 14.5}}[limit]
    if limit == "cut-off":
        battery |= {"resistance_ohm": 0.0875, "capacity_ah": 1.0}
    forecasting = Forecasting(survey_inputs(**CALM), battery=battery, objective=Objective(0.05, 0.5))
    found, b = forecasting.at(0.3), forecasting.mission.battery
    current_a = 3.4 if limit == "current" else (b.voltage_v - 14.5) / b.resistance_ohm
    most_w = current_a * (b.voltage_v - b.resistance_ohm * current_a)
    assert found.limits.room_w == pytest.approx(0.999 * most_w - found.load.peak_w, rel=1e-6)
    assert found.limits.truncated.any()
    for leg in np.flatnonzero(found.limits.truncated).tolist():
        own = forecasting.evaluator.envelopes[int(found.kinds[leg])].powers_w[-1]
        assert own <= found.limits.room_w[leg]


def test_minimum_power_beyond_the_battery_is_a_finite_shortfall_and_the_shortest_route_wins():
    forecasting = Forecasting(survey_inputs(**CALM))
    known = forecasting.known
    forecasting.known = known._replace(motion=known.motion._replace(max_w=6000.0))
    found = forecasting.at(0.0, 0.3, 0.6, 1.0)
    shorts = np.maximum(-found.knapsack.spare, 0.0).tolist()
    assert all(0 < short < np.inf for short in shorts)
    assert shorts[0] < shorts[-1], "fewer laps are flown at the lowest path parameter"
    assert (found.limits.beyond_w > 0).all()
    assert not found.filled().feasible.any()


def test_the_charge_that_minimum_power_requires_at_the_end_is_kept():
    """A cut-off voltage under load is an empty battery: the final charge at which the last leg's power is delivered."""
    battery = {"voltage_v": 16.8, "voltage_empty_v": 12.8, "cutoff_voltage_v": 14.0, "resistance_ohm": 0.05}
    forecasting = Forecasting(survey_inputs(**CALM), battery=battery, objective=Objective(0.05, 0.5))
    found = forecasting.at(0.3)
    required = []
    for leg, power_w in enumerate(found.load.peak_w + found.load.min_w):
        volts = 14.0 + 0.05 * power_w / 14.0
        later = found.knapsack.base_use[0] - leg_use(forecasting, found, leg)
        required.append((volts - 12.8) / 4.0 - later)
    assert found.limits.delivered_soc[0] == pytest.approx(max(required), abs=1e-6)
    assert found.knapsack.available[0] == pytest.approx(found.known.soc - max(required), abs=1e-6)


def leg_use(forecasting, found, last):
    """Charge used at minimum power up to the end of a leg."""
    b, powers_w = forecasting.mission.battery, found.load.motion_w + found.load.min_w
    drains = [b.drain_per_s(powers_w[i], found.limits.volts[i]) for i in range(last + 1)]
    return float(found.load.times_s[: last + 1] @ drains) * float(found.totals.use_ratio[0])


# --- value ------------------------------------------------------------------------------------------------------------


def quality_of(forecasting, found, place, shares_of_c2, flown):
    """U with these shares of c2's set on each leg, from the definition: ground of laps by lengths and advances."""
    route, plan = found.routes[place], forecasting.mission.plan
    times = found.load.times_s[found.legs.place == place]
    weights = [forecasting.settings.weights.get(name, 1.0) for name in plan.names]
    ground = value = 0.0
    for run, scale in enumerate(route.scales.tolist()):
        own = [i for i, number in enumerate(route.runs.tolist()) if number == run]
        length = sum(route.legs[i].distance_m for i in own)
        length += route.beyond_m if run == len(route.scales) - 1 else 0.0
        length += flown.run.flown_m if run == 0 else 0.0
        seconds = sum(times[i] for i in own) + (flown.run.flown_s if run == 0 else 0.0)
        if seconds == 0:  # the plan ends where its last lap starts
            continue
        if run == 0:
            ground += scale * length * flown.run.free_s / seconds
            value += scale * length * flown.run.area_s / seconds
        for i in own:
            box, c1 = plan.hull(0), route.parameters[i][0]
            path = (c1 - box.lo) / (box.hi - box.lo)
            seen = (weights[0] * path + weights[1] * shares_of_c2[i]) / sum(weights)
            ground += scale * length * times[i] / seconds
            value += scale * length * times[i] / seconds * seen
    return (flown.value + value) / (flown.ground + ground)


@pytest.mark.parametrize("weights", [{}, {"c1": 3.0}, {"c1": 0.0, "c2": 2.0}])
def test_the_gain_of_an_increment_is_the_difference_of_u(weights):
    forecasting = Forecasting(survey_inputs(), wind_mps=WIND, weights=weights)
    flown = FlownGround(400.0, 250.0, RunTally(120.0, 9.0, 9.0, 4.0))
    forecasting.known = forecasting.known._replace(flown=flown)
    found = forecasting.at(0.2, 0.8)
    for place in range(2):
        mine = np.flatnonzero(found.legs.place == place)
        none = np.zeros(len(mine))
        base = quality_of(forecasting, found, place, none, flown)
        assert found.knapsack.base_value[place] == pytest.approx(base, abs=ALGEBRA)
        for leg in (0, 1, 2, 3, len(mine) // 2, len(mine) - 1):
            values = forecasting.evaluator.envelopes[int(found.kinds[mine[leg]])].values
            top = none.copy()
            top[leg] = 1.0
            gained = quality_of(forecasting, found, place, top, flown) - base
            assert found.knapsack.gain[mine[leg]].sum() == pytest.approx(gained, abs=ALGEBRA)
            total = weights.get("c1", 1.0) + weights.get("c2", 1.0)
            assert values[-1] == pytest.approx(weights.get("c2", 1.0) / total)
        highest = found.knapsack.base_value[place] + found.knapsack.gain[mine].sum()
        assert highest == pytest.approx(quality_of(forecasting, found, place, none + 1, flown), abs=ALGEBRA)

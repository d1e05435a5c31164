"""Evaluates what is left of a mission at several path parameters at once: time, charge, and quality by ground.

A pure function of what is known of the flight and of routes. Legs of all routes stand one after the other in flat
arrays, so that each formula stands once and runs once, whatever the number of places.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.flight import current_slope_a_per_w, drain_per_s
from eadp.errors import PathUndefined
from eadp.models.airspace import WayHome
from eadp.models.autopilot import Autopilot
from eadp.models.battery import LOSS
from eadp.models.performance import calibrated_over_true
from eadp.models.plan.route import Route, RouteArrays, leg_times_s
from eadp.models.plan.stage import Leg, Stage, left_m
from eadp.models.world import Mission
from eadp.planning.base import Ending, PlannerSettings, TradeOff
from eadp.planning.forecast.battery_limits import LOSS_SQUARE, MIN_STD, PowerLimits, RouteLoad, power_limits
from eadp.planning.forecast.clearance import Homeward, after_leg, homeward, with_climbs
from eadp.planning.forecast.envelopes import Envelopes
from eadp.planning.forecast.knapsack import Filling, Knapsack, fill_greedy
from eadp.planning.forecast.speed_to_fly import SpeedChoice, airspeeds_of
from eadp.planning.state.charge import charge_at_end
from eadp.planning.state.known import Known, WindKnown, terms_of
from eadp.planning.state.level_regression import WINDOW_S

WIND_PRIOR_MPS = 4.0
"""Standard deviation of each component of the wind before anything is known of it: a mean speed of 5 m/s [m/s]."""

MAX_WIND = 0.8
"""Greatest wind for which the variance of times is taken, as a share of the airspeed."""

OVERSHOOT_SHARE = 0.35
"""Standard deviation of the time that overshot turns add, as a share of it: 1.48 times the median miss in gusts
(benchmarks/real.py)."""

ROUNDING = 1e-9
"""Charge that counts as rounding."""

LAST_CHANGE_S = 30.0
"""Before the end, an interval of re-planning [s]: the path is not searched in it, and the margin of computations is
that of today."""


@dataclass(frozen=True)
class Objective:
    """What a forecast keeps, and counts.

    Attributes
    ----------
    reserve_soc : float
        State of charge to keep at the end.
    probability : float
        With which it is kept.
    losses_per_s : float
        Sudden losses of charge to expect [1/s].
    trade_offs : tuple of TradeOff
        Rows that the computations keep to.
    """

    reserve_soc: float
    probability: float = 0.95
    losses_per_s: float = 0.0
    trade_offs: tuple[TradeOff, ...] = ()


class Totals(NamedTuple):
    """Of each route: what is summed over its legs, each of shape (routes,).

    Attributes
    ----------
    seconds, time_var_s2 : array
        Time to the end, and its variance.
    energy_var_j2 : array
        Variance of the motion's energy.
    use_ratio, charge_var : array
        Ratio of charge used to charge predicted, and the variance of the final state of charge due to it.
    mean_w, soc_per_j : array
        Mean power with the computations half way between their extremes [W], and the derivative of the final state
        of charge by energy there [1/J].
    """

    seconds: FloatArray
    time_var_s2: FloatArray
    energy_var_j2: FloatArray
    use_ratio: FloatArray
    charge_var: FloatArray
    mean_w: FloatArray
    soc_per_j: FloatArray


class AutopilotsOwn(NamedTuple):
    """What an autopilot does on its own, of each route, shape (routes,); all 0 where none is known.

    Attributes
    ----------
    seconds, joules : array
        Time [s] and energy [J] of its return from a route's end: a climb, the way home, and a circle there.
    turns_back_soc : array
        Final state of charge with less of which it turns back on the route.
    """

    seconds: FloatArray
    joules: FloatArray
    turns_back_soc: FloatArray


@dataclass(frozen=True)
class Evaluation:
    """Routes evaluated: their forecast, and the knapsack of computations that each allows.

    Places are numbered as the routes that can be flown. `legs` are those of all places, in a row.

    Attributes
    ----------
    evaluator : Evaluator
    known : Known
        What is known where the routes start.
    routes : list of Route
        Those that can be flown in this wind.
    index : array of int, shape (places,)
        Their numbers among those that were given.
    legs : RouteArrays
    load : RouteLoad
    kinds : array of int, shape (legs,)
        Envelope of each leg.
    limits : PowerLimits
    totals : Totals
    std : array, shape (places,)
        Standard deviation of the final state of charge with the reserve just kept.
    knapsack : Knapsack
        The computations of each place, within the charge that keeps the reserve with its probability.
    own : AutopilotsOwn
        What the autopilot does on its own.
    airspeeds_mps : array, shape (places, stages), or None
        Commanded on each stage that has none of its own [m/s]; None for that of cruise.
    thriftiest : Evaluation or None
        Of one place alone: the same at the pace that leaves the most charge; None where the airspeed is not decided.
    """

    evaluator: Evaluator
    known: Known
    routes: list[Route]
    index: IntArray
    legs: RouteArrays
    load: RouteLoad
    kinds: IntArray
    limits: PowerLimits
    totals: Totals
    std: FloatArray
    knapsack: Knapsack
    own: AutopilotsOwn
    airspeeds_mps: FloatArray | None = None
    thriftiest: Evaluation | None = None

    @property
    def final_std(self) -> FloatArray:
        """Of `std`, what will not be known when the computations change last, shape (places,).

        σ₊² = g² + (τ/T)² (σ² − g²): of the deviation at the last change, τ before the end, the part g of the gauge's
        gain stays, and the rest falls with the time T that is left.
        """
        gain = self.evaluator.gain_std(self.known, max(self.evaluator.objective.reserve_soc, 0.0))
        still = np.minimum(LAST_CHANGE_S / self.totals.seconds, 1.0)
        std: FloatArray = np.hypot(gain, still * np.sqrt(np.maximum(self.std**2 - gain**2, 0.0)))
        return std

    @property
    def adaptive(self) -> Knapsack:
        """The knapsack with a smaller margin, for computations and an airspeed that can still fall later in the flight.

        The margin covers only what will not be known yet when they change last, `final_std`. Where minimum power from
        now on, at the pace that leaves the most charge, does not keep the reserve with its probability, the knapsack
        as it is.
        """
        spare = (self.thriftiest or self).knapsack.spare
        return self.knapsack._replace(available=np.where(spare >= 0, self.later.available, self.knapsack.available))

    @property
    def later(self) -> Knapsack:
        """The knapsack with the smaller margin at every place: z (σ − σ₊) less is kept."""
        learned = self.evaluator.quantile * (self.std - self.final_std)
        return self.knapsack._replace(available=self.knapsack.available + learned)

    @property
    def with_loss(self) -> Knapsack:
        """The knapsack that leaves the charge of a first sudden loss, too.

        At places where one is to be expected with more than the probability that the reserve may be missed.
        """
        risk = 1.0 - np.exp(-self.evaluator.losses(self.known, self.totals.seconds))
        expected = (risk > 1.0 - self.evaluator.objective.probability) & (self.known.charge.losses == 0)
        return self.knapsack._replace(available=self.knapsack.available - LOSS * expected)

    def left_over(self, filling: Filling) -> float:
        """State of charge available in `adaptive` beyond the use of a filling; for an evaluation of one place."""
        return float(self.adaptive.available[0] - filling.use[0])

    def filled(self) -> Filling:
        """The optimal computations at each place, in closed form."""
        return fill_greedy(self.knapsack)

    @property
    def shortfall(self) -> float:
        """State of charge missing for minimum power, of one place; 0 where it suffices."""
        return max(0.0, -float((self.thriftiest or self).knapsack.spare[0]))

    def computing_w(self, shares: FloatArray) -> FloatArray:
        """Mean power of the computations on each leg with shares of the increments [W], shape (legs,)."""
        # minimum power, and the share taken of each increment, from one vertex of the envelope to the next
        powers_w = self.evaluator.envelopes.table.powers_w[self.kinds]
        mean_w: FloatArray = powers_w[:, 0] + (np.diff(powers_w, axis=1) * shares).sum(axis=1)
        return mean_w

    def final_charge(self, filling: Filling) -> NormalDist:
        """State of charge at the end with computations as filled: after the autopilot's return from it."""
        expected_loss = float(self.evaluator.losses(self.known, self.totals.seconds[0])) * LOSS
        returning = float(self.totals.soc_per_j[0] * self.own.joules[0])
        mean = self.known.soc - float(filling.use[0]) - expected_loss - returning
        std = float(self.evaluator.charge_std(self.known, self.totals, mean)[0])
        return NormalDist(mean, max(std, MIN_STD))

    def forecast(self, filling: Filling) -> Ending:
        """Forecast with computations as filled.

        Probabilities are those with minimum power from now on, at the pace that leaves the most charge.
        """
        totals, charge = self.totals, self.final_charge(filling)
        # the energy varies with the motion's power, and with the time
        energy_j = float((self.load.motion_w + self.computing_w(filling.shares)) @ self.load.times_s)
        seconds, time_var = float(totals.seconds[0]), float(totals.time_var_s2[0])
        energy_var = float(totals.energy_var_j2[0]) + (energy_j / seconds) ** 2 * time_var
        least = self.thriftiest or self
        safest = least.final_charge(least.knapsack.filling(np.zeros_like(least.knapsack.use)))
        # the cut-off voltage is reached, or the autopilot turns back
        empty_soc = max(float(self.limits.delivered_soc[0]), 0.0, float(self.own.turns_back_soc[0]))
        return Ending(
            remaining_s=seconds + float(self.own.seconds[0]),
            remaining_std_s=math.sqrt(time_var),
            energy_wh=(energy_j + float(self.own.joules[0])) / 3600,
            energy_std_wh=math.sqrt(energy_var) / 3600,
            soc_end=charge.mean,
            soc_end_std=charge.stdev,
            completes_probability=1 - safest.cdf(empty_soc),
            reserve_probability=1 - safest.cdf(max(self.evaluator.objective.reserve_soc, empty_soc)),
        )

    @property
    def reserve_soc(self) -> float:
        """State of charge to keep at the end: the reserve, or that below which the autopilot turns back."""
        return max(self.evaluator.objective.reserve_soc, float(self.own.turns_back_soc[0]))


class _Rest(NamedTuple):
    """Routes that can be flown from a moment of a flight: what is known then, the routes, and their legs in a row.

    `groups` are those of the legs' configurations, shape (legs,).
    """

    known: Known
    routes: Sequence[Route]
    legs: RouteArrays
    groups: IntArray


class _LegTimes(NamedTuple):
    """Times of whole legs.

    Attributes
    ----------
    flown_mps : array, shape (legs,)
        Airspeeds [m/s].
    in_winds_s : array, shape (winds, legs)
        In the estimated wind, the first row, and in winds around it [s].
    turning_s : array, shape (legs,)
        Time integral of tan² of the bank, in the estimated wind [s].
    excess_s : array, shape (legs,)
        What of the time is flown beside the path [s].
    """

    flown_mps: FloatArray
    in_winds_s: FloatArray
    turning_s: FloatArray
    excess_s: FloatArray


class Evaluator:
    """Evaluates routes of one mission.

    Parameters
    ----------
    mission : Mission
    settings : PlannerSettings
        Weights, levels and reserve are used here.
    objective : Objective

    Attributes
    ----------
    envelopes : Envelopes
        Of the computations.
    path_weight : float
        Greatest weight of the path parameters on any stage.
    quantile : float
        Of the standard normal distribution, at the probability to keep.
    """

    def __init__(self, mission: Mission, settings: PlannerSettings, objective: Objective) -> None:
        self.mission, self.objective = mission, objective
        self.envelopes = Envelopes(mission, settings, objective.trade_offs)
        self.quantile = NormalDist().inv_cdf(objective.probability)
        stages = range(1, len(mission.plan.stages) + 1)
        # weights of the parameters in U on each stage: of the path's, and the sum of all, 0 where none has a choice
        of_stages = [self.envelopes.shares.scaled(stage) for stage in stages]
        rho = mission.plan.path_count
        self._path_weights = np.array([weights[:rho] for weights in of_stages]).reshape(len(of_stages), rho)
        self._counted = np.array([weights.sum() for weights in of_stages])
        self._excess_s = np.array([mission.excess.get(stage, (0.0, 0.0)) for stage in stages])
        self._way_home: tuple[Autopilot | None, WayHome | None] = (None, None)
        self.path_weight = float(self._path_weights.sum(axis=1).max(initial=0.0))

    def losses(self, known: Known, seconds: float | FloatArray) -> FloatArray:
        """Mean number of sudden losses of charge in a time [s]: a loss that was seen is evidence of their rate.

        With an exponential prior of mean λ, in a flight that is short beside 1/λ, the rate is λ (1 + losses seen).
        """
        expected: FloatArray = self.objective.losses_per_s * (1 + known.charge.losses) * np.asarray(seconds)
        return expected

    def charge_std(self, known: Known, totals: Totals, soc: float | FloatArray) -> FloatArray:
        """Standard deviation of the final state of charge, where its mean is `soc`, shape (routes,)."""
        # the energy varies with the motion's power, and with the time
        energy_var = totals.energy_var_j2 + totals.mean_w**2 * totals.time_var_s2
        gain = self.gain_std(known, soc)
        loss_var = self.losses(known, totals.seconds) * LOSS_SQUARE  # of a compound Poisson process: λ t E x²
        charge_var = totals.charge_var + known.charge.lost_std**2
        std: FloatArray = np.sqrt(totals.soc_per_j**2 * energy_var + charge_var + gain**2 + loss_var)
        return std

    def gain_std(self, known: Known, soc: float | FloatArray) -> FloatArray:
        """Standard deviation of a final state of charge due to the gauge's gain, which no reading in flight shows."""
        std: FloatArray = known.charge.gain_std * np.maximum(known.charge.gain_from - soc, 0.0)
        return std

    def homeward(self, known: Known, computing_w: float) -> Homeward | None:
        """The way home from a moment, with a power of the computations [W], see `homeward`; None without a home."""
        way = self.way_home(known)
        return None if way is None else homeward(known, way, self.mission.vehicle.cruise_altitude_m, computing_w)

    def way_home(self, known: Known) -> WayHome | None:
        """The way home as it is flown by the autopilot that is known; None without a home."""
        way_home = self.mission.way_home
        if way_home is not None and self._way_home[0] is not known.autopilot:
            self._way_home = known.autopilot, way_home.flown_by(known.autopilot)
        return self._way_home[1]

    def speed_choice(self, known: Known, routes: Sequence[Route]) -> SpeedChoice:
        """The choice of airspeeds on routes, with the computations half way between their extremes."""
        plan, vehicle = self.mission.plan, self.mission.vehicle
        assert vehicle.takes_commands
        legs = RouteArrays.of(routes)
        groups = self.envelopes.groups(routes[0].table, legs.order)
        computing_w = self.envelopes.extremes_w()[groups].mean(axis=1)
        speeds_mps = airspeeds_of(vehicle, known, legs.rows, calibrated_over_true(plan.site, vehicle))
        return SpeedChoice.of(known, legs, computing_w, speeds_mps, len(plan.stages))

    def evaluate(self, known: Known, routes: Sequence[Route], airspeeds_mps: FloatArray | None = None) -> Evaluation:
        """Evaluate routes from a moment of a flight: times and powers of their legs, then charge and computations.

        Parameters
        ----------
        known : Known
        routes : sequence of Route
            From the start of the stage being flown, with a common table.
        airspeeds_mps : array, shape (routes, stages), optional
            Commanded on each stage that has none of its own [m/s]; by default those in force.

        Raises
        ------
        PathUndefined
            If none of them can be flown in this wind.
        """
        legs = RouteArrays.of(routes)
        if airspeeds_mps is None and known.cursor.airspeeds_mps:
            airspeeds_mps = np.tile(known.cursor.airspeeds_mps, (len(routes), 1))
        times = self._leg_times(known, legs, airspeeds_mps)
        flyable = np.isfinite(legs.sums(times.in_winds_s[0]))
        if not flyable.all():  # routes that cannot be flown are left out
            index = np.flatnonzero(flyable)
            if not len(index):
                raise PathUndefined("the rest of the plan cannot be flown in this wind")
            others_mps = None if airspeeds_mps is None else airspeeds_mps[index]
            others = self.evaluate(known, [routes[i] for i in index.tolist()], others_mps)
            return replace(others, index=index[others.index])
        rest = _Rest(known, routes, legs, self.envelopes.groups(routes[0].table, legs.order))
        found = self._evaluation(rest, *self._load(rest, times))
        return replace(found, airspeeds_mps=airspeeds_mps)

    def _leg_times(self, known: Known, legs: RouteArrays, airspeeds_mps: FloatArray | None) -> _LegTimes:
        """Times of whole legs, at the airspeeds of their stages, else those of each route's stages, if any."""
        others_mps: float | FloatArray = known.airspeed_mps
        if airspeeds_mps is not None:
            others_mps = airspeeds_mps[legs.place, legs.stages - 1]
        own_mps = legs.rows.airspeeds_mps[legs.order]
        flown_mps = np.where(np.isnan(own_mps), others_mps, own_mps)
        winds_mps = _sigma_points(known.wind, known.airspeed_mps)
        on_path_s, turning_s = leg_times_s(legs.rows, legs.order, others_mps, winds_mps)
        # a leg that the aircraft cannot follow takes longer than its path: in each wind and at each airspeed as before
        # take-off
        excess_s, excess_turning_s = self._excess_s[legs.stages - 1].T
        return _LegTimes(flown_mps, on_path_s + excess_s, np.maximum(turning_s[0] + excess_turning_s, 0.0), excess_s)

    def _load(self, rest: _Rest, times: _LegTimes) -> tuple[RouteLoad, Totals]:
        """Mean times and powers of the legs, and their totals without `soc_per_j`; see `evaluate`."""
        known, _, legs, groups = rest
        # mean times over the wind's distribution; of the first leg of each route only a part is left
        factor, wind_var = _wind_effect(legs.sums(times.in_winds_s.T))
        shortest_s = np.maximum(legs.sums(times.in_winds_s[0]), 1e-3)
        wind_var += OVERSHOOT_SHARE**2 * legs.sums(times.excess_s**2) / shortest_s**2
        whole_s, turning_s = times.in_winds_s[0] * factor[legs.place], times.turning_s * factor[legs.place]
        part = np.ones(len(whole_s))
        part[legs.first] = self._left(rest, whole_s)
        left_s = whole_s * part * known.time.ratio
        # y = level · a + (flat + turn · tan²φ) b, between 0 and the motor's maximum
        slopes = turning_s / np.where(whole_s > 0.0, whole_s, 1.0)
        motion, (level, flat, turn, own_w) = known.motion, terms_of(known.motion.airframe, times.flown_mps)
        motion_w = level * motion.level_w + motion.slope_w * (flat + turn * slopes) + own_w
        motion_w = np.minimum(np.maximum(motion_w, 0.0), np.maximum(motion.level_w, self.mission.vehicle.max_motion_w))
        level_s = np.maximum(legs.sums(left_s * level), 1e-3)
        bank_s = legs.sums(turning_s * turn * part) * known.time.ratio + legs.sums(left_s * flat)
        peak_w = motion_w
        if known.climb is not None:
            on_path_s = (times.in_winds_s[0] - times.excess_s) * factor[legs.place]
            left_s, motion_w, peak_w = self._climbed(rest, times.flown_mps, on_path_s, left_s, motion_w)
        # the peak is above the mean of a window by twice its standard deviation
        peak_w = np.maximum(peak_w, known.motion.max_w) + 2 * math.sqrt(known.motion.noise / WINDOW_S)
        extremes_w = self.envelopes.extremes_w()[groups]
        load = RouteLoad(left_s, motion_w, peak_w, extremes_w[:, 0], extremes_w[:, 1])
        return load, self._totals(rest, load, (level_s, bank_s), wind_var)

    def _evaluation(self, rest: _Rest, load: RouteLoad, totals: Totals) -> Evaluation:
        """Charge and computations of routes, by the times and powers of their legs: the second half of `evaluate`."""
        known, routes, legs, groups = rest
        # the voltage on each leg, and the configurations that the battery's limits of power leave
        battery, reserve_soc = self.mission.battery, self.objective.reserve_soc
        limits = power_limits(legs, load, battery, known.soc, reserve_soc, totals.use_ratio)
        kinds = self.envelopes.kinds(groups, limits.room_w, limits.truncated)
        # db/dE = k κ dI/dP, at the mean voltage of a route
        mean_v = legs.sums(limits.volts) / (legs.last - legs.first + 1)
        slope = current_slope_a_per_w(totals.mean_w, mean_v, battery.resistance_ohm)
        totals = totals._replace(soc_per_j=battery.drain_per_as * totals.use_ratio * slope)
        # the charge at the end, and what it leaves for the computations
        own = self._own(rest, load, totals)
        std = self.charge_std(known, totals, max(reserve_soc, 0.0))
        use, values = self._vertex_use(legs, load, kinds, limits, totals), self.envelopes.table.values[kinds]
        base_use = legs.sums(use[:, 0])
        weight, base = self._weights(known, legs, load)
        available = self._available(known, limits, totals, std, own)
        # power that cannot be delivered counts as missing charge, so that the least excess ranks first: at most what
        # minimum power uses is available, less the excess
        excess = limits.beyond_w * totals.seconds * totals.soc_per_j
        available = np.where(limits.beyond_w > 0, np.minimum(available, base_use) - excess, available)
        knapsack = Knapsack(
            use=np.diff(use, axis=1),
            gain=np.diff(values, axis=1) * weight[:, None],
            place=legs.place,
            base_use=base_use,
            base_value=base + legs.sums(weight * values[:, 0]),
            available=available,
        )
        index = np.arange(len(routes))
        return Evaluation(self, known, list(routes), index, legs, load, kinds, limits, totals, std, knapsack, own)

    def _left(self, rest: _Rest, whole_s: FloatArray) -> FloatArray:
        """Share of the first leg of each route that is left, shape (routes,); `whole_s` are the times of whole legs."""
        known, routes, legs, _ = rest
        # routes with the same first leg have one share
        _, different, of = np.unique(legs.order[legs.first], return_index=True, return_inverse=True)
        legs_s = (whole_s[legs.first] * known.time.ratio).tolist()
        left = np.array([self._left_of(known, routes[i].legs[0], legs_s[i]) for i in different.tolist()])
        return left[of]

    def _left_of(self, known: Known, leg: Leg, leg_s: float) -> float:
        """Share of a leg being flown that is left, by the position; `leg_s` is the time of the whole leg [s].

        The time since its start distinguishes the turns of a circle, and stands in where the path has no value.
        """
        flown = min(1.0, (known.time_s - known.joined.time_s) / max(leg_s, 1e-9))
        if leg.distance_m <= 0:
            return 0.0
        if known.joined.rejoins_at_start:  # straight to its start
            return 1.0 + math.dist(known.position_m, leg.start_m) / leg.distance_m
        if known.joined.rejoins_at_start is False:
            return math.dist(known.position_m, leg.end_m) / leg.distance_m
        try:
            # the leg may be joined before its start, by up to the radius of the trigger of the stage before
            early_m = self.mission.plan.max_radius_m if known.joined.stages_started > 1 else 0.0
            return left_m(leg, known.position_m, flown * leg.distance_m, early_m) / leg.distance_m
        except PathUndefined:
            return 1.0 - flown

    def _climbed(
        self, rest: _Rest, airspeeds_mps: FloatArray, whole_s: FloatArray, times_s: FloatArray, motion_w: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times [s], mean and greatest motion powers [W] of all legs with climbs, shape (legs,); see `with_climbs`.

        `whole_s` are the times of whole legs, `times_s` those left, and `motion_w` the powers, all in level flight.
        """
        known, of_routes = rest.known, []
        for route, first, last in zip(rest.routes, rest.legs.first.tolist(), rest.legs.last.tolist(), strict=True):
            mine = slice(first, last + 1)
            whole = whole_s[mine] * known.time.ratio
            of_routes.append(with_climbs(known, route, airspeeds_mps[mine], whole, times_s[mine], motion_w[mine]))
        times, motion, peak = (np.concatenate(arrays) for arrays in zip(*of_routes, strict=True))
        return times, motion, np.maximum(peak, motion)

    def _totals(
        self, rest: _Rest, load: RouteLoad, by_power_s: tuple[FloatArray, FloatArray], wind_var: FloatArray
    ) -> Totals:
        """Sums over each route; `soc_per_j` is NaN until the voltage on the legs is known, see `_evaluation`.

        `by_power_s` are the derivatives of each route's energy by a and b, at the airframe's own airspeed its time and
        the time integral of tan² φ [s]; `wind_var` is the variance of the time's logarithm due to the wind.
        """
        known, legs = rest.known, rest.legs
        seconds = np.maximum(legs.sums(load.times_s), 1e-3)
        mean_w = legs.sums((load.motion_w + (load.min_w + load.max_w) / 2) * load.times_s) / seconds
        # charge used to charge predicted: by the filter's state after the drain of the mean power
        drain = self.mission.battery.drain_at_per_s(mean_w, known.soc) * seconds
        soc, charge_var = charge_at_end(known.charge.filtered, drain)
        return Totals(
            seconds=seconds,
            time_var_s2=known.time.var_s2(seconds, wind_var),
            energy_var_j2=known.motion.energy_var_j2(seconds, *by_power_s),
            use_ratio=(known.soc - soc) / np.maximum(drain, 1e-12),
            charge_var=charge_var,
            mean_w=mean_w,
            soc_per_j=np.full_like(seconds, math.nan),
        )

    def _own(self, rest: _Rest, load: RouteLoad, totals: Totals) -> AutopilotsOwn:
        """What the autopilot that is known does on its own."""
        known, routes, legs, _ = rest
        autopilot, way = known.autopilot, self.way_home(known)
        own = AutopilotsOwn(*np.zeros((3, len(routes))))
        if autopilot.kind is None:
            return own
        own = own._replace(turns_back_soc=autopilot.low_soc(self.mission.battery, totals.mean_w))
        rule, cruise_m = autopilot.time_rule, self.mission.vehicle.cruise_altitude_m
        if way is None or (rule is None and not way.circle_radius_m):
            return own
        for place, route in enumerate(routes):
            mine, stages = legs.place == place, route.of_legs
            until = next((i for i, stage in enumerate(stages) if self._is_landing(stage)), len(stages))
            ends = [after_leg(known, leg) for leg in route.legs[:until]]
            if way.circle_radius_m and until == len(stages):
                back = homeward(ends[-1], way, cruise_m, float(load.min_w[mine][-1]))
                own.seconds[place], own.joules[place] = back.seconds, back.seconds * back.power_w
            if rule is None or not ends:
                continue
            # b ≥ (f tₕ + m) ḃ wherever the autopilot may turn back; at the end, after what is left, it is less
            left_s = load.times_s[mine].sum() - np.cumsum(load.times_s[mine])[:until]
            ways = np.array([homeward(end, way, cruise_m, 0.0) for end in ends])
            needed_s = float((rule.needed_s(ways[:, 0], ways[:, 2]) - left_s).max())
            lasting_soc = needed_s * float(totals.mean_w[place]) - own.joules[place]
            own.turns_back_soc[place] = max(own.turns_back_soc[place], lasting_soc * float(totals.soc_per_j[place]))
        return own

    def gives_up(self, known: Known, stage: Stage, mean_w: float) -> bool:
        """Whether the autopilot gives the mission up by itself in a stage, at a mean power [W]."""
        autopilot, battery = known.autopilot, self.mission.battery
        if autopilot.kind is None or self._is_landing(stage):
            return False
        if known.soc < autopilot.low_soc(battery, np.array([mean_w]))[0]:
            return True
        rule, way = autopilot.time_rule, self.homeward(known, 0.0)
        if rule is None or way is None:
            return False
        needed_s = float(rule.needed_s(way.seconds, way.climb_m))
        return known.soc < float(battery.drain_at_per_s(mean_w, known.soc)) * needed_s

    def _is_landing(self, stage: Stage) -> bool:
        """Whether a stage is of the landing that the plan ends with."""
        landing = self.mission.way_home and self.mission.way_home.landing
        return landing is not None and stage.index >= landing.legs[0].stage.index

    def _vertex_use(
        self, legs: RouteArrays, load: RouteLoad, kinds: IntArray, limits: PowerLimits, totals: Totals
    ) -> FloatArray:
        """State of charge that each leg uses at each vertex of its envelope, shape (legs, vertices)."""
        battery, powers_w = self.mission.battery, self.envelopes.table.powers_w[kinds]
        per_as = (battery.drain_per_as * totals.use_ratio)[legs.place]
        currents_a = drain_per_s(load.motion_w[:, None] + powers_w, limits.volts[:, None], battery.resistance_ohm, 1.0)
        use: FloatArray = currents_a * (load.times_s * per_as)[:, None]
        return use

    def _weights(self, known: Known, legs: RouteArrays, load: RouteLoad) -> tuple[FloatArray, FloatArray]:
        """What a value of 1 on each leg adds to the objective, shape (legs,); and the sure part of it, shape (routes,).

        The sure part is what was flown so far, and what the path parameters add on the legs left.

        Source: `eadp.models.plan.ground` for U.
        """
        ground_m, per_s = legs.ground(known.flown, load.times_s)
        stage, run = legs.stages - 1, known.flown.run
        # ground of the whole mission: flown, being flown, and left
        whole_m = known.flown.ground + per_s * run.free_s + legs.sums(ground_m * (self._counted[stage] > 0))
        whole_m = np.where(whole_m > 0, whole_m, math.inf)
        # Σ ω c̃ of the path parameters on each leg; and the ground, seen so far or by the path to come, times its value
        rho = self._path_weights.shape[1]
        path = (self._path_weights[stage] * legs.rows.shares[legs.order, :rho]).sum(axis=1)
        seen_m = known.flown.value + per_s * run.area_s + legs.sums(ground_m * path)
        return ground_m / whole_m[legs.place], seen_m / whole_m

    def _available(
        self, known: Known, limits: PowerLimits, totals: Totals, std: FloatArray, own: AutopilotsOwn
    ) -> FloatArray:
        """State of charge that may be used so that the reserve is kept with its probability, shape (routes,)."""
        # the charge less the expected losses, and what the autopilot's return takes: the level that it exceeds with the
        # probability if nothing is used
        soc = known.soc - self.losses(known, totals.seconds) * LOSS - totals.soc_per_j * own.joules
        floor = np.maximum(np.maximum(self.objective.reserve_soc, own.turns_back_soc), limits.min_soc)
        available: FloatArray = soc - self.quantile * std - floor
        return available


def _wind_effect(times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factor of each route's mean time due to the variance of the wind, and the variance of the time's logarithm.

    To second order: times at two pairs of points about the estimate, along the columns of a root of its covariance.

    Parameters
    ----------
    times_s : array, shape (routes, winds)
        Times in the winds of `_sigma_points` [s].

    Source: unscented transform, Julier and Uhlmann 1997.
    """
    flyable = (np.isfinite(times_s) & (times_s > 0)).all(axis=1, keepdims=True)
    # a route that cannot be flown in one of the winds counts as in the estimate: a ratio of 1
    ratios = np.where(flyable, times_s, 1.0) / np.where(flyable, times_s[:, :1], 1.0)
    # of each pair: first and second difference of log t along one column of the root, which is scaled by √2
    above, below = np.log(ratios[:, 1::2]), np.log(ratios[:, 2::2])
    first, second = (above - below) / 2, (above + below) / 2
    # with gradient g and Hessian H of log t: E = ½ tr H P, var = gᵀ P g + ½ tr (H P)²
    return np.exp(second.sum(axis=1) / 2), ((first**2).sum(axis=1) + (second**2).sum(axis=1)) / 2


def _sigma_points(wind: WindKnown, airspeed_mps: float) -> FloatArray:
    """The winds that represent an uncertain wind: its estimate and two pairs about it, shape (5, 2) [m/s].

    None is above `MAX_WIND`; the estimate alone, shape (1, 2), where it is exact, or above `MAX_WIND` itself.
    """
    (x, y), (pxx, pyy, pxy) = wind.mps, wind.covariance
    max_mps = MAX_WIND * airspeed_mps
    if pxx + pyy <= 0 or math.hypot(x, y) > max_mps:
        return np.array([(x, y)])
    # no more uncertain than before anything was known: P ← P (P + σ² I)⁻¹ σ², written out for two dimensions
    prior, determinant = WIND_PRIOR_MPS**2, pxx * pyy - pxy * pxy
    scale = prior / ((pxx + prior) * (pyy + prior) - pxy * pxy)
    pxx, pyy, pxy = (pxx * prior + determinant) * scale, (pyy * prior + determinant) * scale, pxy * prior * scale
    # √2 L = [[a, 0], [b, c]], with L Lᵀ = P the root of Cholesky; a pair of winds along each of its columns
    a = math.sqrt(2 * max(pxx, 1e-12))
    b = 2 * pxy / a
    c = math.sqrt(max(2 * pyy - b * b, 0.0))
    points = np.array([(x, y), (x + a, y + b), (x - a, y - b), (x, y + c), (x, y - c)])
    lengths = np.hypot(points[:, 0], points[:, 1])
    limited: FloatArray = points * np.minimum(1.0, max_mps / np.maximum(lengths, 1e-9))[:, None]
    return limited

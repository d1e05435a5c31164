"""The program's terms against the same computed plainly, leg by leg."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from common.routes import Tracked
from eadp.planning.joint.knapsack import fill_greedy
from eadp.planning.joint.terms import QUALITY, TOTAL, FlownShares, RouteLoad, TermBuilder
from scipy.optimize import brentq, linprog

from eadp.core.flight.battery import soc_rate_per_s
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text
from eadp.models.battery import Battery
from eadp.models.computing import Computing, join_profile
from eadp.models.profile import Profile
from eadp.planning.base import Mission, PlannerSettings, TradeOff
from eadp.planning.joint import terms as module
from eadp.planning.joint.settings import JointSettings

ALGEBRA = 1e-9
LOWEST_VOLTAGE = 0.02
DIFFERENCE_W = 1e-4
BY_DIFFERENCES = 1e-5

ONE = """\
init:
n = 4
a = 0, 40 + c1
path:
0.1; 90; x - a
a, 100
[0, 20]
[2, 10]
0.01; 270; (x - a - 20)^2 + (y - 100)^2 - 400
a + 40, 100
[0, 20]
[0, 0]
0.1; 270; x - a - 40
a + 40, 0
[0, 20]
[2, 6]
0.01; 90; (x - a - 40 - c1/2)^2 + y^2 - (c1/2)^2
a + 40 + c1, 0
[5, 10]
[4, 4]
trig:
400, 0
"""
TWO = ONE.replace("[2, 10]\n", "[2, 10]\n[1, 3]\n").replace("[0, 0]\n", "[0, 0]\n[0, 0]\n")
TWO = TWO.replace("[2, 6]\n", "[2, 6]\n[3, 3]\n").replace("[4, 4]\n", "[4, 4]\n[1, 3]\n")
NO_COMPUTATIONS = "0.1; 90; x - c1\nc1, 400\n[0, 30]\n0.1; 90; x - c1\nc1, 900\n[0, 30]\n"
BARE = "0.1; 90; x\n0, 400\n0.1; 90; x\n0, 900\n"


def fps():
    return Profile(("fps",), ("",), np.array([[2.0], [5.0], [10.0]]), np.array([4.8, 6.0, 9.8]))


def both():
    rates, sizes = (2.0, 5.0, 10.0), (1.0, 2.0, 3.0)
    rows = list(itertools.product(rates, sizes))
    power = np.array([3 + 0.4 * rate + 0.8 * size + 0.05 * rate * size for rate, size in rows])
    return Profile(("fps", "size"), ("", ""), np.array(rows), power)


def no_limit(**changes):
    return replace(Battery(14.8, 0.05, 1.0), **changes)


@dataclass
class Case:
    """A mission's rest with everything that its terms are made of."""

    plan: object
    computing: Computing
    battery: Battery
    weights: dict = field(default_factory=dict)
    levels: dict = field(default_factory=dict)
    trade_offs: tuple = ()
    objective: str = QUALITY
    soc: float = 0.9
    reserve: float = 0.1
    seed: int = 0
    _middles: list = field(default_factory=list)

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        count = len(self.plan.parameters)
        first = tuple(self.plan.hull(i).hi for i in range(count)) if self.plan.has_sets else ()
        follower = Tracked(self.plan, first, (0.0, -50.0))
        decided = tuple(box.lo + 0.7 * (box.hi - box.lo) for box in (self.plan.hull(i) for i in range(len(first))))
        self.route = follower.route(decided)
        n = len(self.route.legs)
        motion = rng.uniform(30, 40, n)
        self.load = RouteLoad(rng.uniform(2, 20, n), motion, motion + rng.uniform(0, 3, n), 5.0, 100.0)
        self.past = FlownShares(rng.uniform(0, 100, count).tolist(), (rng.uniform(0, 100, count) * 0.5).tolist())
        self.term_builder = TermBuilder(
            Mission(self.plan, self.computing, self.battery, 15.0, first),
            PlannerSettings(weights=self.weights, levels=self.levels),
            JointSettings(objective=self.objective, trade_offs=self.trade_offs),
        )

    def terms(self):
        return self.term_builder.terms(self.route, self.load, self.past, self.soc, self.reserve)

    # --- the same in plain loops

    def choices(self, i):
        """Configurations of a leg that trade-offs and levels allow: (values, power)."""
        rho, leg, own = self.plan.path_count, self.route.legs[i], self.route.parameters[i]
        lists = []
        for k, box in enumerate(leg.stage.sets[rho:]):
            name = self.plan.names[rho + k]
            if name in self.levels:
                inside = sorted(v for v in self.levels[name] if box.lo <= v <= box.hi)
                lists.append(inside or [box.lo])
            else:
                measured = {value for value in ((2.0, 5.0, 10.0), (1.0, 2.0, 3.0))[k] if box.lo < value < box.hi}
                lists.append(sorted({box.lo, box.hi, *measured}))
        found = []
        for choice in itertools.product(*lists):
            named = dict(zip(self.plan.names, (*own[:rho], *choice), strict=True))
            if all(
                sum(c * named[name] for name, c in row.coefficients.items()) >= row.at_least - 1e-9
                for row in self.trade_offs
            ):
                found.append((choice, self.computing.power_w((*own[:rho], *choice), leg.stage.sets)))
        if not found:  # the lowest, as where nothing is feasible
            lowest = tuple(values[0] for values in lists)
            found = [(lowest, self.computing.power_w((*own[:rho], *lowest), leg.stage.sets))]
        return sorted(found, key=lambda pair: pair[1])

    def weight(self, name):
        return self.weights.get(name, 0.0) if self.weights else 1.0

    def quality(self, shares_of_legs):
        """U of the whole flight if each leg has these shares of its computations' sets."""
        total = weights = 0.0
        rho = self.plan.path_count
        for j, name in enumerate(self.plan.names):
            time, area = self.past.times_s[j], self.past.areas_s[j]
            for i, leg in enumerate(self.route.legs):
                box = leg.stage.sets[j]
                if box.lo == box.hi:
                    continue
                value = self.route.parameters[i][j] if j < rho else shares_of_legs[i][j - rho]
                time += self.load.times_s[i]
                area += (min(max(value, box.lo), box.hi) - box.lo) / (box.hi - box.lo) * self.load.times_s[i]
            if time > 0 and self.weight(name) > 0:
                weights += self.weight(name)
                total += self.weight(name) * area / time
        return total / weights if weights else 0.0

    def charges(self):
        """State of charge half way through each leg and at its end, flown with the highest computations.

        The battery is drained in small steps at the voltage that it then has; a flight that would go below the reserve
        is drained so much slower that it ends there.
        """
        b, increments = self.battery, 50
        floor = min(self.reserve, self.soc)

        def drained(slower):
            soc, found = self.soc, []
            for i, seconds in enumerate(self.load.times_s):
                power, ends = self.load.motion_w[i] + self.choices(i)[-1][1], [soc]
                for _ in range(increments):
                    rate = soc_rate_per_s(power, b.voltage_at(soc), b.resistance_ohm, b.capacity_ah, b.k_b_per_s)
                    soc += slower * rate * seconds / increments
                    ends.append(soc)
                found.append((ends[increments // 2], ends[-1]))
            return found

        if drained(1.0)[-1][1] >= floor:
            return drained(1.0)
        if self.soc <= floor:
            return drained(0.0)
        return drained(brentq(lambda slower: drained(slower)[-1][1] - floor, 0.0, 1.0))

    def volts(self, i):
        """The voltage half way through a leg."""
        if self.battery.voltage_empty_v is None:
            return self.battery.voltage_v
        if not self._middles:
            self._middles = [middle for middle, _ in self.charges()]
        return self.battery.voltage_at(self._middles[i])

    @property
    def algebra(self):
        """How near terms are: what is planned with the lowest voltage is a little off where voltages fall."""
        return ALGEBRA if self.battery.voltage_empty_v is None else LOWEST_VOLTAGE

    def use(self, i, power):
        b = self.battery
        total = self.load.motion_w[i] + power
        return self.load.times_s[i] * -soc_rate_per_s(
            total, self.volts(i), b.resistance_ohm, b.capacity_ah, b.k_b_per_s
        )


def case(text=ONE, profile=None, battery=None, **more):
    plan = read_plan(Text("p", text))[0]
    profile = fps() if profile is None and text == ONE else profile
    return Case(plan, join_profile(plan, profile), battery or no_limit(), **more)


CASES = {
    "one computation": lambda: case(),
    "two computations": lambda: case(TWO, both()),
    "weights": lambda: case(TWO, both(), weights={"c1": 3.0, "c3": 1.0}),
    "levels": lambda: case(levels={"c2": (2.0, 4.0, 10.0)}),
    "trade-offs": lambda: case(TWO, both(), trade_offs=(TradeOff({"c2": 1.0, "c3": -1.0}, 3.0),)),
    "trade-off with the path": lambda: case(trade_offs=(TradeOff({"c1": 0.2, "c2": 1.0}, 7.0),)),
    "falling voltage": lambda: case(battery=no_limit(voltage_empty_v=11.0)),
    "no resistance": lambda: case(battery=no_limit(resistance_ohm=0.0)),
    "below the reserve": lambda: case(soc=0.05, reserve=0.3),
    "no computations": lambda: case(NO_COMPUTATIONS),
    "bare": lambda: case(BARE),
    "tiny battery": lambda: case(battery=no_limit(capacity_ah=1e-3)),
}


@pytest.mark.parametrize("name", CASES)
def test_the_base_is_every_leg_at_minimum_power(name):
    it = CASES[name]()
    terms = it.terms()
    least = sum(it.use(i, it.choices(i)[0][1]) for i in range(len(it.route.legs)))
    assert terms.increments.base_use == pytest.approx(least, rel=it.algebra)
    assert terms.beyond_w == 0
    assert len(terms.envelopes) == len(it.route.legs)


@pytest.mark.parametrize("name", CASES)
def test_envelopes_hold_configurations_with_use_and_value(name):
    it = CASES[name]()
    terms, rho = it.terms(), it.plan.path_count
    base = [it.choices(i)[0][0] for i in range(len(it.route.legs))]
    at_base = it.quality(base)
    for i, envelope in enumerate(terms.envelopes):
        allowed = dict(it.choices(i))
        for power, value, row in zip(envelope.powers_w, envelope.values, envelope.configurations, strict=True):
            choice = tuple(row.tolist())
            assert allowed[choice] == pytest.approx(power, rel=ALGEBRA)
            if len(it.plan.names) > rho:
                moved = [*base[:i], choice, *base[i + 1 :]]
                gained = (value - envelope.values[0]) * it.load.times_s[i]
                assert gained == pytest.approx(it.quality(moved) - at_base, abs=1e-6)
        own = terms.increments.segment == i
        order = np.argsort(terms.increments.level[own])
        uses = [it.use(i, power) for power in envelope.powers_w]
        assert terms.increments.use[own][order] == pytest.approx(np.diff(uses), rel=max(it.algebra, 1e-6), abs=1e-12)
        gains = np.diff(envelope.values) * it.load.times_s[i]
        assert terms.increments.gain[own][order] == pytest.approx(gains, abs=ALGEBRA)


@pytest.mark.parametrize("name", CASES)
def test_the_base_value_is_the_quality_with_every_leg_at_minimum_power(name):
    it = CASES[name]()
    base = [it.choices(i)[0][0] for i in range(len(it.route.legs))]
    assert it.terms().increments.base_value == pytest.approx(it.quality(base), abs=1e-6)


@pytest.mark.parametrize("name", ["one computation", "two computations", "trade-offs", "falling voltage"])
def test_filled_terms_are_the_best_mixes_of_all_configurations(name):
    it = CASES[name]()
    terms = it.terms()
    share = 0.4
    available = terms.increments.base_use + share * terms.increments.use.sum()
    # one share for each configuration of each leg, that add up to 1
    uses, gains, owners = [], [], []
    base = [it.choices(i)[0][0] for i in range(len(it.route.legs))]
    at_base = it.quality(base)
    least = most = 0.0
    for i in range(len(it.route.legs)):
        least += it.use(i, it.choices(i)[0][1])
        most += it.use(i, it.choices(i)[-1][1])
        for choice, power in it.choices(i):
            uses.append(it.use(i, power))
            gains.append(it.quality([*base[:i], choice, *base[i + 1 :]]) - at_base)
            owners.append(i)
    sums = np.array([[owner == i for owner in owners] for i in range(len(it.route.legs))], dtype=float)
    spare = least + share * (most - least)
    exact = linprog(
        -np.array(gains), A_ub=100 * np.array([uses]), b_ub=[100 * spare], A_eq=sums, b_eq=np.ones(len(sums))
    )
    best = at_base - exact.fun
    # a battery's use bends upwards with power: configurations off the envelope in power may be worth a trace more
    assert fill_greedy(terms.increments, available).value == pytest.approx(best, abs=max(it.algebra / 10, 1e-4))
    assert fill_greedy(terms.increments, available).value <= best + (
        ALGEBRA if it.algebra == ALGEBRA else it.algebra / 10
    )


def test_total_adds_up_the_computations_over_time():
    it = case(TWO, both(), objective=TOTAL, weights={"c2": 1.0, "c3": 2.0})
    terms = it.terms()
    most = 1.0 * 10 + 2.0 * 3
    free_s = max(
        it.past.times_s[j]
        + sum(t for t, leg in zip(it.load.times_s, it.route.legs, strict=True) if not leg.stage.sets[j].fixed)
        for j in range(3)
    )
    for i, envelope in enumerate(terms.envelopes):
        weighed = envelope.configurations @ np.array([1.0, 2.0]) / (most * free_s)
        running = not all(box.inhibited for box in it.route.legs[i].stage.sets[1:])
        assert envelope.values == pytest.approx(weighed if running else [0.0], rel=1e-3)


def test_a_stage_that_inhibits_computations_takes_and_gives_nothing():
    it = case(TWO, both())
    terms = it.terms()
    for i, leg in enumerate(it.route.legs):
        if leg.stage.sets[1].inhibited:
            assert terms.envelopes[i].powers_w.tolist() == [0]
            assert terms.envelopes[i].configurations.tolist() == [[0, 0]]
            assert i not in terms.increments.segment


# --- limits -----------------------------------------------------------------------------------------------------------


def test_the_crate_bounds_every_configuration():
    it = case(battery=no_limit(letter_crate_per_h=4.0), soc=0.9, reserve=0.8)
    terms, charges = it.terms(), it.charges()
    assert charges[-1][1] == pytest.approx(0.8), "it would take more than there is above the reserve"
    for i, envelope in enumerate(terms.envelopes):
        limit = charges[i][1] * 1.0 * 14.8 * 4.0 - it.load.peak_w[i]
        allowed = [power for _, power in it.choices(i) if power <= limit]
        assert envelope.powers_w[-1] == pytest.approx(max(allowed, default=it.choices(i)[0][1]))


@pytest.mark.parametrize("letter_crate_per_h", [2.5, 6.0, 20.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_least_charge_at_the_end_is_what_the_crate_asks_for_on_the_way(letter_crate_per_h, seed):
    """Found by trying: ends from which the cheapest, flown backwards, is within b Q V crate at every leg's end."""
    it = case(battery=no_limit(letter_crate_per_h=letter_crate_per_h), seed=seed)

    def within(soc):
        for i in reversed(range(len(it.route.legs))):
            cheapest = it.choices(i)[0][1]
            if it.load.peak_w[i] + cheapest > soc * 1.0 * 14.8 * letter_crate_per_h:
                return False
            soc += it.use(i, cheapest)
        return True

    low, high = 0.0, 5.0
    while high - low > 1e-10:
        middle = (low + high) / 2
        low, high = (low, middle) if within(middle) else (middle, high)
    assert it.terms().min_soc == pytest.approx(high, abs=1e-8)


@pytest.mark.parametrize(
    "limits", [{"max_c_rate": 3.0}, {"cutoff_voltage_v": 14.0, "resistance_ohm": 0.25}, {"letter_crate_per_h": 3.0}]
)
def test_a_limit_of_power_truncates_the_configurations_and_says_where(limits):
    it = case(battery=no_limit(**limits), soc=0.99, reserve=0.98)
    max_w = {
        "max_c_rate": module.DELIVERABLE * 3.0 * (14.8 - 0.05 * 3.0),
        "cutoff_voltage_v": module.DELIVERABLE * 14.0 * 0.8 / 0.25,
    }
    terms, charges, truncated = it.terms(), it.charges(), 0
    for i, envelope in enumerate(terms.envelopes):
        powers = [power for _, power in it.choices(i)]
        limit_w = max_w.get(next(iter(limits)), charges[i][1] * 14.8 * 3.0)
        within = [power for power in powers if power <= limit_w - it.load.peak_w[i]]
        assert envelope.powers_w[-1] == pytest.approx(max(within, default=powers[0]))
        assert terms.truncated[i] == (len(within) < len(powers))
        assert terms.by_letter[i] == ("letter_crate_per_h" in limits)
        truncated += terms.truncated[i]
    assert truncated > 0


def test_the_cut_off_voltage_asks_for_charge_at_the_end():
    """Found by trying: the lowest end from which minimum power, flown backwards, is delivered on every leg."""
    it = case(battery=no_limit(voltage_empty_v=11.0, cutoff_voltage_v=12.0), soc=0.9, reserve=0.1)
    b, terms = it.battery, it.terms()

    def within(soc):
        for i in reversed(range(len(it.route.legs))):
            cheapest = it.choices(i)[0][1]
            current = (it.load.peak_w[i] + cheapest) / 12.0
            if b.voltage_at(soc) - 0.05 * current < 12.0:
                return False
            soc += it.use(i, cheapest)
        return True

    low, high = 0.0, 1.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (low, middle) if within(middle) else (middle, high)
    assert terms.min_soc == terms.delivered_soc == pytest.approx(high, abs=1e-3)
    assert 0.25 < high < 0.4
    assert terms.beyond_w == 0
    assert terms.letter_soc < 0.1


@pytest.mark.parametrize("max_w", [30.0, 41.0, 60.0])
def test_power_that_the_battery_cannot_deliver_is_reported(max_w):
    # V²/4R is the most that comes out of it
    it = case(battery=no_limit(resistance_ohm=14.8**2 / (4 * max_w)))
    worst = max(it.choices(i)[0][1] + it.load.peak_w[i] - max_w for i in range(len(it.route.legs)))
    assert it.terms().beyond_w == pytest.approx(max(worst, 0.0))
    assert (worst > 0) == (max_w < 50)


def test_without_a_resistance_any_power_is_delivered():
    assert case(battery=no_limit(resistance_ohm=0.0, letter_crate_per_h=0.1)).terms().beyond_w == 0


def test_a_battery_delivers_no_more_than_it_can():
    # V²/4R = 45 W at 14.8 V
    it = case(battery=no_limit(resistance_ohm=14.8**2 / 180))
    for i, envelope in enumerate(it.terms().envelopes):
        limit = module.DELIVERABLE * 45 - it.load.peak_w[i]
        cheapest = it.choices(i)[0][1]
        assert envelope.powers_w[-1] <= max(limit, cheapest) + ALGEBRA
        assert np.isfinite(it.terms().increments.use).all()


def test_a_battery_that_stays_nearly_full_allows_every_configuration():
    it = case(battery=no_limit(capacity_ah=5.0, letter_crate_per_h=10.0), soc=0.9, reserve=0.03)
    terms = it.terms()
    takes = terms.increments.base_use + terms.increments.use.sum()
    lowest = 0.9 - takes
    assert lowest * 5.0 * 14.8 * 10.0 > 100, "more than any leg asks for, to the end"
    for i, envelope in enumerate(terms.envelopes):
        assert envelope.powers_w[-1] == pytest.approx(it.choices(i)[-1][1])


@pytest.mark.parametrize("volts_empty", [None, 11.0])
def test_soc_per_joule_by_differences(volts_empty):
    it = case(battery=no_limit(voltage_empty_v=volts_empty))
    terms, b = it.terms(), it.battery
    volts = float(np.mean([it.volts(i) for i in range(len(it.route.legs))]))
    rates = [
        -soc_rate_per_s(terms.mean_w + d, volts, b.resistance_ohm, b.capacity_ah, b.k_b_per_s)
        for d in (-DIFFERENCE_W, DIFFERENCE_W)
    ]
    expected = (rates[1] - rates[0]) / (2 * DIFFERENCE_W)
    assert terms.soc_per_j == pytest.approx(expected, rel=max(BY_DIFFERENCES, it.algebra))


def test_mean_power_is_with_the_computations_half_way():
    it = case()
    terms = it.terms()
    half = [(envelope.powers_w[0] + envelope.powers_w[-1]) / 2 for envelope in terms.envelopes]
    expected = np.average(it.load.motion_w + half, weights=it.load.times_s)
    assert terms.mean_w == pytest.approx(expected)


def test_mean_power_of_less_than_a_second_is_as_high():
    it, shares = case(), None
    for seconds in (0.1, 100.0):
        it.load = it.load._replace(times_s=it.load.times_s * seconds / it.load.times_s.sum())
        shares, before = it.terms().mean_w, shares
    assert shares == pytest.approx(before)


# --- choices ----------------------------------------------------------------------------------------------------------


def test_trade_offs_that_leave_nothing_leave_the_lowest():
    it = case(trade_offs=(TradeOff({"c2": 1.0}, 99.0),))
    for i, envelope in enumerate(it.terms().envelopes):
        box = it.route.legs[i].stage.sets[1]
        assert envelope.configurations.tolist() == [[box.lo]]


def test_configurations_that_were_not_measured_are_left_out():
    """Measured at three corners of four: the other one comes second in their order."""
    measured = [[2.0, 1.0], [10.0, 1.0], [10.0, 3.0]]
    text = TWO.replace("[3, 3]\n", "[1, 1]\n").replace("[4, 4]\n[1, 3]\n", "[4, 4]\n[1, 1]\n")
    it = case(text, Profile(("fps", "size"), ("", ""), np.array(measured), np.array([4.0, 7.0, 9.0])))
    sets, own = it.route.legs[0].stage.sets, it.route.parameters[0]
    assert it.term_builder.configurations(sets, own)[0].tolist() == measured


def test_levels_outside_a_set_leave_its_lower_end():
    it = case(levels={"c2": (3.0, 8.0)})
    for i, envelope in enumerate(it.terms().envelopes):
        box = it.route.legs[i].stage.sets[1]
        inside = [level for level in (3.0, 8.0) if box.lo <= level <= box.hi] or [box.lo]
        assert set(envelope.configurations[:, 0].tolist()) <= set(inside)


def test_many_configurations_are_thinned_and_keep_their_ends(monkeypatch):
    monkeypatch.setattr(module, "MAX_CONFIGURATIONS", 12)
    it = case(TWO, both())
    sets, own = it.route.legs[0].stage.sets, it.route.parameters[0]
    configurations, powers = it.term_builder.configurations(sets, own)
    assert len(configurations) <= 12
    assert (np.diff(powers) >= 0).all()
    for row in ([2.0, 1.0], [10.0, 3.0]):
        assert row in configurations.tolist()


def test_many_computations_of_two_values_each_come_to_an_end(monkeypatch):
    monkeypatch.setattr(module, "MAX_CONFIGURATIONS", 3)
    it = case(TWO, both(), levels={"c2": (2.0, 10.0), "c3": (1.0, 3.0)})
    product, calls = math.prod, []

    def counted(values):
        calls.append(1)
        if len(calls) > 100:
            raise RecursionError("it goes on and on")
        return product(values)

    monkeypatch.setattr(module.math, "prod", counted)
    try:
        it.term_builder.configurations(it.route.legs[0].stage.sets, it.route.parameters[0])
    except RecursionError:
        pytest.fail("it goes on and on")


def test_envelopes_are_built_once_for_each_kind_of_leg():
    it = case(TWO, both())
    envelopes = it.terms().envelopes
    kinds = {leg.stage.index for leg in it.route.legs}
    assert len({id(envelope.powers_w) for envelope in envelopes}) <= len(kinds)
    same = [envelope for envelope, leg in zip(envelopes, it.route.legs, strict=True) if leg.stage.index == 1]
    assert all(envelope.powers_w is same[0].powers_w for envelope in same)


def test_no_weight_on_what_is_free_has_no_value():
    it = case(weights={"c1": 0.0, "c2": 0.0})
    terms = it.terms()
    assert terms.increments.base_value == 0
    assert not terms.increments.gain.any()


def test_stages_whose_path_sets_alone_differ_share_an_envelope():
    same = ONE.replace("[0, 0]\n", "[2, 10]\n").replace("[2, 6]\n", "[2, 10]\n").replace("[4, 4]\n", "[2, 10]\n")
    assert {stage.sets[0].lo for stage in case(same, fps()).plan.stages} == {0.0, 5.0}
    assert len(case(same, fps()).terms().kinds) == 1
    assert len(case(ONE).terms().kinds) == 4

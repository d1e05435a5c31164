"""Envelopes of configurations: the hull by brute force, and each stage's own configurations in plain loops."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text
from eadp.models.battery import Battery
from eadp.models.computing import join_profile
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.route import RoutePredictor
from eadp.models.profile import Profile
from eadp.models.vehicle import FixedWing
from eadp.models.world import Mission
from eadp.planning.base import PlannerSettings, TradeOff
from eadp.planning.forecast.envelopes import Configurations, Envelopes

HULL, ALGEBRA = 1e-9, 1e-9


def hull_value(powers, values, power):
    """The most that mixes of two configurations give at a power on average, by looking at every pair."""
    best = -np.inf
    for (p, v), (q, w) in itertools.product(zip(powers, values, strict=True), repeat=2):
        if p == q == power:
            best = max(best, v, w)
        elif p <= power <= q and p < q:
            best = max(best, v + (w - v) * (power - p) / (q - p))
    return best


def most_at(powers, values, power):
    """The same where charge may also be left over."""
    return max(hull_value(powers, values, p) for p in [power, *(p for p in powers if p <= power)])


coarse = st.integers(0, 6).map(float)
points = st.lists(st.tuples(coarse, st.integers(-3, 6).map(float)), min_size=1, max_size=9)
fine = st.floats(0, 30).map(lambda value: round(value, 6))
fine_points = st.lists(st.tuples(fine, fine), min_size=1, max_size=9)


@given(points=st.one_of(points, fine_points))
def test_the_envelope_is_the_upper_hull(points):
    powers, values = (np.array(column) for column in zip(*points, strict=True))
    numbers = np.arange(len(points), dtype=float)[:, None]
    envelope = Configurations(powers, values, numbers).envelope(len(points))
    # among the points, the cheapest first, rising in both
    for p, v, (i,) in zip(envelope.powers_w, envelope.values, envelope.configurations, strict=True):
        assert (p, v) == points[int(i)]
    assert envelope.powers_w[0] == powers.min()
    assert envelope.values[0] == values[powers == powers.min()].max()
    assert (np.diff(envelope.powers_w) > 0).all()
    assert (np.diff(envelope.values) > 0).all()
    # what it gives at every power is the most that is possible
    for power in {*powers.tolist(), *((powers.min() + powers.max()) / 2 * np.ones(1)).tolist()}:
        at = min(power, envelope.powers_w[-1])
        found = np.interp(at, envelope.powers_w, envelope.values)
        assert found == pytest.approx(most_at(powers, values, power), abs=HULL)


# --- envelopes of a mission's stages ----------------------------------------------------------------------------------

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
MEASURED = (2.0, 5.0, 10.0), (1.0, 2.0, 3.0)


def fps():
    return Profile(("fps",), ("",), np.array([[2.0], [5.0], [10.0]]), np.array([4.8, 6.0, 9.8]))


def both():
    rows = list(itertools.product(*MEASURED))
    power = np.array([3 + 0.4 * rate + 0.8 * size + 0.05 * rate * size for rate, size in rows])
    return Profile(("fps", "size"), ("", ""), np.array(rows), power)


class Case:
    """A mission's legs, and their configurations in plain loops."""

    def __init__(self, text=ONE, profile=None, *, trade_offs=(), weights=None, levels=None):
        self.plan = read_plan(Text("p", text))[0]
        self.weights, self.levels = weights or {}, levels or {}
        self.trade_offs = trade_offs
        self.rho = self.plan.path_count
        self.computing = join_profile(self.plan, profile or fps())
        first = tuple(self.plan.hull(i).hi for i in range(len(self.plan.parameters)))
        own = tuple(0.3 * box.lo + 0.7 * box.hi for box in map(self.plan.hull, range(len(first))))
        mission = Mission(self.plan, self.computing, Battery(14.8, 0.05, 1.0), FixedWing(), first)
        settings = PlannerSettings(weights=self.weights, levels=self.levels)
        self.envelopes = Envelopes(mission, settings, trade_offs)
        self.route = RoutePredictor().route(PlanCursor.start(self.plan, own), (0.0, -50.0))

    def of_legs(self, room_w=None):
        """Envelope of each leg, with so much power for the computations."""
        groups = self.envelopes.groups(self.route.table, self.route.order)
        count = len(groups)
        room = np.full(count, np.inf if room_w is None else room_w)
        kinds = self.envelopes.kinds(groups, room, np.full(count, room_w is not None))
        return [self.envelopes[kind] for kind in kinds.tolist()]

    def choices(self, i):
        """Configurations of a leg within its set, levels and trade-offs, with power and value."""
        sets, own = self.route.of_legs[i].sets, self.route.parameters[i]
        lists = []
        for k, box in enumerate(sets[self.rho :]):
            name = self.plan.names[self.rho + k]
            if name in self.levels:
                lists.append(sorted(v for v in self.levels[name] if box.lo <= v <= box.hi) or [box.lo])
            else:
                lists.append(sorted({box.lo, box.hi, *(value for value in MEASURED[k] if box.lo < value < box.hi)}))
        found = []
        for choice in itertools.product(*lists):
            named = dict(zip(self.plan.names, (*own[: self.rho], *choice), strict=True))
            rows = (sum(c * named[n] for n, c in row.coefficients.items()) - row.at_least for row in self.trade_offs)
            if all(row >= -1e-9 for row in rows):
                power = self.computing.power_w((*own[: self.rho], *choice), sets)
                found.append((choice, power, self.value(sets, choice)))
        return found

    def value(self, sets, choice):
        """Σ ω c̃ with ω of all parameters that have a choice on the stage."""
        weight = {name: self.weights.get(name, 1.0) for name in self.plan.names}
        names = self.plan.names[self.rho :]
        scale = sum(weight[name] for name, box in zip(self.plan.names, sets, strict=True) if box.lo < box.hi)
        return sum(
            weight[name] / scale * (value - box.lo) / (box.hi - box.lo)
            for name, value, box in zip(names, choice, sets[self.rho :], strict=True)
            if box.lo < box.hi
        )


CASES = {
    "one computation": Case,
    "two computations": lambda: Case(TWO, both()),
    "weights": lambda: Case(TWO, both(), weights={"c1": 3.0, "c3": 0.5}),
    "levels": lambda: Case(levels={"c2": (2.0, 4.0, 10.0)}),
    "trade-offs": lambda: Case(TWO, both(), trade_offs=(TradeOff({"c2": 1.0, "c3": -1.0}, -1.0),)),
}


@pytest.mark.parametrize("room_w", [None, 7.0])
@pytest.mark.parametrize("name", CASES)
def test_each_leg_has_the_envelope_of_its_own_configurations(name, room_w):
    case = CASES[name]()
    counted = 0
    for i, envelope in enumerate(case.of_legs(room_w)):
        choices = case.choices(i)
        fits = [one for one in choices if room_w is None or one[1] <= room_w]
        choices = fits or [min(choices, key=lambda one: one[1])]
        allowed = {choice: (power, value) for choice, power, value in choices}
        for power, value, row in zip(envelope.powers_w, envelope.values, envelope.configurations, strict=True):
            assert (power, value) == pytest.approx(allowed[tuple(row.tolist())], abs=ALGEBRA)
        powers, values = (np.array(column) for column in list(zip(*choices, strict=True))[1:])
        for power in powers:
            at = min(power, envelope.powers_w[-1])
            found = np.interp(at, envelope.powers_w, envelope.values)
            assert found == pytest.approx(most_at(powers, values, power), abs=HULL)
        counted += len(envelope.powers_w) > 1
    assert counted


def test_a_stage_that_inhibits_computations_takes_and_gives_nothing():
    case = Case(TWO, both())
    inhibited = 0
    for stage, envelope in zip(case.route.of_legs, case.of_legs(), strict=True):
        if stage.sets[1].inhibited:
            inhibited += 1
            assert envelope.powers_w.tolist() == envelope.values.tolist() == [0]
            assert envelope.configurations.tolist() == [[0, 0]]
    assert inhibited


def test_trade_offs_that_nothing_meets_leave_the_lowest():
    case = Case(TWO, both(), trade_offs=(TradeOff({"c2": 1.0}, 1e3),))
    for stage, envelope in zip(case.route.of_legs, case.of_legs(), strict=True):
        assert envelope.configurations.tolist() == [[box.lo for box in stage.sets[1:]]]


def test_rows_of_the_table_are_the_envelopes():
    case = Case(TWO, both())
    envelopes = case.of_legs() + case.of_legs(7.0)
    table = case.envelopes.table
    assert len(table.powers_w) == len({id(envelope) for envelope in envelopes})
    for number, (powers_w, values) in enumerate(zip(*table, strict=True)):
        own = case.envelopes[number]
        count = len(own.powers_w)
        assert powers_w[:count].tolist() == own.powers_w.tolist()
        assert values[:count].tolist() == own.values.tolist()
        assert set(powers_w[count - 1 :]) == {own.powers_w[-1]}, "filled up with the last vertex: no increments"
        assert set(values[count - 1 :]) == {own.values[-1]}

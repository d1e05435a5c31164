"""Which runs, in which order, and the loop that makes them."""

import itertools

import numpy as np
import pytest
from scipy import stats

from eadp.sweep.engines import Result, Run
from eadp.sweep.run import DIED, make_runs
from eadp.sweep.sweep_file import Design, Law, SampleDesign

LAWS = {"u": Law(uniform=(2.0, 4.0)), "n": Law(normal=(10.0, 3.0)), "c": Law(choice=("a", "b", "c"))}


def test_a_design_is_the_product_of_its_parts():
    sample = SampleDesign(3, {"u": Law(uniform=(0.0, 1.0))})
    design = Design({"a": [1, 2], "b": ["x", "y", "z"]}, {"c": [5, 6], "d": [7, 8]}, sample, 2)
    drawn = sample.draws["u"]
    expected = [
        ({"a": a, "b": b, "c": c, "d": d, "u": u}, seed)
        for a, b, (c, d), u, seed in itertools.product([1, 2], "xyz", [(5, 7), (6, 8)], drawn, range(2))
    ]
    points = [design.point(i) for i in range(len(design))]
    assert len(design) == 2 * 3 * 2 * 3 * 2
    assert [(point.values, point.seed) for point in points] == expected
    assert [point.index for point in points] == list(range(len(design)))
    assert design.names == ("a", "b", "c", "d", "u")


def test_a_million_runs_take_no_room():
    design = Design({name: range(100) for name in "abc"})
    assert len(design) == 10**6
    assert design.point(123456).values == {"a": 12, "b": 34, "c": 56}
    wide = Design({f"k{i}": range(10) for i in range(70)})
    assert wide.size == 10**70
    assert [*wide.point(7 * 10**69 + 3).values.values()] == [7, *[0] * 68, 3]


@pytest.mark.parametrize("method", ["random", "latin"])
def test_samples_have_their_distributions(method):
    draws = SampleDesign(4000, LAWS, 7, method).draws
    assert stats.kstest(draws["u"], stats.uniform(2.0, 2.0).cdf).pvalue > 0.001
    assert stats.kstest(draws["n"], stats.norm(10.0, 3.0).cdf).pvalue > 0.001
    assert stats.chisquare([draws["c"].count(value) for value in "abc"]).pvalue > 0.001
    assert abs(np.corrcoef(draws["u"], draws["n"])[0, 1]) < 0.06


def test_a_latin_hypercube_has_one_draw_in_each_part():
    draws = SampleDesign(50, LAWS, 3, "latin").draws
    assert sorted(int((value - 2.0) / 2.0 * 50) for value in draws["u"]) == list(range(50))
    assert sorted(int(stats.norm(10.0, 3.0).cdf(value) * 50) for value in draws["n"]) == list(range(50))


def test_draws_are_the_seeds_and_stay_when_keys_or_runs_are_added():
    draws = SampleDesign(20, LAWS, 3).draws
    assert SampleDesign(20, LAWS, 3).draws == draws
    assert SampleDesign(20, LAWS, 4).draws != draws
    assert {name: values[:20] for name, values in SampleDesign(30, LAWS, 3).draws.items()} == draws
    first = dict(itertools.islice(LAWS.items(), 1))
    assert SampleDesign(20, first, 3).draws["u"] == draws["u"]


# --- the loop


class Engine:
    """Gives back what it has, a few at a time; runs of `deadly` kill their process."""

    def __init__(self, room, deadly=()):
        self._size, self._deadly = room, deadly
        self.have = []
        self.seen = []

    @property
    def room(self):
        return self._size - len(self.have)

    @property
    def busy(self):
        return len(self.have)

    def submit(self, run):
        assert self.room > 0
        self.have.append(run)
        self.seen.append(run.key)

    def finished(self):
        done, self.have = self.have[:2], self.have[2:]
        return [(run, None if run.key in self._deadly else Result({"key": run.key})) for run in done]


class Ledger:
    """Knows what is made."""

    def __init__(self, made=()):
        self.made = set(made)
        self.stored = {}

    def unmade(self, runs):
        return [run for run in runs if run.key not in self.made]

    def store(self, results):
        for run, result in results:
            assert run.key not in self.stored
            self.stored[run.key] = result
            self.made.add(run.key)


RUNS = [Run(str(i), {}, {"seed": 0}) for i in range(10)]


@pytest.mark.parametrize("room", [1, 3, 100])
def test_every_run_is_made_once_and_stored_before_it_is_told(room):
    engine, ledger = Engine(room), Ledger(made=["2", "5"])
    for run, result in make_runs(RUNS, engine, ledger):
        assert ledger.stored[run.key] is result
    assert sorted(engine.seen) == [run.key for run in RUNS if run.key not in "25"]


def test_a_run_that_kills_its_process_is_a_result():
    ledger = Ledger()
    results = {run.key: result for run, result in make_runs(RUNS, Engine(3, deadly="4"), ledger)}
    assert results["4"].error == DIED
    assert results["4"].summary is None
    assert all(result.error is None for key, result in results.items() if key != "4")

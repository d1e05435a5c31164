"""Compiled code beside the plain function, and the door to it."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from eadp.core import compiled
from eadp.core.signals import disturbance, kalman, riccati
from eadp.planning.estimation.estimator import EstimatorSettings, PublishedEstimator

SAME = 1e-9
fast = pytest.mark.skipif(not compiled.available(), reason="eadp[fast] is not installed")


@pytest.fixture
def switched_on():
    """Compiled code for one test."""
    compiled.enable()
    yield
    compiled.enable(False)


def helper(x):
    return 2 * x


def outermost(x):
    return helper(x) + 1


def test_off_a_function_is_itself():
    assert not compiled.enabled()
    assert compiled.jitted(outermost, helper) is outermost


@fast
def test_on_it_is_compiled_with_its_helpers(switched_on, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not compiled.kept()
    jitted = compiled.jitted(outermost, helper)
    assert jitted is not outermost
    assert jitted is compiled.jitted(outermost, helper)
    assert jitted(3.0) == outermost(3.0) == 7.0
    assert compiled.kept()


@fast
def test_where_nothing_can_be_kept_it_is_compiled_all_the_same(tmp_path):
    code = (
        "from eadp.core import compiled; import eadp.core.flight.guidance as g; compiled.enable();"
        "print(compiled.jitted(g.wind_factor)(3.0, 4.0, 3.0, 4.0))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": "/proc/nowhere"}
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert answer.stdout.strip() == "1.0"


def symmetric(rng, n):
    factor = rng.standard_normal((n, n))
    return factor @ factor.T


@fast
@pytest.mark.parametrize("n", [2, 5, 9])
def test_a_covariance_moves_alike(n, switched_on):
    rng = np.random.default_rng(n)
    step, then = ([rng.standard_normal((n, n)), symmetric(rng, n), symmetric(rng, n)] for _ in range(2))
    state, covariance, reading = rng.standard_normal(n), 10 * symmetric(rng, n), (rng.standard_normal(n), 1.7, 0.3)
    for function, arguments, helpers in (
        (riccati.applied, (np.array(step), covariance), riccati.MAPPING),
        (riccati.composed, (np.array(step), np.array(then)), riccati.MAPPING),
        (kalman.predict, (state, covariance, step[0], step[1]), (kalman.product,)),
        (kalman.update, (state, covariance, *reading), ()),
    ):
        for one, other in zip(compiled.jitted(function, *helpers)(*arguments), function(*arguments), strict=True):
            assert one == pytest.approx(other, rel=SAME, abs=SAME)
    jitted = compiled.jitted(riccati.applied, *riccati.MAPPING)(np.array(step), covariance)
    assert (jitted == jitted.T).all()


@fast
@pytest.mark.parametrize("seed", range(3))
def test_a_disturbance_is_learned_alike(seed, switched_on):
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.uniform(0.05, 0.2, 300))
    power_w = np.convolve(rng.standard_normal(320), np.ones(21) / 5, "valid") + rng.standard_normal(300)
    columns = np.column_stack([np.ones(300), np.cos(time_s)])
    jitted = disturbance.fit_disturbance(time_s, power_w, columns=columns, samples=128)
    compiled.enable(False)
    plain = disturbance.fit_disturbance(time_s, power_w, columns=columns, samples=128)
    for name in ("std_w", "time_s", "noise_w", "log_likelihood"):
        assert getattr(jitted, name) == pytest.approx(getattr(plain, name), rel=SAME)


@fast
@pytest.mark.parametrize("every_s", [0.01, 0.1])
def test_the_published_filter_takes_batches_alike(every_s, switched_on):
    times = np.arange(1, 2000) * every_s
    power_w = 35 + 3 * np.sin(times / 7) + np.random.default_rng(0).standard_normal(len(times))
    found = []
    for on in (True, False):
        compiled.enable(on)
        estimator = PublishedEstimator(EstimatorSettings(kind="published", order=3, every_s=every_s))
        expected = []
        for n in range(0, len(times), 7):
            expected.append(estimator.observe_batch(times[n : n + 7].tolist(), power_w[n : n + 7].tolist()))
            if n == 700:
                estimator.lap(float(times[n + 6]))
        found.append([*expected, *estimator.state_w, estimator.period_s])
    assert found[0] == pytest.approx(found[1], rel=SAME, abs=SAME)


@fast
def test_without_a_home_it_is_compiled_all_the_same(switched_on, monkeypatch):
    def no_home():
        raise RuntimeError("Could not determine home directory.")

    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(compiled.Path, "home", no_home)
    assert compiled.jitted(lambda x: x + 1.0)(2.0) == 3.0


@fast
def test_nothing_is_compiled_where_memory_is_limited(monkeypatch):
    resource = pytest.importorskip("resource")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (512 << 20, 1 << 40))
    assert not compiled.available.__wrapped__()
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert compiled.available.__wrapped__()

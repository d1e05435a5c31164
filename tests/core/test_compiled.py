"""Compiled code beside the plain function, and the door to it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from eadp.core import compiled

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

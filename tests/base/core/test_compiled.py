"""Compiled code beside the plain function, and the door to it."""

import pytest

from eadp.core import compiled

fast = pytest.mark.skipif(not compiled.available(), reason="eadp[fast] is not installed")


def helper(x):
    return 2 * x


def outermost(x):
    return helper(x) + 1


def test_off_a_function_is_itself():
    assert not compiled.enabled()
    assert compiled.jitted(outermost) is outermost


@fast
def test_on_it_is_compiled_with_its_helpers(tmp_path, monkeypatch):
    compiled.enable()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not [*tmp_path.rglob("*.nbi")]
    jitted = compiled.jitted(outermost)
    assert jitted is not outermost
    assert jitted is compiled.jitted(outermost)
    assert jitted(3.0) == outermost(3.0) == 7.0
    assert [*tmp_path.rglob("*.nbi")]


@pytest.fixture
def asked_again():
    """The answer whether numba can be used is kept: not beyond one test."""
    compiled.available.cache_clear()
    yield
    compiled.available.cache_clear()


@fast
def test_nothing_is_compiled_where_numba_cannot_be_imported(monkeypatch, asked_again):
    def fails(_):
        raise ImportError("no llvm")

    monkeypatch.setattr(compiled.importlib, "import_module", fails)
    assert not compiled.enable()

"""The one door to numba: functions of numbers and arrays, compiled to machine code where `eadp[fast]` is installed.

A function is written once. It runs as plain Python, or compiled after `enable`: importing numba takes half a second,
more than one flight gains. Both do the same arithmetic in the same order, except for sums over arrays, which numpy adds
pairwise. There is no fast-math, so nothing else is reassociated.

Machine code is cached between processes, in a folder named by a hash of the sources: numba itself checks the file of
the outermost function alone, and would keep code of a helper that has changed.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import math
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

_on = False
_in_loops: dict[Callable[..., Any], Callable[..., Any]] = {}
MEMORY_BYTES = 1 << 30
"""Least address space: the compiler ends a process that has no memory left."""


@cache
def available() -> bool:
    """Whether numba can be imported, and has the memory to compile; imports it."""
    if importlib.util.find_spec("numba") is None or _address_space() < MEMORY_BYTES:
        return False
    try:
        importlib.import_module("numba")
    except Exception:  # for example built for another numpy: numba is optional
        return False
    return True


def _address_space() -> float:
    """Limit of this process's address space [bytes]."""
    try:
        import resource
    except ImportError:  # a system without such limits
        return math.inf
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return math.inf if limit == resource.RLIM_INFINITY else limit


def enable(on: bool = True) -> bool:
    """Turn compiled code on or off for this process; returns whether it is on."""
    global _on
    _on = on and available()
    return _on


def enabled() -> bool:
    """Whether compiled code is used."""
    return _on


def jitted(function: F, *helpers: Callable[..., Any], makes_arrays: bool = True) -> F:
    """The compiled form of a function where compiled code is enabled, else the function.

    Parameters
    ----------
    function : function
        Its arguments are numbers, arrays, None and other types that numba supports.
    *helpers : function
        All functions of this package that it calls, directly or indirectly.
    makes_arrays : bool
        Whether any of them makes an array. Where none does, numba counts no references to arrays, which takes as long
        as half the flight loop.
    """
    return _compiled(_in_loops.get(function, function), helpers, makes_arrays) if _on else function


def on_numbers(function: Callable[..., Any], state: list[float], *arguments: Any) -> tuple[Any, list[float]]:
    """A function's result, and the state that it has changed: both lists of numbers, or arrays in compiled code.

    Parameters
    ----------
    function : function
        As `jitted` returns it; its first argument is the state.
    state : list of float
    *arguments
        Lists among them are arrays in compiled code.
    """
    if not _on:
        return function(state, *arguments), state
    import numpy as np

    numbers = np.array(state)
    result = function(numbers, *(np.array(each) if isinstance(each, list) else each for each in arguments))
    return result, numbers.tolist()


@cache
def _compiled(function: F, helpers: tuple[Callable[..., Any], ...], makes_arrays: bool) -> F:
    import numba
    from numba.extending import overload, register_jitable

    for helper in helpers:
        if helper in _in_loops:
            _replaced(overload, helper)
        else:
            _registered(register_jitable, helper, makes_arrays)
    # error_model: a division by zero gives an infinity, as the flight loop expects, and costs no test
    options = {"error_model": "numpy", "_nrt": makes_arrays}
    before = numba.config.CACHE_DIR
    try:
        numba.config.CACHE_DIR = str(_folder((function, *helpers)))
        result: F = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no home, or no writable cache: compiled in every process
        result = numba.njit(**options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return result


@cache
def _registered(register: Callable[..., Any], helper: Callable[..., Any], makes_arrays: bool) -> None:
    """Register a helper once; inlined into a flight loop, of which calls that pass arrays cost a quarter."""
    register(forceinline=not makes_arrays, _nrt=makes_arrays)(helper)


def in_loops(loops: Callable[..., Any]) -> Callable[[F], F]:
    """Compile `loops` in place of the function decorated, whose arrays are fast without numba but slow to compile."""

    def decorate(function: F) -> F:
        _in_loops[function] = loops
        return function

    return decorate


@cache
def _replaced(overload: Callable[..., Any], helper: Callable[..., Any]) -> None:
    overload(helper, strict=False)(lambda *_: _in_loops[helper])


@cache
def _sources() -> bytes:
    """Hash of the package's sources: compiled code holds constants of modules other than its own."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).resolve().parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()


def _folder(functions: tuple[Callable[..., Any], ...]) -> Path:
    """Cache folder of the machine code of functions: under NUMBA_CACHE_DIR if set, else in the user's cache."""
    digest = hashlib.sha256()
    for name in sorted({inspect.getfile(function) for function in functions}):
        digest.update(Path(name).read_bytes())
    return _home() / digest.hexdigest()[:16]


def _home() -> Path:
    own = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(own) if own else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "eadp" / _sources().hex()[:16]


def kept() -> bool:
    """Whether machine code of these sources is kept, from another process or this one."""
    try:
        return any(_home().rglob("*.nbi"))
    except (OSError, RuntimeError):  # no home, or none that can be read
        return False

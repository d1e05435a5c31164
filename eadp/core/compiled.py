"""The one door to numba: functions of numbers and arrays, compiled to machine code where `eadp[fast]` is installed.

A function is written once. It runs as plain Python, or compiled after `enable`: importing numba takes half a second,
more than one flight gains. Both do the same arithmetic in the same order, except for sums over arrays, which numpy adds
pairwise. There is no fast-math, so nothing else is reassociated.

Machine code is cached between processes, in a folder named by a hash of the sources: numba itself checks the file of
the outermost function alone, and would keep code of a helper that has changed.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeVar

from eadp.plug_ins import sources_hash

F = TypeVar("F", bound=Callable[..., Any])

_on = False
_registered: set[Callable[..., Any]] = set()


@cache
def available() -> bool:
    """Whether functions can be compiled; imports numba."""
    try:
        importlib.import_module("numba")
    except Exception:  # not installed, or for example built for another numpy: numba is optional
        return False
    return True


def enable(on: bool = True) -> bool:
    """Turn compiled code on or off for this process; returns whether it is on."""
    global _on
    _on = on and available()
    return _on


def enabled() -> bool:
    """Whether compiled code is used."""
    return _on


def jitted(function: F, makes_arrays: bool = True) -> F:
    """The compiled form of a function where compiled code is enabled, else the function.

    What it calls of this package by name, directly or indirectly, is compiled with it.

    Parameters
    ----------
    function : function
        Its arguments are numbers, arrays, None and other types that numba supports.
    makes_arrays : bool
        Whether it makes arrays or lists. Where it does not, numba counts no references to arrays and inlines what is
        called. Measured: with references counted the flight loop takes 1.55 times as long, with calls 1.13 times.
    """
    return _compiled(function, makes_arrays) if _on else function


@cache
def _compiled(function: F, makes_arrays: bool) -> F:
    import numba
    from numba.extending import register_jitable

    for helper in helpers_of(function) - _registered:
        register_jitable(forceinline=not makes_arrays, _nrt=makes_arrays)(helper)
        _registered.add(helper)
    # error_model: a division by zero gives an infinity, as the flight loop expects, and costs no test
    options = {"error_model": "numpy", "_nrt": makes_arrays}
    before = numba.config.CACHE_DIR
    try:
        numba.config.CACHE_DIR = str(_home())
        result: F = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # no home, or no writable cache: compiled in every process
        result = numba.njit(**options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return result


def helpers_of(function: Callable[..., Any]) -> set[Callable[..., Any]]:
    """The functions of a function's own package that it calls by name, directly or indirectly."""
    found, to_read = set[Callable[..., Any]](), [(function.__code__, function.__globals__)]
    while to_read:
        code, names = to_read.pop()
        # code within code: comprehensions
        to_read += [(part, names) for part in code.co_consts if isinstance(part, CodeType)]
        for called in map(names.get, code.co_names):
            if isinstance(called, FunctionType) and _package(called) == _package(function) and called not in found:
                found.add(called)
                to_read.append((called.__code__, called.__globals__))
    return found - {function}


def _package(function: Callable[..., Any]) -> str:
    return function.__module__.partition(".")[0]


def _home() -> Path:
    """Cache folder of machine code of these sources: under NUMBA_CACHE_DIR if set, else in the user's cache.

    All of the package's: compiled code holds constants of modules other than its own.
    """
    own = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(own) if own else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "eadp" / sources_hash((Path(__file__).resolve().parents[1],))[:16]

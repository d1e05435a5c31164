"""The one door to numba: functions of numbers and arrays, compiled to machine code where `eadp[fast]` is installed.

A function is written once. It runs as plain Python, or compiled once a process has been told to (`enable`): numba
takes half a second to import, which one flight is not worth. Both do the same arithmetic in the same order but for sums
over arrays, which numpy adds up pairwise; no fast-math: nothing else is reassociated.

Machine code is kept between processes, in a folder named by the sources that it was made from: numba itself looks at
the file of the outermost function alone, and would keep code of a helper that has changed.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

F = TypeVar("F", bound=Callable[..., Any])

_on = False


@cache
def available() -> bool:
    """Whether there is a numba that can be imported; what is slow about it is done then."""
    if importlib.util.find_spec("numba") is None:
        return False
    try:
        importlib.import_module("numba")
    except Exception:  # made for another numpy, or whatever: it is an extra
        return False
    return True


def enable(on: bool = True) -> bool:
    """Use compiled code from here on in this process, or no longer; whether it is used."""
    global _on
    _on = on and available()
    return _on


def enabled() -> bool:
    """Whether compiled code is used."""
    return _on


def jitted(function: F, *helpers: Callable[..., Any]) -> F:
    """A function, or where `enable` says so its compiled form.

    Parameters
    ----------
    function : function
        Of numbers, arrays and None, and of what numba knows.
    *helpers : function
        All functions of ours that it calls, directly or not.
    """
    return _compiled(function, helpers) if _on else function


@cache
def _compiled(function: F, helpers: tuple[Callable[..., Any], ...]) -> F:
    import numba
    from numba.extending import register_jitable

    for helper in helpers:
        _registered(register_jitable, helper)
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(_folder((function, *helpers)))
    try:
        # error_model: a division by zero gives an infinity, as the flight loop expects, and costs no test
        result: F = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # nowhere to keep it: compiled anew in every process
        result = numba.njit(error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR = before
    return result


@cache
def _registered(register: Callable[..., Any], helper: Callable[..., Any]) -> None:
    """Registered once, and put into its callers: calls that pass arrays cost a quarter of the flight loop."""
    register(forceinline=True)(helper)


@cache
def _sources() -> bytes:
    """A hash of all our sources: compiled code holds constants of modules other than its own."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).resolve().parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.digest()


def _folder(functions: tuple[Callable[..., Any], ...]) -> Path:
    """Where machine code of functions is kept: beside numba's own if that has a place, else in the user's cache."""
    digest = hashlib.sha256(_sources())
    for name in sorted({inspect.getfile(function) for function in functions}):
        digest.update(Path(name).read_bytes())
    own = os.environ.get("NUMBA_CACHE_DIR")
    home = Path(own) if own else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "eadp" / digest.hexdigest()[:16]

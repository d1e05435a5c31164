"""How options, which are fields of dataclasses, are written on the command line.

A field's name, type, docstring and default are the option's. The command line is built from them, and its names stand
in faults.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import sys
from dataclasses import dataclass, is_dataclass

from eadp.errors import InputError


@dataclass(frozen=True)
class Flag:
    """What a field's name and type do not say of its option; an annotation of the type.

    Attributes
    ----------
    names : str
        Names, separated by spaces, as in `-o --out`; by default the field's, without its unit.
    metavar : str
        What stands for the value in the help; by default that of the field's unit.
    low, high : float or None
        Bounds of the value.
    """

    names: str = ""
    metavar: str = ""
    low: float | None = None
    high: float | None = None


UNITS = {
    "_per_s": "PER_S",
    "_mps": "MPS",
    "_deg": "DEG",
    "_ah": "AH",
    "_m": "METRES",
    "_s": "SECONDS",
    "_w": "W",
    "_mm": "MM",
    "_cm": "CM",
    "_px": "PX",
}
"""What stands for a value in the help, by the unit that ends its field's name."""

KEPT = ("_mm", "_px")
"""Units that are part of an option's name."""


def check_range(option: str, value: float, low: float, high: float, *, closed: bool = False) -> None:
    """Refuse a value of an option that is not above a bound, or with `closed` is below it, or is above another.

    Raises
    ------
    InputError
        At the option.
    """
    if not (math.isfinite(value) and (low < value <= high or (closed and value == low))):
        most = f", at most {high:g}" if math.isfinite(high) else ""
        expected = f"from {low:g} to {high:g}" if closed else f"above {low:g}{most}"
        raise InputError.at(option, 1, 1, f"{value:g} is out of range", expected, f"{value:g}")


def option_name(field: str) -> str:
    """The option of a field, where it has no other name."""
    unit = next((unit for unit in UNITS if field.endswith(unit) and unit not in KEPT), "")
    return "--" + field.removesuffix(unit).rstrip("_").replace("_", "-")


def attribute_docstrings(kind: type) -> dict[str, str]:
    """The texts under a dataclass's fields, those that it inherits among them, by field."""
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        if is_dataclass(base):
            texts |= _of_module(base.__module__).get(base.__name__, {})
    return texts


@functools.cache
def _of_module(module: str) -> dict[str, dict[str, str]]:
    """The texts under the fields of a module's classes."""
    found: dict[str, dict[str, str]] = {}
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    for node in (each for each in ast.walk(tree) if isinstance(each, ast.ClassDef)):
        texts = found.setdefault(node.name, {})
        for one, after in zip(node.body, node.body[1:], strict=False):
            if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name) and isinstance(after, ast.Expr):
                texts[one.target.id] = inspect.cleandoc(ast.literal_eval(after.value))
    return found

"""The docstrings of a dataclass's attributes: help of options, and descriptions in schemas."""

from __future__ import annotations

import ast
import functools
import inspect
import sys
from dataclasses import is_dataclass


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

"""What a schema finds wrong with a YAML document, in this project's words and at its place."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from eadp.errors import Fault, capped, printable
from eadp.io.text.yaml import Document

Model = TypeVar("Model", bound=BaseModel)
_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "list_type": "a list",
    "model_type": "a mapping of keys",
    "dict_type": "a mapping of keys",
}
_INNER = re.compile(r"[a-z-]+(\[.*\])?\Z")  # pydantic's names of a union's members: float, literal['period']


def validated(
    model: type[Model], document: Document, value: Any, check: Callable[[Model], list[Fault]] | None = None
) -> Model:
    """A document's value as a schema's model.

    Raises
    ------
    InputError
        With every fault of the schema, or of `check`.
    """
    try:
        content = model.model_validate(value)
    except ValidationError as error:
        raise capped(_merged([schema_fault(document, problem, model) for problem in error.errors()])) from None
    faults = check(content) if check is not None else []
    if faults:
        raise capped(faults)
    return content


def _merged(faults: list[Fault]) -> list[Fault]:
    """Faults of one value that fits no member of a union, as one: each member is what was expected."""
    merged: dict[tuple[str, int, int, str], Fault] = {}
    for fault in faults:
        key = (fault.file, fault.line, fault.column, fault.message)
        before = merged.get(key)
        both = f"{before.expected} or {fault.expected}" if before and before.expected else fault.expected
        merged[key] = replace(fault, expected=both)
    return list(merged.values())


def schema_fault(document: Document, problem: Any, model: type[BaseModel]) -> Fault:
    """One of pydantic's complaints."""
    kind, value = problem["type"], problem["input"]
    path = _document_path(document, problem["loc"])
    key = ".".join(printable(str(part), 80) for part in path)
    if kind == "missing":
        return document.fault(path, f"the key {key} is missing")
    if kind == "extra_forbidden":
        known = _keys_beside(model, path)
        return document.fault(path, f"unknown key {key}", f"one of {known}" if known else "")
    message = printable(str(problem["msg"]).removeprefix("Value error, "))
    if kind == "value_error":
        return document.fault(path, f"{key}: {message}" if key else message)
    reworded = re.sub(r"^\w+ should (be|have|match) ", "", message).partition(" after validation")[0]
    expected = _EXPECTED.get(kind, reworded)
    shown = printable(repr(value), 60)
    if isinstance(value, dict | list | tuple):
        shown = "a mapping" if isinstance(value, dict) else f"a list of {len(value)}"
    return document.fault(path, f"{key} cannot be {shown}", expected)


def _document_path(document: Document, location: tuple[str | int, ...]) -> tuple[str | int, ...]:
    """The part of pydantic's path that stands in the document."""
    path: tuple[str | int, ...] = ()
    for part in location:
        if part == "[key]":
            continue
        union = isinstance(part, str) and _INNER.match(part) and part is location[-1]
        if union and not isinstance(_at(document.value, path), dict):
            continue  # the name of a union's member
        path = (*path, part)
    return path


def _at(value: Any, path: tuple[str | int, ...]) -> Any:
    """The value at a path, or None."""
    for part in path:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return None
    return value


def _keys_beside(model: Any, path: tuple[str | int, ...]) -> str:
    """The keys that a schema has where an unknown one stands."""
    for part in path[:-1]:
        inner = model.model_fields.get(part) if isinstance(part, str) else None
        if inner is None or not (isinstance(inner.annotation, type) and issubclass(inner.annotation, BaseModel)):
            return ""
        model = inner.annotation
    return ", ".join(item.alias or name for name, item in model.model_fields.items())

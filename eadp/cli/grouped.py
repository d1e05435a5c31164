"""Options of a command from the fields of dataclasses: name, type, help and default stand there alone."""

from __future__ import annotations

import contextlib
import inspect
import os
import types
from collections.abc import Callable, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import StrEnum
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from typer import Option

from eadp.io.text.docstrings import attribute_docstrings
from eadp.io.text.options import UNITS, Flag, option_name


@dataclass(frozen=True)
class StderrOptions:
    """What every command writes on standard error."""

    quiet: Annotated[bool, Flag("-q --quiet")] = False
    """Write nothing but errors on standard error: no progress, no warnings."""

    faults: Literal["text", "json"] = "text"
    """How to print errors and warnings: json is a document a line, eadp.faults/1."""


def grouped(command: Callable[..., int], *, texts: bool = True) -> Callable[..., int]:
    """A command whose parameters that are dataclasses become an option for each of their fields, with its text."""
    hints = get_type_hints(command, include_extras=True)
    hints.pop("return", None)
    parameters: list[inspect.Parameter] = []
    groups: dict[str, type] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        if is_dataclass(hints[name]):
            groups[name] = hints[name]
            parameters += _options(hints[name], texts=texts)
        else:
            parameters.append(parameter.replace(annotation=hints[name], kind=inspect.Parameter.KEYWORD_ONLY))

    parameters += _options(StderrOptions, texts=texts)

    def run(**given: Any) -> int:
        messages = StderrOptions(**_taken(StderrOptions, given))
        values = {name: kind(**_taken(kind, given)) for name, kind in groups.items()}
        with contextlib.ExitStack() as stack:
            if messages.quiet:
                stack.enter_context(contextlib.redirect_stderr(stack.enter_context(open(os.devnull, "w"))))
            return command(**given, **values)

    run.__doc__ = command.__doc__
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _taken(kind: type, given: dict[str, Any]) -> dict[str, Any]:
    """The values of a dataclass's fields, taken out of those given; a field keeps its default where none is."""
    values = {field.name: given.pop(field.name) for field in _fields(kind)}
    return {name: getattr(value, "value", value) for name, value in values.items() if value is not None}


def _fields(kind: Any) -> tuple[Field[Any], ...]:
    return fields(kind)


def _options(kind: Any, *, texts: bool) -> list[inspect.Parameter]:
    hints, found = get_type_hints(kind, include_extras=True), attribute_docstrings(kind) if texts else {}
    helps = {name: text.replace("\n", " ").replace("`", "") for name, text in found.items()}
    return [_option(field, hints[field.name], helps.get(field.name, "")) for field in _fields(kind)]


def _option(field: Field[Any], hint: Any, text: str) -> inspect.Parameter:
    """The option of a field."""
    flag, kind = Flag(), hint
    if get_origin(hint) is Annotated:
        kind, *notes = get_args(hint)
        flag = next((note for note in notes if isinstance(note, Flag)), flag)
    kind, default = _plain(field.name, kind), None if field.default is MISSING else field.default
    metavar = flag.metavar or next((word for unit, word in UNITS.items() if field.name.endswith(unit)), None)
    names = flag.names.split() or [option_name(field.name)]
    if get_origin(kind) is list or default == "":
        default = None
    if default is None:
        kind = kind | None
    metavar = None if kind is bool else metavar
    option = Option(*names, help=text, metavar=metavar, min=flag.low, max=flag.high)
    annotation = Annotated[kind, option]  # type: ignore[valid-type]
    return inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _plain(name: str, kind: Any) -> Any:
    """The type that an option's text is read as: of several the text, which the use case reads."""
    if get_origin(kind) is Literal:
        return StrEnum(name, {str(value): str(value) for value in get_args(kind)})
    if get_origin(kind) in (Union, types.UnionType):
        kinds = [each for each in get_args(kind) if each is not type(None)]
        return str if str in kinds else _plain(name, kinds[0])
    if get_origin(kind) is not None and issubclass(get_origin(kind), Sequence) and get_origin(kind) is not tuple:
        return list[str]
    return kind

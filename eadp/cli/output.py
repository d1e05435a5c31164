"""Output of every command: results on stdout, progress and warnings on stderr."""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import re
import sys
import time
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from enum import StrEnum
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from typer import Option

from eadp.errors import Fault, InputError, first_faults
from eadp.io.text.options import UNITS, Flag, attribute_docstrings, option_name

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Characters that command a terminal, or turn the direction of writing."""


def escaped(text: str) -> str:
    """A text, of a file too, as it may be printed: characters that command a terminal are escaped, as JSON has them."""
    return _CONTROL.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def emit(text: str) -> None:
    """Print a result, ending in one newline."""
    sys.stdout.write(escaped(text if text.endswith("\n") else text + "\n"))


def emit_json(document: Mapping[str, Any]) -> None:
    """Print one JSON document; NaN and infinities are refused, as JSON has none."""
    plain = not (getattr(sys.stdout, "encoding", None) or "utf-8").lower().startswith("utf")
    emit(json.dumps(document, indent=2, ensure_ascii=plain, allow_nan=False))


def warn(warnings: Iterable[Fault]) -> None:
    """Print warnings on stderr: the first of them, and the number of the rest."""
    if shown := first_faults(warnings):
        sys.stderr.write(faults_text(shown))


_stderr: ContextVar[Any] = ContextVar("_stderr", default=None)
"""Standard error where `--quiet` hides it."""


def alarm(text: str | None) -> None:
    """A warning that `--quiet` does not hide, on stderr, if there is one."""
    if text is not None:
        (_stderr.get() or sys.stderr).write(escaped(f"eadp: warning: {text}\n"))


def faults_text(faults: Sequence[Fault]) -> str:
    """Faults as lines."""
    return escaped("".join(f"{fault}\n" for fault in faults))


def usage_fault(option: str, raw: str, message: str, expected: str) -> InputError:
    """An error in the value of an option, placed in the option's own text."""
    return InputError.at(option, 1, 1, message, expected, raw)


class Progress:
    """A progress line on stderr: redrawn on a terminal once a job has taken a second, else a line every 10 s.

    `every_s` is the time between two lines where there is no terminal [s].
    """

    def __init__(self, title: str, every_s: float = 10.0) -> None:
        self._title = title
        self._every_s = every_s
        self._terminal = sys.stderr.isatty()
        self._due_s = time.monotonic() + (1.0 if self._terminal else every_s)

    def show(self, status: str) -> None:
        """Draw the line if it is time to."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + (0.2 if self._terminal else self._every_s)
        line = escaped(f"{self._title}: {status}")
        sys.stderr.write(f"\r{line}\x1b[K" if self._terminal else f"{line}\n")
        sys.stderr.flush()

    def close(self) -> None:
        """Clear the line from a terminal."""
        if self._terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


@dataclass(frozen=True)
class StderrOptions:
    """What every command writes on standard error."""

    quiet: Annotated[bool, Flag("-q --quiet")] = False
    """Write nothing but errors and failed runs of the solver on standard error: no progress, no other warnings."""


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
                stack.callback(_stderr.reset, _stderr.set(sys.stderr))
                stack.enter_context(contextlib.redirect_stderr(stack.enter_context(open(os.devnull, "w"))))
            return command(**given, **values)

    run.__doc__ = command.__doc__
    run.__annotations__ = {each.name: each.annotation for each in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _taken(kind: Any, given: dict[str, Any]) -> dict[str, Any]:
    """The values of a dataclass's fields, taken out of those given; a field keeps its default where none is."""
    values = {field.name: given.pop(field.name) for field in fields(kind)}
    return {name: getattr(value, "value", value) for name, value in values.items() if value is not None}


def _options(kind: Any, *, texts: bool) -> list[inspect.Parameter]:
    hints, found = get_type_hints(kind, include_extras=True), attribute_docstrings(kind) if texts else {}
    # the section of the help is that of the class which has the field
    sections = {
        name: vars(base).get("SECTION")
        for base in reversed(kind.__mro__)
        for name in vars(base).get("__annotations__", ())
    }
    helps = {name: text.replace("\n", " ").replace("`", "") for name, text in found.items()}
    return [
        _option(field, hints[field.name], helps.get(field.name, ""), sections.get(field.name)) for field in fields(kind)
    ]


def _option(field: Field[Any], hint: Any, text: str, section: str | None) -> inspect.Parameter:
    """The option of a field, in a section of the help."""
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
    option = Option(*names, help=text, metavar=metavar, min=flag.low, max=flag.high, rich_help_panel=section)
    annotation = Annotated[kind, option]  # type: ignore[valid-type]
    return inspect.Parameter(field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def _plain(name: str, kind: Any) -> Any:
    """The type that an option's text is read as: of several the text, which the use case reads."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Literal:
        return StrEnum(name, {str(value): str(value) for value in parts})
    if origin in (Union, types.UnionType):
        kinds = [each for each in parts if each is not type(None)]
        return str if str in kinds else _plain(name, kinds[0])
    return list[str] if origin in (Sequence, list) else kind

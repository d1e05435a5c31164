"""The public functions as their users call them: wrong types are errors of eadp, which name arguments, not options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from numpy.typing import ArrayLike

from eadp.errors import Fault, InputError, printable, refuse
from eadp.io.text.options import Flag, option_name

P = ParamSpec("P")
R = TypeVar("R")

_NUMBERS: dict[Any, tuple[Any, str]] = {float: (Real, "a number"), int: (Integral, "a whole number")}
_WORDS: dict[Any, str] = {str: "a text", bool: "True or False", Mapping: "a mapping", Callable: "a function"}
_WORDS |= dict.fromkeys((Iterable, Sequence), "a sequence")


def public(function: Callable[P, R]) -> Callable[P, R]:
    """A function that checks the types of its arguments, and whose errors name them."""
    signature, hints = _signature(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        given = signature.bind(*args, **kwargs).arguments
        refuse([fault for name, value in given.items() for fault in _faults(name, value, hints[name])])
        try:
            return function(*args, **kwargs)
        except InputError as error:
            names = {option: name for hint in hints.items() for option, name in _options(*hint)} | {
                "--set": "overrides"
            }
            error.faults = [_of_arguments(fault, names) for fault in error.faults]
            error.args = ("\n".join(map(str, error.faults)),)
            raise

    call.__module__ = "eadp"  # pickle finds it there
    call.__signature__ = signature  # type: ignore[attr-defined]
    return call


def _signature(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """The arguments of a function and their types; the keywords of a `TypedDict` are arguments like others."""
    signature, hints = inspect.signature(function), get_type_hints(function, include_extras=True)
    *own, last = signature.parameters.values()
    if last.kind is not last.VAR_KEYWORD:
        return signature, hints
    keywords = get_type_hints(get_args(hints.pop(last.name))[0])
    own += [inspect.Parameter(key, last.KEYWORD_ONLY, default=None, annotation=kind) for key, kind in keywords.items()]
    return signature.replace(parameters=own), hints | keywords


def _faults(name: str, value: Any, hint: Any) -> Iterator[Fault]:
    if not _fits(value, hint):
        expected = " or ".join(dict.fromkeys(_words(hint)))
        yield Fault(name, 1, 1, f"cannot be {printable(repr(value), 60)}", expected)
    elif _is_options(type(value)):
        own = get_type_hints(type(value), include_extras=True)
        for field in fields(value):
            yield from _faults(f"{name}.{field.name}", getattr(value, field.name), own[field.name])


def _is_options(kind: Any) -> bool:
    return isinstance(kind, type) and is_dataclass(kind) and kind.__name__.endswith("Options")


def _fits(value: Any, hint: Any) -> bool:
    origin, parts = get_origin(hint), get_args(hint)
    if hint == ArrayLike:
        return True
    if origin is Annotated:
        return _fits(value, parts[0])
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is Literal:
        return value in parts
    kind = origin or hint
    if kind in _NUMBERS:
        return isinstance(value, _NUMBERS[kind][0]) and not isinstance(value, bool)
    if kind is tuple:
        kind = tuple | list
    return not isinstance(kind, type | UnionType) or isinstance(value, kind)


def _words(hint: Any) -> Iterator[str]:
    """What a type is, in words."""
    if get_origin(hint) in (Union, UnionType, Annotated):
        parts = get_args(hint)[:1] if get_origin(hint) is Annotated else get_args(hint)
        names = [word for part in parts if part is not NoneType for word in _words(part)]
        path = "PathLike" in names  # a text is its name
        yield from ("a path" if name == "PathLike" else name for name in names if not (path and name == "a text"))
    else:
        kind = get_origin(hint) or hint
        yield _NUMBERS[kind][1] if kind in _NUMBERS else _WORDS.get(kind, getattr(kind, "__name__", str(kind)))


def _options(name: str, hint: Any) -> Iterator[tuple[str, str]]:
    """The command line's names of an argument, and of the fields of options."""
    yield option_name(name), name
    for kind in filter(_is_options, (hint, *get_args(hint))):
        own = get_type_hints(kind, include_extras=True)
        for field in fields(kind):
            flags = [each.names for each in get_args(own[field.name]) if isinstance(each, Flag) and each.names]
            for option in (flags[0] if flags else option_name(field.name)).split():
                yield option, f"{name}.{field.name}"


def _of_arguments(fault: Fault, names: Mapping[str, str]) -> Fault:
    def name(match: re.Match[str]) -> str:
        return names.get(match[0], match[0][2:].replace("-", "_"))

    def named(text: str) -> str:
        return re.sub(r"(?<![\w-])--[a-z][a-z-]*", name, text)

    return replace(fault, file=named(fault.file), message=named(fault.message), expected=named(fault.expected))

"""Configurations of computations in options: of a recorded trace, in a file's name, to measure, or to evaluate."""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from eadp.errors import InputError, printable
from eadp.io.profile.measurements import A_NAME, LARGEST, NAME, PARAMETERS_LIMIT, Configuration, read_heading
from eadp.io.text.csv import NUMBER

CONFIGURATIONS_LIMIT = 1000
"""Most configurations of one measurement."""

STARS_LIMIT = 2
"""Most stars in a pattern of names: more match in too many ways, and take long to try."""

_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")
_A_CONFIGURATION = "NAME=VALUE, as in fps=0.5"
_A_SWEEP = "NAME=FROM:TO:STEP, as in fps=2:10:2"


@dataclass(frozen=True)
class _Axis:
    """The values of one parameter."""

    name: str
    unit: str
    values: tuple[float, ...]


def parse_configuration(raw: str) -> Configuration:
    """Read `fps=0.5,keysize=32`, the configuration of a recorded trace: one value for each parameter.

    Raises
    ------
    InputError
        With the faults of the option `--config`.
    """
    axes = _axes(raw)
    for axis in axes:
        if len(axis.values) > 1:
            raise InputError.at("--config", 1, 1, f"{len(axis.values)} values of {axis.name}", "one for a trace", raw)
    return next(iter(_product([axes])))


def configuration_in_name(path: str, pattern: str) -> Configuration:
    """The configuration in a file's name, as `*_{fps}fps` finds 0.5 in `landing_trace_0.5fps.csv`.

    Parameters
    ----------
    path : str
        The file; its folders are ignored, and its ending unless the pattern has it.
    pattern : str
        Text with each parameter's name in braces in place of its value; `*` is any text.

    Raises
    ------
    InputError
        If the pattern, `--from-name`, has no parameter or a wrong one, or the name does not match it.
    """
    names = _PLACEHOLDER.findall(pattern)
    for name in names:
        if not NAME.match(name):
            raise InputError.at("--from-name", 1, 1, f"{printable(name, 80) or 'an empty text'} is no name", A_NAME)
    if not names or len(set(names)) < len(names) or len(names) > PARAMETERS_LIMIT:
        expected = "each parameter once in braces, as in '*_{fps}fps'"
        raise InputError.at("--from-name", 1, 1, "a pattern without parameters, or with one twice", expected, pattern)
    between = _PLACEHOLDER.split(pattern)[::2]
    if pattern.count("*") > STARS_LIMIT or not all(text.strip("*") for text in between[1:-1]):
        expected = f"at most {STARS_LIMIT} stars, and text between two parameters"
        raise InputError.at("--from-name", 1, 1, "a pattern that matches in too many ways", expected, pattern)
    literals = [".*?".join(map(re.escape, text.split("*"))) for text in between]
    expression = re.compile(r"([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)".join(literals))
    base = os.path.basename(path)
    found = expression.fullmatch(base) or expression.fullmatch(os.path.splitext(base)[0])
    if not found or not all(NUMBER.match(text) and abs(float(text)) <= LARGEST for text in found.groups()):
        message = f"the name does not match {printable(pattern)}"
        raise InputError.at(path, 1, 1, message, "a name that --from-name matches")
    return Configuration(tuple(names), ("",) * len(names), tuple(map(float, found.groups())))


def configurations_to_measure(stated: Sequence[str], sweeps: Sequence[str]) -> list[Configuration]:
    """The configurations to measure, in order, each once.

    `fps=2,4,keysize=32,448` are all four combinations; another option of the same parameters adds to them, and one of
    other parameters is combined with them.

    Parameters
    ----------
    stated : sequence of str
        Values of `--config`, as in `fps=2,4,6`.
    sweeps : sequence of str
        Values of `--sweep`, as in `fps=2:10:2`, both ends included.

    Raises
    ------
    InputError
        Where they cannot be read, share some parameters but not all, or are more than `CONFIGURATIONS_LIMIT`.
    """
    groups: dict[frozenset[str], list[list[_Axis]]] = {}
    for option, raw in [*(("--config", raw) for raw in stated), *(("--sweep", raw) for raw in sweeps)]:
        axes = _axes(raw) if option == "--config" else [_sweep(raw)]
        names = frozenset(axis.name for axis in axes)
        clash = [other for other in groups if other != names and other & names]
        if clash:
            shared = ", ".join(sorted(clash[0] & names))
            expected = "options with the same parameters, or with none in common"
            raise InputError.at(option, 1, 1, f"{shared} stands beside other parameters before", expected, raw)
        groups.setdefault(names, []).append(axes)
    if not groups:
        raise InputError.at("--config", 1, 1, "nothing to measure", "configurations, as in --config fps=2,4,6")
    count = math.prod(sum(math.prod(len(axis.values) for axis in axes) for axes in group) for group in groups.values())
    if count > CONFIGURATIONS_LIMIT:
        raise InputError.at("--config", 1, 1, f"{count} configurations", f"at most {CONFIGURATIONS_LIMIT}")
    unions = [list(dict.fromkeys(_product(group))) for group in groups.values()]
    joined = [_joined(parts) for parts in itertools.product(*unions)]
    if len(joined[0].names) > PARAMETERS_LIMIT:
        raise InputError.at("--config", 1, 1, f"{len(joined[0].names)} parameters", f"at most {PARAMETERS_LIMIT}")
    return joined


def _product(group: Iterable[Sequence[_Axis]]) -> Iterable[Configuration]:
    """All combinations of each list of axes, one list after the other, parameters in the first list's order."""
    order: list[str] = []
    for axes in group:
        order = order or [axis.name for axis in axes]
        sorted_axes = sorted(axes, key=lambda axis: order.index(axis.name))
        names, units = tuple(axis.name for axis in sorted_axes), tuple(axis.unit for axis in sorted_axes)
        for values in itertools.product(*(axis.values for axis in sorted_axes)):
            yield Configuration(names, units, values)


def _joined(parts: Sequence[Configuration]) -> Configuration:
    return Configuration(
        tuple(name for part in parts for name in part.names),
        tuple(unit for part in parts for unit in part.units),
        tuple(value for part in parts for value in part.values),
    )


def _axes(raw: str) -> list[_Axis]:
    """Read `fps=2,4,keysize=32`: a piece without a name is another value of the parameter before it."""
    axes: list[_Axis] = []
    column = 1
    for piece in raw.split(","):
        title, equals, text = piece.rpartition("=")
        if equals:
            name, unit = _named("--config", title, raw, column)
            if name in [axis.name for axis in axes]:
                raise InputError.at("--config", 1, column, f"{name} stands twice", "each once", raw)
            axes.append(_Axis(name, unit, ()))
        elif not axes:
            shown = printable(piece.strip(), 80) or "an empty text"
            raise InputError.at("--config", 1, column, f"{shown} is no name=value", _A_CONFIGURATION, raw)
        last = axes[-1]
        values = (*last.values, _number("--config", text, last.name, _A_CONFIGURATION, raw, column))
        axes[-1] = _Axis(last.name, last.unit, values)
        column += len(piece) + 1
    return axes


def _sweep(raw: str) -> _Axis:
    """Read `fps=2:10:2`: from, to (included where a step reaches it) and step."""
    title, equals, text = raw.rpartition("=")
    if not equals or text.count(":") != 2:
        raise InputError.at("--sweep", 1, 1, f"{printable(raw, 80) or 'an empty text'} is no sweep", _A_SWEEP, raw)
    name, unit = _named("--sweep", title, raw, 1)
    first, last, step = (_number("--sweep", part, name, _A_SWEEP, raw, 1) for part in text.split(":"))
    # a hair above the whole, so that 0.1 to 0.3 by 0.1 ends at 0.3
    count = math.floor((last - first) / step * (1 + 1e-12) + 1e-9) + 1 if step else 0
    if not 0 < count <= CONFIGURATIONS_LIMIT:
        message = f"a sweep of {count} values" if count > 0 else "a sweep whose step does not lead from first to last"
        raise InputError.at("--sweep", 1, 1, message, f"1 to {CONFIGURATIONS_LIMIT} values", raw)
    # the digits that were typed, not 0.30000000000000004
    return _Axis(name, unit, tuple(float(f"{first + k * step:.12g}") for k in range(count)))


def _named(option: str, title: str, raw: str, column: int) -> tuple[str, str]:
    """A parameter's name and unit, as in `fps` or `fps [1/s]`."""
    heading = read_heading(title.strip())
    if problem := heading.problem or ("a power is no parameter" if heading.per_watt else ""):
        raise InputError.at(option, 1, column, problem, A_NAME, raw)
    return heading.name, heading.unit


def _number(option: str, text: str, name: str, expected: str, raw: str, column: int) -> float:
    if NUMBER.match(text.strip()) and abs(float(text)) <= LARGEST:
        return float(text)
    message = f"{name} is {printable(text.strip(), 80) or 'empty'}, not a finite number"
    raise InputError.at(option, 1, column, message, expected, raw)

"""Configurations of computations in options: of a recorded trace, in a file's name, to measure, or to evaluate."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated

from eadp.errors import InputError, printable
from eadp.io.profile.measurements import A_NAME, LARGEST, PARAMETERS_LIMIT, Configuration, read_heading
from eadp.io.text.csv import NUMBER
from eadp.io.text.options import Flag, check_range, option_name

if TYPE_CHECKING:
    from eadp.core.signals import SampleMean


CONFIGURATIONS_LIMIT = 1000
"""Most configurations of one measurement."""

_A_CONFIGURATION = "NAME=VALUE, as in fps=0.5"


@dataclass(frozen=True)
class _Axis:
    """The values of one parameter."""

    name: str
    unit: str
    values: list[float]


def parse_configuration(raw: str, option: str = "--config", expected: str = _A_CONFIGURATION) -> Configuration:
    """Read `fps=0.5,keysize=32`, a configuration: one value for each parameter; raises InputError at the option."""
    axes = _axes(raw, option, expected)
    for axis in axes:
        if len(axis.values) > 1:
            raise InputError.at(option, 1, 1, f"{len(axis.values)} values of {axis.name}", "one", raw)
    return next(iter(_product([axes])))


def configurations_to_measure(stated: Sequence[str]) -> list[Configuration]:
    """The configurations to measure, in order, each once.

    `fps=2,4,keysize=32,448` are all four combinations; another option of the same parameters adds to them.

    Parameters
    ----------
    stated : sequence of str
        Values of `--config`, as in `fps=2,4,6`.

    Raises
    ------
    InputError
        Where they cannot be read, are of other parameters, or are more than `CONFIGURATIONS_LIMIT`.
    """
    if not stated:
        raise InputError.at("--config", 1, 1, "nothing to measure", "configurations, as in --config fps=2,4,6")
    group = [_axes(raw) for raw in stated]
    first, *others = (sorted(axis.name for axis in axes) for axes in group)
    for names, raw in zip(others, stated[1:], strict=True):
        if names != first:
            raise InputError.at("--config", 1, 1, "other parameters than before", f"values of {', '.join(first)}", raw)
    if len(first) > PARAMETERS_LIMIT:
        raise InputError.at("--config", 1, 1, f"{len(first)} parameters", f"at most {PARAMETERS_LIMIT}")
    count = sum(math.prod(len(axis.values) for axis in axes) for axes in group)
    if count > CONFIGURATIONS_LIMIT:
        raise InputError.at("--config", 1, 1, f"{count} configurations", f"at most {CONFIGURATIONS_LIMIT}")
    return list(dict.fromkeys(_product(group)))


def _product(group: Iterable[Sequence[_Axis]]) -> Iterable[Configuration]:
    """All combinations of each list of axes, one list after the other, parameters in the first list's order."""
    order: list[str] = []
    for axes in group:
        order = order or [axis.name for axis in axes]
        sorted_axes = sorted(axes, key=lambda axis: order.index(axis.name))
        names, units = tuple(axis.name for axis in sorted_axes), tuple(axis.unit for axis in sorted_axes)
        for values in itertools.product(*(axis.values for axis in sorted_axes)):
            yield Configuration(names, units, values)


def _axes(raw: str, option: str = "--config", form: str = _A_CONFIGURATION) -> list[_Axis]:
    """Read `fps=2,4,keysize=32`: a piece without a name is another value of the parameter before it."""
    axes: list[_Axis] = []
    column = 1
    for piece in raw.split(","):
        title, equals, text = piece.rpartition("=")
        problem, expected = "", form
        if equals:
            heading = read_heading(title.strip())
            axes.append(_Axis(heading.name, heading.unit, []))
            problem, expected = heading.problem or ("a power is no parameter" if heading.per_watt else ""), A_NAME
            if heading.name in [axis.name for axis in axes[:-1]]:
                problem, expected = f"{heading.name} stands twice", "each once"
        elif not axes:
            problem = f"{printable(piece.strip(), 80) or 'an empty text'} is no name=value"
        if not problem and not (NUMBER.match(text.strip()) and abs(float(text)) <= LARGEST):
            shown = printable(text.strip(), 80) or "empty"
            problem, expected = f"{axes[-1].name} is {shown}, not a finite number", form
        if problem:
            raise InputError.at(option, 1, column, problem, expected, raw)
        axes[-1].values.append(float(text))
        column += len(piece) + 1
    return axes


# --- how the power of a command is measured

SHORTEST_INTERVAL_S, MAX_TIME_S = 0.01, 86_400.0
"""Shortest time between two samples [s]: sensors do not change faster; and the longest time at a configuration."""


@dataclass(frozen=True)
class MeasurementSettings:
    """Accuracy and duration of a measurement."""

    warmup_s: float = 5.0
    """Time before the first sample."""

    interval_s: float = 0.2
    """Time from one sample to the next."""

    accuracy_w: float = 0.05
    """Standard error to measure to [W]."""

    longest_s: float = 120.0
    """Longest time at a configuration."""

    def reached(self, found: SampleMean) -> bool:
        """Whether a mean is accurate enough; never where all samples are equal, as of a slow sensor."""
        return found.std > 0 and found.standard_error <= self.accuracy_w


@dataclass(frozen=True)
class MeasureOptions(MeasurementSettings):
    """How the power of a command is measured."""

    config: Annotated[Sequence[str], Flag(metavar="NAME=VALUE,…")] = ()
    """Configuration of a trace, one option for each trace; with --measure, configurations to measure, all combinations:
    fps=2,4,keysize=32,448."""

    sensor: Annotated[str, Flag(metavar="KIND:NAME")] = ""
    """The sensor to read, or its path."""

    sysfs: Annotated[str, Flag(metavar="DIR")] = "/sys"
    """Root of the sensors."""

    def given(self) -> list[str]:
        """Those given, as options; without `--config`, which is not for measuring alone."""
        changed = [each.name for each in fields(self) if getattr(self, each.name) != each.default]
        return [option_name(name) for name in changed if name != "config"]

    def check(self) -> None:
        """Refuse values out of range; raises InputError."""
        check_range("--warmup", self.warmup_s, 0.0, MAX_TIME_S, closed=True)
        check_range("--interval", self.interval_s, SHORTEST_INTERVAL_S, MAX_TIME_S, closed=True)
        check_range("--accuracy", self.accuracy_w, 0.0, math.inf)
        check_range("--longest", self.longest_s, SHORTEST_INTERVAL_S, MAX_TIME_S, closed=True)

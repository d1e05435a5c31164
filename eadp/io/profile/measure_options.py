"""How the power of a command is measured: the options of `eadp profile --measure`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated

from eadp.io.text.options import Flag, check_range, option_name

if TYPE_CHECKING:
    from eadp.core.signals import SampleMean

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

"""The use case of `eadp profile --measure`: options in, the table of measurements out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Annotated

from eadp.api.given import File, Warn, python_warnings
from eadp.errors import Fault, printable
from eadp.io.profile import model_file
from eadp.io.profile.configurations import configurations_to_measure
from eadp.io.scenario import Scenario
from eadp.io.text.options import Flag, check_range, option_name, parse_named
from eadp.io.text.streams import read_text
from eadp.measure import measuring
from eadp.measure.measuring import MeasurementSettings, check_command, mean_text, measure, measurements_csv
from eadp.measure.power_sensor import choose_sensor
from eadp.models.profile import AnyProfile

SHORTEST_INTERVAL_S, MAX_TIME_S = 0.01, 86_400.0
"""Shortest time between two samples [s]: sensors do not change faster; and the longest time at a configuration."""


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


def measure_profile(
    command: Sequence[str], options: MeasureOptions, chosen: Callable[[Fault], None], report: Callable[[str], None]
) -> tuple[str, list[Fault]]:
    """Run a command at each configuration and sample a power sensor.

    Parameters
    ----------
    command : sequence of str
        Program and arguments, see `measuring.measure`.
    options : MeasureOptions
    chosen : function
        Called with a note of the sensor, before anything runs.
    report : function
        Called with the progress, as a short text.

    Returns
    -------
    str
        The table of measurements; see `measuring.measurements_csv`.
    list of Fault
        Notes of the results, and warnings of configurations that were not measured accurately.

    Raises
    ------
    InputError
        Of the options, the sensor or the command.
    """
    configurations = configurations_to_measure(options.config)
    check_command(command, configurations[0].names)
    options.check()
    sensor = choose_sensor(options.sysfs, options.sensor)
    chosen(_note("--sensor", f"{printable(sensor.label)} at {printable(str(sensor.path))}"))
    results, notes = measure(command, configurations, sensor, options, time, measuring.launched, report), []
    for each in results:
        notes.append(_note("--measure", f"{each.configuration}: {mean_text(each.average)}"))
        if not each.accurate:
            what = "not as accurate as asked" if each.average.std else "the sensor showed one value only"
            message = f"{each.configuration}: {what} within {options.longest_s:g} s"
            notes.append(_note("--longest", message, "warning"))
    return measurements_csv(results, command, sensor, options), notes


def _note(option: str, message: str, severity: str = "note") -> Fault:
    return Fault(option, 1, 1, message, severity=severity)


def profile_of_scenario(setting: Scenario) -> tuple[AnyProfile | None, list[Fault]]:
    """The profile that a scenario names, None where it names none, and warnings.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    if setting.profile_path is None:
        return None, []
    return parse_named(read_text(setting.profile_path), model_file.parse_profile, setting.fault("profile", ""))


def read_profile(file: File, *, warn: Warn = python_warnings) -> AnyProfile:
    """Read a computation profile.

    Parameters
    ----------
    file : str or path
        Measurements (CSV) or a model (YAML), `-` for standard input.
    warn : function, optional

    Raises
    ------
    InputError
        With the faults of the file.
    """
    profile, found = model_file.read_profile(str(file))
    warn(found)
    return profile

"""Measurements of power while a command runs: configurations, their loop, the command's process, and the CSV."""

from __future__ import annotations

import itertools
import math
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import IO, Annotated, Protocol

from eadp.core.signals import SampleMean, average
from eadp.errors import CommandError, Fault, InputError, printable
from eadp.io.profile.measurements import A_NAME, LARGEST, PARAMETERS_LIMIT, read_heading
from eadp.io.text.csv import NUMBER
from eadp.io.text.options import Flag, check_range
from eadp.measure.power_sensor import Meter, Sensor, choose_sensor
from eadp.models.profile import configuration_text, shortest, titles

MIN_SAMPLES = 30
"""Fewest samples of a configuration: fewer do not show the correlation of consecutive samples."""

CHECK_FACTOR = 1.1
"""Growth of the number of samples from one check of the accuracy to the next."""

GRACE_S = 5.0
"""Time from SIGTERM to SIGKILL [s]."""

DIGITS = 6
"""Decimals of a power [W] that are kept: sensors resolve microwatts."""

TAIL_BYTES = 400
"""Length of the output that the error of a failed command shows."""


CONFIGURATIONS_LIMIT = 1000
"""Most configurations of one measurement."""

SHORTEST_INTERVAL_S, MAX_TIME_S = 0.01, 86_400.0
"""Shortest time between two samples [s]: sensors do not change faster; and the longest time at a configuration."""


@dataclass(frozen=True)
class MeasureOptions:
    """How the power of a command is measured."""

    warmup_s: float = 5.0
    """Time before the first sample."""

    interval_s: float = 0.2
    """Time from one sample to the next."""

    accuracy_w: float = 0.05
    """Standard error to measure to [W]."""

    longest_s: float = 120.0
    """Longest time at a configuration."""

    config: Annotated[Sequence[str], Flag(metavar="NAME=VALUE,…")] = ()
    """Configuration of a trace, one option for each trace; with --measure, configurations to measure, all combinations:
    fps=2,4,keysize=32,448."""

    sensor: Annotated[str, Flag(metavar="KIND:NAME")] = ""
    """The sensor to read, or its path."""

    sysfs: Annotated[str, Flag(metavar="DIR")] = "/sys"
    """Root of the sensors."""

    def reached(self, found: SampleMean) -> bool:
        """Whether a mean is accurate enough; never where all samples are equal, as of a slow sensor."""
        return found.std > 0 and found.standard_error <= self.accuracy_w

    def check(self) -> None:
        """Refuse values out of range; raises InputError."""
        check_range("--warmup", self.warmup_s, 0.0, MAX_TIME_S, closed=True)
        check_range("--interval", self.interval_s, SHORTEST_INTERVAL_S, MAX_TIME_S, closed=True)
        check_range("--accuracy", self.accuracy_w, 0.0, math.inf)
        check_range("--longest", self.longest_s, SHORTEST_INTERVAL_S, MAX_TIME_S, closed=True)


# ── configurations in options ──


@dataclass(frozen=True)
class Configuration:
    """Parameters of the computations, their units ('' unknown) and a value [unit] for each."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]

    def __str__(self) -> str:
        return configuration_text(self.names, self.values, ",")


_A_CONFIGURATION = "NAME=VALUE, as in fps=0.5"


@dataclass(frozen=True)
class Axis:
    """The values of one parameter."""

    name: str
    unit: str
    values: list[float]


def parse_configuration(raw: str, option: str = "--config", expected: str = _A_CONFIGURATION) -> Configuration:
    """Read `fps=0.5,keysize=32`, a configuration: one value for each parameter; raises InputError at the option."""
    axes = read_axes(raw, option, expected)
    for axis in axes:
        if len(axis.values) > 1:
            raise InputError.at(option, 1, 1, f"{len(axis.values)} values of {axis.name}", "one", raw)
    names, units, values = zip(*((axis.name, axis.unit, axis.values[0]) for axis in axes), strict=True)
    return Configuration(names, units, values)


def read_axes(raw: str, option: str = "--config", form: str = _A_CONFIGURATION) -> list[Axis]:
    """Read `fps=2,4,keysize=32`, as `parse_configuration`: a piece without a name is another value of the last one."""
    axes: list[Axis] = []
    column = 1
    for piece in raw.split(","):
        title, equals, text = piece.rpartition("=")
        problem, expected = "", form
        if equals:
            heading = read_heading(title.strip())
            axes.append(Axis(heading.name, heading.unit, []))
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
    group = [read_axes(raw) for raw in stated]
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


def _product(group: Iterable[Sequence[Axis]]) -> Iterable[Configuration]:
    """All combinations of each list of axes, one list after the other, parameters in the first list's order."""
    order: list[str] = []
    for axes in group:
        order = order or [axis.name for axis in axes]
        sorted_axes = sorted(axes, key=lambda axis: order.index(axis.name))
        names, units = tuple(axis.name for axis in sorted_axes), tuple(axis.unit for axis in sorted_axes)
        for values in itertools.product(*(axis.values for axis in sorted_axes)):
            yield Configuration(names, units, values)


# ── the loop ──


class Clock(Protocol):
    """Time [s]: the module `time`, or a simulated clock."""

    def monotonic(self) -> float:
        """The time [s] from a fixed moment; never decreases."""

    def sleep(self, duration_s: float, /) -> None:
        """Return after a duration [s]."""


@dataclass
class RunningCommand:
    """A command in a process group of its own, its output in a file."""

    popen: subprocess.Popen[bytes]
    output: IO[bytes]

    def exit_code(self) -> int | None:
        """The exit code once it has ended, negative for a signal; None while it runs."""
        return self.popen.poll()

    def output_tail(self) -> str:
        """The end of what it printed."""
        size = os.fstat(self.output.fileno()).st_size
        kept = min(size, TAIL_BYTES)
        return os.pread(self.output.fileno(), kept, size - kept).decode("utf-8", errors="replace")


Launch = Callable[[Sequence[str], Clock], AbstractContextManager[RunningCommand]]
"""Starts a command; the end of the block ends it and all that it started."""


@dataclass(frozen=True)
class PowerMeasurement:
    """Samples [W] at one configuration in order, their mean, and whether its accuracy was reached."""

    configuration: Configuration
    powers_w: Sequence[float]
    average: SampleMean
    accurate: bool


def measure(
    command: Sequence[str],
    configurations: Sequence[Configuration],
    sensor: Sensor,
    settings: MeasureOptions,
    clock: Clock,
    launch: Launch,
    report: Callable[[str], None] = lambda _: None,
) -> list[PowerMeasurement]:
    """Run a command at each configuration in turn and sample a power sensor.

    Parameters
    ----------
    command : sequence of str
        Program and arguments, with a parameter's name in braces where its value goes. No shell sees them.
    configurations : sequence of Configuration
    sensor : Sensor
    settings : MeasureOptions
    clock : Clock
    launch : function
        See `launched`.
    report : function
        Called with the progress, as a short text.

    Returns
    -------
    list of PowerMeasurement
        One for each configuration.

    Raises
    ------
    InputError
        If the command does not start or ends by itself, with its configuration; if the sensor fails.
    """
    meter = Meter(sensor, clock.monotonic)
    results = []
    for i, configuration in enumerate(configurations, start=1):
        label = f"{configuration} ({i} of {len(configurations)})"
        with _errors_of(configuration), launch(fill_placeholders(command, configuration), clock) as running:
            results.append(_measure_one(running, configuration, meter, settings, clock, report, label))
    return results


def fill_placeholders(command: Sequence[str], configuration: Configuration) -> list[str]:
    """A command with the values of a configuration in place of its parameters' names, `{fps}`."""
    result = list(command)
    for name, value in zip(configuration.names, configuration.values, strict=True):
        result = [argument.replace("{" + name + "}", str(shortest(value))) for argument in result]
    return result


def check_command(command: Sequence[str], names: Sequence[str]) -> None:
    """Refuse a command without a placeholder for every parameter.

    Raises
    ------
    InputError
    """
    if not command:
        raise InputError.at("--measure", 1, 1, "no command", "a command after --, as in: --measure -- COMMAND {fps}")
    for name in names:
        placeholder = "{" + name + "}"
        if not any(placeholder in argument for argument in command):
            expected = f"{placeholder} in one of its arguments"
            raise InputError.at("--measure", 1, 1, f"the command does not use {name}", expected, " ".join(command))


@contextmanager
def _errors_of(configuration: Configuration) -> Iterator[None]:
    """Add the configuration to the errors of its command."""
    try:
        yield
    except CommandError as error:
        expected = "a command that runs until it is stopped"
        raise InputError.at("--measure", 1, 1, f"{configuration}: {error}", expected) from None


def _measure_one(
    running: RunningCommand,
    configuration: Configuration,
    meter: Meter,
    settings: MeasureOptions,
    clock: Clock,
    report: Callable[[str], None],
    label: str,
) -> PowerMeasurement:
    """Sample until the accuracy or the longest time is reached."""
    report(f"{label}: warming up")
    until_s = clock.monotonic() + settings.warmup_s
    while (left_s := until_s - clock.monotonic()) > 0:
        _check_running(running)
        clock.sleep(min(settings.interval_s, left_s))
    powers_w: list[float] = []
    check_at = MIN_SAMPLES
    for power_w in _samples(meter, settings.interval_s, settings.longest_s, clock):
        _check_running(running)
        powers_w.append(power_w)
        if len(powers_w) >= check_at:
            found = average([powers_w])
            report(f"{label}: {found.mean:.4g} W ± {found.standard_error:.2g} W")
            if settings.reached(found):
                return PowerMeasurement(configuration, powers_w, found, accurate=True)
            check_at = int(CHECK_FACTOR * len(powers_w)) + 1
    found = average([powers_w])
    return PowerMeasurement(configuration, powers_w, found, len(powers_w) >= MIN_SAMPLES and settings.reached(found))


def _samples(meter: Meter, interval_s: float, max_time_s: float, clock: Clock) -> Iterator[float]:
    """Power [W] at even intervals, the first after one interval; at least one. A late sample delays the following."""
    meter.start()
    end_s = clock.monotonic() + max_time_s
    due_s = clock.monotonic()
    while True:
        due_s = max(due_s + interval_s, clock.monotonic())
        clock.sleep(max(due_s - clock.monotonic(), 0.0))
        yield round(meter.power_w(), DIGITS)
        if clock.monotonic() + interval_s / 2 >= end_s:  # half an interval, against rounding
            return


def _check_running(running: RunningCommand) -> None:
    code = running.exit_code()
    if code is None:
        return
    how = f"was ended by {_signal_name(-code)}" if code < 0 else f"ended by itself with exit code {code}"
    last_line = printable(running.output_tail().strip().rpartition("\n")[2])
    raise CommandError(f"the command {how}" + (f"; its last output: {last_line}" if last_line else ""))


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


# ── the process ──


@contextmanager
def launched(arguments: Sequence[str], clock: Clock, grace_s: float = GRACE_S) -> Iterator[RunningCommand]:
    """Run a command in a session of its own; the end of the block, or an exception, ends its process group.

    Its input is empty; its output is kept for error messages.

    Raises
    ------
    CommandError
        If it does not start.
    """
    with tempfile.TemporaryFile() as output:
        try:
            popen = subprocess.Popen(
                arguments, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
        except (OSError, ValueError) as error:  # ValueError: a NUL in an argument
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise CommandError(f"{printable(arguments[0])} cannot be started: {reason}") from None
        try:
            yield RunningCommand(popen, output)
        finally:
            _end_group(popen, clock, grace_s)


def _end_group(popen: subprocess.Popen[bytes], clock: Clock, grace_s: float) -> None:
    """SIGTERM to the group, then SIGKILL to what is left of it after the grace time or on an interruption."""
    gone = False
    try:
        _signal_group(popen.pid, signal.SIGTERM)
        until_s = clock.monotonic() + grace_s
        while not gone and clock.monotonic() < until_s:
            popen.poll()  # a leader that was not waited for still counts as a member
            gone = not _signal_group(popen.pid, 0)
            if not gone:
                clock.sleep(0.05)
    finally:
        if not gone:
            _signal_group(popen.pid, signal.SIGKILL)
        try:
            popen.wait(timeout=grace_s)
        except subprocess.TimeoutExpired:
            raise CommandError(f"the command, process {popen.pid}, cannot be ended by this user") from None


def _signal_group(group: int, number: int) -> bool:
    """Send a signal to a process group; whether there is one."""
    try:
        os.killpg(group, number)
    except ProcessLookupError:
        return False
    except PermissionError:  # of another user, or on some systems a group of zombies
        pass
    return True


# ── the table ──


def measurements_csv(
    measured: Sequence[PowerMeasurement], command: Sequence[str], sensor: Sensor, settings: MeasureOptions
) -> str:
    """Samples as a table that `eadp profile` reads: a row for each, those of a configuration in their order.

    Parameters
    ----------
    measured : sequence of PowerMeasurement
        Of the same parameters, at least one.
    command, sensor, settings
        Of the measurement, for the comments.

    Returns
    -------
    str
        CSV with a header that names the parameters, with their units, and `power_w`.
    """
    first = measured[0].configuration
    source = f"measured with {sensor.label}, a sample every {settings.interval_s:g} s after {settings.warmup_s:g} s"
    lines = [f"# source: {printable(source)}", f"# command: {printable(' '.join(command), 1000)}"]
    lines.append(",".join([*titles(first.names, first.units), "power_w"]))
    for each in measured:
        at = "".join(f"{shortest(value)}," for value in each.configuration.values)
        lines += [f"{at}{power_w!r}" for power_w in each.powers_w]
    return "\n".join(lines) + "\n"


def mean_text(found: SampleMean) -> str:
    """A mean power with its standard error and number of samples, as text."""
    effective = f"{found.effective:.3g} independent" if found.samples > 1 else "standard deviation unknown"
    return f"{found.mean:.4f} W ± {found.standard_error:.4f} W ({found.samples} samples, {effective})"


def measure_profile(
    command: Sequence[str], options: MeasureOptions, chosen: Callable[[Fault], None], report: Callable[[str], None]
) -> tuple[str, list[Fault]]:
    """Run a command at each configuration and sample a power sensor.

    Parameters
    ----------
    command : sequence of str
        Program and arguments, see `measure`.
    options : MeasureOptions
    chosen : function
        Called with a note of the sensor, before anything runs.
    report : function
        Called with the progress, as a short text.

    Returns
    -------
    str
        The table of measurements; see `measurements_csv`.
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
    results, notes = measure(command, configurations, sensor, options, time, launched, report), []
    for each in results:
        notes.append(_note("--measure", f"{each.configuration}: {mean_text(each.average)}"))
        if not each.accurate:
            what = "not as accurate as asked" if each.average.std else "the sensor showed one value only"
            message = f"{each.configuration}: {what} within {options.longest_s:g} s"
            notes.append(_note("--longest", message, "warning"))
    return measurements_csv(results, command, sensor, options), notes


def _note(option: str, message: str, severity: str = "note") -> Fault:
    return Fault(option, 1, 1, message, severity=severity)

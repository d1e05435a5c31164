"""Measurements of power while a command runs: configurations, the command's process, the sensor, and the CSV."""

from __future__ import annotations

import itertools
import math
import os
import re
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Protocol

from eadp.core.signals import SampleMean, average
from eadp.errors import CommandError, Fault, InputError, printable
from eadp.io.profile.measurements import (
    PARAMETERS_LIMIT,
    Axis,
    Configuration,
    MeasurementSettings,
    MeasureOptions,
    read_axes,
)
from eadp.models.profile import shortest, titles

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


# ── sensors ──

KINDS = ("ina3221", "hwmon", "powercap", "power_supply")
"""Power sensors of a Linux computer in files under /sys, in the order of preference where none is named:

ina3221
    Rails of an INA3221 (hwmon): `in1_input` [mV] × `curr1_input` [mA]. The board's input, where a rail is labelled so.
hwmon
    `power1_input` [µW], or `power1_average`, of any other chip.
powercap
    `energy_uj` [µJ], a counter that wraps around after `max_energy_range_uj`: RAPL. `psys` is the whole platform.
power_supply
    `power_now` [µW], or `voltage_now` [µV] × `current_now` [µA]: a battery while it is discharged.
"""

TOTALS = frozenset({"vdd_in", "pom_5v_in", "5v_in", "vin", "psys"})
"""Labels, in lower case, of channels that feed all others of their kind."""

_WHOLE_NUMBER = re.compile(r"[+-]?[0-9]{1,30}\Z")


@dataclass(frozen=True)
class Sensor:
    """Files in which the kernel shows a power.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    name : str
        The chip or zone, and the label of its channel.
    path : Path
        The folder or file that identifies it.
    files : tuple of Path
        The files to read: one of power or energy, or one of voltage and one of current.
    watts : float
        Watts per unit of the file's number, or of the product of two; joules for a counter of energy.
    range_file : Path, optional
        Of a counter of energy, the file with the number at which it wraps around.
    part : bool
        Whether it measures a part of another sensor, such as one core of a processor.
    """

    kind: str
    name: str
    path: Path
    files: tuple[Path, ...]
    watts: float
    range_file: Path | None = None
    part: bool = False

    @property
    def counts_energy(self) -> bool:
        """Whether the file is a counter of energy, and not a power."""
        return self.range_file is not None

    @property
    def label(self) -> str:
        """Its name for `--sensor`."""
        return f"{self.kind}:{self.name}"

    @property
    def readable(self) -> bool:
        """Whether this user can read it."""
        with suppress(InputError):
            return bool([_number(file) for file in self.files])
        return False


def find_sensors(root: str) -> list[Sensor]:
    """All the power sensors under a root such as `/sys`, in the order of `KINDS`, then by path.

    Raises
    ------
    InputError
        If the root is no folder.
    """
    base = Path(root)
    if not base.is_dir():
        raise InputError.at(root, 1, 1, "is no folder", "the root of sysfs, such as /sys")
    chips, zones, supplies = base / "class/hwmon", base / "class/powercap", base / "class/power_supply"
    found = [
        *(sensor for chip in _entries(chips, "hwmon*") for sensor in _of_chip(chip)),
        *(sensor for zone in _entries(zones, "*:*") for sensor in _of_zone(zone)),
        *(sensor for supply in _entries(supplies, "*") for sensor in _of_supply(supply)),
    ]
    return sorted(found, key=lambda sensor: (KINDS.index(sensor.kind), _natural(sensor.path)))


def choose_sensor(root: str, wanted: str = "") -> Sensor:
    """The sensor of that name or path; without one, the total of the first kind that has any.

    Parameters
    ----------
    root : str
        The root of sysfs.
    wanted : str
        `KIND:NAME`, or the path of a sensor's folder or file; relative paths start at the root.

    Returns
    -------
    Sensor

    Raises
    ------
    InputError
        If none or several match: with the list of sensors found.
    """
    found = find_sensors(root)
    if wanted:
        path = (Path(root) / wanted).resolve()
        matching = [sensor for sensor in found if wanted == sensor.label]
        matching = matching or [s for s in found if path in {file.resolve() for file in (s.path, *s.files)}]
        problem = f"{len(matching)} sensors have this name" if matching else "no such sensor"
    else:
        readable = [sensor for sensor in found if sensor.readable]
        if not readable:
            raise InputError.at("--sysfs", 1, 1, "no power sensor that this user can read", _listing(found, root))
        kind = readable[0].kind  # the sensors are in the order of their kinds
        matching = _totals([sensor for sensor in readable if sensor.kind == kind])
        problem = f"several sensors of the kind {kind}"
    if len(matching) == 1:
        return matching[0]
    raise InputError.at("--sensor", 1, 1, problem, _listing(found, root), wanted)


def _totals(sensors: Sequence[Sensor]) -> list[Sensor]:
    """The sensors labelled as totals; else those not known to be parts."""
    labelled = [sensor for sensor in sensors if sensor.name.rpartition("/")[2].lower() in TOTALS]
    return labelled or [sensor for sensor in sensors if not sensor.part] or list(sensors)


def _listing(found: Sequence[Sensor], root: str) -> str:
    if not found:
        return f"one of {', '.join(KINDS)} under {printable(root)}"
    lines = []
    for sensor in found:
        path = sensor.path.relative_to(root) if sensor.path.is_relative_to(root) else sensor.path
        unreadable = "" if sensor.readable else " (not readable by this user)"
        lines.append(f"{printable(sensor.label)} at {printable(str(path))}{unreadable}")
    return "one of these by name or path:\n    " + "\n    ".join(lines)


# ── the sensors' files ──


def _of_chip(chip: Path) -> Iterable[Sensor]:
    name = _line(chip / "name") or chip.name
    if name == "ina3221":
        for current in _entries(chip, "curr[0-9]*_input"):
            channel = current.name.removeprefix("curr").removesuffix("_input")
            voltage = chip / f"in{channel}_input"
            if voltage.is_file():
                label = _line(chip / f"in{channel}_label") or f"channel{channel}"
                yield Sensor("ina3221", f"{name}/{label}", voltage, (voltage, current), 1e-6)  # mV × mA
        return
    for power in [*_entries(chip, "power[0-9]*_input"), *_entries(chip, "power[0-9]*_average")]:
        channel, _, ending = power.name.partition("_")
        if ending == "average" and (chip / f"{channel}_input").is_file():
            continue
        label = _line(chip / f"{channel}_label") or channel
        yield Sensor("hwmon", f"{name}/{label}", power, (power,), 1e-6)  # µW


def _of_zone(zone: Path) -> Iterable[Sensor]:
    energy = zone / "energy_uj"
    if energy.is_file():
        # intel-rapl:0:1 is a part of intel-rapl:0, which intel-rapl-mmio:0 shows a second time
        part = zone.name.count(":") > 1 or "mmio" in zone.name
        name = _line(zone / "name") or zone.name
        yield Sensor("powercap", name, zone, (energy,), 1e-6, zone / "max_energy_range_uj", part)  # µJ


def _of_supply(supply: Path) -> Iterable[Sensor]:
    power, voltage, current = supply / "power_now", supply / "voltage_now", supply / "current_now"
    part = _line(supply / "type") not in ("", "Battery")
    if power.is_file():
        yield Sensor("power_supply", supply.name, supply, (power,), 1e-6, part=part)  # µW
    elif voltage.is_file() and current.is_file():
        yield Sensor("power_supply", supply.name, supply, (voltage, current), 1e-12, part=part)  # µV × µA


def _entries(folder: Path, pattern: str) -> list[Path]:
    with suppress(OSError):
        return sorted(folder.glob(pattern), key=_natural)
    return []


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts hwmon10 after hwmon9."""
    return [(int(piece), "") if piece.isdigit() else (0, piece) for piece in re.split(r"([0-9]+)", str(path))]


def _line(file: Path) -> str:
    """The first line of a small file; '' if there is none."""
    with suppress(OSError):
        return file.read_text(encoding="utf-8", errors="replace").strip().partition("\n")[0][:64]
    return ""


def _number(file: Path) -> int:
    try:
        text = file.read_text(encoding="ascii", errors="replace").strip()
    except OSError as error:
        raise InputError.at(str(file), 1, 1, f"cannot be read: {error.strerror}", "a readable power sensor") from None
    if not _WHOLE_NUMBER.match(text):
        shown = printable(text, 40) or "nothing"
        raise InputError.at(str(file), 1, 1, f"contains {shown}", "a whole number")
    return int(text)


# ── readings ──


@dataclass
class Meter:
    """Reads a sensor's power: the present one, or the mean since the last reading of a counter of energy.

    Attributes
    ----------
    sensor : Sensor
    monotonic : function
        The time [s]; never decreases.
    """

    sensor: Sensor
    monotonic: Callable[[], float]
    _before: tuple[float, int] | None = field(default=None, repr=False)

    def start(self) -> None:
        """Start a new mean: the next reading of a counter is the mean from here."""
        self._before = (self.monotonic(), _number(self.sensor.files[0])) if self.sensor.counts_energy else None

    def power_w(self) -> float:
        """The present power [W], or its mean since the last reading or start; 0 or more.

        Raises
        ------
        InputError
            If the sensor cannot be read, or a counter falls below where it can wrap around.
        """
        if self.sensor.counts_energy:
            return self._mean_w()
        product = math.prod(_number(file) for file in self.sensor.files)
        return abs(product) * self.sensor.watts  # some batteries report a negative current while they are drained

    def _mean_w(self) -> float:
        if self._before is None:
            raise ValueError("a counter needs a start before its first reading")
        now_s, count = self.monotonic(), _number(self.sensor.files[0])
        before_s, before = self._before
        if not now_s > before_s:
            raise ValueError("two readings of a counter at one time")
        self._before = (now_s, count)
        passed = count - before
        if passed < 0:  # it has wrapped around: E2 + max − E1
            assert self.sensor.range_file is not None
            largest = _number(self.sensor.range_file)
            if largest < before:
                message = f"the counter fell from {before} to {count}, and wraps around after {largest}"
                raise InputError.at(str(self.sensor.files[0]), 1, 1, message, "a counter that rises")
            passed += largest
        return passed * self.sensor.watts / (now_s - before_s)


# ── the measurement ──


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
    settings: MeasurementSettings,
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
    settings : MeasurementSettings
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
    settings: MeasurementSettings,
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
    measured: Sequence[PowerMeasurement], command: Sequence[str], sensor: Sensor, settings: MeasurementSettings
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

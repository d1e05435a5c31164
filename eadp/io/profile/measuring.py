"""Measuring power while a command runs, once for each configuration: the loop, the clock and the command's process."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import IO, Protocol

from eadp.core.signals.averaging import SampleMean, average
from eadp.errors import CommandError, InputError, printable
from eadp.io.profile.measurements import Configuration
from eadp.io.profile.power_sensor import Meter, Sensor

FEWEST = 30
"""Fewest samples of a configuration: fewer cannot show how alike neighbours are."""

LOOK_AGAIN = 1.1
"""How many times as many samples there are when it is next asked whether they are enough."""

GRACE_S = 5.0
"""How long a process group has after SIGTERM before SIGKILL [s]."""

DIGITS = 6
"""Digits of a power in watts that are kept: sensors tell microwatts."""

TAIL_BYTES = 400
"""How much of a failed command's output its error shows."""


class Clock(Protocol):
    """Time that passes: the real one, or a made-up one."""

    def now_s(self) -> float:
        """The time [s] from some fixed moment; never goes back."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Return after a duration [s]."""
        ...


class RealClock:
    """The computer's own clock."""

    def now_s(self) -> float:
        """See `Clock`."""
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        """See `Clock`."""
        time.sleep(duration_s)


class Running(Protocol):
    """A command that was started."""

    def ended(self) -> int | None:
        """The exit code once it has ended, negative for a signal; None while it runs."""
        ...

    def said(self) -> str:
        """The last that it printed."""
        ...


Launch = Callable[[Sequence[str], Clock], AbstractContextManager[Running]]
"""Starts a command; the end of the block ends it and all that it started."""


@dataclass(frozen=True)
class MeasurementSettings:
    """How long to measure.

    Attributes
    ----------
    warm_up_s : float
        What is dropped at the beginning [s].
    interval_s : float
        Time from one sample to the next [s].
    accuracy : float
        The standard error at which a configuration is done: [W], or as a part of its mean if `relative`.
    relative : bool
    longest_s : float
        The time after the warm-up at which it is done anyway [s].
    idle_s : float
        How long to measure without the command before [s]; 0: not.
    """

    warm_up_s: float = 5.0
    interval_s: float = 0.2
    accuracy: float = 0.05
    relative: bool = False
    longest_s: float = 120.0
    idle_s: float = 0.0

    def reached(self, found: SampleMean) -> bool:
        """Whether a mean is known well enough; not of a sensor that has shown one value only, and may be a slow one."""
        return found.std > 0 and found.standard_error <= self.accuracy * (found.mean if self.relative else 1.0)


@dataclass(frozen=True)
class PowerMeasurement:
    """Samples [W] at one configuration, in order; what they add up to, and whether that is as accurate as asked."""

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
) -> tuple[list[PowerMeasurement], SampleMean | None]:
    """Run a command at one configuration after the other, and sample a power sensor meanwhile.

    Parameters
    ----------
    command : sequence of str
        Program and arguments, with a parameter's name in braces where its value goes. No shell sees them.
    configurations : sequence of Configuration
    sensor : Sensor
    settings : Settings
    clock : Clock
    launch : function
        See `launched`.
    report : function
        Is told now and then, in a few words, how far it is.

    Returns
    -------
    list of Measured
        One for each configuration.
    Average or None
        The power without the command [W], where `settings.idle_s` asks for it. It is not subtracted from anything.

    Raises
    ------
    InputError
        If the command does not start or ends by itself, with the configuration; if the sensor fails.
    """
    meter = Meter(sensor, clock.now_s)
    idle = None
    if settings.idle_s:
        report("idle")
        idle = average([list(_samples(meter, settings.interval_s, settings.idle_s, clock))])
    results = []
    for i, configuration in enumerate(configurations, start=1):
        told_of = partial(_told_of, report, f"{configuration} ({i} of {len(configurations)})")
        with _errors_of(configuration), launch(filled(command, configuration), clock) as running:
            results.append(_measured(running, configuration, meter, settings, clock, told_of))
    return results, idle


def _told_of(report: Callable[[str], None], head: str, status: str) -> None:
    report(f"{head}: {status}")


def filled(command: Sequence[str], configuration: Configuration) -> list[str]:
    """A command with the values of a configuration in the places of its parameters' names: `{fps}`."""
    result = list(command)
    for name, value in zip(configuration.names, configuration.values, strict=True):
        result = [argument.replace("{" + name + "}", _shown(value)) for argument in result]
    return result


def _shown(value: float) -> str:
    """A number as a program reads it, whole ones without a point."""
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(value)


def check_command(command: Sequence[str], names: Sequence[str]) -> None:
    """Refuse a command without a place for every parameter.

    Raises
    ------
    InputError
    """
    if not command:
        raise InputError.at("--measure", 1, 1, "no command", "a command after --, as in: --measure -- COMMAND {fps}")
    for name in names:
        place = "{" + name + "}"
        if not any(place in argument for argument in command):
            expected = f"{place} in one of its arguments"
            raise InputError.at("--measure", 1, 1, f"a command that is not told {name}", expected, " ".join(command))


@contextmanager
def _errors_of(configuration: Configuration) -> Iterator[None]:
    """Name the configuration in what goes wrong with the command."""
    try:
        yield
    except CommandError as error:
        expected = "a command that runs until it is stopped"
        raise InputError.at("--measure", 1, 1, f"{configuration}: {error}", expected) from None


def _measured(
    running: Running,
    configuration: Configuration,
    meter: Meter,
    settings: MeasurementSettings,
    clock: Clock,
    report: Callable[[str], None],
) -> PowerMeasurement:
    """Sample until the mean is known well enough, or for the longest time."""
    report("warming up")
    until_s = clock.now_s() + settings.warm_up_s
    while (left_s := until_s - clock.now_s()) > 0:
        _check_running(running)
        clock.sleep_s(min(settings.interval_s, left_s))
    powers_w: list[float] = []
    found, enough = None, FEWEST
    for power_w in _samples(meter, settings.interval_s, settings.longest_s, clock):
        _check_running(running)
        powers_w.append(power_w)
        if len(powers_w) >= enough:
            found = average([powers_w])
            report(f"{found.mean:.4g} W ± {found.standard_error:.2g} W")
            if settings.reached(found):
                return PowerMeasurement(configuration, powers_w, found, accurate=True)
            enough = int(LOOK_AGAIN * len(powers_w)) + 1
    found = average([powers_w])
    return PowerMeasurement(configuration, powers_w, found, len(powers_w) >= FEWEST and settings.reached(found))


def _samples(meter: Meter, interval_s: float, longest_s: float, clock: Clock) -> Iterator[float]:
    """Power [W] at even intervals, the first after one; at least one. A late sample delays those after it."""
    meter.start()
    end_s = clock.now_s() + longest_s
    due_s = clock.now_s()
    while True:
        due_s = max(due_s + interval_s, clock.now_s())
        clock.sleep_s(max(due_s - clock.now_s(), 0.0))
        yield round(meter.power_w(), DIGITS)
        if clock.now_s() + interval_s / 2 >= end_s:  # half an interval: rounding does not take a sample away
            return


def _check_running(running: Running) -> None:
    code = running.ended()
    if code is None:
        return
    how = f"was ended by {_signal_name(-code)}" if code < 0 else f"ended by itself with exit code {code}"
    said = printable(running.said().strip().rpartition("\n")[2])
    raise CommandError(f"the command {how}" + (f", and said last: {said}" if said else ""))


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


# ── the real process ──


@dataclass
class _Process:
    """A command in a process group of its own, its output in a file."""

    popen: subprocess.Popen[bytes]
    output: IO[bytes]

    def ended(self) -> int | None:
        return self.popen.poll()

    def said(self) -> str:
        size = os.fstat(self.output.fileno()).st_size
        kept = min(size, TAIL_BYTES)
        return os.pread(self.output.fileno(), kept, size - kept).decode("utf-8", errors="replace")


@contextmanager
def launched(arguments: Sequence[str], clock: Clock, grace_s: float = GRACE_S) -> Iterator[Running]:
    """Run a command in a session of its own; when the block ends, however it does, end all of its process group.

    Its input is empty, and its output is kept for messages about it.

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
            yield _Process(popen, output)
        finally:
            _end_group(popen, clock, grace_s)


def _end_group(popen: subprocess.Popen[bytes], clock: Clock, grace_s: float) -> None:
    """SIGTERM to the group, and SIGKILL to what of it is there after a grace, or when interrupted in waiting."""
    gone = False
    try:
        _signal_group(popen.pid, signal.SIGTERM)
        until_s = clock.now_s() + grace_s
        while not gone and clock.now_s() < until_s:
            popen.poll()  # a leader that nobody has asked about still counts as a member
            gone = not _signal_group(popen.pid, 0)
            if not gone:
                clock.sleep_s(0.05)
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
    except PermissionError:  # of another user, or on some systems a group of zombies: waited for, not for ever
        return True
    return True


# ── what comes out ──


def measurements_csv(
    measured: Sequence[PowerMeasurement],
    idle: SampleMean | None,
    command: Sequence[str],
    sensor: Sensor,
    settings: MeasurementSettings,
) -> str:
    """Samples as a table that `eadp profile` reads: a row for each, those of a configuration in their order.

    Parameters
    ----------
    measured : sequence of Measured
        Of the same parameters, at least one.
    idle : Average or None
        Power without the command [W]: stated, and not subtracted.
    command, sensor, settings
        As they were measured with.

    Returns
    -------
    str
        CSV with a header that names the parameters, with their units, and `power_w`.
    """
    first = measured[0].configuration
    source = f"measured with {sensor.label}, a sample every {settings.interval_s:g} s after {settings.warm_up_s:g} s"
    lines = [f"# source: {printable(source)}", f"# command: {printable(' '.join(command), 1000)}"]
    if idle:
        lines.append(f"# idle: {told(idle)}, not subtracted")
    titles = [f"{name} [{unit}]" if unit else name for name, unit in zip(first.names, first.units, strict=True)]
    lines.append(",".join([*titles, "power_w"]))
    for each in measured:
        at = "".join(f"{_shown(value)}," for value in each.configuration.values)
        lines += [f"{at}{power_w!r}" for power_w in each.powers_w]
    return "\n".join(lines) + "\n"


def told(found: SampleMean) -> str:
    """A mean power in words."""
    effective = f"{found.effective:.3g} independent" if found.samples > 1 else "no spread known"
    return f"{found.mean:.4f} W ± {found.standard_error:.4f} W ({found.samples} samples, {effective})"

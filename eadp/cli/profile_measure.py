"""`eadp profile --measure`: run a command at each configuration, sample a power sensor, write the measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eadp.cli.output import Progress, usage_fault, warn
from eadp.errors import Fault, printable

SHORTEST_INTERVAL_S = 0.01
"""Shortest time between two samples [s]: sensors do not change faster."""


@dataclass(frozen=True)
class Options:
    """The options that say how to measure; None is one that was not given."""

    config: list[str] | None = None
    sweep: list[str] | None = None
    sysfs: str | None = None
    sensor: str | None = None
    warmup: float | None = None
    interval: float | None = None
    accuracy: str | None = None
    longest: float | None = None
    idle: float | None = None

    def given(self) -> list[str]:
        """Those of them that only measuring knows, as options."""
        names = ("sweep", "sysfs", "sensor", "warmup", "interval", "accuracy", "longest", "idle")
        return [f"--{name}" for name in names if getattr(self, name) is not None]


def measure_command(command: list[str], options: Options, output: str) -> int:
    """Measure and write the CSV, whole or not at all; what was found is told on stderr."""
    from eadp.io.profile.configurations import configurations_to_measure
    from eadp.io.profile.measuring import (
        MeasurementSettings,
        RealClock,
        check_command,
        launched,
        measure,
        measurements_csv,
        told,
    )
    from eadp.io.profile.power_sensor import choose_sensor
    from eadp.io.text.streams import write_text

    configurations = configurations_to_measure(options.config or [], options.sweep or [])
    check_command(command, configurations[0].names)
    accuracy, relative = _accuracy(options.accuracy or "0.05")
    settings = MeasurementSettings(
        warm_up_s=_seconds("--warmup", options.warmup, 5.0),
        interval_s=_seconds("--interval", options.interval, 0.2, SHORTEST_INTERVAL_S),
        accuracy=accuracy,
        relative=relative,
        longest_s=_seconds("--longest", options.longest, 120.0, SHORTEST_INTERVAL_S),
        idle_s=_seconds("--idle", options.idle, 0.0),
    )
    sensor = choose_sensor(options.sysfs or "/sys", options.sensor or "")
    warn([_note("--sensor", f"{printable(sensor.label)} at {printable(str(sensor.path))}", "note")])
    progress = Progress("measuring")
    try:
        measured, idle = measure(command, configurations, sensor, settings, RealClock(), launched, progress.show)
    finally:
        progress.close()
    write_text(output or "-", measurements_csv(measured, idle, command, sensor, settings))
    if idle:
        warn([_note("--idle", f"{told(idle)} without the command; not subtracted", "note")])
    for each in measured:
        warn([_note("--measure", f"{each.configuration}: {told(each.average)}", "note")])
        if not each.accurate:
            what = "not as accurate as asked" if each.average.std else "the sensor showed one value only"
            message = f"{each.configuration}: {what} within {settings.longest_s:g} s"
            warn([_note("--longest", message, "warning")])
    return 0


def _note(option: str, message: str, severity: str) -> Fault:
    return Fault(option, 1, 1, message, severity=severity)


def _seconds(option: str, value: float | None, default: float, least: float = 0.0) -> float:
    if value is None:
        return default
    if not least <= value < math.inf:
        raise usage_fault(option, f"{value:g}", f"{value:g} s", f"a number of seconds, {least:g} or more")
    return value


def _accuracy(raw: str) -> tuple[float, bool]:
    """Read `0.05`, in watts, or `1%` of the mean; and whether it is the latter."""
    text = raw.strip()
    relative = text.endswith("%")
    try:
        value = float(text.removesuffix("%"))
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise usage_fault("--accuracy", raw, "no accuracy", "watts above 0, as in 0.05, or a share, as in 1%")
    return (value / 100, True) if relative else (value, False)

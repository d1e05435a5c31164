"""Power logs: times and watts, in order, with what was left out.

Rows out of order are sorted; of rows at one time the first is kept. Where the clock was set back, as by a restart, the
longest run of rows is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from eadp.core.arrays import FloatArray, IntArray
from eadp.errors import Fault, InputError, printable
from eadp.io.text.options import Flag
from eadp.measure.spectrum import MIN_SAMPLES

LARGEST_W = 1e9
"""Largest power, voltage or current [W, V, A]: beyond it, a log is not of a small aircraft."""
IMPOSSIBLE_W = 5e4
"""Mean power beyond that of any aircraft of the kind [W]: the units are others."""
LARGE_W, SLOW_S, LONG_S = 1e4, 60.0, 86_400.0
"""Mean power [W], time between rows and length [s] beyond which a log's units may be others: an electric aircraft of
150 kg draws about 6 kW, and batteries last for hours."""
SHORTEST_S = 1e-3
RESTARTS = 3
"""Most restarts of the clock; where times decrease more often, rows are out of order."""
GAP = 5.0
"""Shortest gap, relative to the median step."""


TimeUnit = Literal["s", "ms", "us", "ns", "min", "h"]
TIME_UNITS: tuple[TimeUnit, ...] = get_args(TimeUnit)


@dataclass(frozen=True)
class ColumnOptions:
    """Which columns of a log are read."""

    time: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of time."""

    power: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of power."""

    voltage: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of voltage."""

    current: Annotated[str, Flag(metavar="NAME")] = ""
    """The column of current."""

    time_unit: TimeUnit | None = None
    """Unit of the times, where their column's name has none."""

    instance: Annotated[int | None, Flag(metavar="N")] = None
    """Which battery of an autopilot's log."""


@dataclass(frozen=True)
class Columns(ColumnOptions):
    """The columns to read.

    `factors` asks for voltage and current even if there is a power; `also` for other columns, by name; `motion` for the
    motion that the log has, in the columns below of `also`. Positions in degrees become metres about `origin_deg`,
    None for the first of them.
    """

    factors: bool = False
    also: Sequence[str] = ()
    motion: bool = False
    origin_deg: tuple[float, float] | None = None


AIRSPEED, BANK, CLIMB, ALTITUDE = "airspeed_mps", "bank_rad", "climb_mps", "altitude_m"
DENSITY = "air_density_kgpm3"
"""Columns of the motion: true airspeed [m/s], bank [rad], rate of climb [m/s], altitude [m], density of the air
[kg/m³]."""


@dataclass(frozen=True, eq=False)
class PowerLog:
    """Readings of power.

    Attributes
    ----------
    name : str
        The file.
    times_s : array, shape (n,)
        Times from the first reading, strictly increasing [s].
    power_w : array, shape (n,)
        Power [W].
    warnings : list of Fault
        Readings that were left out or sorted.
    voltage_v, current_a : array, shape (n,), or None
        Factors of the power [V, A], if it was computed from them.
    position_m : array, shape (n, 2), or None
        Positions in the log, x and y [m]; NaN in rows without one.
    also : dict of str to array, shape (n,)
        The other columns asked for.
    counts : dict of str to int or float
        Rows read, rows left out by reason, gaps, and the longest gap [s].
    battery : dict of str to float
        What an autopilot says of its battery, as far as it does: `capacity_ah`, and `used_ah` before the first reading.
    """

    name: str
    times_s: FloatArray
    power_w: FloatArray
    warnings: list[Fault] = field(default_factory=list)
    voltage_v: FloatArray | None = None
    current_a: FloatArray | None = None
    position_m: FloatArray | None = None
    also: dict[str, FloatArray] = field(default_factory=dict)
    counts: dict[str, int | float] = field(default_factory=dict)
    battery: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class LogReadings:
    """The readings of a log as arrays of one length, in the order of the file.

    Attributes
    ----------
    raw : array, shape (n,)
        Times in the unit of the file.
    factors : array, shape (n, 1) or (n, 2)
        Power [W], or voltage [V] and current [A].
    others : array, shape (n, m)
        x and y [m] if `position`, then the other columns asked for.
    lines : array, shape (n,)
        Line numbers.
    """

    raw: FloatArray
    factors: FloatArray
    others: FloatArray
    lines: IntArray

    def at(self, index: NDArray[Any] | slice) -> LogReadings:
        """Some of the readings."""
        return LogReadings(self.raw[index], self.factors[index], self.others[index], self.lines[index])


_NAMED_SO = "columns in mW, mV or mA are named so"


def in_order(
    name: str,
    readings: LogReadings,
    per_second: float,
    warnings: list[Fault],
    counts: dict[str, int | float],
    *,
    position: bool,
    also: Sequence[str] = (),
    names: Sequence[str] = ("voltage", "current"),
) -> PowerLog:
    """The log of readings in order of time, each time once; `names` are those of the columns of the factors.

    Raises
    ------
    InputError
        If too few readings, or too short a time, are left to find a period.
    """
    if len(readings.raw) < MIN_SAMPLES:
        message = f"{len(readings.raw)} readings"
        raise InputError(*warnings, Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, to find a period in"))
    readings = _sorted(name, readings, warnings, counts)
    times = (readings.raw - readings.raw[0]) / per_second  # the difference first: a date in µs has no digits to spare
    if len(times) < MIN_SAMPLES or times[-1] < SHORTEST_S:
        message = f"{len(times)} readings at different times, over {times[-1]:g} s"
        raise InputError(Fault(name, 1, 1, message, f"{MIN_SAMPLES} or more, over {SHORTEST_S:g} s or longer"))
    gap = _count_gaps(times, counts)
    if times[gap + 1] - times[gap] > times[-1] / 2:
        message = f"a gap of {times[gap + 1] - times[gap]:g} s before this row, more than half of the log"
        warnings.append(Fault(name, int(readings.lines[gap + 1]), 1, message, severity="warning"))
    mean_w = float(readings.factors.prod(axis=1).mean())
    if abs(mean_w) > IMPOSSIBLE_W:
        means = readings.factors.mean(axis=0)
        columns = ", ".join(f"{printable(what, 80)} {mean:.4g}" for what, mean in zip(names, means, strict=True))
        message = f"a mean power of {mean_w:.4g} W (mean of the columns: {columns})"
        raise InputError.at(name, 1, 1, message, f"at most {IMPOSSIBLE_W:g} W; {_NAMED_SO}")
    warnings += _doubts(name, times, readings.factors.prod(axis=1))
    found = sorted(warnings, key=lambda fault: (fault.line, fault.column))
    factors, others = readings.factors, readings.others
    volts, amps = (factors[:, 0], factors[:, 1]) if factors.shape[1] == 2 else (None, None)
    where = others[:, :2] if position and np.isfinite(others[:, :2]).all(axis=1).sum() >= MIN_SAMPLES else None
    named = {label: others[:, 2 * position + i] for i, label in enumerate(also)}
    return PowerLog(name, times, factors.prod(axis=1), found, volts, amps, where, named, counts)


def _doubts(name: str, times_s: FloatArray, power_w: FloatArray) -> list[Fault]:
    """Warnings about values that may be in other units, or of another sign."""
    step_s, mean_w = float(np.median(np.diff(times_s))), float(power_w.mean())
    found = []
    if step_s > SLOW_S or times_s[-1] > LONG_S:
        message = f"a row every {step_s:.3g} s, over {times_s[-1] / 3600:.3g} h"
        found.append((message, "a log of a flight; --time-unit sets the unit of the time"))
    if mean_w > LARGE_W:
        found.append((f"a mean power of {mean_w:.4g} W", f"at most {LARGE_W:g} W; {_NAMED_SO}"))
    if mean_w < 0:
        found.append((f"a mean power of {mean_w:.4g} W", "power that is drawn, above 0"))
    return [Fault(name, 1, 1, message, expected, severity="warning") for message, expected in found]


def _sorted(name: str, readings: LogReadings, warnings: list[Fault], counts: dict[str, int | float]) -> LogReadings:
    """The longest run between restarts of the clock, in order of time, each time once."""
    kept = _longest_run(readings.raw)
    if (lost := len(readings.raw) - (kept.stop - kept.start)) > 0:
        counts["restart"] = lost
        line = int(readings.lines[kept.start if kept.start else kept.stop])
        message = f"the clock is set back here: {rows_text(lost)} outside the longest run left out"
        warnings.append(Fault(name, line, 1, message, severity="warning"))
        readings = readings.at(kept)
    late = np.flatnonzero(readings.raw < np.maximum.accumulate(readings.raw))
    if len(late):
        counts["late"] = len(late)
        warnings.append(rows_warning(name, readings.lines[late].tolist(), "earlier than one before: sorted by time"))
        readings = readings.at(np.argsort(readings.raw, kind="stable"))
    repeated = np.flatnonzero(np.diff(readings.raw) == 0) + 1
    if len(repeated):
        counts["repeated"] = len(repeated)
        warnings.append(rows_warning(name, readings.lines[repeated].tolist(), "at the time of another left out"))
        readings = readings.at(np.delete(np.arange(len(readings.raw)), repeated))
    return readings


def rows_warning(name: str, lines: Sequence[int], what: str) -> Fault:
    """A warning about rows, at the first of them."""
    where = "" if len(lines) == 1 else ", the first of them here"
    return Fault(name, min(lines), 1, f"{rows_text(len(lines))} {what}{where}", severity="warning")


def rows_text(count: int) -> str:
    """A number of rows, as text."""
    return "1 row" if count == 1 else f"{count} rows"


def _longest_run(raw: FloatArray) -> slice:
    """All rows; or the longest run where a clock was set back: seldom, by much, and with enough rows between."""
    back = np.flatnonzero(np.diff(raw) < 0) + 1
    runs = np.diff([0, *back.tolist(), len(raw)])
    step = float(np.median(np.abs(np.diff(raw))))
    far = len(back) and np.all(raw[back - 1] - raw[back] > 10 * step)
    if not 0 < len(back) <= RESTARTS or not far or runs.min() < MIN_SAMPLES:
        return slice(0, len(raw))
    longest = int(np.argmax(runs))
    start = int(runs[:longest].sum())
    return slice(start, start + int(runs[longest]))


def _count_gaps(times_s: FloatArray, counts: dict[str, int | float]) -> int:
    """The index of the longest step; adds the gaps to the counts."""
    steps = np.diff(times_s)
    longest = int(np.argmax(steps))
    gaps = int(np.count_nonzero(steps > GAP * np.median(steps)))
    if gaps:
        counts["gaps"], counts["longest_gap_s"] = gaps, float(steps[longest])
    return longest

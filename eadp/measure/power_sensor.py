"""Power sensors of a Linux computer, as the kernel shows them in files under /sys.

Kinds, in the order of preference where no sensor is named:

ina3221
    Rails of an INA3221 (hwmon): `in1_input` [mV] × `curr1_input` [mA]. The board's input, where a rail is labelled so.
    The fourth current is the sum of the three.
hwmon
    `power1_input` [µW], or `power1_average`, of any other chip.
powercap
    `energy_uj` [µJ], a counter that wraps around after `max_energy_range_uj`: RAPL. `psys` is the whole platform.
power_supply
    `power_now` [µW], or `voltage_now` [µV] × `current_now` [µA]: a battery while it is discharged.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from eadp.errors import InputError, printable

KINDS = ("ina3221", "hwmon", "powercap", "power_supply")

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


# ── sysfs ──


def _of_chip(chip: Path) -> Iterable[Sensor]:
    name = _line(chip / "name") or chip.name
    if name == "ina3221":
        for current in _entries(chip, "curr[1-3]_input"):
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

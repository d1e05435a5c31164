"""Power sensors of a Linux computer, as the kernel shows them in files under /sys.

Kinds, in the order in which a sensor is looked for where none is named:

ina3221
    Rails of an INA3221 (hwmon): `in1_input` [mV] × `curr1_input` [mA]. The board's input, where a rail is labelled so.
hwmon
    `power1_input` [µW], or `power1_average`, of any other chip.
powercap
    `energy_uj` [µJ], a counter that begins again after `max_energy_range_uj`: RAPL. `psys` is the whole platform.
power_supply
    `power_now` [µW], or `voltage_now` [µV] × `current_now` [µA]: a battery that is being discharged.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from eadp.errors import InputError, printable

KINDS = ("ina3221", "hwmon", "powercap", "power_supply")

WHOLE = frozenset({"vdd_in", "pom_5v_in", "5v_in", "vin", "psys"})
"""Labels, in lower case, of what feeds everything else of its kind."""

_WHOLE_NUMBER = re.compile(r"[+-]?[0-9]{1,30}\Z")


@dataclass(frozen=True)
class Sensor:
    """Where the kernel shows a power.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    name : str
        The chip or zone, and the label of its channel.
    path : Path
        The folder or file that tells it from others.
    files : tuple of Path
        What is read: one file of power or energy, or one of voltage and one of current.
    watts : float
        What a unit of the file's number, or of the product of two, is [W]; [J] for a counter of energy.
    range_file : Path, optional
        Where a counter of energy says at what number it begins again; only such a counter has one.
    part : bool
        Whether it is known to be a part of another, such as one core of a processor.
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
        """What `--sensor` calls it."""
        return f"{self.kind}:{self.name}"

    @property
    def readable(self) -> bool:
        """Whether this user may read it."""
        try:
            for file in self.files:
                _number(file)
        except InputError:
            return False
        return True


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
    """The sensor of that name or path; without one, the whole of the first kind that has any.

    Parameters
    ----------
    root : str
        The root of sysfs.
    wanted : str
        `KIND:NAME`, or the path of a sensor's folder or file; relative paths begin at the root.

    Returns
    -------
    Sensor

    Raises
    ------
    InputError
        If there is none, or several answer: with the list of what was found.
    """
    found = find_sensors(root)
    if wanted:
        path = (Path(root) / wanted).resolve()
        several = [sensor for sensor in found if wanted == sensor.label]
        several = several or [sensor for sensor in found if path in _paths(sensor)]
        problem, place = f"{len(several)} sensors are called so" if several else "no such sensor", "--sensor"
    else:
        able = [sensor for sensor in found if sensor.readable]
        kind = next((kind for kind in KINDS if any(sensor.kind == kind for sensor in able)), "")
        several = _wholes([sensor for sensor in able if sensor.kind == kind])
        problem, place = f"several sensors of the kind {kind}", "--sensor"
        if not able:
            problem, place = "no power sensor that this user can read", "--sysfs"
    if len(several) == 1:
        return several[0]
    raise InputError.at(place, 1, 1, problem, _listing(found, root), wanted)


def _paths(sensor: Sensor) -> set[Path]:
    return {path.resolve() for path in (sensor.path, *sensor.files)}


def _wholes(sensors: Sequence[Sensor]) -> list[Sensor]:
    """Those labelled as the whole; else those that are not known to be parts."""
    labelled = [sensor for sensor in sensors if sensor.name.rpartition("/")[2].lower() in WHOLE]
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


# ── what the kernel shows ──


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
    try:
        return sorted(folder.glob(pattern), key=_natural)
    except OSError:
        return []


def _natural(path: Path) -> list[tuple[int, str]]:
    """So that hwmon10 stands behind hwmon9."""
    return [(int(piece), "") if piece.isdigit() else (0, piece) for piece in re.split(r"([0-9]+)", str(path))]


def _line(file: Path) -> str:
    """The first line of a small file; '' if there is none."""
    try:
        return file.read_text(encoding="utf-8", errors="replace").strip().partition("\n")[0][:64]
    except OSError:
        return ""


def _number(file: Path) -> int:
    try:
        text = file.read_text(encoding="ascii", errors="replace").strip()
    except OSError as error:
        raise InputError.at(str(file), 1, 1, f"cannot be read: {error.strerror}", "a readable power sensor") from None
    if not _WHOLE_NUMBER.match(text):
        shown = printable(text, 40) or "nothing"
        raise InputError.at(str(file), 1, 1, f"says {shown}", "a whole number, as sensors do")
    return int(text)


# ── readings ──


@dataclass
class Meter:
    """Reads a sensor's power.

    A power is read as it is at the moment; of a counter of energy, the mean since the reading before.

    Attributes
    ----------
    sensor : Sensor
    now_s : function
        The time [s], which never goes back.
    """

    sensor: Sensor
    now_s: Callable[[], float]
    _before: tuple[float, int] | None = field(default=None, repr=False)

    def start(self) -> None:
        """Begin anew: the next reading of a counter is the mean from here."""
        self._before = (self.now_s(), _number(self.sensor.files[0])) if self.sensor.counts_energy else None

    def power_w(self) -> float:
        """The power now [W], or its mean since the last reading or start, never below 0.

        Raises
        ------
        InputError
            If the sensor cannot be read, or does not say when its counter begins again.
        """
        if self.sensor.counts_energy:
            return self._mean_w()
        numbers = [_number(file) for file in self.sensor.files]
        product = numbers[0] if len(numbers) == 1 else numbers[0] * numbers[1]
        return abs(product) * self.sensor.watts  # a battery's current may count as negative while it is drained

    def _mean_w(self) -> float:
        if self._before is None:
            raise ValueError("a counter needs a start before its first reading")
        now_s, count = self.now_s(), _number(self.sensor.files[0])
        before_s, before = self._before
        if not now_s > before_s:
            raise ValueError("two readings of a counter at one time")
        self._before = (now_s, count)
        passed = count - before
        if passed < 0:  # it has begun again: E2 + max − E1
            assert self.sensor.range_file is not None
            largest = _number(self.sensor.range_file)
            if largest < before:
                message = f"the counter fell from {before} to {count}, and begins again after {largest}"
                raise InputError.at(str(self.sensor.files[0]), 1, 1, message, "a counter that rises")
            passed += largest
        return passed * self.sensor.watts / (now_s - before_s)

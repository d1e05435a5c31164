"""What power sensors' own programs record, as traces: a column `power_w`, a row for each reading.

`FORMATS` lists them: a recogniser of the first line, and a converter of the lines.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from eadp.errors import InputError
from eadp.io.text.csv import NUMBER
from eadp.io.text.streams import Text

RAILS = ("VDD_IN", "POM_5V_IN", "VIN_SYS_5V0", "VIN")
"""Rails of a Jetson that feed the whole board, by module; the first that a log has is read."""
_RAIL = re.compile(r"(\w+) ([0-9]+)(?:mW)?/[0-9]+(?:mW)?(?= |\Z)")
_UNITS = {"w": 1.0, "mw": 1e-3, "uw": 1e-6, "v": 1.0, "mv": 1e-3, "a": 1.0, "ma": 1e-3, "ua": 1e-6}
_NVIDIA = re.compile(r"power\.draw(?:\.\w+)?(?: \[W\])?\Z")
_INA = {
    "power": re.compile(r"(?:\w*[ _])?power[ _]?[\[(]?(m?w)[\])]?\Z", re.IGNORECASE),
    "voltage": re.compile(r"(?:bus|load)[ _]?volt(?:age|s)?[ _]?[\[(]?(m?v)[\])]?\Z", re.IGNORECASE),
    "current": re.compile(r"(?:\w*[ _])?current[ _]?[\[(]?([mu]?a)[\])]?\Z", re.IGNORECASE),
}


@dataclass(frozen=True)
class RecordingFormat:
    """A program's format: its name, whether a file has it, by its first line, and the power in each line [W]."""

    name: str
    recognise: Callable[[str], bool]
    read: Callable[[Sequence[str]], Iterator[float]]


def as_trace(text: Text) -> Text:
    """A recording as a trace; another text as it is. Raises InputError where a recording has no power."""
    lines = text.body.splitlines()
    head = next((line for line in lines if line.strip()), "")
    chosen = next((each for each in FORMATS if each.recognise(head)), None)
    if chosen is None:
        return text
    readings = [f"{watts:.6g}" for watts in chosen.read(lines)]
    if not readings:
        expected = f"a rail of {', '.join(RAILS)}" if chosen.name == "tegrastats" else "readings of the power"
        raise InputError.at(text.name, 1, 1, f"is a log of {chosen.name} without a power", expected)
    return Text(text.name, "\n".join(["power_w", *readings, ""]))


def _tegrastats(lines: Sequence[str]) -> Iterator[float]:
    found = [dict(_RAIL.findall(line)) for line in lines]
    rail = next((name for name in RAILS if any(name in rails for rails in found)), "")
    yield from (int(rails[rail]) / 1000 for rails in found if rail in rails)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in re.split("[,;\t]", line)]


def _nvidia(lines: Sequence[str]) -> Iterator[float]:
    head, *rows = [_cells(line) for line in lines if line.strip()]
    index = next(i for i, name in enumerate(head) if _NVIDIA.match(name))
    for row in rows:
        value = row[index].removesuffix(" W") if index < len(row) else ""
        if NUMBER.match(value):  # else [N/A]
            yield float(value)


def _ina_columns(head: str) -> dict[str, tuple[int, float]]:
    """The columns of a head of an INA219, INA226 or INA3221, and their units in SI."""
    return {
        role: (i, _UNITS[match[1].lower()])
        for role, pattern in reversed(_INA.items())
        for i, name in reversed(list(enumerate(_cells(head))))
        if (match := pattern.match(name))
    }


def _is_ina(head: str) -> bool:
    return {"voltage", "current"} <= _ina_columns(head).keys()


def _ina(lines: Sequence[str]) -> Iterator[float]:
    head, *rows = [line for line in lines if line.strip()]
    columns = _ina_columns(head)
    factors = [columns["power"]] if "power" in columns else [columns["voltage"], columns["current"]]
    for row in map(_cells, rows):
        values = [row[i] if i < len(row) else "" for i, _ in factors]
        if all(map(NUMBER.match, values)):
            watts = 1.0
            for value, (_, unit) in zip(values, factors, strict=True):
                watts *= float(value) * unit
            yield watts


FORMATS = (
    RecordingFormat("tegrastats", lambda head: bool(re.search(r"\bRAM [0-9]+/[0-9]+MB", head)), _tegrastats),
    RecordingFormat("nvidia-smi", lambda head: any(map(_NVIDIA.match, _cells(head))), _nvidia),
    RecordingFormat("an INA219 or INA226", _is_ina, _ina),
)
"""Formats of recordings; the first that recognises a file's first line reads it."""

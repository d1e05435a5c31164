"""Rows of tables with the position of each field, and what is wrong with a field that should be a number."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import TextIO

from eadp.errors import Fault, printable

NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\Z")
DECIMAL_COMMA = re.compile(r"[-+]?[0-9]*,[0-9]+(?:[eE][-+]?[0-9]+)?\Z")
"""A number with a decimal comma."""
ISO_TIME = re.compile(r"[0-9]{4}([-/])[0-9]{2}\1[0-9]{2}[T ][0-9]{2}:[0-9]{2}")
"""Start of a time by ISO 8601, or with slashes in its date."""
NOT_FINITE = re.compile(r"[-+]?(?:nan|inf|infinity)\Z", re.IGNORECASE)


def write_rows(stream: TextIO, rows: Iterable[Iterable[object]]) -> None:
    """Write rows as CSV."""
    csv.writer(stream, lineterminator="\n").writerows(rows)


@dataclass
class Row:
    """A line of a table and its fields, without the quotes and blanks around them; `mark` separates them.

    Nothing changes it. It is not frozen because a log has a million rows, and a frozen one takes long to make.
    """

    file: str
    line: int
    source: str
    fields: list[str]
    mark: str = ","

    @cached_property
    def columns(self) -> list[int]:
        """The columns, from 1, where the fields start."""
        if not self.mark:
            return [match.start() + 1 for match in re.finditer(r"\S+", self.source)]
        raw = _split(self.source, self.mark)
        starts = accumulate((len(text) + 1 for text in raw), initial=1)
        return [
            start + (len(text) - len(text.lstrip()) if text.strip() else 0)
            for start, text in zip(starts, raw, strict=False)
        ]

    def fault(self, index: int, message: str, expected: str = "") -> Fault:
        """A fault at a field; at the end of the line where it has no such field."""
        columns = self.columns
        column = columns[index] if index < len(columns) else len(self.source) + 1
        return Fault(self.file, self.line, column, message, expected, self.source)


def repeated(names: Sequence[str]) -> list[int]:
    """Positions of the names that have stood before; an empty one is no name."""
    first: dict[str, int] = {}
    return [i for i, name in enumerate(names) if name and first.setdefault(name, i) != i]


def read_rows(file: str, body: str, mark: str | None = None) -> Iterator[Row]:
    """The rows of a table without blank lines and comments, split at the marks outside quotes, or at blanks for ''.

    Without a mark the first row decides: semicolons, tabs, commas, or else blanks. Between semicolons a comma in a
    number is the decimal mark.
    """
    for number, line in enumerate(body.split("\n"), 1):
        if not line.strip() or line.lstrip()[0] == "#":
            continue
        if mark is None:
            mark = next((each for each in ";\t," if each in line), "")
        fields = [text.strip() for text in _split(line, mark)]
        if '"' in line:
            fields = [*map(_unquoted, fields)]
        if mark == ";":
            fields = [text.replace(",", ".") if DECIMAL_COMMA.match(text) else text for text in fields]
        yield Row(file, number, line, fields, mark)


def _split(line: str, mark: str) -> list[str]:
    if not mark:
        return line.split()
    return _split_quoted(line, mark) if '"' in line else line.split(mark)


def _split_quoted(line: str, mark: str) -> list[str]:
    """As `str.split`, but not at marks within quotes."""
    pieces = [""]
    for i, part in enumerate(re.split('(")', line)):
        quoted = i % 4 == 2  # parts alternate with quotes
        first, *rest = [part] if quoted else part.split(mark)
        pieces[-1] += first
        pieces += rest
    return pieces


def _unquoted(text: str) -> str:
    return text[1:-1].replace('""', '"').strip() if len(text) > 1 and text[0] == text[-1] == '"' else text


def number_fault(raw: str, largest: float = math.inf) -> tuple[str, str] | None:
    """What is wrong with a text as a finite number up to `largest`, and what is expected; None if nothing is."""
    is_number = NUMBER.match(raw)
    if is_number and abs(value := float(raw)) <= largest and math.isfinite(value):
        return None
    shown = printable(raw, 40) or "an empty field"
    if is_number:
        expected = "a finite number" if math.isinf(largest) else f"a number of at most {largest:g}"
        return f"{shown} is too large", expected
    if NOT_FINITE.match(raw):
        return f"{shown} is not finite", "a finite number"
    if re.match(r"[0-9]{4}-[0-9]{2}-[0-9]{2}", raw):
        return f"{shown} is a date", "a number, of a time in seconds"
    comma = DECIMAL_COMMA.match(raw)
    return f"{shown} is not a number", f"a decimal point, as in {raw.replace(',', '.')}" if comma else "a number"

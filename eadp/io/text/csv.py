"""Lines of comma-separated fields with the location of each."""

from __future__ import annotations

import re
from dataclasses import dataclass

from eadp.errors import Fault

NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\Z")
NOT_FINITE = re.compile(r"[-+]?(?:nan|inf|infinity)\Z", re.IGNORECASE)


@dataclass(frozen=True)
class Row:
    """A line of fields; `columns` are the columns, from 1, where they start."""

    file: str
    line: int
    source: str
    fields: list[str]
    columns: list[int]

    def fault(self, index: int, message: str, expected: str = "") -> Fault:
        """A fault at a field; at the end of the line where it has no such field."""
        column = self.columns[index] if index < len(self.columns) else len(self.source) + 1
        return Fault(self.file, self.line, column, message, expected, self.source)


def split_fields(line: str) -> tuple[list[str], list[int]]:
    """Split at the commas outside quotes: the fields, bare, and the column where each starts."""
    fields, columns = [], []
    start, quoted = 0, False
    for i, c in enumerate(line + ","):
        if c == '"':
            quoted = not quoted
        elif c == "," and (not quoted or i == len(line)):
            raw = line[start:i]
            text = raw.strip()
            columns.append(start + 1 + (len(raw) - len(raw.lstrip()) if text else 0))
            if len(text) > 1 and text[0] == text[-1] == '"':
                text = text[1:-1].replace('""', '"').strip()
            fields.append(text)
            start = i + 1
    return fields, columns

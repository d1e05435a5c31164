"""JSON reader that keeps the location of every value.

The standard library's reader does not, and a fault in a file of thousands of positions needs its line. Duplicate keys
and lists or objects nested too deeply are refused.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from eadp.errors import InputError, printable
from eadp.io.text.streams import Text

NESTING_LIMIT = 50
"""Greatest nesting of lists and objects, the document included."""

_SPACE = re.compile(r"[ \t\n\r]*")
_POSITION = re.compile(
    r"\[N,N(?:,N)?\]".replace("N", r"[ \t\n\r]*+(-?(?:0|[1-9][0-9]*+)(?:\.[0-9]++)?(?:[eE][-+]?[0-9]++)?)[ \t\n\r]*+")
)
EXACT_DIGITS = 17
"""Most digits of a whole number that is kept as one."""


def _whole(digits: str) -> float:
    return int(digits) if len(digits) <= EXACT_DIGITS else float(digits)


class JsonList(list[Any]):
    """A JSON list; `offsets` are those of its elements.

    A list of two or three finite numbers, a position, is a tuple of floats instead and has none.
    """

    __slots__ = ("offsets",)

    def __init__(self) -> None:
        self.offsets: list[int] = []


class JsonObject(dict[str, Any]):
    """A JSON object; `offsets` are those of its values."""

    __slots__ = ("offsets",)

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        super().__init__(values or {})
        self.offsets: dict[str, int] = {}


class JsonReader:
    """A reader of JSON that keeps the offset of every value but those within a position.

    `not_finite`: whether NaN, infinities and what is too large for a float are read, though JSON has none.
    """

    def __init__(self, source: Text, *, not_finite: bool = False) -> None:
        self.source, self.body, self._not_finite = source, source.body, not_finite
        self._decoder = json.JSONDecoder(parse_int=_whole)

    def document(self) -> Any:
        """The value that the text is."""
        try:
            self._decoder.decode(self.body)  # whether it is JSON
        except json.JSONDecodeError as error:
            raise self._error(error.pos, f"is not JSON: {error.msg[:1].lower() + error.msg[1:]}") from None
        except RecursionError:
            raise self._error(0, f"nested deeper than {NESTING_LIMIT} levels") from None
        return self._value(self._skip(0), 1)[0]

    def _skip(self, i: int) -> int:
        match = _SPACE.match(self.body, i)
        assert match is not None
        return match.end()

    def _error(self, i: int, message: str, expected: str = "") -> InputError:
        return self.source.error(self.source.location(i), message, expected)

    def _value(self, i: int, depth: int) -> tuple[Any, int]:
        """The value at an offset, and the offset of what follows it and the blanks after it."""
        if depth > NESTING_LIMIT:
            raise self._error(i, f"nested deeper than {NESTING_LIMIT} levels")
        c = self.body[i]
        if c == "[" and (position := _POSITION.match(self.body, i)):  # most lists of a file
            place = tuple(float(number) for number in position.groups() if number)
            if all(map(math.isfinite, place)):
                return place, self._skip(position.end())
        if c == "[":
            return self._list(self._skip(i + 1), depth)
        if c == "{":
            return self._object(self._skip(i + 1), depth)
        scalar, end = self._decoder.raw_decode(self.body, i)
        if isinstance(scalar, float) and not (self._not_finite or math.isfinite(scalar)):
            raise self._error(i, f"{printable(self.body[i:end], 40)} is no number of JSON", "a finite number")
        return scalar, self._skip(end)

    def _list(self, i: int, depth: int) -> tuple[JsonList, int]:
        """The list whose elements begin at an offset, and what follows it as `_value`."""
        found = JsonList()
        while self.body[i] != "]":
            found.offsets.append(i)
            value, i = self._value(i, depth + 1)
            found.append(value)
            i = self._skip(i + 1) if self.body[i] == "," else i
        return found, self._skip(i + 1)

    def _object(self, i: int, depth: int) -> tuple[JsonObject, int]:
        """The object whose members begin at an offset, and what follows it as `_value`."""
        found = JsonObject()
        while self.body[i] != "}":
            key, colon = self._value(i, depth)
            if key in found:
                raise self._error(i, f"the key {printable(key, 80)} stands twice", "each key once")
            found.offsets[key] = i = self._skip(colon + 1)
            found[key], i = self._value(i, depth + 1)
            i = self._skip(i + 1) if self.body[i] == "," else i
        return found, self._skip(i + 1)


def json_lines(text: Text, *, whole: bool = False) -> list[dict[str, Any]]:
    """The objects of a text, one a line; with `whole`, the one that the text is.

    Raises
    ------
    InputError
        At what is no JSON object.
    """
    documents = []
    for number, line in enumerate([text.body] if whole else text.body.splitlines(), 1):
        try:
            document = json.loads(line)
        except (ValueError, RecursionError) as error:
            place = getattr(error, "lineno", 1) + number - 1, getattr(error, "colno", 1)
            raise InputError.at(text.name, *place, "is not JSON", "a JSON object") from None
        if not isinstance(document, dict):
            raise InputError.at(text.name, number, 1, "is no JSON object", "a JSON object")
        documents.append(document)
    return documents


def significant(value: float | None, digits: int = 6) -> float | None:
    """A number rounded to significant digits; None where there is none."""
    return None if value is None or not math.isfinite(value) else float(f"{value:.{digits}g}")


def aligned(rows: Sequence[Sequence[str]], first: str = ">", others: str = ">") -> list[str]:
    """Lines of a table; `first` is the alignment of the first column, `others` that of the rest: < or >."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = [first, *others * (len(widths) - 1)]
    return [
        "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths, strict=True)).rstrip()
        for row in rows
    ]

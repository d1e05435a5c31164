"""A text by lines: locations in it, and faults at them."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate

from eadp.errors import Fault, InputError
from eadp.io.text.streams import Text

Location = tuple[int, int]
"""Line and column, from 1."""


class SourceText:
    """A text by lines."""

    def __init__(self, text: Text) -> None:
        self.name, self.body, self.lines = text.name, text.body, text.body.split("\n")

    @cached_property
    def starts(self) -> Sequence[int]:
        """Offsets of the lines; an array, since a text may be all line ends."""
        return array("q", accumulate((len(line) + 1 for line in self.lines), initial=0))

    def location(self, offset: int) -> Location:
        """Line and column of an offset."""
        line = bisect_right(self.starts, offset, hi=len(self.lines))
        return line, offset - self.starts[line - 1] + 1

    def fault(self, location: Location, message: str, expected: str = "") -> Fault:
        """A fault at a location, with the line it is in."""
        line, column = location
        source = self.lines[line - 1] if line <= len(self.lines) else ""
        return Fault(self.name, line, column, message, expected, source)

    def error(self, location: Location, message: str, expected: str = "") -> InputError:
        """The error of a single fault at a location, to be raised."""
        return InputError(self.fault(location, message, expected))

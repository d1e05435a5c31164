"""Files that another file names: a text that is not ours is not quoted, as its owner may be another than the writer."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from eadp.errors import Fault, InputError, printable
from eadp.io.text.streams import Text

Content = TypeVar("Content")

_OURS = re.compile(
    r"""\A(?:\s*(?:[#%][^\n]*)?\n)*                      # after comments and blank lines
    (?: [^\n]*power                                     # the header of measurements
      | [-+0-9.eE,;\s]+$                                # or numbers
      | [^\n;]+;[^\n;]+;                                # the first line of a stage
      | \s*(?:init|path)\s*:\s*$                        # of sections
      | QGC[ ]WPL | \{\s*"fileType" )                   # missions
    | ^[\s{]*["']?schema["']?\s*:\s*["']?eadp\.         # the key of every YAML file
    | ^(?:airframe|battery|wind|planner|points)\s*:       # or a key of one where that is missing""",
    re.VERBOSE | re.MULTILINE | re.IGNORECASE,
)
HEAD = 20_000
"""Characters by which a text is recognised."""


def parse_named(text: Text, parse: Callable[[Text], Content], reference: Fault | None) -> Content:
    """The content of a file; `reference` is the location where another file names it, if one does.

    Raises
    ------
    InputError
        As `parse` does; at the reference, and without a word of the file, if that is no text of ours.
    """
    try:
        return parse(text)
    except InputError as error:
        if reference is None or _OURS.search(text.body[:HEAD]):
            raise
        message = f"{printable(text.name)} is none of eadp's files, by its line {error.faults[0].line}"
        raise InputError(replace(reference, message=message, expected="the path of one")) from None

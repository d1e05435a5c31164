"""Output of every command: results on stdout, progress and warnings on stderr."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Sequence
from contextvars import ContextVar
from dataclasses import asdict
from typing import Any

from eadp.errors import Fault, InputError, first_faults

faults_as_json: ContextVar[bool] = ContextVar("faults_as_json", default=False)
"""Whether faults are printed as JSON."""


def emit(text: str) -> None:
    """Print a result, ending in one newline."""
    sys.stdout.write(text if text.endswith("\n") else text + "\n")


def emit_json(document: dict[str, Any]) -> None:
    """Print one JSON document; NaN and infinities are refused, as JSON has none."""
    emit(json_text(document, indent=2))


def json_text(document: Any, indent: int | None = None) -> str:
    """A JSON document in the characters that standard output has; raises ValueError as `emit_json`."""
    plain = not (getattr(sys.stdout, "encoding", None) or "utf-8").lower().startswith("utf")
    return json.dumps(document, indent=indent, ensure_ascii=plain, allow_nan=False)


def warn(warnings: Iterable[Fault]) -> None:
    """Print warnings on stderr: the first of them, and the number of the rest."""
    if shown := first_faults(warnings):
        sys.stderr.write(faults_text(shown))


def faults_text(faults: Sequence[Fault]) -> str:
    """Faults as lines, or as one line of JSON where that is asked for."""
    if faults_as_json.get():
        return json_text({"schema": "eadp.faults/1", "faults": [asdict(fault) for fault in faults]}) + "\n"
    return "".join(f"{fault}\n" for fault in faults)


def usage_fault(option: str, raw: str, message: str, expected: str, column: int = 1) -> InputError:
    """An error in the value of an option, placed in the option's own text."""
    return InputError.at(option, 1, column, message, expected, raw)


class Progress:
    """A progress line on stderr: redrawn on a terminal once a job has taken a second, else a line every 10 s.

    `every_s` is the time between two lines where there is no terminal [s].
    """

    def __init__(self, title: str, every_s: float = 10.0) -> None:
        self._title = title
        self._every_s = every_s
        self._terminal = sys.stderr.isatty()
        self._due_s = time.monotonic() + (1.0 if self._terminal else every_s)
        self._drawn = False

    def show(self, status: str) -> None:
        """Draw the line if it is time to."""
        now_s = time.monotonic()
        if now_s < self._due_s:
            return
        self._due_s = now_s + (0.2 if self._terminal else self._every_s)
        self._drawn = True
        if self._terminal:
            sys.stderr.write(f"\r{self._title}: {status}\x1b[K")
        else:
            sys.stderr.write(f"{self._title}: {status}\n")
        sys.stderr.flush()

    def close(self) -> None:
        """Clear the line from a terminal."""
        if self._drawn and self._terminal:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()

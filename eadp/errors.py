"""Everything eadp raises on purpose.

EadpError
├── InputError       a file or an option is wrong: one or more faults, each with its location
├── ExpressionError  an expression breaks the grammar or a limit; the offset in its text
├── Infeasible       a request has no solution: the battery cannot deliver the power, no control is admissible
│   └── Unreachable  a target of a path through waypoints and circles cannot be reached from the one before
├── CommandError     a command to be measured did not start, or ended by itself
├── PathUndefined    a path function has no value where the robot is
└── SolverFailed     the solver gave no answer that may be used as one
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace


class EadpError(Exception):
    """What eadp raises on purpose: the base of `InputError`, `Infeasible` and all its other errors."""


def printable(text: str, limit: int = 200) -> str:
    """Text as it may stand in a message: control characters escaped, cut at `limit` characters."""
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text[: limit + 1])
    return shown if len(shown) <= limit else shown[:limit] + "…"


def counted(count: int, noun: str) -> str:
    """A count with its noun: "1 hole", "2 holes"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def one_of(known: Iterable[str], given: str) -> str:
    """What is expected where one of some names is: them, and the one that what was given looks like."""
    import difflib

    names = list(dict.fromkeys(known))
    like = difflib.get_close_matches(given, names, 1)
    return f"one of {', '.join(names)}{f'; did you mean {like[0]}?' if like else ''}" if names else ""


@dataclass(frozen=True)
class Fault:
    """One fault of an input, with its location.

    `line` and `column` count from 1; `expected` is what would be right; `source` is the line itself.
    """

    file: str
    line: int
    column: int
    message: str
    expected: str = ""
    source: str = ""
    severity: str = "error"

    def __str__(self) -> str:
        tail = f"; expected {self.expected}" if self.expected else ""
        head = f"{printable(self.file)}:{self.line}:{self.column}: {self.severity}: {self.message}{tail}"
        return head + self._caret()

    def _caret(self) -> str:
        if not self.source.strip():
            return ""
        # a window round the column keeps long lines readable
        start = max(0, self.column - 61) if len(self.source) > 100 else 0
        window = self.source[start : start + 100]
        before = printable(window[: self.column - 1 - start], 400)
        return f"\n    {printable(window, 400)}\n    {' ' * len(before)}^"


SEVERITIES = ("error", "warning", "note")
"""From the gravest on."""

FAULTS_SHOWN = 20
FAULTS_READ = 10_000
"""Faults after which a reader of rows leaves the rest of a file unread."""


def first_faults(faults: Iterable[Fault]) -> list[Fault]:
    """The first `FAULTS_SHOWN` faults by line; the rest, where they are several, are counted in one more."""
    ordered = sorted(faults, key=lambda fault: (fault.file, fault.line, fault.column))
    shown, hidden = ordered[:FAULTS_SHOWN], ordered[FAULTS_SHOWN:]
    if len(hidden) <= 1:
        return ordered
    gravest, *lesser = (each for each in SEVERITIES if each in {fault.severity for fault in hidden})
    kinds = "faults" if gravest == "error" else " and ".join(f"{each}s" for each in (gravest, *lesser))
    many = f"at least {len(hidden)}" if len(ordered) >= FAULTS_READ else f"{len(hidden)}"
    count = f"{many} more {kinds} from here on"
    return [*shown, replace(hidden[0], message=count, expected="", source="", severity=gravest)]


class InputError(EadpError):
    """A file or an option is wrong. Carries the faults that were found: `first_faults`."""

    def __init__(self, *faults: Fault) -> None:
        self.faults: Sequence[Fault] = first_faults(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))

    def __reduce__(self) -> tuple[type[InputError], tuple[Fault, ...]]:
        return type(self), tuple(self.faults)

    @classmethod
    def at(cls, file: str, line: int, column: int, message: str, expected: str = "", source: str = "") -> InputError:
        """An error with a single fault."""
        return cls(Fault(file, line, column, message, expected, source))


def refuse(faults: Sequence[Fault]) -> None:
    """Raise the error of the faults, if there are any."""
    if faults:
        raise InputError(*faults)


class ExpressionError(EadpError):
    """An expression breaks the grammar or a limit, at `offset` [characters] of its text."""

    def __init__(self, offset: int, message: str, expected: str = "") -> None:
        self.offset, self.message, self.expected = offset, message, expected
        super().__init__(message)


class Infeasible(EadpError):
    """A request has no solution; `advice` is what may have one."""

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message)
        self.advice = advice


class Unreachable(Infeasible):
    """The target of a path with this index (from 0) cannot be reached."""

    def __init__(self, target: int, message: str) -> None:
        self.target = target
        super().__init__(message)


class CommandError(EadpError):
    """A command to be measured did not start, ended by itself, or cannot be ended."""


class PathUndefined(EadpError):
    """A path function or a point of a plan has no finite real value at the given place."""


class SolverFailed(EadpError):
    """The solver gave no answer that may be used as one; the message names its status."""

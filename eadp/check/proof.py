"""What sympy proves of a plan's triggers for every value of the parameters, where a check by value samples them.

For each stage: φ at its trigger, of its own path and of the next one (0: the trigger lies on it), and whether the two
are travelled in one direction there. A proof that takes longer, or an expression that is larger, than `ANSWER_LIMIT_S`
and `algebra.SIZE_LIMIT` is given up. In segments that repeat, the variables that change from lap to lap are symbols:
what holds, holds in every lap. From one lap of theirs to the next, and between segments, nothing is proven.

sympy knows no limit of time: a text of a hundred characters can keep it busy for hours. Only a process can be ended at
any moment, on every platform and from every thread. Its watchdog is a timer of the system, or a thread of C, which a
long operation on a large number does not hold up.

Source: draft 002, Def. III.1; draft 003, Def. IV.1.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import TracebackType
from typing import IO, Any, NamedTuple

from eadp.core.expressions import algebra
from eadp.core.expressions.algebra import SIZE_LIMIT, SymbolicStage
from eadp.core.expressions.reader import read_expression
from eadp.core.expressions.tree import (
    LENGTH_LIMIT,
    NON_SMOOTH_FUNCTIONS,
    PARAMETER,
    Expression,
    difference,
    substituted,
)
from eadp.errors import EadpError, ExpressionError, InputError
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import PointExpression, Stage

ANSWER_LIMIT_S = 2.0
"""Processor time for one answer [s]: what is proven does not depend on what else the machine does."""

WAITED = 30
"""An answer waits at most so many times its processor time; once, on a platform without a timer of that."""

MEMORY_LIMIT_BYTES = 2 << 30
"""Memory of the other process, where the platform can limit it."""

_READY = "ready"


class AlgebraProcess:
    """A process that computes with sympy: started by the first question, ended on leaving the context.

    Attributes
    ----------
    spent_s : float
        Processor time of all answers [s].
    """

    def __init__(self) -> None:
        self.spent_s = 0.0
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> AlgebraProcess:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._end()

    def ask(self, question: str, *arguments: Any) -> Any:
        """The answer to one of `QUESTIONS`; None where there is none within the limits of size, time and memory.

        Raises
        ------
        EadpError
            If sympy cannot be imported.
        """
        try:
            process = self._process or self._started()
            _write(process.stdin, [question, ANSWER_LIMIT_S, *arguments])
            line = _read(process.stdout)
        except OSError:  # no process can be started, or it has ended
            line = ""
        if not line:
            self._end()
            self.spent_s += ANSWER_LIMIT_S
            return None
        answer, spent_s = json.loads(line)
        self.spent_s += spent_s
        return answer

    def _started(self) -> subprocess.Popen[str]:
        if importlib.util.find_spec("sympy") is None:
            algebra.load_sympy()
        if getattr(sys, "frozen", False) or not sys.executable:  # there is no interpreter to start
            raise OSError
        code = "from eadp.check.proof import serve; serve()"
        self._process = process = subprocess.Popen(
            [sys.executable, "-P", "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(part or os.getcwd() for part in sys.path)},
            encoding="utf-8",
        )
        greeting = _read(process.stdout)
        if greeting and json.loads(greeting) != _READY:
            self._end()
            raise EadpError(json.loads(greeting))
        return process

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with contextlib.suppress(OSError):
                process.communicate()


def _write(stream: IO[str] | None, message: Any) -> None:
    assert stream is not None
    stream.write(json.dumps(message) + "\n")
    stream.flush()


def _read(stream: IO[str] | None) -> str:
    assert stream is not None
    return stream.readline()


# --- the other process ------------------------------------------------------------------------------------------------


def serve() -> None:
    """Answer questions, one a line, until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that asks: it ends this one
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    try:
        algebra.load_sympy()
    except EadpError as error:
        _write(sys.stdout, str(error))
        return
    _write(sys.stdout, _READY)
    for line in sys.stdin:
        question, limit_s, *arguments = json.loads(line)
        start_s = time.process_time()
        with _limited(limit_s):
            try:
                answer = QUESTIONS[question](*arguments)
            except Exception:  # whatever sympy raises, there is no answer
                answer = None
        _write(sys.stdout, [answer, time.process_time() - start_s])


@contextlib.contextmanager
def _limited(limit_s: float) -> Iterator[None]:
    """Within it this process ends once it has taken so much processor time [s], by a signal that nothing holds up."""
    timed = hasattr(signal, "setitimer")
    if timed:
        signal.setitimer(signal.ITIMER_PROF, limit_s)
    faulthandler.dump_traceback_later(WAITED * limit_s if timed else limit_s, exit=True)
    yield
    faulthandler.cancel_dump_traceback_later()
    if timed:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def remainder(text: str, names: Sequence[str]) -> str | None:
    """An expression multiplied out by sympy, in its syntax: '0' where it is 0 for every value.

    None where that is undecided, or the text is longer than an expression may be.
    """
    sympy, expression = algebra.load_sympy(), read_expression(text, names)
    value = sympy.expand(algebra.limited(expression))
    if value != 0 and algebra.is_zero(expression.node):
        return "0" if sympy.simplify(value) == 0 else None
    found = str(sympy.sstr(value))
    return None if value.has(sympy.nan, sympy.zoo, sympy.oo) or len(found) > LENGTH_LIMIT else found


def same_direction(
    stage: Sequence[str],
    after: Sequence[str],
    names: Sequence[str],
    sense: int,
    ranges: Mapping[str, tuple[float, float]],
) -> bool | None:
    """Whether the gradients of two paths, each at the trigger that comes with it, are parallel for all parameters.

    Parameters
    ----------
    stage, after : sequence of str
        As `texts_of` has them: the trigger of each is the point where they meet, in the frame of its own path.
    names : sequence of str
        Of loop variables.
    sense : int
        +1: they shall point the same way; −1: opposite ways.
    ranges : mapping of str to (float, float)
        The sets of the parameters; a name that is not in it may have any value.

    Returns
    -------
    bool or None
        None: undecided.
    """
    sympy, (x, y) = algebra.load_sympy(), algebra.coordinates()
    here, there = _stage(stage, names), _stage(after, names)
    ax, ay = here.gradient.xreplace({x: here.trigger[0], y: here.trigger[1]})
    bx, by = there.gradient.xreplace({x: there.trigger[0], y: there.trigger[1]})
    across = remainder(*_text_of(sympy.expand(ax * by - ay * bx)))
    if across != "0":
        return None if across is None else False
    # the sign of a·b over the box of the sets, by interval arithmetic on exact numbers
    intervals = {
        sympy.Symbol(name, real=True): sympy.AccumBounds(sympy.Rational(repr(lo)), sympy.Rational(repr(hi)))
        for name, (lo, hi) in ranges.items()
    }
    along = sympy.expand(sense * (ax * bx + ay * by)).subs(intervals)
    lowest, highest = (along.min, along.max) if isinstance(along, sympy.AccumBounds) else (along, along)
    return True if lowest.is_positive else False if highest.is_negative else None


def _text_of(value: Any) -> tuple[str, list[str]]:
    """A sympy tree in the language of plans, and the names in it; in sympy's own where plans have no such function."""
    text = str(algebra.load_sympy().sstr(value, order="none"))
    for name in NON_SMOOTH_FUNCTIONS:
        text = text.replace(f"{name.title()}(", f"{name}(")
    return text, [symbol.name for symbol in value.free_symbols]


def lines(texts: Sequence[str], names: Sequence[str], index: int, style: str) -> list[str]:
    """The expressions of a stage in sympy's plain syntax, each with its name as a comment, or as LaTeX.

    Parameters
    ----------
    texts, names, index : sequences of str, int
        The stage as `texts_of` has it, its loop variables and its number.
    style : str
        `sympy` or `latex`.
    """
    sympy, stage = algebra.load_sympy(), _stage(texts, names)
    if style == "latex":
        labelled = {
            rf"\varphi_{{{index}}}": stage.path,
            rf"\nabla \varphi_{{{index}}}": stage.gradient,
            rf"\nabla^{{2}} \varphi_{{{index}}}": stage.hessian,
            rf"\mathbf{{p}}_{{\Gamma_{{{index}}}}}": stage.trigger,
        }
        return [f"{name} = {sympy.latex(value)}" for name, value in labelled.items()]
    (xx, xy), (_, yy) = stage.hessian.tolist()
    values = (stage.path, *stage.gradient, xx, xy, yy, *stage.trigger)
    labels = [f"phi_{index}{d}" for d in ("", "_x", "_y", "_xx", "_xy", "_yy")]
    labels += [f"trigger_{index}_x", f"trigger_{index}_y"]
    return [f"{sympy.sstr(value)}  # {name}" for name, value in zip(labels, values, strict=True)]


def _stage(texts: Sequence[str], names: Sequence[str]) -> SymbolicStage:
    path, x, y = (read_expression(text, names) for text in texts)
    return SymbolicStage.of(path, (x, y))


QUESTIONS: Mapping[str, Callable[..., Any]] = {"remainder": remainder, "same_direction": same_direction, "lines": lines}


def texts_of(path: Expression, trigger: tuple[Expression, Expression]) -> list[str]:
    """A stage as questions have it."""
    return [path.text, trigger[0].text, trigger[1].text]


def _expressions(plan: Plan, file: str, *, style: str) -> str:
    """Path functions, gradients, Hessians and triggers as the process that may be ended prints them.

    Raises InputError at a stage of `file`.
    """
    lines = []
    with AlgebraProcess() as process:
        for stage in plan.stages:
            names = [q.name for q in stage.segment.variables] if stage.segment else []
            printed = process.ask("lines", texts_of(stage.path, stage.trigger), names, stage.index, style)
            if printed is None:
                message = f"sympy gives no expressions of stage {stage.index}"
                expected = f"expressions of at most {SIZE_LIMIT} parts, printed within {ANSWER_LIMIT_S:g} s"
                raise InputError.at(file, stage.line, 1, message, expected)
            lines += printed
    return "\n".join(lines)


sympy_text = partial(_expressions, style="sympy")
latex_text = partial(_expressions, style="latex")


PROOFS_LIMIT_S = 10.0
"""Processor time for all proofs of a plan [s]; each has `ANSWER_LIMIT_S`."""


@dataclass(frozen=True)
class StageProof:
    """What is proven of a stage; None: undecided, or there is no next stage.

    `own` and `next` are φ_i and φ_{i+1} at the trigger of stage i, in sympy's syntax: '0' where it lies on the path for
    every parameter. `direction` is whether both are travelled in one direction there, for every parameter of the sets.
    """

    own: str | None = None
    next: str | None = None
    direction: bool | None = None

    @property
    def own_gap(self) -> str:
        """The formula of how far the trigger is off its path; empty where it lies on it, or that is undecided."""
        return "" if self.own in (None, ON_PATH) else str(self.own)

    @property
    def next_gap(self) -> str:
        """As `own_gap`, of the next path."""
        return "" if self.next in (None, ON_PATH) else str(self.next)


ON_PATH = "0"
"""φ at a trigger that lies on the path."""


class PlacedPath(NamedTuple):
    """A path, and a point in the frame of that path."""

    path: Expression
    point: PointExpression

    @property
    def parts(self) -> tuple[Expression, ...]:
        """All its expressions."""
        return self.path, *self.point


class Meeting(NamedTuple):
    """A stage's path at its trigger, and the stage after it with its own path there."""

    here: PlacedPath
    there: PlacedPath
    after: Stage


def prove_plan(plan: Plan) -> tuple[StageProof, ...]:
    """What sympy proves of each stage of a plan, within the limits of time and size.

    Raises
    ------
    EadpError
        If sympy cannot be imported.
    """
    with AlgebraProcess() as process:
        return tuple([_proof(process, plan, stage) for stage in plan.stages])


def _proof(process: AlgebraProcess, plan: Plan, stage: Stage) -> StageProof:
    try:
        here = _in_a_lap(stage)
        own, meeting = _off_path(process, here), _meeting(plan, stage, here)
        if meeting is None:
            return StageProof(own)
        return StageProof(own, _off_path(process, meeting.there), _same_sense(process, stage, meeting))
    except ExpressionError:  # too large, once substituted
        return StageProof()


def _meeting(plan: Plan, stage: Stage, here: PlacedPath) -> Meeting | None:
    """Where a stage meets the next one; None where that is no single one in the same lap."""
    last = stage.index == len(plan.stages)
    after = None if last and not plan.repeats else plan.stages[stage.index % len(plan.stages)]
    if after is None or after.segment is not stage.segment:
        return None
    x, y = here.point
    if last and plan.shift is not None:
        x, y = difference(x, plan.shift[0]), difference(y, plan.shift[1])
    return Meeting(here, PlacedPath(_in_a_lap(after).path, (x, y)), after)


def _in_a_lap(stage: Stage) -> PlacedPath:
    """A stage in any lap: formulas substituted, the variables that change from lap to lap as symbols."""
    formulas = stage.segment.formulas({}) if stage.segment else {}
    if not formulas:
        return PlacedPath(stage.path, stage.trigger)
    x, y = stage.trigger
    return PlacedPath(substituted(stage.path, formulas), (substituted(x, formulas), substituted(y, formulas)))


def _may_ask(process: AlgebraProcess, *parts: Expression) -> bool:
    """Whether a question of expressions is within the limits of size and of time."""
    return sum(part.size for part in parts) <= SIZE_LIMIT and process.spent_s <= PROOFS_LIMIT_S


def _off_path(process: AlgebraProcess, placed: PlacedPath) -> str | None:
    """φ at the point, '0' where it lies on the path; None where that is undecided."""
    x, y = placed.point
    value = substituted(placed.path, {"x": x, "y": y})
    if not _may_ask(process, value):
        return None
    answer: str | None = process.ask("remainder", value.text, _loop_variables(value))
    return answer


def _same_sense(process: AlgebraProcess, stage: Stage, meeting: Meeting) -> bool | None:
    """Whether a stage and the one after it are travelled in one direction where they meet; None: undecided."""
    here, there, after = meeting
    parts = (*here.parts, *there.parts)
    if not _may_ask(process, *parts):
        return None
    ranges = {f"c{i}": (box.lo, box.hi) for i, box in enumerate(stage.sets, 1)}
    names = sorted({name for part in parts for name in _loop_variables(part)})
    answer: bool | None = process.ask(
        "same_direction", texts_of(*here), texts_of(*there), names, stage.sense * after.sense, ranges
    )
    return answer


def _loop_variables(expression: Expression) -> list[str]:
    return sorted(name for name in expression.names - {"x", "y"} if not PARAMETER.match(name))

"""Fuzz the plan reader, its printer and its check by coverage; by hand, not in the test suite.

usage: pip install atheris; python benchmarks/fuzz_plan.py [CORPUS_FOLDER] -max_total_time=600

Whatever the bytes: nothing but the project's own errors, no run longer than two seconds, and what can be read prints as
text that reads as the same plan. docs/fuzzing.md says what was run and what came of it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["eadp"]):
    from eadp.errors import EadpError, InputError, PathUndefined
    from eadp.io.plan.reader import read_plan
    from eadp.io.plan.writer import plan_text
    from eadp.io.text.streams import Text
    from eadp.models.plan.trace import nominal_legs
    from eadp.validation.check import check_plan

LIMIT_S = 2.0
ROOT = Path(__file__).resolve().parent.parent


def one(data: bytes) -> None:
    """Read, print, read again, check; anything unexpected escapes."""
    started = time.process_time()
    text = data.decode("utf-8", errors="replace")
    try:
        plan, _ = read_plan(Text("fuzz", text))
    except InputError:
        assert time.process_time() - started < LIMIT_S, "slow to refuse"
        return
    printed = plan_text(plan)
    assert time.process_time() - started < LIMIT_S, "slow to read"
    try:
        again, _ = read_plan(Text("again", printed))
    except InputError as error:
        # spaces that the canonical text adds may take an expression over its limit of characters
        if not ("characters" in str(error) or "nested" in str(error)):
            raise RuntimeError(printed) from error
        return
    assert plan_text(again) == printed
    try:
        check_plan(plan)
        nominal_legs(plan, [box.hi for box in plan.stages[0].sets] or [0.0] * plan.path_count)
    except (EadpError, PathUndefined):
        pass


def seeds(folder: str) -> None:
    """Plans of the repository as a first corpus."""
    for index, path in enumerate([*ROOT.glob("plans/*.plan"), *ROOT.glob("tests/bad/*.plan")]):
        (Path(folder) / f"seed{index}").write_bytes(path.read_bytes())


if __name__ == "__main__":
    arguments = sys.argv
    if not any(Path(argument).is_dir() for argument in arguments[1:]):
        made = tempfile.mkdtemp()
        seeds(made)
        arguments = [*arguments, made]
    atheris.Setup(arguments, one)
    atheris.Fuzz()

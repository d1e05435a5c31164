"""Does the test that a row of docs/papers.md names fall when the row's formula is broken?

    PYTHONPATH=tests/support python tests/support/papers_mutants.py [WORDS]

Each row has a mutation: in a module one text is replaced by another as it is imported, and the named test runs in a
process of its own, forked from one that has the libraries, and in plain Python, as machine code is kept. Prints row,
mutation and verdict; WORDS choose rows.
"""

import multiprocessing
import os
import re
import sys
import tempfile
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs/papers.md"


class Mutation(NamedTuple):
    """Of a row, by its paper and the beginning of its first cell: the named test, a file, its text, and another one."""

    row: str
    test: str
    file: str
    old: str
    new: str


def mutations() -> list[Mutation]:
    """Those of the table beside this script: a line of row, test and file, then the text and the other one."""
    lines = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").splitlines()
    groups = zip(lines[::3], lines[1::3], lines[2::3], strict=True)
    return [Mutation(*head.split(" | "), *(text[4:].replace("\\n", "\n") for text in texts)) for head, *texts in groups]


WITHOUT_FORMULA = {
    "Draft 003: Sec. II-B, T by j": "a claim about flights, for which nothing is computed",
    "The letter: Sec. V, ROS": "nodes, which have no formula",
}
"""Rows whose test has no formula of the package that it could fall with, and why."""


def rows() -> dict[str, list[str]]:
    """The tests that each row names, by its paper and first cell; without those that name none."""
    found = {}
    for section in re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        for line in re.findall(r"^\| (?!item \|)(.+) \|$", section, flags=re.MULTILINE):
            item, *_, tests = line.split(" | ")
            nodes, file = [], ""
            for name in re.findall(r"`(tests/\S+|test_\w+)`", tests):
                file = name.partition("::")[0] if name.startswith("tests/") else file
                nodes.append(name if name.startswith("tests/") else f"{file}::{name}")
            if nodes:
                found[f"{section.splitlines()[0]}: {item}"] = nodes
    return found


def of_row(row: str) -> list[Mutation]:
    """The mutations of a row."""
    return [each for each in mutations() if row.startswith(each.row)]


def broken(mutation: Mutation, nodes: list[str]) -> tuple[str, str]:
    """The test to run, and the file's text with the mutation.

    Raises
    ------
    ValueError
        If the row does not name the test, or its file does not have the text once.
    """
    named = [each for each in nodes if each.endswith(f"::{mutation.test}")]
    body = (ROOT / "eadp" / mutation.file).read_text(encoding="utf-8")
    if len(named) != 1 or body.count(mutation.old) != 1:
        raise ValueError(f"{mutation}: {body.count(mutation.old)} times; {nodes}")
    return named[0], body.replace(mutation.old, mutation.new)


PASSED, FELL = 10, 11
"""Exit codes: those of pytest, apart from that of an exception of the process."""

LIBRARIES = ["hypothesis", "matplotlib.pyplot", "osqp", "pydantic", "pytest", "scipy.optimize", "shapely", "typer"]


def falls(mutation: Mutation, nodes: list[str]) -> bool:
    """Whether the named test falls in a process whose package has a mutation; raises ValueError as `broken`."""
    node, body = broken(mutation, nodes)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(LIBRARIES)
    with tempfile.TemporaryDirectory() as folder:
        said = Path(folder, "said")
        process = context.Process(target=run, args=(str(ROOT / "eadp" / mutation.file), body, node, str(said)))
        process.start()
        process.join()
        printed = said.read_text(encoding="utf-8", errors="replace")
    if process.exitcode not in (PASSED, FELL) or " error" in printed.splitlines()[-1]:
        raise ValueError(f"{mutation}: {process.exitcode}: {printed[-2000:]}")
    return process.exitcode == FELL


def run(file: str, body: str, node: str, said: str) -> None:
    """Run a test in this process, in which a module of the package has another text; prints into a file."""
    read = SourceFileLoader.get_code

    def changed(self, name):
        return compile(body, file, "exec") if self.path == file else read(self, name)

    out = os.open(said, os.O_WRONLY | os.O_CREAT)
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.environ |= {"NUMBA_DISABLE_JIT": "1"}
    os.chdir(ROOT)
    SourceFileLoader.get_code = changed
    # plain asserts: the libraries were imported without pytest's
    words = ["-n", "0", "-x", "-q", "-p", "no:cacheprovider", "--assert=plain", "--rootdir", str(ROOT)]
    code = pytest.main([*words, "--hypothesis-profile", "any", str(ROOT / node)])
    sys.stdout.flush()
    os._exit(PASSED + code)


def main() -> None:
    words = " ".join(sys.argv[1:])
    for row, nodes in rows().items():
        for mutation in of_row(row):
            if words in f"{row} {mutation.test}":
                verdict = "falls" if falls(mutation, nodes) else "SURVIVES"
                print(  # noqa: T201
                    f"{verdict:<9} {row[:60]:<60} {mutation.file}: {mutation.old!r} → {mutation.new!r}", flush=True
                )


if __name__ == "__main__":
    main()

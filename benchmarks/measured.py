"""Writes what a benchmark prints to docs/measured/NAME.md, beside its command, the date and the machine.

Benchmarks print their tables as Markdown, so that the page holds what was printed. Other lines become items of a list.
Pages of the documentation link to these files and copy nothing from them.

    python benchmarks/measured.py

lists the pages whose code (`MEASURES`) has changed since they were written, or whose code was not recorded then.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import datetime
import hashlib
import io
import os
import platform
import re
import shlex
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "docs/measured"


PLANNED = "planning/joint", "planning/forecast", "planning/state"
MEASURES: dict[str, tuple[str, ...]] = {
    "ablation": PLANNED,
    "ablation_twin": PLANNED,
    "ablation_twin_1": PLANNED,
    "autopilot": ("planning/state", "live"),
    "exchange": ("exchange",),
    "fit": ("measure/spectrum.py", "measure/noise.py"),
    "flight": ("simulation/inner_loop.py", "simulation/aircraft.py", "core/guidance.py"),
    "link": ("live",),
    "quality": PLANNED,
    "real": ("exchange", "measure", "survey", "simulation/nominal.py"),
    "replan": ("papers/horizon.py", "planning/qp.py"),
    "sorties": ("survey",),
    "sweep": ("sweep", "simulation/inner_loop.py"),
    "twin": PLANNED,
    "twin_1": PLANNED,
}
"""The modules and packages of eadp that decide the figures of a page: what its benchmark is about, not all that runs.
Other pages measure all of eadp, its tests, or the plant that they are flown on."""


def add_option(parser: argparse.ArgumentParser, name: str) -> None:
    """The option --write, which writes docs/measured/NAME.md."""
    parser.add_argument("--write", action="store_true", help=f"write docs/measured/{name}.md")


def line(*cells: object) -> str:
    """A row of a Markdown table."""
    return "| " + " | ".join(str(cell) for cell in cells) + " |"


def head(*titles: str) -> str:
    """The first two rows of a Markdown table: titles, and the rule below."""
    return f"{line(*titles)}\n|{'---|' * len(titles)}"


def machine() -> str:
    """The machine in one line."""
    return f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"


def command() -> str:
    """The command line of this process."""
    script = Path(sys.argv[0]).resolve()
    return shlex.join(["python", f"benchmarks/{script.name}", *sys.argv[1:]])


def digest(paths: Sequence[str]) -> str:
    """A hash of modules and packages of eadp without comments, docstrings, layout and imports."""
    whole = hashlib.sha256()
    for path in paths:
        place = FOLDER.parents[1] / "eadp" / path
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            tree = ast.parse(file.read_text(encoding="utf-8"))
            for node in ast.walk(tree):
                body = getattr(node, "body", None)
                if isinstance(body, list):
                    node.body = [  # type: ignore[attr-defined]
                        one
                        for one in body
                        if not isinstance(one, ast.Import | ast.ImportFrom)
                        and not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))
                    ]
            whole.update(ast.dump(tree).encode())
    return whole.hexdigest()[:16]


def age(name: str) -> str:
    """Why a page may not be of the present code; empty where it is, or where it has no modules of its own."""
    if name not in MEASURES:
        return ""
    known = re.search(r"^Code `(\w+)` of", (FOLDER / f"{name}.md").read_text(encoding="utf-8"), re.MULTILINE)
    if known is None:
        return "with code that was not recorded"
    return "" if known[1] == digest(MEASURES[name]) else "with code that has changed"


def page(name: str, text: str) -> str:
    """The page of a benchmark that printed a text."""
    today = datetime.datetime.now(tz=datetime.UTC).date()
    top = [f"# Measured: {name}", "", f"    {command()}", "", f"{today}, {machine()}.", ""]
    if measures := MEASURES.get(name):
        top += [f"Code `{digest(measures)}` of {', '.join(f'`{path}`' for path in measures)}.", ""]
    return "\n".join([*top, *_body(text)]).rstrip("\n") + "\n"


def _body(text: str) -> Iterator[str]:
    """Printed lines as Markdown: tables as they are, other lines as items of a list."""
    lines = [own for printed in text.splitlines() if (own := printed.strip())]
    before = ""
    for own, after in zip(lines, [*lines[1:], ""], strict=True):
        kind = own[0] if own[0] in "|#" else "-"
        if before and (kind != before or kind == "#" or after.startswith("|---")):
            yield ""
        yield own if kind != "-" else f"- {own.removeprefix('- ')}"
        before = kind
    yield ""


class _Tee(io.TextIOBase):
    """Writes to a stream, and keeps the text."""

    def __init__(self, stream: io.TextIOBase) -> None:
        self._stream, self.kept = stream, io.StringIO()

    def write(self, text: str) -> int:
        self._stream.write(text)
        return self.kept.write(text)

    def flush(self) -> None:
        self._stream.flush()


@contextlib.contextmanager
def recorded(name: str, *, write: bool = True) -> Iterator[None]:
    """Write what is printed within to docs/measured/NAME.md, unless an error ends it."""
    tee = _Tee(sys.stdout)  # type: ignore[arg-type]
    with contextlib.redirect_stdout(tee):  # type: ignore[type-var]
        yield
    if write:
        FOLDER.mkdir(exist_ok=True)
        (FOLDER / f"{name}.md").write_text(page(name, tee.kept.getvalue()), encoding="utf-8")


if __name__ == "__main__":
    for file in sorted(FOLDER.glob("*.md")):
        measured = re.search(r"^\d{4}-\d\d-\d\d", file.read_text(encoding="utf-8"), re.MULTILINE)
        print(f"{file.stem:14} {measured[0] if measured else 'no date':10}  {age(file.stem)}".rstrip())

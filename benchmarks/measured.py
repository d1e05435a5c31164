"""Writes what a benchmark prints to docs/measured/NAME.md, beside its command, the date and the machine.

    python benchmarks/measured.py [--run] [NAME …]

lists the pages whose code (`PAGES`) has changed since they were written, or was not recorded then. With `--run` it
makes these again, or the pages named, one after the other, and prints how long each takes. Some take hours.

Benchmarks have their options, tables and statistics from here. They print tables as Markdown; other lines become items
of a list. Progress belongs on standard error.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import datetime
import hashlib
import io
import math
import os
import platform
import re
import shlex
import statistics
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).resolve().parents[1] / "docs/measured"


PLANNED = "planning/joint", "planning/forecast", "planning/state"
PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "ablation": ("quality.py --ablate --jobs 2", PLANNED),
    "autopilot": ("autopilot.py", ("planning/state", "live")),
    "fit": ("fit.py", ("measure/spectrum.py", "measure/noise.py")),
    "flight": ("flight.py", ("simulation/inner_loop.py", "simulation/aircraft.py", "core/guidance.py")),
    "forecast": ("forecast.py --jobs 2", ("planning/forecast/held.py", "planning/state/charge.py")),
    "link": ("link.py", ("live",)),
    "quality": ("quality.py --jobs 2", PLANNED),
    "real": ("real.py", ("exchange", "measure", "survey", "simulation/nominal.py")),
    "replan": ("replan.py", ("papers/horizon.py", "planning/qp.py")),
    "sorties": ("sorties.py", ("survey",)),
    "sweep": ("sweep.py", ("sweep", "simulation/inner_loop.py")),
    "twin": ("twin.py --jobs 2", PLANNED),
    "twin_1": ("twin.py --seed 1 --missions 28 --jobs 2", PLANNED),
    "twin_paced": ("twin.py --paced --jobs 2", PLANNED),
    "twin_paced_1": ("twin.py --paced --seed 1 --missions 28 --jobs 2", PLANNED),
}
"""Of each page its command, and the modules and packages of eadp that decide its figures: what its benchmark is about,
not all that runs."""


def options(text: str | None, page: str) -> argparse.ArgumentParser:
    """The options of a benchmark: its help, and --write."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"write docs/measured/{page}.md")
    return parser


def line(*cells: object) -> str:
    """A row of a Markdown table."""
    return "| " + " | ".join(yes(cell) if isinstance(cell, bool | np.bool_) else str(cell) for cell in cells) + " |"


def head(*titles: str) -> str:
    """The first two rows of a Markdown table: titles, and the rule below."""
    return f"{line(*titles)}\n|{'---|' * len(titles)}"


def table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a Markdown table, each row as it comes."""
    print(head(*titles))
    for row in rows:
        print(line(*row), flush=True)


def share(flags: Sequence[bool]) -> str:
    """How many of how many; nothing of none."""
    return f"{sum(flags)} of {len(flags)}" if flags else ""


def yes(met: object) -> str:
    """Whether something is so."""
    return "yes" if met else "no"


def rms(values: Iterable[float]) -> float:
    """Root mean square."""
    return math.sqrt(statistics.fmean(value**2 for value in values))


def mean_text(values: Sequence[float]) -> str:
    """The mean of differences and its standard error."""
    error = statistics.stdev(values) / math.sqrt(len(values)) if len(values) > 1 else math.nan
    return f"{statistics.fmean(values):+.4f} ± {error:.4f}"


def covered(
    folder: Path, fields: Mapping[str, Path | list[list[float]]], profile: object, metres: int
) -> dict[str, str]:
    """Plans of laps over fields, by corners [m] or a file: files in a folder; swath and smallest turning radius [m]."""
    found = {}
    for name, field in fields.items():
        source, found[name] = [str(field)], str(folder / f"{name}.plan")
        if isinstance(field, list):
            source = [str(folder / f"{name}.csv"), "--metres"]
            Path(source[0]).write_text("x_m,y_m\n" + "\n".join(f"{x},{y}" for x, y in field) + "\n")
        command = [sys.executable, "-m", "eadp", "cover", *source, "--pattern", "zamboni", "--min-radius", str(metres)]
        command += ["--swath", str(metres), "--profile", str(profile), "-o", found[name]]
        subprocess.run(command, check=True, capture_output=True)
    return found


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
    if name not in PAGES:
        return ""
    known = re.search(r"^Code `(\w+)` of", (FOLDER / f"{name}.md").read_text(encoding="utf-8"), re.MULTILINE)
    if known is None:
        return "with code that was not recorded"
    return "" if known[1] == digest(PAGES[name][1]) else "with code that has changed"


def page(name: str, text: str) -> str:
    """The page of a benchmark that printed a text."""
    today = datetime.datetime.now(tz=datetime.UTC).date()
    top = [f"# Measured: {name}", "", f"    {command()}", "", f"{today}, {machine()}.", ""]
    if name in PAGES:
        paths = PAGES[name][1]
        top += [f"Code `{digest(paths)}` of {', '.join(f'`{path}`' for path in paths)}.", ""]
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


def main() -> None:
    """List the pages, or make them again."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="pages, whatever their age")
    parser.add_argument("--run", action="store_true", help="make them again")
    asked = parser.parse_args()
    for name in asked.names or sorted(path.stem for path in FOLDER.glob("*.md")):
        file = FOLDER / f"{name}.md"
        written = re.search(r"^\d{4}-\d\d-\d\d", file.read_text("utf-8") if file.exists() else "", re.MULTILINE)
        why = age(name) if written else "not written"
        print(f"{name:16} {written[0] if written else '':10}  {why}".rstrip(), flush=True)
        if asked.run and (why or asked.names):
            script, *words = shlex.split(PAGES[name][0])
            started = time.perf_counter()
            command = [sys.executable, str(FOLDER.parents[1] / "benchmarks" / script), *words, "--write"]
            code = subprocess.run(command, stdout=subprocess.DEVNULL, cwd=FOLDER.parents[1], check=False).returncode
            ended = "written" if code == 0 else f"exit code {code}"
            print(f"{name:16} {ended} after {time.perf_counter() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main()

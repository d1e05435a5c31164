"""Fuzz a reader by coverage, by hand: what it finds is fixed, and gets a test.

    pip install atheris; python benchmarks/fuzz.py TARGET [SEEDS …] [--seconds 600]

Whatever the bytes: only eadp's own errors, in printable lines; no process started, no text of the input compiled;
10 s and 2 GB at most. The run ends at the first finding, which atheris keeps. SEEDS are folders of files to start from.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import atheris

with atheris.instrument_imports(include=["eadp"]):
    from eadp.api.inputs import Files, load_flight
    from eadp.check.check import check_plan
    from eadp.core.compiled import enable
    from eadp.errors import EadpError
    from eadp.io.energy import parse_energy
    from eadp.io.plan.reader import read_plan
    from eadp.io.plan.sources import PlanReader
    from eadp.io.profile.model_file import parse_profile
    from eadp.io.text.streams import Text
    from eadp.live.mavlink import tlog_messages
    from eadp.live.messages import WANTED
    from eadp.live.replanner import replan_lines
    from eadp.measure.power_log import Columns, read_csv_log
    from eadp.survey.field_reader import read_field
    from eadp.sweep.sweep_file import read_sweep

ROOT = Path(__file__).resolve().parents[1]
PLAN = str(ROOT / "plans/survey.plan")
FORBIDDEN = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect", "os.rename")
INPUTS = load_flight(PLAN, scenario=str(ROOT / "scenarios/survey.yaml"), overrides={"planner.name": "static"})
READERS: dict[str, Callable[[Text], Any]] = {
    "plan": lambda text: check_plan(read_plan(text)[0]),
    "mission": lambda text: check_plan(PlanReader()(text)[0]),
    "scenario": lambda text: load_flight(PLAN, scenario=text.name, files=Files({text.name: text})),
    "sweep": read_sweep,
    "profile": parse_profile,
    "energy": parse_energy,
    "log": lambda text: read_csv_log(text, Columns()),
    "field": read_field,
    "telemetry": lambda text: replan_lines(INPUTS, io.BytesIO(text.body.encode()), "fuzz", None, str, str),
    "tlog": lambda text: list(tlog_messages(text.body.encode("latin-1", "replace"), WANTED)),
}
reading = ""


def audit(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse what no input may cause."""
    if reading and event in FORBIDDEN:
        raise RuntimeError(f"an input causes {event}: {arguments}")
    if reading and event == "compile" and isinstance(arguments[0], str) and arguments[0].strip() in reading:
        raise RuntimeError(f"an input's text is compiled: {arguments[0]}")


def main() -> None:
    """Fuzz one target."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=READERS)
    parser.add_argument("seeds", nargs="*")
    parser.add_argument("--seconds", type=int, default=600)
    asked = parser.parse_args()

    def one(data: bytes) -> None:
        global reading
        reading = data.decode("latin-1" if asked.target == "tlog" else "utf-8", errors="replace")
        try:
            READERS[asked.target](Text(str(ROOT / "scenarios/fuzz"), reading))
        except EadpError as error:
            if not all(line.isprintable() for line in str(error).splitlines()):
                raise RuntimeError(repr(str(error))) from error
        finally:
            reading = ""

    enable(False)
    sys.addaudithook(audit)
    limits = [f"-max_total_time={asked.seconds}", "-timeout=10", "-rss_limit_mb=2048"]
    atheris.Setup([sys.argv[0], *limits, tempfile.mkdtemp(), *asked.seeds], one)  # the first folder gets what is new
    atheris.Fuzz()


if __name__ == "__main__":
    main()

"""Reading, printing and checking plans of many stages: CPU seconds against the number of stages.

usage: python benchmarks/plan.py [--stages 60 500 1000 5000]

The plan is the published survey written out stage by stage, every place a function of c1. Prints, for each size, CPU
seconds to read it (structure found included), to print it canonically, and to check it over the whole range of c1; and
the seconds per thousand stages, which stay level where the cost is linear.
"""

from __future__ import annotations

import argparse
import itertools
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text
from eadp.validation.check import check_plan


def survey_text(stages: int) -> str:
    """The survey of `stages` stages, a multiple of four."""
    sets = "[-1000, 0]\n[2, 10]\n"
    lines = []
    for k in range(stages // 4):
        dx = f"{k}*(150 - 2*sqrt(4900 + c1))"
        lines += [
            f"0.006; 90; (x - {dx} - sqrt(4900 + c1) + 115)^2 + (y - {146 + k})^2 - 4900 - c1",
            f"-115 + {dx}, {146 + k}\n{sets}".rstrip(),
            f"0.1; 270; x + 115 - {dx}",
            f"-115 + {dx}, {11 + k}\n{sets}".rstrip(),
            f"0.006; 90; (x + 40 - {dx})^2 + (y - {11 + k})^2 - 75^2",
            f"35 + {dx}, {11 + k}\n{sets}".rstrip(),
            f"0.1; 90; x - 35 - {dx}",
            f"35 + {dx}, {147 + k}\n{sets}".rstrip(),
        ]
    return "\n".join(lines) + "\n"


def measured(stages: int) -> tuple[float, float, float]:
    """CPU seconds to read, print and check a plan."""
    text = survey_text(stages)
    marks = [time.process_time()]
    plan, _ = read_plan(Text("survey", text))
    marks.append(time.process_time())
    plan_text(plan)
    marks.append(time.process_time())
    check_plan(plan)
    marks.append(time.process_time())
    read_s, print_s, check_s = (later - earlier for earlier, later in itertools.pairwise(marks))
    return read_s, print_s, check_s


def whole_command_s(stages: int) -> float:
    """CPU seconds of `eadp plan` on such a plan, start-up and imports included."""
    code = (
        "import sys, time; from eadp.cli.main import main; code = main(sys.argv[1:]);"
        "sys.stderr.write(str(time.process_time())); sys.exit(code)"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "survey.plan"
        path.write_text(survey_text(stages))
        command = [sys.executable, "-c", code, "plan", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(done.stderr)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--stages", type=int, nargs="+", default=[60, 500, 1000, 5000])
    sizes = parser.parse_args().stages
    measured(60)  # imports and first compilations apart
    print(f"{'stages':>7} {'read s':>8} {'print s':>8} {'check s':>8} {'read s/1000':>12} {'check s/1000':>13}")
    for stages in sizes:
        read_s, print_s, check_s = measured(stages)
        per = 1000 / stages
        print(
            f"{stages:>7} {read_s:>8.2f} {print_s:>8.2f} {check_s:>8.2f} {read_s * per:>12.2f} {check_s * per:>13.2f}"
        )
    runs = sorted(whole_command_s(60) for _ in range(5))
    print(f"eadp plan of 60 stages, imports included: {runs[2]:.2f} CPU s (median of 5)")


if __name__ == "__main__":
    main()

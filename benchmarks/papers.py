"""The papers' figures, drawn by the commands of the tool into a folder, to be looked at beside the captions.

    python benchmarks/papers.py -o DIR [--log LOG.csv]

A log of one's own needs time_s, power_w, x_m and y_m; without one the example log is drawn, which has no track.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PLAN = "plans/survey.plan"
FLIGHTS = ("paper-I-static", "paper-II-static", "paper-i-dynamic", "paper-ii-dynamic")


def commands(folder: Path, log: str | None) -> dict[str, list[str]]:
    """The arguments of each figure's command."""
    power = log or "scenarios/example-power-log.csv"
    found = {
        "letter Fig. 1, left; draft 002 Fig. 3": ["fit", power, "--plot", f"{folder}/log.png"],
        "letter Fig. 1, right": ["fit", power, "--spectrum", f"{folder}/spectrum.png"],
        "draft 002 Fig. 3": ["fit", power, "--filter", f"{folder}/filter.png", "--gate", "1"],
        "letter Fig. 2; draft 003 Figs. 1, 2": ["plan", PLAN, "--set", "c1=-400", "--plot", f"{folder}/plan.png"],
        "letter Fig. 5": [
            *("cover", "plans/meadow.geojson", "--min-radius", "30", "--swath", "30", "--pattern", "zamboni"),
            *("-o", f"{folder}/meadow.plan", "--plot", f"{folder}/cover.png"),
        ],
    }
    if log is not None:
        found["draft 002 Fig. 2"] = ["fit", log, "--plan", PLAN, "--track", f"{folder}/track.png"]
    for flight in FLIGHTS:
        out = ("-o", f"{folder}/{flight}", "--figure", "paper", "--force")
        found[f"letter Fig. 6, {flight}"] = ["simulate", PLAN, "--scenario", f"scenarios/{flight}.yaml", *out]
    found["letter Fig. 6"] = ["report", *(f"{folder}/{flight}" for flight in FLIGHTS), "-o", f"{folder}/flights.html"]
    return found


def main() -> None:
    """Draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", required=True, type=Path, metavar="DIR")
    parser.add_argument("--log", metavar="LOG.csv")
    options = parser.parse_args()
    options.o.mkdir(parents=True, exist_ok=True)
    for name, arguments in commands(options.o.resolve(), options.log and str(Path(options.log).resolve())).items():
        done = subprocess.run([sys.executable, "-m", "eadp", *arguments], cwd=ROOT, capture_output=True, text=True)
        # 1: a mission that is not completed, as some of the published flights
        if done.returncode not in (0, 1):
            raise SystemExit(f"{name}: {done.stderr}")
        print(f"{name}: eadp {' '.join(arguments)}")


if __name__ == "__main__":
    main()

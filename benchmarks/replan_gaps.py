"""Flights by `eadp replan` through disturbed telemetry: is the stage found again, and what does it cost?

usage: python benchmarks/replan_gaps.py [--plan FILE] [--scenario FILE] [--at 100 150 200] [--bare] [--set KEY=VALUE]

The simulated aircraft flies the decisions of the planner; what the planner knows are lines of telemetry, one a second,
disturbed on the way. Prints, for each disturbance and each of its starts: U beside that of the undisturbed flight, how
long after its end the stage is wrong, the charge left, and how the flight ends. `--bare` leaves out the optional keys.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from measured import add_option, head, line, recorded

from eadp.api.inputs import FlightInputs, load_flight
from eadp.io.scenario.scenario_file import override_texts, read_overrides

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests" / "support"))

from common.link import BARE, DISTURBANCES, UNDISTURBED, Flown, flown  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plan", default=str(ROOT / "plans/survey.plan"), help="plan (default: the survey)")
    parser.add_argument("--scenario", default=str(ROOT / "scenarios/survey.yaml"), help="scenario")
    parser.add_argument("--at", type=float, nargs="+", default=[100.0], help="starts of the disturbances [s]")
    parser.add_argument("--only", default="", help="disturbances whose name has this")
    parser.add_argument("--bare", action="store_true", help="lines without optional keys")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="settings of the scenario")
    add_option(parser, "replan_gaps")
    options = parser.parse_args()
    with recorded("replan_gaps", write=options.write):
        _print(options)


def _print(options: argparse.Namespace) -> None:
    keys = BARE if options.bare else None

    def inputs() -> FlightInputs:
        return load_flight(
            options.plan, scenario=options.scenario, overrides=read_overrides(override_texts(options.set))
        )

    print(head("telemetry", "start [s]", "U", "stage wrong after it [s]", "charge left", "end"))

    def show(name: str, start_s: float, f: Flown) -> None:
        left = f.outcome.soc_final
        cells = f"{start_s:g}", f"{f.quality:.4f}", f"{f.wrong_s:.0f}", f"{left:.4f}", f.outcome.reason
        print(line(name, *cells), flush=True)

    show(UNDISTURBED.name, 0.0, flown(inputs(), UNDISTURBED, 0.0, keys))
    for disturbance in DISTURBANCES:
        if options.only not in disturbance.name:
            continue
        for start_s in options.at:
            show(disturbance.name, start_s, flown(inputs(), disturbance, start_s, keys))


if __name__ == "__main__":
    main()

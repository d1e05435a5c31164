"""The pictures of the pages, each made by the commands of its row; `tests/test_pictures.py` compares them.

    PYTHONPATH=tests/support python tests/support/pictures.py

The picture of an aircraft's power is that of docs/aircraft.md.
"""

import shlex
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from common import ROOT

from eadp.api.inputs import load_flight
from eadp.cli.main import main
from eadp.io.figures.canvas import figure_file
from eadp.planning.base import Ending
from eadp.planning.forecast.held import before_take_off
from eadp.planning.joint.planner import JointPlanner
from eadp.report.report import read_folder

PICTURES = ROOT / "docs/pictures"
LOSS = "simulate plans/survey.plan --scenario scenarios/survey-loss.yaml"
FLIGHTS = [f"{LOSS} --planner {name} -o {{out}}/{name}" for name in ("joint", "paper", "static")]
COVER = (
    "cover plans/meadow.geojson --vehicle vehicles/foam-wing.yaml --wind 4,240 --pattern zamboni "
    "--gsd 1.4 --camera canon-sx260 --side-overlap 70:55 --format text"
)
ESTATE = (
    "cover plans/estate.geojson --vehicle vehicles/foam-wing.yaml --wind 4,240 --gsd 2.1 "
    "--camera canon-sx260 --side-overlap 80 --home 55.516,10.351 --sorties auto"
)

MADE: Mapping[str, tuple[list[str], str]] = {
    "survey.png": (FLIGHTS[:1], "joint/flight.png"),
    "survey-flights.png": ([], ""),
    "paper-i-dynamic.png": (
        ["simulate plans/survey.plan --scenario scenarios/paper-i-dynamic.yaml -o {out}/i"],
        "i/flight.png",
    ),
    "paper-I-static.png": (
        ["simulate plans/survey.plan --scenario scenarios/paper-I-static.yaml --figure paper -o {out}/I"],
        "I/paper.png",
    ),
    "sorties.png": ([f"{ESTATE} -o {{out}}/job"], "job/sorties.png"),
    "speed-to-fly.png": ([], ""),
    "meadow.png": ([f"{COVER} --plot {{out}}/meadow.png"], "meadow.png"),
}
"""Commands of each picture, and the file that they make, in a folder `{out}` of their own."""


def speed_to_fly(made: Path) -> Path:
    """Time and energy of the meadow's densest lines, at each pace and at one airspeed; what three packs have chosen."""
    plan = made.with_name("meadow.plan")
    assert main(shlex.split(f"{COVER} -o {plan}")) == 0
    wind = {"vehicle": "vehicles/foam-wing.yaml", "wind": {"speed_mps": 4, "from_deg": 240}}
    settings = {**wind, "vehicle.battery.capacity_ah": 3.0, "planner.joint.loss_rate_per_h": 0.0}

    def ending(**more: object) -> Ending:
        found = load_flight(str(plan), overrides={**settings, **more}).preflight(whole=False)
        assert found is not None
        return found.forecast

    inputs = load_flight(str(plan), overrides=settings)
    planner = JointPlanner(inputs.scenario.planner, inputs.mission, inputs.scenario.planner.own)
    known = before_take_off(inputs.scenario.planner, inputs.mission, (2 * 3**0.5, 2.0), 0.0)
    planner._places.enter(known)
    here = planner._places.shares
    paces, _ = planner._places.paces(known, here)
    alone = [planner._places.evaluate(known, [here], pace)[1] for pace in paces]
    by_pace = [at.forecast(at.filled()) for at in alone if at is not None]
    fixed = {"planner.joint.airspeed": "fixed"}
    held = [ending(**fixed, **{"vehicle.airframe.airspeed_mps": v}) for v in (15, 14, 13, 12, 11)]
    packs = [1.4, 1.5, 1.6]
    chosen = [ending(**{"vehicle.battery.capacity_ah": pack}) for pack in packs]
    with figure_file(str(made), 7.0, 4.0) as figure:
        axes = figure.subplots()
        axes.plot(
            [e.remaining_s for e in by_pace], [e.energy_wh for e in by_pace], ".-", label="a speed for each stage"
        )
        axes.plot([e.remaining_s for e in held], [e.energy_wh for e in held], "o", label="one airspeed, 15 to 11 m/s")
        axes.plot([e.remaining_s for e in chosen], [e.energy_wh for e in chosen], "k*", markersize=12, label="chosen")
        for pack, end in zip(packs, chosen, strict=True):
            axes.annotate(
                f"{pack:g} Ah", (end.remaining_s, end.energy_wh), va="bottom", xytext=(4, 4), textcoords="offset points"
            )
        axes.set(xlabel="time [s]", ylabel="energy [Wh]")
        axes.margins(0.08, 0.12)
        axes.legend()
    return made


def three_planners(made: Path) -> Path:
    """The charge and the spacing of three planners that lose charge in flight."""
    with figure_file(str(made), 9.0, 4.5) as figure:
        rows = figure.subplots(2, 1, sharex=True)
        for command, name, style in zip(FLIGHTS, ("joint", "paper", "static"), ("-", "--", ":"), strict=True):
            assert main(shlex.split(command.format(out=made.parent))) in (0, 1)
            flight = read_folder(made.parent / name)
            columns, spacing = flight.columns, flight.world.mission.plan.parameters[0]
            label = name if flight.summary["completed"] else f"{name}: NOT completed"
            for axes, values in zip(rows, (columns["soc"], [*map(spacing.shown, columns["c1"])]), strict=True):
                axes.plot(columns["time_s"], values, style, label=label)
                if not flight.summary["completed"]:
                    axes.plot(columns["time_s"][-1], values[-1], "kX")
        rows[0].set_ylabel("state of charge")
        rows[1].set(xlabel="time [s]", ylabel="spacing [m]")
        rows[0].legend()
    return made


def make(name: str, folder: Path) -> Path:
    """Run a picture's commands, in the repository's folder, and return the file that they made."""
    if name == "speed-to-fly.png":
        return speed_to_fly(folder / name)
    if name == "survey-flights.png":
        return three_planners(folder / name)
    commands, made = MADE[name]
    for command in commands:
        assert main(shlex.split(command.format(out=folder))) in (0, 1), command
    return folder / made


if __name__ == "__main__":
    for name in MADE:
        with tempfile.TemporaryDirectory() as folder:
            shutil.copyfile(make(name, Path(folder)), PICTURES / name)

"""The pictures of the pages, each made by the commands of its row; `tests/test_pictures.py` compares them.

    PYTHONPATH=tests/support python tests/support/pictures.py

The picture of an aircraft's power is that of docs/aircraft.md.
"""

from __future__ import annotations

import shlex
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from common import ROOT

from eadp.cli.main import main

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
    "survey-flights.png": (
        [*FLIGHTS, "report {out}/joint {out}/paper {out}/static -o {out}/flights.html"],
        "flights.png",
    ),
    "paper-i-dynamic.png": (
        ["simulate plans/survey.plan --scenario scenarios/paper-i-dynamic.yaml -o {out}/i"],
        "i/flight.png",
    ),
    "paper-I-static.png": (
        ["simulate plans/survey.plan --scenario scenarios/paper-I-static.yaml --figure paper -o {out}/I"],
        "I/paper.png",
    ),
    "sorties.png": ([f"{ESTATE} -o {{out}}/job"], "job/sorties.png"),
    "meadow.png": ([f"{COVER} --plot {{out}}/meadow.png"], "meadow.png"),
}
"""Commands of each picture, and the file that they make, in a folder `{out}` of their own."""


def make(name: str, folder: Path) -> Path:
    """Run a picture's commands, in the repository's folder, and return the file that they made."""
    commands, made = MADE[name]
    for command in commands:
        assert main(shlex.split(command.format(out=folder))) in (0, 1), command
    return folder / made


if __name__ == "__main__":
    for name in MADE:
        with tempfile.TemporaryDirectory() as folder:
            shutil.copyfile(make(name, Path(folder)), PICTURES / name)

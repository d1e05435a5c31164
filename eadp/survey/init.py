"""`eadp init`: aircraft that are shipped, and the files that a folder starts with."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib.resources import files
from typing import Annotated

from typer import Argument

from eadp.cli.output import emit
from eadp.errors import Fault, InputError, refuse
from eadp.io.text.options import Flag
from eadp.io.text.streams import write_text
from eadp.survey.camera import FOLDER as CAMERAS_FOLDER
from eadp.survey.cover import coverage_task
from eadp.survey.options import CoverageOptions

FOLDER = files("eadp") / "presets"
PRESETS = tuple(sorted(file.name.removesuffix(".yaml") for file in (FOLDER / "vehicles").iterdir()))
"""Names of the aircraft that are shipped."""

SCENARIO, FIELD, PLAN, CAMERA = "scenario.yaml", "field.geojson", "survey.plan", "camera.yaml"
LIGHT_CAMERA = "canon-s100"
"""The camera of 0.2 kg that any of the aircraft carries."""
SWATH_M = 40.0
"""Swath of the plan [m]."""

WIND = 4.0, 270.0
"""Wind of the plan and of the scenario [m/s], and the bearing that it blows from [°]."""


def start_texts(folder: str, preset: str) -> dict[str, str]:
    """Texts by path of a folder's first files: a preset's vehicle, a scenario, a camera, a field, and a plan for it.

    Raises
    ------
    InputError
        If there is no preset of this name.
    """
    if preset not in PRESETS:
        raise InputError.at("--preset", 1, 1, "no such aircraft", f"one of {', '.join(PRESETS)}", preset)
    vehicle, field = f"{preset}.yaml", FOLDER / FIELD
    path = FOLDER / "vehicles" / vehicle
    body, options = path.read_text("utf-8"), CoverageOptions(swath_m=SWATH_M, pattern="zamboni", wind=WIND)
    task = coverage_task(str(field), options, None, None, str(path), lambda _: None)
    plan = task.planned(task.solution()).text
    names = {"vehicle": vehicle, "scenario": SCENARIO, "plan": PLAN, "wind_mps": WIND[0], "from_deg": WIND[1]}
    scenario = (FOLDER / SCENARIO).read_text("utf-8").format(**names)
    camera = (CAMERAS_FOLDER / f"{LIGHT_CAMERA}.yaml").read_text("utf-8")
    texts = {vehicle: body, CAMERA: camera, SCENARIO: scenario, FIELD: field.read_text("utf-8"), PLAN: plan}
    return {os.path.join(folder, name): text for name, text in texts.items()}


def write_new(texts: dict[str, str], *, force: bool) -> None:
    """Write files by path, their folders too.

    Raises
    ------
    InputError
        If one exists and `force` is not set, or is a link, and nothing is written; or if one cannot be written.
    """
    links = [path for path in texts if force and os.path.islink(path)]
    refuse([Fault(path, 1, 1, "is a link, and what it leads to is not replaced", "a file") for path in links])
    taken = [path for path in texts if os.path.lexists(path) and not force]
    refuse([Fault(path, 1, 1, "exists already", "a new file, or --force to replace it") for path in taken])
    for path, text in texts.items():
        try:
            os.makedirs(os.path.dirname(path) or ".", exist_ok=True)
        except OSError as error:
            raise InputError.at(path, 1, 1, f"cannot be written: {error.strerror}", "a writable location") from None
        write_text(path, text)


@dataclass(frozen=True)
class InitOptions:
    """The aircraft, and what becomes of files that exist."""

    preset: Annotated[str, Flag(metavar="NAME")] = "foam-wing"
    """Aircraft: small-wing (1.2 kg), foam-wing (2 kg), mapper (4 kg), survey-wing, or data-sheet, by what a maker
    states."""

    force: bool = False
    """Replace files that exist."""


def command(
    options: InitOptions,
    folder: Annotated[str, Argument(metavar="DIR", help="Folder for the files, which may exist.")] = ".",
) -> int:
    """Example: eadp init runs/mine --preset foam-wing

    Start a folder: a commented vehicle file and scenario, a field, and a plan that covers it, which fly as they are.
    A camera file lies beside them.

    Exit code 0 if the files are written, 2 on bad input; a file that exists is replaced with --force alone.
    """
    texts = start_texts(folder, options.preset)
    write_new(texts, force=options.force)
    plan, scenario = (os.path.join(folder, name) for name in (PLAN, SCENARIO))
    emit("\n".join([f"written  {', '.join(texts)}", f"next     eadp simulate {plan} --scenario {scenario}"]))
    return 0

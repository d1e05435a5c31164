"""`eadp init`."""

from __future__ import annotations

import os
from typing import Annotated

from typer import Argument, Option

from eadp.cli.output import emit


def command(
    folder: Annotated[str, Argument(metavar="DIR", help="Folder for the files, which may exist.")] = ".",
    preset: Annotated[
        str, Option(metavar="NAME", help="Aircraft: small-wing (1.2 kg), foam-wing (2 kg), mapper (4 kg), survey-wing.")
    ] = "foam-wing",
    force: Annotated[bool, Option("--force", help="Replace files that exist.")] = False,
) -> int:
    """Example: eadp init runs/mine --preset foam-wing

    Start a folder: a commented vehicle file and scenario, a field, and a plan that covers it, which fly as they are.

    Exit code 0 if the files are written, 2 on bad input; a file that exists is replaced with --force alone.
    """
    from eadp.api.init import PLAN, SCENARIO, start_texts, write_new

    texts = start_texts(folder, preset)
    write_new(texts, force=force)
    plan, scenario = (os.path.join(folder, name) for name in (PLAN, SCENARIO))
    emit("\n".join([f"written  {', '.join(texts)}", f"next     eadp simulate {plan} --scenario {scenario}"]))
    return 0

"""`eadp init`."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Annotated

from typer import Argument

from eadp.cli.output import emit
from eadp.io.text.options import Flag


@dataclass(frozen=True)
class InitOptions:
    """The aircraft, and what becomes of files that exist."""

    preset: Annotated[str, Flag(metavar="NAME")] = "foam-wing"
    """Aircraft: small-wing (1.2 kg), foam-wing (2 kg), mapper (4 kg), survey-wing."""

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
    from eadp.api.init import PLAN, SCENARIO, start_texts, write_new

    texts = start_texts(folder, options.preset)
    write_new(texts, force=options.force)
    plan, scenario = (os.path.join(folder, name) for name in (PLAN, SCENARIO))
    emit("\n".join([f"written  {', '.join(texts)}", f"next     eadp simulate {plan} --scenario {scenario}"]))
    return 0

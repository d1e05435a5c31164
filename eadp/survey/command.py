"""`eadp cover`."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from typer import Argument

from eadp.cli.output import Progress, emit, emit_json, usage_fault, warn
from eadp.errors import Fault, Infeasible
from eadp.io.text.options import Flag
from eadp.io.text.streams import check_new_folder, output_file
from eadp.survey.cover import cover
from eadp.survey.options import CoverageOptions
from eadp.survey.sorties import SortieOptions

if TYPE_CHECKING:
    from eadp.survey.sorties import SortiePlan


@dataclass(frozen=True)
class CoverInputs:
    """Files that serve a coverage."""

    SECTION: ClassVar = "Aircraft"

    profile: Annotated[str | None, Flag(metavar="FILE")] = None
    """Computation profile: the plan gets its computations."""

    scenario: Annotated[str | None, Flag(metavar="FILE")] = None
    """Scenario, for the vehicle, the wind and the energy."""

    vehicle: Annotated[str | None, Flag(metavar="FILE")] = None
    """Aircraft, instead of the scenario's."""


@dataclass(frozen=True)
class CoverOutputs:
    """What is written and printed."""

    force: bool = False
    """Replace the folder of sorties, if it holds these and nothing else."""

    out: Annotated[str | None, Flag("-o --out", metavar="PLAN")] = None
    """Write the plan here; of sorties, a folder."""

    format: Literal["plan", "text", "json"] | None = None
    """What to print: the plan, a summary (the default with -o), or JSON."""

    plot: Annotated[str | None, Flag(metavar="FILE")] = None
    """Draw field and plan: FILE.svg or FILE.png."""


def command(
    file: Annotated[
        str,
        Argument(
            help="Field: GeoJSON, KML, KMZ or CSV of vertices, - for standard input; of shapefiles ogr2ogr makes one.",
            metavar="FIELD",
        ),
    ],
    options: CoverageOptions,
    division: SortieOptions,
    given: CoverInputs,
    output: CoverOutputs,
) -> int:
    """Example: eadp cover plans/meadow.geojson --min-radius 30 --swath 30 --pattern zamboni

    Plan the coverage of a field: from its outline to a plan whose line spacing can vary in flight.

    Exit code 0 if a plan covers the field, 1 if the pattern asked for does not fit it, 2 on bad input.
    """
    out, plot = output.out, output.plot
    wanted = output.format or ("plan" if out in (None, "-") else "text")
    if out == "-" and wanted != "plan":
        raise usage_fault("--out", out, f"standard output is taken by --format {wanted}", "a file")
    divided = division != SortieOptions()
    if divided:
        if plot is not None:
            raise usage_fault("--plot", plot, "beside sorties", "-o DIR, whose folder has a picture")
        if out is not None:
            check_new_folder(out, force=output.force)
    if plot is not None:
        from eadp.io.figures.canvas import check_figure_name

        check_figure_name(plot)
    taken = [] if file == "-" or "\0" in file else [os.path.realpath(file)]
    for option, path in (("--out", None if divided else out), ("--plot", plot)):
        if path is None or path == "-":
            continue
        if not Path(path).absolute().parent.is_dir():
            raise usage_fault(option, path, "no such folder", "a file in an existing folder")
        place = str(output_file(path))
        if place in taken:
            raise usage_fault(option, path, "is the field's own file, or the plan's", "a file of its own")
        taken.append(place)
    name = "<stdin>" if file == "-" else file
    files = {"profile": given.profile, "scenario": given.scenario, "vehicle": given.vehicle}
    if divided:
        from eadp.survey.resume import cover_in_sorties

        progress = Progress("cover", math.inf)  # on a terminal alone
        try:
            plan = cover_in_sorties(file, options, division, **files, on_part=progress.show, warn=warn)
            progress.close()
            warn([Fault(name, 1, 1, note, severity="note") for note in plan.planner.task.notes])
            return _sorties(plan, output, wanted)
        except Infeasible as error:
            warn([Fault(name, 1, 1, str(error), error.advice or "a nearer home, a larger pack, or less wind")])
            return 1
        finally:
            progress.close()
    try:
        found = cover(file, options, **files, warn=warn)
    except Infeasible as error:
        advice = error.advice or "a field, a pattern, a swath and a spacing that fit together"
        warn([Fault(name, 1, 1, str(error), advice)])
        return 1
    if out not in (None, "-"):
        from eadp.io.text.streams import write_text

        write_text(out, found.text)
    if plot is not None:
        from eadp.survey.figures import write_coverage_figure

        write_coverage_figure(plot, found.field, found.titled_paths, found.motion.swath_m, found.left)
    if wanted == "json":
        emit_json(found.document)
        return 0
    warn([Fault(name, 1, 1, note, severity="note") for note in found.notes])
    written = [f"written    {out}"] if out else []
    emit(found.text if wanted == "plan" else "\n".join([*found.lines, *written]))
    return 0


def _sorties(plan: SortiePlan, output: CoverOutputs, wanted: str) -> int:
    """Write and print sorties."""
    from eadp.survey.folder import write_sorties

    if output.out is not None:
        write_sorties(plan, output.out, force=output.force)
    if wanted == "json":
        emit_json(plan.document())
        return 0
    emit("\n".join([*plan.lines(), *([f"written    {output.out}"] if output.out else [])]))
    return 0

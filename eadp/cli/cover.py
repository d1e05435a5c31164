"""`eadp cover`."""

from __future__ import annotations

import enum
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from eadp.cli.output import emit, emit_json, usage_fault, warn
from eadp.errors import Fault, Infeasible

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eadp.api.sorties.plan import SortiePlan

Pattern = enum.StrEnum("Pattern", ["auto", "zamboni", "dubins"])
Holes = enum.StrEnum("Holes", ["cover", "avoid"])
CoverFormat = enum.StrEnum("CoverFormat", ["plan", "text", "json"])


def command(
    file: Annotated[
        str,
        Argument(help="Field: GeoJSON, KML, KMZ or CSV of vertices, - for standard input.", metavar="FIELD"),
    ],
    min_radius: Annotated[
        float | None,
        Option(help="Smallest turning radius [m]; by default what the aircraft needs in the wind.", metavar="METRES"),
    ] = None,
    swath: Annotated[
        float | None,
        Option(help="Width of ground that a line covers [m]; or it follows from the camera.", metavar="METRES"),
    ] = None,
    altitude: Annotated[
        float | None, Option(help="Altitude above the ground [m], which the plan holds.", metavar="METRES")
    ] = None,
    sensor_width: Annotated[
        float | None,
        Option("--sensor-width-mm", help="Width of the camera's sensor, across the lines [mm].", metavar="MM"),
    ] = None,
    sensor_height: Annotated[
        float | None,
        Option("--sensor-height-mm", help="Height of the camera's sensor, along the lines [mm].", metavar="MM"),
    ] = None,
    focal_length: Annotated[
        float | None, Option("--focal-length-mm", help="Focal length of the camera [mm].", metavar="MM")
    ] = None,
    side_overlap: Annotated[
        str | None,
        Option(
            help="Overlap of the pictures of neighbouring lines [%]; or wanted and acceptable, as 70:60.",
            metavar="PERCENT",
        ),
    ] = None,
    forward_overlap: Annotated[
        float | None,
        Option(help="Overlap of the pictures along a line [%]: the plan takes them.", metavar="PERCENT"),
    ] = None,
    image_width: Annotated[
        int | None,
        Option("--image-width-px", help="Width of a picture [pixels]: the size of a pixel is said.", metavar="PX"),
    ] = None,
    radius: Annotated[
        float | None, Option(help="Ideal turning radius [m]; by default 1.5 times the smallest.", metavar="METRES")
    ] = None,
    spacing: Annotated[
        float | None,
        Option(
            help="Distance of the lines [m]. Of Zamboni-like laps the finest, by default half the swath, up to which a "
            "planner widens it; of lines in an order by default the swath.",
            metavar="METRES",
        ),
    ] = None,
    heading: Annotated[
        float | None,
        Option(help="Heading of the lines [°], a compass bearing; the quickest by default.", metavar="DEG"),
    ] = None,
    pattern: Annotated[
        Pattern, Option(help="Zamboni-like laps, lines in an order with Dubins turns, or the shorter.")
    ] = Pattern.auto,
    turns_off: Annotated[bool, Option("--turns-off", help="Computations stop on turns.")] = False,
    metres: Annotated[bool, Option("--metres", help="The file is in local metres, not degrees.")] = False,
    feature: Annotated[
        str | None, Option(help="Which polygon of a file that holds several: id, name or number; or all, as parts.")
    ] = None,
    avoid: Annotated[
        str | None, Option(help="Polygons that lines and turns stay out of: GeoJSON, KML or CSV.", metavar="FILE")
    ] = None,
    holes: Annotated[Holes, Option(help="Whether the field's holes may be flown over.")] = Holes.cover,
    inside: Annotated[
        str | None, Option(help="Polygons that lines and turns stay inside of, as --avoid.", metavar="FILE")
    ] = None,
    start: Annotated[
        str | None, Option(help="Where the flight starts: X,Y [m], or LAT,LON [°].", metavar="POINT")
    ] = None,
    home: Annotated[str | None, Option(help="Where the flight ends; as --start.", metavar="POINT")] = None,
    wind: Annotated[
        str | None, Option(help="Wind: speed [m/s] and the bearing it blows from [°].", metavar="SPEED,FROM_DEG")
    ] = None,
    airspeed: Annotated[
        float | None, Option(help="Airspeed [m/s]; by default that of the scenario's vehicle.", metavar="MPS")
    ] = None,
    profile: Annotated[
        str | None, Option(help="Computation profile: the plan gets its computations.", metavar="FILE")
    ] = None,
    scenario: Annotated[
        str | None, Option(help="Scenario, for the vehicle, the wind and the energy.", metavar="FILE")
    ] = None,
    vehicle: Annotated[str | None, Option(help="Aircraft, instead of the scenario's.", metavar="FILE")] = None,
    sorties: Annotated[
        str | None,
        Option(help="Divide the field among flights from home: auto for the fewest, or a number.", metavar="NUMBER"),
    ] = None,
    aircraft: Annotated[int, Option(help="How many aircraft fly sorties at once.", metavar="N", show_default="1")] = 1,
    resume: Annotated[
        list[str] | None,
        Option(help="Flights flown, result folders or telemetry: what they covered is left out.", metavar="FLOWN"),
    ] = None,
    sortie_overlap: Annotated[
        float, Option(help="What both parts of a line that is cut have in common [m].", metavar="METRES")
    ] = 20.0,
    separation: Annotated[
        float, Option(help="Distance that aircraft keep from one another [m].", metavar="METRES")
    ] = 50.0,
    swap_time: Annotated[
        float, Option(help="Time on the ground between two sorties of an aircraft [s].", metavar="SECONDS")
    ] = 120.0,
    export: Annotated[
        list[str] | None, Option(help="Write each sortie in this format, too, as eadp export.", metavar="FORMAT")
    ] = None,
    force: Annotated[bool, Option("--force", help="Replace the folder of sorties if it exists.")] = False,
    out: Annotated[
        str | None, Option("-o", "--out", help="Write the plan here; of sorties, a folder.", metavar="PLAN")
    ] = None,
    format_: Annotated[
        CoverFormat | None,
        Option("--format", help="What to print: the plan, a summary (the default with -o), or JSON."),
    ] = None,
    plot: Annotated[str | None, Option(help="Draw field and plan: FILE.svg or FILE.png.", metavar="FILE")] = None,
) -> int:
    """Example: eadp cover plans/meadow.geojson --min-radius 30 --swath 30 --pattern zamboni

    Plan the coverage of a field: from its outline to a plan whose line spacing can vary in flight.

    Exit code 0 if a plan covers the field, 1 if the pattern asked for does not fit it, 2 on bad input.
    """
    from eadp.api.cover import CoverageOptions, cover
    from eadp.io.text.streams import write_text

    wanted = format_ or (CoverFormat.plan if out in (None, "-") else CoverFormat.text)
    if out == "-" and wanted is not CoverFormat.plan:
        raise usage_fault("--out", out, f"standard output is taken by --format {wanted.value}", "a file")
    divided = sorties is not None or bool(resume) or aircraft != 1
    if divided:
        from eadp.io.text.streams import check_new_folder

        if plot is not None:
            raise usage_fault("--plot", plot, "beside sorties", "-o DIR, whose folder has a picture")
        if out is not None:
            check_new_folder(out, force=force)
    _check_outputs(
        [] if file == "-" or "\0" in file else [os.path.realpath(file)],
        {"--out": None if divided else out, "--plot": plot},
    )
    name = "<stdin>" if file == "-" else file
    options = CoverageOptions(
        min_radius,
        swath,
        radius,
        spacing,
        heading,
        pattern.value,
        start,
        home,
        wind,
        airspeed,
        turns_off,
        metres,
        feature,
        avoid,
        inside,
        holes is Holes.avoid,
        altitude,
        sensor_width,
        sensor_height,
        focal_length,
        side_overlap,
        forward_overlap,
        image_width,
    )
    if divided:
        from eadp.api.sorties.cover import cover_in_sorties
        from eadp.api.sorties.plan import SortieOptions

        count = None if sorties in (None, "auto") else _count(sorties or "")
        division = SortieOptions(count, aircraft, sortie_overlap, separation, swap_time)
        try:
            return _sorties(
                cover_in_sorties(
                    file, options, division, profile, scenario, vehicle=vehicle, resume=resume or (), warn=warn
                ),
                out,
                wanted,
                force=force,
                exports=export or (),
            )
        except Infeasible as error:
            warn([Fault(name, 1, 1, str(error), "a nearer home, a larger pack, or less wind")])
            return 1
    try:
        found = cover(file, options, profile, scenario, vehicle=vehicle, warn=warn)
    except Infeasible as error:
        warn([Fault(name, 1, 1, str(error), "a field, a pattern, a swath and a spacing that fit together")])
        return 1
    if out not in (None, "-"):
        write_text(out, found.text)
    if plot is not None:
        from eadp.io.figures.coverage import write_coverage_figure

        report = found.report
        write_coverage_figure(plot, report.field, report.titled_paths(), report.motion.swath_m)
    if wanted is CoverFormat.json:
        emit_json(found.document)
        return 0
    notes = [
        *found.repairs,
        *([f"line spacing {fixed}"] if wanted is CoverFormat.plan and (fixed := found.report.fixed_spacing()) else []),
    ]
    warn([Fault(name, 1, 1, note, severity="note") for note in notes])
    written = [f"written    {out}"] if out else []
    emit(found.text if wanted is CoverFormat.plan else "\n".join([*found.lines, *written]))
    return 0


def _count(raw: str) -> int:
    if not raw.isdecimal() or not 1 <= int(raw[:6]) <= 200:
        raise usage_fault("--sorties", raw, "no number of sorties", "auto, or a whole number from 1 to 200")
    return int(raw)


def _sorties(plan: SortiePlan, out: str | None, wanted: CoverFormat, *, force: bool, exports: Sequence[str]) -> int:
    """Write and print sorties."""
    from eadp.api.sorties.folder import write_sorties

    if out is not None:
        write_sorties(plan, out, force=force, exports=exports)
    if wanted is CoverFormat.json:
        emit_json(plan.document())
        return 0
    emit("\n".join([*plan.lines(), *([f"written    {out}"] if out else [])]))
    return 0


def _check_outputs(taken: list[str], outputs: dict[str, str | None]) -> None:
    """Refuse, before anything is written, a file that cannot be written and one that is used twice."""
    from eadp.io.figures.canvas import check_figure_name
    from eadp.io.text.streams import output_file

    for option, name in outputs.items():
        if name is None or name == "-":
            continue
        if option == "--plot":
            check_figure_name(name)
        path = str(output_file(name))
        if not Path(name).absolute().parent.is_dir():
            raise usage_fault(option, name, "no such folder", "a file in an existing folder")
        if path in taken:
            raise usage_fault(option, name, "is the field's own file, or the plan's", "a file of its own")
        taken.append(path)

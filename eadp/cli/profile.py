"""`eadp profile`: measurements of the computations in, their energy model out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from eadp.cli.output import Progress, emit, emit_json, usage_fault, warn
from eadp.errors import Fault, printable, refuse
from eadp.io.profile.measurements import MeasureOptions, PowerColumns, parse_configuration
from eadp.io.text.json import aligned
from eadp.io.text.options import Flag, given_options
from eadp.io.text.streams import write_text
from eadp.plug_ins import plug_in

if TYPE_CHECKING:
    from eadp.models.profile import Profile


@dataclass(frozen=True)
class ModelOptions:
    """Of what the model is made, and what of it is printed."""

    at: Annotated[Sequence[str], Flag(metavar="NAME=VALUE,…")] = ()
    """Print the power at a configuration. May repeat."""

    plot: Annotated[str, Flag(metavar="FILE")] = ""
    """Draw the model: FILE.svg or FILE.png."""

    names: Annotated[str, Flag(metavar="NAME,…")] = ""
    """New names of the parameters, in order."""

    interpolation: Literal["linear", "pchip"] | None = None
    """Between configurations; the default is linear, or the model's."""

    clamp: bool = False
    """Outside the measured range, take the nearest inside."""

    format: Literal["text", "json"] = "text"
    """How to print."""


def command(
    files: Annotated[
        list[str],
        Argument(
            metavar="FILE",
            help="Measurements (CSV), of several traces or tables, or a model (YAML); - is standard input. With "
            "--measure and after --, the command.",
        ),
    ],
    columns: PowerColumns,
    model: ModelOptions,
    options: MeasureOptions,
    measure: Annotated[
        bool, Option("--measure", help="Run a command at each configuration and measure its power.")
    ] = False,
    output: Annotated[
        str, Option("--output", "-o", metavar="FILE", help="Write the model (YAML), or with --measure the CSV.")
    ] = "",
) -> int:
    """Example: eadp profile profiles/pednet-jetson-nano.csv --at fps=5

    Build the energy model of the computations from measurements of their power: a CSV with a column for each
    parameter and one for the power (fps,power_w), or powprofiler's. Repeated configurations are averaged.

    Traces are recordings at one configuration each, of tegrastats, jtop, nvidia-smi, turbostat, an INA219,
    INA226 or INA3221, hwmon or RAPL: eadp profile slow.log fast.log --config fps=2 --config fps=10

    Measure them: eadp profile --measure --config fps=2,4,6 -o measured.csv -- ./detect --rate {fps}
    """
    from eadp.io.profile.model_file import powers_at, profile_document, profile_yaml, read_profile

    if measure:
        _refuse(given_options(model) + given_options(columns), "without --measure, on its result")
        return _measure(files, options, output)
    _refuse(options.given(), "with --measure")
    _refuse(["--clamp"] if model.clamp and not model.at else [], "with --at")
    at, json = model.at, model.format == "json"
    if output == "-" and (at or json):
        raise usage_fault("--output", output, "standard output is taken by --at or --format", "a file")
    configurations = [parse_configuration(raw) for raw in options.config]
    names = [name.strip() for name in model.names.split(",")] if model.names else []
    kind = model.interpolation
    profile, warnings = read_profile(files, names, configurations=configurations, interpolation=kind, columns=columns)
    values, clamped = powers_at(profile, at, model.clamp)
    if model.plot:
        plug_in("charts", "profile")(model.plot, profile)
    if output:
        write_text(output, profile_yaml(profile))
    warn(warnings + clamped)
    if json:
        emit_json({"schema": "eadp.power/1", "values": values} if at else profile_document(profile))
    elif at or output != "-":
        emit(_powers(values) if at else _summary(profile))
    return 0


def _refuse(options: list[str], where: str) -> None:
    refuse([Fault(option, 1, 1, "has no effect here", f"it {where}") for option in options])


def _measure(command: list[str], options: MeasureOptions, output: str) -> int:
    """Measure and write the CSV; the results are noted on stderr."""
    progress = Progress("measuring")
    try:
        table, notes = plug_in("measurers", "command")(command, options, lambda note: warn([note]), progress.show)
    finally:
        progress.close()
    write_text(output or "-", table)
    warn(notes)
    return 0


def _powers(values: list[dict[str, Any]]) -> str:
    """The power at each configuration, a line each."""
    from eadp.models.profile import configuration_text

    lines = []
    for value in values:
        names, numbers = zip(*value["configuration"].items(), strict=True)
        lines.append(f"{configuration_text(names, numbers, ',')}: {value['power_w']:.6g} W")
    return "\n".join(lines)


def _summary(part: Profile) -> str:
    """The model as a table: configuration, power, standard deviation and error, samples."""
    from eadp.models.profile import titles

    heads = [*titles(part.names, part.units), "power [W]"]
    rows = []
    for i, at in enumerate(part.configurations.tolist()):
        count, error_w = part.samples[i], part.standard_error_w[i]
        std, error = f"{part.std_w[i]:.2g}" if count > 1 else "", f"{error_w:.2g}" if math.isfinite(error_w) else ""
        rows.append([*(f"{value:.10g}" for value in at), f"{part.power_w[i]:.6g}", std, error, str(count)])
    optional = ["std. dev. [W]", "std. error [W]", "samples"]
    columns = zip([*heads, *optional], *rows, strict=True)
    filled = [column for i, column in enumerate(columns) if i < len(heads) or any(column[1:])]
    title = f"{len(part.power_w)} configurations of {', '.join(part.names)}; {part.interpolation} between them"
    source = f"source: {printable(part.source, 1000)}"
    return "\n".join([title, source, *aligned([*zip(*filled, strict=True)])])

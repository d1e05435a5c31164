"""`eadp profile`: measurements of the computations in, their energy model out."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any, cast

from typer import Argument, Option

from eadp.cli.options import Format, FormatOption, names_in
from eadp.cli.output import Progress, aligned, emit, emit_json, usage_fault, warn
from eadp.errors import Fault, InputError, printable

if TYPE_CHECKING:
    from eadp.api.profile import MeasureOptions
    from eadp.core.interpolation import Kind
    from eadp.models.profile import Profile
    from eadp.models.profile_sum import AnyProfile


Interpolation = StrEnum("Interpolation", ["linear", "pchip"])
Device = StrEnum("Device", ["total", "cpu", "gpu"])


def command(
    files: Annotated[
        list[str],
        Argument(
            metavar="FILE",
            help="Measurements (CSV), of several traces or tables, or a model (YAML); - is standard input. With "
            "--measure and after --, the command.",
        ),
    ],
    output: Annotated[
        str, Option("--output", "-o", metavar="FILE", help="Write the model (YAML), or with --measure the CSV.")
    ] = "",
    at: Annotated[
        list[str] | None, Option(metavar="NAME=VALUE,…", help="Print the power at a configuration. May repeat.")
    ] = None,
    format: FormatOption = Format.text,
    plot: Annotated[str, Option(metavar="FILE", help="Draw the model: FILE.svg or FILE.png.")] = "",
    add: Annotated[
        list[str] | None, Option(metavar="FILE", help="Computations measured apart: their power is added. May repeat.")
    ] = None,
    names: Annotated[str, Option(metavar="NAME,…", help="New names of the parameters, in order.")] = "",
    config: Annotated[
        list[str] | None,
        Option(
            "--config",
            metavar="NAME=VALUE,…",
            help="Configuration of a trace, one option for each trace; with --measure, configurations to measure, all "
            "combinations: fps=2,4,keysize=32,448.",
        ),
    ] = None,
    from_name: Annotated[
        str, Option(metavar="PATTERN", help="Configurations of traces are in their names: '*_{fps}fps'.")
    ] = "",
    interpolation: Annotated[
        Interpolation | None, Option(help="Between configurations; the default is linear, or the model's.")
    ] = None,
    device: Annotated[
        Device | None, Option(help="Which of powprofiler's columns is the power; the default is total.")
    ] = None,
    clamp: Annotated[bool, Option("--clamp", help="Outside the measured range, take the nearest inside.")] = False,
    measure: Annotated[
        bool, Option("--measure", help="Run a command at each configuration and measure its power.")
    ] = False,
    sweep: Annotated[
        list[str] | None, Option(metavar="NAME=FROM:TO:STEP", help="Values to measure at, both ends included.")
    ] = None,
    sensor: Annotated[str | None, Option(metavar="KIND:NAME", help="The sensor to read, or its path.")] = None,
    sysfs: Annotated[str | None, Option(metavar="DIR", help="Root of the sensors [/sys].")] = None,
    warmup: Annotated[float | None, Option(metavar="S", help="Time before the first sample [5 s].")] = None,
    interval: Annotated[float | None, Option(metavar="S", help="Time from one sample to the next [0.2 s].")] = None,
    accuracy: Annotated[
        str | None, Option(metavar="W", help="Standard error to measure to [0.05 W], or as in 1%.")
    ] = None,
    longest: Annotated[float | None, Option(metavar="S", help="Longest time at a configuration [120 s].")] = None,
    idle: Annotated[float | None, Option(metavar="S", help="First measure for this time without the command.")] = None,
) -> int:
    """Example: eadp profile profiles/pednet-jetson-nano.csv --at fps=5

    Build the energy model of the computations from measurements of their power: a CSV with a column for each
    parameter and one for the power (fps,power_w), or powprofiler's. Repeated configurations are averaged.

    Measure them: eadp profile --measure --config fps=2,4,6 -o measured.csv -- ./detect --rate {fps}

    Computations that were measured apart: eadp profile detector.csv --add encoder.csv -o both.yaml
    """
    from eadp.api.profile import MeasureOptions
    from eadp.io.profile.configurations import parse_configuration
    from eadp.io.profile.model_file import Sources, profile_document, profile_yaml, read_profiles
    from eadp.io.profile.power_at import powers_at
    from eadp.io.text.streams import write_text

    options = MeasureOptions(config, sweep, sysfs, sensor, warmup, interval, accuracy, longest, idle)
    if measure:
        model_options = {
            "--at": at,
            "--plot": plot,
            "--add": add,
            "--names": names,
            "--from-name": from_name,
            "--interpolation": interpolation,
            "--device": device,
            "--clamp": clamp,
            "--format": format is Format.json,
        }
        _refuse([name for name, value in model_options.items() if value], "without --measure, on its result")
        return _measure(files, options, output)
    _refuse(options.given(), "with --measure")
    if output == "-" and (at or format is Format.json):
        raise usage_fault("--output", output, "standard output is taken by --at or --format", "a file")
    configurations = [parse_configuration(raw) for raw in config or ()]
    kind = cast("Kind | None", interpolation and interpolation.value)
    sources = Sources(files, add or (), names_in(names), configurations, from_name, kind, device or "")
    profile, warnings = read_profiles(sources)
    values, clamped = powers_at(profile, at or [], clamp)
    if plot:
        from eadp.io.figures.profile import write_profile_figure

        write_profile_figure(plot, profile)
    if output:
        write_text(output, profile_yaml(profile))
    warn(warnings + clamped)
    if format is Format.json:
        emit_json({"schema": "eadp.power/1", "values": values} if at else profile_document(profile))
    elif at or output != "-":
        emit(_powers(values) if at else _summary(profile))
    return 0


def _refuse(options: list[str], where: str) -> None:
    if options:
        raise InputError(*(Fault(option, 1, 1, "has no effect here", f"it {where}") for option in options))


def _measure(command: list[str], options: MeasureOptions, output: str) -> int:
    """Measure and write the CSV; the results are noted on stderr."""
    from eadp.api.profile import measure_profile
    from eadp.io.text.streams import write_text

    progress = Progress("measuring")
    try:
        table, notes = measure_profile(command, options, lambda note: warn([note]), progress.show)
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


def _summary(profile: AnyProfile) -> str:
    """The model as a table, one for each part, and their parameters if there are several."""
    tables = [_part_summary(part) for part in profile.parts]
    if len(tables) > 1:
        tables.insert(0, f"{len(tables)} parts, measured apart, whose power is added: {', '.join(profile.names)}")
    return "\n\n".join(tables)


def _part_summary(part: Profile) -> str:
    """A table: configuration, power, standard deviation and error, samples, leave-one-out error."""
    from eadp.models.profile import titles

    heads = [*titles(part.names, part.units), "power [W]"]
    rows = [
        [
            *(f"{value:.10g}" for value in at),
            f"{part.power_w[i]:.6g}",
            f"{part.std_w[i]:.2g}" if part.samples[i] > 1 else "",
            _finite_text(part.standard_error_w[i], ".2g"),
            str(part.samples[i]),
            _finite_text(part.energy_w_samples[i], ".6g"),
            _finite_text(part.soc[i], ".4g"),
            _finite_text(part.leave_one_out_w[i] - part.power_w[i], "+.2g"),
        ]
        for i, at in enumerate(part.configurations.tolist())
    ]
    optional = ["std. dev. [W]", "std. error [W]", "samples", "energy [W·samples]", "SoC", "leave-one-out error [W]"]
    columns = zip([*heads, *optional], *rows, strict=True)
    filled = [column for i, column in enumerate(columns) if i < len(heads) or any(column[1:])]
    title = f"{len(part.power_w)} configurations of {', '.join(part.names)}; {part.interpolation} between them"
    source = f"source: {printable(part.source, 1000)}"
    device = [f"device: {printable(part.device, 64)}"] if part.device else []
    known = any(map(math.isfinite, part.energy_w_samples))
    energy = ["energy: powprofiler's sum of power samples, no joules"] if known else []
    return "\n".join([title, source, *device, *aligned([*zip(*filled, strict=True)]), *energy, *_error_summary(part)])


def _finite_text(value: float, form: str) -> str:
    return f"{value:{form}}" if math.isfinite(value) else ""


def _error_summary(part: Profile) -> list[str]:
    found = part.leave_one_out_error
    if not found:
        return []
    points = "1 configuration" if found.points == 1 else f"{found.points} configurations"
    worst = f"at most {found.largest_w:.2g} W at {part.named(found.worst)}"
    return [f"leave-one-out error of {points}: {found.rms_w:.2g} W RMS, {worst}"]

"""`eadp profile`: measurements of the computations in, their energy model out."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eadp.cli.output import Format, emit, emit_json, usage_fault, warn
from eadp.cli.profile_measure import Options, measure_command
from eadp.errors import Fault, Infeasible, InputError, printable

if TYPE_CHECKING:
    from eadp.models.profile import Profile
    from eadp.models.profile_sum import AnyProfile


class Interpolation(StrEnum):
    """How power is told between measured configurations."""

    linear = "linear"
    pchip = "pchip"


def command(
    files: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE",
            help="Measurements (CSV), of several traces or tables, or a model (YAML); - is standard input. With "
            "--measure and after --, the command.",
        ),
    ],
    output: Annotated[
        str,
        typer.Option("--output", "-o", metavar="FILE", help="Write the model (YAML), or with --measure the CSV."),
    ] = "",
    at: Annotated[
        list[str] | None,
        typer.Option("--at", metavar="NAME=VALUE,…", help="Print the power at a configuration. May repeat."),
    ] = None,
    format: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.text,
    plot: Annotated[str, typer.Option("--plot", metavar="FILE", help="Draw the model: FILE.svg or FILE.png.")] = "",
    add: Annotated[
        list[str] | None,
        typer.Option("--add", metavar="FILE", help="Computations measured apart: their power is added. May repeat."),
    ] = None,
    names: Annotated[
        str, typer.Option("--names", metavar="NAME,…", help="Better names for the parameters, in order.")
    ] = "",
    config: Annotated[
        list[str] | None,
        typer.Option(
            "--config",
            metavar="NAME=VALUE,…",
            help="What a trace was measured at, one option for each trace; with --measure, what to measure at, all "
            "combinations: fps=2,4,keysize=32,448.",
        ),
    ] = None,
    from_name: Annotated[
        str,
        typer.Option(
            "--from-name", metavar="PATTERN", help="What traces were measured at is in their names: '*_{fps}fps'."
        ),
    ] = "",
    interpolation: Annotated[
        Interpolation | None,
        typer.Option("--interpolation", help="Between configurations; the default is linear, or the model's."),
    ] = None,
    clamp: Annotated[
        bool, typer.Option("--clamp", help="Outside the measured range, take the nearest inside.")
    ] = False,
    measure: Annotated[
        bool, typer.Option("--measure", help="Run a command at each configuration and measure its power.")
    ] = False,
    sweep: Annotated[
        list[str] | None,
        typer.Option("--sweep", metavar="NAME=FROM:TO:STEP", help="Values to measure at, both ends included."),
    ] = None,
    sensor: Annotated[
        str | None, typer.Option("--sensor", metavar="KIND:NAME", help="The sensor to read, or its path.")
    ] = None,
    sysfs: Annotated[str | None, typer.Option("--sysfs", metavar="DIR", help="Root of the sensors [/sys].")] = None,
    warmup: Annotated[
        float | None, typer.Option("--warmup", metavar="S", help="Drop so long at the beginning [5 s].")
    ] = None,
    interval: Annotated[
        float | None, typer.Option("--interval", metavar="S", help="From one sample to the next [0.2 s].")
    ] = None,
    accuracy: Annotated[
        str | None,
        typer.Option("--accuracy", metavar="W", help="Standard error to measure to [0.05 W], or as in 1%."),
    ] = None,
    longest: Annotated[
        float | None, typer.Option("--longest", metavar="S", help="Longest time at a configuration [120 s].")
    ] = None,
    idle: Annotated[
        float | None, typer.Option("--idle", metavar="S", help="First, measure so long without the command.")
    ] = None,
) -> int:
    """Example: eadp profile profiles/pednet-jetson-nano.csv --at fps=5

    Build the energy model of the computations from measurements of their power: a CSV with a column for each
    parameter and one for the power (fps,power_w), or powprofiler's. Repeated configurations are averaged.

    Measure them: eadp profile --measure --config fps=2,4,6 -o measured.csv -- ./detect --rate {fps}

    Computations that were measured apart: eadp profile detector.csv --add encoder.csv -o both.yaml
    """
    options = Options(config, sweep, sysfs, sensor, warmup, interval, accuracy, longest, idle)
    if measure:
        model_options = {
            "--at": at,
            "--plot": plot,
            "--add": add,
            "--names": names,
            "--from-name": from_name,
            "--interpolation": interpolation,
            "--clamp": clamp,
            "--format": format is Format.json,
        }
        _refuse([name for name, value in model_options.items() if value], "without --measure, on what it writes")
        return measure_command(files, options, output)
    _refuse(options.given(), "with --measure")
    if output == "-" and (at or format is Format.json):
        raise usage_fault("--output", output, "standard output is taken by --at or --format", "a file")
    profile, warnings = _read(files, add or [], names, config or [], from_name)
    if interpolation:
        profile = _interpolated(profile, interpolation)
    values = _values(profile, at or [], clamp)
    if plot:
        from eadp.io.figures.profile import write_profile_figure

        write_profile_figure(plot, profile)
    if output:
        _write(output, profile)
    warn(warnings)
    _warn_clamped(profile, values)
    if at and format is Format.json:
        emit_json({"schema": "eadp.power/1", "values": values})
    elif at:
        emit("\n".join(f"{_shown(value['configuration'])}: {value['power_w']:.6g} W" for value in values))
    elif format is Format.json:
        _emit_document(profile)
    elif output != "-":
        emit(_summary(profile))
    return 0


def _refuse(options: list[str], where: str) -> None:
    if options:
        raise InputError(*(Fault(option, 1, 1, "says nothing here", f"it {where}") for option in options))


def _read(
    files: list[str], added: list[str], names: str, config: list[str], pattern: str
) -> tuple[AnyProfile, list[Fault]]:
    from eadp.io.profile.configurations import stated_configuration
    from eadp.io.profile.model_file import Sources, read_profiles

    better = [name.strip() for name in names.split(",")] if names else ()
    return read_profiles(Sources(files, added, better, [stated_configuration(raw) for raw in config], pattern))


def _write(output: str, profile: AnyProfile) -> None:
    from eadp.io.profile.model_file import profile_yaml
    from eadp.io.text.streams import write_text

    write_text(output, profile_yaml(profile))


def _emit_document(profile: AnyProfile) -> None:
    from eadp.io.profile.model_file import profile_document

    emit_json(profile_document(profile))


def _interpolated(profile: AnyProfile, kind: Interpolation) -> AnyProfile:
    from eadp.models.profile_sum import added

    try:
        return added([replace(part, interpolation=kind.value) for part in profile.parts])
    except Infeasible as error:
        raise usage_fault("--interpolation", kind.value, str(error), "linear") from None


def _values(profile: AnyProfile, asked: list[str], clamp: bool) -> list[dict[str, Any]]:
    """The answers to `--at`, all of their faults at once."""
    from eadp.io.profile.model_file import plain

    values: list[dict[str, Any]] = []
    faults: list[Fault] = []
    for raw in asked:
        try:
            configuration = _configuration(raw, profile.names)
            power_w = profile.power_w_at(configuration, clamp)
        except InputError as error:
            faults += error.faults
        except Infeasible as error:
            faults.append(Fault("--at", 1, 1, str(error), "a value inside, or --clamp for the nearest", raw))
        else:
            values.append(
                {
                    "configuration": dict(zip(profile.names, map(plain, configuration), strict=True)),
                    "power_w": power_w,
                    "extrapolated": not profile.contains(configuration),
                }
            )
    if faults:
        raise InputError(*faults)
    return values


def _configuration(raw: str, names: tuple[str, ...]) -> tuple[float, ...]:
    """Read `fps=5,keysize=32`: each parameter once."""
    values: dict[str, float] = {}
    faults, column = [], 1
    for part in raw.split(","):
        name, equals, text = (piece.strip() for piece in part.partition("="))
        problem = ""
        if not equals:
            problem = f"{printable(part.strip(), 80) or 'an empty text'} is no name=value"
        elif name not in names:
            problem = f"no parameter {printable(name, 80) or 'without a name'}"
        elif name in values:
            problem = f"{name} stands twice"
        elif (value := _finite(text)) is None:
            problem = f"{name} is {printable(text, 80) or 'empty'}, not a finite number"
        else:
            values[name] = value
        if problem:
            faults.append(Fault("--at", 1, column, problem, _example(names), raw))
        column += len(part) + 1
    missing = [name for name in names if name not in values]
    if missing and not faults:
        faults.append(Fault("--at", 1, 1, f"no value for {', '.join(missing)}", _example(names), raw))
    if faults:
        raise InputError(*faults)
    return tuple(values[name] for name in names)


def _finite(text: str) -> float | None:
    """A number as people write it, or None; Python's own reader also takes nan, inf, and 1_000."""
    try:
        value = float(text)
    except ValueError:
        return None
    plausible = text.isascii() and "_" not in text and abs(value) < float("inf")
    return value if plausible else None


def _example(names: tuple[str, ...]) -> str:
    return ",".join(f"{name}=VALUE" for name in names)


def _warn_clamped(profile: AnyProfile, values: list[dict[str, Any]]) -> None:
    outside = [tuple(value["configuration"].values()) for value in values if value["extrapolated"]]
    for configuration in outside:
        taken = dict(zip(profile.names, profile.nearest(configuration), strict=True))
        message = f"{profile.outside(configuration)}: taken at {_shown(taken)}"
        warn([Fault("--at", 1, 1, message, severity="warning")])


def _shown(configuration: dict[str, float]) -> str:
    return ",".join(f"{name}={value:.10g}" for name, value in configuration.items())


def _summary(profile: AnyProfile) -> str:
    """The model as a table, one for each part, and their parameters if there are several."""
    tables = [_part_summary(part) for part in profile.parts]
    if len(tables) > 1:
        tables.insert(0, f"{len(tables)} parts, measured apart, whose power is added: {', '.join(profile.names)}")
    return "\n\n".join(tables)


def _part_summary(part: Profile) -> str:
    """A table: configuration, power, its spread and standard error, samples, how far the others miss it."""
    named = zip(part.names, part.units, strict=True)
    titles = [f"{name} [{unit}]".removesuffix(" []") for name, unit in named]
    left_out_w = (part.left_out_w - part.power_w).tolist()
    rows = [[*titles, "power [W]", "spread [W]", "std. error [W]", "samples", "left out [W]"]]
    for i, at in enumerate(part.configurations.tolist()):
        error_w = part.standard_error_w[i]
        rows.append(
            [
                *(f"{value:.10g}" for value in at),
                f"{part.power_w[i]:.6g}",
                f"{part.spread_w[i]:.2g}" if part.samples[i] > 1 else "",
                f"{error_w:.2g}" if math.isfinite(error_w) else "",
                str(part.samples[i]),
                f"{left_out_w[i]:+.2g}" if math.isfinite(left_out_w[i]) else "",
            ]
        )
    empty = [i for i in range(len(titles) + 1, len(rows[0])) if not any(row[i] for row in rows[1:])]
    kept = [[cell for i, cell in enumerate(row) if i not in empty] for row in rows]
    widths = [max(map(len, column)) for column in zip(*kept, strict=True)]
    table = ["  ".join(map(str.rjust, row, widths)).rstrip() for row in kept]
    head = f"{len(part.power_w)} configurations of {', '.join(part.names)}; {part.interpolation} between them"
    return "\n".join([head, f"source: {printable(part.source, 1000)}", *table, *_left_out_summary(part)])


def _left_out_summary(part: Profile) -> list[str]:
    found = part.leave_one_out
    if not found:
        return []
    worst = f"at most {found.largest_w:.2g} W, at {part.named(found.worst)}"
    points = "1 configuration" if found.points == 1 else f"{found.points} configurations"
    return [f"leave one out: {points} predicted from the others to {found.rms_w:.2g} W (rms), {worst}"]

"""`eadp profile`: measurements of the computations in, their energy model out."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eadp.cli.output import Format, emit, emit_json, usage_fault, warn
from eadp.errors import Fault, Infeasible, InputError, printable

if TYPE_CHECKING:
    from eadp.models.profile import Profile


class Interpolation(StrEnum):
    """How power is told between measured configurations."""

    linear = "linear"
    pchip = "pchip"


def command(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="Measurements (CSV) or a model (YAML); - is standard input.")
    ],
    output: Annotated[
        str,
        typer.Option("--output", "-o", metavar="MODEL.yaml", help="Write the model; - is standard output."),
    ] = "",
    at: Annotated[
        list[str] | None,
        typer.Option("--at", metavar="NAME=VALUE,…", help="Print the power at a configuration. May repeat."),
    ] = None,
    format: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.text,
    names: Annotated[
        str, typer.Option("--names", metavar="NAME,…", help="Better names for the parameters, in order.")
    ] = "",
    interpolation: Annotated[
        Interpolation | None,
        typer.Option("--interpolation", help="Between configurations; the default is linear, or the model's."),
    ] = None,
    clamp: Annotated[
        bool, typer.Option("--clamp", help="Outside the measured range, take the nearest inside.")
    ] = False,
) -> int:
    """Example: eadp profile profiles/pednet-jetson-nano.csv --at fps=5

    Build the energy model of the computations from measurements of their power: a CSV with a column for each
    parameter and one for the power (fps,power_w), or powprofiler's. Repeated configurations are averaged.
    """
    from eadp.io.profile_file import profile_document, profile_yaml, read_profile
    from eadp.io.streams import write_text

    if output == "-" and (at or format is Format.json):
        raise usage_fault("--output", output, "standard output is taken by --at or --format", "a file")
    profile, warnings = read_profile(file, [name.strip() for name in names.split(",")] if names else ())
    if interpolation:
        profile = _interpolated(profile, interpolation)
    values = _values(profile, at or [], clamp)
    if output:
        write_text(output, profile_yaml(profile))
    warn(warnings)
    _warn_clamped(profile, values)
    if at and format is Format.json:
        emit_json({"schema": "eadp.power/1", "values": values})
    elif at:
        emit("\n".join(f"{_shown(value['configuration'])}: {value['power_w']:.6g} W" for value in values))
    elif format is Format.json:
        emit_json(profile_document(profile))
    elif output != "-":
        emit(_summary(profile))
    return 0


def _interpolated(profile: Profile, kind: Interpolation) -> Profile:
    try:
        return replace(profile, interpolation=kind.value)
    except Infeasible as error:
        raise usage_fault("--interpolation", kind.value, str(error), "linear") from None


def _values(profile: Profile, asked: list[str], clamp: bool) -> list[dict[str, Any]]:
    """The answers to `--at`, all of their faults at once."""
    from eadp.io.profile_file import plain

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


def _warn_clamped(profile: Profile, values: list[dict[str, Any]]) -> None:
    outside = [tuple(value["configuration"].values()) for value in values if value["extrapolated"]]
    for configuration in outside:
        taken = dict(zip(profile.names, profile.interpolant.nearest(configuration), strict=True))
        message = f"{profile.outside(configuration)}: taken at {_shown(taken)}"
        warn([Fault("--at", 1, 1, message, severity="warning")])


def _shown(configuration: dict[str, float]) -> str:
    return ",".join(f"{name}={value:.10g}" for name, value in configuration.items())


def _summary(profile: Profile) -> str:
    """The model as a table: configuration, power and its spread, how many samples."""
    named = zip(profile.names, profile.units, strict=True)
    titles = [f"{name} [{unit}]".removesuffix(" []") for name, unit in named]
    rows = [[*titles, "power [W]", "spread [W]", "samples"]]
    for i, at in enumerate(profile.configurations.tolist()):
        spread = f"{profile.spread_w[i]:.2g}" if profile.samples[i] > 1 else ""
        configuration = [f"{value:.10g}" for value in at]
        rows.append([*configuration, f"{profile.power_w[i]:.6g}", spread, str(profile.samples[i])])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = ["  ".join(map(str.rjust, row, widths)) for row in rows]
    count = len(profile.power_w)
    head = f"{count} configurations of {', '.join(profile.names)}; {profile.interpolation} between them"
    return "\n".join([head, f"source: {printable(profile.source, 1000)}", *table])

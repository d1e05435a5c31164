"""`eadp profile`: measurements of the computations in, their energy model out."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any, Literal

from typer import Argument, Option

from eadp.cli.output import Progress, emit, emit_json, usage_fault, warn
from eadp.core.interpolation import Kind
from eadp.errors import Fault, Infeasible, InputError, printable, refuse
from eadp.io.profile.measurements import read_measurements
from eadp.io.profile.model_file import is_model, parse_profile, profile_document, profile_yaml
from eadp.io.text.json import aligned
from eadp.io.text.options import Flag, option_name
from eadp.io.text.streams import read_text, write_text
from eadp.measure.measuring import Configuration, MeasureOptions, measure_profile, parse_configuration
from eadp.measure.recordings import PowerColumns, as_tables
from eadp.models.profile import Profile, configuration_text, shortest, titles


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
    if measure:
        _refuse(_given(model) + _given(columns), "without --measure, on its result")
        return _measure(files, options, output)
    _refuse([option for option in _given(options) if option != "--config"], "with --measure")
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
        from eadp.measure.figures import write_profile_figure

        write_profile_figure(model.plot, profile)
    if output:
        write_text(output, profile_yaml(profile))
    warn(warnings + clamped)
    if json:
        emit_json({"schema": "eadp.power/1", "values": values} if at else profile_document(profile))
    elif at or output != "-":
        emit(_powers(values) if at else _summary(profile))
    return 0


def _given(options: Any) -> list[str]:
    """The options of a dataclass of them that have another value than their default."""
    return [option_name(each.name) for each in fields(options) if getattr(options, each.name) != each.default]


def _refuse(options: list[str], where: str) -> None:
    refuse([Fault(option, 1, 1, "has no effect here", f"it {where}") for option in options])


def _measure(command: list[str], options: MeasureOptions, output: str) -> int:
    """Measure and write the CSV; the results are noted on stderr."""
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
    lines = []
    for value in values:
        names, numbers = zip(*value["configuration"].items(), strict=True)
        lines.append(f"{configuration_text(names, numbers, ',')}: {value['power_w']:.6g} W")
    return "\n".join(lines)


def _summary(part: Profile) -> str:
    """The model as a table: configuration, power, standard deviation and error, samples."""
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


# ── what is read, and what is asked of it ──


def read_profile(
    files: Sequence[str],
    names: Sequence[str] = (),
    *,
    configurations: Sequence[Configuration] = (),
    interpolation: Kind | None = None,
    columns: PowerColumns | None = None,
) -> tuple[Profile, list[Fault]]:
    """Read a profile: measurements (CSV) or a model (YAML, JSON), whichever the files hold.

    Parameters
    ----------
    files : sequence of str
        Measurements, of several tables or traces, or one model; `-` is standard input.
    names : sequence of str
        New names of the parameters, in the order of their columns; none keeps the files'.
    configurations : sequence of Configuration
        Configurations of the traces among the files, in their order.
    interpolation : str
        `linear` or `pchip`; None keeps the model's.
    columns : PowerColumns
        Which columns of the files are read.

    Returns
    -------
    Profile
    list of Fault
        Warnings, first by line.

    Raises
    ------
    InputError
        With the faults of the files, or of the options about them.
    """
    texts = [*map(read_text, files)]
    models = [text for text in texts if is_model(text)]
    if models and len(texts) > 1:
        raise InputError.at(models[0].name, 1, 1, "a model among several files", "measurements, or one model")
    if models and configurations:
        raise InputError.at(models[0].name, 1, 1, "a model needs no configuration", "a trace of power over time")
    notes: list[Fault] = []
    if models:
        profile, warnings = parse_profile(models[0])
    else:
        tables, notes = as_tables(texts, columns or PowerColumns(), configurations)
        profile, warnings = read_measurements(tables)
    profile = _renamed(profile, names)
    if interpolation:
        try:
            profile = replace(profile, interpolation=interpolation)
        except Infeasible as error:
            raise InputError.at("--interpolation", 1, 1, str(error), "linear", interpolation) from None
    return profile, notes + warnings


def _renamed(profile: Profile, names: Sequence[str]) -> Profile:
    """A profile with new names of its parameters, if there are any."""
    if not names:
        return profile
    for name in names:
        if not re.fullmatch(r"[A-Za-z]\w{0,63}", name, re.ASCII):
            shown = printable(name, 80) or "an empty text"
            expected = "a name as a plan has it: letters, digits and _; commas between names"
            raise InputError.at("--names", 1, 1, f"{shown} is no name", expected)
    if len(set(names)) < len(names):
        raise InputError.at("--names", 1, 1, f"a name stands twice in {','.join(names)}", "each once")
    if len(names) != len(profile.names):
        message = f"{len(names)} names for the parameters {', '.join(profile.names)}"
        raise InputError.at("--names", 1, 1, message, f"{len(profile.names)} of them")
    return replace(profile, names=tuple(names))


def powers_at(profile: Profile, asked: Sequence[str], clamp: bool) -> tuple[list[dict[str, Any]], list[Fault]]:
    """Power at configurations such as `fps=5,keysize=32`.

    Parameters
    ----------
    profile : Profile
    asked : sequence of str
        Values of `--at`.
    clamp : bool
        Outside the measured range, take the nearest configuration inside.

    Returns
    -------
    list of dict
        The `values` of `eadp.power/1`.
    list of Fault
        A warning for each configuration that was clamped.

    Raises
    ------
    InputError
        With the faults of the first option that has any.
    """
    values: list[dict[str, Any]] = []
    warnings: list[Fault] = []
    for raw in asked:
        configuration = _configuration(raw, profile.names)
        extrapolated = False
        try:
            power_w = profile.power_w_at(configuration)
        except Infeasible as error:
            if not clamp:
                expected = "a value inside, or --clamp for the nearest"
                raise InputError.at("--at", 1, 1, str(error), expected, raw) from None
            extrapolated, nearest = True, profile.interpolant.nearest(configuration)
            power_w, taken = profile.power_w_at(nearest), configuration_text(profile.names, nearest, ",")
            warnings.append(Fault("--at", 1, 1, f"{error}: taken at {taken}", severity="warning"))
        named = dict(zip(profile.names, map(shortest, configuration), strict=True))
        values.append({"configuration": named, "power_w": power_w, "extrapolated": extrapolated})
    return values, warnings


def _configuration(raw: str, names: Sequence[str]) -> tuple[float, ...]:
    """Read `fps=5,keysize=32`: each parameter once."""
    expected = ",".join(f"{name}=VALUE" for name in names)
    given = parse_configuration(raw, "--at", expected)
    unknown = [name for name in given.names if name not in names]
    missing = [name for name in names if name not in given.names]
    if unknown or missing:
        message = f"no parameter {', '.join(unknown)}" if unknown else f"no value for {', '.join(missing)}"
        raise InputError.at("--at", 1, 1, message, expected, raw)
    return tuple(given.values[given.names.index(name)] for name in names)

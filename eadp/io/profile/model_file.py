"""Computation profiles in files: measurements (CSV) in, the model (YAML) in and out."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from eadp.core.interpolation import Kind
from eadp.errors import Fault, Infeasible, InputError, printable, refuse
from eadp.io.profile.measurements import (
    A_NAME,
    LARGEST,
    NAME,
    PARAMETERS_LIMIT,
    Configuration,
    PowerColumns,
    parse_configuration,
    read_measurements,
)
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import STRICT, Document, Path, keys_document, validated, yaml_text
from eadp.models.profile import ARRAYS, Profile, configuration_text, shortest
from eadp.plug_ins import plug_in

SCHEMA = "eadp.profile/1"

_MODEL = re.compile(r"""\{|["']?schema["']?\s*:""")


def read_profile(
    files: str | Sequence[str],
    names: Sequence[str] = (),
    *,
    configurations: Sequence[Configuration] = (),
    interpolation: Kind | None = None,
    columns: PowerColumns | None = None,
) -> tuple[Profile, list[Fault]]:
    """Read a profile: measurements (CSV) or a model (YAML, JSON), whichever the files hold.

    Parameters
    ----------
    files : str or sequence of str
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
    texts = [read_text(path) for path in ([files] if isinstance(files, str) else files)]
    models = [text for text in texts if _is_model(text)]
    if models and len(texts) > 1:
        raise InputError.at(models[0].name, 1, 1, "a model among several files", "measurements, or one model")
    if models and configurations:
        raise InputError.at(models[0].name, 1, 1, "a model needs no configuration", "a trace of power over time")
    notes: list[Fault] = []
    if models:
        profile, warnings = parse_profile(models[0], names)
    else:
        tables, notes = plug_in("recordings", "power")(texts, columns or PowerColumns(), configurations)
        profile, warnings = _measured(tables, names)
    if interpolation:
        try:
            profile = replace(profile, interpolation=interpolation)
        except Infeasible as error:
            raise InputError.at("--interpolation", 1, 1, str(error), "linear", interpolation) from None
    return profile, notes + warnings


def parse_profile(text: Text, names: Sequence[str] = ()) -> tuple[Profile, list[Fault]]:
    """`read_profile` of a text: a model if its name ends as one's does, or if its first key is `schema`."""
    if not _is_model(text):
        return _measured([text], names)
    return _renamed(_read_model(text), names), []


def _measured(tables: Sequence[Text], names: Sequence[str]) -> tuple[Profile, list[Fault]]:
    profile, warnings = read_measurements(tables, names)
    found = [replace(fault, severity="warning") for fault in warnings]
    return _renamed(profile, names), sorted(found, key=lambda fault: (fault.file, fault.line, fault.column))


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


def _is_model(text: Text) -> bool:
    """Whether a text is a model and not measurements: by the ending of its name, or by its first line."""
    if os.path.splitext(text.name)[1].lower() in (".yaml", ".yml", ".json"):
        return True
    lines = (line.strip() for line in text.body.split("\n"))
    first = next((line for line in lines if line and not line.startswith("#") and line != "---"), "")
    return _MODEL.match(first) is not None


# ── the model's schema ──

_Power = Annotated[float, Field(ge=0, le=LARGEST)]
_Value = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


@dataclass(frozen=True)
class _Parameter:
    """A parameter of the computations; its unit is empty where it is not known."""

    name: str
    """name, as the plan and options use it"""

    unit: Annotated[str, Field(max_length=64)] = ""
    """unit of its values; empty where it is not known"""


@dataclass(frozen=True)
class _Point:
    """A measured configuration, a value for each parameter; mean and standard deviation of its power, samples."""

    at: Annotated[list[_Value], Field(min_length=1)]
    """a value for each parameter, in their order"""

    power_w: _Power
    """mean power [W]"""

    std_w: _Power = 0.0
    """standard deviation of the samples; 0 of one sample"""

    samples: Annotated[int, Field(ge=1, le=2**53)] = 1
    """number of samples that the mean is of"""

    standard_error_w: _Power | None = None
    """standard error of power_w, with the correlation of consecutive samples"""


@dataclass(frozen=True, kw_only=True)
class ProfileFile:
    """Computation profile: average power at measured configurations of the computations' parameters."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.profile/1"]
    """name and version of the format"""

    source: str = ""
    """where the measurements are from"""

    parameters: Annotated[list[_Parameter], Field(min_length=1, max_length=PARAMETERS_LIMIT)]
    """parameters of the computations, in order"""

    interpolation: Literal["linear", "pchip"] = "linear"
    """between the points: piecewise linear, or monotone cubic"""

    points: Annotated[list[_Point], Field(min_length=2)]
    """configurations that were measured"""


# ── reading a model ──


def _read_model(text: Text) -> Profile:
    """A model."""
    document = keys_document(text, SCHEMA)
    content = validated(ProfileFile, document, document.value)
    refuse(_faults(document, content))

    points = content.points
    try:
        profile = Profile(
            names=tuple(parameter.name for parameter in content.parameters),
            units=tuple(parameter.unit for parameter in content.parameters),
            configurations=np.array([point.at for point in points], dtype=np.float64),
            power_w=np.array([point.power_w for point in points]),
            std_w=np.array([point.std_w for point in points]),
            samples=np.array([point.samples for point in points]),
            source=content.source,
            standard_error_w=np.array([point.standard_error_w for point in points], dtype=np.float64),  # None is NaN
        )
    except Infeasible as error:
        raise InputError(document.fault(("points",), str(error))) from None
    try:
        return replace(profile, interpolation=content.interpolation)
    except Infeasible as error:
        raise InputError(document.fault(("interpolation",), str(error))) from None


def _faults(document: Document, content: ProfileFile) -> list[Fault]:
    """Faults of a model beyond the types of its keys."""
    faults = []
    names = [parameter.name for parameter in content.parameters]
    for i, name in enumerate(names):
        path: Path = ("parameters", i, "name")
        if not NAME.match(name):
            shown = printable(name, 80) or "an empty text"
            faults.append(document.fault(path, f"{shown} is no name", A_NAME))
        elif name in names[:i]:
            faults.append(document.fault(path, f"the name {name} stands twice", "each once"))
    seen: set[tuple[float, ...]] = set()
    for i, point in enumerate(content.points):
        path, at = ("points", i, "at"), tuple(point.at)
        if len(at) != len(names):
            message = f"{len(at)} values for {len(names)} parameters"
            faults.append(document.fault(path, message, "one for each"))
        elif at in seen:
            shown = ", ".join(f"{value:g}" for value in at)
            faults.append(document.fault(path, f"the configuration {shown} stands twice", "each once"))
        seen.add(at)
    return faults


# ── writing a model ──


def profile_document(profile: Profile) -> dict[str, Any]:
    """A profile as the JSON-ready document of its schema, every key written out."""
    columns = [getattr(profile, name).tolist() for name in ARRAYS]
    return {
        "schema": SCHEMA,
        "source": profile.source,
        "parameters": [{"name": n, "unit": u} for n, u in zip(profile.names, profile.units, strict=True)],
        "interpolation": profile.interpolation,
        "points": [
            {
                "at": [shortest(value) for value in at],
                "power_w": shortest(power_w),
                "std_w": shortest(std_w),
                "samples": samples,
                "standard_error_w": shortest(standard_w) if math.isfinite(standard_w) else None,
            }
            for at, power_w, std_w, samples, standard_w in zip(*columns, strict=True)
        ],
    }


def profile_yaml(profile: Profile) -> str:
    """The canonical text of a profile; reading it gives an equal profile.

    Parameters
    ----------
    profile : Profile

    Returns
    -------
    str
        YAML, one line for each parameter and each configuration, without defaults.
    """
    return yaml_text(_without_defaults(profile_document(profile)))


DEFAULTS = {"unit": "", "std_w": 0, "samples": 1, "standard_error_w": None}
"""Keys that a file need not have, and what they are then."""


def _without_defaults(value: Any) -> Any:
    """A document without defaults."""
    if isinstance(value, list):
        return [_without_defaults(item) for item in value]
    if not isinstance(value, dict):
        return value
    return {key: _without_defaults(item) for key, item in value.items() if key not in DEFAULTS or item != DEFAULTS[key]}


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
        try:
            power_w = profile.power_w_at(configuration, clamp)
        except Infeasible as error:
            expected = "a value inside, or --clamp for the nearest"
            raise InputError.at("--at", 1, 1, str(error), expected, raw) from None
        extrapolated = not profile.interpolant.contains(configuration)
        if extrapolated:
            taken = configuration_text(profile.names, profile.interpolant.nearest(configuration), ",")
            message = f"{profile.outside(configuration)}: taken at {taken}"
            warnings.append(Fault("--at", 1, 1, message, severity="warning"))
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

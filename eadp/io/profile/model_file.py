"""Computation profiles in files: measurements (CSV) in, the model (YAML) in and out."""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from eadp.errors import Fault, Infeasible, InputError, capped, printable
from eadp.io.profile.configurations import configuration_in_name
from eadp.io.profile.measurements import (
    A_NAME,
    LARGEST,
    NAME,
    PARAMETERS_LIMIT,
    Configuration,
    Places,
    Trace,
    is_trace,
    read_measurements,
)
from eadp.io.text.schema_faults import validated
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import Document, Path, read_yaml
from eadp.models.profile import Profile
from eadp.models.profile_sum import AnyProfile, ProfileSum, added

SCHEMA = "eadp.profile/1"

PARTS_LIMIT = 16
"""Most parts of a model: computations that were measured apart."""

_MODEL = re.compile(r"""\{|["']?schema["']?\s*:""")


@dataclass(frozen=True)
class Sources:
    """Which files a profile comes from.

    Attributes
    ----------
    files : sequence of str
        Measurements (CSV) of one set of computations, or one model (YAML, JSON); `-` is standard input.
    added : sequence of str
        Measurements or models of computations that were measured apart: their power is added.
    names : sequence of str
        Better names for the parameters, in the order of their columns, file by file; none keeps the files'.
    configurations : sequence of Configuration
        What the traces among `files` were measured at, in their order.
    pattern : str
        How the names of the traces carry what they were measured at; see `configurations.configuration_in_name`.
    """

    files: Sequence[str]
    added: Sequence[str] = ()
    names: Sequence[str] = ()
    configurations: Sequence[Configuration] = ()
    pattern: str = ""


def read_profile(path: str, names: Sequence[str] = ()) -> tuple[AnyProfile, list[Fault]]:
    """Read a profile: measurements (CSV) or a model (YAML, JSON), whichever the file holds.

    Parameters
    ----------
    path : str
        The file, `-` for standard input.
    names : sequence of str
        Better names for its parameters, in the order of their columns; none keeps the file's.

    Returns
    -------
    Profile, or ProfileSum
        The model.
    list of Fault
        Warnings, first by line.

    Raises
    ------
    InputError
        With the faults of the file, or of `names`.
    """
    return parse_profile(read_text(path), names, is_model=ends_as_model(path))


def read_profiles(sources: Sources) -> tuple[AnyProfile, list[Fault]]:
    """`read_profile` of several files: traces of several configurations, and computations that were measured apart.

    Raises
    ------
    InputError
        With the faults of the files, or of what options say about them.
    """
    if len(sources.files) == 1 and not (sources.added or sources.configurations or sources.pattern):
        return read_profile(sources.files[0], sources.names)
    _check_names(sources.names)
    texts = [read_text(path) for path in sources.files]
    models = [
        text
        for path, text in zip(sources.files, texts, strict=True)
        if ends_as_model(path) or _begins_as_model(text.body)
    ]
    if models and len(texts) > 1:
        message = "a model among several files"
        raise InputError.at(models[0].name, 1, 1, message, "measurements, or --add for what is added")
    apart = bool(sources.added and sources.names)
    names = () if apart else sources.names
    if models:
        if sources.configurations or sources.pattern:
            raise InputError.at(texts[0].name, 1, 1, "a model needs no configuration", "a trace of power over time")
        profile, warnings = parse_profile(texts[0], names, is_model=True)
    else:
        profile, warnings = _measured(_traces(sources, texts), names, nameless=apart)
    profiles = [profile]
    for path in sources.added:
        profile, more = parse_profile(read_text(path), is_model=ends_as_model(path), nameless=apart)
        profiles.append(profile)
        warnings += more
    return _added(profiles, sources.names if apart else ()), warnings


def _traces(sources: Sources, texts: Sequence[Text]) -> list[Trace]:
    """Each file with what it was measured at, where it needs to be told."""
    if sources.configurations and sources.pattern:
        raise InputError.at("--from-name", 1, 1, "stands beside --config", "one of the two")
    told = list(sources.configurations)
    traces, count = [], 0
    for path, text in zip(sources.files, texts, strict=True):
        configuration = None
        if is_trace(text):
            if sources.pattern:
                configuration = configuration_in_name(path, sources.pattern)
            elif count < len(told):
                configuration = told[count]
            count += 1
        traces.append(Trace(text, configuration))
    if told and len(told) != count:
        message = f"stated for {len(told)} files, and {count} do not say what they were measured at"
        raise InputError.at("--config", 1, 1, message, "one for each of them, in their order")
    return traces


def _added(profiles: Sequence[AnyProfile], names: Sequence[str]) -> AnyProfile:
    """The sum of profiles, renamed all together."""
    if names:
        count = sum(len(profile.names) for profile in profiles)
        if len(names) != count:
            message = f"{len(names)} names for the parameters {', '.join(n for p in profiles for n in p.names)}"
            raise InputError.at("--names", 1, 1, message, f"{count} of them")
        rest, renamed = list(names), []
        for profile in profiles:
            renamed.append(_renamed(profile, rest[: len(profile.names)]))
            rest = rest[len(profile.names) :]
        profiles = renamed
    try:
        return added(profiles)
    except Infeasible as error:
        raise InputError.at("--add", 1, 1, str(error), "names of their own, as --names gives them") from None


def parse_profile(
    text: Text, names: Sequence[str] = (), *, is_model: bool = False, nameless: bool = False
) -> tuple[AnyProfile, list[Fault]]:
    """`read_profile` of a text: a model if said so, or if it begins with a `schema` key or a brace.

    `nameless` takes several columns of numbers alone without names, as c1, c2, …: they are named later.
    """
    _check_names(names)
    if not (is_model or _begins_as_model(text.body)):
        return _measured([Trace(text)], names, nameless=nameless)
    parts = _read_model(text)
    warnings = [found for profile, places in parts for found in _warnings(profile, places)]
    try:
        profile = added([profile for profile, _ in parts])
    except Infeasible as error:
        raise InputError.at(text.name, 1, 1, str(error), "each parameter in one part") from None
    return _renamed(profile, names) if names else profile, warnings


def _measured(files: Sequence[Trace], names: Sequence[str], *, nameless: bool) -> tuple[AnyProfile, list[Fault]]:
    profile, places = read_measurements(files, names, nameless=nameless)
    if names:
        renamed = _renamed(profile, names)
        assert isinstance(renamed, Profile)
        profile = renamed
    return profile, _warnings(profile, places)


def _warnings(profile: Profile, places: Places) -> list[Fault]:
    """What is odd about a profile, each at its place, first by line."""
    warnings = [replace(fault, severity="warning") for fault in places.warnings]
    for found in profile.findings():
        place = places.of_point[tuple(profile.configurations[found.point].tolist())]
        warnings.append(replace(place, severity="warning", message=found.message))
    return sorted(warnings, key=lambda fault: (fault.file, fault.line, fault.column))


def ends_as_model(path: str) -> bool:
    """Whether a file's name says that it is a model."""
    return os.path.splitext(path)[1].lower() in (".yaml", ".yml", ".json")


def _begins_as_model(body: str) -> bool:
    """Whether the first line that is no comment, nor the mark of a document, begins a model."""
    for line in io.StringIO(body):
        stripped = line.strip()
        if stripped and not stripped.startswith("#") and stripped != "---":
            return _MODEL.match(stripped) is not None
    return False


def _check_names(names: Sequence[str]) -> None:
    for name in names:
        if not NAME.match(name):
            shown = printable(name, 80) or "an empty text"
            raise InputError.at("--names", 1, 1, f"{shown} is no name", A_NAME)
    if len(set(names)) < len(names):
        raise InputError.at("--names", 1, 1, f"a name stands twice in {','.join(names)}", "each once")


def _renamed(profile: AnyProfile, names: Sequence[str]) -> AnyProfile:
    if len(names) != len(profile.names):
        message = f"{len(names)} names for the parameters {', '.join(profile.names)}"
        raise InputError.at("--names", 1, 1, message, f"{len(profile.names)} of them")
    parts, column = [], 0
    for part in profile.parts:
        parts.append(replace(part, names=tuple(names[column : column + len(part.names)])))
        column += len(part.names)
    return added(parts)


# ── the model's schema ──

_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
_Power = Annotated[float, Field(ge=0, le=LARGEST)]
_Value = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]


class _Parameter(BaseModel):
    """A parameter of the computations; its unit is empty where it is not known."""

    model_config = _STRICT
    name: str
    unit: Annotated[str, Field(max_length=64)] = ""


class _Point(BaseModel):
    """A measured configuration, a value for each parameter; the mean and spread of its power, the samples."""

    model_config = _STRICT
    at: Annotated[list[_Value], Field(min_length=1)]
    power_w: _Power
    spread_w: Annotated[_Power, Field(description="standard deviation of the samples; 0 of one sample")] = 0.0
    samples: Annotated[int, Field(ge=1, le=2**53)] = 1
    standard_error_w: Annotated[
        _Power | None, Field(description="standard deviation of power_w as a mean, consecutive samples being alike")
    ] = None
    left_out_error_w: Annotated[
        _Value | None, Field(description="what the other points predict, less power_w; reported, ignored when read")
    ] = None


class _LeaveOneOut(BaseModel):
    """How far the other points miss one that is left out; reported, ignored when read."""

    model_config = _STRICT
    points: int
    rms_w: float
    largest_w: float


class _PartFile(BaseModel):
    """Average power at measured configurations of the parameters of computations that were measured together."""

    model_config = _STRICT
    source: str = ""
    parameters: Annotated[list[_Parameter], Field(min_length=1, max_length=PARAMETERS_LIMIT)]
    interpolation: Literal["linear", "pchip"] = "linear"
    points: Annotated[list[_Point], Field(min_length=2)]
    leave_one_out: _LeaveOneOut | None = None


class ProfileFile(_PartFile):
    """Computation profile: average power at measured configurations of the computations' parameters."""

    model_config = ConfigDict(title=SCHEMA, **_STRICT)
    schema_: Annotated[Literal["eadp.profile/1"], Field(alias="schema")]


class _SumFile(BaseModel):
    """Computation profile of computations that were measured apart: their power is added."""

    model_config = ConfigDict(title=SCHEMA, **_STRICT)
    schema_: Annotated[Literal["eadp.profile/1"], Field(alias="schema")]
    parts: Annotated[list[_PartFile], Field(min_length=1, max_length=PARTS_LIMIT)]


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a profile's model file: parameters and points, or parts that have them."""
    whole, parts = ProfileFile.model_json_schema(), _SumFile.model_json_schema()
    keys = ["source", "parameters", "interpolation", "points", "leave_one_out"]
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **whole}
    schema["$defs"] = {**whole["$defs"], **parts["$defs"]}
    schema["properties"] = {**whole["properties"], "parts": parts["properties"]["parts"]}
    schema["required"] = ["schema"]
    schema["oneOf"] = [
        {"required": ["parameters", "points"], "not": {"required": ["parts"]}},
        {"required": ["parts"], "not": {"anyOf": [{"required": [key]} for key in keys]}},
    ]
    return schema


# ── the model in ──


def _read_model(text: Text) -> list[tuple[Profile, Places]]:
    """The parts of a model, one where it has no parts, each with the places of its points."""
    document = read_yaml(text)
    content = _validated(document)
    parts: dict[Path, _PartFile] = {}
    if isinstance(content, _SumFile):
        parts = {("parts", i): part for i, part in enumerate(content.parts)}
    else:
        parts = {(): content}
    faults = [fault for place, part in parts.items() for fault in _faults(document, part, place)]
    if faults:
        raise capped(faults)
    return [(_part(document, part, place), _places(document, part, place)) for place, part in parts.items()]


def _places(document: Document, content: _PartFile, where: Path) -> Places:
    points = enumerate(content.points)
    return Places({tuple(point.at): document.fault((*where, "points", i), "") for i, point in points})


def _part(document: Document, content: _PartFile, where: Path) -> Profile:
    points = content.points
    errors_w = [point.standard_error_w for point in points]
    try:
        return Profile(
            names=tuple(parameter.name for parameter in content.parameters),
            units=tuple(parameter.unit for parameter in content.parameters),
            configurations=np.array([point.at for point in points], dtype=np.float64),
            power_w=np.array([point.power_w for point in points], dtype=np.float64),
            spread_w=np.array([point.spread_w for point in points], dtype=np.float64),
            samples=np.array([point.samples for point in points], dtype=np.int64),
            interpolation=content.interpolation,
            source=content.source,
            standard_error_w=np.array([np.nan if error is None else error for error in errors_w], dtype=np.float64),
        )
    except Infeasible as error:
        key = "interpolation" if content.interpolation == "pchip" else "points"
        raise InputError(document.fault((*where, key), str(error))) from None


def _validated(document: Document) -> ProfileFile | _SumFile:
    value = document.value
    if not isinstance(value, dict) or value.get("schema") != SCHEMA:
        raise InputError(document.fault(("schema",), "not the model of a profile", f"schema: {SCHEMA}"))
    if "parts" in value:
        return validated(_SumFile, document, value)
    return validated(ProfileFile, document, value)


def _faults(document: Document, content: _PartFile, where: Path) -> list[Fault]:
    """What is wrong with a model beyond the types of its keys."""
    faults = []
    names = [parameter.name for parameter in content.parameters]
    for i, name in enumerate(names):
        place: Path = (*where, "parameters", i, "name")
        if not NAME.match(name):
            shown = printable(name, 80) or "an empty text"
            faults.append(document.fault(place, f"{shown} is no name", A_NAME))
        elif name in names[:i]:
            faults.append(document.fault(place, f"the name {name} stands twice", "each once"))
    seen: set[tuple[float, ...]] = set()
    for i, point in enumerate(content.points):
        place, at = (*where, "points", i, "at"), tuple(point.at)
        if len(at) != len(names):
            message = f"{len(at)} values for {len(names)} parameters"
            faults.append(document.fault(place, message, "one for each"))
        elif at in seen:
            shown = ", ".join(f"{value:g}" for value in at)
            faults.append(document.fault(place, f"the configuration {shown} stands twice", "each once"))
        seen.add(at)
    return faults


# ── the model out ──


def profile_document(profile: AnyProfile) -> dict[str, Any]:
    """A profile as the JSON-ready document of its schema, every key written out, with its leave-one-out errors."""
    if isinstance(profile, ProfileSum):
        return {"schema": SCHEMA, "parts": [_part_document(part) for part in profile.parts]}
    return {"schema": SCHEMA, **_part_document(profile)}


def _part_document(profile: Profile) -> dict[str, Any]:
    points = zip(
        profile.configurations.tolist(),
        profile.power_w.tolist(),
        profile.spread_w.tolist(),
        profile.samples.tolist(),
        profile.standard_error_w.tolist(),
        (profile.left_out_w - profile.power_w).tolist(),
        strict=True,
    )
    found = profile.leave_one_out
    return {
        "source": profile.source,
        "parameters": [{"name": n, "unit": u} for n, u in zip(profile.names, profile.units, strict=True)],
        "interpolation": profile.interpolation,
        "points": [
            {
                "at": [plain(value) for value in at],
                "power_w": plain(power_w),
                "spread_w": plain(spread_w),
                "samples": samples,
                "standard_error_w": plain(error_w) if math.isfinite(error_w) else None,
                "left_out_error_w": left_out_w if math.isfinite(left_out_w) else None,
            }
            for at, power_w, spread_w, samples, error_w, left_out_w in points
        ],
        "leave_one_out": found and {"points": found.points, "rms_w": found.rms_w, "largest_w": found.largest_w},
    }


def plain(value: float) -> float | int:
    """A number as people write it: a whole one without its point."""
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def profile_yaml(profile: AnyProfile) -> str:
    """The canonical text of a profile; reading it gives an equal profile.

    Parameters
    ----------
    profile : Profile or ProfileSum

    Returns
    -------
    str
        YAML, one line for each parameter and each configuration; keys that say nothing, or that follow from others,
        are left out.
    """
    lines = [f"schema: {SCHEMA}"]
    if isinstance(profile, ProfileSum):
        lines.append("parts:")
        for part in profile.parts:
            first, *rest = _part_lines(part)
            lines += [f"  - {first}", *(f"    {line}" for line in rest)]
    else:
        lines += _part_lines(profile)
    return "\n".join(lines) + "\n"


def _part_lines(profile: Profile) -> list[str]:
    document = _part_document(profile)
    return [
        f"source: {_quoted(document['source'])}",
        "parameters:",
        *(f"  - {_flow(_told(parameter))}" for parameter in document["parameters"]),
        f"interpolation: {document['interpolation']}",
        "points:",
        *(f"  - {_flow(_told(point))}" for point in document["points"]),
    ]


def _told(item: dict[str, Any]) -> dict[str, Any]:
    """A mapping without the keys whose values are their defaults, or follow from others."""
    defaults = {"unit": "", "spread_w": 0, "samples": 1, "standard_error_w": None}
    return {
        key: value
        for key, value in item.items()
        if key != "left_out_error_w" and (key not in defaults or value != defaults[key])
    }


def _flow(value: Any) -> str:
    """A value on one line; `repr` of a float is the shortest text that reads back the same."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return _quoted(value) if isinstance(value, str) else repr(value)


def _quoted(text: str) -> str:
    """A YAML string in double quotes, everything that does not print escaped."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in escaped) + '"'

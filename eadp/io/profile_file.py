"""Computation profiles in files: measurements (CSV) in, the model (YAML) in and out."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from eadp.errors import Fault, Infeasible, InputError, capped, printable
from eadp.io.profile_csv import A_NAME, LARGEST, NAME, PARAMETERS_LIMIT, Places, read_measurements
from eadp.io.schema_faults import validated
from eadp.io.streams import Text, read_text
from eadp.io.yaml_text import Document, read_yaml
from eadp.models.profile import Profile

SCHEMA = "eadp.profile/1"

_MODEL = re.compile(r"""\{|["']?schema["']?\s*:""")


def read_profile(path: str, names: Sequence[str] = ()) -> tuple[Profile, list[Fault]]:
    """Read a profile: measurements (CSV) or a model (YAML, JSON), whichever the file holds.

    Parameters
    ----------
    path : str
        The file, `-` for standard input.
    names : sequence of str
        Better names for its parameters, in the order of their columns; none keeps the file's.

    Returns
    -------
    Profile
        The model.
    list of Fault
        Warnings, first by line.

    Raises
    ------
    InputError
        With the faults of the file, or of `names`.
    """
    is_model = os.path.splitext(path)[1].lower() in (".yaml", ".yml", ".json")
    return parse_profile(read_text(path), names, is_model=is_model)


def parse_profile(text: Text, names: Sequence[str] = (), *, is_model: bool = False) -> tuple[Profile, list[Fault]]:
    """`read_profile` of a text: a model if said so, or if it begins with a `schema` key or a brace."""
    _check_names(names)
    is_model = is_model or _begins_as_model(text.body)
    profile, places = _read_model(text) if is_model else read_measurements(text, names)
    if names:
        profile = _renamed(profile, names)
    warnings = [replace(fault, severity="warning") for fault in places.warnings]
    for found in profile.findings():
        place = places.of_point[tuple(profile.configurations[found.point].tolist())]
        warnings.append(replace(place, severity="warning", message=found.message))
    return profile, sorted(warnings, key=lambda fault: (fault.line, fault.column))


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


def _renamed(profile: Profile, names: Sequence[str]) -> Profile:
    if len(names) != len(profile.names):
        message = f"{len(names)} names for the parameters {', '.join(profile.names)}"
        raise InputError.at("--names", 1, 1, message, f"{len(profile.names)} of them")
    return replace(profile, names=tuple(names))


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
    spread_w: _Power = 0.0
    samples: Annotated[int, Field(ge=1, le=2**53)] = 1


class ProfileFile(BaseModel):
    """Computation profile: average power at measured configurations of the computations' parameters."""

    model_config = ConfigDict(title=SCHEMA, **_STRICT)
    schema_: Annotated[Literal["eadp.profile/1"], Field(alias="schema")]
    source: str = ""
    parameters: Annotated[list[_Parameter], Field(min_length=1, max_length=PARAMETERS_LIMIT)]
    interpolation: Literal["linear", "pchip"] = "linear"
    points: Annotated[list[_Point], Field(min_length=2)]


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a profile's model file."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **ProfileFile.model_json_schema()}


# ── the model in ──


def _read_model(text: Text) -> tuple[Profile, Places]:
    document = read_yaml(text)
    content = _validated(document)
    faults = _faults(document, content)
    if faults:
        raise capped(faults)
    try:
        profile = Profile(
            names=tuple(parameter.name for parameter in content.parameters),
            units=tuple(parameter.unit for parameter in content.parameters),
            configurations=np.array([point.at for point in content.points], dtype=np.float64),
            power_w=np.array([point.power_w for point in content.points], dtype=np.float64),
            spread_w=np.array([point.spread_w for point in content.points], dtype=np.float64),
            samples=np.array([point.samples for point in content.points], dtype=np.int64),
            interpolation=content.interpolation,
            source=content.source,
        )
    except Infeasible as error:
        key = "interpolation" if content.interpolation == "pchip" else "points"
        raise InputError(document.fault((key,), str(error))) from None
    places = {tuple(point.at): document.fault(("points", i), "") for i, point in enumerate(content.points)}
    return profile, Places(places)


def _validated(document: Document) -> ProfileFile:
    value = document.value
    if not isinstance(value, dict) or value.get("schema") != SCHEMA:
        raise InputError(document.fault(("schema",), "not the model of a profile", f"schema: {SCHEMA}"))
    return validated(ProfileFile, document, value)


def _faults(document: Document, content: ProfileFile) -> list[Fault]:
    """What is wrong with a model beyond the types of its keys."""
    faults = []
    names = [parameter.name for parameter in content.parameters]
    for i, name in enumerate(names):
        place = ("parameters", i, "name")
        if not NAME.match(name):
            shown = printable(name, 80) or "an empty text"
            faults.append(document.fault(place, f"{shown} is no name", A_NAME))
        elif name in names[:i]:
            faults.append(document.fault(place, f"the name {name} stands twice", "each once"))
    seen: set[tuple[float, ...]] = set()
    for i, point in enumerate(content.points):
        place, at = ("points", i, "at"), tuple(point.at)
        if len(at) != len(names):
            message = f"{len(at)} values for {len(names)} parameters"
            faults.append(document.fault(place, message, "one for each"))
        elif at in seen:
            shown = ", ".join(f"{value:g}" for value in at)
            faults.append(document.fault(place, f"the configuration {shown} stands twice", "each once"))
        seen.add(at)
    return faults


# ── the model out ──


def profile_document(profile: Profile) -> dict[str, Any]:
    """A profile as the JSON-ready document of its schema, every key written out."""
    points = zip(
        profile.configurations.tolist(),
        profile.power_w.tolist(),
        profile.spread_w.tolist(),
        profile.samples.tolist(),
        strict=True,
    )
    parameters = zip(profile.names, profile.units, strict=True)
    return {
        "schema": SCHEMA,
        "source": profile.source,
        "parameters": [{"name": name, "unit": unit} for name, unit in parameters],
        "interpolation": profile.interpolation,
        "points": [
            {
                "at": [plain(value) for value in at],
                "power_w": plain(power_w),
                "spread_w": plain(spread_w),
                "samples": samples,
            }
            for at, power_w, spread_w, samples in points
        ],
    }


def plain(value: float) -> float | int:
    """A number as people write it: a whole one without its point."""
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def profile_yaml(profile: Profile) -> str:
    """The canonical text of a profile; reading it gives an equal profile.

    Parameters
    ----------
    profile : Profile

    Returns
    -------
    str
        YAML, one line for each parameter and each configuration; keys that say nothing are left out.
    """
    document = profile_document(profile)
    lines = [
        f"schema: {document['schema']}",
        f"source: {_quoted(document['source'])}",
        "parameters:",
        *(f"  - {_flow(_told(parameter))}" for parameter in document["parameters"]),
        f"interpolation: {document['interpolation']}",
        "points:",
        *(f"  - {_flow(_told(point))}" for point in document["points"]),
    ]
    return "\n".join(lines) + "\n"


def _told(item: dict[str, Any]) -> dict[str, Any]:
    """A mapping without the keys whose values are their defaults."""
    defaults = {"unit": "", "spread_w": 0, "samples": 1}
    return {key: value for key, value in item.items() if key not in defaults or value != defaults[key]}


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

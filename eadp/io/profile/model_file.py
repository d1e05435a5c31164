"""Computation profiles in files: measurements (CSV) in, the model (YAML) in and out."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from eadp.errors import Fault, Infeasible, InputError, printable, refuse
from eadp.io.profile.measurements import A_NAME, LARGEST, NAME, PARAMETERS_LIMIT, read_measurements
from eadp.io.text.streams import Text
from eadp.io.text.yaml import STRICT, Document, Path, keys_document, validated, yaml_text
from eadp.models.profile import ARRAYS, Profile, shortest

SCHEMA = "eadp.profile/1"

_MODEL = re.compile(r"""\{|["']?schema["']?\s*:""")


def parse_profile(text: Text) -> tuple[Profile, list[Fault]]:
    """The profile of a text, a model (YAML, JSON) or measurements (CSV), and warnings, first by line.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    return (_read_model(text), []) if is_model(text) else read_measurements([text])


def is_model(text: Text) -> bool:
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
    except (Infeasible, ValueError) as error:
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
    for i, point in enumerate(content.points):
        if len(point.at) != len(names):
            message = f"{len(point.at)} values for {len(names)} parameters"
            faults.append(document.fault(("points", i, "at"), message, "one for each"))
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

"""Energy models in files: YAML or JSON in, `schema: eadp.energy/1`; the document and its text out."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields
from itertools import zip_longest
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import to_jsonable_python

from eadp.errors import Fault, InputError, refuse
from eadp.io.text.streams import Text
from eadp.io.text.yaml import STRICT, Document, read_yaml, validated, yaml_text
from eadp.models.energy import Coefficients, EnergyModel, Harmonic

SCHEMA = "eadp.energy/1"
AGREEMENT = 1e-6
"""Tolerance between the coefficients and the harmonics, relative to the largest: rounding."""

_Watts = Annotated[float, Field(ge=-1e9, le=1e9)]
_Deviation = Annotated[float, Field(ge=0, le=1e9)]
_Seconds = Annotated[float, Field(gt=0, le=1e9)]


class EnergyFile(BaseModel):
    """Energy model: power = mean + Σ_j amplitude_j cos(2πjt/period + phase_j), t from the first sample.

    `periodic`, `order` and `coefficients` repeat what the other keys give: they may be left out, and must agree.
    """

    model_config = ConfigDict(title=SCHEMA, use_attribute_docstrings=True, **STRICT)
    schema_: Annotated[Literal["eadp.energy/1"], Field(alias="schema")]
    """Name and version of the format."""

    periodic: bool | None = None
    """Whether there is a period."""

    period_s: _Seconds | None
    """Period [s]; null without one."""

    period_std_s: _Deviation | None = None
    """Standard deviation of the period [s]."""

    order: Annotated[int, Field(ge=0)] | None = None
    """Number of harmonics."""

    mean_w: _Watts
    """Mean power [W]."""

    mean_std_w: _Deviation | None = None
    """Standard deviation of the mean [W]."""

    harmonics: Annotated[tuple[Harmonic, ...], Field(max_length=1000)]
    """Amplitude and phase of each harmonic, from the first."""

    amplitude_std_w: Annotated[tuple[_Deviation, ...], Field(max_length=1000)] = ()
    """Standard deviation of each amplitude [W]."""

    coefficients: Coefficients | None = None
    """The papers' coefficients."""

    noise_std_w: _Deviation = 0.0
    """Standard deviation of what the model leaves over [W]."""

    cv_r2: Annotated[float, Field(le=1)] = 0.0
    """Coefficient of determination, cross-validated."""

    samples: Annotated[int, Field(ge=0, le=2**53)] = 0
    """Number of samples of the log."""

    span_s: Annotated[float, Field(ge=0, le=1e12)] = 0.0
    """Time that the log spans [s]."""

    candidate: dict[str, float | None] | None = None
    """Of a fit alone, as are the keys below: the best period [s], significant or not, and its p-value `chance`."""

    range_s: tuple[float, float] | None = None
    """Shortest and longest period searched [s]."""

    drift_s: tuple[float, float] | None = None
    """Shortest and longest period of a part of the log, where it drifts [s]."""

    prior: dict[str, float | str] | None = None
    """Period near which it was searched [s], and its source."""

    log: dict[str, float] | None = None
    """Readings of the log, and those left out."""


def parse_energy(text: Text) -> EnergyModel:
    """The energy model in a text, YAML or JSON, as `eadp fit` writes it.

    Raises
    ------
    InputError
        With the faults of the file.
    """
    document = read_yaml(text)
    if not isinstance(document.value, dict) or document.value.get("schema") != SCHEMA:
        raise InputError(document.fault(("schema",), "not an energy model", f"schema: {SCHEMA}"))
    content = validated(EnergyFile, document, document.value)
    if content.period_s is None and content.harmonics:
        raise InputError(document.fault(("harmonics",), "harmonics without a period", "a period_s, or []"))
    model = EnergyModel(**{field.name: getattr(content, field.name) for field in fields(EnergyModel)})
    refuse(_disagreements(document, content, model))
    return model


def _disagreements(document: Document, content: EnergyFile, model: EnergyModel) -> list[Fault]:
    """Faults of keys that contradict the ones they repeat."""
    faults = []
    if content.periodic not in (None, model.periodic):
        given, expected = json.dumps(content.periodic), f"{json.dumps(model.periodic)}, by period_s"
        faults.append(document.fault(("periodic",), f"periodic is {given}", expected))
    if content.order not in (None, model.order):
        expected = f"{model.order}, the number of harmonics"
        faults.append(document.fault(("order",), f"order is {content.order}", expected))
    if len(content.amplitude_std_w) not in (0, model.order):
        message = f"{len(content.amplitude_std_w)} standard deviations of amplitudes"
        faults.append(document.fault(("amplitude_std_w",), message, f"{model.order}, the number of harmonics, or none"))
    if content.coefficients is not None:
        known = asdict(model.coefficients)
        tolerance = AGREEMENT * max(map(abs, (*known["a"], *known["b"])), default=0.0)
        for key, values in known.items():
            if not _agree(getattr(content.coefficients, key), values, tolerance):
                shown = json.dumps([float(f"{value:.6g}") for value in values])
                message = f"{key} is not that of the harmonics"
                faults.append(document.fault(("coefficients", key), message, f"{shown}, or no coefficients"))
    return faults


def _agree(given: tuple[float, ...], expected: tuple[float, ...], tolerance: float) -> bool:
    pairs = zip_longest(given, expected, fillvalue=math.inf)
    return all(abs(one - other) <= tolerance for one, other in pairs)


def energy_document(model: EnergyModel) -> dict[str, Any]:
    """An energy model as the JSON-ready document of its schema, every key written out."""
    keys = [key for key in EnergyFile.model_fields if hasattr(model, key)]
    return {"schema": SCHEMA, **to_jsonable_python({key: getattr(model, key) for key in keys})}


def energy_yaml(model: EnergyModel) -> str:
    """The canonical text of an energy model; reading it gives an equal model.

    Parameters
    ----------
    model : EnergyModel

    Returns
    -------
    str
        YAML with the keys of `energy_document`, one line for each harmonic.
    """
    return yaml_text(energy_document(model))

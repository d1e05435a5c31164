"""Energy models in files: YAML or JSON in, `schema: eadp.energy/1`; the document and its text out."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic_core import to_jsonable_python

from eadp.errors import InputError
from eadp.io.text.streams import Text
from eadp.io.text.yaml import STRICT, keys_document, validated, yaml_text
from eadp.models.energy import Coefficients, EnergyModel, Harmonic

SCHEMA = "eadp.energy/1"

_Watts = Annotated[float, Field(ge=-1e9, le=1e9)]
_Deviation = Annotated[float, Field(ge=0, le=1e9)]
_Seconds = Annotated[float, Field(gt=0, le=1e9)]


@dataclass(frozen=True, kw_only=True)
class EnergyFile:
    """Energy model: power = mean + Σ_j amplitude_j cos(2πjt/period + phase_j), t from the first sample.

    `periodic`, `order` and `coefficients` repeat what the other keys give, which are those that count.
    """

    __pydantic_config__ = STRICT

    schema: Literal["eadp.energy/1"]
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
    document = keys_document(text, SCHEMA)
    content = validated(EnergyFile, document, document.value)
    if content.period_s is None and content.harmonics:
        raise InputError(document.fault(("harmonics",), "harmonics without a period", "a period_s, or []"))
    return EnergyModel(**{field.name: getattr(content, field.name) for field in fields(EnergyModel)})


def energy_document(model: EnergyModel) -> dict[str, Any]:
    """An energy model as the JSON-ready document of its schema, every key written out."""
    known = {each.name: getattr(model, each.name) for each in fields(EnergyFile) if hasattr(model, each.name)}
    return {"schema": SCHEMA, **to_jsonable_python(known)}


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

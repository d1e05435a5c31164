"""The vehicle file: an airframe and its battery, read strictly, with defaults that fly."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, make_dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import Discriminator, Tag

from eadp.errors import EadpError, Fault, InputError, printable, refuse
from eadp.io.text.streams import Text
from eadp.io.text.yaml import STRICT, Document, Path, keys_document, validated, validated_at, without_nulls
from eadp.models.battery import Battery
from eadp.models.data_sheet import DataSheet, estimate
from eadp.models.vehicle import AIRFRAMES, Airframe, FixedWing, airframe_class

SCHEMA = "eadp.vehicle/1"
DEFAULT = next(iter(AIRFRAMES))


def _model_of(airframe: Any) -> str:
    model = airframe.get("model") if isinstance(airframe, dict) else getattr(airframe, "model", None)
    return DEFAULT if model is None else str(model)


if TYPE_CHECKING:
    AnyAirframe = Airframe
else:
    AnyAirframe = Annotated[
        Union[tuple(Annotated[airframe, Tag(model)] for model, airframe in AIRFRAMES.items())],  # noqa: UP007
        Discriminator(_model_of),
    ]


@dataclass(frozen=True)
class VehicleFile:
    """A vehicle file."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.vehicle/1"] = "eadp.vehicle/1"
    """Name and version of the format."""

    name: str = ""
    """Name of the aircraft, for people."""

    airframe: AnyAirframe = field(default_factory=FixedWing)
    """The airframe: its model, and the keys of that model alone."""

    battery: Battery = field(default_factory=Battery)
    """The battery."""

    data_sheet: DataSheet | None = None
    """What the maker states: it gives the keys of a `fixed-wing` that `airframe` does not have."""

    std: dict[str, float] | None = None
    """Of a fit alone, as are the keys below: standard errors of keys of the airframe."""

    battery_std: dict[str, float | None] | None = None
    """Standard errors of keys of the battery."""

    power: dict[str, Any] | None = None
    """The power that was fitted, and how well."""

    notes: list[str] | None = None
    """What was not identified, and what was taken instead."""


@cache
def _class_of(airframe: Any) -> type[VehicleFile]:
    """`VehicleFile` with an airframe of another package in place of those of eadp."""
    keys: Any = [("airframe", airframe, field(default_factory=airframe))]
    return make_dataclass("VehicleFile", keys, bases=(VehicleFile,), frozen=True, namespace={"__module__": __name__})


def vehicle_class(vehicle: Any) -> type[VehicleFile]:
    """The class that checks the keys of a vehicle: `VehicleFile`, or one with the airframe of another package."""
    airframe = vehicle.get("airframe") if isinstance(vehicle, dict) else None
    model = _model_of(airframe)
    kind: Any = None if model in AIRFRAMES else airframe_class(model)
    return VehicleFile if kind is None else _class_of(kind)


def vehicle_of(document: Document) -> VehicleFile:
    """The vehicle that a document describes.

    Raises
    ------
    InputError
        With every fault found.
    """
    value = without_nulls(document.value)
    refuse(airframe_faults(document, value) + given_twice(document, value))
    value = with_sheet(document, document.value)
    return validated(vehicle_class(value), document, value, lambda keys: battery_faults(document, keys.battery))


def with_sheet(document: Document, vehicle: Any, at: Path = ()) -> Any:
    """The keys of a vehicle, at a path, with an airframe by its data sheet under the keys that are given.

    Raises
    ------
    InputError
        With the faults of the sheet and of the battery, or of what they lead to.
    """
    keys, place = without_nulls(vehicle), (*map(str, at), "data_sheet")
    if not isinstance(keys, dict) or "data_sheet" not in keys:
        return vehicle
    sheet = validated_at(place, DataSheet, document, keys["data_sheet"])
    given, pack = keys.get("airframe", {}), keys.get("battery", {})
    if not isinstance(given, dict) or not isinstance(pack, dict):
        return vehicle  # which is refused
    if _model_of(given) != FixedWing.model:
        message = f"data_sheet beside an airframe of model {_model_of(given)}"
        raise InputError(document.fault(place, message, "one of the two"))
    if (sheet.endurance_min is None) == (sheet.cruise_power_w is None):
        message = "data_sheet has an endurance and a power" if sheet.endurance_min else "data_sheet has no endurance"
        raise InputError(document.fault(place, message, "endurance_min or cruise_power_w"))
    if sheet.endurance_min is not None and sheet.pack_wh is None and not pack:
        message = "data_sheet.endurance_min without the pack that it is stated for"
        raise InputError(document.fault((*place, "endurance_min"), message, "pack_wh, or the battery of the vehicle"))
    battery = validated_at((*place[:-1], "battery"), Battery, document, pack)
    base = validated_at((*place[:-1], "airframe"), FixedWing, document, given)
    try:
        sheet = sheet.with_power(battery)
        found = estimate(sheet, base.avionics_w if "avionics_w" in given else None, base.air_density_kgpm3)
    except EadpError as error:
        expected = "kg, m, m/s, min and Wh; of an unusual aircraft wing_area_m2, or the keys of airframe"
        raise InputError(document.fault(place, f"data_sheet has {error}", expected)) from None
    speed = base.airspeed_mps if "airspeed_mps" in given else sheet.airspeed_mps
    stated = without_nulls(asdict(sheet))
    airframe = {**found.keys, "power_std_share": found.power_std_at(speed), **given}
    return {**keys, "data_sheet": stated, "airframe": airframe}


WIND_KEYS = "speed_mps", "from_deg", "towards_deg"
BESIDE: dict[str, tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]] = {
    "battery": ((("voltage_v", "voltage_empty_v"), ("cells", "chemistry")),),
    "wind": ((("towards_deg",), ("from_deg",)), *(((key,), ("profile",)) for key in WIND_KEYS)),
    "start": ((("lat_deg", "lon_deg"), ("position_m",)),),
    "home": ((("lat_deg", "lon_deg"), ("position_m",)),),
}
"""By section of a vehicle or a scenario, what is given in one of two ways: the keys of both, the one it needs first."""


def given_twice(document: Document, value: Any, at: Path = ()) -> list[Fault]:
    """What is given in both ways of `BESIDE`, below a path."""
    faults = []
    for section, ways in BESIDE.items():
        keys: Any = value.get(section) if isinstance(value, dict) else None
        for way in ways if isinstance(keys, dict) else ():
            one, other = (next((key for key in names if keys.get(key) not in (None, [])), "") for names in way)
            if one and other:
                message = f"{section}.{other} and {section}.{one} are both given"
                faults.append(document.fault((*at, section, one), message, "one of the two"))
    return faults


def replaced(key: str) -> set[str]:
    """The keys whose place an override of a dotted one takes: where it is the first of its way, the other's."""
    *_, section, last = ("", *key.split("."))
    both = [ways for one, other in BESIDE.get(section, ()) for ways in ((one, other), (other, one))]
    return {name for own, others in both if last == own[0] for name in others}


def battery_faults(document: Document, battery: Battery) -> list[Fault]:
    """Settings of a battery that contradict each other."""
    return [document.fault(("battery", key), f"battery.{message}") for key, message in battery.faults()]


def airframe_faults(document: Document, vehicle: Any, at: Path = ()) -> list[Fault]:
    """An unknown model of the airframe, or keys of another model, of a vehicle at a path."""
    airframe = vehicle.get("airframe") if isinstance(vehicle, dict) else None
    if not isinstance(airframe, dict):
        return []
    model, place = _model_of(airframe), (*at, "airframe")
    if airframe_class(model) is None:
        message = f"unknown {'.'.join(map(str, place))}.model {printable(model, 60)}"
        return [document.fault((*place, "model"), message, f"one of {', '.join(AIRFRAMES)}")]
    keys = {name: {item.name for item in fields(other)} for name, other in AIRFRAMES.items()}
    faults = []
    for key in airframe if model in AIRFRAMES else ():
        owners = [name for name in AIRFRAMES if key in keys[name]]
        if owners and model not in owners:
            message = f"{'.'.join(map(str, place))}.{key} is a key of model {', '.join(owners)}, not of {model}"
            faults.append(document.fault((*place, key), message, f"keys of model {model} alone"))
    return faults


def read_vehicle(text: Text) -> VehicleFile:
    """The vehicle of a file's text.

    Raises
    ------
    InputError
        With every fault found.
    """
    return vehicle_of(keys_document(text, SCHEMA))

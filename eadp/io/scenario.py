"""The scenario: what `simulate` needs beside plan and profile, read strictly, with defaults that fly.

The settings stand beside what they set, in the dataclasses of models and planning; the keys here are what is left.
"""

from __future__ import annotations

import copy
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, make_dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Ge, Le, Lt
from pydantic import Field
from pydantic_core import to_jsonable_python

from eadp.core.arrays import Altitude, Coordinate, Degrees, Duration, Latitude, Longitude, Reserve
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import FARTHEST_M, heading_rad, to_near_local_m
from eadp.errors import Fault, InputError, one_of, printable, refuse
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import (
    STRICT,
    Document,
    keys_document,
    read_yaml,
    schema_of,
    validated,
    validated_at,
    without_nulls,
)
from eadp.io.vehicle import SCHEMA as VEHICLE_SCHEMA
from eadp.io.vehicle import (
    VehicleFile,
    airframe_faults,
    battery_faults,
    given_twice,
    replaced,
    vehicle_class,
    vehicle_of,
    with_sheet,
)
from eadp.models.autopilot import Autopilot
from eadp.models.battery import Battery, BatteryFault
from eadp.models.plan.cursor import Rules
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Box, Parameter
from eadp.models.vehicle import Guidance
from eadp.models.weather import Sensors, Wind
from eadp.planning.base import PlannerSettings, SharedSettings
from eadp.planning.registry import DEFAULT, PLANNERS, is_planner, planner_class, planner_names
from eadp.plug_ins import plug_in

SCHEMA = "eadp.scenario/1"

ParameterName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Pair = tuple[Coordinate, Coordinate]
TextSource = Callable[[str], Text]


def _or_path(node: dict[str, Any]) -> None:
    """Complete the vehicle's schema: the path of a file stands for its content."""
    node["anyOf"] = [{"type": "string"}, {"$ref": node.pop("$ref")}]


@dataclass(frozen=True)
class _PlannerKeys(SharedSettings):
    """Settings of every planner, and which of them flies."""

    __pydantic_config__ = STRICT

    name: Annotated[str, Field(json_schema_extra={"enum": [*PLANNERS]})] = DEFAULT
    """Planner that flies."""


@cache
def _planner_section(others: tuple[str, ...] = ()) -> type[SharedSettings]:
    """Section `planner`: the keys of every planner, and a section of each one's own, those of other packages too."""
    sections: list[Any] = []
    for planner in (*PLANNERS, *others):
        settings: Any = planner_class(planner).own_settings
        if settings is not None:
            described = Field(description=f"Settings of planner {planner} alone.")
            sections.append((planner, Annotated[settings, described], field(default_factory=settings)))
    module = {"__module__": __name__}
    return make_dataclass("PlannerSection", sections, bases=(_PlannerKeys,), frozen=True, namespace=module)


if TYPE_CHECKING:
    PlannerSection = SharedSettings
    EstimatorSettings = Any
else:
    PlannerSection = _planner_section()
    EstimatorSettings = plug_in("estimators", "power").own_settings


@dataclass(frozen=True)
class Home:
    """Where the aircraft can return to, for the point of no return and flights that turn back."""

    position_m: Pair | None = None
    """Position [east, north] in the plan's frame [m]."""

    lat_deg: Latitude | None = None
    """Latitude [°], instead of `position_m`, where the plan has an origin."""

    lon_deg: Longitude | None = None
    """Longitude [°], with `lat_deg`."""

    altitude_m: Altitude | None = None
    """Altitude of the way there [m], as `RTL_ALTITUDE`; by default that of the stage."""


@dataclass(frozen=True)
class Start(Home):
    """Where the flight starts; by default on the first path, before its trigger."""

    heading_deg: Degrees | None = None
    """Compass bearing of the nose, 0 north, 90 east [°]; by default along the first path."""

    altitude_m: Altitude | None = None
    """Altitude [m]; by default that of the first stage or of the airframe's cruise, and 0 for a mission, from home."""

    @property
    def heading_rad(self) -> float | None:
        """The heading in the plan's frame, 0 east, counter-clockwise [rad], if it is given."""
        return None if self.heading_deg is None else heading_rad(self.heading_deg)


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file."""

    __pydantic_config__ = STRICT

    schema: Literal["eadp.scenario/1"] = "eadp.scenario/1"
    """Name and version of the format."""

    profile: str | None = None
    """Computation profile: path of a model or of measurements, relative to this file."""

    vehicle: Annotated[VehicleFile, Field(json_schema_extra=_or_path)] = field(default_factory=VehicleFile)
    """The aircraft: path of a vehicle file, relative to this file, or its content."""

    wind: Wind = field(default_factory=Wind)
    """The wind."""

    battery: Battery = field(default_factory=Battery)
    """The battery: each key overrides the vehicle's, null restores its default."""

    faults: tuple[BatteryFault, ...] = ()
    """Sudden losses of charge, of a battery that is drained."""

    start: Start = field(default_factory=Start)
    """Where the flight starts."""

    home: Home = field(default_factory=Home)
    """Where the aircraft can return to."""

    autopilot: Autopilot = field(default_factory=Autopilot)
    """The autopilot that flies, for its own rules of returns and landings."""

    parameters: Mapping[ParameterName, float] = field(default_factory=dict)
    """Parameters at take-off, by name; by default each at its maximum."""

    bounds: Mapping[ParameterName, tuple[float, float]] = field(default_factory=dict)
    """Sets [low, high] by parameter, for a plan whose stages carry none."""

    parameter_changes: Literal["latched", "live"] = "latched"
    """When a path parameter takes effect: latched, at the next lap, or live, at once."""

    guidance: Guidance = field(default_factory=Guidance)
    """How the aircraft follows its path."""

    sensors: Sensors = field(default_factory=Sensors)
    """Errors of the sensors."""

    reserve_soc: Reserve = PlannerSettings.reserve_soc
    """State of charge to keep at the end of the flight, as a share of the full charge."""

    estimator: EstimatorSettings = field(default_factory=EstimatorSettings)
    """Estimation of the power from its readings."""

    planner: PlannerSection = field(default_factory=PlannerSection)
    """The planner and its settings; sections of planners that do not fly are checked and unused."""

    on_infeasible: Literal["continue", "home"] = "continue"
    """Where the reserve cannot be kept to the end: continue the plan, or fly home while that keeps the reserve."""

    obstacles: Literal["avoid", "ignore"] = "avoid"
    """Whether the plan's obstacles and boundary count: a flight that enters one, or leaves it, is not completed."""

    step_s: Annotated[float, Ge(1e-4), Le(1)] = 0.01
    """Time step of the simulation [s]."""

    log_every_s: Duration = 0.1
    """Time between rows of flight.csv [s]."""

    time_limit_s: Annotated[float, Ge(1e-3), Le(1e9)] | None = None
    """Time after which the flight is ended [s]; by default three times the plan's at the parameters of take-off."""

    seed: Annotated[int, Ge(0), Lt(2**63)] = 0
    """Seed of gusts and noise."""


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scenario file."""
    schema = schema_of(ScenarioFile)
    for node in schema["properties"].values():
        if "patternProperties" in node:
            node["additionalProperties"] = False
    return schema | {"required": ["schema"]}


@dataclass(frozen=True)
class Scenario:
    """A scenario that was read: its keys, and the document for faults that show later."""

    keys: ScenarioFile
    document: Document = field(repr=False)
    vehicle_text: Text | None = field(default=None, repr=False)
    """Text of the vehicle file, if the vehicle is one."""

    @property
    def profile_path(self) -> str | None:
        """Path of the profile, relative to the working directory."""
        return None if self.keys.profile is None else beside(self.document.name, self.keys.profile)

    @property
    def chosen(self) -> frozenset[str]:
        """Which of airframe, battery and wind somebody chose: the scenario, its vehicle or an override."""
        given = self.document.value
        vehicle = given.get("vehicle") or {}
        airframe = vehicle.get("airframe") or vehicle.get("data_sheet")
        found = {"airframe": airframe, "battery": given.get("battery") or vehicle.get("battery")}
        return frozenset(key for key, value in {**found, "wind": given.get("wind")}.items() if value)

    @property
    def rules(self) -> Rules:
        """How stages follow one another."""
        return Rules(self.keys.parameter_changes, self.keys.vehicle.airframe.published_triggers)

    @property
    def planner(self) -> PlannerSettings:
        """The planner's settings."""
        keys, section = self.keys, self.keys.planner
        shared: dict[str, Any] = {each.name: getattr(section, each.name) for each in fields(SharedSettings)}
        own = getattr(section, section.name, None)
        return PlannerSettings(**shared, reserve_soc=keys.reserve_soc, own=own, estimator=keys.estimator)

    @property
    def bounds(self) -> dict[str, Box]:
        """Sets for a plan whose stages carry none."""
        return {name: Box(lo, hi) for name, (lo, hi) in self.keys.bounds.items()}

    def with_names(self, parameters: Sequence[Parameter], sets: Sequence[Box]) -> Scenario:
        """The same scenario with parameters by their names where it has their titles, and values as the plan has them.

        Raises
        ------
        InputError
            If a parameter is given by both, or what it stands for has no such value.
        """
        titled = {item.title: i for i, item in enumerate(parameters) if item.title}
        value, renamed = copy.deepcopy(self.document.value), {}
        for path, values in by_parameter(value):
            for title in [name for name in values if name in titled]:
                given, key = values.pop(title), ".".join(map(str, (*path, title)))
                i, item = titled[title], parameters[titled[title]]
                if item.name in values:
                    message = f"{title} is {item.name}, which stands there too"
                    raise InputError(self.fault(key, message, "one of them"))
                if item.stands_for is not None and path[-1] not in ("weights", "coefficients"):
                    given = self._of_shown(key, item, given, sets[i : i + 1])
                values[item.name], renamed[*path, title] = given, (*path, item.name)
        if not renamed:
            return self
        places = {renamed.get(path, path): found for path, found in self.document.places.items()}
        overrides = {renamed.get(path, path): found for path, found in self.document.overrides.items()}
        return _checked(replace(self.document, value=value, places=places, overrides=overrides), self.vehicle_text)

    def unknown_parameter(self, key: str, name: str, plan: Plan) -> Fault:
        """The fault of a parameter that the plan does not have, given at a dotted key."""
        if self.document.overrides.get(("parameters", name)) == f"--set {key}":  # of --set NAME=…, which may be a key
            known = [*(item.label for item in plan.parameters), *ScenarioFile.__dataclass_fields__]
            return self.fault(key, f"unknown key {name}: the plan has no parameter {name} either", one_of(known, name))
        return self.fault(key, f"the plan has no parameter {name}", plan.expected_name(name))

    def _of_shown(self, key: str, item: Parameter, shown: Any, sets: Sequence[Box]) -> float:
        """A value of a parameter that is given by what it stands for."""
        if not key.startswith("parameters.") or not sets:
            what = f"{item.title} stands for a value of {item.name}, which is not known here"
            raise InputError(self.fault(key, what, item.name))
        given = item.of_shown(float(shown), sets[0])
        if sets[0].clip(given) != given:
            low, high = sorted(map(item.shown, (sets[0].lo, sets[0].hi)))
            what = f"{item.title} = {shown:.10g} is outside its set"
            raise InputError(self.fault(key, what, f"a value in [{low:.4g}, {high:.4g}]"))
        return given

    def position_m(self, key: str, origin_deg: Point | None) -> Point | None:
        """The position at `start` or `home` [m], of a plan with an origin or without; None where it has none.

        Raises
        ------
        InputError
            If its latitude and longitude have no position in the plan's frame.
        """
        place: Home = getattr(self.keys, key)
        if place.lat_deg is None or place.lon_deg is None:
            return place.position_m
        if origin_deg is None:
            message = "a latitude and a longitude, and the plan has no origin"
            raise InputError(self.fault(f"{key}.lat_deg", message, f"{key}.position_m, or %: origin in the plan"))
        point = to_near_local_m(place.lat_deg, place.lon_deg, origin_deg)
        if point is None:
            swapped = abs(place.lon_deg) <= 90 and to_near_local_m(place.lon_deg, place.lat_deg, origin_deg)
            hint = ", but near it with lon_deg and lat_deg swapped" if swapped else ""
            message = f"too far from the plan's origin{hint}"
            raise InputError(self.fault(f"{key}.lat_deg", message, f"at most {FARTHEST_M / 1000:g} km"))
        return point

    def fault(self, key: str, message: str, expected: str = "") -> Fault:
        """A fault at a dotted key."""
        return self.document.fault(tuple(key.split(".")), message, expected)


def by_parameter(value: Any) -> Iterator[tuple[tuple[str | int, ...], dict[str, Any]]]:
    """The mappings of a scenario whose keys are parameters, each with its path."""
    planner = value.get("planner") or {}
    sections: list[tuple[tuple[str | int, ...], dict[str, Any], tuple[str, ...]]] = [
        ((), value, ("parameters", "bounds")),
        (("planner",), planner, ("weights", "levels")),
    ]
    for name in PLANNERS:
        own = planner.get(name) or {}
        sections.append((("planner", name), own, ("delta", "gains")))
        trade_offs = enumerate(own.get("trade_offs") or ())
        sections += [(("planner", name, "trade_offs", i), each, ("coefficients",)) for i, each in trade_offs]
    for path, section, keys in sections:
        yield from (((*path, key), section[key]) for key in keys if section.get(key))


def beside(name: str, path: str) -> str:
    """A path relative to the file of a name."""
    return path if name == "<stdin>" else str(Path(name).parent / path)


def read_scenario(path: str | None, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario, or the defaults, with some keys overridden.

    Parameters
    ----------
    path : str or None
        The file, `-` for standard input, None for the defaults.
    overrides : mapping of dotted key to value, optional
        As `read_override` gives them.

    Raises
    ------
    InputError
        With every fault that was found.
    """
    text = Text("scenario", "") if path is None else read_text(path)
    return scenario_of(Document(text, {}) if path is None else scenario_document(text), overrides)


def scenario_document(text: Text) -> Document:
    """A scenario's document, its keys not yet checked.

    Raises
    ------
    InputError
        If it is no YAML or no mapping, or has no key `schema`.
    """
    return keys_document(text, SCHEMA)


def vehicle_path(document: Document, overrides: Mapping[str, Any]) -> str | None:
    """Path of the vehicle file that a scenario names, relative to the working directory; None if it names none.

    That of an override may be given so, too: it is typed in a shell.
    """
    path = overrides.get("vehicle", document.value.get("vehicle"))
    if not isinstance(path, str):
        return None
    return path if "vehicle" in overrides and Path(path).exists() else beside(document.name, path)


def scenario_of(
    document: Document, overrides: Mapping[str, Any] | None = None, text: TextSource = read_text
) -> Scenario:
    """`read_scenario` of a document, which is not changed; `text` reads the vehicle file, if it names one."""
    document, overrides = copy.deepcopy(document), dict(overrides or {})
    path, vehicle_text = vehicle_path(document, overrides), None
    if "vehicle" in overrides:
        _put(document, "vehicle", overrides.pop("vehicle"))
    if path is not None:
        vehicle_text = text(path)
        vehicle = keys_document(vehicle_text, VEHICLE_SCHEMA)
        vehicle_of(vehicle)
        document.value["vehicle"] = vehicle.value
    for key, given in overrides.items():
        _put(document, key, copy.deepcopy(given))
    return _checked(document, vehicle_text)


def _checked(document: Document, vehicle_text: Text | None) -> Scenario:
    raw = without_nulls(document.value)
    vehicle = raw.get("vehicle")
    faults = airframe_faults(document, vehicle, ("vehicle",)) + given_twice(document, vehicle, ("vehicle",))
    refuse(faults + given_twice(document, raw))
    keys = _validated(document)
    given = battery_keys(document, keys.vehicle.battery)
    battery = validated_at(("battery",), Battery, document, given)
    refuse(battery_faults(document, battery))
    return Scenario(replace(keys, battery=battery), document, vehicle_text)


def battery_keys(document: Document, battery: Battery) -> dict[str, Any]:
    """The keys of a scenario's battery: its own over those of the vehicle's, and null restores a default.

    A voltage takes the place of cells, and cells that of a resistance, which was that of others.
    """
    own, vehicle = document.value.get("battery") or {}, document.value.get("vehicle") or {}
    kept = dict(vehicle.get("battery") or {})
    if kept.get("cells") and own.keys() & {"voltage_v", "voltage_empty_v"}:
        kept |= {key: getattr(battery, key) for key in ("voltage_v", "voltage_empty_v", "resistance_ohm")}
        kept |= {"cells": None, "chemistry": None}
    elif own.get("cells"):
        kept["resistance_ohm"] = None
    return without_nulls(kept | own)  # type: ignore[no-any-return]


@cache
def _class_of(vehicle: Any, planners: tuple[str, ...]) -> type[ScenarioFile]:
    """`ScenarioFile` with another class of the vehicle, and with sections of planners of other packages."""
    planner = _planner_section(planners)
    keys: Any = [
        (name, kind, field(default_factory=kind)) for name, kind in (("vehicle", vehicle), ("planner", planner))
    ]
    return make_dataclass("ScenarioFile", keys, bases=(ScenarioFile,), frozen=True, namespace={"__module__": __name__})


def _validated(document: Document) -> ScenarioFile:
    """The keys of a scenario, those of other packages among them."""
    value = {**document.value}
    if "vehicle" in value:
        value["vehicle"] = with_sheet(document, value["vehicle"], ("vehicle",))
    vehicle: Any = vehicle_class(value.get("vehicle"))
    planner, own = value.get("planner"), set[str]()
    if isinstance(planner, dict):
        own = {*planner, str(planner.get("name"))} - PlannerSection.__dataclass_fields__.keys()
    others = tuple(sorted(filter(is_planner, own - {*PLANNERS})))
    kind = ScenarioFile if vehicle is VehicleFile and not others else _class_of(vehicle, others)
    return validated(kind, document, value, lambda keys: _faults(keys, document))


def override_key(name: str) -> str | None:
    """The dotted key that a name stands for, as `c1` does for `parameters.c1`; None if it is no such name."""
    if not name or not all(part.isidentifier() for part in name.split(".")):
        return None
    return name if "." in name or name in ScenarioFile.__dataclass_fields__ else f"parameters.{name}"


def read_override(raw: str) -> tuple[str, Any]:
    """`key=value` of `--set`: the dotted key, and the value read as YAML; `fps=…` is short for `parameters.fps=…`.

    Raises
    ------
    InputError
        If it is not of that form.
    """
    name, equals, text = raw.partition("=")
    key = override_key(name.strip())
    if not equals or key is None:
        raise InputError.at("--set", 1, 1, f"{printable(raw)} sets no key", "key=value, as in wind.speed_mps=8", raw)
    try:
        return key, read_yaml(Text("--set", text)).value
    except InputError as error:
        first = error.faults[0]
        column = first.column + len(raw) - len(text) if first.line == 1 else 1
        raise InputError.at("--set", 1, column, first.message, first.expected, raw) from None


def plain(value: Any) -> Any:
    """A value of mappings, lists and what YAML has: arrays become lists, and paths texts."""
    return to_jsonable_python(value, fallback=lambda each: each.tolist() if hasattr(each, "tolist") else str(each))


def value_text(value: Any) -> str:
    """A value as text that is both JSON and YAML."""
    return json.dumps(plain(value))


def override_texts(
    given: Mapping[str, Any] | Iterable[str], planner: str | None = None, seed: int | None = None
) -> list[str]:
    """Overrides as key=value, of a mapping or as they are given; a planner and a seed are more of them.

    Raises
    ------
    InputError
        If there is no such planner.
    """
    if planner is not None and not is_planner(planner):
        message = f"unknown planner {printable(planner, 60)}"
        raise InputError.at("--planner", 1, 1, message, one_of(planner_names(), planner), planner)
    pairs = given.items() if isinstance(given, Mapping) else ()
    texts = [f"{key}={value_text(value)}" for key, value in pairs] or [str(text) for text in given]
    texts += [f"planner.name={planner}"] if planner is not None else []
    return texts + ([] if seed is None else [f"seed={seed}"])


def read_overrides(texts: Iterable[str]) -> dict[str, Any]:
    """`read_override` of each text; of two with one key, the last holds."""
    return dict(map(read_override, texts))


def _put(document: Document, key: str, value: Any) -> None:
    """Set a dotted key; the locations of what it replaces are removed."""
    parts = key.split(".")
    target = document.value
    for part in parts[:-1]:
        if not isinstance(target.get(part), dict):
            target[part] = {}
        target = target[part]
    target[parts[-1]] = value
    for other in replaced(key) if value is not None else ():
        target.pop(other, None)
    path = tuple(parts)
    for known in [place for place in document.places if place[: len(path)] == path]:
        del document.places[known]
    document.overrides[path] = f"--set {key}"


def _faults(keys: ScenarioFile, document: Document) -> list[Fault]:
    """What the schema alone cannot express."""
    faults = []
    if any(after[0] <= before[0] for before, after in itertools.pairwise(keys.wind.profile)):
        faults.append(document.fault(("wind", "profile"), "wind.profile is not in order of time", "times that rise"))
    if keys.guidance.k_d < 0 and keys.vehicle.airframe.takes_commands:
        message = "guidance.k_d is negative: the aircraft turns away from its path"
        faults.append(document.fault(("guidance", "k_d"), message, "0 or more, but for paper aircraft"))
    if not is_planner(keys.planner.name):
        message = f"unknown planner {printable(keys.planner.name, 60)}"
        faults.append(document.fault(("planner", "name"), message, one_of(planner_names(), keys.planner.name)))
    for key, place in {"start": keys.start, "home": keys.home}.items():
        if (place.lat_deg is None) != (place.lon_deg is None):
            faults.append(document.fault((key,), f"{key} has one of lat_deg and lon_deg", "both, or neither"))
    for name, (lo, hi) in keys.bounds.items():
        if lo > hi:
            faults.append(document.fault(("bounds", name), f"bounds of {name}: {lo:g} is above {hi:g}", "[low, high]"))
    return faults

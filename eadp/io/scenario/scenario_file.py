"""The scenario: what `simulate` needs beside plan and profile, read strictly, with defaults that fly.

The schema here is the contract with users; `Scenario` hands out the domain's own dataclasses.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from eadp.core.geometry.curves import Point
from eadp.errors import Fault, InputError, printable
from eadp.io.text.schema_faults import validated
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import Document, read_yaml
from eadp.models.battery import Battery, BatteryFault
from eadp.models.plan.cursor import Rules
from eadp.models.plan.plan import Box
from eadp.models.sensors import Sensors
from eadp.models.vehicle import FixedWing, Guidance, PaperVehicle, Vehicle
from eadp.models.weather import Wind
from eadp.planning.estimation.estimator import EstimatorSettings
from eadp.planning.registry import NAMES as PLANNERS
from eadp.planning.registry import PlannerSettings

SCHEMA = "eadp.scenario/1"
LONGEST_STEPS = 100_000_000

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
ParameterName = Annotated[str, Field(pattern=r"^c[1-9][0-9]{0,2}$")]
Pair = tuple[Finite, Finite]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class VehicleKeys(_Strict):
    """The simulated aircraft: constants of model `paper`, then of `fixed-wing`; those of the other are ignored."""

    model: Literal["paper", "fixed-wing"] = "fixed-wing"
    mass_kg: Positive | None = Field(default=None, description="1.0 for paper, 1.2 for fixed-wing")
    weight_n: Positive = 9.8
    lift_coefficient: Positive = 9.8 / 15**2
    speed_per_throttle_mps: Positive = 0.3
    nominal_throttle: Positive = 50.0
    altitude_gain: NotNegative = 5.0
    climb_gain: NotNegative = 5.0
    cruise_altitude_m: Finite = 25.0
    idle_power_w: NotNegative = 16.0
    throttle_power_w: NotNegative = 20.0
    wind_in_lift: bool = Field(
        default=False, description="add the wind along the heading to the speed that lifts (unphysical)"
    )
    published_triggers: bool = Field(default=False, description="box triggers, neither armed nor passed")
    wing_area_m2: Positive = 0.32
    aspect_ratio: Positive = 4.5
    oswald_efficiency: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 0.8
    zero_lift_drag: Positive = 0.022
    highest_lift: Positive = Field(default=1.1, description="lift coefficient at which the wing stalls")
    air_density_kgpm3: Positive = 1.225
    propulsive_efficiency: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 0.55
    avionics_w: NotNegative = 2.0
    most_power_w: Positive = Field(default=200.0, description="the motor's limit")
    airspeed_mps: Positive = Field(default=15.0, description="held by the throttle")
    most_bank_deg: Annotated[float, Field(gt=0, le=80, allow_inf_nan=False)] = 45.0
    roll_time_s: Positive = 0.3
    most_climb_mps: Positive = 3.0
    speed_gain_per_s: Positive = 1.0
    altitude_gain_per_s: Positive = 0.5


class WindKeys(_Strict):
    """Wind; the direction is the one it blows towards, 0° east, 90° north."""

    speed_mps: NotNegative = 0.0
    towards_deg: Finite = 0.0
    gust_std_mps: NotNegative = 0.0
    gust_time_s: Positive = 5.0


class BatteryKeys(_Strict):
    """A Rint battery, drained by the actual power, or a replayed trace."""

    voltage_v: Positive = 14.8
    resistance_ohm: NotNegative = 0.05
    capacity_ah: Positive = 3.2
    k_b_per_s: Positive = 1 / 3600
    soc: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 1.0
    crate_per_h: Positive = 10.0
    voltage_empty_v: Positive | None = Field(
        default=None, description="open-circuit voltage without charge; voltage_v is then that at full charge"
    )
    prescribed: list[tuple[NotNegative, Share]] | None = Field(
        default=None, description="[[t_s, soc], …] replayed instead"
    )

    @model_validator(mode="after")
    def _in_order(self) -> BatteryKeys:
        if self.voltage_empty_v is not None and self.voltage_empty_v > self.voltage_v:
            raise ValueError("voltage_empty_v: above voltage_v")
        times = [t for t, _ in self.prescribed or []]
        if self.prescribed is not None and not times:
            raise ValueError("prescribed: an empty trace")
        if any(later < earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError("prescribed: times that go back")
        return self


class FaultKeys(_Strict):
    """A sudden loss of charge."""

    at_s: NotNegative
    soc_drop: Share


class StartKeys(_Strict):
    """Where the flight begins; by default on the first path, before its trigger."""

    position_m: Pair | None = None
    heading_deg: Finite | None = None
    altitude_m: Finite | None = None


class HomeKeys(_Strict):
    """Where to be able to return to, for the point of no return."""

    position_m: Pair | None = None


class SensorKeys(_Strict):
    """What sensors make of the truth: standard deviations of white noise, age, and times without a power reading."""

    power_noise_w: NotNegative = 0.0
    position_noise_m: NotNegative = 0.0
    soc_noise: NotNegative = 0.0
    delay_s: Annotated[float, Field(ge=0, le=60, allow_inf_nan=False)] = 0.0
    drop_out_share: Share = Field(default=0.0, description="share of the time without a power reading")
    drop_out_s: Positive = Field(default=2.0, description="how long a drop-out takes on average")


class GuidanceKeys(_Strict):
    """How the vehicle follows its path; gains k_e are the plan's."""

    k_d: Finite = 1.0
    wind_corrected: bool = True
    normalised: bool = False
    gain_per_m: Positive = 0.05


class EstimatorKeys(_Strict):
    """From power readings to the energy model's state."""

    kind: Literal["exact", "published"] = Field(
        default="exact", description="published: as the papers ran it, with order and every_s alone"
    )
    order: Annotated[int, Field(ge=0, le=20)] = 3
    gate_w: NotNegative = Field(
        default=0.0, description="a reading no farther than this from its forecast corrects nothing; 0: every one does"
    )
    every_s: Positive = 0.1
    noise_w: Positive = Field(default=0.5, description="standard deviation of the readings' white noise")
    disturbance_std_w: NotNegative = Field(
        default=0.5, le=1e6, description="standard deviation of what stays a while beside the laps' pattern"
    )
    disturbance_time_s: Positive = Field(
        default=5.0, ge=0.01, le=1e6, description="how long it stays: its Matérn-3/2 time constant"
    )
    learn_noise: bool = Field(
        default=True, description="learn the three above from the readings, now and then; they are where it starts"
    )


class TradeOffKeys(_Strict):
    """One row R c − r ≥ 0: coefficients by parameter name, and r."""

    coefficients: dict[ParameterName, Finite]
    at_least: Finite


class PlannerKeys(_Strict):
    """The planner and its settings."""

    name: str = "joint"
    every_s: Positive = 1.0
    horizon_s: Positive | Literal["period"] = 6.0
    reserve_probability: Annotated[float, Field(ge=0.5, lt=1, allow_inf_nan=False)] = Field(
        default=0.95, description="joint: how surely the reserve is kept"
    )
    keep_gain: Share = Field(default=0.01, description="joint: the quality U that a change of a parameter has to gain")
    objective: Literal["quality", "total"] = Field(
        default="quality", description="joint: U averaged over the flight, or the computations summed over time"
    )
    weights: dict[ParameterName, NotNegative] = {}
    delta: dict[ParameterName, Positive] = {}
    levels: dict[ParameterName, Annotated[list[NotNegative], Field(min_length=1, max_length=1000)]] = {}
    cost: Literal["control", "power", "quadratic", "output"] = "control"
    cost_weights: tuple[NotNegative, NotNegative] = Field(default=(1.0, 1.0), description="Q and R of cost quadratic")
    solver: Literal["auto", "qp"] = Field(
        default="auto", description="auto: a closed form where it is proven to be the best, else QPs; qp: always QPs"
    )
    constraint_at: Literal["end", "worst"] = "worst"
    remaining_time: Literal["corrected", "published"] = "corrected"
    path_search: Literal["delta", "largest"] = "delta"
    raise_path: bool = True
    path_every_s: Positive | None = None
    start_after_s: NotNegative = 0.0
    min_periods: Annotated[int, Field(ge=0)] = 2
    longest_s: Positive | None = None
    shortest_s: Positive | None = None
    trade_offs: list[TradeOffKeys] = []


class ScenarioKeys(_Strict):
    """A scenario file."""

    schema_: Literal["eadp.scenario/1"] = Field(default="eadp.scenario/1", alias="schema")
    profile: str | None = Field(default=None, description="model or measurements, relative to this file")
    vehicle: VehicleKeys = VehicleKeys()
    wind: WindKeys = WindKeys()
    battery: BatteryKeys = BatteryKeys()
    faults: list[FaultKeys] = []
    start: StartKeys = StartKeys()
    home: HomeKeys = HomeKeys()
    parameters: dict[ParameterName, Finite] = {}
    bounds: dict[ParameterName, Pair] = {}
    parameter_changes: Literal["latched", "live"] = "latched"
    guidance: GuidanceKeys = GuidanceKeys()
    sensors: SensorKeys = SensorKeys()
    reserve_soc: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.05
    estimator: EstimatorKeys = EstimatorKeys()
    planner: PlannerKeys = PlannerKeys()
    step_s: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 0.01
    log_every_s: Positive = 0.1
    time_limit_s: Positive = 7200.0
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scenario file."""
    return ScenarioKeys.model_json_schema(by_alias=True)


@dataclass(frozen=True)
class Scenario:
    """A scenario as the domain sees it. `place` puts a fault at a key, for what only shows later."""

    keys: ScenarioKeys
    document: Document = field(repr=False)

    @property
    def profile_path(self) -> str | None:
        """Path of the profile, relative to the working directory."""
        if self.keys.profile is None:
            return None
        if self.document.name == "<stdin>":
            return self.keys.profile
        return str(Path(self.document.name).parent / self.keys.profile)

    @property
    def vehicle(self) -> Vehicle:
        """The aircraft."""
        keys = self.keys.vehicle
        model = FixedWing if keys.model == "fixed-wing" else PaperVehicle
        own = {field.name for field in fields(model)}
        return model(**keys.model_dump(include=own, exclude_none=True))

    @property
    def wind(self) -> Wind:
        """The wind."""
        return Wind(**self.keys.wind.model_dump())

    @property
    def battery(self) -> Battery:
        """The battery."""
        values = self.keys.battery.model_dump()
        values["prescribed"] = tuple(values["prescribed"] or ())
        return Battery(**values)

    @property
    def faults(self) -> tuple[BatteryFault, ...]:
        """Sudden losses of charge."""
        return tuple(BatteryFault(fault.at_s, fault.soc_drop) for fault in self.keys.faults)

    @property
    def guidance(self) -> Guidance:
        """How the vehicle follows a path."""
        return Guidance(**self.keys.guidance.model_dump())

    @property
    def sensors(self) -> Sensors:
        """What sensors make of the truth."""
        return Sensors(**self.keys.sensors.model_dump())

    @property
    def rules(self) -> Rules:
        """How stages follow one another."""
        return Rules(self.keys.parameter_changes, self.keys.vehicle.published_triggers)

    @property
    def estimator(self) -> EstimatorSettings:
        """The estimator's settings."""
        return EstimatorSettings(**self.keys.estimator.model_dump())

    @property
    def planner(self) -> PlannerSettings:
        """The planner's settings."""
        values = self.keys.planner.model_dump()
        if values["horizon_s"] == "period":
            values["horizon_s"] = None
        values["levels"] = {name: tuple(levels) for name, levels in values["levels"].items()}
        values["trade_offs"] = tuple((row["coefficients"], row["at_least"]) for row in values["trade_offs"])
        return PlannerSettings(**values, reserve_soc=self.keys.reserve_soc)

    @property
    def bounds(self) -> dict[str, Box]:
        """Sets for a plan whose stages carry none."""
        return {name: Box(lo, hi) for name, (lo, hi) in self.keys.bounds.items()}

    @property
    def start_m(self) -> Point | None:
        """Where the flight begins [m], if stated."""
        return self.keys.start.position_m

    @property
    def home_m(self) -> Point | None:
        """Where home is [m], if stated."""
        return self.keys.home.position_m

    @property
    def heading_rad(self) -> float | None:
        """The heading it begins with [rad], if stated."""
        degrees = self.keys.start.heading_deg
        return None if degrees is None else math.radians(degrees)

    def place(self, key: str, message: str, expected: str = "") -> Fault:
        """A fault at a dotted key."""
        return self.document.fault(tuple(key.split(".")), message, expected)


def read_scenario(path: str | None, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """Read a scenario, or the defaults, with some keys set anew.

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
    return scenario_of(Document("scenario", {}) if path is None else scenario_document(read_text(path)), overrides)


def scenario_document(text: Text) -> Document:
    """A scenario's document, its keys not yet checked.

    Raises
    ------
    InputError
        If it is no YAML or no mapping, or does not say that it is a scenario.
    """
    document = read_yaml(text)
    if document.value is None:
        document.value = {}
    if not isinstance(document.value, dict):
        raise InputError(document.fault((), "is no mapping of keys", f"keys such as schema: {SCHEMA}"))
    if "schema" not in document.value:
        raise InputError(document.fault((), "has no key schema", f"schema: {SCHEMA}"))
    return document


def scenario_of(document: Document, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """`read_scenario` of a document, which stays as it is."""
    document = replace(
        document, value=copy.deepcopy(document.value), places=dict(document.places), overrides=dict(document.overrides)
    )
    for key, value in (overrides or {}).items():
        _put(document, key, copy.deepcopy(value))
    _drop_nulls(document.value)
    keys = validated(ScenarioKeys, document, _tuples(document.value), lambda keys: _faults(keys, document))
    return Scenario(keys, document)


def override_key(name: str) -> str | None:
    """The dotted key that a name stands for, as `c1` does for `parameters.c1`; None if it is no such name."""
    if not name or not all(part.isidentifier() for part in name.split(".")):
        return None
    return f"parameters.{name}" if name[0] == "c" and name[1:].isdigit() else name


def read_override(raw: str) -> tuple[str, Any]:
    """`key=value` of `--set`: the dotted key, and the value read as YAML; `c1=…` is short for `parameters.c1=…`.

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


def _put(document: Document, key: str, value: Any) -> None:
    """Set a dotted key; the places of what it replaces are forgotten."""
    parts = key.split(".")
    target = document.value
    for part in parts[:-1]:
        if not isinstance(target.get(part), dict):
            target[part] = {}
        target = target[part]
    target[parts[-1]] = value
    path = tuple(parts)
    for known in [place for place in document.places if place[: len(path)] == path]:
        del document.places[known]
    document.overrides[path] = f"--set {key}"


def _drop_nulls(value: Any) -> None:
    """A null is an absent key."""
    if isinstance(value, dict):
        for key in [key for key, inner in value.items() if inner is None]:
            del value[key]
        for inner in value.values():
            _drop_nulls(inner)
    elif isinstance(value, list):
        for inner in value:
            _drop_nulls(inner)


def _tuples(value: Any) -> Any:
    """Lists as tuples where the schema wants those: pydantic's strict mode takes no list for a tuple."""
    if not isinstance(value, dict):
        return value
    result = dict(value)
    for section, key in (("start", "position_m"), ("home", "position_m"), ("planner", "cost_weights")):
        inner = result.get(section)
        if isinstance(inner, dict) and isinstance(inner.get(key), list):
            result[section] = {**inner, key: tuple(inner[key])}
    battery = result.get("battery")
    if isinstance(battery, dict) and isinstance(battery.get("prescribed"), list):
        points = [tuple(point) if isinstance(point, list) else point for point in battery["prescribed"]]
        result["battery"] = {**battery, "prescribed": points}
    if isinstance(result.get("bounds"), dict):
        result["bounds"] = {k: tuple(v) if isinstance(v, list) else v for k, v in result["bounds"].items()}
    return result


def _faults(keys: ScenarioKeys, document: Document) -> list[Fault]:
    """What the schema alone cannot say."""
    faults = []
    if keys.planner.name not in PLANNERS:
        message = f"unknown planner {printable(keys.planner.name, 60)}"
        faults.append(document.fault(("planner", "name"), message, f"one of {', '.join(PLANNERS)}"))
    for name, (lo, hi) in keys.bounds.items():
        if lo > hi:
            faults.append(document.fault(("bounds", name), f"bounds of {name}: {lo:g} is above {hi:g}", "[low, high]"))
    if keys.time_limit_s / keys.step_s > LONGEST_STEPS:
        message = f"more than {LONGEST_STEPS} steps of {keys.step_s:g} s in {keys.time_limit_s:g} s"
        faults.append(document.fault(("time_limit_s",), message, "a longer step or an earlier limit"))
    return faults

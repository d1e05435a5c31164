"""Everything a flight needs, brought together from its files and checked before it takes off."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

from eadp import __version__
from eadp.core.geometry.curves import Point
from eadp.errors import EadpError, Fault, Infeasible, InputError, PathUndefined, refuse
from eadp.io.mission.reader import PlanReader, is_mission
from eadp.io.profile.model_file import parse_profile
from eadp.io.scenario.scenario_file import Scenario, scenario_document, scenario_of
from eadp.io.text.named import parse_named
from eadp.io.text.source import SourceText
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import Document
from eadp.models.airspace import CLEARANCE_SHARE, EVERYWHERE, HOME_RADII, WayHome
from eadp.models.battery import CURRENT, CUT_OFF
from eadp.models.computing import ComputationRate, Computing, join_profile, load_configuration, may_compute
from eadp.models.doubts import aircraft_doubts, fault_doubts, position_doubts
from eadp.models.energy import EnergyModel
from eadp.models.performance import too_tight
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import MARGIN_M
from eadp.models.plan.stage import COMPUTATION, Stage
from eadp.models.plan.trace import KEPT_ROUTES, default_start, whole_route
from eadp.models.profile import configuration_text
from eadp.models.profile_sum import AnyProfile
from eadp.models.sweep import Run
from eadp.models.vehicle import Airframe, FixedWing
from eadp.models.world import TakeOff, Timing, World
from eadp.planning.base import Mission
from eadp.planning.flight import PlannedFlight, make_flight
from eadp.planning.forecast.held import Preflight
from eadp.planning.registry import planner_class

LIMIT_FORECASTS, LIMIT_S = 3.0, 7200.0
"""Time limit of a flight as a multiple of its forecast time, and where there is no forecast [s]."""

CORNERS_LIMIT = 6
RETURN_HOME, IGNORE = "home", "ignore"
COMMANDED = ComputationRate()
"""A computation that runs as commanded."""

Content = TypeVar("Content")


class Files:
    """Files of flights, by path: each is read and parsed once. Only the texts are pickled.

    `texts` are those that are known already.
    """

    def __init__(self, texts: Mapping[str, Text] | None = None) -> None:
        self.texts = dict(texts or {})
        self._contents: dict[tuple[str, Callable[[Text], Any]], Any] = {}

    def __getstate__(self) -> tuple[str, dict[str, Text]]:
        return __version__, self.texts

    def __setstate__(self, state: tuple[str, dict[str, Text]]) -> None:
        version, self.texts = state
        self._contents = {}
        if version != __version__:  # another version's flights may differ
            raise EadpError(f"this is eadp {__version__}")

    def text(self, path: str) -> Text:
        """A file's text."""
        if path not in self.texts:
            self.texts[path] = read_text(path)
        return self.texts[path]

    def read(self, path: str, parse: Callable[[Text], Content], reference: Fault | None = None) -> tuple[Text, Content]:
        """A file's text and content; `reference` is where another file names it."""
        text = self.text(path)
        if (path, parse) not in self._contents:
            self._contents[path, parse] = parse_named(text, parse, reference)
        content: Content = self._contents[path, parse]
        return text, content

    def document(self, path: str | None, reference: Fault | None = None) -> Document:
        """A scenario's document, or that of the defaults."""
        if path is None:
            return Document(SourceText(Text("scenario", "")), {})
        return self.read(path, scenario_document, reference)[1]

    def scenario(self, path: str | None, overrides: Mapping[str, Any] | None) -> Scenario:
        """A scenario with some keys overridden."""
        return scenario_of(self.document(path), overrides, self.text)

    def load(self, run: Run) -> FlightInputs:
        """The flight of a run, ready to be flown."""
        paths = {f"{kind}_path": path for kind, path in run.files.items()}
        return load_flight(**paths, overrides=run.overrides, files=self)


def profile_of(text: Text) -> tuple[AnyProfile, list[Fault]]:
    """A profile and its warnings: a model, or measurements."""
    return parse_profile(text)


@dataclass(frozen=True)
class FlightInputs:
    """A flight ready to be flown: the world, the planner's mission, and the texts that they were read from."""

    world: World
    mission: Mission
    scenario: Scenario
    warnings: tuple[Fault, ...]
    texts: Mapping[str, Text]

    def flight(self) -> PlannedFlight:
        """A new flight with its planner."""
        return make_flight(self.scenario.planner, self.scenario.estimator, self.mission)

    def preflight(self) -> Preflight | None:
        """The forecast of the flight before take-off, with its wind as the weather forecast."""
        if self.mission.battery.prescribed:
            return None
        wind, settings = self.world.wind, self.scenario.planner
        planner = planner_class(settings.name)
        plan, altitudes_m = self.world.plan, _altitudes_m(self.world.plan, self.world.vehicle)
        wind_mps = wind.steady_at_mps(0.0, statistics.median_high(altitudes_m))
        found = planner.preflight(settings, self.mission, wind_mps, wind.gust_std_mps)
        airspace = plan.site.airspace.in_the_way(min(altitudes_m))
        if found is None or not any(airspace):
            return found
        from eadp.planning.forecast.clearance import entering  # few plans have obstacles

        gusts, world = (wind.gust_std_mps, wind.gust_time_s), self.world
        legs = found.planned(self.mission).legs
        return replace(found, entering=entering(legs, airspace, world.vehicle, world.guidance, wind_mps, gusts))


def load_flight(
    plan_path: str,
    *,
    scenario_path: str | None = None,
    profile_path: str | None = None,
    energy_path: str | None = None,
    overrides: Mapping[str, Any] | None = None,
    files: Files | None = None,
) -> FlightInputs:
    """Read and check a flight's files; those in `files` are not read again.

    Raises
    ------
    InputError
        With every fault found in the first file that has any.
    """
    files = files or Files()
    scenario = files.scenario(scenario_path, overrides)
    plan_text, plan, warnings = _plan(files, plan_path, scenario)
    texts = {"plan": plan_text}
    if scenario_path is not None:
        texts["scenario"] = Text(scenario.document.name, scenario.document.source.body)
    if scenario.vehicle_text is not None:
        texts["vehicle"] = scenario.vehicle_text
    profile, energy = None, None
    reference = None if profile_path else scenario.fault("profile", "")
    profile_path = profile_path or scenario.profile_path
    if profile_path is not None:
        texts["profile"], (profile, found) = files.read(profile_path, profile_of, reference)
        warnings += found
    plan, scenario = _named(plan, plan_text, profile, scenario)
    computing = _computing(plan, plan_text, profile, profile_path, scenario)
    if profile is not None and not may_compute(plan):
        warnings.append(_load_note(profile, profile_path or "", computing, scenario))
    if energy_path is not None:
        from eadp.io.energy.model_file import parse_energy

        texts["energy"], energy = files.read(energy_path, parse_energy)
    parameters = _parameters_at_take_off(plan, scenario)
    _check_paths(plan, plan_text, parameters)
    start = _start(plan, plan_text, scenario, parameters)
    _check_aircraft(plan, plan_text, scenario)
    _check_battery(scenario, computing.power_w(parameters, plan.stages[0].sets))
    world = _world(plan, computing, scenario, parameters, start)
    _check_rates(world, scenario)
    _check_names(plan, scenario)
    warnings += _unused(plan, scenario)
    mission = _mission(world, scenario, energy)
    _check_planner(scenario, mission)
    warnings += _doubts(scenario, world)
    return FlightInputs(world, mission, scenario, tuple(warnings), texts)


def _plan(files: Files, path: str, scenario: Scenario) -> tuple[Text, Plan, list[Fault]]:
    """Text of a plan or a mission, the plan as it is flown, and warnings."""
    keys, vehicle = scenario.keys, scenario.keys.vehicle.airframe
    foreign = is_mission(files.text(path))
    reader = PlanReader.of(vehicle, keys.battery, keys.laps) if foreign else PlanReader()
    text, (plan, findings) = files.read(path, reader)
    if keys.obstacles == IGNORE:
        plan = replace(plan, site=plan.site._replace(airspace=EVERYWHERE))
    warnings = [finding.fault(text.name) for finding in findings]
    radius_m, wind_mps = plan.min_radius_m, keys.wind.speeds_mps[1]
    if not foreign and radius_m and (tight := too_tight(vehicle, vehicle.airspeed_mps, radius_m, wind_mps)):
        expected = "a path of eadp cover with --wind, or less wind"
        warnings.append(Fault(text.name, 1, 1, tight, expected, severity="warning"))
    made = plan.site.made_for
    if made is not None and f"{made.airspeed_mps:g}" != f"{vehicle.airspeed_mps:g}":
        message = f"the plan was made for {made.aircraft}, and is flown at {vehicle.airspeed_mps:g} m/s"
        expected = "its aircraft, as --scenario or --set vehicle=FILE"
        warnings.append(Fault(text.name, 1, 1, message, expected, severity="note"))
    if not isinstance(vehicle, FixedWing) and _commands(plan):
        message = f"altitudes and airspeeds of stages are not flown: the airframe {vehicle.model} holds its own"
        warnings.append(Fault(text.name, plan.stages[0].line, 1, message, severity="note"))
        level = [replace(stage, altitude_m=None, airspeed_mps=None) for stage in plan.stages]
        plan = replace(plan, stages=tuple(level))
    return text, plan, warnings


def _named(plan: Plan, text: Text, profile: AnyProfile | None, scenario: Scenario) -> tuple[Plan, Scenario]:
    """The plan as it is flown, its computations named as in the profile where they have no names, and its scenario."""
    columns = () if profile is None else tuple(zip(profile.names, profile.units, strict=True))
    if not plan.computations and len(plan.parameters) == plan.path_count + len(columns):
        plan = replace(plan, computations=columns)
    scenario = scenario.with_names(plan.parameters, tuple(map(plan.hull, range(len(plan.stages[0].sets)))))
    return _with_sets(plan, text, scenario).laps(), scenario


def _world(
    plan: Plan, computing: Computing, scenario: Scenario, parameters: Vector, start: tuple[Point, float]
) -> World:
    keys, (start_m, heading_rad) = scenario.keys, start
    vehicle, rates = keys.vehicle.airframe, keys.computations
    limit_s = keys.time_limit_s or _time_limit_s(plan, parameters, start_m, scenario, vehicle.airspeed_mps)
    return World(
        plan=plan,
        computing=computing,
        vehicle=vehicle,
        guidance=keys.guidance,
        wind=keys.wind,
        battery=keys.battery,
        faults=keys.faults,
        start=TakeOff(start_m, heading_rad, _altitude_m(plan, scenario, vehicle)),
        parameters=parameters,
        rules=scenario.rules,
        clock=Timing(keys.step_s, keys.log_every_s, limit_s),
        seed=keys.seed,
        sensors=keys.sensors,
        rates={name: rates[name] for name in plan.names if rates.get(name, COMMANDED) != COMMANDED},
        way_home=_way_home(plan, scenario, start_m),
    )


def _altitudes_m(plan: Plan, vehicle: Airframe) -> list[float]:
    """Altitudes of a plan's stages, the aircraft's own where the plan commands none [m]."""
    return [vehicle.cruise_altitude_m if stage.altitude_m is None else stage.altitude_m for stage in plan.stages]


def _way_home(plan: Plan, scenario: Scenario, start_m: Point) -> WayHome | None:
    """Home and the way to it, round what is in the way; None without a home."""
    home_m = scenario.position_m("home", plan.site.origin_deg) or plan.site.home_m
    airspace = plan.site.airspace.in_the_way(min(_altitudes_m(plan, scenario.keys.vehicle.airframe)))
    for key, point in (("start", start_m), ("home", home_m)):
        if point is not None and not airspace.admits(point):
            message = f"the {key} ({point[0]:g}, {point[1]:g}) lies in an obstacle or beyond the boundary"
            raise InputError(scenario.fault(key, message, "another place, or obstacles: ignore"))
    if home_m is None:
        return None
    turn_radius_m, turns_back = scenario.keys.vehicle.airframe.turn_radius_m, scenario.keys.on_infeasible == RETURN_HOME
    ways = None
    if any(airspace):
        from eadp.core.geometry.ways import WaysTo

        radius_m = HOME_RADII * turn_radius_m
        clear, near = airspace.free_space(CLEARANCE_SHARE * radius_m), airspace.free_space(0.0)
        ways = WaysTo(home_m, clear, near, radius_m)
    return WayHome(home_m, turn_radius_m, turns_back, ways)


def _mission(world: World, scenario: Scenario, energy: EnergyModel | None) -> Mission:
    """What the planner knows of a world before take-off."""
    vehicle = world.vehicle
    return Mission(
        plan=world.plan,
        computing=world.computing,
        battery=world.battery,
        cruise_mps=vehicle.airspeed_mps,
        parameters=world.parameters,
        start_m=world.start.position_m,
        energy=energy,
        motion_w=vehicle.cruise_power_w,
        way_home=world.way_home,
        rules=world.rules,
        max_motion_w=vehicle.max_motion_w,
        gust_time_s=world.wind.gust_time_s,
        airframe=vehicle if isinstance(vehicle, FixedWing) else None,
        altitude_m=world.start.altitude_m,
    )


def _doubts(scenario: Scenario, world: World) -> list[Fault]:
    """Warnings about settings that may mean something else."""
    keys, plan = scenario.keys, world.plan
    first_m, origin_deg = plan.stages[0].trigger_at(world.parameters), plan.site.origin_deg
    found = [
        *aircraft_doubts(keys.vehicle.airframe, keys.battery, keys.wind),
        *position_doubts("start", keys.start.position_m, first_m, origin_deg),
        *position_doubts("home", keys.home.position_m, first_m, origin_deg),
        *fault_doubts(keys.faults, world.clock.time_limit_s),
    ]
    return [replace(scenario.fault(*doubt), severity="warning") for doubt in found]


def _check_aircraft(plan: Plan, text: Text, scenario: Scenario) -> None:
    """The aircraft can fly, and faster than the wind."""
    vehicle, wind_mps = scenario.keys.vehicle.airframe, scenario.keys.wind.speeds_mps[1]
    refuse([scenario.fault("vehicle.airframe", fault, "an aeroplane that can fly so") for fault in vehicle.faults()])
    if wind_mps >= vehicle.airspeed_mps:
        message = f"a wind of {wind_mps:g} m/s, at an airspeed of {vehicle.airspeed_mps:g} m/s"
        key = "wind.profile" if scenario.keys.wind.profile else "wind.speed_mps"
        raise InputError(scenario.fault(key, message, "a wind below the airspeed"))
    if isinstance(vehicle, FixedWing):
        _check_airspeeds(plan, text, vehicle, wind_mps)


def _check_battery(scenario: Scenario, computing_w: float) -> None:
    """The battery can deliver the power of level flight and of the computations [W]."""
    battery, power_w = scenario.keys.battery, scenario.keys.vehicle.airframe.cruise_power_w + computing_w
    if power_w > battery.max_power_w(battery.voltage_v):
        key = {CURRENT: "max_c_rate", CUT_OFF: "cutoff_voltage_v"}.get(
            battery.limit_at(battery.voltage_v), "resistance_ohm"
        )
        message = f"level flight: {battery.undeliverable(power_w, 1.0)}"
        raise InputError(scenario.fault(f"battery.{key}", message, "a battery that can"))


def _time_limit_s(plan: Plan, parameters: Vector, start: Point, scenario: Scenario, airspeed_mps: float) -> float:
    """Time limit of a flight without one [s]: a multiple of the forecast at the parameters of take-off."""
    try:
        route = whole_route(plan, parameters, scenario.rules, start, MARGIN_M)
    except PathUndefined:
        return LIMIT_S
    forecast_s = float(route.times_s(airspeed_mps, scenario.keys.wind.steady_mps)[0].sum())
    return LIMIT_FORECASTS * forecast_s if math.isfinite(forecast_s) else LIMIT_S


def _commands(plan: Plan) -> bool:
    """Whether stages command altitudes or airspeeds."""
    return any(stage.altitude_m is not None or stage.airspeed_mps is not None for stage in plan.stages)


def _altitude_m(plan: Plan, scenario: Scenario, vehicle: Airframe) -> float:
    """Altitude at the start [m]: as given, else the first stage's; a mission, which starts at home, on the ground."""
    if scenario.keys.start.altitude_m is not None:
        return scenario.keys.start.altitude_m
    commanded_m = [stage.altitude_m for stage in plan.stages if stage.altitude_m is not None]
    from_home = plan.site.start_m == (0.0, 0.0)  # the origin of a mission
    if commanded_m and from_home and scenario.position_m("start", plan.site.origin_deg) is None:
        return 0.0
    first_m = plan.stages[0].altitude_m
    return vehicle.cruise_altitude_m if first_m is None else first_m


def _check_airspeeds(plan: Plan, text: Text, vehicle: FixedWing, wind_mps: float) -> None:
    """The aircraft can fly at the airspeeds of the stages, and faster than the wind."""
    checked = {stage.airspeed_mps: stage for stage in reversed(plan.stages) if stage.airspeed_mps is not None}
    faults = []
    for airspeed_mps, stage in checked.items():
        found = replace(vehicle, airspeed_mps=airspeed_mps).faults()
        if wind_mps >= airspeed_mps:
            found.append(f"a wind of {wind_mps:g} m/s, at an airspeed of {airspeed_mps:g} m/s")
        faults += [
            Fault(text.name, stage.line, 1, f"stage {stage.index}: {what}", "an airspeed at which the aircraft can fly")
            for what in found
        ]
    refuse(faults)


def _with_sets(plan: Plan, text: Text, scenario: Scenario) -> Plan:
    """The plan's own sets, else the scenario's bounds."""
    if plan.has_sets:
        if scenario.bounds:
            raise InputError(scenario.fault("bounds", "bounds for a plan whose stages carry sets", "one or the other"))
        return plan
    if scenario.bounds:
        try:
            return plan.with_bounds(scenario.bounds)
        except EadpError as error:
            raise InputError(scenario.fault("bounds", str(error), "bounds for every parameter")) from None
    if plan.path_count or plan.computations:
        what = "the stages carry no sets and the scenario no bounds"
        raise InputError.at(text.name, plan.stages[0].line, 1, what, "sets like [-1000, 0] after each trigger")
    return plan


def _computing(plan: Plan, text: Text, profile: AnyProfile | None, path: str | None, scenario: Scenario) -> Computing:
    """The computations of a plan, or the constant load of those that it does not decide."""
    load_at = scenario.keys.profile_at
    if load_at and (profile is None or may_compute(plan)):
        what = "no profile" if profile is None else "a plan that has parameters for its computations"
        raise InputError(
            scenario.fault("profile_at", f"a constant load beside {what}", "a profile, and a plan without")
        )
    if profile is not None and load_at:
        try:
            load_configuration(profile, load_at)
        except EadpError as error:
            raise InputError(
                scenario.fault("profile_at", str(error), f"measured values of {', '.join(profile.names)}")
            ) from None
    try:
        return join_profile(plan, profile, load_at)
    except EadpError as error:
        if path is None:
            raise InputError.at(
                text.name, plan.stages[0].line, 1, str(error), "--profile, or profile: in the scenario"
            ) from None
        raise InputError.at(path, 1, 1, str(error), "a profile of the plan's computations") from None


def _load_note(profile: AnyProfile, path: str, computing: Computing, scenario: Scenario) -> Fault:
    """What a profile beside a plan without computations counts as."""
    load_at = scenario.keys.profile_at
    at = configuration_text(profile.names, load_configuration(profile, load_at), ",")
    why = "as stated" if set(load_at) == set(profile.names) else "the highest; --at states another"
    message = f"the plan has no parameter for it: a constant load of {computing.load_w:.2f} W at {at} ({why})"
    return Fault(path, 1, 1, message, severity="note")


def _parameters_at_take_off(plan: Plan, scenario: Scenario) -> Vector:
    """Parameters at take-off: as stated, else each at its maximum."""
    faults = []
    values = []
    given = dict(scenario.keys.parameters)
    for i, name in enumerate(plan.names):
        box = plan.hull(i)
        value = given.pop(name, box.hi)
        if box.clip(value) != value:
            message = f"{name} = {value:.10g} is outside its set"
            faults.append(scenario.fault(f"parameters.{name}", message, f"a value in [{box.lo:.10g}, {box.hi:.10g}]"))
        values.append(value)
    for name in given:
        faults.append(scenario.unknown_parameter(f"parameters.{name}", name, plan))
    if faults:
        raise InputError(*faults)
    return tuple(values)


def _check_rates(world: World, scenario: Scenario) -> None:
    """The actual rates are of computations of the plan, and within what was measured."""
    computations = [parameter.name for parameter in world.plan.parameters if parameter.kind == COMPUTATION]
    expected = f"one of {', '.join(computations) or 'none'}"
    faults = [
        scenario.fault(f"computations.{name}", f"the plan has no computation {name}", expected)
        for name in scenario.keys.computations
        if name not in computations
    ]
    refuse(faults)
    for stage in world.plan.stages if world.rates else ():
        for corner in zip(*((box.lo, box.hi) for box in stage.sets), strict=True):
            try:
                world.computing_w(corner, stage)
            except Infeasible as error:
                what = f"stage {stage.index}: the actual rates leave what was measured: {error}"
                raise InputError(scenario.fault("computations", what, "rates that the profile has measured")) from None


def _check_names(plan: Plan, scenario: Scenario) -> None:
    """Parameters that the planner's settings name are the plan's."""
    settings = scenario.planner
    own = settings.own
    named = {f"planner.{key}.{name}": name for key in ("weights", "levels") for name in getattr(settings, key)}
    named |= {
        f"planner.{settings.name}.{key}.{name}": name for key in ("delta", "gains") for name in getattr(own, key, ())
    }
    for i, row in enumerate(getattr(own, "trade_offs", ())):
        named |= {f"planner.{settings.name}.trade_offs.{i}.coefficients.{name}": name for name in row.coefficients}
    faults = [scenario.unknown_parameter(key, name, plan) for key, name in named.items() if name not in plan.names]
    if faults and plan.names:  # a plan without parameters may share a scenario with others
        raise InputError(*faults)


def _unused(plan: Plan, scenario: Scenario) -> list[Fault]:
    """A note on settings of parameters beside a plan that has none, if any."""
    unused = [key for key in ("weights", "levels") if not plan.names and getattr(scenario.planner, key)]
    if not unused:
        return []
    keys = ", ".join(f"planner.{name}" for name in unused)
    return [
        replace(
            scenario.fault(f"planner.{unused[0]}", f"not used: {keys}: the plan has no parameters"), severity="note"
        )
    ]


def _check_planner(scenario: Scenario, mission: Mission) -> None:
    """The planner's own settings fit the mission, and it can turn back where that is asked for."""
    name, turns_back = scenario.planner.name, scenario.keys.on_infeasible == RETURN_HOME
    if turns_back and mission.way_home is None:
        raise InputError(scenario.fault("on_infeasible", "home, which has no location", "home: {position_m: [x, y]}"))
    if turns_back and not planner_class(name).optimises_to_end:
        raise InputError(
            scenario.fault("on_infeasible", f"home, with planner {name}", "planner joint, which forecasts")
        )
    if found := planner_class(name).faults(scenario.planner, scenario.estimator, mission):
        raise InputError(*(scenario.fault(f"planner.{name}.{key}", what, hint) for key, what, hint in found))


@lru_cache(KEPT_ROUTES)
def _check_paths(plan: Plan, text: Text, parameters: Vector) -> None:
    """Every stage has a path and a trigger, at take-off and at every corner of the path parameters' sets."""
    rho = plan.path_count
    corners: list[Sequence[float]] = [parameters]
    if plan.has_sets and rho <= CORNERS_LIMIT:
        ends = [(box.lo, box.hi) for box in (plan.hull(i) for i in range(rho))]
        corners += [(*corner, *parameters[rho:]) for corner in itertools.product(*ends)]
    faults = []
    for stage in plan.stages:
        for corner in corners:
            try:
                _check_stage(stage, corner)
            except PathUndefined as error:
                at = ", ".join(f"{name} = {value:g}" for name, value in zip(plan.names, corner[:rho], strict=False))
                message = f"{error}" + (f", at {at}" if at else "")
                faults.append(Fault(text.name, stage.line, 1, message, "a path that can be flown"))
                break
    if faults:
        raise InputError(*faults)


def _check_stage(stage: Stage, parameters: Sequence[float]) -> None:
    path, trigger = stage.path_at(parameters), stage.trigger_at(parameters)
    try:
        stage.track(path, trigger).nearest(trigger)
    except PathUndefined as error:
        raise PathUndefined(f"the path of stage {stage.index} {error}") from None


def _start(plan: Plan, text: Text, scenario: Scenario, parameters: Vector) -> tuple[Point, float]:
    """Position and heading at the start of the flight."""
    stage = plan.stages[0]
    start, heading = scenario.position_m("start", plan.site.origin_deg), scenario.keys.start.heading_rad
    try:
        usual, usual_heading = default_start(plan, parameters)
    except PathUndefined as error:
        raise InputError.at(text.name, stage.line, 1, f"stage 1: {error}", "a path that can be joined") from None
    if start is None:
        return usual, usual_heading if heading is None else heading
    try:
        jet = stage.path_at(parameters)(*start)
        if not all(math.isfinite(value) for value in jet):
            raise ValueError
    except (ArithmeticError, ValueError):
        message = f"the path of stage 1 has no value at the start ({start[0]:g}, {start[1]:g})"
        key = "position_m" if scenario.keys.start.lat_deg is None else "lat_deg"
        raise InputError(scenario.fault(f"start.{key}", message, "a start from which it can be joined")) from None
    if heading is None:
        phi, gx, gy = jet[:3]
        dx = -stage.sense * gy - stage.gain * phi * gx
        dy = stage.sense * gx - stage.gain * phi * gy
        heading = math.atan2(dy, dx) if dx or dy else usual_heading
    return start, heading

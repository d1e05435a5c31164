"""Everything a flight needs, brought together from its files and checked before it takes off."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from os import PathLike
from typing import Any, TypeVar

import numpy as np

from eadp.api.given import File
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import FARTHEST_M
from eadp.errors import EadpError, Fault, InputError, PathUndefined, refuse
from eadp.io.energy import energy_yaml, parse_energy
from eadp.io.plan.sources import PlanReader, is_mission
from eadp.io.plan.writer import plan_text
from eadp.io.profile.model_file import parse_profile, profile_yaml
from eadp.io.scenario import SCHEMA, Scenario, by_parameter, plain, scenario_document, scenario_of, value_text
from eadp.io.text.streams import Text, read_text
from eadp.io.text.yaml import Document
from eadp.models.airspace import CLEARANCE_M, CLEARANCE_SHARE, EVERYWHERE, HOME_RADII, Landing, WayHome
from eadp.models.battery import CURRENT, CUT_OFF, DELIVERABLE
from eadp.models.computing import Computing, join_profile, load_configuration, may_compute
from eadp.models.energy import EnergyModel
from eadp.models.performance import too_tight
from eadp.models.plan.cursor import Vector
from eadp.models.plan.plan import Finding, Plan
from eadp.models.plan.route import MARGIN_M
from eadp.models.plan.stage import LAND, TAKEOFF, Leg, Stage, leg_points
from eadp.models.plan.trace import KEPT_ROUTES, default_start, nominal_legs, whole_route
from eadp.models.profile import Profile, configuration_text
from eadp.models.vehicle import Airframe
from eadp.models.world import Mission, TakeOff, Timing, World
from eadp.planning.base import PlannerSettings
from eadp.planning.forecast.clearance import entering
from eadp.planning.forecast.held import Preflight
from eadp.planning.registry import PlannedFlight, make_flight, planner_class
from eadp.simulation.nominal import Overshoot, overshoot_findings, overshoots

HELD = "fixed"
"""Setting `airspeed` of a planner that does not decide it."""

LIMIT_FORECASTS, LIMIT_S = 3.0, 7200.0
"""Time limit of a flight as a multiple of its forecast time, and where there is no forecast [s]."""

CORNERS_LIMIT = 6
RETURN_HOME, IGNORE = "home", "ignore"

Content = TypeVar("Content")


class Files:
    """Files of flights, by path: each is read and parsed once. Only the texts, without their lines, are pickled.

    `texts` are those that are known already.
    """

    def __init__(self, texts: Mapping[str, Text] | None = None) -> None:
        self.texts = dict(texts or {})
        self._contents: dict[tuple[str, Callable[[Text], Any]], Any] = {}

    def __reduce__(self) -> tuple[type[Files], tuple[dict[str, Text]]]:
        return Files, ({path: replace(text) for path, text in self.texts.items()},)

    def text(self, path: str, read: Callable[[str], Text] = read_text) -> Text:
        """A file's text."""
        if path not in self.texts:
            self.texts[path] = read(path)
        return self.texts[path]

    def read(self, path: str, parse: Callable[[Text], Content]) -> tuple[Text, Content]:
        """A file's text and content."""
        text = self.text(path)
        if (path, parse) not in self._contents:
            self._contents[path, parse] = parse(text)
        content: Content = self._contents[path, parse]
        return text, content

    def document(self, given: File | Mapping[str, Any] | None) -> Document:
        """A scenario's document: of its file, of its keys, or of the defaults."""
        if given is None:
            return Document(Text("scenario", ""), {})
        if isinstance(given, Mapping):
            return Document(Text("given-keys.yaml", ""), {"schema": SCHEMA, **plain(given)})
        return self.read(str(given), scenario_document)[1]

    def scenario(self, given: File | Mapping[str, Any] | None, overrides: Mapping[str, Any] | None = None) -> Scenario:
        """A scenario with some keys overridden."""
        return scenario_of(self.document(given), overrides, self.text)

    def profile(self, given: File | Profile) -> tuple[Text, Profile, list[Fault]]:
        """A profile, a model or of measurements, where it comes from, and warnings."""
        if not isinstance(given, str | PathLike):
            return Text("given-profile.yaml", profile_yaml(given)), given, []
        text, (profile, found) = self.read(str(given), parse_profile)
        return text, profile, found


@dataclass(frozen=True)
class FlightInputs:
    """A flight ready to be flown: the world with the planner's mission, and what it was read from, by kind."""

    world: World
    scenario: Scenario
    warnings: tuple[Fault, ...]
    sources: Mapping[str, Text]
    never_past: str = ""
    """The item or stage with a turn that the aircraft never gets past; the plan has no forecast then."""

    @property
    def mission(self) -> Mission:
        """What the planner knows before take-off."""
        return self.world.mission

    def with_mission(self, **changes: Any) -> FlightInputs:
        """The same with changes of the mission."""
        return replace(self, world=replace(self.world, mission=replace(self.mission, **changes)))

    def at_one_airspeed(self) -> FlightInputs:
        """The same with an airspeed that is not decided, for what commands none: an autopilot's mission, a link."""
        vehicle = self.mission.vehicle
        if vehicle.airspeed_range_mps is None:
            return self
        return self.with_mission(vehicle=replace(vehicle, airspeed_range_mps=None))

    def at_min_energy(self) -> Preflight | None:
        """The forecast at the airspeeds that take the least energy; None where the airspeed is no decision."""
        settings = self.scenario.planner
        if self.mission.vehicle.airspeed_range_mps is None or self.mission.battery.prescribed:
            return None
        return self._before_take_off(replace(settings, own=replace(settings.own, airspeed="least-energy")))

    def flight(self) -> PlannedFlight:
        """A new flight with its planner."""
        return make_flight(self.scenario.planner, self.mission, logged=True)

    def preflight(self, *, whole: bool = True) -> Preflight | None:
        """The forecast of the flight before take-off, with its wind as the weather forecast.

        Without `whole` it has no probabilities of obstacles, which take most of its time.
        """
        if self.mission.battery.prescribed:
            return None
        found, world = self._before_take_off(self.scenario.planner), self.world
        if found is not None and set(found.airspeeds_mps) - {self.mission.cruise_mps}:
            found = replace(found, at_cruise=self.at_one_airspeed().preflight(whole=False))
        if found is None or not whole or not any(self.mission.plan.site.airspace):
            return found
        legs = found.planned(self.mission).legs
        return replace(found, entering=entering(self.mission, legs, world.guidance, world.wind))

    def _before_take_off(self, settings: PlannerSettings) -> Preflight | None:
        """The planner's forecast before take-off."""
        planner = planner_class(settings.name)
        return planner.preflight(settings, self.mission, self.world.wind.steady_mps, self.world.wind.gust_std_mps)


def load_flight(
    plan: File | Plan,
    *,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | Profile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Mapping[str, Any] | None = None,
    files: Files | None = None,
) -> FlightInputs:
    """Read and check what a flight is of, paths or objects; those in `files` are not read again.

    Raises
    ------
    InputError
        With every fault found in the first file that has any.
    """
    files = files or Files()
    setting = files.scenario(scenario, overrides)
    plan_source, flown, warnings = _plan(files, plan, setting)
    sources: dict[str, Text] = {"plan": plan_source}
    if isinstance(scenario, Mapping):
        sources["scenario"] = Text("given-keys.yaml", value_text(setting.document.value))
    elif scenario is not None:
        sources["scenario"] = files.text(str(scenario))
    if setting.vehicle_text is not None:
        sources["vehicle"] = setting.vehicle_text
    computations, model = None, None
    given_profile = setting.profile_path if profile is None else profile
    if given_profile is not None:
        sources["profile"], computations, found = files.profile(given_profile)
        warnings += found
    flown, setting = _named(flown, plan_source, computations, setting)
    place = "" if computations is None else sources["profile"].name
    computing = _computing(flown, plan_source, computations, place)
    if computations is not None and not may_compute(flown):
        at = configuration_text(computations.names, load_configuration(computations), ",")
        load = f"a constant load of {computing.load_w:.2f} W at {at}, its highest"
        warnings.append(Fault(place, 1, 1, f"the plan has no parameter for it: {load}", severity="note"))
    if isinstance(energy, EnergyModel):
        sources["energy"], model = Text("given-energy.yaml", energy_yaml(energy)), energy
    elif energy is not None:
        sources["energy"], model = files.read(str(energy), parse_energy)
    parameters = _parameters_at_take_off(flown, setting)
    _check_paths(flown, plan_source, parameters)
    start = _start(flown, plan_source, setting, parameters)
    _check_aircraft(flown, plan_source, setting)
    _check_battery(setting, computing.power_w(parameters, flown.stages[0].sets))
    forecast_s, overshot = _nominal_s(flown, parameters, setting, start.position_m)
    mission = Mission(
        plan=flown,
        computing=computing,
        battery=setting.keys.battery,
        vehicle=setting.keys.vehicle.airframe,
        parameters=parameters,
        start_m=start.position_m,
        energy=model,
        way_home=_way_home(flown, setting, parameters, start.position_m),
        rules=setting.rules,
        gust_time_s=setting.keys.wind.gust_time_s,
        altitude_m=start.altitude_m,
        excess={one.stage.index: one.excess for one in overshot},
        autopilot=setting.keys.autopilot,
    )
    _check_names(flown, setting)
    warnings += [finding.fault(plan_source.name) for finding in overshoot_findings(overshot)]
    _check_planner(setting, mission)
    world = _world(mission, setting, start, forecast_s)
    stated_m, home_m = setting.keys.home.altitude_m, world.way_home and world.way_home.altitude_m
    if stated_m is not None and home_m is not None and home_m > stated_m:
        message = f"{stated_m:g} m is not clear of all that is below ways home: {home_m:g} m is taken"
        warnings.append(replace(setting.fault("home.altitude_m", message, "a higher one"), severity="warning"))
    never_past = next((one.stage.label for one in overshot if math.isinf(one.excess.seconds)), "")
    inputs = FlightInputs(world, setting, tuple(warnings), sources, never_past)
    decides = getattr(setting.planner.own, "airspeed", HELD) != HELD
    return inputs if decides else inputs.at_one_airspeed()


def _plan(files: Files, given: File | Plan, scenario: Scenario) -> tuple[Text, Plan, list[Fault]]:
    """Where a plan or a mission comes from, the plan as it is flown, and warnings."""
    keys, vehicle = scenario.keys, scenario.keys.vehicle.airframe
    findings: list[Finding] = []
    foreign = not isinstance(given, Plan) and is_mission(files.text(str(given)))
    if isinstance(given, Plan):
        text, plan = Text("given.plan", plan_text(given)), given
    else:
        reader = PlanReader.of(vehicle, keys.battery) if foreign else PlanReader()
        text, (plan, findings) = files.read(str(given), reader)
    if keys.obstacles == IGNORE:
        plan = replace(plan, site=plan.site._replace(airspace=EVERYWHERE))
    warnings = [finding.fault(text.name) for finding in findings]
    radius_m, wind_mps = plan.min_radius_m, keys.wind.speeds_mps[1]
    if not foreign and radius_m and (tight := too_tight(vehicle, vehicle.airspeed_mps, radius_m, wind_mps)):
        expected = "a path of eadp cover with --wind, or of eadp plan with --min-radius, or less wind"
        warnings.append(Fault(text.name, 1, 1, tight, expected, severity="warning"))
    made = plan.site.made_for
    if made is not None and f"{made.airspeed_mps:g}" != f"{vehicle.airspeed_mps:g}":
        message = f"the plan was made for {made.aircraft}, and is flown at {vehicle.airspeed_mps:g} m/s"
        expected = "its aircraft, as --scenario or --set vehicle=FILE"
        warnings.append(Fault(text.name, 1, 1, message, expected, severity="note"))
    commanded = any(stage.altitude_m is not None or stage.airspeed_mps is not None for stage in plan.stages)
    if commanded and not vehicle.takes_commands:
        message = f"altitudes and airspeeds of stages are not flown: the airframe {vehicle.model} holds its own"
        warnings.append(Fault(text.name, plan.stages[0].line, 1, message, severity="note"))
        level = [replace(stage, altitude_m=None, airspeed_mps=None) for stage in plan.stages]
        plan = replace(plan, stages=tuple(level))
    return text, plan, warnings


def _named(plan: Plan, text: Text, profile: Profile | None, scenario: Scenario) -> tuple[Plan, Scenario]:
    """The plan as it is flown, its computations named as in the profile where they have no names, and its scenario."""
    columns = () if profile is None else tuple(zip(profile.names, profile.units, strict=True))
    if not plan.computations and len(plan.parameters) == plan.path_count + len(columns):
        plan = replace(plan, computations=columns)
        if clash := set(plan.names[plan.path_count :]).intersection(plan.names[: plan.path_count]):
            message = f"the profile's {min(clash)} has the name of a path parameter"
            raise InputError.at(text.name, plan.stages[0].line, 1, message, "another one, as by eadp profile --names")
    scenario = scenario.with_names(plan.parameters, tuple(map(plan.hull, range(len(plan.stages[0].sets)))))
    return _with_sets(plan, text, scenario).laps(), scenario


def _world(mission: Mission, scenario: Scenario, start: TakeOff, forecast_s: float) -> World:
    keys = scenario.keys
    limit_s = keys.time_limit_s or (LIMIT_FORECASTS * forecast_s if math.isfinite(forecast_s) else LIMIT_S)
    clock = Timing(keys.step_s, keys.log_every_s, limit_s)
    return World(mission, keys.guidance, keys.wind, keys.faults, start, clock, keys.seed, keys.sensors)


def _altitudes_m(stages: Sequence[Stage], vehicle: Airframe) -> list[float]:
    """Altitudes of stages but a landing, the aircraft's own where they command none [m]."""
    level = [stage for stage in stages if not stage.command(LAND)] or stages
    return [vehicle.cruise_altitude_m if stage.altitude_m is None else stage.altitude_m for stage in level]


def _way_home(plan: Plan, scenario: Scenario, parameters: Vector, start_m: Point) -> WayHome | None:
    """Home and the way to it, round what is in the way, with the plan's landing; None without a home."""
    vehicle, home_m = scenario.keys.vehicle.airframe, scenario.position_m("home", plan.site.origin_deg)
    home_m = home_m or plan.site.home_m
    airspace = plan.site.airspace.in_the_way(min(_altitudes_m(plan.stages, vehicle)))
    first_m = plan.stages[0].trigger_at(parameters)
    for key, point in (("start", start_m), ("home", home_m)):
        if point is not None and (far_m := math.dist(point, first_m)) > FARTHEST_M:
            message = f"the {key} is {far_m / 1000:.0f} km from the plan's first trigger"
            raise InputError(
                scenario.fault(key, message, f"a place of the plan, at most {FARTHEST_M / 1000:g} km away")
            )
        if point is not None and not airspace.admits(point):
            message = f"the {key} ({point[0]:g}, {point[1]:g}) lies in an obstacle or beyond the boundary"
            raise InputError(scenario.fault(key, message, "another place, or obstacles: ignore"))
    if home_m is None:
        return None
    legs: Sequence[Leg] = ()
    with contextlib.suppress(PathUndefined):  # a plan that is never flown has no landing either
        legs = nominal_legs(plan, parameters, start_m)
    # as given, but clear of ground and obstacles; that of the stage where nothing says more
    altitudes_m = scenario.keys.home.altitude_m, plan.site.home_altitude_m, clear_home_m(plan, legs, home_m, vehicle)
    altitude_m = max((each for each in altitudes_m if each is not None), default=None)
    turns_back, landing = scenario.keys.on_infeasible == RETURN_HOME, Landing.of(legs, vehicle.cruise_altitude_m)
    way_home = WayHome(home_m, vehicle.turn_radius_m, turns_back, None, altitude_m, landing)
    if not any(airspace):
        return way_home
    from eadp.core.geometry.polygons import WaysTo

    radius_m = HOME_RADII * vehicle.turn_radius_m
    clear, near = airspace.free_space(CLEARANCE_SHARE * radius_m), airspace.free_space(0.0)
    return way_home._replace(ways=WaysTo(way_home.end_m, clear, near, radius_m))


def clear_home_m(plan: Plan, legs: Sequence[Leg], home_m: Point, vehicle: Airframe) -> int | None:
    """Altitude at which straight ways home from legs are clear of obstacles [m]; None where the plan's own are.

    A take-off has none of its own.
    """
    site, stages = plan.site, [stage for stage in plan.stages if not stage.command(TAKEOFF)] or plan.stages
    if not legs or all(each.height_m is None for each in site.airspace.obstacles):
        return None
    points_m = np.concatenate([leg_points(leg, CLEARANCE_M)[:, :2] for leg in legs])
    clear_m = site.airspace.top_on_ways_m(points_m, home_m, CLEARANCE_M) + site.clearance_m
    return math.ceil(clear_m) if clear_m > min(_altitudes_m(stages, vehicle)) else None


def _check_aircraft(plan: Plan, text: Text, scenario: Scenario) -> None:
    """The aircraft can fly, at the airspeeds of the stages, too, and faster than the wind."""
    vehicle, wind_mps = scenario.keys.vehicle.airframe, scenario.keys.wind.speeds_mps[1]
    refuse([scenario.fault("vehicle.airframe", fault, "an aeroplane that can fly so") for fault in vehicle.faults()])
    if wind_mps >= vehicle.airspeed_mps:
        message = f"a wind of {wind_mps:g} m/s, at an airspeed of {vehicle.airspeed_mps:g} m/s"
        raise InputError(scenario.fault("wind", message, "a wind below the airspeed"))
    if not vehicle.takes_commands:
        return
    checked = {stage.airspeed_mps: stage for stage in reversed(plan.stages) if stage.airspeed_mps is not None}
    faults = []
    for airspeed_mps, stage in checked.items():
        found = replace(vehicle, airspeed_mps=airspeed_mps).faults()
        if wind_mps >= airspeed_mps:
            found.append(f"a wind of {wind_mps:g} m/s, at an airspeed of {airspeed_mps:g} m/s")
        expected = "an airspeed at which the aircraft can fly"
        faults += [Fault(text.name, stage.line, 1, f"stage {stage.index}: {what}", expected) for what in found]
    refuse(faults)


def _check_battery(scenario: Scenario, computing_w: float) -> None:
    """The battery can deliver the power of level flight and of the computations [W]."""
    battery, power_w = scenario.keys.battery, scenario.keys.vehicle.airframe.cruise_power_w + computing_w
    if power_w > battery.max_power_w(battery.voltage_v):
        keys = {CURRENT: "max_c_rate", CUT_OFF: "cutoff_voltage_v", DELIVERABLE: "resistance_ohm"}
        message = f"level flight: {battery.undeliverable(power_w, 1.0)}"
        key = f"battery.{keys[battery.limit_at(battery.voltage_v)]}"
        raise InputError(scenario.fault(key, message, "a battery that can"))


def _nominal_s(plan: Plan, parameters: Vector, scenario: Scenario, start: Point) -> tuple[float, list[Overshoot]]:
    """Time of a flight at the parameters of take-off [s], infinite where there is none; what is flown off its path."""
    try:
        route = whole_route(plan, parameters, scenario.rules, start, MARGIN_M)
    except PathUndefined:
        return math.inf, []
    wind_mps, vehicle, found = scenario.keys.wind.steady_mps, scenario.keys.vehicle.airframe, dict[int, Overshoot]()
    if vehicle.takes_commands:
        found = overshoots(route, vehicle, scenario.keys.guidance, wind_mps)
    excess_s = sum(found[i].excess.seconds for i in route.stages.tolist() if i in found)
    return float(route.times_s(vehicle.airspeed_mps, wind_mps)[0].sum()) + excess_s, [*found.values()]


def _altitude_m(plan: Plan, scenario: Scenario) -> float:
    """Altitude at the start [m]: as given, else the ground for a take-off or a mission, else the first stage's."""
    vehicle = scenario.keys.vehicle.airframe
    if scenario.keys.start.altitude_m is not None:
        return scenario.keys.start.altitude_m
    commanded = any(stage.altitude_m is not None for stage in plan.stages)
    # a plan takes off by command, a mission from the origin
    from_ground = plan.stages[0].command(TAKEOFF) or (commanded and plan.site.start_m == (0.0, 0.0))
    here = scenario.position_m("start", plan.site.origin_deg) is None
    if from_ground and here and vehicle.takes_commands:
        return 0.0
    first_m = plan.stages[0].altitude_m
    return vehicle.cruise_altitude_m if first_m is None else first_m


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


def _computing(plan: Plan, text: Text, profile: Profile | None, place: str) -> Computing:
    """The computations of a plan, or the constant load of those that it does not decide."""
    try:
        return join_profile(plan, profile)
    except EadpError as error:
        if place:
            raise InputError.at(place, 1, 1, str(error), "a profile of the plan's computations") from None
        expected = "--profile, or profile: in the scenario"
        raise InputError.at(text.name, plan.stages[0].line, 1, str(error), expected) from None


def _parameters_at_take_off(plan: Plan, scenario: Scenario) -> Vector:
    """Parameters at take-off: as stated, else each at its maximum."""
    faults, values, given = [], [], dict(scenario.keys.parameters)
    for i, name in enumerate(plan.names):
        box = plan.hull(i)
        value = given.pop(name, box.hi)
        if box.clip(value) != value:
            message = f"{name} = {value:.10g} is outside its set"
            faults.append(scenario.fault(f"parameters.{name}", message, f"a value in [{box.lo:.10g}, {box.hi:.10g}]"))
        values.append(value)
    faults += [scenario.unknown_parameter(f"parameters.{name}", name, plan) for name in given]
    refuse(faults)
    return tuple(values)


def _check_names(plan: Plan, scenario: Scenario) -> None:
    """Parameters that the planner's settings name are the plan's."""
    faults = [
        scenario.unknown_parameter(".".join(map(str, (*path, name))), name, plan)
        for path, values in by_parameter(scenario.document.value)
        if path[0] == "planner" and path[1] in ("weights", "levels", scenario.planner.name)
        for name in values
        if name not in plan.names
    ]
    refuse(faults if plan.names else [])  # a plan without parameters may share a scenario with others


def _check_planner(scenario: Scenario, mission: Mission) -> None:
    """The planner's own settings fit the mission, and it can turn back where that is asked for."""
    name, turns_back = scenario.planner.name, scenario.keys.on_infeasible == RETURN_HOME
    if turns_back and mission.way_home is None:
        raise InputError(scenario.fault("on_infeasible", "home, which has no location", "home: {position_m: [x, y]}"))
    planner = planner_class(name)
    if turns_back and not planner.optimises_to_end:
        message = f"home, with planner {name}"
        raise InputError(scenario.fault("on_infeasible", message, "planner joint, which forecasts"))
    found = planner.faults(scenario.planner, mission)
    refuse([scenario.fault(f"planner.{name}.{key}", what, hint) for key, what, hint in found])


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
    refuse(faults)


def _check_stage(stage: Stage, parameters: Sequence[float]) -> None:
    path, trigger = stage.path_at(parameters), stage.trigger_at(parameters)
    try:
        stage.track(path, trigger).nearest(trigger)
    except PathUndefined as error:
        raise PathUndefined(f"the path of stage {stage.index} {error}") from None


def _start(plan: Plan, text: Text, scenario: Scenario, parameters: Vector) -> TakeOff:
    """Position, heading and altitude at the start of the flight."""
    stage = plan.stages[0]
    start, heading = scenario.position_m("start", plan.site.origin_deg), scenario.keys.start.heading_rad
    try:
        usual, usual_heading = default_start(plan, parameters)
    except PathUndefined as error:
        raise InputError.at(text.name, stage.line, 1, f"stage 1: {error}", "a path that can be joined") from None
    altitude_m = _altitude_m(plan, scenario)
    if start is None:
        return TakeOff(usual, usual_heading if heading is None else heading, altitude_m)
    try:
        jet = stage.path_at(parameters)(*start)
        if not all(math.isfinite(value) for value in jet):
            raise ValueError
    except (ArithmeticError, ValueError):
        message = f"the path of stage 1 has no value at the start ({start[0]:g}, {start[1]:g})"
        raise InputError(scenario.fault("start", message, "a start from which it can be joined")) from None
    if heading is None:
        phi, gx, gy = jet[:3]
        dx = -stage.sense * gy - stage.gain * phi * gx
        dy = stage.sense * gx - stage.gain * phi * gy
        heading = math.atan2(dy, dx) if dx or dy else usual_heading
    return TakeOff(start, heading, altitude_m)

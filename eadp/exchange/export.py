"""A plan as the mission of an autopilot: at which parameters, which of its legs, and where on the earth."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, NamedTuple

from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import FlightInputs, load_flight
from eadp.core.geometry.geodesy import FARTHEST_M, place_text, to_geodetic_deg, to_near_local_m
from eadp.errors import Fault, Infeasible, InputError, PathUndefined, one_of, printable
from eadp.exchange.autopilot import (
    ENDS_REQUIRED,
    PARAMETER_FILES,
    check_landing,
    lacking_ends,
    stated_parameters,
    wanted_parameters,
)
from eadp.exchange.items import ARDUPILOT_ITEMS, LAND_START, MissionItem
from eadp.exchange.path import FENCE_ENDING, ITEMS_ENDING, WITH_ITEMS, PlannedPath, planned_sections
from eadp.exchange.writer import EXPORTS, files_beside, items_text, mapped_items, mission_items, writer_of
from eadp.io.flight import airspeeds_text
from eadp.io.plan.sources import PlanReader
from eadp.io.plan.writer import parameters_of
from eadp.io.scenario import override_texts, read_overrides, read_scenario
from eadp.io.text.options import Flag, check_range
from eadp.io.text.streams import read_text, write_text
from eadp.models.airspace import Airspace, risk_text
from eadp.models.autopilot import ARDUPILOT, LANDS, PX4, Autopilot
from eadp.models.performance import calibrated_over_true
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import PlannedLegs
from eadp.models.plan.stage import TRIGGER_DISTANCE, Leg, leg_points
from eadp.models.plan.trace import nominal_route, zone_findings
from eadp.models.vehicle import Airframe, FixedWing
from eadp.planning.forecast.held import Preflight
from eadp.plug_ins import plug_in

FENCE_STEP_M = 2.0
"""Distance between points of the path that is checked for fences [m]."""

Position = str | tuple[float, float]
"""Latitude and longitude [°], as a pair or as text."""


RISK = 0.05
"""Probability to enter an obstacle, or to leave the boundary, above which a mission is not written."""


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export. Faults name them as the command `eadp export` does."""

    overrides: Annotated[Sequence[str], Flag("--set", metavar="NAME=VALUE")] = ()
    """A parameter, as in spacing=20; with --scenario any of its keys."""

    scenario: Annotated[str | None, Flag(metavar="FILE")] = None
    """Scenario (YAML): parameters are those that the forecast before take-off chooses."""

    start: Annotated[str | None, Flag("--from", metavar="STAGE,LAP")] = None
    """Write the rest, from this stage of this lap on."""

    telemetry: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write what is left where this telemetry ends, as then decided; with --scenario."""

    parameters: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write the autopilot's parameters that the forecast holds for: .param of ArduPilot, .params of PX4."""

    altitude_m: float | None = None
    """Altitude above home [m], where the plan has none; by default the aircraft's."""

    home_deg: Annotated[Position | None, Flag(metavar="POINT")] = None
    """Where to take off and return to: LAT,LON [°]; by default the plan's home, if it has one."""

    origin_deg: Annotated[Position | None, Flag(metavar="POINT")] = None
    """Where the plan's (0, 0) lies: LAT,LON [°], for a plan without."""

    trigger_distance_m: float | None = None
    """Take a picture every so many metres [m]."""

    tolerance_m: float = 1.0
    """Largest distance of the exported path from the plan's [m]."""

    force: bool = False
    """Write a mission that is forecast to enter an obstacle or to leave its boundary."""

    def check(self, to: str, out: File | None = None) -> None:
        """Refuse values out of range, and options that do not go together, for a format and a file to write."""
        if self.telemetry is not None and (self.scenario is None or self.start is not None):
            raise _fault("--telemetry", self.telemetry, "needs a planner", "--scenario, and no --from")
        if self.parameters is not None:
            self._check_parameters(self.parameters, to)
            if out is not None and os.path.realpath(self.parameters) == os.path.realpath(out):
                raise _fault("--parameters", self.parameters, "is the file of -o", "another file")
        for option, value in (("--trigger-distance", self.trigger_distance_m), ("--tolerance", self.tolerance_m)):
            if value is not None:
                check_range(option, value, 0.01, 10_000, closed=True)
        if self.altitude_m is not None:
            check_range("--altitude", self.altitude_m, -10_000, 10_000, closed=True)

    def _check_parameters(self, file: str, to: str) -> None:
        """Refuse a file of parameters that is not of the format's autopilot, or that no aircraft is known for."""
        endings = [".params" if to == PX4 else ".param"] if to in WITH_ITEMS else list(PARAMETER_FILES)
        if Path(file).suffix not in endings:
            message = f"is no file of parameters for --to {to}"
            raise _fault("--parameters", file, message, f"a name in {' or '.join(endings)}")
        if self.scenario is None:
            raise _fault("--parameters", file, "needs an aircraft and a battery", "--scenario")


def _items_beside(path: PlannedPath, chosen: _Chosen, to: str, autopilot: Autopilot, warn: Warn) -> dict[str, str]:
    """What is written beside a mission of items, by the ending of its name: a map to stages, and ArduPilot's fence.

    What its autopilot asks of it is said. Raises Infeasible where PX4 does not arm it.
    """
    items = mission_items(path, px4=to == PX4)
    asks = _asks_of_px4 if to == PX4 else _asks_of_ardupilot
    warn([replace(fault, file=chosen.name) for fault in asks(items, autopilot)])
    rho = chosen.plan.path_count
    beside = {ITEMS_ENDING: items_text(mapped_items(items, chosen.planned, rho), chosen.plan.names[:rho])}
    return beside | (files_beside(path) if to == ARDUPILOT else {})


def _asks_of_px4(items: Sequence[MissionItem], autopilot: Autopilot) -> Iterator[Fault]:
    """What PX4 asks of a mission; raises Infeasible where it does not arm it."""
    check_landing(items, autopilot)
    if end := lacking_ends(items, autopilot):
        message = (
            f"PX4 does not arm a mission without {end} while {ENDS_REQUIRED} is {autopilot.value(ENDS_REQUIRED):g}"
        )
        way = "eadp cover --landing LAT,LON,HEADING" if end == "a landing" else "--home LAT,LON"
        yield Fault("", 1, 1, message, f"{way}, or {ENDS_REQUIRED} 0 in the autopilot", severity="warning")


def _asks_of_ardupilot(items: Sequence[MissionItem], autopilot: Autopilot) -> Iterator[Fault]:
    """What ArduPilot asks of a mission."""
    if any(item.command == LAND_START for item in items) and autopilot.given("RTL_AUTOLAND", 0.0) not in LANDS:
        note = "ArduPlane does not arm it while RTL_AUTOLAND is 0, as delivered; with 2 a return flies its landing"
        yield Fault("", 1, 1, note, severity="note")
    count = len(items) + 1  # home
    if count > ARDUPILOT_ITEMS:
        message = f"{count} items, where an ArduPilot holds some {ARDUPILOT_ITEMS}, by its board"
        expected = "fewer lines, eadp cover --sorties, or BRD_SD_MISSION in the autopilot"
        yield Fault("", 1, 1, message, expected, severity="warning")


class _Chosen(NamedTuple):
    """What is exported: a plan, its name in messages, the legs at parameters, the aircraft, and its parameter file."""

    plan: Plan
    name: str
    planned: PlannedLegs
    airframe: Airframe
    parameters: str = ""


def _plan(given: File | Plan, warn: Warn) -> tuple[Plan, str]:
    """A plan that is given, and its name in messages."""
    if isinstance(given, Plan):
        return given, given.name
    text = read_text(str(given))
    plan, findings = PlanReader()(text)
    warn([finding.fault(text.name) for finding in findings])
    return plan, text.name


def _stated(given: File | Plan, options: ExportOptions, warn: Warn) -> _Chosen:
    """A plan at the parameters that are stated."""
    plan, name = _plan(given, warn)
    made = plan.site.made_for
    airframe = FixedWing() if made is None else FixedWing(airspeed_mps=made.airspeed_mps)
    planned = _planned(plan, name, parameters_of(plan, options.overrides))
    low_m = airframe.cruise_altitude_m if options.altitude_m is None else options.altitude_m
    found = [finding.fault(name) for finding in zone_findings(planned.legs, plan.site.airspace, low_m)]
    warn([replace(each, expected="--scenario, for a forecast, or another path") for each in found])
    return _Chosen(plan, name, planned, airframe)


def _forecast(
    given: File | Plan, autopilot: Autopilot, options: ExportOptions, warn: Warn, *, decides: bool
) -> _Chosen:
    """A plan at the parameters that its forecast in a scenario chooses, or the rest of it by telemetry."""
    overrides = read_overrides(override_texts(options.overrides))
    if autopilot.kind == PX4:  # by whose own rules it flies, stated or not
        overrides = {**overrides, "autopilot.kind": PX4}
    inputs = load_flight(given, scenario=options.scenario, overrides=overrides)
    inputs = inputs if decides else inputs.at_one_airspeed()
    warn(inputs.warnings)
    plan, airframe = inputs.mission.plan, inputs.mission.vehicle
    name = inputs.sources["plan"].name
    if options.altitude_m is None and not airframe.takes_commands:
        stated, _ = _plan(given, lambda _: None)
        if any(stage.altitude_m is not None for stage in stated.stages):
            message = f"the plan commands altitudes, and the airframe {airframe.model} holds its own"
            raise _fault("--scenario", str(options.scenario), message, "another airframe, or --altitude")
    parameters = "" if options.parameters is None else _parameters(inputs, plan, options.parameters, name, warn)
    if options.telemetry is not None:
        return _Chosen(plan, name, _after(inputs, options.telemetry, name, warn), airframe, parameters)
    forecast = inputs.preflight()
    if forecast is None:
        message, expected = "the forecast before take-off finds no parameters", "a battery that is drained"
        raise _fault("--scenario", str(options.scenario), message, f"{expected}, or --set without --scenario")
    planned = forecast.planned(inputs.mission)
    warn([Fault(name, 1, 1, _forecast_text(forecast, plan, planned.legs), severity="note")])
    if not options.force and any(share > RISK for share in forecast.entering.values()):
        risks = "; ".join(risk_text(name, share) for name, share in forecast.entering.items() if share > RISK)
        advice = "another path or altitude; --force writes it as it is"
        raise Infeasible(f"the flight {risks}: not written", advice)
    return _Chosen(plan, name, planned, airframe, parameters)


def _path(chosen: _Chosen, to: str, options: ExportOptions, warn: Warn) -> PlannedPath:
    """What is written, with notes on what the format cannot hold."""
    plan, name, planned, airframe, _ = chosen
    known = options.scenario is not None  # the aircraft
    place, home_deg = _places(plan, name, options)
    altitude_m = _altitude_m(chosen, options, warn)
    if any(plan.site.airspace) and to not in WITH_ITEMS:
        message = f"obstacles and boundary are not in the format {to}"
        warn([Fault(name, 1, 1, message, severity="note")])
    if plan.site.ground_m is not None and options.home_deg is not None:
        message = f"altitudes are above {plan.site.ground_m:g} m above the sea, the ground at the plan's home or start"
        warn([Fault("--home", 1, 1, message, "a home as high", severity="warning")])
    sections = planned_sections(planned.legs)
    ends_m = [point for section in sections for point in (section.start_m, section.end_m)]
    far_m = max((math.hypot(*end_m) for end_m in ends_m), default=0.0)
    if far_m > FARTHEST_M:
        where = (name, "") if options.origin_deg is None else ("--origin", str(options.origin_deg))
        message = f"the path reaches {far_m / 1000:.0f} km from the origin, {place_text(place)}"
        raise _fault(*where, message, f"metres from the origin, at most {FARTHEST_M / 1000:g} km")
    return PlannedPath(
        name=(plan.site.field.name if plan.site.field else "") or printable(name.rpartition("/")[2]),
        sections=sections,
        origin_deg=place,
        altitude_m=altitude_m,
        airspeed_mps=airframe.airspeed_mps,
        home_deg=home_deg,
        trigger_distance_m=options.trigger_distance_m,
        tolerance_m=options.tolerance_m,
        airspace=_fenced(plan.site.airspace, planned.legs),
        stated_mps=airframe.airspeed_mps if known or plan.site.made_for is not None else None,
        climb_deg=_climb_deg(airframe) if known else 0.0,
        zero_m=plan.site.ground_m,
        calibrated=calibrated_over_true(plan.site, airframe),
        height_m=plan.site.above_sea_m or 0.0,
    )


def _altitude_m(chosen: _Chosen, options: ExportOptions, warn: Warn) -> float:
    """The altitude of stages without their own [m]: the one stated, else the aircraft's, which is said."""
    of_stages, known = [stage.altitude_m for stage in chosen.plan.stages], options.scenario is not None
    if options.altitude_m is not None:
        if None not in of_stages:
            expected = "no --altitude, or a plan made for this altitude"
            raise _fault("--altitude", f"{options.altitude_m:g}", "the plan has altitudes of its own", expected)
        return options.altitude_m
    altitude_m = chosen.airframe.cruise_altitude_m
    if None in of_stages:
        whose = "the aircraft's" if known else "that of the default aircraft, as there is no --scenario"
        message = f"altitude {altitude_m:g} m, {whose}; --altitude sets another"
        warn([Fault(chosen.name, 1, 1, message, severity="note" if known else "warning")])
    return altitude_m


def autopilot_of(to: str, options: ExportOptions) -> Autopilot:
    """The autopilot of a format, with the scenario's parameters. Raises InputError where that has another one."""
    stated = Autopilot()
    if options.scenario is not None:
        stated = read_scenario(options.scenario, read_overrides(override_texts(options.overrides))).keys.autopilot
    if to in WITH_ITEMS and stated.kind is not None and (to == PX4) != (stated.kind == PX4):
        expected = f"--to {PX4 if stated.kind == PX4 else 'ardupilot or qgc'}, or --set autopilot.kind"
        raise _fault("--to", to, f"the scenario's autopilot is {stated.kind}", expected)
    return replace(stated, kind=PX4) if to == PX4 else stated


def _climb_deg(airframe: Airframe) -> float:
    """Angle of the steepest climb at the airspeed in whole degrees, as ArduPilot holds it; 0 where none is modelled."""
    climb_mps, _ = airframe.climb_rates_mps(airframe.airspeed_mps)
    return float(round(math.degrees(math.asin(min(1.0, climb_mps / airframe.airspeed_mps)))))


def _fenced(airspace: Airspace, legs: Sequence[Leg]) -> Airspace:
    """Obstacles and boundary as fences, which have no height: without the obstacles that are flown over."""
    low = [each for each in airspace.obstacles if each.height_m is not None]
    track = [(x, y) for leg in legs for x, y, _ in leg_points(leg, FENCE_STEP_M).tolist()] if low else []
    over = [each for each in low if Airspace((each,)).entries([0.0] * len(track), track, [-math.inf] * len(track))]
    return airspace._replace(obstacles=tuple(each for each in airspace.obstacles if each not in over))


def _parameters(inputs: FlightInputs, plan: Plan, path: str, name: str, warn: Warn) -> str:
    """The file of the autopilot's parameters, which are said, too."""
    ardupilot, text = PARAMETER_FILES[Path(path).suffix]
    mission = inputs.mission
    home_m = mission.way_home and mission.way_home.altitude_m
    found = wanted_parameters(
        plan, inputs.mission.vehicle, mission.battery, ardupilot=ardupilot, home_altitude_m=home_m
    )
    found += stated_parameters(mission.autopilot, found, ardupilot=ardupilot)
    said = ", ".join(f"{each.name} {each.value:.6g}" for each in found)
    calibrated = calibrated_over_true(plan.site, mission.vehicle)
    said += f"; airspeeds calibrated, {calibrated:.4f} of the true ones" if round(calibrated, 4) != 1 else ""
    warn([Fault(name, 1, 1, f"the forecast holds for {said}", severity="note")])
    return text(found)


def _planned(plan: Plan, name: str, parameters: Sequence[float]) -> PlannedLegs:
    try:
        return nominal_route(plan, parameters).planned()
    except PathUndefined as error:
        raise InputError.at(name, plan.stages[0].line, 1, str(error), "a path that can be flown") from None


def _places(plan: Plan, name: str, options: ExportOptions) -> tuple[tuple[float, float], tuple[float, float] | None]:
    """Where the plan lies, and home: latitude and longitude [°]; no home where it starts there, as a mission does."""
    given = {"--home": options.home_deg, "--origin": options.origin_deg}
    points = {option: _position_deg(option, raw) for option, raw in given.items() if raw is not None}
    if plan.site.origin_deg is not None and "--origin" in points:
        raise _fault("--origin", str(options.origin_deg), "the plan has an origin", "no --origin")
    place = plan.site.origin_deg or points.get("--origin")
    if place is None:
        raise InputError.at(name, 1, 1, "the plan has no place on the earth", "--origin LAT,LON")
    if "--home" in points:
        if to_near_local_m(*points["--home"], place) is None:
            expected = f"LAT,LON in that order, within {FARTHEST_M / 1000:g} km"
            raise _fault("--home", str(options.home_deg), "is far from the plan's origin", expected)
        return place, points["--home"]
    if plan.site.home_m is None or plan.site.home_m == plan.site.start_m:
        return place, None
    return place, to_geodetic_deg(*plan.site.home_m, place)


def _forecast_text(forecast: Preflight, plan: Plan, legs: Sequence[Leg]) -> str:
    """The forecast that is exported, for people."""
    paths = plan.parameters[: plan.path_count]
    chosen = [f"{item.label} = {item.text(forecast.parameters[item.name])}" for item in paths]
    end, length_m = forecast.forecast, sum(leg.distance_m for leg in legs)
    reserve = f"; keeps the reserve with {100 * (end.reserve_probability or 0.0):.1f} %"
    energy = "" if end.energy_wh is None else f", {end.energy_wh:.2f} Wh"
    energy += f"; the autopilot {forecast.autopilot_text}" if forecast.autopilot_text else ""
    if forecast.airspeeds_mps:
        chosen.append(f"airspeed {airspeeds_text(forecast.airspeeds_mps)}")
    at = f"at {', '.join(chosen)}: " if chosen else ""
    risks = "".join(f"; {risk_text(name, share)}" for name, share in forecast.entering.items())
    return f"forecast {at}{length_m / 1000:.2f} km, {end.remaining_s:.0f} s{energy}{reserve}{risks}"


def _after(inputs: FlightInputs, telemetry: str, name: str, warn: Warn) -> PlannedLegs:
    """The legs that are left after telemetry; what was decided is said."""
    planned: PlannedLegs | None
    planned, decision = plug_in("rests", "telemetry")(inputs, telemetry, lambda fault: warn([fault]))
    if planned is None or decision is None:
        raise _fault("--telemetry", telemetry, "leaves nothing to fly", "telemetry of a flight that goes on")
    parameters = inputs.mission.plan.parameters
    values = ", ".join(f"{item.label} = {item.text(decision['parameters'][item.name])}" for item in parameters)
    length_m, end = sum(leg.distance_m for leg in planned.legs), decision["soc_end_forecast"]
    message = f"after {decision['time_s']:g} s, in stage {decision['stage']} of lap {decision['lap']}, at {values}: "
    message += f"{length_m / 1000:.2f} km left, {math.nan if end is None else 100 * end:.1f} % of the charge at the end"
    warn([Fault(name, 1, 1, message, severity="note")])
    return planned


def _with_pictures(plan: Plan, planned: PlannedLegs) -> PlannedLegs:
    """The legs that are left of a flight; the first one starts the pictures that an earlier stage has started."""
    first = planned.legs[0]
    before = plan.stages[: first.stage.index - 1]
    before = (*plan.stages, *before) if first.lap else before
    taken = [each for stage in before for each in stage.commands if each[0] == TRIGGER_DISTANCE]
    if planned.started == 1 or not taken or not taken[-1][1] or first.stage.command(TRIGGER_DISTANCE):
        return planned
    stage = replace(first.stage, commands=(taken[-1], *first.stage.commands))
    return planned._replace(legs=(first._replace(stage=stage), *planned.legs[1:]))


def _rest(planned: PlannedLegs, raw: str) -> PlannedLegs:
    """The legs from a stage of a lap on."""
    try:
        stage, lap = map(int, raw.split(","))
    except ValueError:
        raise _fault("--from", raw, "no stage and lap", "two whole numbers, as in 3,2") from None
    for i, leg in enumerate(planned.legs):
        if (leg.stage.index, leg.lap) == (stage, lap):
            return planned.after(i)
    last = max((leg.lap for leg in planned.legs if leg.stage.index == stage), default=None)
    known = "one of the plan" if last is None else f"a lap from 0 to {last}"
    raise _fault("--from", raw, f"stage {stage} is not flown in lap {lap}", known)


def _position_deg(option: str, given: Position) -> tuple[float, float]:
    """Latitude and longitude of an option [°]."""
    raw = given if isinstance(given, str) else f"{given[0]},{given[1]}"
    try:
        latitude, longitude = (float(part) for part in raw.split(","))
    except ValueError:
        latitude = longitude = math.nan
    if not (abs(latitude) <= 85 and abs(longitude) <= 180):
        raise _fault(option, raw, "no position", "a latitude within ±85° and a longitude, as in 55.37,10.43")
    return latitude, longitude


def _fault(option: str, raw: str, message: str, expected: str) -> InputError:
    return InputError.at(option, 1, 1, message, expected, raw)


def export(
    plan: File | Plan,
    to: str,
    options: ExportOptions | None = None,
    out: File | None = None,
    *,
    warn: Warn = python_warnings,
) -> str:
    """Write a plan as the mission of an autopilot, or as a map.

    Parameters
    ----------
    plan : path or Plan
    to : str
        Format: `qgc`, `ardupilot`, `paparazzi`, `geojson`, `kml` or `gpx`.
    options : ExportOptions, optional
        With a scenario the parameters are those that the forecast chooses.
    out : path, optional
        Write it here, too; beside the mission of an autopilot a file `.items.json`, which `eadp replan` reads.
    warn : function, optional
        Takes what was forecast, as a note, and what the format cannot hold.

    Returns
    -------
    str
        The text of the mission.

    Raises
    ------
    InputError
        With the faults of the files, or of an option under its name on the command line.
    Infeasible
        If PX4 would not arm the mission; or if the flight is forecast to enter an obstacle or to leave its boundary,
        with a probability above `RISK`.
    """
    options = options or ExportOptions()
    options.check(to, out)
    writer = writer_of(to)
    if writer is None:
        raise _fault("--to", to, "is no format", one_of(EXPORTS, to))
    autopilot = autopilot_of(to, options)
    decides = to in WITH_ITEMS and options.telemetry is None  # whether airspeeds that are decided can be commanded
    stated = options.scenario is None
    chosen = _stated(plan, options, warn) if stated else _forecast(plan, autopilot, options, warn, decides=decides)
    if options.start is not None:
        chosen = chosen._replace(planned=_rest(chosen.planned, options.start))
    chosen = chosen._replace(planned=_with_pictures(chosen.plan, chosen.planned))
    path = _path(chosen, to, options, warn)
    beside = _items_beside(path, chosen, to, autopilot, warn) if to in WITH_ITEMS else {}
    text, written = writer(path), out is not None and str(out) != "-"
    if options.parameters is not None:
        write_text(options.parameters, chosen.parameters)
    for ending, body in {"": text, **beside}.items() if written else ():
        write_text(f"{out}{ending}", body)
    if FENCE_ENDING in beside:
        where = f"{out}{FENCE_ENDING}" if written else "a file beside that of -o FILE"
        message = f"obstacles and boundary are ArduPilot's fence, {where}: send it besides"
        warn([Fault(str(plan) if isinstance(plan, str | os.PathLike) else "plan", 1, 1, message, severity="note")])
    return text

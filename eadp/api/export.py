"""A plan as the mission of an autopilot: at which parameters, which of its legs, and where on the earth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np

from eadp.api.fences import fenced_by
from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import FlightInputs, load_flight
from eadp.api.plan import plan_of
from eadp.core.arrays import FloatArray
from eadp.core.geometry.geodesy import FARTHEST_M, to_geodetic_deg, to_near_local_m
from eadp.errors import Fault, InputError, PathUndefined, one_of, printable
from eadp.io.mission import FENCE_ENDING, ITEMS_ENDING, WITH_ITEMS
from eadp.io.mission.autopilot import PARAMETER_FILES, wanted_parameters
from eadp.io.mission.export import ABOVE_GROUND, EXPORTS, FENCED, fence_file, mission_items, writer_of
from eadp.io.mission.items import items_text, mapped_items
from eadp.io.mission.path import PlannedPath, Section, planned_sections
from eadp.io.plan.parameters import parameters_of
from eadp.io.scenario.scenario_file import override_texts, read_overrides
from eadp.io.terrain.reader import read_terrain
from eadp.io.text.options import Flag
from eadp.io.text.streams import write_text
from eadp.models.airspace import Airspace, risk_text
from eadp.models.plan.legs import Leg, leg_points
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import PlannedLegs
from eadp.models.plan.trace import nominal_route
from eadp.models.vehicle import Airframe, FixedWing, PaperVehicle
from eadp.planning.forecast.held import Preflight

FENCE_STEP_M = 2.0
"""Distance between points of the path that is checked for fences [m]."""

Position = str | tuple[float, float]
"""Latitude and longitude [°], as a pair or as text."""


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export. Faults name them as the command `eadp export` does."""

    overrides: Annotated[Sequence[str], Flag("--set", metavar="NAME=VALUE")] = ()
    """A parameter, as in spacing=20; with --scenario any of its keys."""

    scenario: Annotated[str | None, Flag(metavar="FILE")] = None
    """Scenario (YAML): parameters are those that the forecast before take-off chooses."""

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

    min_radius_m: float | None = None
    """Turning radius of a mission's turns [m]."""

    laps: Annotated[int | None, Flag(metavar="N", low=1, high=10_000)] = None
    """How many times a mission that repeats for ever is flown."""

    avoid: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that the path stays out of: a fence, GeoJSON, KML or CSV."""

    inside: Annotated[str | None, Flag(metavar="FILE")] = None
    """Polygons that the path stays inside of, as --avoid."""

    altitudes: Literal["relative", "terrain"] = "relative"
    """Above home, or above the ground below, as qgc and ardupilot can."""

    terrain: Annotated[Sequence[str], Flag(metavar="FILE")] = ()
    """Heights of the ground, as of eadp cover: for --altitudes terrain of a plan that follows it."""

    start: Annotated[str | None, Flag("--from", metavar="STAGE,LAP")] = None
    """Write the rest, from this stage of this lap on."""

    telemetry: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write what is left where this telemetry ends, as then decided; with --scenario."""

    parameters: Annotated[str | None, Flag(metavar="FILE")] = None
    """Write the autopilot's parameters that the forecast holds for: .param of ArduPilot, .params of PX4."""

    def check(self) -> None:
        """Refuse values out of range, and options that do not go together; raises InputError."""
        if self.telemetry is not None and (self.scenario is None or self.start is not None):
            raise _fault("--telemetry", self.telemetry, "needs a planner", "--scenario, and no --from")
        if self.parameters is not None:
            if Path(self.parameters).suffix not in PARAMETER_FILES:
                raise _fault("--parameters", self.parameters, "is no file of parameters", "a name in .param or .params")
            if self.scenario is None:
                raise _fault("--parameters", self.parameters, "needs an aircraft and a battery", "--scenario")
        for option, value in (
            ("--trigger-distance", self.trigger_distance_m),
            ("--tolerance", self.tolerance_m),
            ("--min-radius", self.min_radius_m),
        ):
            if value is not None and not 0.01 <= value <= 10_000:
                raise _fault(option, f"{value:g}", f"{value:g} m is out of range", "from 0.01 to 10000")
        if self.altitude_m is not None and not abs(self.altitude_m) <= 10_000:
            message = f"{self.altitude_m:g} m is out of range"
            raise _fault("--altitude", f"{self.altitude_m:g}", message, "from -10000 to 10000")


class Exported(NamedTuple):
    """A plan in another format.

    Attributes
    ----------
    text : str
    items : str
        The file of the map of its items to stages; empty where it has no items.
    parameters : str
        The file of an autopilot's parameters; empty where none is asked for.
    fence : str
        The file of its fence, of ArduPilot; empty without obstacles and boundary.
    """

    text: str
    items: str = ""
    parameters: str = ""
    fence: str = ""

    def write(self, path: str) -> None:
        """Write the file, and the map and the fence beside it. Raises InputError."""
        write_text(path, self.text)
        if self.fence:
            write_text(path + FENCE_ENDING, self.fence)
        if self.items:
            write_text(path + ITEMS_ENDING, self.items)


def exported(plan: File | Plan, to: str, options: ExportOptions, warn: Warn) -> Exported:
    """A plan in the format of an autopilot or a map.

    Parameters
    ----------
    plan : path or Plan
        A path may be that of a mission.
    to : str
        Name of the format, of `EXPORT_NAMES`.
    options : ExportOptions
    warn : function
        Takes what was forecast, and what the format cannot hold.

    Returns
    -------
    Exported

    Raises
    ------
    InputError
        With the faults of the files, or of an option.
    """
    options.check()
    writer = writer_of(to)
    if writer is None:
        raise _fault("--to", to, "is no format", one_of(EXPORTS, to))
    parameters = ""
    if options.scenario is None:
        flown, name = plan_of(plan, options.min_radius_m, options.laps, warn)
        flown, notes = fenced_by(flown, options.avoid, options.inside)
        warn(notes)
        made = flown.site.made_for
        airframe: Airframe = FixedWing() if made is None else FixedWing(airspeed_mps=made.airspeed_mps)
        forecast, planned = None, _planned(flown, name, parameters_of(flown, options.overrides))
    else:
        overrides = read_overrides(override_texts(options.overrides, laps=options.laps))
        inputs = load_flight(
            plan, scenario=options.scenario, avoid=options.avoid, inside=options.inside, overrides=overrides
        )
        warn(inputs.warnings)
        flown, name, airframe = inputs.world.plan, inputs.sources["plan"].name, inputs.world.vehicle
        if isinstance(airframe, PaperVehicle) and options.altitude_m is None:
            stated, _ = plan_of(plan, options.min_radius_m, options.laps, lambda _: None)
            if any(stage.altitude_m is not None for stage in stated.stages):
                message = f"the plan commands altitudes, and the airframe {airframe.model} holds its own"
                raise _fault("--scenario", str(options.scenario), message, "another airframe, or --altitude")
        if options.parameters is not None:
            parameters = _parameters(inputs, options.parameters, name, warn)
        forecast = None
        if options.telemetry is not None:
            planned = _after(inputs, options.telemetry, name, warn)
        else:
            forecast = inputs.preflight()
            if forecast is None:
                message, expected = "the forecast before take-off finds no parameters", "a battery that is drained"
                raise _fault("--scenario", options.scenario, message, f"{expected}, or --set without --scenario")
            planned = forecast.planned(inputs.mission)
    place, home_deg = _places(flown, name, options)
    altitude_m = options.altitude_m
    if altitude_m is None:
        altitude_m = airframe.cruise_altitude_m
        if any(stage.altitude_m is None for stage in flown.stages):
            known = options.scenario is not None
            whose = "the aircraft's" if known else "that of the default aircraft, as there is no --scenario"
            message = f"altitude {altitude_m:g} m, {whose}; --altitude sets another"
            warn([Fault(name, 1, 1, message, severity="note" if known else "warning")])
    if forecast is not None:
        warn([Fault(name, 1, 1, _forecast_text(forecast, flown, planned.legs), severity="note")])
    if options.start is not None:
        planned = _rest(planned, options.start)
    if any(flown.site.airspace) and to not in FENCED:
        message = f"obstacles and boundary are not in the format {to}"
        warn([Fault(name, 1, 1, message, severity="note")])
    if flown.site.ground_m is not None and options.home_deg is not None and options.altitudes == "relative":
        message = f"altitudes are above {flown.site.ground_m:g} m above the sea, the ground at the plan's home or start"
        warn([Fault("--home", 1, 1, message, "a home as high, or --altitudes terrain", severity="warning")])
    sections = planned_sections(planned.legs)
    ground = _ground(flown, name, to, options, sections)
    path = PlannedPath(
        (flown.site.field.name if flown.site.field else "") or printable(name.rpartition("/")[2]),
        sections,
        place,
        altitude_m,
        airframe.airspeed_mps,
        home_deg,
        options.trigger_distance_m,
        options.tolerance_m,
        _fenced(flown.site.airspace, planned.legs),
        None if options.scenario is None and flown.site.made_for is None else airframe.airspeed_mps,
        0.0 if options.scenario is None else _climb_deg(airframe),
        ground,
    )
    if to not in WITH_ITEMS:
        return Exported(writer(path), "", parameters)
    mapped = mapped_items(mission_items(path, px4=to == "px4"), planned, flown.path_count)
    fence = fence_file(path) if to == "ardupilot" else ""
    return Exported(writer(path), items_text(mapped, flown.names[: flown.path_count]), parameters, fence)


def _ground(
    plan: Plan, name: str, to: str, options: ExportOptions, sections: Sequence[Section]
) -> Callable[[FloatArray], FloatArray] | None:
    """The ground above which altitudes are written, above the altitude 0; None where they are above home."""
    zero_m, origin_deg = plan.site.ground_m, plan.site.origin_deg
    if options.altitudes == "relative":
        return None
    if to not in ABOVE_GROUND:
        raise _fault("--altitudes", options.altitudes, f"{to} has no altitudes above ground", " or ".join(ABOVE_GROUND))
    if zero_m is None or origin_deg is None:  # a plan over flat ground
        return lambda points_m: np.zeros(len(points_m))
    if not options.terrain:
        raise _fault("--altitudes", options.altitudes, f"{name} follows a ground that is not known", "--terrain FILE")
    ends = [point for section in sections for point in (section.start_m, section.end_m)]
    terrain = read_terrain(options.terrain, np.array(ends), origin_deg)
    return lambda points_m: terrain.known_m(points_m) - zero_m


def _climb_deg(airframe: Airframe) -> float:
    """Angle of the steepest climb at the airspeed in whole degrees, as ArduPilot holds it; 0 where none is modelled."""
    if isinstance(airframe, PaperVehicle):
        return 0.0
    climb_mps, _ = airframe.climb_rates_mps(airframe.airspeed_mps)
    return float(round(math.degrees(math.asin(min(1.0, climb_mps / airframe.airspeed_mps)))))


def _fenced(airspace: Airspace, legs: Sequence[Leg]) -> Airspace:
    """Obstacles and boundary as fences, which have no height: without the obstacles that are flown over."""
    low = [each for each in airspace.obstacles if each.height_m is not None]
    track = [(point.x_m, point.y_m) for leg in legs for point in leg_points(leg, FENCE_STEP_M)] if low else []
    over = [each for each in low if Airspace((each,)).entries([0.0] * len(track), track, [-math.inf] * len(track))]
    return airspace._replace(obstacles=tuple(each for each in airspace.obstacles if each not in over))


def _parameters(inputs: FlightInputs, path: str, name: str, warn: Warn) -> str:
    """The file of the autopilot's parameters, which are said, too."""
    ardupilot, text = PARAMETER_FILES[Path(path).suffix]
    mission = inputs.mission
    found = wanted_parameters(mission.plan, inputs.world.vehicle, mission.battery, ardupilot=ardupilot)
    said = ", ".join(f"{each.name} {each.value:.6g}" for each in found)
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
    at = f"at {', '.join(chosen)}: " if chosen else ""
    risks = "".join(f"; {risk_text(name, share)}" for name, share in forecast.entering.items())
    return f"forecast {at}{length_m / 1000:.2f} km, {end.remaining_s:.0f} s{energy}{reserve}{risks}"


def _after(inputs: FlightInputs, telemetry: str, name: str, warn: Warn) -> PlannedLegs:
    """The legs that are left after telemetry; what was decided is said."""
    from eadp.api.replan.replanner import rest_after

    planned, decision = rest_after(inputs, telemetry, lambda fault: warn([fault]))
    if planned is None or decision is None:
        raise _fault("--telemetry", telemetry, "leaves nothing to fly", "telemetry of a flight that goes on")
    parameters = inputs.world.plan.parameters
    values = ", ".join(f"{item.label} = {item.text(decision['parameters'][item.name])}" for item in parameters)
    length_m, end = sum(leg.distance_m for leg in planned.legs), decision["soc_end_forecast"]
    message = f"after {decision['time_s']:g} s, in stage {decision['stage']} of lap {decision['lap']}, at {values}: "
    message += f"{length_m / 1000:.2f} km left, SoC {math.nan if end is None else end:.3f} at the end"
    warn([Fault(name, 1, 1, message, severity="note")])
    return planned


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
    """
    mission = exported(plan, to, options or ExportOptions(), warn)
    if options is not None and options.parameters is not None:
        write_text(options.parameters, mission.parameters)
    written = out is not None and str(out) != "-"
    if written:
        mission.write(str(out))
    if mission.fence:
        where = f"{out}{FENCE_ENDING}" if written else "a file beside that of -o FILE"
        message = f"obstacles and boundary are ArduPilot's fence, {where}: send it besides"
        warn([Fault(str(plan) if isinstance(plan, str | PathLike) else "plan", 1, 1, message, severity="note")])
    return mission.text

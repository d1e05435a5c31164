"""The use case of `eadp cover`: a field, an aircraft and computations in, a plan and its report out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import cached_property
from os import PathLike
from typing import Any, Literal

import numpy as np

from eadp.api.given import File, Warn, python_warnings
from eadp.api.inputs import clear_home_m, load_flight
from eadp.api.vehicle import read_profile
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import Pose
from eadp.core.geometry.geodesy import compass_deg
from eadp.errors import Fault, Infeasible, InputError, one_of, refuse
from eadp.io.flight import setting_text
from eadp.io.scenario import read_scenario
from eadp.io.text.options import check_range
from eadp.io.text.streams import read_text
from eadp.io.vehicle import read_vehicle
from eadp.models.airspace import Airspace, Field, Obstacle
from eadp.models.autopilot import Autopilot
from eadp.models.performance import too_tight
from eadp.models.plan.pieces import (
    CLIMB_OUT_M,
    Air,
    approach,
    approach_slopes,
    behind_warning,
    climb_out,
    course_rad,
    landing_pose,
)
from eadp.models.plan.plan import MadeFor, Plan, Site
from eadp.models.plan.stage import Box
from eadp.models.plan.trace import nominal_legs
from eadp.models.profile import Profile
from eadp.models.vehicle import Airframe
from eadp.plug_ins import plug_in
from eadp.survey.camera import MAX_ALTITUDE_M, Pictures, option_fault
from eadp.survey.coverage import (
    AUTO,
    DUBINS,
    PATTERNS,
    ZAMBONI,
    CoverageRequest,
    CoverageSolution,
    check_access,
    has_pattern,
)
from eadp.survey.coverage import cover as cover_field
from eadp.survey.heights import (
    Climbing,
    FinalApproach,
    Ground,
    HeightProfile,
    Lack,
    check_approach,
    clear_circle,
    climb_lack,
    climbed_first,
    free_circles,
    held_up_m,
    level_lack,
    over_terrain,
    with_circles,
)
from eadp.survey.options import CoverageOptions, place_of, point_of
from eadp.survey.plan_builder import FieldComputations, build_plan
from eadp.survey.report import CoveragePlan, Pack, PathReport
from eadp.survey.swaths import CoverageLeg, MotionLimits
from eadp.survey.terrain import ElevationModel

FLAT_M = 1000.0
"""Extent of a field from which on it is said that its ground is taken as flat [m]."""

LOWER_M, MIN_APPROACH_M = 10.0, 30.0
"""Step of the heights from which a final approach is tried, and the least: lower, an autopilot has no time to line up
[m]."""


@dataclass(frozen=True)
class CoverageTask:
    """A field to cover: as its file, the options and the aircraft have it.

    Attributes
    ----------
    file : str
        Name of the field's file.
    field : Field
    repairs : sequence of str
        Repairs made to the field.
    options : CoverageOptions
    motion : MotionLimits
    vehicle : str
        Name of the aircraft, '' if it has none.
    airframe : Airframe
        For the airspeed, and the power of the motion in level flight.
    profile : profile or None
        Its computations run over the field; with it, or with a pack, the report has the energy.
    pack : Pack or None
    autopilot : Autopilot
        For the landings that it accepts.
    """

    file: str
    field: Field
    repairs: Sequence[str]
    options: CoverageOptions
    motion: MotionLimits
    vehicle: str
    airframe: Airframe
    profile: Profile | None = None
    pack: Pack | None = None
    autopilot: Autopilot = dataclass_field(default_factory=Autopilot)

    @property
    def extent_m(self) -> float:
        """The greater extent of the field, to the east or to the north [m]."""
        x, y = zip(*(vertex for part in self.field.parts for vertex in part[0]), strict=True)
        return float(max(max(x) - min(x), max(y) - min(y)))

    @cached_property
    def terrain(self) -> ElevationModel | None:
        """The ground to follow, if one is given. Raises InputError of its files and options."""
        ends = point_of("--start", self.options.start, self.field), self.home_m
        found = self.options.elevations(self.field, ends)
        if found is not None and not self.airframe.takes_commands:
            message = f"the airframe {self.airframe.model} holds its own altitude"
            raise option_fault("--terrain", "", message, "another --vehicle")
        return found

    def _ground(self, field: Field, apart_m: float, home_m: Point) -> Ground | None:
        """The ground of a flight along lines so far apart whose altitudes are 0 at home [m]; None without a terrain.

        Raises Infeasible where its height there is not known.
        """
        if self.terrain is None:
            return None
        zero_m = round(float(self.terrain.known_m(np.array([home_m]))[0]), 2)  # as a plan has it
        limits = self.options.height_limits
        return Ground(self.terrain, home_m, zero_m, limits, self.motion, apart_m, field.airspace)

    @cached_property
    def home_m(self) -> Point | None:
        """Where the flight takes off and returns to."""
        found = point_of("--home", self.options.home, self.field)
        return self.landing[:2] if found is None and self.landing is not None else found

    @property
    def from_ground(self) -> bool:
        """Whether the flight takes off at home."""
        return self.home_m is not None and self.options.start is None

    @cached_property
    def landing(self) -> Pose | None:
        """Where the flight lands, and on which course."""
        if self.options.landing is None:
            return None
        return landing_pose(self.options.landing, lambda raw: place_of("--landing", raw, self.field))

    @cached_property
    def climb_out(self) -> CoverageLeg | None:
        """The climb straight ahead after take-off; None where no direction is known."""
        options, given = self.options, self.options.takeoff_deg
        if given is None and (options.landing is None or options.start is not None or self.motion.windless):
            return None
        if self.home_m is None or options.start is not None:
            raise option_fault("--takeoff", f"{given}", "no home to take off from", "--home, and no --start")
        east, north = self.motion.wind_mps
        course = math.atan2(-north, -east) if given is None else course_rad("--takeoff", given)
        return CoverageLeg(climb_out(self.home_m, course, min(CLIMB_OUT_M, self._altitude_m), self.airframe, self._air))

    @cached_property
    def final(self) -> FinalApproach | None:
        """The final approach: from the plan's altitude, else from less by a circle before it. None without a landing.

        Raises Infeasible, of the first one tried.
        """
        if self.landing is None:
            return None
        failures: list[Infeasible] = []
        whole_m, straight_in = self._altitude_m, None
        steps = range(math.ceil(whole_m / LOWER_M) - 1, math.ceil(MIN_APPROACH_M / LOWER_M) - 1, -1)
        for slope in approach_slopes(self.autopilot):
            for height_m in (whole_m, *(LOWER_M * step for step in steps)):
                try:
                    found = self._checked(slope, height_m)
                except Infeasible as error:
                    failures.append(error)
                    continue
                if found.circle is not None or (height_m == whole_m and self.terrain is None):
                    return found
                if height_m == whole_m:
                    straight_in = straight_in or found
            if straight_in is not None:
                return straight_in
        raise Infeasible(str(failures[0]), "another heading, another place, or less altitude")

    def _checked(self, slope: float, height_m: float) -> FinalApproach:
        """A final approach that is free, reached and clear of the ground, with a circle if one is. Raises."""
        assert self.landing is not None
        way = approach(self.landing, height_m, self.airframe, self._air, slope)
        final = FinalApproach(CoverageLeg(way), height_m)
        request = self._request(final)
        request.check()
        check_access(request)
        ground = self._ground(self.field, self.motion.swath_m, self.landing[:2])
        if ground is not None:
            check_approach(final, ground)
        circles = free_circles(final.leg.start, held_up_m(self.motion.min_radius_m), request.space)
        return final._replace(
            circle=next((each for each in circles if ground is None or clear_circle(each, final, ground)), None)
        )

    @property
    def _air(self) -> Air:
        return Air(self.motion.airspeed_mps, self.motion.wind_mps)

    @property
    def _altitude_m(self) -> float:
        altitude_m = self.options.altitude_m
        return self.airframe.cruise_altitude_m if altitude_m is None else altitude_m

    @cached_property
    def airspace(self) -> Airspace:
        """What is in the way: not obstacles lower than the plan's altitude, and a climb from home, by the clearance."""
        return self._airspace(self.final)

    def _airspace(self, final: FinalApproach | None) -> Airspace:
        """As `airspace`, with a final approach."""
        given, altitude_m, airframe = self.field.airspace, self.options.altitude_m, self.airframe
        if altitude_m is None or not airframe.takes_commands:
            return given
        reached_m, slopes = [altitude_m] * len(given.obstacles), list[tuple[Point, float]]()
        if self.home_m is not None:
            # a climb from home with the wind behind, straight to the obstacle
            climb_mps = airframe.climb_rates_mps(self.motion.airspeed_mps)[0]
            slopes.append((self.home_m, climb_mps / self.motion.ground_limit_mps))
        if final is not None:
            slopes.append((final.leg.end[:2], final.height_m / final.leg.piece.length_m))
        for point, slope in slopes if given.obstacles else ():
            from eadp.core.geometry.polygons import distances_m

            ways_m = distances_m([each.outline for each in given.obstacles], point).tolist()
            reached_m = [min(there_m, slope * way_m) for there_m, way_m in zip(reached_m, ways_m, strict=True)]
        high = [
            each
            for each, there_m in zip(given.obstacles, reached_m, strict=True)
            if each.height_m is None or each.height_m > there_m - self.options.clearance_m
        ]
        return given._replace(obstacles=tuple(high))

    @property
    def notes(self) -> list[str]:
        """Repairs made to the field, and what is said of obstacles that are flown over."""
        over = [each for each in self.field.airspace.obstacles if each not in self.airspace.obstacles]
        highest = max(over, key=lambda each: each.height_m or 0.0, default=None)
        if highest is None:
            return [*self.repairs]
        many = "an obstacle is" if len(over) == 1 else f"{len(over)} obstacles are"
        said = f"{many} flown over at {self.options.altitude_m:g} m"
        return [*self.repairs, f"{said}, the highest {highest.name} of {highest.height_m:g} m"]

    @cached_property
    def request(self) -> CoverageRequest:
        """The coverage of the whole field."""
        return self._request(self.final)

    def _request(self, final: FinalApproach | None) -> CoverageRequest:
        """As `request`, with a final approach."""
        options = self.options
        ends = point_of("--start", options.start, self.field) or self.home_m, self.home_m
        apart = options.wanted_spacing_m if options.spacing_m is None else options.spacing_m
        pattern = options.pattern
        if self.terrain is not None and pattern == ZAMBONI:
            raise Infeasible("laps have one altitude, and do not follow a terrain", "--pattern dubins")
        if self.terrain is not None and pattern == AUTO:
            pattern = DUBINS
        return CoverageRequest(
            self.field,
            self.motion,
            pattern,
            options.heading_rad,
            *ends,
            apart,
            airspace=self._airspace(final),
            climb_out=self.climb_out,
            approach=None if final is None else final.leg,
            climb_s=self._climb_s,
        )

    @cached_property
    def _climbing(self) -> Climbing | None:
        """How the aircraft climbs from the ground and descends to it; None where it holds its own altitude."""
        if self.options.altitude_m is None or not self.airframe.takes_commands:
            return None
        return Climbing(*self.airframe.climb_rates_mps(self.motion.airspeed_mps), self.airframe.altitude_gain_per_s)

    @property
    def _climb_s(self) -> float:
        """Time of the climb from home to the height of the lines above it [s]; 0 where none is known."""
        if self._climbing is None or not self.from_ground or self._climbing.up_mps <= 0:
            return 0.0
        return self._climbing.reached_s(self._altitude_m)

    def _with_circles(self, solution: CoverageSolution, ground: Ground | None) -> CoverageSolution:
        """A path with the circles of its climb before the first line, and on level ground of its descent to land."""
        motion, climbing, final = self.motion, self._climbing, self.final
        if climbing is None:
            return solution
        if final is not None and final.circle is not None and ground is None:
            count = final.circles(self._altitude_m - final.height_m, climbing, motion)
            circle = replace(final.circle, altitude_m=final.height_m)
            solution = with_circles(solution, len(solution.sections) - 1, circle, count, motion)
        if not self._climb_s:
            return solution

        def lack(tried: CoverageSolution) -> Lack:
            """What the climb of a path lacks."""
            if ground is None:
                return level_lack(tried, motion, self._climb_s)
            return climb_lack(tried, ground, climbing, 0.0)

        return climbed_first(solution, motion, self.request.space, lack)

    def solution(self) -> CoverageSolution:
        """The quickest path found. Raises Infeasible."""
        return cover_field(self.request)

    def planned(self, solution: CoverageSolution, field: Field | None = None) -> CoveragePlan:
        """The plan of a path over the field, or over a part of it, which circles up to its first line."""
        field, options, motion = field or self.field, self.options, self.motion
        home_m = self.home_m or solution.path(0.0).legs[0].start[:2]
        ground, heights = self._ground(field, self.request.order_spacing_m or motion.swath_m, home_m), None
        flown = solution = self._with_circles(solution, ground)
        altitude_m = None if options.altitude_m is None else round(options.altitude_m, 3)
        if ground is not None:
            assert self._climbing is not None  # else `terrain` is refused
            start_m = 0.0 if self.from_ground else None
            flown, heights = over_terrain(solution, ground, self._climbing, start_m, lands=self.final)
            altitude_m = heights.commanded_m[0]
        pictures = self._pictures(solution)
        up_m = 0.0 if self.climb_out is None else min(CLIMB_OUT_M, self._altitude_m)
        down_m = 0.0 if heights is None else heights.commanded_m[-1]
        plan = build_plan(
            flown,
            name=self.file,
            computations=_computations(self.profile, options.turns_off),
            min_radius_m=motion.min_radius_m,
            site=self._site(field, heights, pictures),
            altitude_m=altitude_m,
            picture_m=options.picture_distance_m,
            takeoff_m=up_m if self.from_ground else None,
            land_m=None if self.landing is None else down_m,
        )
        if heights is None and self.home_m is not None and altitude_m is not None:
            legs = nominal_legs(plan, [plan.hull(i).hi for i in range(len(plan.parameters))])
            clear_m = clear_home_m(plan, legs, self.home_m, self.airframe)
            plan = replace(plan, site=plan.site._replace(home_altitude_m=clear_m))
        site_field, c1s = replace(field, airspace=self.airspace), dict.fromkeys((0.0, solution.min_c1))
        ends = tuple(PathReport.of(solution, site_field, motion, c1) for c1 in c1s)
        return CoveragePlan(plan, site_field, motion, solution, ends, self.notes, pictures, self.pack, heights)

    def _pictures(self, solution: CoverageSolution) -> Pictures | None:
        """The camera's pictures along a path; None without a camera."""
        options, distance_m = self.options, self.options.picture_distance_m
        if options.sensor_width_mm is None or options.altitude_m is None:
            return None
        sensed_m = sum(leg.piece.length_m for leg in solution.path(0.0).legs if leg.sensing)
        number = None if distance_m is None else math.ceil(sensed_m / distance_m)
        return Pictures(options, number, self.motion.max_line_speed_mps(solution.heading_rad))

    def _site(self, field: Field, heights: HeightProfile | None, pictures: Pictures | None) -> Site:
        """What the plan carries of its mission."""
        given = field.airspace if heights is None else heights.ground.airspace
        obstacles = tuple(each._replace(outline=_millimetres(each.outline)) for each in given.obstacles)
        (outline, *holes), *others = (tuple(map(_millimetres, part)) for part in field.parts)
        motion, wind_mps = self.motion, math.hypot(*self.motion.wind_mps)
        from_deg = compass_deg(math.atan2(-motion.wind_mps[1], -motion.wind_mps[0])) if wind_mps else 0.0
        return Site(
            origin_deg=field.origin_deg,
            field=Field(outline, tuple(holes), field.name, others=tuple(others)),
            swath_m=motion.swath_m,
            home_m=None if self.home_m is None else _millimetres((self.home_m,))[0],
            airspace=Airspace(obstacles, tuple(map(_millimetres, given.boundary))),
            made_for=MadeFor(self.vehicle, motion.airspeed_mps, round(wind_mps, 3), round(from_deg, 1) % 360),
            camera=None if pictures is None else pictures.of_plan,
            ground_m=None if heights is None else heights.ground.zero_m,
            home_altitude_m=None if heights is None or self.home_m is None else heights.home_altitude_m,
            clearance_m=self.options.clearance_m,
        )


def _millimetres(points: Sequence[Point]) -> tuple[Point, ...]:
    return tuple((round(x, 3), round(y, 3)) for x, y in points)


def _limited_field(file: str, options: CoverageOptions) -> tuple[Field, list[str]]:
    """The field of a file with its obstacles and its boundary; notes on what was repaired and left out of these."""
    read = plug_in("fields", "files")
    found: tuple[Field, list[str]] = read(
        file, metres=options.metres, feature=options.feature, avoid=options.avoid, inside=options.inside
    )
    field, notes = found
    if options.holes == "avoid":
        holes = [hole for part in field.parts for hole in part[1:]]
        named = [Obstacle(hole, f"hole {i}") for i, hole in enumerate(holes, 1)]
        airspace = field.airspace._replace(obstacles=(*field.airspace.obstacles, *named))
        field = replace(field, airspace=airspace)
    return field, notes


def _computations(profile: Profile | None, off_on_turns: bool) -> FieldComputations:
    """The computations of a profile, over the range that it measures, in whole numbers if it has any."""
    if profile is None:
        return FieldComputations()
    sets = []
    for lo, hi in zip(profile.interpolant.lower, profile.interpolant.upper, strict=True):
        lo = max(lo, 0.0)  # bounds of computations are 0 or more
        whole = float(math.ceil(lo)), float(math.floor(hi))
        sets.append(Box(*whole) if whole[0] <= whole[1] else Box(lo, hi))
    return FieldComputations(tuple(zip(profile.names, profile.units, strict=True)), tuple(sets), off_on_turns)


def flight_keys(task: CoverageTask, vehicle: File | None) -> dict[str, Any]:
    """Keys of a scenario with which what a task plans is flown: its aircraft, its airspeed and its wind."""
    keys: dict[str, Any] = {} if vehicle is None else {"vehicle": str(vehicle)}
    if task.options.airspeed_mps is not None:
        keys["vehicle.airframe.airspeed_mps"] = task.options.airspeed_mps
        wider = task.airframe.flown_at(task.options.airspeed_mps)
        if wider.airspeed_range_mps is not None:
            keys["vehicle.airframe.airspeed_range_mps"] = [*wider.airspeed_range_mps]
    if task.options.wind is not None:
        east, north = task.motion.wind_mps
        from_deg = compass_deg(math.atan2(-north, -east))
        keys |= {"wind.speed_mps": math.hypot(east, north), "wind.from_deg": round(from_deg, 6)}
    return keys


def held_at(plan: Plan, path: Literal["lo", "hi"], computations: Literal["lo", "hi"]) -> Plan:
    """A plan whose parameters are fixed at ends of their sets: those of the path, and those of the computations."""
    ends = [path if i < plan.path_count else computations for i in range(len(plan.parameters))]
    fixed = [[getattr(box, end) for box, end in zip(stage.sets, ends, strict=True)] for stage in plan.stages]
    stages = [
        replace(stage, sets=tuple(Box(value, value) for value in values))
        for stage, values in zip(plan.stages, fixed, strict=True)
    ]
    return replace(plan, stages=tuple(stages))


def cover(
    field: File,
    options: CoverageOptions,
    profile: File | Profile | None = None,
    scenario: File | None = None,
    *,
    vehicle: File | None = None,
    warn: Warn = python_warnings,
) -> CoveragePlan:
    """Plan the coverage of a field: from its outline to a plan whose line spacing can vary in flight.

    Parameters
    ----------
    field : path
        Outline: GeoJSON, KML or CSV of vertices.
    options : CoverageOptions
        The turning radius and the swath, and what else is prescribed.
    profile : path or profile, optional
        The plan gets its computations, and the report the energy; by default the scenario's.
    scenario : path, optional
        For the vehicle, the wind and the energy.
    vehicle : path, optional
        The aircraft, instead of the scenario's.
    warn : function, optional

    Raises
    ------
    Infeasible
        If no path of this pattern covers the field.
    InputError
        With the faults of the files, or of an option under its name on the command line.
    """
    task = coverage_task(str(field), options, profile, scenario, vehicle, warn)
    found = task.planned(task.solution())
    if task.profile is not None or task.pack is not None:
        keys, given = flight_keys(task, vehicle) | {"parameters": None}, None if scenario is None else str(scenario)
        try:
            found = _with_energy(found, given, profile, keys)
        except InputError as error:
            # the path takes vehicle and wind alone from a scenario, which may be of another plan
            if any(fault.file not in (given, *(f"--set {key}" for key in keys)) for fault in error.faults):
                raise
            first = error.faults[0]
            warn([replace(first, message=f"no energy is stated: {first.message}", severity="note")])
    warn(picture_warnings(found.pictures))
    return found


def _with_energy(
    found: CoveragePlan, scenario: str | None, profile: File | Profile | None, keys: dict[str, Any]
) -> CoveragePlan:
    """A plan with its energy at each end of c1 as forecast, with every computation at its highest."""
    ends, turns_back_soc = [], 0.0
    for end in found.ends:
        plan = held_at(found.plan, "lo" if end.c1 < 0 else "hi", "hi")
        inputs = load_flight(plan, scenario=scenario, profile=profile, overrides=keys)
        forecast = inputs.at_one_airspeed().preflight(whole=False)
        if forecast is None:
            return found
        ends.append(replace(end, energy_wh=forecast.forecast.energy_wh))
        turns_back_soc = max(turns_back_soc, forecast.turns_back_soc)
        slower = inputs.at_min_energy() if end.c1 == 0 else found.slower
        found = replace(found, aircraft=setting_text(inputs.scenario), slower=slower)
    return replace(found, ends=tuple(ends), pack=found.pack and found.pack._replace(turns_back_soc=turns_back_soc))


def picture_warnings(pictures: Pictures | None) -> list[Fault]:
    """Warnings about pictures that the camera may be too slow for."""
    doubts = [] if pictures is None else pictures.doubts()
    return [Fault(key, 1, 1, message, expected, severity="warning") for key, message, expected in doubts]


def coverage_task(
    field: str,
    options: CoverageOptions,
    profile: File | Profile | None,
    scenario: File | None,
    vehicle: File | None,
    warn: Warn,
    *,
    cruises: bool = False,
) -> CoverageTask:
    """A field to cover, with the aircraft and the wind of a scenario; warns of turns that are too tight.

    With `cruises` the altitude is that of the aircraft, unless the options have one.
    """
    setting = read_scenario(None if scenario is None else str(scenario))
    if profile is None:
        profile = setting.profile_path
    if isinstance(profile, str | PathLike):
        profile = read_profile(profile, warn=warn)
    if options.turns_off and profile is None:
        message = "no computations to stop on turns; --profile names some"
        warn([Fault("--turns-off", 1, 1, message, severity="note")])
    flown = setting.keys.vehicle if vehicle is None else read_vehicle(read_text(str(vehicle)))
    options = options.with_camera()
    if (cruises or options.landing is not None or options.takeoff_deg is not None) and options.altitude_m is None:
        options = replace(options, altitude_m=flown.airframe.cruise_altitude_m)
    pack = None
    if vehicle is not None or "battery" in setting.chosen:
        battery = flown.battery if vehicle is not None else setting.keys.battery
        pack = Pack(battery, setting.keys.reserve_soc)
    wind_mps = setting.keys.wind.steady_mps
    if vehicle is not None or "vehicle" in setting.chosen:
        airspeed_mps = options.airspeed_mps
        faults = (flown.airframe if airspeed_mps is None else flown.airframe.flown_at(airspeed_mps)).faults()
        where = "--airspeed" if options.airspeed_mps else str(vehicle or scenario)
        refuse([Fault(where, 1, 1, fault, "an aeroplane that can fly so") for fault in faults])
    motion = options.motion(flown.airframe, wind_mps)
    if options.altitude_m is not None:
        check_range("--altitude", options.altitude_m, 0, MAX_ALTITUDE_M)
    check_range("--clearance", options.clearance_m, 0, MAX_ALTITUDE_M, closed=True)
    if not has_pattern(options.pattern):
        raise option_fault("--pattern", options.pattern, "is no pattern", one_of(PATTERNS, options.pattern))
    ground, notes = _limited_field(field, options)
    name, autopilot = "<stdin>" if field == "-" else field, setting.keys.autopilot
    task = CoverageTask(name, ground, notes, options, motion, flown.name, flown.airframe, profile, pack, autopilot)
    if task.terrain is None and task.extent_m > FLAT_M:
        message = f"the ground is taken as flat over {task.extent_m / 1000:.1f} km; --terrain has its heights"
        warn([Fault(task.file, 1, 1, message, severity="note")])
    speed_mps = math.hypot(*task.motion.wind_mps)
    if tight := too_tight(flown.airframe, task.motion.airspeed_mps, task.motion.min_radius_m, speed_mps):
        warn([Fault("--min-radius", 1, 1, tight, severity="warning")])
    if task.landing is not None:
        warn(behind_warning(task.landing[2], task.motion.wind_mps))
    return task

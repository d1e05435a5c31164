"""What a coverage path amounts to: ground covered, length, time and energy, as values, as JSON and as text."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import cached_property
from typing import Any, NamedTuple

from eadp.core.expressions.tree import number_text
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import compass_deg, place_text, point_text, to_geodetic_deg
from eadp.core.geometry.polygons import (
    Ring,
    covered_share,
    ground_m2,
    inner_point,
    uncovered,
)
from eadp.io.flight import airspeeds_text
from eadp.models.airspace import Field
from eadp.models.autopilot import FACTORY, LANDING_ANGLE, PX4, Autopilot
from eadp.models.battery import Battery
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import LAND, LOITER_TO_ALTITUDE
from eadp.planning.forecast.held import Preflight
from eadp.survey.camera import Pictures, pictures_document
from eadp.survey.coverage import DUBINS, ZAMBONI, CoverageSolution
from eadp.survey.ground import (
    HOME_TEXT,
    HeightReport,
    Heights,
)
from eadp.survey.swaths import CoveragePath, MotionLimits

FIXED_SPACING = "fixed: a planner cannot save lines in flight, as it can with --pattern zamboni"
FULL = 0.9999
"""Share of a field from which on it counts as covered."""


@dataclass(frozen=True)
class PathReport:
    """A coverage path at one value of c1.

    `spacing_m` is the distance of its lines, None for a single one; `energy_wh` is its forecast, None without one.
    """

    c1: float
    spacing_m: float | None
    coverage: float
    length_m: float
    time_s: float
    lines: int
    min_radius_m: float
    energy_wh: float | None = None


def path_report(solution: CoverageSolution, field: Field, motion: MotionLimits, c1: float) -> PathReport:
    """Ground covered, length and time at a fixed c1.

    Parameters
    ----------
    solution : CoverageSolution
    field : Field
        The field that it covers.
    motion : MotionLimits
        Swath, airspeed and wind.
    c1 : float
        The path parameter.
    """
    path = solution.path(c1)
    time_s = motion.time_s(path.pieces)
    coverage = covered_by_lines(path, field, motion.swath_m)
    if solution.blocks:
        spacing_m: float | None = solution.blocks[0].spacing_at(max(c1, solution.blocks[0].min_c1))
    else:
        spacing_m = _line_distance_m(path, solution.heading_rad)
    return PathReport(c1, spacing_m, coverage, path.length_m, time_s, path.lines, path.min_radius_m)


def _line_distance_m(path: CoveragePath, heading_rad: float) -> float | None:
    """The median distance of neighbouring lines [m]; None for a single one."""
    sin, cos = math.sin(heading_rad), math.cos(heading_rad)
    # places across the lines; those of one line twice are equal to a centimetre
    places = sorted({round(leg.start[1] * cos - leg.start[0] * sin, 2) for leg in path.legs if leg.sensing})
    return statistics.median(b - a for a, b in itertools.pairwise(places)) if len(places) > 1 else None


def covered_by_lines(path: CoveragePath, field: Field, swath_m: float) -> float:
    """Share of a field that the lines of a path cover; turns cover nothing."""
    return covered_share(field.parts, path.sensed_m, swath_m)


def rounded_deg(heading_rad: float, digits: int) -> float:
    """The compass bearing of a heading, rounded [°]."""
    return round(compass_deg(heading_rad), digits) % 360


@dataclass(frozen=True)
class CoverageReport:
    """A coverage path of a field at both ends of c1: `full` at c1 = 0, `least` at the lowest c1."""

    field: Field
    motion: MotionLimits
    solution: CoverageSolution
    full: PathReport
    least: PathReport

    @classmethod
    def of(cls, field: Field, motion: MotionLimits, solution: CoverageSolution) -> CoverageReport:
        """The report of a solution."""
        full = path_report(solution, field, motion, 0.0)
        least = path_report(solution, field, motion, solution.min_c1) if solution.min_c1 < 0 else full
        return cls(field, motion, solution, full, least)

    def with_energy(self, energy_wh: Callable[[float], float | None]) -> CoverageReport:
        """The report with the energy of each end by its c1 [Wh]."""
        full, *rest = (replace(end, energy_wh=energy_wh(end.c1)) for end in self.ends)
        return replace(self, full=full, least=rest[0] if rest else full)

    @property
    def ends(self) -> Sequence[PathReport]:
        """The reports of the ends of c1 that differ."""
        return (self.full,) if self.least is self.full else (self.full, self.least)

    @property
    def _heading_text(self) -> str:
        """ "heading" and the compass bearing of the lines [°]."""
        return f"heading {rounded_deg(self.solution.heading_rad, 1):.1f}"

    @cached_property
    def left(self) -> list[LeftGround]:
        """The places that are not covered, at the coarsest spacing."""
        if self.least.coverage >= FULL:
            return []
        return left_ground(self.field, self.solution.path(self.least.c1).sensed_m, self.motion.swath_m)

    @property
    def _steps(self) -> list[float]:
        return self.solution.blocks[0].steps() if self.solution.blocks else []

    @property
    def _steps_text(self) -> str:
        """Spacings from which on laps are saved, rounded up: each saves its lap."""
        block = self.solution.blocks[0]
        ends = (block.spacing_at(c1) for c1 in self._steps)
        return ", ".join(f"{min(math.ceil(100 * m) / 100, block.spacing_at(block.min_c1)):.4g}" for m in ends)

    def titled_paths(self) -> dict[str, CoveragePath]:
        """The path at each end of c1 under a title."""
        paths = {}
        for end in self.ends:
            at = f"lines {end.spacing_m:.1f} m apart: " if len(self.ends) > 1 else ""
            title = f"{at}{end.lines} lines, {end.length_m / 1000:.2f} km, {100 * end.coverage:.2f} % covered"
            paths[title] = self.solution.path(end.c1)
        return paths

    def comments(self, name: str) -> list[str]:
        """Comment lines for the head of a plan that covers the field of a name."""
        motion, lines = self.motion, []
        for end in self.ends:
            spacing = "" if end.spacing_m is None else f", {end.spacing_m:.4g} m apart"
            parameter = f" with c1 = {number_text(end.c1)}" if len(self.ends) > 1 else ""
            lines.append(f"{_counted(end.lines, 'line')}{spacing}, {end.length_m:.0f} m{parameter}")
        swath = f"Covers {name} with a swath of {motion.swath_m:g} m and turns of {motion.min_radius_m:g} m or more"
        return [f"{swath}; lines {self._heading_text} deg.", *lines]

    def document(self, normalised: Sequence[str], plan: str) -> dict[str, Any]:
        """The values of `eadp.cover/1`, with the repairs made to the field and the plan's text."""
        full, least, solution = self.full, self.least, self.solution
        min_radius_m = round(min(full.min_radius_m, least.min_radius_m), 6)
        document: dict[str, Any] = {
            "schema": "eadp.cover/1",
            "pattern": solution.pattern,
            "heading_deg": rounded_deg(solution.heading_rad, 9),
            "coverage": full.coverage,
            "coverage_min": least.coverage,
            "length_m": full.length_m,
            "time_s": full.time_s,
            "lines": full.lines,
            "spacing_m": [full.spacing_m, least.spacing_m],
            "swath_m": self.motion.swath_m,
            "lead_in_m": self.motion.lead_in_m,
            "min_radius_m": min_radius_m if math.isfinite(min_radius_m) else None,  # a single line has no turn
            "c1": [least.c1, full.c1] if least is not full else None,
            "at_lowest_c1": {"length_m": least.length_m, "time_s": least.time_s, "lines": least.lines},
            "c1_steps": self._steps,
            "blocks": len(solution.blocks),
            "parts": len(self.field.parts),
            "obstacles": len(self.field.airspace.obstacles),
            "boundary": bool(self.field.airspace.boundary),
            "origin_deg": self.field.origin_deg,
            "field": {"name": self.field.name, "area_m2": self.field.area_m2},
            "left": [each.document(self.field.origin_deg) for each in self.left],
            "normalised": list(normalised),
            "plan": plan,
        }
        if full.energy_wh is not None:
            document["energy_wh"] = full.energy_wh
            document["at_lowest_c1"]["energy_wh"] = least.energy_wh
        return document

    def text(self) -> list[str]:
        """A summary for people, line by line."""
        solution, blocks = self.solution, len(self.solution.blocks)
        parts = len(self.field.parts)
        holes = sum(map(len, self.field.parts)) - parts
        own = {
            DUBINS: "lines in an order, Dubins turns",
            ZAMBONI: f"Zamboni-like, {_counted(blocks, 'block')}",
        }
        pattern = own.get(solution.pattern, solution.pattern)
        lines = [
            f"field      {f'{self.field.name}, ' if self.field.name else ''}{self.field.area_m2 / 1e4:.2f} ha"
            + (f" at {place_text(self.field.origin_deg)}" if self.field.origin_deg else "")
            + (f", {parts} parts" if parts > 1 else "")
            + (f", {_counted(holes, 'hole')}" if holes else ""),
            f"pattern    {pattern}; lines {self._heading_text}°",
        ]
        for end in self.ends:
            at = "" if end.spacing_m is None else f" with lines {end.spacing_m:.1f} m apart"
            energy = f", {end.energy_wh:.2f} Wh" if end.energy_wh is not None else ""
            lines.append(
                f"{'covers' if end is self.full else '':<10} {100 * end.coverage:.2f} %{at}: "
                f"{_counted(end.lines, 'line')}, {end.length_m / 1000:.2f} km, {end.time_s:.0f} s{energy}"
            )
        obstacles, boundary = self.field.airspace
        if obstacles or boundary:
            kept = [f"out of {_counted(len(obstacles), 'obstacle')}"] if obstacles else []
            kept += ["inside the boundary"] if boundary else []
            lines.append(f"stays      {' and '.join(kept)}")
        lines += left_text(self.left, 1 - self.least.coverage, self.field.origin_deg)
        if blocks:
            lines.append(f"laps       one less in each block from a spacing of {self._steps_text} m on")
        tightest = min(end.min_radius_m for end in self.ends)
        wide = f"{math.floor(100 * tightest + 1e-6) / 100:.2f} m or wider" if math.isfinite(tightest) else "none"
        lead_in = f"; straight for {self.motion.lead_in_m:g} m before each line" if self.motion.lead_in_m else ""
        lines.append(f"turns      {wide}{lead_in}")
        if not blocks:
            lines.append(f"spacing    {FIXED_SPACING}")
        return [*lines, self.motion.wind_text]


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


MIN_SHARE = 1e-4
"""A place is listed from this share of the field on."""

WIDTH_SHARE = 0.01
"""Width over the swath below which ground between strips is rounding."""

SHOWN = 3
"""Places that are named, the largest ones."""


class LeftGround(NamedTuple):
    """A place that is not covered: its outline and its holes [m], its area [m²], and a point of it [m]."""

    rings: Sequence[Ring]
    area_m2: float
    place_m: Point

    def document(self, origin_deg: Point | None) -> dict[str, Any]:
        """Its values, with latitude and longitude where the field has an origin."""
        at_deg = None if origin_deg is None else [round(each, 7) for each in to_geodetic_deg(*self.place_m, origin_deg)]
        return {"area_m2": self.area_m2, "at_m": self.place_m, "at_deg": at_deg}


def left_ground(field: Field, lines: Sequence[Sequence[Point]], swath_m: float) -> list[LeftGround]:
    """The places of a field that lines leave uncovered, the largest first.

    Parameters
    ----------
    field : Field
    lines : sequence of sequences of (float, float)
        Points of each line [m].
    swath_m : float
    """
    found = []
    for rings in uncovered(field.parts, lines, swath_m, WIDTH_SHARE * swath_m):
        area_m2 = ground_m2(*rings)
        if area_m2 >= MIN_SHARE * field.area_m2:
            found.append(LeftGround(rings, area_m2, inner_point(*rings)))
    return sorted(found, key=lambda each: -each.area_m2)


def left_text(left: Sequence[LeftGround], share: float, origin_deg: Point | None) -> list[str]:
    """What is left, for people, line by line: the share of the field, and the largest places."""
    if not left:
        return []
    places = f"in {len(left)} places; the largest" if len(left) > SHOWN else "at"
    total = sum(each.area_m2 for each in left)
    lines = [f"left       {100 * share:.2f} % of the field, {area_text(total)} {places}:"]
    for each in left[:SHOWN]:
        lines.append(f"           {area_text(each.area_m2)} at {point_text(each.place_m, origin_deg)}")
    return lines


def area_text(area_m2: float) -> str:
    """An area, for people."""
    return f"{area_m2 / 1e4:.2f} ha" if area_m2 >= 1000 else f"{area_m2:.0f} m²"


# --- a plan


class Pack(NamedTuple):
    """A full pack, the state of charge kept in it, and that with less of which the autopilot turns back."""

    battery: Battery
    reserve_soc: float
    turns_back_soc: float = 0.0

    @property
    def energy_wh(self) -> float:
        """What it gives before [Wh]."""
        kept = max(self.reserve_soc, self.turns_back_soc)
        return float((1 - kept) * self.battery.capacity_ah * self.battery.voltage_at((1 + kept) / 2))


@dataclass(frozen=True)
class CoveragePlan:
    """A plan that covers a field: its text, its report, the repairs made to the field, and the camera's pictures.

    `pack` is a full one of the aircraft, if it has one, and `aircraft` says what the energy is of; `slower` is the
    forecast of its finest lines at the airspeeds of the least energy, where these are a decision.
    """

    plan: Plan
    text: str
    report: CoverageReport
    repairs: Sequence[str]
    pictures: Pictures | None = None
    pack: Pack | None = None
    heights: Heights | None = None
    autopilot: Autopilot = dataclass_field(default_factory=Autopilot)
    aircraft: str = ""
    slower: Preflight | None = None

    @property
    def document(self) -> dict[str, Any]:
        """The values of `eadp.cover/1`."""
        return {
            **self.report.document(self.repairs, self.text),
            "side_overlap": self._side_overlaps,
            "batteries": self._batteries,
            "slower": self._slower,
            **pictures_document(self.pictures),
            "terrain": None if self.heights is None else HeightReport([self.heights], *self.on_ground).document(),
        }

    @property
    def on_ground(self) -> tuple[float, float | None, float | None]:
        """Width of a picture or of a line's ground [m], distance of the lines [m], and size of a pixel [cm]."""
        shot, apart_m = self.pictures, self.report.least.spacing_m
        if shot is None:
            return self.report.motion.swath_m, apart_m, None
        return shot.shot.width_m, apart_m, shot.shot.pixel_cm

    @property
    def _side_overlaps(self) -> list[float | None]:
        """Share of a line's ground that the next line shows too, at the finest spacing and at the coarsest."""
        return [self._overlap(end.spacing_m) for end in (self.report.full, self.report.least)]

    def _overlap(self, apart_m: float | None) -> float | None:
        return None if apart_m is None else 1 - apart_m / self.on_ground[0]

    @property
    def _batteries(self) -> list[float] | None:
        """Full packs, down to what is kept in them, for the path at the finest spacing and at the coarsest."""
        energies_wh = [end.energy_wh for end in (self.report.full, self.report.least) if end.energy_wh is not None]
        return [energy_wh / self.pack.energy_wh for energy_wh in energies_wh] or None if self.pack else None

    @property
    def _slower(self) -> dict[str, Any] | None:
        if self.slower is None or not self.slower.airspeeds_mps:
            return None
        ending = self.slower.forecast
        return {
            "airspeeds_mps": list(self.slower.airspeeds_mps),
            "time_s": ending.remaining_s,
            "energy_wh": ending.energy_wh,
        }

    @property
    def lines(self) -> list[str]:
        """A summary for people, line by line."""
        camera = [] if self.pictures is None else self.pictures.lines()
        home_m = self.plan.site.home_altitude_m
        ground = [] if home_m is None else [HOME_TEXT.format(home_m)]
        if self.heights is not None:
            ground = HeightReport([self.heights], *self.on_ground).text()
        flight = [*self.report.text(), *self._climb_text(), *self._landing_text()]
        return [*flight, *camera, *self._overlap_text(), *ground, *self._batteries_text()]

    def _climb_text(self) -> list[str]:
        """The circles of the climb before the first line."""
        ways = itertools.takewhile(lambda leg: not leg.sensing, self.report.solution.path(0.0).legs)
        radii_m = [leg.piece.radius_m for leg in ways if leg.whole_circle]
        many = f"{len(radii_m)} circles" if len(radii_m) > 1 else "a circle"
        return [f"climb      {many} of {radii_m[0]:.0f} m radius before the first line"] if radii_m else []

    def _landing_text(self) -> list[str]:
        """The final approach."""
        last = self.plan.stages[-1]
        if not last.command(LAND):
            return []
        before = self.plan.stages[-2]  # which leads to its start
        length_m = math.dist(before.trigger_at(()), last.trigger_at(()))
        down_m = (before.altitude_m or 0.0) - (last.altitude_m or 0.0)
        ends = f" to {last.altitude_m:.0f} m" if last.altitude_m else ""
        circle = ", after a circle down to it" if before.command(LOITER_TO_ALTITUDE) else ""
        steep_deg = math.degrees(math.atan2(down_m, length_m))
        steep = self.autopilot.kind is None and steep_deg > FACTORY[PX4][LANDING_ANGLE] + 0.05
        px4 = f": PX4 needs {LANDING_ANGLE} {steep_deg:.1f}" if steep else ""
        how = f"final approach of {length_m:.0f} m from {before.altitude_m:g} m{ends}, {steep_deg:.1f}°"
        return [f"landing    {how}{circle}{px4}"]

    def _overlap_text(self) -> list[str]:
        """The overlap of neighbouring lines."""
        shares = [f"{100 * share:.0f} %" for share in self._side_overlaps if share is not None]
        return [f"overlap    {' to '.join(dict.fromkeys(shares))} from line to line"] if shares else []

    def _batteries_text(self) -> list[str]:
        """What the energy is of, and how many packs the path takes."""
        aircraft = [f"aircraft   {self.aircraft}"] if self.aircraft else []
        if self._batteries is None or self.pack is None:
            return aircraft
        packs = " to ".join(dict.fromkeys(f"{count:.2g}" for count in self._batteries))
        until = "its reserve" if self.pack.turns_back_soc <= self.pack.reserve_soc else "the autopilot turns back"
        text = [
            *aircraft,
            f"batteries  {packs}; a full one gives {self.pack.energy_wh:.3g} Wh before {until}, no charge lost at once",
        ]
        if (slower := self._slower) is not None:
            least = f"{slower['time_s']:.0f} s, {slower['energy_wh']:.2f} Wh with the densest lines"
            flown = airspeeds_text(slower["airspeeds_mps"])
            text.append(f"slower     {flown}: {least}; flown where the charge is short")
        return text

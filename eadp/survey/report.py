"""What a coverage path amounts to: ground covered, length, time and energy, as values, as JSON and as text."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import compass_deg, place_text, point_text, to_geodetic_deg
from eadp.core.geometry.polygons import Ring, covered_share, ground_m2, inner_point, uncovered
from eadp.errors import counted
from eadp.io.flight import airspeeds_text
from eadp.io.plan.writer import plan_text
from eadp.models.airspace import Field
from eadp.models.battery import Battery
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import LAND, LOITER_TO_ALTITUDE
from eadp.planning.forecast.held import Preflight
from eadp.survey.camera import Pictures, pictures_document, rounded_text
from eadp.survey.coverage import DUBINS, ZAMBONI, CoverageSolution
from eadp.survey.heights import HeightProfile
from eadp.survey.swaths import CoveragePath, MotionLimits

FULL = 0.9999
"""Share of a field from which on it counts as covered."""


def rounded_deg(heading_rad: float, digits: int) -> float:
    """The compass bearing of a heading, rounded [°]."""
    return round(compass_deg(heading_rad), digits) % 360


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


def left_ground(
    parts: Sequence[Sequence[Ring]], lines: Sequence[Sequence[Point]], swath_m: float, width_share: float = WIDTH_SHARE
) -> list[LeftGround]:
    """The places of a field that lines leave uncovered, the largest first.

    Parameters
    ----------
    parts : sequence of sequences of rings
        Those of the field [m], each an outline and its holes.
    lines : sequence of sequences of (float, float)
        Points of each line [m].
    swath_m : float
    width_share : float, optional
        Width over the swath below which ground is not left.
    """
    found, field_m2 = [], sum(ground_m2(*part) for part in parts)
    for rings in uncovered(parts, lines, swath_m, width_share * swath_m):
        area_m2 = ground_m2(*rings)
        if area_m2 >= MIN_SHARE * field_m2:
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


@dataclass(frozen=True)
class Covered:
    """What the lines of a path cover of a field, and what they leave; turns cover nothing."""

    field: Field
    path: CoveragePath
    swath_m: float

    @cached_property
    def share(self) -> float:
        """Share of the field."""
        return covered_share(self.field.parts, self.path.sensed_m, self.swath_m)

    @cached_property
    def left(self) -> list[LeftGround]:
        """The places that they leave; none where the field counts as covered."""
        return [] if self.share >= FULL else left_ground(self.field.parts, self.path.sensed_m, self.swath_m)

    def lines(self) -> list[str]:
        """What they leave, for people, line by line."""
        return left_text(self.left, 1 - self.share, self.field.origin_deg)


@dataclass(frozen=True)
class PathReport:
    """A coverage path at one value of c1.

    `spacing_m` is the distance of its lines, None for a single one; `energy_wh` is its forecast, None without one.
    """

    c1: float
    path: CoveragePath
    covered: Covered
    spacing_m: float | None
    time_s: float
    energy_wh: float | None = None

    @classmethod
    def of(cls, solution: CoverageSolution, field: Field, motion: MotionLimits, c1: float) -> PathReport:
        """The report of a solution, for a field, at a fixed c1."""
        path, spacing_m = solution.path(c1), None
        # places across the lines; those of one line twice are equal to a centimetre
        sin, cos = math.sin(solution.heading_rad), math.cos(solution.heading_rad)
        places = sorted({round(leg.start[1] * cos - leg.start[0] * sin, 2) for leg in path.legs if leg.sensing})
        if solution.blocks:
            spacing_m = solution.blocks[0].spacing_at(max(c1, solution.blocks[0].min_c1))
        elif len(places) > 1:
            spacing_m = statistics.median(b - a for a, b in itertools.pairwise(places))
        return cls(c1, path, Covered(field, path, motion.swath_m), spacing_m, motion.time_s(path.pieces))

    @property
    def coverage(self) -> float:
        """Share of the field that it covers."""
        return self.covered.share

    @property
    def length_m(self) -> float:
        """Length of the path [m]."""
        return self.path.length_m

    @property
    def lines(self) -> int:
        """The number of its lines."""
        return self.path.lines


# --- heights above ground

HOME_TEXT = "way home   clear of ground and obstacles at {:g} m (home.altitude_m, RTL_ALTITUDE)"
"""What is said of the altitude of the way home."""


class HeightReport(NamedTuple):
    """The heights of one flight, or of sorties together.

    `width_m` is that of a picture on lines at their height, `apart_m` the distance of the lines [m], and `gsd_cm` the
    size of a pixel [cm].
    """

    flights: Sequence[HeightProfile]
    width_m: float
    apart_m: float | None
    gsd_cm: float | None

    def _joined(self, name: str) -> FloatArray:
        """An array of all profiles."""
        return np.concatenate([getattr(each, name) for each in self.flights])

    @property
    def home_altitude_m(self) -> int:
        """Altitude at which every straight way home is clear of ground and obstacles [m]."""
        return max(each.home_altitude_m for each in self.flights)

    def document(self) -> dict[str, Any]:
        """Its values in `eadp.cover/1` and `eadp.sorties/1`."""
        ground, above_m, ground_m = self.flights[0].ground, self._joined("above_m"), self._joined("ground_m")
        line_m = ground.limits.line_m
        # pictures are as wide as their height above the ground
        widths_m = self.width_m * self._joined("overlapping_m") / line_m
        return {
            "zero_m": ground.zero_m,
            "ground_m": [float(ground_m.min()), float(ground_m.max())],
            "height_m": _range(above_m),
            "altitudes": sum(len(each.commanded_m) for each in self.flights),
            "home_altitude_m": self.home_altitude_m,
            "gsd_cm": None if self.gsd_cm is None else _range(self.gsd_cm * above_m / line_m),
            "side_overlap": None if self.apart_m is None else _range(1 - self.apart_m / widths_m),
        }

    def text(self) -> list[str]:
        """For people, of the same."""
        values = self.document()
        low, high = values["ground_m"]
        least, mean, most = values["height_m"]
        lines = [
            f"ground     {round(low)} to {round(high)} m above home, {values['zero_m']:.0f} m above the sea; "
            f"{counted(values['altitudes'], 'altitude')}",
            f"height     {least:.1f} to {most:.1f} m above ground on lines, mean {mean:.1f} m",
        ]
        said = []
        if (pixels := values["gsd_cm"]) is not None:
            least, mean, most = (rounded_text(pixel_cm, 2) for pixel_cm in pixels)
            said.append(f"pixels of {least} to {most} cm, mean {mean} cm")
        if (shares := values["side_overlap"]) is not None:
            least, mean, most = (100 * share for share in shares)
            said.append(f"overlap {least:.0f} to {most:.0f} %, mean {mean:.0f} %")
        lines += [f"on ground  {'; '.join(said)}"] if said else []
        return [*lines, HOME_TEXT.format(values["home_altitude_m"])]


def _range(values: FloatArray) -> list[float]:
    """Least, mean and greatest."""
    return [float(values.min()), float(values.mean()), float(values.max())]


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
    """A plan that covers a field, and what its path amounts to.

    Attributes
    ----------
    plan : Plan
    field : Field
        What it covers, with what is in the way.
    motion : MotionLimits
    solution : CoverageSolution
        The path.
    ends : tuple of PathReport
        At c1 = 0, and at the lowest c1 if that is another.
    notes : sequence of str
        Repairs made to the field, and what is flown over.
    pictures : Pictures or None
        The camera's.
    pack : Pack or None
        A full one of the aircraft.
    heights : HeightProfile or None
        Over its terrain.
    aircraft : str
        What the energy is of.
    slower : Preflight or None
        The flight at c1 = 0 with the least energy, where the airspeed can be decided.
    """

    plan: Plan
    field: Field
    motion: MotionLimits
    solution: CoverageSolution
    ends: tuple[PathReport, ...]
    notes: Sequence[str] = ()
    pictures: Pictures | None = None
    pack: Pack | None = None
    heights: HeightProfile | None = None
    aircraft: str = ""
    slower: Preflight | None = None

    @property
    def full(self) -> PathReport:
        """The path at c1 = 0, with the densest lines."""
        return self.ends[0]

    @property
    def least(self) -> PathReport:
        """The path at the lowest c1, with the fewest lines."""
        return self.ends[-1]

    @property
    def text(self) -> str:
        """The plan as text."""
        return plan_text(self.plan)

    @property
    def left(self) -> list[LeftGround]:
        """The places that are not covered, at the coarsest spacing."""
        return self.least.covered.left

    @property
    def on_ground(self) -> tuple[float, float | None, float | None]:
        """Width of a picture or of a line's ground [m], distance of the lines [m], and size of a pixel [cm]."""
        shot, apart_m = self.pictures, self.least.spacing_m
        if shot is None:
            return self.motion.swath_m, apart_m, None
        return shot.shot.width_m, apart_m, shot.shot.pixel_cm

    @property
    def _side_overlaps(self) -> list[float | None]:
        """Share of a line's ground that the next line shows too, at the finest spacing and at the coarsest."""
        spacings_m = [end.spacing_m for end in (self.full, self.least)]
        return [None if apart_m is None else 1 - apart_m / self.on_ground[0] for apart_m in spacings_m]

    @property
    def _batteries(self) -> list[float] | None:
        """Full packs, down to what is kept in them, for the path at the finest spacing and at the coarsest.

        None where nothing is known of them, or of the energy, and where the autopilot turns back with a full one.
        """
        if self.pack is None or self.pack.energy_wh <= 0:
            return None
        energies_wh = [end.energy_wh for end in (self.full, self.least) if end.energy_wh is not None]
        return [energy_wh / self.pack.energy_wh for energy_wh in energies_wh] or None

    @property
    def _slower(self) -> dict[str, Any] | None:
        if self.slower is None or not self.slower.airspeeds_mps:
            return None
        ending, airspeeds_mps = self.slower.forecast, list(self.slower.airspeeds_mps)
        return {"airspeeds_mps": airspeeds_mps, "time_s": ending.remaining_s, "energy_wh": ending.energy_wh}

    @property
    def _min_radius_m(self) -> float:
        """The smallest radius of its turns [m]; infinite without one."""
        return min(end.path.min_radius_m for end in self.ends)

    @property
    def document(self) -> dict[str, Any]:
        """The values of `eadp.cover/1`."""
        full, least, origin_deg = self.full, self.least, self.field.origin_deg
        lowest: dict[str, Any] = {"length_m": least.length_m, "time_s": least.time_s, "lines": least.lines}
        energy: dict[str, float | None] = {} if full.energy_wh is None else {"energy_wh": full.energy_wh}
        return {
            "schema": "eadp.cover/1",
            "pattern": self.solution.pattern,
            "heading_deg": rounded_deg(self.solution.heading_rad, 9),
            "coverage": full.coverage,
            "coverage_min": least.coverage,
            "length_m": full.length_m,
            "time_s": full.time_s,
            "lines": full.lines,
            "spacing_m": [full.spacing_m, least.spacing_m],
            "swath_m": self.motion.swath_m,
            "lead_in_m": self.motion.lead_in_m,
            # a single line has no turn
            "min_radius_m": round(self._min_radius_m, 6) if math.isfinite(self._min_radius_m) else None,
            "c1": [least.c1, full.c1] if least is not full else None,
            "at_lowest_c1": lowest | (energy and {"energy_wh": least.energy_wh}),
            "blocks": len(self.solution.blocks),
            "parts": len(self.field.parts),
            "obstacles": len(self.field.airspace.obstacles),
            "boundary": bool(self.field.airspace.boundary),
            "origin_deg": origin_deg,
            "field": {"name": self.field.name, "area_m2": self.field.area_m2},
            "left": [each.document(origin_deg) for each in self.left],
            "normalised": list(self.notes),
            "plan": self.text,
            **energy,
            "side_overlap": self._side_overlaps,
            "batteries": self._batteries,
            "slower": self._slower,
            **pictures_document(self.pictures),
            "terrain": None if self.heights is None else HeightReport([self.heights], *self.on_ground).document(),
        }

    @property
    def titled_paths(self) -> dict[str, CoveragePath]:
        """The path at each end of c1 under a title."""
        return {
            f"{counted(end.lines, 'line')}, {end.length_m / 1000:.2f} km, {100 * end.coverage:.2f} % covered": end.path
            for end in self.ends
        }

    def _covers_text(self, end: PathReport) -> str:
        """What the path covers at an end of c1."""
        at = "" if end.spacing_m is None else f" with lines {end.spacing_m:.1f} m apart"
        energy = f", {end.energy_wh:.2f} Wh" if end.energy_wh is not None else ""
        lines = f"{counted(end.lines, 'line')}, {end.length_m / 1000:.2f} km, {end.time_s:.0f} s{energy}"
        return f"{100 * end.coverage:.2f} %{at}: {lines}"

    @property
    def lines(self) -> list[str]:
        """A summary for people, line by line."""
        field, blocks = self.field, len(self.solution.blocks)
        parts = len(field.parts)
        holes = sum(map(len, field.parts)) - parts
        own = {DUBINS: "lines in an order, Dubins turns", ZAMBONI: f"Zamboni-like, {counted(blocks, 'block')}"}
        pattern = own.get(self.solution.pattern, self.solution.pattern)
        lines = [
            f"field      {f'{field.name}, ' if field.name else ''}{field.area_m2 / 1e4:.2f} ha"
            + (f" at {place_text(field.origin_deg)}" if field.origin_deg else "")
            + (f", {parts} parts" if parts > 1 else "")
            + (f", {counted(holes, 'hole')}" if holes else ""),
            f"pattern    {pattern}; lines heading {rounded_deg(self.solution.heading_rad, 1):.1f}°",
            *(f"{'covers' if end is self.full else '':<10} {self._covers_text(end)}" for end in self.ends),
        ]
        obstacles, boundary = field.airspace
        if obstacles or boundary:
            kept = [f"out of {counted(len(obstacles), 'obstacle')}"] if obstacles else []
            kept += ["inside the boundary"] if boundary else []
            lines.append(f"stays      {' and '.join(kept)}")
        lines += self.least.covered.lines()
        tightest = self._min_radius_m
        wide = f"{math.floor(100 * tightest + 1e-6) / 100:.2f} m or wider" if math.isfinite(tightest) else "none"
        lead_in = f"; straight for {self.motion.lead_in_m:g} m before each line" if self.motion.lead_in_m else ""
        lines += [f"turns      {wide}{lead_in}", self.motion.wind_text, *self._climb_text(), *self._landing_text()]
        lines += [] if self.pictures is None else self.pictures.lines()
        if shares := [f"{100 * share:.0f} %" for share in self._side_overlaps if share is not None]:
            lines.append(f"overlap    {' to '.join(dict.fromkeys(shares))} from line to line")
        if self.heights is not None:
            lines += HeightReport([self.heights], *self.on_ground).text()
        elif self.plan.site.home_altitude_m is not None:
            lines.append(HOME_TEXT.format(self.plan.site.home_altitude_m))
        lines += [f"aircraft   {self.aircraft}"] if self.aircraft else []
        if self._batteries is not None and self.pack is not None:
            packs = " to ".join(dict.fromkeys(rounded_text(count, 2) for count in self._batteries))
            until = "its reserve" if self.pack.turns_back_soc <= self.pack.reserve_soc else "the autopilot turns back"
            gives = f"a full one gives {rounded_text(self.pack.energy_wh, 3)} Wh before {until}, no charge lost at once"
            lines.append(f"batteries  {packs}; {gives}")
        elif self.pack is not None and self.pack.energy_wh <= 0:
            lines.append("batteries  none is enough: the autopilot turns back with a full one")
        if (slower := self._slower) is not None:
            least = f"{slower['time_s']:.0f} s, {slower['energy_wh']:.2f} Wh with the densest lines"
            lines.append(
                f"slower     {airspeeds_text(slower['airspeeds_mps'])}: {least}; flown where the charge is short"
            )
        return lines

    def _climb_text(self) -> list[str]:
        """The circles of the climb before the first line."""
        ways = itertools.takewhile(lambda leg: not leg.sensing, self.full.path.legs)
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
        how = f"final approach of {length_m:.0f} m from {before.altitude_m:g} m{ends}, {steep_deg:.1f}°"
        return [f"landing    {how}{circle}"]

"""What a coverage path amounts to: ground covered, length, time and energy, as values, as JSON and as text."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from eadp.core.expressions.tree import number_text
from eadp.core.geometry.bearings import compass_deg
from eadp.core.geometry.geodesy import place_text
from eadp.core.geometry.polygons import covered_share
from eadp.coverage.cover import DUBINS, ZAMBONI, CoverageSolution
from eadp.coverage.left import LeftGround, left_ground, left_text
from eadp.coverage.swaths import CoveragePath, MotionLimits
from eadp.models.field import Field

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
        lines, low = self.solution.path(self.least.c1).sensed_m, self.solution.in_climb_m
        return left_ground(self.field, lines, self.motion, in_climb=low)

    @property
    def seam_m(self) -> float | None:
        """Distance of the lines where the first lines of laps meet the second ones, and blocks meet [m].

        It holds at every c1, as the laps of a block end there; None for a plan without laps.
        """
        return self.solution.blocks[0].layout.pitch_m if self.solution.blocks else None

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
        full, least, motion = self.full, self.least, self.motion
        lines = [
            f"Covers {name} with a swath of {motion.swath_m:g} m and turns of {motion.min_radius_m:g} m or "
            f"more; lines {self._heading_text} deg.",
            f"{_counted(full.lines, 'line')}, {full.length_m:.0f} m",
        ]
        if least is not full:
            lines[1] += f" with a spacing of {full.spacing_m:.4g} m; {least.lines} lines, {least.length_m:.0f} m "
            lines[1] += f"with {least.spacing_m:.4g} m, c1 = {number_text(least.c1)}"
            lines.append(f"A lap less in each block from a spacing of {self._steps_text} m on")
        return lines

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
            "seam_m": self.seam_m,
            "swath_m": self.motion.swath_m,
            "lead_in_m": self.motion.lead_in_m,
            "overshoot_m": self.motion.overshoot_m,
            "min_radius_m": min_radius_m if math.isfinite(min_radius_m) else None,  # a single line has no turn
            "c1": [least.c1, full.c1] if least is not full else None,
            "at_lowest_c1": {"length_m": least.length_m, "time_s": least.time_s, "lines": least.lines},
            "c1_steps": self._steps,
            "blocks": len(solution.blocks),
            "other_pattern_share": solution.other_share,
            "zamboni_time_s": self.laps_s() or None,
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

    def laps_s(self) -> list[float]:
        """Times of the Zamboni-like motion that was not chosen, at its lowest c1 and at c1 = 0 [s]; [] without one."""
        laps = self.solution.laps
        return [] if laps is None else [self.motion.time_s(laps.path(c1).pieces) for c1 in (laps.min_c1, 0.0)]

    def fixed_spacing(self) -> str:
        """What a plan of fixed spacing gives up, and what laps would cost and save; '' for a plan that varies it."""
        if not (times_s := self.laps_s()):
            return ""
        shortest_s, full_s = times_s
        more = 100 * (shortest_s / self.full.time_s - 1)
        return (
            f"fixed: a planner cannot save lines in flight. --pattern zamboni takes {full_s:.0f} s with the densest "
            f"lines and can save {full_s - shortest_s:.0f} s of them, down to {shortest_s:.0f} s ({more:+.0f} %)"
        )

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
        beyond = f"laps turn {self.motion.beyond_m:g} m farther out" if blocks else self.motion.beyond_text
        lines.append(f"turns      {wide}{f'; {beyond}' if self.motion.beyond_m else ''}")
        if solution.laps is not None:
            lines.append(f"spacing    {self.fixed_spacing()}")
        elif not blocks and any(self.field.airspace):
            lines.append("spacing    fixed: a planner cannot save lines in flight, as laps do not keep to the limits")
        elif solution.other_share is not None:
            lines.append(
                f"instead    lines in an order would take {solution.other_share:.2f} times as long as the widest laps"
            )
        return [*lines, self.motion.wind_text]


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"

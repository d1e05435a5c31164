"""A plan at parameters as the path that is exported: sections with what holds on them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

from eadp.core.geometry.curves import CIRCLE, LINE, Point, circle_of
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.models.airspace import EVERYWHERE, Airspace
from eadp.models.plan.stage import LOITER_TO_ALTITUDE, Leg, Stage, leg_points

TOLERANCE_M = 1.0
"""Distance of an exported path from the plan's, by default [m]."""
MAX_HALF_ANGLE_RAD = math.pi / 4
MAX_ACCEPTANCE_M = 255.0
"""Largest acceptance radius that ArduPilot holds [m]."""
CURVE_STEP_M = 5.0


class Arc(NamedTuple):
    """An arc: its centre [m], radius [m], turn (+1 counter-clockwise), start [rad] and angle [rad]."""

    centre_m: Point
    radius_m: float
    turn: int
    start_rad: float
    sweep_rad: float

    def point(self, share: float, out: float = 1.0) -> Point:
        """The point at a share of the arc, `out` times as far from the centre."""
        angle = self.start_rad + self.turn * share * self.sweep_rad
        x, y = self.centre_m
        return x + out * self.radius_m * math.cos(angle), y + out * self.radius_m * math.sin(angle)


@dataclass(frozen=True)
class Section:
    """A stage of the path as flown: a line to its end, an arc, or the points of a curve [m].

    `gain_per_m` is its gain for a path function whose gradient is 1; `first` and `last` are the indices of its legs.
    """

    stage: Stage
    start_m: Point
    end_m: Point
    gain_per_m: float
    arc: Arc | None = None
    points_m: tuple[Point, ...] = ()
    first: int = 0
    last: int = 0

    @property
    def courses_rad(self) -> tuple[float, float]:
        """Directions in which it starts and ends, 0 east, counter-clockwise [rad]."""
        if self.arc is not None:
            first = self.arc.start_rad + self.arc.turn * math.pi / 2
            return first, first + self.arc.turn * self.arc.sweep_rad
        points = [self.start_m, *self.points_m, self.end_m]
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = *points[:2], *points[-2:]
        return math.atan2(y1 - y0, x1 - x0), math.atan2(y3 - y2, x3 - x2)

    def corners(self, tolerance_m: float = math.inf) -> list[tuple[Point, float]]:
        """Points [m] whose fillets are the arc, and how far before them these begin [m]; else its points, with 0.

        The points lie at most a tolerance [m] outside the arc.
        """
        if self.arc is None:
            return [(point, 0.0) for point in self.points_m]
        # a fillet that turns by 2 h begins r tan h before its corner, which lies r (1/cos h − 1) out
        radius_m = self.arc.radius_m
        near = math.acos(radius_m / (radius_m + tolerance_m))
        most = min(MAX_HALF_ANGLE_RAD, math.atan(MAX_ACCEPTANCE_M / radius_m), near)
        count = math.ceil(self.arc.sweep_rad / (2 * most) - 1e-9)
        half = self.arc.sweep_rad / (2 * count)
        begins_m = radius_m * math.tan(half)
        return [(self.arc.point((k + 0.5) / count, 1 / math.cos(half)), begins_m) for k in range(count)]

    def drawn(self, tolerance_m: float) -> list[Point]:
        """Points of the section after its start [m], the path between them within a tolerance [m] of their chords."""
        if self.arc is None:
            return [*self.points_m, self.end_m]
        step = 2 * math.acos(max(1 - tolerance_m / self.arc.radius_m, math.cos(MAX_HALF_ANGLE_RAD)))
        count = math.ceil(self.arc.sweep_rad / step)
        return [self.arc.point((k + 1) / count) for k in range(count)]


@dataclass(frozen=True)
class PlannedPath:
    """What is exported: the sections of a plan at parameters, and what holds on them.

    `altitude_m` holds where a stage has none, and `stated_mps` as its airspeed, None without one; `home_deg` is where
    the aircraft takes off and returns to, None without; `climb_deg` is the pitch of the take-off [°]. `zero_m` is the
    altitude 0 above the sea [m], where it is known: of a plan over terrain.
    Airspeeds are true; `calibrated` is what an autopilot holds over them. `height_m` is home's above the sea, or 0.
    """

    name: str
    sections: tuple[Section, ...]
    origin_deg: Point
    altitude_m: float
    airspeed_mps: float
    home_deg: Point | None = None
    trigger_distance_m: float | None = None
    tolerance_m: float = TOLERANCE_M
    airspace: Airspace = EVERYWHERE
    stated_mps: float | None = None
    climb_deg: float = 0.0
    zero_m: float | None = None
    calibrated: float = 1.0
    height_m: float = 0.0

    def geodetic_deg(self, point: Point) -> Point:
        """Latitude and longitude of a point [m]."""
        return to_geodetic_deg(*point, self.origin_deg)

    def altitude_of(self, section: Section) -> float:
        """The altitude of a section above home [m]."""
        return self.altitude_m if section.stage.altitude_m is None else section.stage.altitude_m

    def airspeed_of(self, section: Section) -> float | None:
        """The airspeed that is stated for a section [m/s]."""
        return self.stated_mps if section.stage.airspeed_mps is None else section.stage.airspeed_mps

    @property
    def home(self) -> Point:
        """Latitude and longitude of home, or of the start of the path."""
        return self.home_deg or self.geodetic_deg(self.sections[0].start_m)

    def drawn(self) -> Iterator[tuple[float, float, float]]:
        """Latitude, longitude [°] and altitude [m] of points along the path: above the sea where `zero_m` is known."""
        first, zero_m = self.sections[0], self.zero_m or 0.0
        yield (*self.geodetic_deg(first.start_m), zero_m + self.altitude_of(first))
        for section in self.sections:
            for point in section.drawn(self.tolerance_m):
                yield (*self.geodetic_deg(point), zero_m + self.altitude_of(section))


def planned_sections(legs: Iterable[Leg]) -> tuple[Section, ...]:
    """The path along legs, its arcs round one circle joined."""
    sections: list[Section] = []
    for index, leg in enumerate(legs):
        section = replace(_section(leg), first=index, last=index)
        before = sections[-1] if sections else None
        if before is not None and before.arc and section.arc and _one_circle(before.arc, section.arc):
            arc = before.arc._replace(sweep_rad=before.arc.sweep_rad + section.arc.sweep_rad)
            stage = before.stage
            if section.stage.command(LOITER_TO_ALTITUDE):  # to the altitude of the last circle
                stage = replace(section.stage, commands=(*stage.commands, *section.stage.commands))
            sections[-1] = replace(before, stage=stage, end_m=section.end_m, arc=arc, last=index)
        elif leg.distance_m > 1e-6:
            sections.append(section)
    return tuple(sections)


def _one_circle(a: Arc, b: Arc) -> bool:
    near = math.dist(a.centre_m, b.centre_m) < 1e-6 and abs(a.radius_m - b.radius_m) < 1e-6
    return near and a.turn == b.turn


def _section(leg: Leg) -> Section:
    stage, (ox, oy) = leg.stage, leg.offset_m
    _, gx, gy, *_ = leg.path(leg.end_m[0] - ox, leg.end_m[1] - oy)
    gain = stage.gain * math.hypot(gx, gy)
    if stage.kind == CIRCLE:
        local = (leg.end_m[0] - ox, leg.end_m[1] - oy)
        circle = circle_of(leg.path, local, stage.sense)
        start = circle.angle_rad((leg.start_m[0] - ox, leg.start_m[1] - oy))
        centre = (circle.centre_m[0] + ox, circle.centre_m[1] + oy)
        arc = Arc(centre, circle.radius_m, circle.turn, start, leg.distance_m / circle.radius_m)
        return Section(stage, arc.point(0.0), arc.point(1.0), gain, arc)
    points = [(point.x_m, point.y_m) for point in leg_points(leg, math.inf if stage.kind == LINE else CURVE_STEP_M)]
    return Section(stage, points[0], points[-1], gain, points_m=tuple(points[1:-1]))

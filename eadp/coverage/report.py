"""What a way over a field amounts to: ground covered, length, time, energy."""

from __future__ import annotations

from dataclasses import dataclass

from eadp.core.geometry.polygons import covered_share
from eadp.coverage.cover import CoverageSolution
from eadp.coverage.swaths import CoveragePath, MotionLimits
from eadp.models.field import Field


@dataclass(frozen=True)
class PowerDraw:
    """Power drawn over the field and on turns [W]: of the motion in level flight, and of the computations."""

    motion_w: float
    computing_w: float
    computing_on_turns_w: float


@dataclass(frozen=True)
class PathReport:
    """A way at one value of c1.

    `energy_wh` is None where nothing is known of the power.
    """

    c1: float
    coverage: float
    length_m: float
    time_s: float
    lines: int
    min_radius_m: float
    energy_wh: float | None


def flown(
    solution: CoverageSolution, field: Field, motion: MotionLimits, c1: float, power: PowerDraw | None = None
) -> PathReport:
    """What a way amounts to at a fixed c1.

    Parameters
    ----------
    solution : Solution
    field : Field
        The field that it covers.
    motion : Motion
        Swath, airspeed and wind.
    c1 : float
        The path parameter.
    power : Power, optional
        For the energy.
    """
    way = solution.way(c1)
    time_s = motion.time_s(way.pieces)
    energy = None
    if power is not None:
        over_s = motion.time_s([leg.piece for leg in way.legs if leg.sensing])
        joules = power.motion_w * time_s + power.computing_w * over_s + power.computing_on_turns_w * (time_s - over_s)
        energy = joules / 3600
    coverage = covered_lines(way, field, motion.swath_m)
    return PathReport(c1, coverage, way.length_m, time_s, way.lines, way.min_radius_m, energy)


def covered_lines(way: CoveragePath, field: Field, swath_m: float) -> float:
    """Share of a field that the lines of a way cover; its turns cover nothing."""
    lines = [(leg.piece.start[:2], leg.piece.end[:2]) for leg in way.legs if leg.sensing]
    return covered_share(field.outline, field.holes, lines, swath_m)

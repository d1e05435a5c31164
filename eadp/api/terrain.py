"""The ground under a coverage: its options, the flight over it, and what is said of its heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.following import RATE_SHARE, Climbing
from eadp.core.geometry.curves import Point
from eadp.coverage.cover import AUTO, DUBINS, CoverageSolution
from eadp.coverage.heights import Ground, HeightLimits, HeightProfile, over_terrain
from eadp.coverage.swaths import MotionLimits
from eadp.errors import InputError
from eadp.io.terrain.reader import read_terrain
from eadp.io.text.options import Flag, check_range
from eadp.models.field import Field
from eadp.models.terrain import ElevationModel
from eadp.models.vehicle import Airframe, PaperVehicle

TOLERANCE_SHARE = 0.1
"""Default of --height-tolerance over --altitude: pixels on the ground are up to so much larger."""

FLAT_M = 1000.0
"""Extent of a field from which on it is said that its ground is taken as flat [m]."""

RELIEF_POINTS, HOME_POINTS = 50, 25
"""Points in a row over a field whose relief is taken, and on a way home."""


@dataclass(frozen=True)
class TerrainOptions:
    """The ground, and how lines follow it."""

    terrain: Annotated[Sequence[str], Flag(metavar="FILE")] = ()
    """Heights of the ground, as GeoTIFF or .hgt of SRTM; several are joined. Lines keep --altitude above it, turns and
    ways --clearance."""

    height_tolerance_m: float | None = None
    """How much higher above the ground lines may be [m]; by default a tenth of --altitude."""


class TerrainTask(NamedTuple):
    """The ground of a field to cover, and how an aircraft follows it.

    `from_ground` is whether the flight starts on the ground.
    """

    terrain: ElevationModel
    limits: HeightLimits
    climbing: Climbing
    from_ground: bool

    @classmethod
    def read(
        cls,
        options: TerrainOptions,
        altitude_m: float | None,
        clearance_m: float,
        field: Field,
        ends: Sequence[Point | None],
        airframe: Airframe,
        airspeed_mps: float,
        from_ground: bool,
    ) -> TerrainTask | None:
        """The ground around a field and the ends of its flight; None where no terrain is given.

        Raises
        ------
        InputError
            Of the files, and where the plan cannot follow a terrain.
        """
        files = [options.terrain] if isinstance(options.terrain, str) else options.terrain
        if not files:
            if options.height_tolerance_m is not None:
                raise _fault("--height-tolerance", "no ground to be above", "--terrain")
            return None
        if altitude_m is None:
            raise _fault("--terrain", "no height to keep above the ground", "--altitude")
        if field.origin_deg is None:
            raise _fault("--terrain", "the field has no place on the earth", "a field in degrees")
        if isinstance(airframe, PaperVehicle):
            raise _fault("--terrain", f"the airframe {airframe.model} holds its own altitude", "another --vehicle")
        tolerance_m = TOLERANCE_SHARE * altitude_m if options.height_tolerance_m is None else options.height_tolerance_m
        check_range("--height-tolerance", tolerance_m, 1, 1000, closed=True)
        if altitude_m < clearance_m:
            raise _fault(
                "--altitude", f"{altitude_m:g} m, less than the clearance", f"--clearance {altitude_m:g} or less"
            )
        points = [*(vertex for part in field.parts for vertex in part[0]), *(end for end in ends if end is not None)]
        terrain = read_terrain(files, np.array(points), field.origin_deg)
        climbing = Climbing(*airframe.climb_rates_mps(airspeed_mps), airframe.altitude_gain_per_s)
        return cls(terrain, HeightLimits(altitude_m, tolerance_m, clearance_m), climbing, from_ground)

    def pattern(self, pattern: str, field: Field) -> str:
        """Lines in an order instead of either pattern, where laps would be too high above the lower ground."""
        if pattern != AUTO:
            return pattern
        corners = np.array([vertex for part in field.parts for vertex in part[0]])
        x, y = np.linspace(corners.min(axis=0), corners.max(axis=0), RELIEF_POINTS).T
        heights_m = self.terrain.heights_m(np.column_stack([each.ravel() for each in np.meshgrid(x, y)]))
        return DUBINS if np.ptp(heights_m[~np.isnan(heights_m)]) > self.limits.tolerance_m else AUTO

    def ground(self, field: Field, start_m: Point, home_m: Point | None) -> Ground:
        """The ground as a flight has it, whose altitude is 0 at home, or at the start."""
        zero_m = round(float(self.terrain.known_m(np.array([home_m or start_m]))[0]), 2)  # as a plan has it
        return Ground(self.terrain, zero_m, field.airspace)

    def flown(
        self, solution: CoverageSolution, ground: Ground, motion: MotionLimits, apart_m: float
    ) -> tuple[CoverageSolution, HeightProfile]:
        """A path with its altitudes, see `over_terrain`."""
        start_m = 0.0 if self.from_ground else None
        return over_terrain(solution, ground, self.limits, motion, self.climbing, apart_m, start_m)


class Heights(NamedTuple):
    """The heights of a flight: its profile, its ground, home [m], and the least ground speed of a climb [m/s]."""

    profile: HeightProfile
    ground: Ground
    home_m: Point
    task: TerrainTask
    ground_limit_mps: float

    @property
    def home_altitude_m(self) -> int:
        """Altitude at which every straight way home is clear of the ground [m]."""
        points_m = self.profile.points_m[:: max(1, len(self.profile.points_m) // 200)]
        shares = np.linspace(0, 1, HOME_POINTS)[:, None, None]
        ways_m = (np.array(self.home_m) + shares * (points_m - np.array(self.home_m))).reshape(-1, 2)
        return math.ceil(float(self.ground.heights_m(ways_m).max()) + self.profile.limits.clearance_m)

    def overlaps(self, width_m: float, apart_m: float | None) -> list[float] | None:
        """Least, mean and greatest share of a picture that the next line shows too."""
        if apart_m is None:
            return None
        # a picture is as wide as its height above the ground
        shares = 1 - apart_m / (width_m * self.profile.overlapping_m / self.profile.limits.line_m)
        return _range(shares)

    def pixels_cm(self, gsd_cm: float | None) -> list[float] | None:
        """Least, mean and greatest size of a pixel on the ground [cm]."""
        return None if gsd_cm is None else _range(gsd_cm * self.profile.above_m / self.profile.limits.line_m)

    def document(self, width_m: float, apart_m: float | None, gsd_cm: float | None) -> dict[str, Any]:
        """Its values in `eadp.cover/1`."""
        profile = self.profile
        return {
            "zero_m": self.ground.zero_m,
            "ground_m": [float(profile.ground_m.min()), float(profile.ground_m.max())],
            "height_m": _range(profile.above_m),
            "height_elsewhere_m": profile.elsewhere_m,
            "higher_share": profile.high_share,
            "altitudes": profile.commanded,
            "home_altitude_m": self.home_altitude_m,
            "gsd_cm": self.pixels_cm(gsd_cm),
            "side_overlap": self.overlaps(width_m, apart_m),
        }

    def text(self, width_m: float, apart_m: float | None, gsd_cm: float | None) -> list[str]:
        """For people."""
        profile, (least, mean, most) = self.profile, _range(self.profile.above_m)
        low, high = profile.ground_m.min(), profile.ground_m.max()
        elsewhere = "" if profile.elsewhere_m is None else f", {profile.elsewhere_m:.0f} m or more elsewhere"
        lines = [
            f"ground     {low:.0f} to {high:.0f} m above home, {self.ground.zero_m:.0f} m above the sea; "
            f"{profile.commanded} altitude{'s' * (profile.commanded > 1)}",
            f"height     {least:.1f} to {most:.1f} m above ground on lines, mean {mean:.1f} m{elsewhere}",
        ]
        if profile.high_share and profile.commanded == 1:
            lines[1] += "; laps have one altitude, lines of --pattern dubins follow the ground"
        elif profile.high_share:
            able = [100 * RATE_SHARE * rate / self.ground_limit_mps for rate in self.task.climbing[:2]]
            latitude, longitude = profile.highest
            lines.append(
                f"           {100 * profile.high_share:.0f} % of the lines higher than "
                f"{profile.limits.line_m + profile.limits.tolerance_m:g} m, most at {latitude:.5f},{longitude:.5f}: "
                f"slopes are up to {100 * profile.steepest:.0f} %, the aircraft follows {able[0]:.0f} % up and "
                f"{able[1]:.0f} % down"
            )
        shares, pixels = self.overlaps(width_m, apart_m), self.pixels_cm(gsd_cm)
        said = [] if pixels is None else [f"pixels of {pixels[0]:.2g} to {pixels[2]:.2g} cm, mean {pixels[1]:.2g} cm"]
        if shares is not None:
            said.append(f"overlap {100 * shares[0]:.0f} to {100 * shares[2]:.0f} %, mean {100 * shares[1]:.0f} %")
        lines += [f"on ground  {'; '.join(said)}"] if said else []
        return [*lines, f"way home   above the ground at {self.home_altitude_m} m (home.altitude_m, RTL_ALTITUDE)"]


def height_range_m(heights: Sequence[Heights]) -> list[float] | None:
    """Least, mean and greatest height above ground on the lines of some flights [m]; None without one."""
    return _range(np.concatenate([each.profile.above_m for each in heights])) if heights else None


def _range(values: FloatArray) -> list[float]:
    """Least, mean and greatest."""
    return [float(values.min()), float(values.mean()), float(values.max())]


def _fault(option: str, message: str, expected: str) -> InputError:
    return InputError.at(option, 1, 1, message, expected)

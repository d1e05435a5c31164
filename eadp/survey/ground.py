"""The ground under a coverage: its options, the flight over it, and what is said of its heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import Point
from eadp.core.geometry.geodesy import compass_deg
from eadp.errors import Infeasible, InputError
from eadp.io.text.options import Flag, check_range
from eadp.models.airspace import CLEARANCE_M, Field
from eadp.survey.coverage import AUTO, DUBINS, ZAMBONI
from eadp.survey.heights import FinalApproach, Ground, HeightLimits, HeightProfile, low_approach
from eadp.survey.swaths import MotionLimits
from eadp.survey.terrain import ElevationModel, read_terrain

TOLERANCE_SHARE = 0.1
"""Default of --height-tolerance over --altitude: pixels on the ground are up to so much larger."""

FLAT_M = 1000.0
"""Extent of a field from which on it is said that its ground is taken as flat [m]."""

HOME_POINTS = 25
"""Points in a row on a way home."""

HOME_TEXT = "way home   clear of ground and obstacles at {:g} m (home.altitude_m, RTL_ALTITUDE)"
"""What is said of the altitude of the way home."""

WAYS_HOME = 200
"""Ways home that are tried, at least."""


@dataclass(frozen=True)
class TerrainOptions:
    """The ground, and how lines follow it."""

    SECTION: ClassVar = "Ground"

    terrain: Annotated[Sequence[str], Flag(metavar="FILE")] = ()
    """Heights of the ground, as GeoTIFF or .hgt of SRTM; several are joined. Lines keep --altitude above it, turns and
    ways --clearance."""

    height_tolerance_m: float | None = None
    """How much higher above the ground lines may be [m]; by default a tenth of --altitude."""


class TerrainTask(NamedTuple):
    """The ground of a field to cover, and the heights above it that a flight keeps."""

    terrain: ElevationModel
    limits: HeightLimits

    @classmethod
    def read(
        cls,
        options: TerrainOptions,
        altitude_m: float | None,
        clearance_m: float,
        field: Field,
        ends: Sequence[Point | None],
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
                raise InputError.at("--height-tolerance", 1, 1, "no ground to be above", "--terrain")
            return None
        if altitude_m is None:
            raise InputError.at("--terrain", 1, 1, "no height to keep above the ground", "--altitude")
        if field.origin_deg is None:
            raise InputError.at("--terrain", 1, 1, "the field has no place on the earth", "a field in degrees")
        tolerance_m = TOLERANCE_SHARE * altitude_m if options.height_tolerance_m is None else options.height_tolerance_m
        check_range("--height-tolerance", tolerance_m, 1, 1000, closed=True)
        if altitude_m < clearance_m:
            message = f"{altitude_m:g} m, less than the clearance"
            raise InputError.at("--altitude", 1, 1, message, f"--clearance {altitude_m:g} or less")
        points = [*(vertex for part in field.parts for vertex in part[0]), *(end for end in ends if end is not None)]
        terrain = read_terrain(files, np.array(points), field.origin_deg)
        return cls(terrain, HeightLimits(altitude_m, tolerance_m, clearance_m))

    @staticmethod
    def pattern(pattern: str, *, lands: bool) -> str:
        """Lines in an order instead of either pattern: laps have one altitude, too high above the lower ground.

        Raises Infeasible where laps are asked for, and a landing.
        """
        if pattern == ZAMBONI and lands:
            raise Infeasible("laps have one altitude, and over terrain the final approach another", "--pattern dubins")
        return DUBINS if pattern == AUTO else pattern

    def ground(self, field: Field, motion: MotionLimits, apart_m: float, zero: Point) -> Ground:
        """The ground of a flight whose altitudes are 0 at a place [m]. Raises Infeasible where it is not known."""
        zero_m = round(float(self.terrain.known_m(np.array([zero]))[0]), 2)  # as a plan has it
        return Ground(self.terrain, zero_m, self.limits, motion, apart_m, field.airspace)

    def check_approach(self, final: FinalApproach, ground: Ground) -> None:
        """Raise Infeasible where a final approach comes too near to the ground."""
        if (low := low_approach(final, ground)) is None:
            return
        place, above_m, min_m = low
        message = f"the final approach towards {compass_deg(final.leg.start[2]) % 360:.0f}° "
        if above_m > 0:
            message += f"is {above_m:.1f} m above the ground at {place}, {min_m - above_m:.2g} m less than it has to be"
        else:
            message += f"leads into the ground at {place}"
        raise Infeasible(message)


class Heights(NamedTuple):
    """The heights of a flight over its ground: its profile, and home [m]."""

    profile: HeightProfile
    home_m: Point

    @property
    def home_altitude_m(self) -> int:
        """Altitude at which every straight way home is clear of ground and obstacles [m]."""
        ground, points_m = self.profile.ground, self.profile.samples.points_m
        top_m = ground.airspace.top_on_ways_m(points_m, self.home_m, CLEARANCE_M)
        ends_m = points_m[:: max(1, len(points_m) // WAYS_HOME)] - np.array(self.home_m)
        ways_m = np.array(self.home_m) + np.linspace(0, 1, HOME_POINTS)[:, None, None] * ends_m
        top_m = max(float(ground.heights_m(ways_m.reshape(-1, 2)).max()), top_m)
        return math.ceil(top_m + ground.limits.clearance_m)


class HeightReport(NamedTuple):
    """The heights of one flight, or of sorties together.

    `width_m` is that of a picture on lines at their height, `apart_m` the distance of the lines [m], and `gsd_cm` the
    size of a pixel [cm].
    """

    flights: Sequence[Heights]
    width_m: float
    apart_m: float | None
    gsd_cm: float | None

    def _joined(self, name: str) -> FloatArray:
        """An array of all profiles."""
        return np.concatenate([getattr(each.profile, name) for each in self.flights])

    @property
    def home_altitude_m(self) -> int:
        """Altitude at which every straight way home is clear of ground and obstacles [m]."""
        return max(each.home_altitude_m for each in self.flights)

    def document(self) -> dict[str, Any]:
        """Its values in `eadp.cover/1` and `eadp.sorties/1`."""
        ground, above_m, ground_m = self.flights[0].profile.ground, self._joined("above_m"), self._joined("ground_m")
        line_m, elsewhere_m = ground.limits.line_m, [each.profile.elsewhere_m for each in self.flights]
        higher = [each.profile.high_share for each in self.flights]
        # pictures are as wide as their height above the ground
        widths_m = self.width_m * self._joined("overlapping_m") / line_m
        return {
            "zero_m": ground.zero_m,
            "ground_m": [float(ground_m.min()), float(ground_m.max())],
            "height_m": _range(above_m),
            "height_elsewhere_m": min((up_m for up_m in elsewhere_m if up_m is not None), default=None),
            "higher_share": float(np.average(higher, weights=[len(each.profile.above_m) for each in self.flights])),
            "altitudes": sum(len(each.profile.commanded_m) for each in self.flights),
            "home_altitude_m": self.home_altitude_m,
            "gsd_cm": None if self.gsd_cm is None else _range(self.gsd_cm * above_m / line_m),
            "side_overlap": None if self.apart_m is None else _range(1 - self.apart_m / widths_m),
        }

    def text(self) -> list[str]:
        """For people, of the same."""
        values, highest = self.document(), max(self.flights, key=lambda each: each.profile.above_m.max()).profile
        limits = highest.ground.limits
        (low, high), elsewhere_m = values["ground_m"], values["height_elsewhere_m"]
        least, mean, most = values["height_m"]
        elsewhere = "" if elsewhere_m is None else f", {elsewhere_m:.0f} m or more elsewhere"
        lines = [
            f"ground     {round(low)} to {round(high)} m above home, {values['zero_m']:.0f} m above the sea; "
            f"{values['altitudes']} altitude{'s' * (values['altitudes'] > 1)}",
            f"height     {least:.1f} to {most:.1f} m above ground on lines, mean {mean:.1f} m{elsewhere}",
        ]
        if share := 100 * values["higher_share"]:
            limit_m = limits.line_m + limits.tolerance_m
            lines.append(
                f"           {share:.0f} % of the lines higher than {limit_m:g} m, most at {highest.max_place_text}"
            )
        said = []
        if (pixels := values["gsd_cm"]) is not None:
            said.append(f"pixels of {pixels[0]:.2g} to {pixels[2]:.2g} cm, mean {pixels[1]:.2g} cm")
        if (shares := values["side_overlap"]) is not None:
            least, mean, most = (100 * share for share in shares)
            said.append(f"overlap {least:.0f} to {most:.0f} %, mean {mean:.0f} %")
        lines += [f"on ground  {'; '.join(said)}"] if said else []
        return [*lines, HOME_TEXT.format(values["home_altitude_m"])]


def _range(values: FloatArray) -> list[float]:
    """Least, mean and greatest."""
    return [float(values.min()), float(values.mean()), float(values.max())]

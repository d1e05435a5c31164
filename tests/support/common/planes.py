"""A field on a ground that is a function of the place, and how it is flown."""

import numpy as np

from eadp.core.geometry.geodesy import to_local_m
from eadp.models.airspace import Airspace, Field
from eadp.survey.heights import Climbing, Ground, HeightLimits
from eadp.survey.swaths import MotionLimits
from eadp.survey.terrain import ElevationModel, Tile

LIMITS = HeightLimits(80.0, 8.0, 20.0)
WING = Climbing(3.0, 1.6, 0.5)
MOTION = MotionLimits(50.0, 40.0, 60.0, 25.0)
ORIGIN = (55.5, 10.5)
FIELD = Field(((0.0, 0.0), (600.0, 0.0), (600.0, 300.0), (0.0, 300.0)), origin_deg=ORIGIN)
ZERO_M = 120.0


def ground(height, obstacles=()):
    """The ground of a function of x and y [m], from cells of 10 m; by 0 at `ZERO_M` above the sea."""
    rows, columns = np.mgrid[-200:201, -200:201]
    heights_m = ZERO_M + height(10.0 * columns, -10.0 * rows)

    def cells(latitudes, longitudes):
        x, y = np.array([to_local_m(*place, ORIGIN) for place in zip(latitudes, longitudes, strict=True)]).T
        return 200 - y / 10, 200 + x / 10

    terrain = ElevationModel((Tile(heights_m, cells),), ORIGIN)
    return Ground(terrain, (0.0, 0.0), ZERO_M, LIMITS, MOTION, 50.0, Airspace(tuple(obstacles)))

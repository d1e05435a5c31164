"""The wind that a flight plans with: measured or forecast where it is, else of ground velocities and headings."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.wind import WindFilter
from eadp.core.geometry.curves import Point
from eadp.planning.state.heading_gate import HeadingGate
from eadp.planning.state.known import WindKnown

MEASURED_WIND_S = 60.0
"""How long a measured wind is used [s]."""


class FlightWind:
    """The wind of a flight; see the module.

    Attributes
    ----------
    headings : HeadingGate
        Whether headings are believed.
    """

    def __init__(self, gust_time_s: float) -> None:
        self.headings = HeadingGate()
        self._filter = WindFilter(gust_time_s)
        self._measured: tuple[Point, float] | None = None  # [m/s], and until when it is used [s]

    def forecast(self, wind_mps: Point) -> None:
        """Plan with the wind of a weather forecast [m/s], until another one is measured."""
        self._measured = wind_mps, math.inf

    def measure(self, wind_mps: Point, time_s: float) -> None:
        """Plan with a measured wind [m/s], for `MEASURED_WIND_S` from a time on [s]."""
        self._measured = wind_mps, time_s + MEASURED_WIND_S

    def ingest(
        self,
        velocities_mps: tuple[FloatArray, FloatArray],
        headings_rad: FloatArray,
        steps_s: FloatArray,
        airspeeds_mps: FloatArray,
        time_s: float,
    ) -> None:
        """Update the estimate with ground velocities and headings, NaN for none; also while another wind is used.

        All are of shape (n,). `steps_s` are the times since the reading before [s], `time_s` is that of the last one.
        """
        vx, vy = velocities_mps
        believed = np.asarray(self.headings.ingest(vx, vy, headings_rad, steps_s, airspeeds_mps, self._filter))
        if self._measured is not None and time_s > self._measured[1]:
            self._measured = None
        moving = steps_s > 0
        self._filter.ingest(*(column[moving] for column in (vx, vy, believed, steps_s, airspeeds_mps)))

    @property
    def mps(self) -> Point:
        """The wind to plan with [m/s]."""
        return self._filter.wind_mps if self._measured is None else self._measured[0]

    @property
    def gust_std_mps(self) -> float:
        """Standard deviation of gusts, of each component [m/s]."""
        return self._filter.gust_std_mps

    @property
    def known(self) -> WindKnown:
        """The wind, and how well it is known."""
        return WindKnown(self.mps, self._filter.covariance if self._measured is None else (0.0, 0.0, 0.0))

"""The simulated aircraft in wind. It knows nothing of planners."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.derivatives import PathFunction
from eadp.core.geometry import Point
from eadp.core.guidance import heading_rate_radps, normalised_jet, wind_factor
from eadp.models.vehicle import Guidance, PaperVehicle
from eadp.models.weather import Wind


class PaperAircraft:
    """The aircraft of the published flights, stepped in the order they step it.

    Source: docs/reproduction.md "One step", from the letter's published flights.
    """

    def __init__(
        self,
        vehicle: PaperVehicle,
        guidance: Guidance,
        wind_mps: Point,
        position: Point,
        heading_rad: float,
        altitude_m: float,
    ) -> None:
        self._v = vehicle
        self._guidance = guidance
        self._published_guidance = not (guidance.normalised or guidance.wind_corrected)
        self.x_m, self.y_m = position
        self.heading_rad = heading_rad
        self.altitude_m = altitude_m
        self.climb_mps = 0.0
        self.air_x, self.air_y = (
            vehicle.airspeed_mps * math.cos(heading_rad),
            vehicle.airspeed_mps * math.sin(heading_rad),
        )
        self.vx, self.vy = self.air_x + wind_mps[0], self.air_y + wind_mps[1]

    def step(self, path: PathFunction, offset: Point, gain: float, sense: int, wind_mps: Point, step_s: float) -> float:
        """Fly one step along a path; return the motion power over it [W].

        Parameters
        ----------
        path : function
            The stage's path function in its own frame, which lies `offset` [m] from the local frame.
        gain, sense
            k_e and the direction of travel of the stage.
        wind_mps : (float, float)
            Wind [m/s].
        step_s : float
            Length of the step [s].

        Raises
        ------
        ArithmeticError, ValueError
            If the path function has no value here.
        """
        v = self._v
        # 1. guidance from the old position and the previous velocity
        jet = path(self.x_m - offset[0], self.y_m - offset[1])
        if self._published_guidance:
            rate = heading_rate_radps(jet, self.vx, self.vy, gain, self._guidance.k_d, sense)
        else:
            rate = self._rate(jet, gain, sense)
        # 2. altitude by throttle
        throttle = v.altitude_gain * (v.cruise_altitude_m - self.altitude_m) - v.climb_gain * self.climb_mps
        airspeed = v.speed_per_throttle_mps * (v.nominal_throttle + throttle)
        heading = self.heading_rad
        c, s = math.cos(heading), math.sin(heading)
        lift_speed = airspeed
        if v.wind_in_lift:
            lift_speed += wind_mps[0] * c + wind_mps[1] * s
        lift = v.lift_coefficient * lift_speed * lift_speed
        self.climb_mps += (lift - v.weight_n) / v.mass_kg * step_s
        self.altitude_m += self.climb_mps * step_s
        # 3. position, then heading
        self.air_x, self.air_y = airspeed * c, airspeed * s
        self.vx, self.vy = self.air_x + wind_mps[0], self.air_y + wind_mps[1]
        self.x_m += self.vx * step_s
        self.y_m += self.vy * step_s
        heading += rate * step_s
        self.heading_rad = heading if -math.pi < heading <= math.pi else _wrapped(heading)
        return v.throttle_power_w * (v.nominal_throttle + throttle) / 100 + v.idle_power_w

    def _rate(self, jet: tuple[float, float, float, float, float, float], gain: float, sense: int) -> float:
        g = self._guidance
        if g.normalised:
            jet, gain = normalised_jet(jet), g.gain_per_m
        rate = heading_rate_radps(jet, self.vx, self.vy, gain, g.k_d, sense)
        if g.wind_corrected:
            rate *= wind_factor(self.vx, self.vy, self.air_x, self.air_y)
        return rate


def _wrapped(heading: float) -> float:
    if not math.isfinite(heading):
        raise ValueError("the heading is not finite")
    return math.remainder(heading, 2 * math.pi)


class Gusts:
    """First-order coloured wind on each axis, exact for any step.

    Source: Gauss-Markov process, w⁺ = a w + σ√(1 − a²) n with a = exp(−Δt/τ).
    """

    def __init__(self, wind: Wind, step_s: float, rng: np.random.Generator) -> None:
        self._steady = wind.steady_mps
        self._std = wind.gust_std_mps
        self._a = math.exp(-step_s / wind.gust_time_s)
        self._b = wind.gust_std_mps * math.sqrt(1 - self._a**2)
        self._rng = rng
        self._noise: list[float] = []
        first = rng.standard_normal(2) * wind.gust_std_mps
        self._gust = (float(first[0]), float(first[1]))

    def next_mps(self) -> Point:
        """The wind of the next step [m/s]."""
        if not self._std:
            return self._steady
        if not self._noise:
            self._noise = self._rng.standard_normal(2000).tolist()
        pop = self._noise.pop
        gx = self._a * self._gust[0] + self._b * pop()
        gy = self._a * self._gust[1] + self._b * pop()
        self._gust = (gx, gy)
        return self._steady[0] + gx, self._steady[1] + gy

"""The simulated aircraft in wind. It knows nothing of planners."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.aerodynamics import GRAVITY_MPS2
from eadp.core.derivatives import PathFunction
from eadp.core.geometry import Point
from eadp.core.guidance import heading_rate_radps, normalised_jet, wind_factor
from eadp.models.vehicle import FixedWing, Guidance, PaperVehicle, Vehicle
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


class FixedWingAircraft:
    """A fixed-wing aircraft: bank for the heading rate that is asked for, throttle for airspeed and climb.

    Point-mass dynamics with first-order roll; the wind is the air's motion, and a gust changes the airspeed before it
    changes the aircraft's motion.

    Source: Beard and McLain 2012, chapter 9 (guidance models) for the shape of the model; Anderson 1999 for the forces.
    """

    def __init__(
        self,
        vehicle: FixedWing,
        guidance: Guidance,
        wind_mps: Point,
        position: Point,
        heading_rad: float,
        altitude_m: float,
    ) -> None:
        self._v = vehicle
        self._guidance = guidance
        self.x_m, self.y_m = position
        self.heading_rad = heading_rad
        self.altitude_m = altitude_m
        self.climb_mps = 0.0
        self.bank_rad = 0.0
        self.airspeed_mps = vehicle.airspeed_mps
        self._wind = wind_mps
        self._most_bank = math.radians(vehicle.most_bank_deg)
        self._weight = vehicle.weight_n
        density_area = 0.5 * vehicle.air_density_kgpm3 * vehicle.wing_area_m2
        # D = ½ρS C_D0 V² + K (n W)² / (½ρS V²): the two coefficients
        self._parasitic = density_area * vehicle.zero_lift_drag
        self._induced = vehicle.induced_drag * self._weight**2 / density_area
        self._slowest = 0.5 * vehicle.stall_mps
        self.vx = vehicle.airspeed_mps * math.cos(heading_rad) + wind_mps[0]
        self.vy = vehicle.airspeed_mps * math.sin(heading_rad) + wind_mps[1]

    def step(self, path: PathFunction, offset: Point, gain: float, sense: int, wind_mps: Point, step_s: float) -> float:
        """Fly one step along a path; return the motion power over it [W]. See `PaperAircraft.step`."""
        v, g = self._v, self._guidance
        heading, speed = self.heading_rad, self.airspeed_mps
        c, s = math.cos(heading), math.sin(heading)
        # 1. guidance: the heading rate that follows the path, held by a bank within its limit
        jet = path(self.x_m - offset[0], self.y_m - offset[1])
        if g.normalised:
            jet, gain = normalised_jet(jet), g.gain_per_m
        rate = heading_rate_radps(jet, self.vx, self.vy, gain, g.k_d, sense)
        if g.wind_corrected:
            rate *= wind_factor(self.vx, self.vy, speed * c, speed * s)
        bank = math.atan(rate * speed / GRAVITY_MPS2)
        bank = min(max(bank, -self._most_bank), self._most_bank)
        self.bank_rad += (bank - self.bank_rad) * (1 - math.exp(-step_s / v.roll_time_s))
        cosine = math.cos(self.bank_rad)
        turn = GRAVITY_MPS2 * math.sin(self.bank_rad) / (cosine * speed)  # g tan φ / V
        # 2. climb, at once but within its limit; airspeed by the throttle, which knows drag and climb
        wanted = v.altitude_gain_per_s * (v.cruise_altitude_m - self.altitude_m)
        climb = min(max(wanted, -v.most_climb_mps), v.most_climb_mps)
        square = speed * speed
        drag = self._parasitic * square + self._induced / (cosine * cosine * square)
        needed = drag + self._weight * climb / speed + v.mass_kg * v.speed_gain_per_s * (v.airspeed_mps - speed)
        motor_w = needed * speed / v.propulsive_efficiency  # P = T V / η
        if motor_w < 0.0:
            motor_w = 0.0
        elif motor_w > v.most_power_w:
            motor_w = v.most_power_w
        thrust = motor_w * v.propulsive_efficiency / speed
        gust = ((wind_mps[0] - self._wind[0]) * c + (wind_mps[1] - self._wind[1]) * s) / step_s
        self._wind = wind_mps
        # m V̇ = T − D − W sin γ, less the air's own acceleration along the heading
        speed += ((thrust - drag - self._weight * climb / speed) / v.mass_kg - gust) * step_s
        self.airspeed_mps = speed = max(speed, self._slowest)
        self.climb_mps = climb
        self.altitude_m += climb * step_s
        # 3. position, then heading
        self.vx, self.vy = speed * c + wind_mps[0], speed * s + wind_mps[1]
        self.x_m += self.vx * step_s
        self.y_m += self.vy * step_s
        heading += turn * step_s
        self.heading_rad = heading if -math.pi < heading <= math.pi else _wrapped(heading)
        return motor_w + v.avionics_w


Aircraft = PaperAircraft | FixedWingAircraft


def make_aircraft(
    vehicle: Vehicle, guidance: Guidance, wind_mps: Point, position: Point, heading_rad: float, altitude_m: float
) -> Aircraft:
    """The aircraft of a vehicle's model, ready to fly."""
    model = FixedWingAircraft if isinstance(vehicle, FixedWing) else PaperAircraft
    return model(vehicle, guidance, wind_mps, position, heading_rad, altitude_m)  # type: ignore[arg-type]


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

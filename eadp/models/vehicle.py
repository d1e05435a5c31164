"""Constants of the simulated aircraft."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from eadp.core.flight.aerodynamics import (
    GRAVITY_MPS2,
    drag_n,
    induced_drag_factor,
    lift_coefficient,
    load_factor,
    speed_of_least_power_mps,
)


@dataclass(frozen=True, slots=True)
class PaperVehicle:
    """The aircraft of the published flights: a heading, a throttle that holds the altitude, and power from throttle.

    Source: the letter's published flights (docs/reproduction.md); `wind_in_lift` and `published_triggers` are theirs.
    """

    mass_kg: float = 1.0
    weight_n: float = 9.8
    lift_coefficient: float = 9.8 / 15**2
    speed_per_throttle_mps: float = 15 / 50
    nominal_throttle: float = 50.0
    altitude_gain: float = 5.0
    climb_gain: float = 5.0
    cruise_altitude_m: float = 25.0
    idle_power_w: float = 16.0
    throttle_power_w: float = 20.0
    wind_in_lift: bool = False
    published_triggers: bool = False

    @property
    def airspeed_mps(self) -> float:
        """Airspeed in level flight [m/s]."""
        return self.speed_per_throttle_mps * self.nominal_throttle

    @property
    def cruise_power_w(self) -> float:
        """Motion power in level flight [W]."""
        return self.idle_power_w + self.throttle_power_w * self.nominal_throttle / 100


@dataclass(frozen=True)
class FixedWing:
    """A small electric aeroplane: a drag polar, a propulsion of one efficiency, and limits of throttle, bank and climb.

    The defaults are those of a flying wing of 1.2 m span for surveys: 36 W at 15 m/s, of which the published survey
    flight of such a wing drew 30 to 40 W (docs/fixed-wing.md).

    Attributes
    ----------
    mass_kg, wing_area_m2, aspect_ratio, oswald_efficiency, zero_lift_drag : float
        Mass [kg], wing area [m²], aspect ratio A, Oswald's e and C_D0 of the polar C_D = C_D0 + C_L²/(π e A).
    highest_lift : float
        C_L at which the wing stalls.
    propulsive_efficiency, avionics_w, most_power_w : float
        From electrical to thrust power; what flies along whatever the throttle [W]; the motor's limit [W].
    airspeed_mps, cruise_altitude_m : float
        What is held [m/s, m].
    most_bank_deg, roll_time_s, most_climb_mps : float
        Limits of bank [°] and climb [m/s], and how fast a bank is reached [s].
    speed_gain_per_s, altitude_gain_per_s : float
        How fast errors of airspeed and altitude are taken out [1/s].
    """

    mass_kg: float = 1.2
    wing_area_m2: float = 0.32
    aspect_ratio: float = 4.5
    oswald_efficiency: float = 0.8
    zero_lift_drag: float = 0.022
    highest_lift: float = 1.1
    air_density_kgpm3: float = 1.225
    propulsive_efficiency: float = 0.55
    avionics_w: float = 2.0
    most_power_w: float = 200.0
    airspeed_mps: float = 15.0
    cruise_altitude_m: float = 25.0
    most_bank_deg: float = 45.0
    roll_time_s: float = 0.3
    most_climb_mps: float = 3.0
    speed_gain_per_s: float = 1.0
    altitude_gain_per_s: float = 0.5

    @cached_property
    def weight_n(self) -> float:
        """Weight [N]."""
        return self.mass_kg * GRAVITY_MPS2

    @cached_property
    def induced_drag(self) -> float:
        """K of the drag polar."""
        return induced_drag_factor(self.aspect_ratio, self.oswald_efficiency)

    def drag_n(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Drag in level flight [N], in a bank with its load factor."""
        load = self.weight_n * load_factor(bank_rad)
        area, density = self.wing_area_m2, self.air_density_kgpm3
        return drag_n(load, airspeed_mps, area, density, self.zero_lift_drag, self.induced_drag)

    def level_power_w(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Electrical power in level flight [W]: D V/η and the avionics'."""
        # P = D V / η
        return self.drag_n(airspeed_mps, bank_rad) * airspeed_mps / self.propulsive_efficiency + self.avionics_w

    @property
    def cruise_power_w(self) -> float:
        """Motion power in straight level flight at the airspeed held [W]."""
        return self.level_power_w(self.airspeed_mps)

    @property
    def stall_mps(self) -> float:
        """Airspeed at which the wing stalls in straight flight [m/s]."""
        return math.sqrt(2 * self.weight_n / (self.air_density_kgpm3 * self.wing_area_m2 * self.highest_lift))

    @property
    def least_power_mps(self) -> float:
        """Airspeed of least power [m/s], the avionics' left out."""
        area, density = self.wing_area_m2, self.air_density_kgpm3
        return speed_of_least_power_mps(self.weight_n, area, density, self.zero_lift_drag, self.induced_drag)

    def lift_coefficient(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """C_L in level flight."""
        load = self.weight_n * load_factor(bank_rad)
        return lift_coefficient(load, airspeed_mps, self.wing_area_m2, self.air_density_kgpm3)

    def faults(self) -> list[str]:
        """Why it cannot fly as it is meant to, if it cannot."""
        found = []
        if self.airspeed_mps <= self.stall_mps:
            found.append(f"an airspeed of {self.airspeed_mps:g} m/s is below the stall's {self.stall_mps:.1f} m/s")
        elif self.lift_coefficient(self.airspeed_mps, math.radians(self.most_bank_deg)) > self.highest_lift:
            found.append(f"at a bank of {self.most_bank_deg:g}° and {self.airspeed_mps:g} m/s the wing stalls")
        motor_w = self.cruise_power_w - self.avionics_w
        if motor_w > self.most_power_w:
            found.append(f"level flight takes {motor_w:.0f} W of a motor of {self.most_power_w:g} W")
        return found


Vehicle = PaperVehicle | FixedWing


@dataclass(frozen=True, slots=True)
class Guidance:
    """How the vehicle follows a path. k_e is the plan's gain per stage.

    `normalised` follows φ/‖∇φ‖ with the one gain `gain_per_m` instead; `wind_corrected` turns the heading as much
    faster as the course needs in wind.
    """

    k_d: float = 1.0
    wind_corrected: bool = True
    normalised: bool = False
    gain_per_m: float = 0.05

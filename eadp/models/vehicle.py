"""Constants of the simulated aircraft."""

from __future__ import annotations

from dataclasses import dataclass


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

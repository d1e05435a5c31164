"""Forces on a fixed-wing aircraft in steady flight, straight or banked: a drag polar and what follows from it.

Source: Anderson 1999, chapters 2 (drag polar), 5 (drag and power required in level flight) and 6 (level turns).
"""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import FloatArray

RATE_SHARE = 0.8
"""Share of the greatest rates of climb and descent that the ground may ask for: turns and gusts take the rest."""

GRAVITY_MPS2 = 9.80665
SEA_LEVEL_KGPM3 = 1.225
"""Density of the standard atmosphere at the sea, for which calibrated airspeeds are true ones [kg/m³]."""


def air_density_kgpm3(height_m: FloatArray | float) -> FloatArray:
    """Density of the standard atmosphere at a height above the sea [m], any shape [kg/m³].

    Source: ISO 2533, the troposphere.
    """
    # ρ = ρ0 (1 − L h/T0)^(g M/(R L) − 1), L/T0 = 0.0065 K/m / 288.15 K
    return np.asarray(SEA_LEVEL_KGPM3 * np.maximum(1 - 2.25577e-5 * np.asarray(height_m), 0.1) ** 4.25588)


def calibrated_share(density_kgpm3: FloatArray | float) -> FloatArray:
    """Calibrated over true airspeed in air of a density [kg/m³], any shape: that of equal dynamic pressure.

    Source: Anderson 1999, chapter 2; what pitot tubes measure, and autopilots hold, at small aircraft's speeds.
    """
    # ½ ρ0 V_c² = ½ ρ V²
    return np.asarray(np.sqrt(np.asarray(density_kgpm3) / SEA_LEVEL_KGPM3))


def dynamic_pressure_pa(airspeed_mps: float, density_kgpm3: float) -> float:
    """q = ½ ρ V² [Pa]."""
    return 0.5 * density_kgpm3 * airspeed_mps * airspeed_mps


def lift_coefficient(load_n: float, airspeed_mps: float, area_m2: float, density_kgpm3: float) -> float:
    """C_L of a wing that carries a load [N] at an airspeed [m/s]."""
    # n W = q S C_L
    return load_n / (dynamic_pressure_pa(airspeed_mps, density_kgpm3) * area_m2)


def drag_n(
    load_n: float, airspeed_mps: float, area_m2: float, density_kgpm3: float, zero_lift_drag: float, induced_drag: float
) -> float:
    """Drag of a wing that carries a load.

    Parameters
    ----------
    load_n : float
        Weight times load factor [N].
    airspeed_mps, area_m2, density_kgpm3 : float
        Airspeed [m/s], above 0; wing area [m²]; air density [kg/m³].
    zero_lift_drag, induced_drag : float
        C_D0, and K of the polar C_D = C_D0 + K C_L² [1].

    Returns
    -------
    float
        Drag [N].

    Source: Anderson 1999.
    """
    pressure_area = dynamic_pressure_pa(airspeed_mps, density_kgpm3) * area_m2
    # D = q S C_D0 + K (n W)² / (q S)
    return pressure_area * zero_lift_drag + induced_drag * load_n * load_n / pressure_area


def induced_drag_factor(aspect_ratio: float, oswald: float) -> float:
    """K = 1/(π e A). Source: Anderson 1999."""
    return 1.0 / (math.pi * oswald * aspect_ratio)


def load_factor(bank_rad: float) -> float:
    """n = 1/cos φ of a level turn with a bank below 90°. Source: Anderson 1999."""
    return 1.0 / math.cos(bank_rad)


def turn_radius_m(airspeed_mps: float, bank_rad: float) -> float:
    """r = V²/(g tan φ) of a level turn [m]. Source: Anderson 1999."""
    return airspeed_mps * airspeed_mps / (GRAVITY_MPS2 * math.tan(bank_rad))

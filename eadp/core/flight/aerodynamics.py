"""Forces on a fixed-wing aircraft in steady flight, straight or banked: a drag polar and what follows from it.

Source: Anderson 1999, chapters 2 (drag polar), 5 (drag and power required in level flight) and 6 (level turns).
"""

from __future__ import annotations

import math

GRAVITY_MPS2 = 9.80665


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

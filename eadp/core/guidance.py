"""Guiding vector field: from a path function and the aircraft's motion to a heading rate.

Source: drafts, Eqs. 3, 6 and 8, with the rotation and the sign of the k_d term corrected (docs/reproduction.md);
de Marina et al. 2017 (references.md) for the derivation.
"""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.expressions.derivatives import Jet

WIND_FACTOR_LIMIT = 3.0
"""Largest ratio of the heading's turn rate to the course's."""


def heading_rate_radps(jet: Jet, vx: float, vy: float, k_e: float, k_d: float, sense: float) -> float:
    """Heading rate that follows a path, without wind.

    Parameters
    ----------
    jet : tuple of float
        φ, its gradient [1/m] and its Hessian [1/m²] at the aircraft's position.
    vx, vy : float
        Ground velocity ṗ [m/s].
    k_e : float
        Gain of the convergence to the path [the path function's, so that k_e φ has no unit].
    k_d : float
        Gain of the turn towards the desired direction [1/s]; above 0 turns towards it.
    sense : int
        +1 for rotation 90, −1 for rotation 270.

    Returns
    -------
    float
        θ̇ [rad/s]; 0 (keep the heading) at a critical point, where the field has no direction.

    Source: drafts, Eqs. 3, 6, 8; misprints 6 and 12 corrected.
    """
    phi, gx, gy, hxx, hxy, hyy = jet
    ke_phi = k_e * phi
    # ṗ_d = τ − k_e φ ∇φ, τ = R ∇φ
    dx = -sense * gy - ke_phi * gx
    dy = sense * gx - ke_phi * gy
    square = dx * dx + dy * dy
    speed_square = vx * vx + vy * vy
    if square < 1e-18 or speed_square < 1e-18:
        return 0.0
    # p̈_d = (R − k_e φ I) H ṗ − k_e (∇φᵀ ṗ) ∇φ
    hvx = hxx * vx + hxy * vy
    hvy = hxy * vx + hyy * vy
    slope = k_e * (gx * vx + gy * vy)
    ax = -sense * hvy - ke_phi * hvx - slope * gx
    ay = sense * hvx - ke_phi * hvy - slope * gy
    # χ̇_d = p̂̈_dᵀ E ṗ_d / ‖ṗ_d‖ with p̂̈_d = −E ṗ_d ṗ_dᵀ E p̈_d / ‖ṗ_d‖³, which is (ṗ_d × p̈_d) / ‖ṗ_d‖²
    turn = (dx * ay - dy * ax) / square
    # θ̇ = χ̇_d − k_d ṗᵀ E ṗ_d / (‖ṗ‖ ‖ṗ_d‖), and −ṗᵀ E ṗ_d = ṗ × ṗ_d
    return turn + k_d * (vx * dy - vy * dx) / math.sqrt(square * speed_square)


def wind_factor(vx: float, vy: float, air_x: float, air_y: float) -> float:
    """Ratio of the heading's turn rate to the course's in wind.

    Parameters
    ----------
    vx, vy : float
        Ground velocity ṗ = a + w [m/s].
    air_x, air_y : float
        Air velocity a = s(cos θ, sin θ) [m/s].

    Returns
    -------
    float
        ‖ṗ‖ / (s cos(θ − χ)), χ the course, held between 1/`WIND_FACTOR_LIMIT` and `WIND_FACTOR_LIMIT`.

    Notes
    -----
    At constant airspeed and wind χ̇ = s cos(θ − χ) θ̇ / ‖ṗ‖, and s cos(θ − χ) ‖ṗ‖ = aᵀṗ, so the factor is ‖ṗ‖² / aᵀṗ.

    Source: our addition: the published flights turn the heading as fast as the course.
    """
    square = vx * vx + vy * vy
    along = air_x * vx + air_y * vy
    if along * WIND_FACTOR_LIMIT <= square:  # also where the wind is faster than the aircraft
        return WIND_FACTOR_LIMIT
    return max(square / along, 1.0 / WIND_FACTOR_LIMIT)


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

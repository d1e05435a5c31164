"""Guiding vector field: from a path function and the aircraft's motion to a heading rate.

Source: drafts, Eqs. 3, 6 and 8, with the rotation and the sign of the k_d term corrected (docs/reproduction.md);
de Marina et al. 2017 (references.md) for the derivation.
"""

from __future__ import annotations

import math

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


def normalised_jet(jet: Jet) -> Jet:
    """The jet of φ/‖∇φ‖, the distance to the path to first order [m], so that one gain serves lines and circles.

    The gradient's norm is held constant in the derivatives: on the path that is exact for the first ones.

    Source: ours; the papers' gains are 3e-4 on circles and 5e-2 on lines.
    """
    phi, gx, gy, hxx, hxy, hyy = jet
    norm = math.sqrt(gx * gx + gy * gy)
    if norm < 1e-9:
        return jet
    s = 1.0 / norm
    return phi * s, gx * s, gy * s, hxx * s, hxy * s, hyy * s


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

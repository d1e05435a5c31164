"""An aircraft by its data sheet: from span, mass and a stated endurance or power to the keys of a `FixedWing`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le

from eadp.core.arrays import FloatArray, Watts
from eadp.core.guidance import GRAVITY_MPS2, SEA_LEVEL_KGPM3, dynamic_pressure_pa
from eadp.errors import EadpError
from eadp.models.battery import Battery
from eadp.models.vehicle import Airspeed, Mass, WingArea

EFFICIENCY, DRAG, OSWALD = (0.5, 0.15), (0.028, 0.35), (0.8, 0.12)
"""Of the propulsion, C_D0 and Oswald's e of small electric aeroplanes: median, and standard deviation of the logarithm.

Source: propellers of 0.5 to 0.7 (Brandt and Selig 2011), motors of 0.8, speed controllers of 0.95; wings alone from
0.019 (Gryte et al. 2018) and 0.025 (Beard and McLain 2012), with fuselage and camera up to 0.045; e of 0.72 to 0.9.
"""

CRUISE_LIFT, ASPECT = (0.3, 0.2), (3.0, 15.0)
"""Lift coefficient of the stated cruise, by which a wing area that is not stated follows, as above; and the least and
the greatest aspect ratio that it may lead to.

Source: aircraft whose makers state it, from 0.24 (Trimble UX5) to 0.38 (a Zagi at 14 m/s).
"""

ENDURANCE_STD, POWER_STD = 0.15, 0.1
"""Relative standard deviation of the power that a stated endurance or a stated power means.

The whole pack is taken to be used, the greatest power that an endurance allows: makers state their longest flight.
"""

AVIONICS_W, AVIONICS_W_PER_KG, MAX_AVIONICS = 4.0, 1.5, 0.25
"""Power of avionics and camera, by the mass [W, W/kg], and its greatest share of the cruise's: as `eadp init`."""

MOTOR = 4.0
"""Greatest power of the motor over the cruise's: 4.5 to 6 of `eadp init`."""

UNLIKELY = 3.0
"""Standard deviations from the power of such an aircraft from which on a data sheet is refused."""

STEPS = 50


@dataclass(frozen=True)
class DataSheet:
    """What the maker of an aircraft states, or a pilot measures with a tape and scales."""

    span_m: Annotated[float, Ge(0.2), Le(40)]
    """Wing span [m]."""

    mass_kg: Mass
    """Mass at take-off of the flight that is stated [kg]."""

    airspeed_mps: Airspeed
    """Airspeed of the cruise that is stated [m/s]."""

    endurance_min: Annotated[float, Ge(1), Le(1e4)] | None = None
    """Stated time of flight at that airspeed, in which the whole pack is taken to be used [min]."""

    pack_wh: Annotated[float, Gt(0), Le(1e5)] | None = None
    """Energy of the pack that the endurance is stated for [Wh]; by default that of `battery`, new."""

    cruise_power_w: Watts | None = None
    """Electrical power of the cruise, avionics among it, instead of the endurance [W]."""

    wing_area_m2: WingArea | None = None
    """Wing area [m²]; by default that with which mass and airspeed have a usual lift coefficient, within 20 %."""

    def with_power(self, battery: Battery) -> DataSheet:
        """The same with the power that its endurance means, on a battery unless it has a pack's energy."""
        if self.endurance_min is None:
            return self
        seconds = 60 * self.endurance_min
        if self.pack_wh is not None:
            return replace(self, cruise_power_w=3600 * self.pack_wh / seconds)
        from scipy.optimize import brentq

        top_w = 3600 * battery.energy_wh(1.0) / seconds
        found = brentq(lambda watts: battery.endurance_s(watts) - seconds, 1e-3 * top_w, top_w)
        return replace(self, cruise_power_w=float(found))


@dataclass(frozen=True)
class SheetEstimate:
    """The likeliest aircraft of a data sheet, of those that draw the stated power at the stated airspeed.

    Attributes
    ----------
    sheet : DataSheet
    keys : dict
        Of a `FixedWing`.
    """

    sheet: DataSheet
    keys: dict[str, Any]
    _covariance: FloatArray
    _drags_n: tuple[float, float]

    def power_std_at(self, airspeed_mps: float) -> float:
        """Relative standard deviation of the power of level flight at an airspeed [m/s]."""
        ratio = (airspeed_mps / self.sheet.airspeed_mps) ** 2
        flat_n, induced_n = self._drags_n[0] * ratio, self._drags_n[1] / ratio
        slope = _slope(flat_n, induced_n)
        motor_w = (flat_n + induced_n) * airspeed_mps / self.keys["propulsive_efficiency"]
        share = motor_w / (motor_w + self.keys["avionics_w"])
        return float(share * math.sqrt(slope @ self._covariance @ slope))


def estimate(
    sheet: DataSheet, avionics_w: float | None = None, density_kgpm3: float = SEA_LEVEL_KGPM3
) -> SheetEstimate:
    """The keys of an aircraft by its data sheet.

    Of the logarithms of C_D0 S, η and e, known beforehand as `DRAG`, `EFFICIENCY` and `OSWALD` have it, the likeliest
    with which level flight at the stated airspeed draws the stated power.

    Parameters
    ----------
    sheet : DataSheet
        With its power, see `DataSheet.with_power`.
    avionics_w : float, optional
        Power of the avionics [W]; by default `AVIONICS_W` and more by the mass.
    density_kgpm3 : float
        Air density of the stated flight [kg/m³].

    Raises
    ------
    EadpError
        If no such aircraft draws the stated power.

    Source: drag polar (Anderson 1999); iterated update of a normal prior by one exact measurement (Bar-Shalom 2001).
    """
    power_w, power_std = sheet.cruise_power_w or 0.0, POWER_STD if sheet.endurance_min is None else ENDURANCE_STD
    if avionics_w is None:
        avionics_w = min(AVIONICS_W + AVIONICS_W_PER_KG * sheet.mass_kg, MAX_AVIONICS * power_w)
    weight_n, speed = sheet.mass_kg * GRAVITY_MPS2, sheet.airspeed_mps
    pressure_pa = dynamic_pressure_pa(speed, density_kgpm3)
    area_m2, area_std = sheet.wing_area_m2, 0.0
    if area_m2 is None:
        low_m2, high_m2 = (sheet.span_m**2 / aspect for aspect in reversed(ASPECT))
        area_m2, area_std = min(max(weight_n / (pressure_pa * CRUISE_LIFT[0]), low_m2), high_m2), CRUISE_LIFT[1]
    # the span alone gives the induced drag: D_i = W²/(π e b² q)
    induced_n = weight_n**2 / (math.pi * sheet.span_m**2 * pressure_pa)
    prior = np.log([DRAG[0] * area_m2, EFFICIENCY[0], OSWALD[0]])
    variances = np.diag([DRAG[1] ** 2 + area_std**2, EFFICIENCY[1] ** 2, OSWALD[1] ** 2])

    def drags_n(x: FloatArray) -> tuple[float, float]:
        return pressure_pa * math.exp(x[0]), induced_n / math.exp(x[2])

    def motor_w(x: FloatArray) -> float:
        return sum(drags_n(x)) * speed / math.exp(x[1])

    wanted_w, x, slope = power_w - avionics_w, prior, _slope(*drags_n(prior))
    std = math.sqrt(slope @ variances @ slope + power_std**2)
    if wanted_w <= 0 or abs(math.log(wanted_w / motor_w(prior))) > UNLIKELY * std:
        low, high = (motor_w(prior) * math.exp(sign * 2 * std) + avionics_w for sign in (-1, 1))
        stated = f"{power_w:.3g} W at {speed:g} m/s, of {sheet.mass_kg:g} kg with a span of {sheet.span_m:g} m"
        raise EadpError(f"{stated}, of which such an aircraft takes {low:.0f} to {high:.0f} W")
    for _ in range(STEPS):
        # x = x₀ + Σg (gᵀΣg)⁻¹ (ln P − h(x) − gᵀ(x₀ − x))
        slope = _slope(*drags_n(x))
        gain = variances @ slope / (slope @ variances @ slope)
        x = prior + gain * (math.log(wanted_w / motor_w(x)) - slope @ (prior - x))
    rest = np.eye(3) - np.outer(gain, slope)
    covariance = rest @ variances @ rest.T + np.outer(gain, gain) * (power_std * power_w / wanted_w) ** 2
    parasite_m2, efficiency, oswald = (float(each) for each in np.exp(x))
    keys = {
        "mass_kg": sheet.mass_kg,
        "wing_area_m2": area_m2,
        "aspect_ratio": sheet.span_m**2 / area_m2,
        "oswald_efficiency": min(oswald, 1.0),
        "zero_lift_drag_coefficient": parasite_m2 / area_m2,
        "propulsive_efficiency": min(efficiency, 1.0),
        "avionics_w": avionics_w,
        "max_power_w": MOTOR * power_w,
        "airspeed_mps": speed,
    }
    return SheetEstimate(sheet, keys, covariance, drags_n(x))


def _slope(flat_n: float, induced_n: float) -> FloatArray:
    """Gradient of ln P = ln (D_0 + D_i) V/η in the logarithms of C_D0 S, η and e, shape (3,)."""
    drag_n = flat_n + induced_n
    return np.array([flat_n / drag_n, -1.0, -induced_n / drag_n])

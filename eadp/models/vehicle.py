"""Airframe models of the simulated aircraft: their constants, and what follows from them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen

from eadp.core.arrays import Altitude, Efficiency, NotNegative, Watts
from eadp.core.guidance import GRAVITY_MPS2, SEA_LEVEL_KGPM3, drag_n, induced_drag_factor, load_factor, turn_radius_m
from eadp.errors import EadpError
from eadp.plug_ins import plug_in

Mass = Annotated[float, Ge(0.01), Le(500)]
"""Aircraft from 0.1 kg to 150 kg are flown: a bound refuses none of them, and most masses in grams."""
WingArea = Annotated[float, Ge(1e-3), Le(100)]
"""Of 0.1 kg to 150 kg: 0.01 m² of a small one's wing to 30 m² of a solar one's. An area in cm² is refused."""
Airspeed = Annotated[float, Ge(0.5), Le(200)]
"""Indoor aircraft fly at 1 m/s; propellers lose their thrust long before 200 m/s."""
Bank = Annotated[float, Ge(2), Le(80)]
"""A bank in radians is below 2."""
ClimbRate = Annotated[float, Gt(0), Le(100)]
"""Below the speed of any climb on propellers; rates in feet per minute are mostly above it."""
RollTime = Annotated[float, Gt(0), Le(30)]
"""Aeroplanes of some tonnes take about a second; milliseconds are mostly above."""
AirDensity = Annotated[float, Ge(0.01), Le(2)]
"""From that at 30 km, or of other planets' thin air, to that of the coldest air at sea level."""
Rate = Annotated[float, Gt(0), Le(1e3)]
LEVEL_SHARE = 0.05
"""Relative standard deviation of a stated power of level flight, before it is measured."""


class PowerTerms(NamedTuple):
    """Power of level flight at another airspeed, by what is known of it at the airframe's own: a and b [W].

    P = level · a + (flat + turn · tan² φ) · b + own_w, with a the power of straight flight at the own airspeed and b
    what a bank of 45° adds there: `level` and `turn` are 1 at the own airspeed, `flat` and `own_w` are 0.
    """

    level: float = 1.0
    flat: float = 0.0
    turn: float = 1.0
    own_w: float = 0.0


@dataclass(frozen=True)
class PaperVehicle:
    """The aircraft of the published flights: a heading, a throttle that holds the altitude, and power from throttle.

    Source: the letter's published flights (docs/reproduction.md); `wind_in_lift` and `published_triggers` are theirs.
    """

    model: Literal["paper"] = "paper"
    """Name of this airframe model."""

    mass_kg: Mass = 1.0
    """Mass [kg]."""

    weight_n: Annotated[float, Ge(1e-2), Le(1e5)] = 9.8
    """Weight [N]."""

    lift_coefficient: Annotated[float, Gt(0), Le(1e5)] = 9.8 / 15**2
    """Lift over the square of the airspeed [N s²/m²]."""

    speed_per_throttle_mps: Annotated[float, Ge(1e-3), Le(1e3)] = 15 / 50
    """Airspeed of a unit of throttle [m/s]."""

    nominal_throttle: Annotated[float, Ge(1e-3), Le(1e3)] = 50.0
    """Throttle in level flight, of 0 to 100."""

    altitude_gain: NotNegative = 5.0
    """Throttle for an error of altitude [1/m]."""

    climb_gain: NotNegative = 5.0
    """Throttle against climbing [s/m]."""

    cruise_altitude_m: Altitude = 25.0
    """Altitude held [m]."""

    idle_power_w: Watts = 16.0
    """Power at throttle 0 [W]."""

    throttle_power_w: Watts = 20.0
    """Power that throttle 100 adds [W]."""

    wind_in_lift: bool = False
    """Add the wind along the heading to the speed that lifts. Unphysical; the published flights do."""

    takes_commands: ClassVar[Literal[False]] = False
    power_std_share: ClassVar[float] = LEVEL_SHARE
    airspeed_range_mps: ClassVar[None] = None
    speed_gain_per_s: ClassVar[float] = math.inf
    air_density_kgpm3: ClassVar[float] = SEA_LEVEL_KGPM3
    max_bank_deg: ClassVar[float] = 90.0  # no limit
    roll_time_constant_s: ClassVar[float] = 0.0
    climb_j_per_m: ClassVar[float] = 0.0

    published_triggers: bool = False
    """Triggers fire in a box of 20 m, neither armed nor passed, and the flight ends by position, as published."""

    @property
    def airspeed_mps(self) -> float:
        """Airspeed in level flight [m/s]."""
        return self.speed_per_throttle_mps * self.nominal_throttle

    @property
    def cruise_power_w(self) -> float:
        """Motion power in level flight [W]."""
        return self.idle_power_w + self.throttle_power_w * self.nominal_throttle / 100

    def level_power_w(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Motion power in level flight [W], the same at any bank; its airspeed is that of the throttle."""
        return self.idle_power_w + self.throttle_power_w * airspeed_mps / self.speed_per_throttle_mps / 100

    def power_terms(self, airspeed_mps: float) -> PowerTerms:
        """The power at its one airspeed."""
        return PowerTerms()

    def level_speeds_mps(self) -> tuple[float, float]:
        """Least and greatest airspeed of level flight [m/s]: the one whose lift carries the weight."""
        return self.airspeed_mps, self.airspeed_mps

    def climb_rates_mps(self, airspeed_mps: float) -> tuple[float, float]:
        """No climb and no descent [m/s]: the altitude is held."""
        return 0.0, 0.0

    def flown_at(self, airspeed_mps: float) -> Self:
        """The same: it has one airspeed."""
        return self

    @property
    def max_motion_w(self) -> float:
        """Greatest motion power, at full throttle [W]."""
        return self.idle_power_w + self.throttle_power_w

    @property
    def turn_radius_m(self) -> float:
        """Radius of a turn at a bank of 45° [m]: it has no limit of its own."""
        return turn_radius_m(self.airspeed_mps, math.pi / 4)

    def faults(self) -> list[str]:
        """Why the aircraft cannot hold its airspeed and bank: it has no limits of either."""
        return []


STALL_MARGIN = 1.3
"""Least airspeed over the stall's: that of approaches, which gusts and errors of the airspeed leave flying.

Source: 14 CFR 23 (reference landing speed of at least 1.3 stall speeds)."""


@dataclass(frozen=True)
class _Aeroplane:
    """The keys that every aeroplane has, and what follows from them, whatever its power is computed from."""

    model: str = ""
    """Name of this airframe model."""

    mass_kg: Mass = 1.2
    """Mass [kg]."""

    propulsive_efficiency: Efficiency = 0.55
    """Efficiency of the propulsion: thrust power over the motor's electrical power; so in a climb, too."""

    avionics_w: Watts = 2.0
    """Power of the avionics at any throttle [W]."""

    max_power_w: Annotated[float, Gt(0), Le(1e6)] = 200.0
    """The motor's greatest electrical power [W]."""

    airspeed_mps: Airspeed = 15.0
    """True airspeed that the throttle holds [m/s]; autopilots are set to the calibrated one, which export converts."""

    cruise_altitude_m: Altitude = 25.0
    """Altitude held [m]."""

    max_bank_deg: Bank = 45.0
    """Greatest bank [°]."""

    roll_time_constant_s: RollTime = 0.3
    """Time constant of the roll to a bank [s]."""

    max_climb_rate_mps: ClimbRate = 3.0
    """Greatest rate of climb and descent [m/s]."""

    speed_gain_per_s: Rate = 1.0
    """Rate at which the throttle corrects an error of airspeed [1/s]."""

    altitude_gain_per_s: Rate = 0.5
    """Rate at which climbing corrects an error of altitude [1/s]."""

    airspeed_range_mps: tuple[Airspeed, Airspeed] | None = None
    """Least and greatest true airspeed that a planner may command [m/s]; without it the airspeed is held."""

    power_std_share: Annotated[float, Gt(0), Le(1)] = LEVEL_SHARE
    """Standard deviation of the power of level flight as it is stated here, as a share of it; flights measure it."""

    takes_commands: ClassVar[Literal[True]] = True
    """Whether it flies at commanded altitudes and airspeeds, within limits of bank and climb."""

    published_triggers: ClassVar[bool] = False

    def drag_n(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Drag in level flight [N], in a bank with its load factor."""
        raise NotImplementedError

    def level_power_w(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Electrical power in level flight [W]: D V/η and the avionics'."""
        # P = D V / η
        return self.drag_n(airspeed_mps, bank_rad) * airspeed_mps / self.propulsive_efficiency + self.avionics_w

    def power_terms(self, airspeed_mps: float) -> PowerTerms:
        """The power at another airspeed, by that at the own one: the curve of straight flight scaled, and b v₀/v."""
        level, turn = self.level_power_w(airspeed_mps) / self.cruise_power_w, self.airspeed_mps / airspeed_mps
        return PowerTerms(level, 0.0, turn)

    def slowest_mps(self, bank_rad: float) -> float:
        """Least airspeed that is flown on purpose, with turns of a bank [m/s]."""
        return self.level_speeds_mps()[0]

    def level_speeds_mps(self) -> tuple[float, float]:
        """Least and greatest airspeed of level flight [m/s]."""
        raise NotImplementedError

    @cached_property
    def weight_n(self) -> float:
        """Weight [N]."""
        return self.mass_kg * GRAVITY_MPS2

    @property
    def climb_j_per_m(self) -> float:
        """Electrical energy of a metre of climb beside level flight's [J/m], and what a metre of descent saves."""
        # E = m g Δh / η
        return self.weight_n / self.propulsive_efficiency

    def climb_rates_mps(self, airspeed_mps: float) -> tuple[float, float]:
        """Greatest rates of climb and of descent in straight flight at an airspeed [m/s], 0 or more.

        Both are within `max_climb_rate_mps`; the excess power bounds the climb, and the glide's sink rate the descent.

        Source: Anderson 1999.
        """
        # without thrust D V = W v, and R/C = (T − D) V / W
        sink = self.drag_n(airspeed_mps) * airspeed_mps / self.weight_n
        excess = max(self.max_power_w * self.propulsive_efficiency / self.weight_n - sink, 0.0)
        return min(self.max_climb_rate_mps, excess), min(self.max_climb_rate_mps, sink)

    def flown_at(self, airspeed_mps: float) -> Self:
        """The same with another airspeed held [m/s], which its range then has."""
        if self.airspeed_range_mps is None:
            return replace(self, airspeed_mps=airspeed_mps)
        low, high = self.airspeed_range_mps
        wider = min(low, airspeed_mps), max(high, airspeed_mps)
        return replace(self, airspeed_mps=airspeed_mps, airspeed_range_mps=wider)

    def faults(self) -> list[str]:
        """Why the aeroplane cannot fly as it is stated: its range of airspeeds, or its motor; empty if it can."""
        found, motor_w = self._range_faults(), self.cruise_power_w - self.avionics_w
        if motor_w > self.max_power_w:
            found.append(f"level flight takes {motor_w:.0f} W of a motor of {self.max_power_w:g} W")
        return found

    def _range_faults(self) -> list[str]:
        """Why the range of airspeeds cannot be flown; empty if it can, or there is none."""
        if self.airspeed_range_mps is None:
            return []
        low, high = self.airspeed_range_mps
        if not low <= self.airspeed_mps <= high:
            return [f"the airspeed of {self.airspeed_mps:g} m/s is not in its range, {low:g} to {high:g} m/s"]
        found, (_, fastest) = [], self.level_speeds_mps()
        if low < (slowest := self.slowest_mps(0.0)) * (1 - 1e-9):
            found.append(f"the range begins at {low:g} m/s, and the least airspeed is {slowest:.1f} m/s")
        if high > fastest * (1 + 1e-9):
            found.append(f"the range ends at {high:g} m/s, and level flight at {fastest:.1f} m/s")
        return found

    @property
    def cruise_power_w(self) -> float:
        """Motion power in straight level flight at the airspeed held [W]."""
        return self.level_power_w(self.airspeed_mps)

    @property
    def max_motion_w(self) -> float:
        """Greatest motion power, at full throttle [W]."""
        return self.max_power_w + self.avionics_w

    @property
    def turn_radius_m(self) -> float:
        """Radius of a turn at its greatest bank, without wind [m]."""
        return turn_radius_m(self.airspeed_mps, math.radians(self.max_bank_deg))


@dataclass(frozen=True)
class FixedWing(_Aeroplane):
    """A small electric aeroplane: a drag polar, a propulsion of one efficiency, and limits of throttle, bank and climb.

    The defaults are those of a flying wing of 1.2 m span for surveys: 36 W at 15 m/s, of which the published survey
    flight of such a wing drew 30 to 40 W (docs/aircraft.md).
    """

    model: Literal["fixed-wing"] = "fixed-wing"

    wing_area_m2: WingArea = 0.32
    """Wing area [m²]."""

    aspect_ratio: Annotated[float, Ge(0.1), Le(100)] = 4.5
    """Aspect ratio A of the wing: span² / area."""

    oswald_efficiency: Efficiency = 0.8
    """Oswald's efficiency e of the drag polar C_D = C_D0 + C_L² / (π e A)."""

    zero_lift_drag_coefficient: Annotated[float, Ge(1e-4), Le(10)] = 0.022
    """Drag coefficient without lift, C_D0 of the drag polar."""

    max_lift_coefficient: Annotated[float, Ge(1e-2), Le(10)] = 1.1
    """Lift coefficient at which the wing stalls."""

    air_density_kgpm3: AirDensity = 1.225
    """Air density [kg/m³]; 1.225 at the sea, 1.161 at 550 m, 1.007 at 2000 m."""

    @cached_property
    def induced_drag(self) -> float:
        """K of the drag polar."""
        return induced_drag_factor(self.aspect_ratio, self.oswald_efficiency)

    def drag_n(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Drag in level flight [N], in a bank with its load factor."""
        load = self.weight_n * load_factor(bank_rad)
        area, density = self.wing_area_m2, self.air_density_kgpm3
        return drag_n(load, airspeed_mps, area, density, self.zero_lift_drag_coefficient, self.induced_drag)

    def level_speeds_mps(self) -> tuple[float, float]:
        """Least and greatest airspeed of level flight [m/s]: the stall's, and where the motor's power is all needed."""
        # P_max η = ½ρS C_D0 V³ + 2K W²/(ρS V); above the speed of least drag it rises
        density_area = 0.5 * self.air_density_kgpm3 * self.wing_area_m2
        parasitic = density_area * self.zero_lift_drag_coefficient
        induced = self.induced_drag * self.weight_n**2 / density_area
        roots = np.roots([parasitic, 0.0, 0.0, -self.max_power_w * self.propulsive_efficiency, induced])
        real = [float(root.real) for root in roots if abs(root.imag) < 1e-9 * abs(root) and root.real > 0]
        return self.stall_mps, max([self.stall_mps, *real])

    def power_terms(self, airspeed_mps: float) -> PowerTerms:
        """The power at another airspeed, by that at the own one.

        Source: drag polar, P = A v³ + B (1 + tan² φ)/v + P_av, with b = B/v₀ and a = A v₀³ + b + P_av.
        """
        ratio = airspeed_mps / self.airspeed_mps
        cube = ratio**3
        return PowerTerms(cube, 1 / ratio - cube, 1 / ratio, self.avionics_w * (1 - cube))

    def slowest_mps(self, bank_rad: float) -> float:
        """Least airspeed that is flown on purpose [m/s]: `STALL_MARGIN` times that of the stall in turns of a bank."""
        return STALL_MARGIN * self.stall_in_turn_mps(bank_rad)

    def _level_mps(self, lift_coefficient: float) -> float:
        """Airspeed of straight level flight with a lift coefficient [m/s]."""
        # V = √(2 W / (ρ S C_L))
        return math.sqrt(2 * self.weight_n / (self.air_density_kgpm3 * self.wing_area_m2 * lift_coefficient))

    @property
    def glide_mps(self) -> float:
        """Airspeed of least drag [m/s]: where C_L² = C_D0/K, or the stall's above it. Source: Anderson 1999."""
        lift = math.sqrt(self.zero_lift_drag_coefficient / self.induced_drag)
        return self._level_mps(min(lift, self.max_lift_coefficient))

    @property
    def glide_ratio(self) -> float:
        """Lift over drag at `glide_mps`."""
        return self.weight_n / self.drag_n(self.glide_mps)

    @property
    def stall_mps(self) -> float:
        """Airspeed at which the wing stalls in straight flight [m/s]."""
        return self._level_mps(self.max_lift_coefficient)

    def stall_in_turn_mps(self, bank_rad: float) -> float:
        """Airspeed at which the wing stalls in a turn of a bank [m/s]."""
        return self.stall_mps * math.sqrt(load_factor(bank_rad))

    def faults(self) -> list[str]:
        """As `_Aeroplane`, and why it cannot hold its airspeed and bank."""
        found = super().faults()
        if self.airspeed_mps <= self.stall_mps:
            found.append(f"an airspeed of {self.airspeed_mps:g} m/s is below the stall's {self.stall_mps:.1f} m/s")
        elif self.airspeed_mps < self.stall_in_turn_mps(math.radians(self.max_bank_deg)):
            found.append(f"at a bank of {self.max_bank_deg:g}° and {self.airspeed_mps:g} m/s the wing stalls")
        return found


@dataclass(frozen=True)
class PowerCurve(_Aeroplane):
    """An aeroplane by the power that it draws, as measured or as fitted to a log; it flies as `FixedWing` does.

    Drag, (P − P_avionics) η/V, is linear between the points, and constant below and above them.
    """

    model: Literal["power-curve"] = "power-curve"

    points: Annotated[tuple[tuple[Airspeed, Watts], ...], MinLen(1), MaxLen(100)] = ((15.0, 36.0),)
    """Airspeeds, rising, and power of straight level flight, avionics among it [[m/s, W], …]."""

    air_density_kgpm3: AirDensity = 1.225
    """Air density [kg/m³] for which the points hold."""

    bank_w: Watts = 0.0
    """Power that a bank of 45° adds at `airspeed_mps` [W]: proportional to tan² of the bank, over the airspeed."""

    @cached_property
    def drags_n(self) -> tuple[float, ...]:
        """Drag at the points in straight level flight [N]."""
        return tuple((watts - self.avionics_w) * self.propulsive_efficiency / speed for speed, watts in self.points)

    @cached_property
    def turn_drag_n(self) -> float:
        """Drag that a bank of 45° adds, times the square of the airspeed [N m²/s²]."""
        return self.bank_w * self.propulsive_efficiency * self.airspeed_mps

    def drag_n(self, airspeed_mps: float, bank_rad: float = 0.0) -> float:
        """Drag in level flight [N]."""
        straight = float(np.interp(airspeed_mps, [speed for speed, _ in self.points], self.drags_n))
        return straight + self.turn_drag_n * math.tan(bank_rad) ** 2 / airspeed_mps**2

    def level_speeds_mps(self) -> tuple[float, float]:
        """Least and greatest airspeed of the points [m/s]."""
        return self.points[0][0], self.points[-1][0]

    def faults(self) -> list[str]:
        """As `_Aeroplane`, and what is wrong with its points."""
        found = super().faults()
        speeds = [speed for speed, _ in self.points]
        if any(later <= earlier for earlier, later in itertools.pairwise(speeds)):
            found.append("airspeeds of the points do not rise")
        if min(self.drags_n) <= 0:
            found.append(f"a point draws no more than the avionics' {self.avionics_w:g} W")
        return found


Aeroplane = FixedWing | PowerCurve
Airframe = PaperVehicle | Aeroplane
AIRFRAMES: dict[str, type[Airframe]] = {airframe.model: airframe for airframe in (FixedWing, PaperVehicle, PowerCurve)}
"""Every airframe model by its name: the first is the default."""


NOT_ASKED = (
    *("drag_n", "level_power_w", "power_terms", "level_speeds_mps", "climb_j_per_m", "climb_rates_mps"),
    *("cruise_power_w", "max_motion_w", "turn_radius_m"),
)
"""What forecasts ask of an aeroplane, and the simulated aircraft has of its keys: nowhere another's."""


def airframe_class(model: str) -> type[Airframe] | None:
    """The dataclass of an airframe model of eadp, or of an installed package; None where there is none.

    Raises
    ------
    EadpError
        If it cannot be imported, or has formulas that the simulated flight does not ask.
    """
    if model in AIRFRAMES:
        return AIRFRAMES[model]
    kind: type[Airframe] | None = plug_in("airframes", model)
    if kind is None:
        return None
    if not (isinstance(kind, type) and issubclass(kind, FixedWing | PowerCurve)):
        raise EadpError(f"airframe {model} inherits from neither FixedWing nor PowerCurve, whose motion is simulated")
    own: type[Aeroplane] = FixedWing if issubclass(kind, FixedWing) else PowerCurve
    if unasked := [name for name in NOT_ASKED if getattr(kind, name) is not getattr(own, name)]:
        has = f"airframe {model} has {', '.join(unasked)} of its own"
        raise EadpError(f"{has}, which a simulated flight does not ask; it asks induced_drag, the keys and points")
    return kind


@dataclass(frozen=True, slots=True)
class Guidance:
    """How the aircraft follows a path. The gains k_e stand in the plan, one for each stage."""

    k_d: Annotated[float, Ge(-1e6), Le(1e6)] = 1.0
    """Gain k_d of the guiding vector field's turn; the published flights' code has its sign reversed."""

    wind_corrected: bool = True
    """Turn the heading by as much more as the course needs in wind."""

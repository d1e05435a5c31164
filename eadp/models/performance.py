"""What an aircraft can do: its best speeds, the power they take, turns, endurance and range in wind."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.guidance import air_density_kgpm3, calibrated_share
from eadp.models.battery import Battery
from eadp.models.plan.plan import Site
from eadp.models.vehicle import Airframe, FixedWing

SPEEDS = 2001
"""Airspeeds that a best one is searched among, before it is refined."""

STALL_MARGIN = 1.2
"""Least of the best airspeeds over the stall's: what is left for a gust and a turn."""


PATH_MARGIN = 1.3
"""Radius of the tightest turn of a path over the least that can be held, for the guidance and for gusts.

With it flights stay within 6.5 m of paths among obstacles, in winds up to 0.6 of the airspeed; with 1.0, within 10 m.
"""


LEVEL_DEG = 2.0
"""Bank at which an aircraft is level: of a picture at 100 m the middle is 3.5 m aside [°]."""


def calibrated_over_true(site: Site, airframe: Airframe) -> float:
    """The calibrated airspeed that an autopilot holds, over the true one of plans and aircraft, at a plan's field.

    By the standard atmosphere's density at the field's height, or where that is not known by the aircraft's.

    Source: `calibrated_share`.
    """
    if site.above_sea_m is not None:
        return float(calibrated_share(air_density_kgpm3(site.above_sea_m)))
    return float(calibrated_share(airframe.air_density_kgpm3))


def ground_radius_m(airframe: Airframe, airspeed_mps: float, wind_mps: float) -> float:
    """Least radius of a circle over the ground [m], in a wind, at the course on which it is the widest.

    With the wind the ground speed is V + W, and its acceleration (V + W)²/r is at most that of a turn in calm air.
    """
    return airframe.turn_radius_m * ((airspeed_mps + wind_mps) / airframe.airspeed_mps) ** 2


def roll_out_m(airframe: Airframe, ground_mps: float) -> float:
    """Distance from the end of a turn of the greatest bank to where the aircraft is level, to `LEVEL_DEG` [m].

    Source: the airframe's first-order roll.
    """
    # φ = φ_max e^(−t/τ)
    return ground_mps * airframe.roll_time_constant_s * max(0.0, math.log(airframe.max_bank_deg / LEVEL_DEG))


def too_tight(airframe: Airframe, airspeed_mps: float, radius_m: float, wind_mps: float) -> str:
    """What is wrong with a path whose tightest turn has a radius [m], in a wind [m/s]; '' where it can be held."""
    min_m = ground_radius_m(airframe, airspeed_mps, wind_mps)
    if radius_m >= min_m:
        return ""
    greatest_mps = airframe.airspeed_mps * math.sqrt(radius_m / airframe.turn_radius_m) - airspeed_mps
    held = f"only up to {greatest_mps:.1f} m/s of wind" if greatest_mps >= 0 else "not even in calm air"
    return f"turns of {radius_m:g} m, which the aircraft holds {held}; in {wind_mps:g} m/s it needs {min_m:.1f} m"


@dataclass(frozen=True)
class SpeedRange:
    """Time and distance on a battery at an airspeed, in a wind.

    Attributes
    ----------
    airspeed_mps, power_w : float
        Airspeed [m/s] and power [W], computations among it.
    endurance_s : float
        Time until the reserve [s].
    against_m, with_m : float
        Distance against the wind and with it [m]; 0 against a wind that the aircraft cannot outfly.
    out_and_back_m : float
        Distance from which it can return, the wind along the way [m].
    """

    airspeed_mps: float
    power_w: float
    endurance_s: float
    against_m: float
    with_m: float
    out_and_back_m: float

    @property
    def wh_per_km(self) -> float:
        """Energy of a kilometre, half of it with the wind and half against it [Wh]; infinite in a wind too strong."""
        spent_wh, flown_km = self.power_w * self.endurance_s / 3600, 2 * self.out_and_back_m / 1000
        return spent_wh / flown_km if flown_km > 0 else math.inf


@dataclass(frozen=True)
class WindPerformance:
    """An aircraft in a wind [m/s]: at the airspeed held, at that of longest time, at that of longest way against it.

    `range` is None where the wind is at or above every airspeed. `speeds` are those that may be decided, a metre a
    second apart, the greatest first; empty without a range of the aircraft.
    """

    wind_mps: float
    held: SpeedRange
    endurance: SpeedRange
    range: SpeedRange | None
    speeds: tuple[SpeedRange, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Performance:
    """An aircraft's performance: as it flies, at its best speeds, and in winds; None where its model has no such limit.

    Attributes
    ----------
    airspeed_mps, level_power_w, bank_power_w : float
        Airspeed held [m/s]; motion power in straight level flight and at the greatest bank [W].
    turn_radius_m : float
        Turning radius at the greatest bank, without wind [m].
    stall_mps, stall_in_turn_mps : float or None
        Airspeed at which the wing stalls, straight and at the greatest bank [m/s].
    endurance_mps, endurance_w : float
        Airspeed of least power [m/s], and the power [W].
    range_mps, range_w : float
        Airspeed of least energy for a distance in still air [m/s], and the power [W].
    glide_ratio, glide_mps : float or None
        Greatest lift over drag, and its airspeed [m/s].
    max_speed_mps, climb_mps : float or None
        Greatest airspeed in level flight, and rate of climb at the airspeed held [m/s], of the motor's greatest power.
    winds : tuple of WindPerformance
    faults : tuple of str
        What the aircraft cannot do, and would have to.
    """

    airspeed_mps: float
    level_power_w: float
    bank_power_w: float
    turn_radius_m: float
    stall_mps: float | None = None
    stall_in_turn_mps: float | None = None
    endurance_mps: float
    endurance_w: float
    range_mps: float
    range_w: float
    glide_ratio: float | None = None
    glide_mps: float | None = None
    max_speed_mps: float | None = None
    climb_mps: float | None = None
    winds: tuple[WindPerformance, ...]
    faults: tuple[str, ...]


def performance(
    airframe: Airframe,
    battery: Battery,
    winds_mps: Sequence[float] = (0.0,),
    *,
    computing_w: float = 0.0,
    reserve_soc: float = 0.0,
) -> Performance:
    """What an aircraft can do on a full battery.

    Parameters
    ----------
    airframe, battery
    winds_mps : sequence of float
        Speeds of the wind [m/s], 0 or more.
    computing_w : float
        Power of the computations, beside that of the motion [W].
    reserve_soc : float
        State of charge that is kept.

    Returns
    -------
    Performance
        Best speeds count the computations, and keep `STALL_MARGIN` to the stall.

    Source: Anderson 1999, chapter 5: least power at C_L² = 3 C_D0/K, least drag at C_L² = C_D0/K; in wind and beside a
    constant power the least energy for a distance is searched.
    """
    bank = math.radians(airframe.max_bank_deg)
    low_mps, high_mps = airframe.level_speeds_mps()
    margin = STALL_MARGIN if isinstance(airframe, FixedWing) else 1.0
    speeds = min(margin * low_mps, max(high_mps, low_mps)), high_mps

    def power_w(airspeed_mps: float) -> float:
        return airframe.level_power_w(airspeed_mps) + computing_w

    def flown(airspeed_mps: float, wind_mps: float) -> SpeedRange:
        watts = power_w(airspeed_mps)
        time_s = battery.endurance_s(watts, reserve_soc)
        ahead, behind = max(airspeed_mps - wind_mps, 0.0), airspeed_mps + wind_mps
        # R/(V − w) + R/(V + w) = t
        back_m = time_s * ahead * behind / (2 * airspeed_mps)
        return SpeedRange(airspeed_mps, watts, time_s, time_s * ahead, time_s * behind, back_m)

    def ground_cost(wind_mps: float, airspeed_mps: float) -> float:
        return power_w(airspeed_mps) / (airspeed_mps - wind_mps)

    slow, far = _argmin(power_w, *speeds), _argmin(partial(ground_cost, 0.0), *speeds)
    between_mps = airframe.airspeed_range_mps
    decided = [] if between_mps is None else [*np.arange(between_mps[1], between_mps[0], -1.0).tolist(), between_mps[0]]
    winds = []
    for wind in winds_mps:
        low = max(speeds[0], wind * (1 + 1e-9) + 1e-6)
        best = flown(_argmin(partial(ground_cost, wind), low, speeds[1]), wind) if low <= speeds[1] else None
        each = tuple(flown(speed, wind) for speed in decided)
        winds.append(WindPerformance(wind, flown(airframe.airspeed_mps, wind), flown(slow, wind), best, each))
    faults, watts = airframe.faults(), power_w(airframe.airspeed_mps)
    if watts > float(battery.max_power_w(battery.voltage_v)):
        faults.append(f"level flight: {battery.undeliverable(watts, 1.0)}")
    of_wing: dict[str, float] = {}
    if isinstance(airframe, FixedWing):
        # ḣ = (P_max − P) η / W
        spare_w = airframe.max_motion_w - airframe.cruise_power_w
        climb_mps = spare_w * airframe.propulsive_efficiency / airframe.weight_n
        if 0 <= climb_mps < airframe.max_climb_rate_mps:
            faults.append(f"a climb of {airframe.max_climb_rate_mps:g} m/s: the motor allows {climb_mps:.3g} m/s")
        of_wing = {
            "stall_mps": airframe.stall_mps,
            "stall_in_turn_mps": airframe.stall_in_turn_mps(bank),
            "glide_ratio": airframe.glide_ratio,
            "glide_mps": airframe.glide_mps,
            "max_speed_mps": high_mps,
            "climb_mps": climb_mps,
        }
    return Performance(
        airspeed_mps=airframe.airspeed_mps,
        level_power_w=airframe.cruise_power_w,
        bank_power_w=airframe.level_power_w(airframe.airspeed_mps, bank),
        turn_radius_m=airframe.turn_radius_m,
        endurance_mps=slow,
        endurance_w=power_w(slow),
        range_mps=far,
        range_w=power_w(far),
        winds=tuple(winds),
        faults=tuple(faults),
        **of_wing,
    )


def _argmin(cost: Callable[[float], float], low: float, high: float) -> float:
    """Where a function is least between two bounds: on a grid, then refined around the best of it."""
    if high <= low:
        return low
    grid: FloatArray = np.linspace(low, high, SPEEDS)
    best = int(np.argmin([cost(float(v)) for v in grid]))
    low, high = around = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, SPEEDS - 1)])
    while high - low > 1e-9 * high:  # by golden sections
        step = (math.sqrt(5) - 1) / 2 * (high - low)
        low, high = (low, low + step) if cost(high - step) <= cost(low + step) else (high - step, high)
    return min(((low + high) / 2, *around), key=cost)

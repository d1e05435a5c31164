"""The use case of `eadp fit --vehicle`: an aircraft's power fitted to a log, as a vehicle file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from eadp.api.fit.battery import BatteryLogFit
from eadp.api.fit.power import FitOptions, log_part
from eadp.api.given import File, Warn, python_warnings
from eadp.core.flight.aerodynamics import GRAVITY_MPS2
from eadp.core.flight.power_fit import MIN_AIRSPEED_MPS, PowerFit, fit_power
from eadp.errors import Fault, Infeasible, InputError
from eadp.io.log.formats import read_power_log
from eadp.io.log.power_log import AIRSPEED, ALTITUDE, BANK, CLIMB, DENSITY, Columns, PowerLog
from eadp.io.text.streams import read_text
from eadp.io.vehicle.vehicle_file import SCHEMA, read_vehicle
from eadp.models.vehicle import FixedWing, PaperVehicle, PowerCurve

POINTS = 5
ASSUMED_EFFICIENCY = PowerCurve.propulsive_efficiency
TAKE_OFF_POWER, TAKE_OFF_CLIMB_MPS, TAKE_OFF_PAUSE_S = 1.5, 1.0, 5.0
"""A take-off draws so many times the median power in flight, climbs so fast, and is over after so long without both."""
SURE = 0.1
"""Largest standard error of the level power, as a share of it, of an aircraft that counts as identified."""

WANTED = {
    AIRSPEED: "airspeed (airspeed_mps; ULog airspeed_validated or airspeed; DataFlash ARSP)",
    BANK: "bank (bank_deg or roll_deg; ULog vehicle_attitude; DataFlash ATT)",
    CLIMB: "climb (climb_mps or altitude_m; ULog vehicle_local_position; DataFlash XKF1, BARO or GPS)",
}
"""Columns of the motion, and where a log has them."""


@dataclass(frozen=True)
class VehicleLogFit:
    """A fit of an aircraft's power, the keys of its airframe and their standard errors, notes and warnings."""

    fit: PowerFit
    name: str
    airframe: dict[str, Any]
    stds: dict[str, float]
    notes: list[str]
    warnings: list[Fault]
    battery: BatteryLogFit | None = None

    @property
    def sure(self) -> bool:
        """Whether the level power is identified."""
        return self.fit.stds["level_w"] <= SURE * self.fit.level_power_w(self.fit.airspeed_mps)

    @property
    def document(self) -> dict[str, Any]:
        """The JSON-ready document: the keys of a vehicle file, and what the fit knows of them."""
        fit, pack = self.fit, self.battery
        return {
            "schema": SCHEMA,
            "name": self.name,
            "airframe": self.airframe,
            **({} if pack is None else {"battery": pack.keys, "battery_std": pack.document["std"]}),
            "std": self.stds,
            "power": {
                "airspeed_mps": fit.airspeed_mps,
                "speeds_mps": list(fit.speeds_mps),
                "polar": fit.polar,
                "level_w": [[speed, fit.level_power_w(speed)] for speed in self.speeds_mps],
                "bank_w": fit.bank_w,
                "climb_w_per_mps": fit.climb_w_per_mps,
                "std": fit.stds,
                "rms_w": fit.rms_w,
                "correlation_s": fit.correlation_s,
                "windows": fit.windows,
                "idle": fit.idle,
            },
            "notes": self.notes,
        }

    @property
    def speeds_mps(self) -> list[float]:
        """Airspeeds at which the level power is shown: the range flown, or the one flown."""
        low, high = self.fit.speeds_mps
        return np.linspace(low, high, POINTS).tolist() if self.fit.polar else [self.fit.airspeed_mps]

    @property
    def yaml(self) -> str:
        """The vehicle file, with notes and standard errors as comments."""
        lines = [f"# {note}" for note in self.notes]
        lines += [f"schema: {SCHEMA}", f"name: {self.name}", "airframe:"]
        for key, value in self.airframe.items():
            std = f" # ± {self.stds[key]:.2g}" if key in self.stds else ""
            lines.append(f"  {key}: {value}{std}")
        return "\n".join([*lines, *([] if self.battery is None else self.battery.block.splitlines()), ""])

    @property
    def text(self) -> str:
        """The result for people."""
        fit, stds = self.fit, self.fit.stds
        level_w = fit.level_power_w(fit.airspeed_mps)
        lines = [f"level      {level_w:.2f} ± {stds['level_w']:.2f} W at {fit.airspeed_mps:.1f} m/s"]
        if fit.polar:
            shown = [f"{fit.level_power_w(speed):.1f} W at {speed:.1f}" for speed in self.speeds_mps]
            lines.append(f"           {', '.join(shown)} m/s")
        if fit.bank_w is not None:
            lines.append(
                f"turns      {fit.bank_w:.2f} ± {stds['induced_w']:.2f} W more at a bank of 45°, as tan² of the bank"
            )
        if fit.climb_w_per_mps is not None:
            lines.append(f"climb      {fit.climb_w_per_mps:.2f} ± {stds['climb_w_per_mps']:.2f} W more for each m/s")
        lines += [
            f"{key:<10} {self.airframe[key]} ± {std:.2g}"
            for key, std in self.stds.items()
            if self.airframe["model"] == FixedWing.model
        ]
        lines.append(
            f"windows    {fit.windows}, {fit.idle} more with the motor idling; residuals {fit.rms_w:.2f} W rms, "
            f"correlated over {fit.correlation_s:.0f} s"
        )
        lines += [f"not known  {note}" for note in self.notes]
        if self.battery is not None:
            lines += ["", self.battery.text.rstrip()]
        return "\n".join(lines)


def fit_vehicle(
    log: File,
    base: File | None = None,
    columns: Columns | None = None,
    start_s: float | None = None,
    end_s: float | None = None,
    *,
    warn: Warn = python_warnings,
) -> VehicleLogFit:
    """Fit an aircraft's power to a log with airspeed: level flight, its rise with bank, climb and airspeed.

    Parameters
    ----------
    log : path
        CSV with a header, PX4 ULog or ArduPilot DataFlash log.
    base : path, optional
        Vehicle file of what is known: mass, wing, avionics, for a drag polar.
    columns : Columns, optional
        The columns to read.
    start_s, end_s : float, optional
        The part of the log to fit [s]; without a start a take-off is left out.
    warn : function, optional

    Returns
    -------
    VehicleLogFit
        `yaml` is the vehicle file, `text` says how sure each value is.

    Raises
    ------
    InputError
        With the faults of a file, or with what the log lacks.
    """
    known = read_vehicle(read_text(str(base))) if base else None
    wing = None if known is None else known.airframe
    if isinstance(wing, PaperVehicle):
        raise InputError.at("--base", 1, 1, "an aircraft of model paper", "model fixed-wing or power-curve", str(base))
    FitOptions(start_s=start_s, end_s=end_s).check()
    read = log_part(read_power_log(str(log), replace(columns or Columns(), motion=True)), start_s, end_s, {})
    if start_s is None and (airborne_s := _airborne_s(read)) is not None:
        read = log_part(read, airborne_s, None, {})
        message = f"a take-off, to {airborne_s:.0f} s of the log, left out; --from 0 fits it too"
        read.warnings.append(Fault(read.name, 1, 1, message, severity="warning"))
    motion = _motion(read)
    density = _density_kgpm3(motion)
    if wing is not None and density is not None:
        wing = replace(wing, air_density_kgpm3=density)
    constant_w = None if wing is None else wing.avionics_w
    try:
        fit = fit_power(
            read.times_s, read.power_w, motion[AIRSPEED], motion.get(BANK), motion.get(CLIMB), constant_w=constant_w
        )
    except Infeasible as error:
        raise InputError.at(read.name, 1, 1, str(error), "a log of a flight") from None
    airframe, stds, notes = _airframe(fit, wing, float(np.percentile(read.power_w, 99.9)))
    if density is not None:
        airframe["air_density_kgpm3"] = _rounded(density)
    name = known.name if known is not None and known.name else "aircraft of a log"
    warn(read.warnings)
    return VehicleLogFit(fit, name, airframe, stds, [*fit.notes, *notes], read.warnings)


def _airborne_s(log: PowerLog) -> float | None:
    """When the take-off of a log ends [s]: the first climb with much more power than later; None without one."""
    motion = _motion(log)
    flying = np.flatnonzero(motion[AIRSPEED] >= MIN_AIRSPEED_MPS)
    if CLIMB not in motion or len(flying) < 2:
        return None
    steady_w = float(np.median(log.power_w[flying]))
    up = (log.power_w > TAKE_OFF_POWER * steady_w) & (motion[CLIMB] > TAKE_OFF_CLIMB_MPS)
    first_s = log.times_s[flying[0]]
    climbing = np.flatnonzero(up & (log.times_s >= first_s))
    if not len(climbing) or log.times_s[climbing[0]] > first_s + TAKE_OFF_PAUSE_S:
        return None
    pauses = np.flatnonzero(np.diff(log.times_s[climbing]) > TAKE_OFF_PAUSE_S)
    last = climbing[pauses[0]] if len(pauses) else climbing[-1]
    return float(log.times_s[last]) + TAKE_OFF_PAUSE_S


def _density_kgpm3(motion: dict[str, Any]) -> float | None:
    """Density of the air in flight [kg/m³], of a log that says it or the height; None without."""
    flown = motion.get(DENSITY, np.array([]))[motion[AIRSPEED] >= MIN_AIRSPEED_MPS] if DENSITY in motion else []
    known = np.asarray(flown)[np.isfinite(flown)]
    return float(np.median(known)) if len(known) else None


def _motion(log: PowerLog) -> dict[str, Any]:
    """The motion that a log has, the climb by its altitude if need be; raises InputError without airspeed."""
    motion = dict(log.also)
    if CLIMB not in motion and ALTITUDE in motion:
        motion[CLIMB] = np.gradient(motion[ALTITUDE], log.times_s)
    missing = [
        words for column, words in WANTED.items() if column not in motion or not np.isfinite(motion[column]).any()
    ]
    if WANTED[AIRSPEED] in missing:
        raise InputError.at(log.name, 1, 1, f"the log lacks {', '.join(missing)}", "an airspeed at least")
    return motion


def _airframe(
    fit: PowerFit, wing: FixedWing | PowerCurve | None, max_w: float
) -> tuple[dict[str, Any], dict[str, float], list[str]]:
    """Keys of the airframe, their standard errors, and what could not be identified."""
    if fit.polar and isinstance(wing, FixedWing):
        polar, stds, why = _polar(fit, wing)
        if not why:
            given = {item.name: getattr(wing, item.name) for item in fields(wing)}
            return {key: _rounded(value) for key, value in (given | polar).items()}, stds, []
        notes = [why]
    else:
        notes = ["mass, wing and lift: --base FILE names what is known of the aircraft"] if wing is None else []
    speeds = np.linspace(*fit.speeds_mps, POINTS).tolist() if fit.polar else [fit.airspeed_mps]
    points = [[_rounded(speed), _rounded(fit.level_power_w(speed))] for speed in speeds]
    min_w = min(watts for _, watts in points)
    curve: dict[str, Any] = {"model": PowerCurve.model, "points": points, "bank_w": fit.bank_w}
    stds = {"points": fit.stds["level_w"]}
    if fit.bank_w is not None:
        stds["bank_w"] = fit.stds["induced_w"]
    else:
        curve["bank_w"], note = _assumed_bank_w(fit, wing)
        notes.append(note)
    if wing is not None:
        shared = {item.name for item in fields(wing)} & {item.name for item in fields(PowerCurve)} - curve.keys()
        curve |= {key: getattr(wing, key) for key in shared if key != "airspeed_mps"}
    else:
        curve["max_power_w"] = max_w
        curve["avionics_w"] = min(max(fit.constant_w, 0.0), min_w / 2)
        if fit.climb_w_per_mps is not None:
            curve["mass_kg"] = fit.climb_w_per_mps * ASSUMED_EFFICIENCY / GRAVITY_MPS2
            notes.append(f"mass and efficiency apart: the climb gives their ratio, for {ASSUMED_EFFICIENCY:g}")
    if wing is not None and fit.climb_w_per_mps is not None:
        # k = m g/η
        curve["propulsive_efficiency"] = min(1.0, wing.mass_kg * GRAVITY_MPS2 / fit.climb_w_per_mps)
    curve["airspeed_mps"] = fit.airspeed_mps
    order = [item.name for item in fields(PowerCurve)]
    return {key: _rounded(curve[key]) for key in order if key in curve}, stds, notes


def _assumed_bank_w(fit: PowerFit, wing: FixedWing | PowerCurve | None) -> tuple[float, str]:
    """Power that a bank of 45° adds [W] where the log does not show it: the induced drag's; and a note."""
    known, speed = wing or FixedWing(), fit.airspeed_mps if wing else FixedWing.airspeed_mps
    straight_w = known.level_power_w(speed) - known.avionics_w
    # induced drag ∝ n² = 1/cos² φ: at 45° as much again as in straight flight
    share = (known.level_power_w(speed, math.pi / 4) - known.level_power_w(speed)) / straight_w
    bank_w = share * max(fit.level_power_w(fit.airspeed_mps) - max(fit.constant_w, 0.0), 0.0)
    whose = "--base" if wing else "the default wing"
    return bank_w, f"bank_w: assumed, {100 * share:.0f} % of the motor's power, the share of induced drag of {whose}"


def _polar(fit: PowerFit, wing: FixedWing) -> tuple[dict[str, Any], dict[str, float], str]:
    """Drag polar and efficiency of a wing whose mass and area are known, or why they cannot be."""
    climb_w, relative = fit.climb_w_per_mps, 0.0
    efficiency = wing.propulsive_efficiency
    if climb_w is not None:
        # k = W/η
        efficiency, relative = wing.weight_n / climb_w, fit.stds["climb_w_per_mps"] / climb_w
    speed, density_area = fit.airspeed_mps, wing.air_density_kgpm3 * wing.wing_area_m2
    # A V³ = ½ρS C_D0 V³/η,  B/V = 2K W²/(ρSη V)
    parasitic = 2 * fit.parasitic_w * efficiency / (density_area * speed**3)
    factor = fit.induced_w * efficiency * density_area * speed / (2 * wing.weight_n**2)
    oswald = 1 / (math.pi * factor * wing.aspect_ratio) if factor > 0 else math.inf
    keys = {
        "zero_lift_drag_coefficient": parasitic,
        "oswald_efficiency": oswald,
        "propulsive_efficiency": efficiency,
        "avionics_w": fit.constant_w,
    }
    for key, value, limit in (("propulsive_efficiency", efficiency, 1), ("oswald_efficiency", oswald, 1)):
        if not 0 < value <= limit:
            return {}, {}, f"the drag polar: {key} would be {value:.3g}; mass, area or span of --base are not the log's"
    if parasitic <= 1e-4 or fit.constant_w < 0:
        return {}, {}, "the drag polar: the power does not have its form"
    stds = {
        "zero_lift_drag_coefficient": parasitic * math.hypot(fit.stds["parasitic_w"] / fit.parasitic_w, relative),
        "oswald_efficiency": oswald * math.hypot(fit.stds["induced_w"] / fit.induced_w, relative),
        "propulsive_efficiency": efficiency * relative,
    }
    return keys, stds | ({"avionics_w": fit.stds["constant_w"]} if "constant_w" in fit.stds else {}), ""


def _rounded(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float) else value

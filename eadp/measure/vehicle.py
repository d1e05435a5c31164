"""The use case of `eadp fit --vehicle`: an aircraft's power fitted to a log, as a vehicle file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from eadp.api.given import File, Warn, python_warnings
from eadp.core.arrays import FloatArray
from eadp.core.guidance import GRAVITY_MPS2
from eadp.errors import Fault, Infeasible, InputError
from eadp.io.text.streams import read_text
from eadp.io.vehicle import SCHEMA, read_vehicle
from eadp.measure.battery import BatteryLogFit
from eadp.measure.formats import read_power_log
from eadp.measure.noise import regressed
from eadp.measure.power import FitOptions, log_part
from eadp.measure.power_log import AIRSPEED, ALTITUDE, BANK, CLIMB, DENSITY, Columns, PowerLog
from eadp.models.vehicle import FixedWing, PowerCurve

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
        Vehicle file of what is known: mass, avionics.
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
    if wing is not None and not wing.takes_commands:
        raise InputError.at("--base", 1, 1, "an aircraft of model paper", "model fixed-wing or power-curve", str(base))
    FitOptions(start_s=start_s, end_s=end_s).check()
    read = log_part(read_power_log(str(log), replace(columns or Columns(), motion=True)), start_s, end_s)
    if start_s is None and (airborne_s := _airborne_s(read)) is not None:
        read = log_part(read, airborne_s, None)
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
    speeds = np.linspace(*fit.speeds_mps, POINTS).tolist() if fit.polar else [fit.airspeed_mps]
    points = [[_rounded(speed), _rounded(fit.level_power_w(speed))] for speed in speeds]
    curve: dict[str, Any] = {"model": PowerCurve.model, "points": points, "airspeed_mps": fit.airspeed_mps}
    stds, notes = {"points": fit.stds["level_w"]}, []
    if fit.bank_w is not None:
        curve["bank_w"], stds["bank_w"] = fit.bank_w, fit.stds["induced_w"]
    else:
        curve["bank_w"], note = _assumed_bank_w(fit, wing)
        notes.append(note)
    if wing is not None:
        more, more_notes = _keys_of_base(fit, wing)
    else:
        more, more_notes = _keys_without_base(fit, max_w, min(watts for _, watts in points))
    order = [item.name for item in fields(PowerCurve)]
    curve = more | curve
    return {key: _rounded(curve[key]) for key in order if key in curve}, stds, [*notes, *more_notes]


def _keys_of_base(fit: PowerFit, wing: FixedWing | PowerCurve) -> tuple[dict[str, Any], list[str]]:
    """What the aircraft of --base says beside the power of the log, the efficiency by the log's climb; and notes."""
    shared = {item.name for item in fields(wing)} & {item.name for item in fields(PowerCurve)}
    known = {key: getattr(wing, key) for key in shared - {"airspeed_range_mps"}}
    if fit.climb_w_per_mps is None:
        return known, []
    # k = m g/η
    efficiency = wing.mass_kg * GRAVITY_MPS2 / fit.climb_w_per_mps
    known["propulsive_efficiency"] = min(1.0, efficiency)
    note = f"efficiency: it would be {efficiency:.3g}; the mass of --base is not the log's"
    return known, [note] if efficiency > 1 else []


def _keys_without_base(fit: PowerFit, max_w: float, min_w: float) -> tuple[dict[str, Any], list[str]]:
    """What the log alone says beside the power: its largest and least in level flight are given [W]; and notes."""
    known = {"max_power_w": max_w, "avionics_w": min(max(fit.constant_w, 0.0), min_w / 2)}
    notes = ["mass: --base FILE names what is known of the aircraft"]
    if fit.climb_w_per_mps is not None:
        known["mass_kg"] = fit.climb_w_per_mps * ASSUMED_EFFICIENCY / GRAVITY_MPS2
        notes.append(f"mass and efficiency apart: the climb gives their ratio, for {ASSUMED_EFFICIENCY:g}")
    return known, notes


def _assumed_bank_w(fit: PowerFit, wing: FixedWing | PowerCurve | None) -> tuple[float, str]:
    """Power that a bank of 45° adds [W] where the log does not show it: the induced drag's; and a note."""
    known, speed = wing or FixedWing(), fit.airspeed_mps if wing else FixedWing.airspeed_mps
    straight_w = known.level_power_w(speed) - known.avionics_w
    # induced drag ∝ n² = 1/cos² φ: at 45° as much again as in straight flight
    share = (known.level_power_w(speed, math.pi / 4) - known.level_power_w(speed)) / straight_w
    bank_w = share * max(fit.level_power_w(fit.airspeed_mps) - max(fit.constant_w, 0.0), 0.0)
    whose = "--base" if wing else "the default wing"
    return bank_w, f"bank_w: assumed, {100 * share:.0f} % of the motor's power, the share of induced drag of {whose}"


def _rounded(value: Any) -> Any:
    return float(f"{value:.5g}") if isinstance(value, float) else value


WINDOW_S = 5.0
"""Length of the windows that are averaged [s]: in shorter ones, gusts that change airspeed and climb bias the rises."""

MIN_WINDOWS = 20
MIN_AIRSPEED_MPS = 3.0
"""Airspeed below which an aeroplane does not fly [m/s]."""

MAX_SINK_MPS, IDLE_SHARE = 0.5, 0.25
"""Windows that sink faster [m/s], or draw less than this share of the median power, are a glide: the motor idles."""

MIN_SPREAD = 1.2
"""Ratio of airspeeds, the 95th to the 5th percentile, from which on a drag polar is fitted."""

SLOPE = 2.0
"""Exponent of the airspeed in the power near one airspeed, where none can be fitted: between drag at its minimum (1)
and drag that is all parasitic (3)."""

MIN_BANK_RAD = math.radians(10)
"""Largest bank (95th percentile) below which its rise is not fitted."""

SIGNIFICANCE = 3.0
"""Distance from 0, in standard errors, at which a coefficient is significant."""


@dataclass(frozen=True)
class PowerFit:
    """Power of an aeroplane; standard errors hold under correlated noise.

    Attributes
    ----------
    airspeed_mps : float
        Median airspeed V₀ [m/s], at which the coefficients are powers.
    speeds_mps : tuple of float
        Airspeeds flown, the 5th and the 95th percentile [m/s].
    polar : bool
        Whether a drag polar is fitted; else the power near one airspeed.
    parasitic_w, induced_w, constant_w : float
        A V₀³, B/V₀ and C [W]; without a polar the level power at V₀, the rise with tan² φ, and 0.
    climb_w_per_mps : float or None
        Rise with climb k [W s/m]; None where it is not significant.
    bank_w : float or None
        Rise with tan² φ at V₀ [W]; None where it is not significant.
    stds : dict of str to float
        Standard errors of the level power at V₀, `level_w`, and of the coefficients by name, where they are estimated.
    rms_w, correlation_s : float
        Root mean square and correlation time of the residuals of windows [W, s].
    windows, idle : int
        Windows used, and windows left out because the motor idles.
    notes : tuple of str
        What could not be identified, and why.
    """

    airspeed_mps: float
    speeds_mps: tuple[float, float]
    polar: bool
    parasitic_w: float
    induced_w: float
    constant_w: float
    climb_w_per_mps: float | None
    bank_w: float | None
    stds: dict[str, float]
    rms_w: float
    correlation_s: float
    windows: int
    idle: int
    notes: tuple[str, ...]

    def level_power_w(self, airspeed_mps: float) -> float:
        """Power in straight level flight [W]."""
        ratio = airspeed_mps / self.airspeed_mps
        exponent = 3.0 if self.polar else SLOPE
        straight = self.parasitic_w * math.pow(ratio, exponent)
        return straight + self.induced_w / ratio + self.constant_w if self.polar else straight


def fit_power(
    times_s: FloatArray,
    power_w: FloatArray,
    airspeed_mps: FloatArray,
    bank_rad: FloatArray | None = None,
    climb_mps: FloatArray | None = None,
    *,
    constant_w: float | None = None,
) -> PowerFit:
    """Fit an aeroplane's power to a log.

    Parameters
    ----------
    times_s, power_w, airspeed_mps : array, shape (n,)
        Times [s], increasing; power [W]; true airspeed [m/s].
    bank_rad, climb_mps : array, shape (n,), optional
        Bank [rad] and rate of climb [m/s].
    constant_w : float, optional
        What is drawn at any throttle [W], where it is known: without it low speeds are less certain.

    Raises
    ------
    Infeasible
        If there are too few readings in flight.

    Source: Anderson 1999, chapters 2, 5 and 6.
    """
    log = _in_flight(times_s, power_w, airspeed_mps, bank_rad, climb_mps)
    windows = _Windows(log)
    if len(windows.times_s) < MIN_WINDOWS:
        raise Infeasible(
            f"{len(windows.times_s)} windows of {WINDOW_S:g} s in flight; {MIN_WINDOWS} or more are needed"
        )
    motor_on = (windows.climb_mps > -MAX_SINK_MPS) & (windows.power_w > IDLE_SHARE * np.median(windows.power_w))
    if (running := int(np.count_nonzero(motor_on))) < MIN_WINDOWS:
        raise Infeasible(f"{running} windows with the motor running; {MIN_WINDOWS} or more are needed")
    low, high = (float(v) for v in np.percentile(log.airspeed_mps, (5, 95)))
    polar = high / low >= MIN_SPREAD
    columns, of_level, known_w = _polar_terms(windows, constant_w) if polar else _one_speed_terms(windows)
    table = np.stack(list(columns.values()), axis=1)[motor_on]
    fit = regressed(table, windows.power_w[motor_on] - known_w, windows.times_s[motor_on])
    values: dict[str, float] = dict(zip(columns, fit.values.tolist(), strict=True))
    stds = {name: max(fit.std(i), math.sqrt(fit.first_order[i, i])) for i, name in enumerate(columns)}
    summed = np.array([float(name in of_level) for name in columns])
    stds["level_w"] = math.sqrt(max(float(summed @ each @ summed) for each in (fit.covariance, fit.first_order)))
    notes = []
    if not windows.turns:
        notes.append(f"the rise with bank: no {'turns' if log.has_bank else 'bank'} in the log")
    if not log.has_climb:
        notes.append("the rise with climb: no climb or altitude in the log; it is that of the airspeed's changes")
    if not polar:
        notes.append(f"the drag polar: airspeeds from {low:.3g} to {high:.3g} m/s; a ratio of {MIN_SPREAD:g} is needed")
    elif values["parasitic_w"] <= 0 or values["induced_w"] <= 0:
        notes.append("the drag polar: the power does not have its form; windows or airspeeds are too few")
    climb_w = _significant("climb_w_per_mps", "the rise with climb [W s/m]", values, stds, notes)
    with_bank = "the rise with tan² of the bank [W]"
    bank_w = _significant("induced_w", with_bank, values, stds, notes) if windows.turns else None
    return PowerFit(
        airspeed_mps=windows.median_mps,
        speeds_mps=(low, high),
        polar=polar,
        parasitic_w=values["parasitic_w"],
        induced_w=values.get("induced_w", 0.0),
        constant_w=values.get("constant_w", known_w),
        climb_w_per_mps=climb_w,
        bank_w=bank_w,
        stds=stds,
        rms_w=fit.rms,
        correlation_s=fit.correlation_s,
        windows=running,
        idle=len(motor_on) - running,
        notes=tuple(notes),
    )


class _Readings:
    """Readings in flight of which all is known, each an array, shape (n,); level where no bank or climb is logged."""

    def __init__(self, table: FloatArray, *, has_bank: bool, has_climb: bool) -> None:
        self.times_s, self.power_w, self.airspeed_mps, self.bank_rad, self.climb_mps = table
        self.has_bank, self.has_climb = has_bank, has_climb


def _in_flight(
    times_s: FloatArray,
    power_w: FloatArray,
    airspeed_mps: FloatArray,
    bank_rad: FloatArray | None,
    climb_mps: FloatArray | None,
) -> _Readings:
    """The readings of `fit_power` in flight; raises Infeasible if they are few."""
    banks, climbs = (
        None if column is None or not np.isfinite(column).any() else column for column in (bank_rad, climb_mps)
    )
    level = np.zeros_like(times_s)
    table = np.stack(
        [times_s, power_w, airspeed_mps, level if banks is None else banks, level if climbs is None else climbs]
    )
    table = table[:, np.isfinite(table).all(axis=0) & (airspeed_mps >= MIN_AIRSPEED_MPS)]
    if table.shape[1] < MIN_WINDOWS:
        raise Infeasible(f"{table.shape[1]} readings in flight with an airspeed; {MIN_WINDOWS} or more are needed")
    return _Readings(table, has_bank=banks is not None, has_climb=climbs is not None)


class _Windows:
    """Windows of a log, and their means; one with less than half of its readings is left out."""

    def __init__(self, log: _Readings) -> None:
        index = np.floor((log.times_s - log.times_s[0]) / WINDOW_S).astype(int)
        counts = np.bincount(index)
        full = counts >= 0.5 * WINDOW_S / float(np.median(np.diff(log.times_s)))
        full &= counts >= 2
        self._index, self._counts, self._full = index, np.maximum(counts, 1), full
        self.times_s, self.power_w = self.mean(log.times_s), self.mean(log.power_w)
        self.climb_mps = self.mean(log.climb_mps)
        # ḣ + V V̇/g
        faster = self.mean(np.gradient(log.airspeed_mps**2, log.times_s))
        self.rising_mps = self.climb_mps + faster / (2 * GRAVITY_MPS2)
        self.median_mps = float(np.median(log.airspeed_mps))
        # of each reading: V/V₀
        self.speed_ratio = log.airspeed_mps / self.median_mps
        self.turns = bool(np.percentile(np.abs(log.bank_rad), 95) >= MIN_BANK_RAD)
        # tan² φ V₀/V, by which the induced drag's power at V₀ rises in turns
        load = np.tan(np.clip(log.bank_rad, -1.4, 1.4)) ** 2 * self.median_mps / log.airspeed_mps
        self.bank_load = self.mean(load if self.turns else np.zeros_like(load))

    def mean(self, values: FloatArray) -> FloatArray:
        """Means of readings, one for each window."""
        means: FloatArray = (np.bincount(self._index, weights=values) / self._counts)[self._full]
        return means


class _Terms(NamedTuple):
    """The regressors by their coefficients' names, of each window.

    The coefficients `of_level` add up to the power in level flight at V₀, with `known_w` that is drawn at any throttle.
    """

    columns: dict[str, FloatArray]
    of_level: tuple[str, ...]
    known_w: float


def _polar_terms(windows: _Windows, constant_w: float | None) -> _Terms:
    """Climb and a drag polar: A V³ + B/V + C."""
    columns = {
        "climb_w_per_mps": windows.rising_mps,
        "parasitic_w": windows.mean(windows.speed_ratio**3),
        "induced_w": windows.mean(1 / windows.speed_ratio) + windows.bank_load,
    }
    if constant_w is not None:
        return _Terms(columns, ("parasitic_w", "induced_w"), constant_w)
    columns["constant_w"] = np.ones_like(windows.power_w)
    return _Terms(columns, ("parasitic_w", "induced_w", "constant_w"), 0.0)


def _one_speed_terms(windows: _Windows) -> _Terms:
    """Climb, a power of the airspeed where no polar is identified, and turns."""
    columns = {"climb_w_per_mps": windows.rising_mps, "parasitic_w": windows.mean(windows.speed_ratio**SLOPE)}
    if windows.turns:
        columns["induced_w"] = windows.bank_load
    return _Terms(columns, ("parasitic_w",), 0.0)


def _significant(
    name: str, words: str, value: dict[str, float], stds: dict[str, float], notes: list[str]
) -> float | None:
    """A coefficient that is known to be above 0; None where it is not, with a note."""
    if name in value and value[name] <= SIGNIFICANCE * stds[name]:
        notes.append(f"{words}: {value[name]:.3g} ± {stds[name]:.2g}, too uncertain")
        return None
    return value.get(name)

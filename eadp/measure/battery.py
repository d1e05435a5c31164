"""A battery fitted to a log of voltage and current, as the `battery:` block of a scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from eadp.core.arrays import FloatArray
from eadp.core.flight import interpolated
from eadp.errors import Fault, Infeasible, InputError
from eadp.io.text.options import Flag, check_range
from eadp.measure.formats import read_power_log
from eadp.measure.noise import HuberFit, regressed
from eadp.measure.power_log import Columns
from eadp.models.battery import cell_v, misfit

NO_CHARGE, RESTING = 0.01, 0.05
"""Share of the capacity below which nothing was used; share of the largest current below which a battery is at rest."""


@dataclass(frozen=True)
class BatteryOptions:
    """What is known of a battery that is fitted."""

    capacity_ah: float | None = None
    """The battery's capacity [Ah]; or --cells."""

    cells: Annotated[int | None, Flag(metavar="N")] = None
    """Cells in series: the capacity is estimated by their voltage."""

    chemistry: Annotated[str, Flag(metavar="NAME")] = "lipo"
    """Chemistry of the cells: lipo, li-ion, or one of another package."""

    k_b_per_s: float = 1 / 3600
    """k_b [1/s]; 1/3600 is a battery without losses."""

    soc: Annotated[float | None, Flag(metavar="SHARE")] = None
    """State of charge at the start of the log; default: by the charge that the log says was used before, or full where
    the first voltage is that of full cells at rest."""

    @property
    def cell_v(self) -> Sequence[float]:
        """Open-circuit voltage of a cell at even steps of the charge [V]; empty where only its ends are known."""
        return self._known_v if len(self._known_v) > 2 else ()

    @property
    def ends_or_curve(self) -> tuple[str, Sequence[float]]:
        """A chemistry, and its voltages as `cell_v` or at its ends alone [V]; lipo where none of its own is known."""
        return (self.chemistry, self._known_v) if self._known_v else ("lipo", CURVES_V["lipo"])

    @property
    def _known_v(self) -> Sequence[float]:
        """What is known of the chemistry: a curve, or its ends; empty of one that is not known."""
        return CURVES_V.get(self.chemistry) or cell_v(self.chemistry) or ()

    def check(self) -> None:
        """Refuse values that no battery has; raises InputError."""
        if self.capacity_ah is None and self.cells is None:
            message = "no capacity, nor what it is estimated by"
            raise InputError.at("--capacity", 1, 1, message, "--capacity AH or --cells N beside --battery")
        if self.cells is not None and not 1 <= self.cells <= 1000:
            raise InputError.at("--cells", 1, 1, f"{self.cells} cells", "from 1 to 1000", str(self.cells))
        if self.capacity_ah is None and not self.cell_v:
            expected = f"one of {', '.join(CURVES_V)}, or --capacity AH"
            raise InputError.at("--chemistry", 1, 1, "no curve of its voltage is known", expected, self.chemistry)
        for option, value, largest in (
            ("--capacity", self.capacity_ah, math.inf),
            ("--k-b", self.k_b_per_s, math.inf),
            ("--soc", self.soc, 1),
        ):
            if value is not None:
                check_range(option, value, 0, largest)


@dataclass(frozen=True)
class BatteryLogFit:
    """A fit with its options and the warnings of the log."""

    fit: BatteryFit
    options: BatteryOptions
    warnings: list[Fault]
    capacity: CapacityFit | None = None

    @property
    def keys(self) -> dict[str, float]:
        """The scenario's keys, as far as they are known."""
        known = {
            "voltage_v": self.fit.voltage_full_v,
            "voltage_empty_v": self.fit.voltage_empty_v,
            "resistance_ohm": self.fit.resistance_ohm,
            "capacity_ah": self.options.capacity_ah,
            "k_b_per_s": self.options.k_b_per_s,
            "soc": self.fit.charge_from,
        }
        return {key: float(f"{value:.6g}") for key, value in known.items() if value is not None}

    @property
    def block(self) -> str:
        """The block of a scenario, with notes as comments."""
        lines = [f"  {key}: {value!r}" for key, value in self.keys.items()]
        return "\n".join([*(f"# {note}" for note in self.fit.notes), "battery:", *lines, ""])

    @property
    def text(self) -> str:
        """The block after its accuracy in comments."""
        fit = self.fit
        lines = [f"# open-circuit voltage at full charge {fit.voltage_full_v:.3f} ± {fit.voltage_full_std_v:.2g} V"]
        if fit.voltage_empty_v is not None:
            empty = f"{fit.voltage_empty_v:.2f} ± {fit.voltage_empty_std_v:.2g} V"
            lines.append(f"# open-circuit voltage without charge {empty}")
        if fit.resistance_ohm is not None:
            lines.append(f"# resistance {1000 * fit.resistance_ohm:.1f} ± {1000 * fit.resistance_std_ohm:.2g} mΩ")
        lines.append(
            f"# RMS error of the voltage {1000 * fit.rms_v:.0f} mV, {1000 * fit.constant_rms_v:.0f} mV if it did not "
            f"depend on charge; correlation time of the residuals {fit.correlation_s:.1f} s"
        )
        if self.capacity is not None:
            found, share = self.capacity, self.capacity.used_ah / self.capacity.capacity_ah
            lines.append(
                f"# capacity {found.capacity_ah:.3f} ± {found.std_ah:.2g} Ah, of which {100 * share:.0f} % is used"
            )
        lines.append(f"# state of charge from {fit.charge_from:.3f} to {fit.charge_to:.3f}")
        return "\n".join([*lines, self.block])

    @property
    def document(self) -> dict[str, Any]:
        """The JSON-ready document, `eadp.battery/1`."""
        fit = self.fit
        return {
            "schema": "eadp.battery/1",
            "battery": self.keys,
            "std": {
                "voltage_v": fit.voltage_full_std_v,
                "voltage_empty_v": fit.voltage_empty_std_v if fit.voltage_empty_v is not None else None,
                "resistance_ohm": fit.resistance_std_ohm if fit.resistance_ohm is not None else None,
                "capacity_ah": None if self.capacity is None else self.capacity.std_ah,
            },
            "rms_v": fit.rms_v,
            "constant_rms_v": fit.constant_rms_v,
            "soc": [fit.charge_from, fit.charge_to],
            "correlation_s": fit.correlation_s,
            "notes": list(fit.notes),
        }


def read_battery_fit(path: str, columns: Columns, options: BatteryOptions) -> BatteryLogFit:
    """Read a log and fit a battery to its voltage and current.

    Raises
    ------
    InputError
        Of the options, with the faults of the log, or where it is not a log of such a battery.
    """
    if columns.power:
        message = "a power has no information on a battery"
        raise InputError.at("--power", 1, 1, message, "voltage and current", columns.power[0])
    options.check()
    log = read_power_log(path, replace(columns, factors=True))
    assert log.voltage_v is not None
    assert log.current_a is not None
    readings = BatteryReadings(log.times_s, log.voltage_v, log.current_a)
    if len(readings.times_s) < MIN_SAMPLES:  # as a log of another package's format may have
        message = f"{len(readings.times_s)} readings of voltage and current"
        raise InputError.at(log.name, 1, 1, message, f"{MIN_SAMPLES} or more")
    soc, used_before = _charge_at_start(log.battery, readings, options)
    capacity = None
    try:
        if options.capacity_ah is None:
            assert options.cells is not None
            capacity = fit_capacity(readings, options.cells, options.cell_v, soc, options.k_b_per_s)
            options = replace(options, capacity_ah=capacity.capacity_ah)
        assert options.capacity_ah is not None
        fit = fit_battery(readings, options.capacity_ah, k_b_per_s=options.k_b_per_s, soc=soc)
    except Infeasible as error:
        raise InputError.at(log.name, 1, 1, str(error), "a log of the battery that is given") from None
    source = "capacity and k_b cannot be estimated from voltage and current: they are as given"
    if capacity is not None:
        source = f"the capacity is that with which the voltage falls as that of {options.chemistry} cells does"
    stated_ah = log.battery.get("capacity_ah")
    stated = [f"the autopilot's parameters state a capacity of {stated_ah:g} Ah"] if stated_ah else []
    fit = replace(fit, notes=(source, *fit.notes, *stated))
    doubts = [*used_before, *_doubtful_start(readings, fit, options)]
    warnings = [Fault(log.name, 1, 1, message, expected, severity="warning") for message, expected in doubts]
    return BatteryLogFit(fit, options, [*log.warnings, *warnings], capacity)


class BatteryReadings(NamedTuple):
    """Times, increasing [s], voltages at the terminals [V] and currents drawn [A], each an array, shape (n,)."""

    times_s: FloatArray
    voltage_v: FloatArray
    current_a: FloatArray

    @property
    def used_as(self) -> FloatArray:
        """Charge used up to each reading [A s]: the current is straight in between."""
        t, amps = self.times_s, self.current_a
        return np.concatenate(([0.0], np.cumsum(np.diff(t) * (amps[1:] + amps[:-1]) / 2)))


def _doubtful_start(readings: BatteryReadings, fit: BatteryFit, options: BatteryOptions) -> Iterator[tuple[str, str]]:
    """What the first voltage says against the charge at the start, and what is expected."""
    if options.cells is None or not options.cell_v:
        return
    curve_v, soc = options.cell_v, fit.charge_from
    drop_v = (fit.resistance_ohm or 0.0) * max(float(readings.current_a[0]), 0.0) / options.cells
    open_v = float(readings.voltage_v[0]) / options.cells + drop_v
    if said := misfit(open_v - float(interpolated(soc, curve_v)), curve_v[-1] - curve_v[0], drop_v):
        message = f"the log starts at {open_v:.2f} V a cell without current, far {said} that of a charge of {soc:.2f}"
        yield message, "the charge at its start, --soc SHARE, or other --cells"


def _charge_at_start(
    stated: Mapping[str, float], readings: BatteryReadings, options: BatteryOptions
) -> tuple[float, list[tuple[str, str]]]:
    """The state of charge at the start of a log, and what is doubtful about it; raises InputError without evidence."""
    if options.soc is not None:
        return options.soc, []
    used_ah = stated.get("used_ah", 0.0)
    used_share = 3600 * options.k_b_per_s * used_ah / _holds_ah(stated, options)
    if NO_CHARGE < used_share < 1:
        soc = 1 - used_share
        message = f"{used_ah:.3g} Ah were used before the log's first reading: its charge is taken as {soc:.3f}"
        return soc, [(message, "--soc SHARE")]
    first_v, first_a = float(readings.voltage_v[0]), float(readings.current_a[0])
    chemistry, curve_v = options.ends_or_curve
    resting = abs(first_a) <= RESTING * float(np.max(readings.current_a))
    if resting and is_full_at_rest(first_v, options.cells, curve_v):
        return 1.0, []
    of = f"{options.cells or 'some number of'} full {chemistry} cells"
    counted = f"; {1000 * used_ah:.0f} mAh were used before" if "used_ah" in stated else ""
    message = (
        f"nothing shows the charge at the start of the log: the first voltage is {first_v:.2f} V "
        f"{'at rest' if resting else f'under {first_a:.3g} A'}, not that of {of} at rest{counted}"
    )
    expected = "--soc SHARE, which is 1 for a battery that was full"
    raise InputError.at("--soc", 1, 1, message, expected)


def _holds_ah(stated: Mapping[str, float], options: BatteryOptions) -> float:
    """The capacity that is given, or stated in the log [Ah]; infinite without one, or where the log counts more."""
    capacity_ah = options.capacity_ah or stated.get("capacity_ah") or math.inf
    counted_ah = stated.get("used_ah", 0.0) + stated.get("counted_ah", 0.0)
    return math.inf if counted_ah > 1.05 * capacity_ah else capacity_ah


MIN_SAMPLES = 20

MIN_CHARGE_USED = 0.05
"""Smallest share of the capacity that must be used for a slope of the voltage to be fitted."""

SIGNIFICANCE = 3.0
"""Distance from 0, in standard errors, at which a slope or a resistance is significant."""


@dataclass(frozen=True)
class BatteryFit:
    """Rint battery fitted to a log; standard errors hold under correlated noise.

    Attributes
    ----------
    voltage_full_v, voltage_empty_v : float, float or None
        Open-circuit voltage at full charge and without; None where it is taken as the same at any charge [V].
    resistance_ohm : float or None
        Inner resistance [Ω]; None where the current varies too little.
    voltage_full_std_v, voltage_empty_std_v, resistance_std_ohm : float
        Standard errors; 0 where there is no value.
    rms_v, constant_rms_v : float
        Error of the voltage [V], root mean square: of this fit, and of one whose voltage does not depend on charge.
    charge_from, charge_to : float
        State of charge at the start and at the end of the log.
    correlation_s : float
        Correlation time of the residuals [s]: unmodelled dynamics, mainly relaxation.
    notes : tuple of str
        What could not be estimated, and why.
    """

    voltage_full_v: float
    voltage_empty_v: float | None
    resistance_ohm: float | None
    voltage_full_std_v: float
    voltage_empty_std_v: float
    resistance_std_ohm: float
    rms_v: float
    constant_rms_v: float
    charge_from: float
    charge_to: float
    correlation_s: float
    notes: tuple[str, ...]


# fmt: off
CURVES_V = {
    "lipo": (3.27, 3.61, 3.69, 3.71, 3.73, 3.75, 3.77, 3.79, 3.80, 3.82, 3.84,
             3.85, 3.87, 3.91, 3.95, 3.98, 4.02, 4.08, 4.11, 4.15, 4.20),
    "li-ion": (2.90, 3.22, 3.37, 3.43, 3.47, 3.51, 3.54, 3.57, 3.60, 3.63, 3.67,
               3.72, 3.78, 3.83, 3.88, 3.92, 3.97, 4.01, 4.06, 4.11, 4.18),
}
# fmt: on
"""Open-circuit voltage of a cell at each twentieth of the charge [V], as tables of chargers (lipo) and data sheets of
18650 cells (li-ion) have it."""

FULL_SHARE = 0.95
"""Charge whose voltage is that of a full battery."""
MAX_GUESSED_CELLS = 8
"""Most cells in series that a voltage tells from one more."""


def is_full_at_rest(voltage_v: float, cells: int | None = None, cell_v: Sequence[float] = CURVES_V["lipo"]) -> bool:
    """Whether a voltage at rest is that of full cells: of so many, or of some number up to `MAX_GUESSED_CELLS`."""
    low, high = interpolated(FULL_SHARE, cell_v), cell_v[-1] + 0.05
    numbers = range(1, MAX_GUESSED_CELLS + 1) if cells is None else [cells]
    return any(low <= voltage_v / number <= high for number in numbers)


CURVE_STD_V = 0.01
"""Standard deviation of a cell's curve about the table [V], as far as it acts like a change of the capacity."""

MIN_DISCHARGE = 0.3
"""Smallest share of the capacity that must be used for it to be estimated."""
BOUND = 1e-4
"""Distance of a capacity's logarithm to that of the least the log allows, within which the search ended there: ten
times its tolerance."""


@dataclass(frozen=True)
class CapacityFit:
    """Capacity and its standard error, and the charge used in the log [Ah]."""

    capacity_ah: float
    std_ah: float
    used_ah: float


def fit_capacity(
    readings: BatteryReadings,
    cells: int,
    curve_v: Sequence[float] = CURVES_V["lipo"],
    soc: float = 1.0,
    k_b_per_s: float = 1 / 3600,
) -> CapacityFit:
    """Capacity of a pack whose cells' open-circuit voltage is known, by how far the voltage falls with the charge used.

    Parameters
    ----------
    readings : BatteryReadings
    cells : int
        Cells in series.
    curve_v : sequence of float
        Open-circuit voltage of a cell [V] at even steps of the charge.
    soc : float
        State of charge at the start.
    k_b_per_s : float
        k_b [1/s].

    Raises
    ------
    Infeasible
        If too little of the charge is used.

    Source: letter, Sec. III-C, with an open-circuit voltage V(b) of tables.
    """
    t, volts, amps = readings
    used_ah = k_b_per_s * readings.used_as  # ḃ = −k_b I/Q_c
    total = float(used_ah[-1])
    if total <= 0:
        raise Infeasible("the log uses no charge")
    needed = f"{100 * MIN_DISCHARGE:.0f} %"
    if soc <= MIN_DISCHARGE:
        raise Infeasible(f"the log starts with {100 * soc:.0f} % of the charge: a capacity needs more than {needed}")

    def open_v(log_capacity: float) -> FloatArray:
        return cells * np.asarray(interpolated(soc - used_ah / math.exp(log_capacity), curve_v))

    def cost(log_capacity: float) -> float:
        rest = volts - open_v(log_capacity)
        # V = V(b) − R I
        left = rest + amps * max(0.0, -float(amps @ rest) / float(amps @ amps))
        return float(left @ left)

    least = math.log(total / soc)
    grid = least + np.linspace(0.0, math.log(1.2 / MIN_DISCHARGE), 200)
    best = int(np.argmin([cost(float(x)) for x in grid]))
    around = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)])
    log_found = float(minimize_scalar(cost, bounds=around, method="bounded").x)
    capacity = math.exp(log_found)
    if log_found - least < BOUND:
        raise Infeasible(f"the voltage falls as if {total:.3g} Ah, which the log uses, were more than the cells held")
    if total / capacity < MIN_DISCHARGE:
        raise Infeasible(f"the voltage falls too little: {needed} of the charge must be used")
    step = 1e-3
    volts_per_log = (open_v(log_found + step) - open_v(log_found - step)) / (2 * step)
    log_std_of_noise = regressed(np.stack([volts_per_log, -amps], axis=1), volts - open_v(log_found), t).std(0)
    log_std_of_curve = cells * CURVE_STD_V / max(float(np.sqrt(np.mean(volts_per_log**2))), 1e-9)
    return CapacityFit(capacity, capacity * math.hypot(log_std_of_noise, log_std_of_curve), total)


def fit_battery(
    readings: BatteryReadings, capacity_ah: float, *, k_b_per_s: float = 1 / 3600, soc: float = 1.0
) -> BatteryFit:
    """Fit a Rint battery to a log.

    Parameters
    ----------
    readings : BatteryReadings
    capacity_ah, k_b_per_s : float
        Capacity [Ah] and k_b [1/s], which such a log does not determine.
    soc : float
        State of charge at the start.

    Raises
    ------
    Infeasible
        If the current used is more than the charge there was.

    Source: letter, Sec. III-C.
    """
    used = readings.used_as
    # ḃ = −k_b I/Q_c
    charge = soc - k_b_per_s * used / capacity_ah
    if charge.min() < -0.02:
        drawn_ah = k_b_per_s * float(used.max())
        raise Infeasible(f"the log uses {drawn_ah:.3g} Ah, more than {soc:g} of a capacity of {capacity_ah:g} Ah")
    log = _VoltageLog(*readings, charge)
    both = log.likely_fit(resists=True)
    ohm, ohm_std = both.resistance_ohm
    resists = ohm > SIGNIFICANCE * ohm_std
    found = both
    if not resists:  # fit the terminal voltage
        found = log.likely_fit(resists=False) if both.rises else log.fit(rises=False, resists=False)
    (empty_v, empty_std_v), (full_v, full_std_v) = found.open_v(0.0), found.open_v(1.0)
    notes = [] if found.rises else [log.why_no_rise()]
    notes += [] if resists else [log.why_no_resistance(ohm, ohm_std)]
    return BatteryFit(
        voltage_full_v=full_v,
        voltage_empty_v=empty_v if found.rises else None,
        resistance_ohm=ohm if resists else None,
        voltage_full_std_v=full_std_v,
        voltage_empty_std_v=empty_std_v if found.rises else 0.0,
        resistance_std_ohm=ohm_std if resists else 0.0,
        rms_v=found.fit.rms,
        constant_rms_v=log.fit(rises=False, resists=resists).fit.rms,
        charge_from=float(charge[0]),
        charge_to=float(charge[-1]),
        correlation_s=found.fit.correlation_s,
        notes=tuple(notes),
    )


class _VoltageFit(NamedTuple):
    """V = a − R I + s b: whether the voltage rises with the charge b by s, and falls with the current by R."""

    fit: HuberFit
    rises: bool

    @property
    def resistance_ohm(self) -> tuple[float, float]:
        """R, and its standard error [Ω], of a fit that has it."""
        return float(self.fit.values[1]), self.fit.std(1)

    @property
    def rise_v(self) -> tuple[float, float]:
        """s, and its standard error [V], of a fit that has it."""
        last = len(self.fit.values) - 1
        return float(self.fit.values[last]), self.fit.std(last)

    def open_v(self, charge: float) -> tuple[float, float]:
        """The voltage without a current at a charge, and its standard error [V]."""
        row = np.zeros(len(self.fit.values))
        row[0] = 1.0
        if self.rises:
            row[-1] = charge
        return float(row @ self.fit.values), math.sqrt(float(row @ self.fit.covariance @ row))


class _VoltageLog(NamedTuple):
    """Readings to fit: times [s], voltages [V], currents [A] and states of charge, each of shape (n,)."""

    times_s: FloatArray
    volts: FloatArray
    amps: FloatArray
    charge: FloatArray

    def fit(self, *, rises: bool, resists: bool) -> _VoltageFit:
        """The fit with a rise over the charge or without, and with a resistance or without."""
        columns = [np.ones_like(self.amps), *([-self.amps] if resists else []), *([self.charge] if rises else [])]
        return _VoltageFit(regressed(np.stack(columns, axis=1), self.volts, self.times_s), rises)

    @property
    def used_share(self) -> float:
        """Share of the capacity over which the charge goes."""
        return float(np.ptp(self.charge))

    def likely_fit(self, *, resists: bool) -> _VoltageFit:
        """The fit with a rise over the charge if that is beyond doubt, else the one without."""
        if self.used_share >= MIN_CHARGE_USED:
            found = self.fit(rises=True, resists=resists)
            rise_v, std_v = found.rise_v
            if rise_v > SIGNIFICANCE * std_v:
                return found
        return self.fit(rises=False, resists=resists)

    def why_no_rise(self) -> str:
        """Why the voltage is taken as the same at any charge."""
        why = "the voltage does not fall with the charge beyond doubt: it"
        if self.used_share < MIN_CHARGE_USED:
            why = f"only {100 * self.used_share:.1f} % of the charge is used: the voltage"
        return f"{why} is taken as the same at any charge"

    def why_no_resistance(self, ohm: float, std_ohm: float) -> str:
        """Why a resistance that was found is not taken."""
        if ohm < -SIGNIFICANCE * std_ohm:
            rises = f"the voltage rises with the current, by {-ohm:.3g} ± {std_ohm:.2g} Ω"
            return f"the resistance cannot be estimated: {rises}: is each column what it is taken for?"
        varies = f"the current varies by {np.std(self.amps):.3g} A about {np.mean(self.amps):.3g} A"
        return f"the resistance cannot be estimated: {varies}, which gives {ohm:.3g} ± {std_ohm:.2g} Ω"

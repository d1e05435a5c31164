"""A battery fitted to a log of voltage and current, as the `battery:` block of a scenario."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.battery_fit import CURVES_V, BatteryFit, CapacityFit, fit_battery, fit_capacity, is_full_at_rest
from eadp.errors import Fault, Infeasible, InputError
from eadp.io.log.formats import read_power_log
from eadp.io.log.power_log import Columns
from eadp.io.text.options import Flag, check_range
from eadp.models.battery import cell_v

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
        raise InputError.at("--power", 1, 1, message, "voltage and current", columns.power)
    options.check()
    log = read_power_log(path, replace(columns, factors=True))
    assert log.voltage_v is not None
    assert log.current_a is not None
    found, readings = None, (log.times_s, log.voltage_v, log.current_a)
    soc, doubt = _charge_at_start(log.battery, log.voltage_v, log.current_a, options)
    if doubt:
        log.warnings.append(Fault(log.name, 1, 1, doubt, "--soc SHARE", severity="warning"))
    try:
        if options.capacity_ah is None:
            assert options.cells is not None
            found = fit_capacity(*readings, options.cells, options.cell_v, soc)
            options = replace(options, capacity_ah=found.capacity_ah)
        assert options.capacity_ah is not None
        fit = fit_battery(*readings, options.capacity_ah, k_b_per_s=options.k_b_per_s, soc=soc)
    except Infeasible as error:
        raise InputError.at(log.name, 1, 1, str(error), "a log of the battery that is given") from None
    if found is not None:
        note = f"the capacity is that with which the voltage falls as that of {options.chemistry} cells does"
        fit = replace(fit, notes=(note, *fit.notes[1:]))
    if stated_ah := log.battery.get("capacity_ah"):
        note = f"the autopilot's parameters state a capacity of {stated_ah:g} Ah"
        fit = replace(fit, notes=(*fit.notes, note))
    return BatteryLogFit(fit, options, log.warnings, found)


def _charge_at_start(
    stated: Mapping[str, float], voltage_v: FloatArray, current_a: FloatArray, options: BatteryOptions
) -> tuple[float, str]:
    """The state of charge at the start of a log, and what is doubtful about it; raises InputError without evidence."""
    if options.soc is not None:
        return options.soc, ""
    used_ah, capacity_ah = stated.get("used_ah"), options.capacity_ah or stated.get("capacity_ah")
    if used_ah and capacity_ah and NO_CHARGE < used_ah / capacity_ah < 1:
        soc = 1 - used_ah / capacity_ah
        return soc, f"{used_ah:.3g} Ah were used before the log's first reading: its charge is taken as {soc:.3f}"
    first_v, first_a, (chemistry, curve_v) = float(voltage_v[0]), float(current_a[0]), options.ends_or_curve
    resting = abs(first_a) <= RESTING * float(np.max(current_a))
    if resting and is_full_at_rest(first_v, options.cells, curve_v):
        return 1.0, ""
    cells = options.cells or 1
    facts = [
        f"the first voltage is {first_v:.2f} V {'at rest' if resting else f'under {first_a:.3g} A'}",
        f"{f'a full {chemistry} cell has' if cells == 1 else f'{cells} full {chemistry} cells have'} "
        f"{cells * curve_v[-1]:.2f} V at rest",
    ]
    if used_ah is not None:
        of = "" if capacity_ah else " of a capacity that is not known (--capacity AH)"
        facts.append(f"its count of the charge used starts at {1000 * used_ah:.0f} mAh{of}")
    if "capacity_ah" in stated:
        facts.append(f"the autopilot's parameters state a capacity of {stated['capacity_ah']:g} Ah")
    message = f"nothing shows the charge at the start of the log: {', '.join(facts)}"
    expected = "--soc SHARE, which is 1 for a battery that was full"
    if resting and options.cells is None:
        expected += ", or --cells N, by which the voltage at rest tells it"
    elif resting and options.cell_v and curve_v[0] <= first_v / cells <= curve_v[-1]:
        share = np.interp(first_v / cells, curve_v, np.linspace(0, 1, len(curve_v)))
        expected += f"; the voltage at rest of {options.chemistry} cells makes it {share:.2f}"
    raise InputError.at("--soc", 1, 1, message, expected)

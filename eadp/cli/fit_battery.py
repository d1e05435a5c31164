"""`eadp fit --battery`: a log of voltage and current in, the `battery:` block of a scenario out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from eadp.cli.output import Format, emit, emit_json, usage_fault, warn
from eadp.errors import Infeasible, InputError

if TYPE_CHECKING:
    from eadp.core.flight.battery_fit import BatteryFit
    from eadp.io.log.power_log import Columns


def fit_battery_from(
    log: str,
    columns: Columns,
    capacity_ah: float | None,
    k_b_per_s: float,
    soc: float,
    output: str,
    format_: Format,
) -> int:
    """Fit a battery to a log and print it; the exit code is 1 where the log does not tell a resistance."""
    from eadp.core.flight.battery_fit import fit_battery
    from eadp.io.log.formats import read_power_log
    from eadp.io.text.streams import write_text

    if capacity_ah is None:
        raise usage_fault("--capacity", "", "no capacity, which a log cannot tell", "--capacity AH beside --battery")
    for option, value, most in (
        ("--capacity", capacity_ah, math.inf),
        ("--k-b", k_b_per_s, math.inf),
        ("--soc", soc, 1),
    ):
        if not 0 < value <= most or math.isinf(value):
            expected = "above 0" + (f", at most {most:g}" if math.isfinite(most) else "")
            raise usage_fault(option, f"{value:g}", f"{value:g} cannot stand here", expected)
    readings = read_power_log(log, replace(columns, factors=True))
    assert readings.voltage_v is not None
    assert readings.current_a is not None
    try:
        fit = fit_battery(
            readings.times_s, readings.voltage_v, readings.current_a, capacity_ah, k_b_per_s=k_b_per_s, soc=soc
        )
    except Infeasible as error:
        raise InputError.at(readings.name, 1, 1, str(error), "a log of the battery that is given") from None
    block = _block(fit, capacity_ah, k_b_per_s)
    if output:
        write_text(output, block)
    warn(readings.warnings)
    if format_ is Format.json:
        emit_json(_document(fit, capacity_ah, k_b_per_s))
    elif output != "-":
        emit(_text(fit, block))
    return 0 if fit.resistance_ohm is not None else 1


def _keys(fit: BatteryFit, capacity_ah: float, k_b_per_s: float) -> dict[str, float]:
    """The scenario's keys, as far as they are known."""
    known = {
        "voltage_v": fit.voltage_full_v,
        "voltage_empty_v": fit.voltage_empty_v,
        "resistance_ohm": fit.resistance_ohm,
        "capacity_ah": capacity_ah,
        "k_b_per_s": k_b_per_s,
        "soc": fit.charge_from,
    }
    return {key: float(f"{value:.6g}") for key, value in known.items() if value is not None}


def _block(fit: BatteryFit, capacity_ah: float, k_b_per_s: float) -> str:
    lines = [f"  {key}: {value!r}" for key, value in _keys(fit, capacity_ah, k_b_per_s).items()]
    return "\n".join([*(f"# {note}" for note in fit.notes), "battery:", *lines, ""])


def _text(fit: BatteryFit, block: str) -> str:
    """The block, and how sure it is, in comments: a scenario may take it as it stands."""
    lines = [f"# open-circuit voltage at full charge {fit.voltage_full_v:.3f} ± {fit.voltage_full_std_v:.2g} V"]
    if fit.voltage_empty_v is not None:
        lines.append(
            f"# open-circuit voltage without charge {fit.voltage_empty_v:.2f} ± {fit.voltage_empty_std_v:.2g} V"
        )
    if fit.resistance_ohm is not None:
        lines.append(f"# resistance {1000 * fit.resistance_ohm:.1f} ± {1000 * fit.resistance_std_ohm:.2g} mΩ")
    lines.append(
        f"# error of the voltage {1000 * fit.rms_v:.0f} mV (rms), {1000 * fit.constant_rms_v:.0f} mV if it did not "
        f"depend on charge; residuals are alike over {fit.correlation_s:.1f} s"
    )
    lines.append(f"# state of charge from {fit.charge_from:.3f} to {fit.charge_to:.3f}")
    return "\n".join([*lines, block])


def _document(fit: BatteryFit, capacity_ah: float, k_b_per_s: float) -> dict[str, Any]:
    """`eadp.battery/1`."""
    return {
        "schema": "eadp.battery/1",
        "battery": _keys(fit, capacity_ah, k_b_per_s),
        "std": {
            "voltage_v": fit.voltage_full_std_v,
            "voltage_empty_v": fit.voltage_empty_std_v if fit.voltage_empty_v is not None else None,
            "resistance_ohm": fit.resistance_std_ohm if fit.resistance_ohm is not None else None,
        },
        "rms_v": fit.rms_v,
        "constant_rms_v": fit.constant_rms_v,
        "soc": [fit.charge_from, fit.charge_to],
        "correlation_s": fit.correlation_s,
        "notes": list(fit.notes),
    }

"""`eadp fit`: a power log in, its period and Fourier series out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument

from eadp.cli.output import emit, emit_json, usage_fault, warn
from eadp.io.text.options import Flag
from eadp.measure.battery import BatteryOptions, read_battery_fit
from eadp.measure.power import FitOptions, LogFit, read_fit
from eadp.measure.power_log import ColumnOptions, Columns

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eadp.errors import Fault
    from eadp.models.energy import EnergyModel


@dataclass(frozen=True)
class FitKind:
    """What is fitted."""

    vehicle: bool = False
    """Fit the aircraft's power instead, from a log with airspeed; -o is a vehicle file."""

    base: Annotated[str, Flag(metavar="FILE")] = ""
    """Vehicle file of what is known: mass, avionics."""

    battery: bool = False
    """Fit the battery, instead or beside, from voltage and current."""


@dataclass(frozen=True)
class FitOutputs:
    """What is written and printed."""

    output: Annotated[str, Flag("-o --output", metavar="MODEL.yaml")] = ""
    """Write the model; - is standard output."""

    plot: Annotated[str, Flag(metavar="FILE")] = ""
    """Draw log, fit, residuals, periodogram and folded power (.svg or .png)."""

    filter_: Annotated[str, Flag(metavar="FILE")] = ""
    """The planners' filter over the log: estimate and states (.svg, .png, .csv)."""

    gate_w: Annotated[float, Flag(low=0)] = 0.0
    """The filter leaves out readings so near to their forecast [W]."""

    format: Literal["text", "json"] = "text"
    """How to print."""


def command(
    log: Annotated[
        str,
        Argument(metavar="LOG", help="Power log: CSV, PX4 ULog, ArduPilot DataFlash, ROS bag; - is standard input."),
    ],
    options: FitOptions,
    named: ColumnOptions,
    kind: FitKind,
    pack: BatteryOptions,
    out: FitOutputs,
) -> int:
    """Example: eadp fit scenarios/example-power-log.csv

    Find the period of a power log, and fit its mean, harmonics and noise.

    The log is a CSV with a header that names its columns and their units: time_s (or time_ms, or timestamp, in µs), and
    power_w or voltage_v and current_a; or a PX4 ULog, an ArduPilot DataFlash log, or a bag of ROS; or a recording of a
    computer, as eadp profile reads it (tegrastats, jtop, nvidia-smi, INA219, hwmon, RAPL, …).

    With --vehicle the power of an aircraft is fitted: in level flight, its rise with bank, climb and airspeed.

    Exit code 0 if the log has a period, 1 if it has none, 2 if it cannot be read.
    """
    if out.output == "-" and out.format == "json":
        raise usage_fault("--output", out.output, "standard output is taken by --format json", "a file")
    columns = Columns(**vars(named))
    found = read_battery_fit(log, columns, pack) if kind.battery else None
    if kind.vehicle:
        from eadp.measure.vehicle import fit_vehicle

        flown = fit_vehicle(log, kind.base, columns, options.start_s, options.end_s, warn=lambda _: None)
        flown = replace(flown, battery=found)
        _print(flown.document, flown.text, flown.yaml, flown.warnings, out)
        return 0 if flown.sure else 1
    if found is not None:
        _print(found.document, found.text, found.block, found.warnings, out)
        return 0 if found.fit.resistance_ohm is not None else 1
    fit = read_fit(log, columns, options)
    if out.plot or out.filter_:
        _write_pictures(fit, out)
    _print(fit.document, _text(fit), fit.yaml, fit.warnings, out)
    return 0 if fit.fitted.model.periodic else 1


def _write_pictures(fit: LogFit, out: FitOutputs) -> None:
    """Write the figures and tables that are asked for."""
    from eadp.io.figures.canvas import check_figure_name
    from eadp.io.text.streams import write_text
    from eadp.measure import figures
    from eadp.measure.power import filtered

    as_table = out.filter_.lower().endswith(".csv")
    for name in filter(None, (out.plot, "" if as_table else out.filter_)):
        check_figure_name(name)
    if out.plot:
        figures.write_fit_figure(out.plot, fit.fitted)
    if out.filter_:
        log = filtered(fit.fitted, out.gate_w)
        if as_table:
            write_text(out.filter_, log.csv)
        else:
            figures.write_filter_figure(out.filter_, log)


def _print(document: Mapping[str, Any], text: str, file: str, warnings: list[Fault], out: FitOutputs) -> None:
    """Write the result to a file if there is one, and print it as JSON, or as text unless the file is stdout."""
    from eadp.io.text.streams import write_text

    if out.output:
        write_text(out.output, file)
    warn(warnings)
    if out.format == "json":
        emit_json(document)
    elif out.output != "-":
        emit(text)


def _text(fit: LogFit) -> str:
    model = fit.fitted.model
    low_s, high_s = fit.fitted.spectrum.range_s
    constant = math.isnan(fit.fitted.spectrum.period_s)
    searched = "" if constant else f"; periods of {low_s:.4g} s to {high_s:.4g} s searched"
    head = [f"no period: {_refusal(fit)}"]
    label = "std dev"
    if model.period_s is not None:
        head = [f"period   {_with_std(model.period_s, model.period_std_s or 0.0)} s", f"order    {model.order}"]
        label = "noise"
    lines = [
        *head,
        f"mean     {_with_std(model.mean_w, model.mean_std_w or 0.0)} W",
        f"{label:<8} {model.noise_std_w:.3g} W",
        *([f"R²       {model.cv_r2:.4f} cross-validated"] if model.periodic else []),
        f"samples  {model.samples} over {model.span_s:.6g} s{searched}",
    ]
    if "gaps" in fit.counts:
        lines.append(f"gaps     {fit.counts['gaps']}, the longest {fit.counts['longest_gap_s']:.3g} s")
    return "\n".join([*lines, *_terms(model)])


def _terms(model: EnergyModel) -> list[str]:
    if not model.periodic:
        return []
    stds = model.amplitude_std_w or (0.0,) * model.order
    lines = ["", "harmonic   amplitude [W]  phase [rad]"]
    for j, (term, std) in enumerate(zip(model.harmonics, stds, strict=True), start=1):
        lines.append(f"{j:8d}  {_with_std(term.amplitude_w, std):>14}  {term.phase_rad:11.4f}")
    return lines


def _with_std(value: float, std: float) -> str:
    """A value and its standard deviation, to two digits of the deviation."""
    if not std > 1e-9 * value:
        return f"{value:.9g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def _refusal(fit: LogFit) -> str:
    """The reason why there is no period."""
    from eadp.measure.spectrum import MAX_CHANCE, MIN_CV_R2, MIN_PERIODS

    spectrum = fit.fitted.spectrum
    if math.isnan(spectrum.period_s):
        return "the power is constant"
    best = f"{spectrum.period_s:.4g} s"
    if spectrum.cv_r2 < MIN_CV_R2:
        explained = f"{100 * max(0.0, spectrum.cv_r2):.1f} % of the variance in cross-validation"
        return f"the best, {best}, explains {explained}; {100 * MIN_CV_R2:g} % are needed"
    if spectrum.chance <= MAX_CHANCE:
        twice = spectrum.span_s >= MIN_PERIODS * spectrum.period_s
        why = "too uncertain, or outside the range of the prior" if twice else "more than half of the log"
        return f"the best is {best}, {why}"
    chance = f"a false-alarm probability of {spectrum.chance:.2g} in slow noise; at most {MAX_CHANCE:g} is allowed"
    return f"the best is {best}, with {chance}"

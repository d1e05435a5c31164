"""`eadp fit`: a power log in, its period and Fourier series out."""

from __future__ import annotations

import math
import os
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from eadp.cli.output import Format, emit, emit_json, usage_fault, warn
from eadp.errors import Infeasible, InputError

if TYPE_CHECKING:
    from eadp.core.spectrum import Spectrum
    from eadp.io.power_log import PowerLog
    from eadp.models.energy import EnergyModel


class TimeUnit(StrEnum):
    """Units of a log's times."""

    s = "s"
    ms = "ms"
    us = "us"
    ns = "ns"
    min = "min"
    h = "h"


def command(
    log: Annotated[str, typer.Argument(metavar="LOG", help="Power log (CSV); - is standard input.")],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="MODEL.yaml", help="Write the model; - is standard output.")
    ] = "",
    period_prior: Annotated[
        float | None,
        typer.Option("--period-prior", metavar="S", help="Look for a period near this one [s], within a factor of √2."),
    ] = None,
    order: Annotated[
        int | None, typer.Option("--order", metavar="R", min=1, help="Number of harmonics; default: as many as help.")
    ] = None,
    time: Annotated[str, typer.Option("--time", metavar="NAME", help="The column of time.")] = "",
    power: Annotated[str, typer.Option("--power", metavar="NAME", help="The column of power.")] = "",
    voltage: Annotated[str, typer.Option("--voltage", metavar="NAME", help="The column of voltage.")] = "",
    current: Annotated[str, typer.Option("--current", metavar="NAME", help="The column of current.")] = "",
    columns: Annotated[
        str, typer.Option("--columns", metavar="NAME,…", help="Names of the first columns of a log without a header.")
    ] = "",
    time_unit: Annotated[
        TimeUnit | None, typer.Option("--time-unit", help="Unit of the times, where their column's name has none.")
    ] = None,
    battery: Annotated[
        bool, typer.Option("--battery", help="Fit the battery instead, from voltage and current; needs --capacity.")
    ] = False,
    capacity: Annotated[float | None, typer.Option(metavar="AH", help="The battery's capacity [Ah].")] = None,
    k_b: Annotated[
        float, typer.Option("--k-b", metavar="PER_S", help="k_b [1/s]; 1/3600 is a battery without losses.")
    ] = 1 / 3600,
    soc: Annotated[float, typer.Option(metavar="SHARE", help="State of charge where the log begins.")] = 1.0,
    format: Annotated[Format, typer.Option("--format", help="How to print.")] = Format.text,
) -> int:
    """Example: eadp fit scenarios/example-power-log.csv

    Find the period of a power log, and fit its mean, harmonics and noise.

    The log is a CSV with a header that names its columns and their units: time_s (or time_ms, or timestamp, in µs), and
    power_w or voltage_v and current_a.

    Exit code 0 if the log has a period, 1 if it has none, 2 if it cannot be read.
    """
    # the matrices are small: a second thread of linear algebra only spins; once numpy is loaded this has no effect
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from eadp.io.energy_file import energy_document, energy_yaml
    from eadp.io.power_log import Columns, read_power_log
    from eadp.io.streams import write_text
    from eadp.models.energy import energy_model

    if output == "-" and format is Format.json:
        raise usage_fault("--output", output, "standard output is taken by --format json", "a file")
    if period_prior is not None and not 0 < period_prior < math.inf:
        raise usage_fault("--period-prior", f"{period_prior:g}", "no period", "a number of seconds above 0")
    names = [name.strip() for name in columns.split(",")] if columns else []
    if battery:
        if power:
            raise usage_fault("--power", power, "a power tells nothing of a battery", "voltage and current")
        from eadp.cli.fit_battery import fit_battery_from

        wanted = Columns(time, "", voltage or "", current or "", names, time_unit or "")
        return fit_battery_from(log, wanted, capacity, k_b, soc, output, format)
    readings = read_power_log(log, Columns(time, power, voltage, current, names, time_unit or ""))
    spectrum = _analysed(readings, order, period_prior)
    model = energy_model(spectrum)
    if output:
        write_text(output, energy_yaml(model))
    warn(readings.warnings)
    if format is Format.json:
        emit_json(energy_document(model))
    elif output != "-":
        emit(_report(model) if model.periodic else _refusal(spectrum))
    return 0 if model.periodic else 1


def _analysed(readings: PowerLog, order: int | None, period_prior_s: float | None) -> Spectrum:
    from eadp.core.spectrum import analyse

    try:
        return analyse(readings.times_s, readings.power_w, order=order, period_prior_s=period_prior_s)
    except Infeasible as error:
        raise InputError.at(readings.name, 1, 1, str(error)) from None


def _report(model: EnergyModel) -> str:
    assert model.period_s is not None
    lines = [
        f"period   {_with_std(model.period_s, model.period_std_s or 0.0)} s",
        f"order    {model.order}",
        f"mean     {model.mean_w:.6g} W",
        f"noise    {model.noise_std_w:.3g} W",
        f"R²       {model.cv_r2:.4f} of blocks held out",
        f"samples  {model.samples} over {model.span_s:.6g} s",
        "",
        "harmonic  amplitude [W]  phase [rad]",
    ]
    terms = enumerate(model.harmonics, start=1)
    return "\n".join([*lines, *(f"{j:8d}  {term.amplitude_w:13.4f}  {term.phase_rad:11.4f}" for j, term in terms)])


def _with_std(value: float, std: float) -> str:
    """A value and its standard deviation, to two digits of the deviation."""
    if not std > 1e-9 * value:
        return f"{value:.9g}"
    digits = max(0, 1 - math.floor(math.log10(std)))
    return f"{value:.{digits}f} ± {std:.{digits}f}"


def _refusal(spectrum: Spectrum) -> str:
    """What was found instead of a period."""
    from eadp.core.spectrum import MAX_CHANCE, MIN_CV_R2

    if math.isnan(spectrum.period_s):
        reason = "the power is constant"
    elif spectrum.cv_r2 < MIN_CV_R2:
        explained = f"{100 * max(0.0, spectrum.cv_r2):.1f} % of the variance of blocks held out"
        reason = f"the best, {spectrum.period_s:.4g} s, explains {explained}; {100 * MIN_CV_R2:g} % are needed"
    else:
        chance = f"noise looks so with a chance of {spectrum.chance:.2g}; at most {MAX_CHANCE:g} is allowed"
        reason = f"the best is {spectrum.period_s:.4g} s, but slow {chance}"
    return "\n".join(
        [
            f"no period: {reason}",
            f"mean     {spectrum.mean_w:.6g} W",
            f"spread   {spectrum.noise_std_w:.3g} W",
            f"samples  {spectrum.samples} over {spectrum.span_s:.6g} s",
        ]
    )

"""`eadp fit`: a power log in, its period and Fourier series out."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from eadp.cli.options import Format, FormatOption, names_in
from eadp.cli.output import emit, emit_json, usage_fault, warn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eadp.errors import Fault
    from eadp.io.log.fit_inputs import LogFit
    from eadp.models.energy import EnergyModel


TimeUnit = StrEnum("TimeUnit", ["s", "ms", "us", "ns", "min", "h"])


def command(
    log: Annotated[
        str, Argument(metavar="LOG", help="Power log: CSV, PX4 ULog, ArduPilot DataFlash; - is standard input.")
    ],
    output: Annotated[
        str, Option("--output", "-o", metavar="MODEL.yaml", help="Write the model; - is standard output.")
    ] = "",
    period_prior: Annotated[
        float | None, Option(metavar="S", help="Search the period near this one [s], within a factor of 1.3.")
    ] = None,
    plan: Annotated[
        str, Option(metavar="FILE", help="Search the period near the nominal time of this plan's lap.")
    ] = "",
    airspeed: Annotated[
        float | None, Option(metavar="MPS", help="Speed the plan's lap is flown at; default 15 m/s.")
    ] = None,
    order: Annotated[
        int | None, Option(metavar="R", min=1, help="Number of harmonics; default: by cross-validation.")
    ] = None,
    time: Annotated[str, Option(metavar="NAME", help="The column of time.")] = "",
    power: Annotated[str, Option(metavar="NAME", help="The column of power.")] = "",
    voltage: Annotated[str, Option(metavar="NAME", help="The column of voltage.")] = "",
    current: Annotated[str, Option(metavar="NAME", help="The column of current.")] = "",
    columns: Annotated[
        str, Option(metavar="NAME,…", help="Names of the first columns of a log without a header.")
    ] = "",
    time_unit: Annotated[TimeUnit | None, Option(help="Unit of the times, where their column's name has none.")] = None,
    instance: Annotated[int | None, Option(metavar="N", help="Which battery of an autopilot's log.")] = None,
    start: Annotated[
        float | None, Option("--from", metavar="S", help="Leave out earlier readings, in seconds of the log.")
    ] = None,
    end: Annotated[
        float | None, Option("--to", metavar="S", help="Leave out later readings, in seconds of the log.")
    ] = None,
    keep_spikes: Annotated[
        bool, Option("--keep-spikes", help="Fit single samples far from their neighbours too.")
    ] = False,
    profile: Annotated[
        str,
        Option(
            metavar="FILE",
            help="Subtract the computations' power first: configurations are in the log, under the profile's names.",
        ),
    ] = "",
    plot: Annotated[
        str, Option(metavar="FILE", help="Draw log, fit, residuals, periodogram and folded power (.svg or .png).")
    ] = "",
    spectrum: Annotated[
        str, Option(metavar="FILE", help="Draw the power's spectrum, its harmonics marked (.svg or .png).")
    ] = "",
    filter_: Annotated[
        str,
        Option(
            "--filter",
            metavar="FILE",
            help="The planners' filter over the log: estimate and states (.svg, .png, .csv).",
        ),
    ] = "",
    gate: Annotated[
        float, Option(metavar="W", min=0, help="The filter leaves out readings so near to their forecast [W].")
    ] = 0.0,
    track: Annotated[
        str, Option(metavar="FILE", help="The log's positions beside the path of --plan (.svg, .png, .csv).")
    ] = "",
    vehicle: Annotated[
        bool,
        Option("--vehicle", help="Fit the aircraft's power instead, from a log with airspeed; -o is a vehicle file."),
    ] = False,
    base: Annotated[
        str, Option(metavar="FILE", help="Vehicle file of what is known: mass, wing, avionics, for a drag polar.")
    ] = "",
    battery: Annotated[
        bool, Option("--battery", help="Fit the battery, instead or beside, from voltage and current.")
    ] = False,
    capacity: Annotated[float | None, Option(metavar="AH", help="The battery's capacity [Ah]; or --cells.")] = None,
    cells: Annotated[
        int | None, Option(metavar="N", help="Cells in series: the capacity is estimated by their voltage.")
    ] = None,
    chemistry: Annotated[str, Option(metavar="NAME", help="Chemistry of the cells: lipo or li-ion.")] = "lipo",
    k_b: Annotated[float, Option(metavar="PER_S", help="k_b [1/s]; 1/3600 is a battery without losses.")] = 1 / 3600,
    soc: Annotated[float, Option(metavar="SHARE", help="State of charge at the start of the log.")] = 1.0,
    format: FormatOption = Format.text,
) -> int:
    """Example: eadp fit scenarios/example-power-log.csv

    Find the period of a power log, and fit its mean, harmonics and noise.

    The log is a CSV with a header that names its columns and their units: time_s (or time_ms, or timestamp, in µs), and
    power_w or voltage_v and current_a; or a PX4 ULog, or an ArduPilot DataFlash log. Where a log has positions (x_m and
    y_m, or lat and lon), and no other prior is given, the period is searched near the time of their laps.

    With --vehicle the power of an aircraft is fitted: in level flight, its rise with bank, climb and airspeed.

    Exit code 0 if the log has a period, 1 if it has none, 2 if it cannot be read.
    """
    from eadp.io.log.battery_fit import BatteryOptions, read_battery_fit
    from eadp.io.log.fit_inputs import FitOptions, read_fit
    from eadp.io.log.power_log import Columns

    if output == "-" and format is Format.json:
        raise usage_fault("--output", output, "standard output is taken by --format json", "a file")
    chosen = Columns(time, power, voltage, current, names_in(columns), time_unit or "", instance=instance)
    found = read_battery_fit(log, chosen, BatteryOptions(capacity, k_b, soc, cells, chemistry)) if battery else None
    if vehicle:
        from dataclasses import replace

        from eadp.io.log.vehicle_fit import read_vehicle_fit

        flown = replace(read_vehicle_fit(log, chosen, base, start, end), battery=found)
        _print(flown.document, flown.text, flown.yaml, flown.warnings, output, format)
        return 0 if flown.sure else 1
    if found is not None:
        _print(found.document, found.text, found.block, found.warnings, output, format)
        return 0 if found.fit.resistance_ohm is not None else 1
    if track and not plan:
        raise usage_fault("--track", track, "beside no plan", "--plan FILE")
    options = FitOptions(order, period_prior, plan, airspeed, start, end, keep_spikes, profile, bool(track))
    fit = read_fit(log, chosen, options)
    if plot or spectrum or filter_ or track:
        _write_pictures(fit, plot, spectrum, (filter_, gate), (track, plan))
    _print(fit.document, _text(fit), fit.yaml, fit.warnings, output, format)
    return 0 if fit.fitted.model.periodic else 1


def _write_pictures(fit: LogFit, plot: str, spectrum: str, filter_: tuple[str, float], track: tuple[str, str]) -> None:
    """Write the figures and tables that are asked for."""
    from eadp.io.figures import fit as figures
    from eadp.io.figures.canvas import check_figure_name
    from eadp.io.log.flown_log import filtered
    from eadp.io.text.streams import write_text

    for name in (plot, spectrum, *(name for name in (filter_[0], track[0]) if not _is_table(name))):
        if name:
            check_figure_name(name)
    if plot:
        figures.write_fit_figure(plot, fit.fitted)
    if spectrum:
        figures.write_spectrum_figure(spectrum, fit.fitted)
    if filter_[0]:
        log = filtered(fit.fitted, filter_[1])
        if _is_table(filter_[0]):
            write_text(filter_[0], log.csv)
        else:
            figures.write_filter_figure(filter_[0], log)
    if fit.track is not None:
        if _is_table(track[0]):
            write_text(track[0], fit.track.csv)
        else:
            figures.write_track_figure(track[0], fit.track, track[1].rpartition("/")[2])


def _is_table(name: str) -> bool:
    return name.lower().endswith(".csv")


def _print(document: dict[str, Any], text: str, file: str, warnings: list[Fault], output: str, format: Format) -> None:
    """Write the result to a file if there is one, and print it as JSON, or as text unless the file is stdout."""
    from eadp.io.text.streams import write_text

    if output:
        write_text(output, file)
    warn(warnings)
    if format is Format.json:
        emit_json(document)
    elif output != "-":
        emit(text)


def _text(fit: LogFit) -> str:
    model = fit.fitted.model
    head = [f"no period: {_refusal(fit)}"]
    label = "std dev"
    if model.period_s is not None:
        head = [f"period   {_with_std(model.period_s, model.period_std_s or 0.0)} s", f"order    {model.order}"]
        label = "noise"
    slow = model.disturbance
    noise = "" if slow is None else f", of it {slow.std_w:.3g} W with a time constant of {slow.time_s:.2g} s"
    lines = [
        *head,
        f"mean     {_with_std(model.mean_w, model.mean_std_w or 0.0)} W",
        f"{label:<8} {model.noise_std_w:.3g} W{noise}",
        *([f"R²       {model.cv_r2:.4f} cross-validated"] if model.periodic else []),
        f"samples  {model.samples} over {model.span_s:.6g} s",
    ]
    return "\n".join([*lines, *_left_out(fit.counts), *_terms(model)])


_REASONS = {
    "empty": "with an empty cell",
    "not_finite": "not finite",
    "unknown": "unknown",
    "restart": "outside the longest run",
    "repeated": "at the time of another",
    "no_configuration": "without a configuration",
    "outside": "outside --from and --to",
    "spikes": "spikes",  # and one of them is "1 spike"
}


def _left_out(counts: Mapping[str, int | float]) -> list[str]:
    parts = [f"{counts[key]} {words}" for key, words in _REASONS.items() if counts.get(key)]
    parts = ["1 spike" if part == "1 spikes" else part for part in parts]
    lines = [f"left out {', '.join(parts)}"] if parts else []
    if counts.get("gaps"):
        lines.append(f"gaps     {counts['gaps']}, the longest {counts['longest_gap_s']:.3g} s")
    return lines


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
    from eadp.core.signals.spectrum import MAX_CHANCE, MIN_CV_R2, MIN_PERIODS

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

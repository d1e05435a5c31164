"""The use case of `eadp fit`: an energy model fitted to a power log, and the log filtered."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.signals import output_row
from eadp.errors import Fault, Infeasible, InputError
from eadp.io.energy import energy_document, energy_yaml
from eadp.io.profile.model_file import parse_profile
from eadp.io.text.options import Flag
from eadp.io.text.streams import read_text
from eadp.measure.formats import read_power_log
from eadp.measure.noise import spikes
from eadp.measure.power_log import Columns, PowerLog, rows_text
from eadp.measure.spectrum import Spectrum, analyse
from eadp.models.energy import EnergyModel, Harmonic
from eadp.models.profile import Profile
from eadp.plug_ins import plug_in


@dataclass(frozen=True, eq=False)
class EnergyFit:
    """An energy model with the analysis and the samples that it comes from.

    Attributes
    ----------
    model : EnergyModel
    spectrum : Spectrum
        The analysis; it holds the best candidate also where no period is significant.
    times_s, power_w : array, shape (n,)
        Samples kept [s], [W]; times from the first of them.
    spikes : array of int
        Indices, into the samples given, of those left out.
    """

    model: EnergyModel
    spectrum: Spectrum
    times_s: FloatArray
    power_w: FloatArray
    spikes: IntArray


def fit_power(
    times_s: ArrayLike, power_w: ArrayLike, period_prior_s: float | None = None, *, order: int | None = None
) -> EnergyFit:
    """Fit the energy model of a power log: its period, mean, harmonics and noise.

    Parameters
    ----------
    times_s, power_w : array, shape (n,)
        Strictly increasing times [s] and power [W].
    period_prior_s : float, optional
        The period is searched within a factor of 1.3 of this one [s].
    order : int, optional
        Number of harmonics, by default found by cross-validation.

    Returns
    -------
    EnergyFit
        Its `model.period_s` is None where no period is significant.

    Raises
    ------
    InputError
        If the samples are no numbers, not finite, or not in order.
    Infeasible
        If they are too few.
    """
    expected = "two arrays of as many finite numbers, the times increasing"
    try:
        times, power = np.asarray(times_s, dtype=float), np.asarray(power_w, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError.at("times_s, power_w", 1, 1, str(error), expected) from None
    if times.ndim != 1 or times.shape != power.shape:
        raise InputError.at("times_s, power_w", 1, 1, f"of shapes {times.shape} and {power.shape}", expected)
    if not np.isfinite([times, power]).all() or (np.diff(times) <= 0).any():
        raise InputError.at("times_s, power_w", 1, 1, "not finite, or not in order", expected)
    out = spikes(power)
    times, power = times[~out], power[~out]
    times = times - times[0] if len(times) else times
    spectrum = analyse(times, power, order=order, period_prior_s=period_prior_s)
    return EnergyFit(energy_model(spectrum), spectrum, times, power, np.flatnonzero(out))


def energy_model(spectrum: Spectrum) -> EnergyModel:
    """The energy model of a spectral analysis; a period that is not significant is left out.

    Parameters
    ----------
    spectrum : Spectrum

    Returns
    -------
    EnergyModel
    """
    terms = zip(spectrum.amplitude_w.tolist(), spectrum.phase_rad.tolist(), strict=True)
    return EnergyModel(
        period_s=spectrum.period_s if spectrum.periodic else None,
        mean_w=spectrum.mean_w,
        harmonics=tuple(Harmonic(amplitude, phase) for amplitude, phase in terms),
        noise_std_w=spectrum.noise_std_w,
        period_std_s=spectrum.period_std_s if spectrum.periodic else None,
        cv_r2=spectrum.cv_r2,
        samples=spectrum.samples,
        span_s=spectrum.span_s,
        mean_std_w=spectrum.mean_std_w,
        amplitude_std_w=tuple(spectrum.amplitude_std_w.tolist()),
    )


@dataclass(frozen=True, eq=False)
class FilteredLog:
    """The estimator of the planners over a log.

    Attributes
    ----------
    period_s : float or None
        T [s], of the fit; None without one.
    gate_w : float
        A reading no farther than this from its forecast corrected nothing [W].
    times_s, power_w : array, shape (n,)
        Readings.
    forecast_w : array, shape (n,)
        Of each, from those before it [W].
    states_w : array, shape (n, 2r + 1)
        α0, α1, β1, … after each [W].
    """

    period_s: float | None
    gate_w: float
    times_s: FloatArray
    power_w: FloatArray
    forecast_w: FloatArray
    states_w: FloatArray

    @property
    def estimate_w(self) -> FloatArray:
        """C q after each reading [W], shape (n,): the power without its slow disturbance."""
        estimate: FloatArray = self.states_w @ output_row((self.states_w.shape[1] - 1) // 2)
        return estimate

    @property
    def used(self) -> float:
        """Share of the readings that corrected the state."""
        return float(np.mean(np.abs(self.power_w - self.forecast_w) > self.gate_w))

    @property
    def csv(self) -> str:
        """A table of the readings: forecast, estimate, period and states."""
        waves = [f"{name}{j}_w" for j in range(1, (self.states_w.shape[1] + 1) // 2) for name in ("alpha", "beta")]
        header = ["time_s", "power_w", "forecast_w", "estimate_w", "period_s", "alpha0_w", *waves]
        columns = self.times_s, self.power_w, self.forecast_w, self.estimate_w
        period = "" if self.period_s is None else self.period_s
        rows = zip(*(column.tolist() for column in columns), self.states_w.tolist(), strict=True)
        return _table([header, *([*values, period, *state] for *values, state in rows)])


def filtered(fitted: EnergyFit, gate_w: float = 0.0) -> FilteredLog:
    """Run the planners' estimator over the readings of a fit, from its period and with a gate [W].

    Source: draft 002, Fig. 3 and Algorithm l. 9-16.
    """
    found = plug_in("estimators", "log")(fitted.model, fitted.times_s, fitted.power_w, gate_w)
    return FilteredLog(fitted.model.period_s, gate_w, fitted.times_s, fitted.power_w, *found)


def _table(rows: Sequence[Sequence[object]]) -> str:
    """Rows as CSV."""
    return "".join(",".join(map(str, row)) + "\n" for row in rows)


@dataclass(frozen=True)
class FitOptions:
    """How a log's power is fitted."""

    period_prior_s: float | None = None
    """Search the period near this one [s], within a factor of 1.3."""

    order: Annotated[int | None, Flag(metavar="R", low=1)] = None
    """Number of harmonics; default: by cross-validation."""

    start_s: Annotated[float | None, Flag("--from")] = None
    """Leave out earlier readings, in seconds of the log."""

    end_s: Annotated[float | None, Flag("--to")] = None
    """Leave out later readings, in seconds of the log."""

    profile: Annotated[str, Flag(metavar="FILE")] = ""
    """Subtract the computations' power first: configurations are in the log, under the profile's names."""

    def check(self) -> None:
        """Refuse times that cannot be; raises InputError."""
        prior = self.period_prior_s
        if prior is not None and not 0 < prior < math.inf:
            raise _refused("--period-prior", prior, "no period", "a number of seconds above 0")
        for option, seconds in (("--from", self.start_s), ("--to", self.end_s)):
            if seconds is not None and not 0 <= seconds < math.inf:
                raise _refused(option, seconds, "no time of a log", "a number of seconds, 0 or more")


def _refused(option: str, value: float, message: str, expected: str) -> InputError:
    return InputError.at(option, 1, 1, message, expected, f"{value:g}")


@dataclass(frozen=True)
class LogFit:
    """A fit with its prior, readings left out by reason, and warnings."""

    fitted: EnergyFit
    prior_s: float | None
    counts: dict[str, int | float]
    warnings: list[Fault] = field(default_factory=list)

    @property
    def yaml(self) -> str:
        """The model's file."""
        return energy_yaml(self.fitted.model)

    @property
    def document(self) -> dict[str, Any]:
        """The model's JSON-ready document, with the best candidate, the prior, and the readings left out."""
        spectrum = self.fitted.spectrum
        candidate = None if math.isnan(spectrum.period_s) else spectrum.period_s
        return energy_document(self.fitted.model) | {
            "candidate": {"period_s": candidate, "chance": spectrum.chance},
            "range_s": spectrum.range_s,
            "drift_s": spectrum.drift_s,
            "prior": None if self.prior_s is None else {"period_s": self.prior_s},
            "log": self.counts,
        }


def read_fit(path: str, columns: Columns, options: FitOptions) -> LogFit:
    """Read a log and fit an energy model to it.

    Parameters
    ----------
    path : str
        As `read_power_log`.
    columns : Columns
    options : FitOptions

    Raises
    ------
    InputError
        Of the options, with the faults of a file, or if the log is too short.
    """
    options.check()
    profile, profile_warnings = parse_profile(read_text(options.profile)) if options.profile else (None, [])
    log = read_power_log(path, replace(columns, also=profile.names) if profile else columns)
    log = log_part(log, options.start_s, options.end_s)
    if profile is not None:
        log = _without_computations(log, options.profile, profile)
    prior_s = options.period_prior_s
    try:
        fitted = fit_power(log.times_s, log.power_w, prior_s, order=options.order)
    except Infeasible as error:
        raise InputError.at(log.name, 1, 1, str(error)) from None
    counts = log.counts | ({"spikes": len(fitted.spikes)} if len(fitted.spikes) else {})
    notes = [Fault(log.name, 1, 1, message, severity="warning") for message in _notes(log, fitted)]
    return LogFit(fitted, prior_s, counts, [*log.warnings, *profile_warnings, *notes])


def _notes(log: PowerLog, fitted: EnergyFit) -> Iterator[str]:
    """What is to be known of a fit: spikes left out, and a period that drifts."""
    if len(fitted.spikes):
        many = f"{len(fitted.spikes)} spikes" if len(fitted.spikes) > 1 else "1 spike"
        yield f"{many} left out, the first at {float(log.times_s[fitted.spikes[0]]):.6g} s"
    if fitted.spectrum.drift_s is not None:
        low_s, high_s = fitted.spectrum.drift_s
        yield f"the period drifts: {low_s:.4g} s to {high_s:.4g} s in parts of the log"


def log_part(log: PowerLog, start_s: float | None, end_s: float | None) -> PowerLog:
    """The log from one time to another; raises InputError where nothing of it is left."""
    inside = (log.times_s >= (start_s or 0.0)) & (log.times_s <= (math.inf if end_s is None else end_s))
    if inside.all():
        return log
    if not inside.any():
        option = "--from" if start_s is not None and start_s > log.times_s[-1] else "--to"
        raise InputError.at(option, 1, 1, "leaves nothing of the log", f"a time within its {log.times_s[-1]:g} s")
    counts = log.counts | {"outside": int(np.count_nonzero(~inside))}
    return replace(log.at(np.flatnonzero(inside)), counts=counts)


def _without_computations(log: PowerLog, path: str, profile: Profile) -> PowerLog:
    """The log less the computations' power, where it has a configuration of the profile, which is read from a path."""
    configurations = np.stack([log.also[name] for name in profile.names], axis=1)
    known = np.isfinite(configurations).all(axis=1)
    different, which = np.unique(configurations[known], axis=0, return_inverse=True)
    try:
        powers_w = np.array([profile.power_w_at(one.tolist()) for one in different], dtype=float)
    except Infeasible as error:
        raise InputError.at(path, 1, 1, f"the log has a configuration outside the profile: {error}") from None
    counts, warnings = log.counts, log.warnings
    if unknown := int(np.count_nonzero(~known)):
        counts = counts | {"no_configuration": unknown}
        message = f"{rows_text(unknown)} without a configuration left out"
        warnings = [*warnings, Fault(log.name, 1, 1, message, severity="warning")]
    log = log.at(np.flatnonzero(known))
    return replace(log, power_w=log.power_w - powers_w[which.ravel()], counts=counts, warnings=warnings)

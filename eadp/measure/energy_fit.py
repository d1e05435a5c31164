"""Fit of an energy model to samples of power: spikes removed, period tested, correlated disturbance separated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.signals import design_matrix, fit_disturbance, output_row
from eadp.errors import InputError
from eadp.measure.robust import spikes
from eadp.measure.spectrum import Spectrum, analyse
from eadp.models.energy import Disturbance, EnergyModel, Harmonic
from eadp.models.plan.stage import Leg, leg_points
from eadp.plug_ins import plug_in

MIN_VARIANCE_SHARE = 0.05
"""Smallest share of the noise's variance that counts as a disturbance."""
MIN_TIME_STEPS = 2.0
"""Shortest time constant of a disturbance, in sampling steps: a shorter one is white noise."""
LONG_SHARE = 0.25
"""Time constant, as a share of the log, beyond which a disturbance is distinguishable from the mean only with"""
MIN_VARIANCE_SHARE_LONG = 0.5
"""this share of the noise's variance."""
MAX_STD_RATIO = 1.5
"""Largest standard deviation of a disturbance over the residuals': beyond it, the columns have absorbed part of it."""


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


def fit_energy(
    times_s: ArrayLike,
    power_w: ArrayLike,
    *,
    order: int | None = None,
    period_prior_s: float | None = None,
) -> EnergyFit:
    """Fit an energy model to samples.

    Parameters
    ----------
    times_s, power_w : array, shape (n,)
        Strictly increasing times [s] and power [W].
    order, period_prior_s
        As `eadp.measure.spectrum.analyse`.

    Raises
    ------
    Infeasible
        As `eadp.measure.spectrum.analyse`.
    """
    times, power = np.asarray(times_s, dtype=float), np.asarray(power_w, dtype=float)
    out = spikes(power)
    times, power = times[~out], power[~out]
    times = times - times[0] if len(times) else times
    spectrum = analyse(times, power, order=order, period_prior_s=period_prior_s)
    model = energy_model(spectrum)
    model = replace(model, disturbance=_disturbance(times, power, model))
    return EnergyFit(model, spectrum, times, power, np.flatnonzero(out))


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


def _disturbance(times_s: FloatArray, power_w: FloatArray, model: EnergyModel) -> Disturbance | None:
    """Correlated part of the residuals; None where they are white."""
    residual = power_w - model.power_w(times_s)
    columns = design_matrix(times_s, 1 / model.period_s if model.period_s else 0.0, model.order)
    found = fit_disturbance(times_s, residual, columns=columns)
    if found.std_w > MAX_STD_RATIO * float(np.std(residual)):
        found = fit_disturbance(times_s, residual)
    long = found.time_s > LONG_SHARE * float(times_s[-1])
    min_w2 = (MIN_VARIANCE_SHARE_LONG if long else MIN_VARIANCE_SHARE) * (found.std_w**2 + found.noise_w**2)
    lasts = found.time_s > MIN_TIME_STEPS * float(np.median(np.diff(times_s)))
    significant = found.std_w**2 > min_w2 and found.std_w > 1e-6 * abs(model.mean_w) and lasts
    return Disturbance(found.std_w, found.time_s) if significant else None


PATH_STEP_M = 1.0
"""Distance between the points of a plan's path that a track is compared with [m]."""
WINDOW, BEGIN_M = 40, 50.0
"""Points by which a track may be ahead of or behind its path, and its greatest distance from it at first [m]."""


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


@dataclass(frozen=True, eq=False)
class FlownTrack:
    """Positions of a log beside the path of a plan.

    Attributes
    ----------
    times_s : array, shape (n,)
    position_m, path_m : array, shape (n, 2) and (m, 2)
        Flown, and of the plan.
    off_m : array, shape (n,)
        Distance of each position from the path [m].
    """

    times_s: FloatArray
    position_m: FloatArray
    path_m: FloatArray
    off_m: FloatArray

    @property
    def csv(self) -> str:
        """A table of the positions and their distances."""
        values = np.column_stack([self.times_s, self.position_m, self.off_m])
        return _table([["time_s", "x_m", "y_m", "cross_track_m"], *values.tolist()])


def flown_track(name: str, times_s: FloatArray, position_m: FloatArray | None, legs: Sequence[Leg]) -> FlownTrack:
    """The track of a log beside the legs of a plan.

    Raises
    ------
    InputError
        If the log has no positions.
    """
    known = None if position_m is None else np.isfinite(position_m).all(axis=1)
    if position_m is None or known is None or not known.any():
        raise InputError.at(name, 1, 1, "the log has no positions", "columns x_m and y_m, or lat and lon")
    path_m = np.array([(point.x_m, point.y_m) for leg in legs for point in leg_points(leg, PATH_STEP_M)])
    return FlownTrack(times_s[known], position_m[known], path_m, _distances_along(path_m, position_m[known]))


def _distances_along(path_m: FloatArray, position_m: FloatArray) -> FloatArray:
    """Distance of each position of a track from the path that it is flown along [m]; other laps may lie nearer.

    The track may begin on any lap that passes its first position. From each of them, the track's positions are matched
    to the path in their order: each to the nearest point around the match before, or ahead of it. The lap with the
    least sum of squared distances counts.
    """
    # number of the path's points that each step of the track passes
    moved = np.linalg.norm(np.diff(position_m, axis=0, prepend=position_m[:1]), axis=1) / PATH_STEP_M
    first_m = np.linalg.norm(path_m - position_m[0], axis=1)
    # local minima of the distance from the first position: one for each lap that passes by it
    nearest = (first_m[1:-1] <= first_m[:-2]) & (first_m[1:-1] <= first_m[2:]) & (first_m[1:-1] < BEGIN_M)
    of_laps: list[FloatArray] = []
    for point in [*(np.flatnonzero(nearest) + 1).tolist(), int(first_m.argmin())]:
        off_m = np.empty(len(position_m))
        for k, steps in enumerate(moved.tolist()):
            low, high = max(point - WINDOW, 0), point + round(1.5 * steps) + WINDOW
            ahead_m = np.linalg.norm(path_m[low:high] - position_m[k], axis=1)
            point = low + int(ahead_m.argmin())
            off_m[k] = ahead_m.min()
        of_laps.append(off_m)
    return min(of_laps, key=lambda off_m: float(off_m @ off_m))

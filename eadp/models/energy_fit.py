"""Fit of an energy model to samples of power: spikes removed, period tested, correlated disturbance separated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, IntArray
from eadp.core.signals.disturbance import fit_disturbance
from eadp.core.signals.harmonics import design_matrix
from eadp.core.signals.outliers import spikes
from eadp.core.signals.spectrum import Spectrum, analyse
from eadp.models.energy import Disturbance, EnergyModel, energy_model

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
        As `eadp.core.signals.spectrum.analyse`.

    Raises
    ------
    Infeasible
        As `eadp.core.signals.spectrum.analyse`.
    """
    times, power = np.asarray(times_s, dtype=float), np.asarray(power_w, dtype=float)
    out = spikes(power)
    times, power = times[~out], power[~out]
    times = times - times[0] if len(times) else times
    spectrum = analyse(times, power, order=order, period_prior_s=period_prior_s)
    model = energy_model(spectrum)
    model = replace(model, disturbance=_disturbance(times, power, model))
    return EnergyFit(model, spectrum, times, power, np.flatnonzero(out))


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

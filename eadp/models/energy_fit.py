"""From samples of power to an energy model: spikes left out, the period judged, what stays a while told from noise."""

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

LEAST_SHARE = 0.05
"""Part of the noise's variance that a disturbance must have to be told, and"""
LEAST_STEPS = 2.0
"""how many sampling steps it must last: a shorter one is white noise;"""
LONGEST_SHARE = 0.25
"""beyond this part of the log a disturbance is told from the mean only if it has"""
LEAST_SHARE_LONG = 0.5
"""this part of the variance."""
LARGEST_RATIO = 1.5
"""A larger spread than this many of the residual's own is not believed: the laps' columns have taken it."""


@dataclass(frozen=True, eq=False)
class EnergyFit:
    """A model, what it was found from, and what was left out.

    Attributes
    ----------
    model : EnergyModel
    spectrum : Spectrum
        The period judged: also the candidate where there is none.
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
    keep_spikes: bool = False,
) -> EnergyFit:
    """Fit an energy model to samples.

    Parameters
    ----------
    times_s, power_w : array, shape (n,)
        Strictly increasing times [s] and power [W].
    order, period_prior_s
        As `eadp.core.signals.spectrum.analyse`.
    keep_spikes : bool
        Take samples far from their neighbours for what they are.

    Raises
    ------
    Infeasible
        As `eadp.core.signals.spectrum.analyse`.
    """
    times, power = np.asarray(times_s, dtype=float), np.asarray(power_w, dtype=float)
    out = np.zeros(len(power), dtype=np.bool_) if keep_spikes else spikes(power)
    times, power = times[~out], power[~out]
    times = times - times[0] if len(times) else times
    spectrum = analyse(times, power, order=order, period_prior_s=period_prior_s)
    model = energy_model(spectrum)
    model = replace(model, disturbance=_disturbance(times, power, model))
    return EnergyFit(model, spectrum, times, power, np.flatnonzero(out))


def _disturbance(times_s: FloatArray, power_w: FloatArray, model: EnergyModel) -> Disturbance | None:
    """What of the residual stays a while; None where it is white."""
    residual = power_w - model.power_w(times_s)
    columns = design_matrix(times_s, 1 / model.period_s if model.period_s else 0.0, model.order)
    found = fit_disturbance(times_s, residual, columns=columns)
    if found.std_w > LARGEST_RATIO * float(np.std(residual)):
        found = fit_disturbance(times_s, residual)
    long = found.time_s > LONGEST_SHARE * float(times_s[-1])
    least = (LEAST_SHARE_LONG if long else LEAST_SHARE) * (found.std_w**2 + found.noise_w**2)
    lasts = found.time_s > LEAST_STEPS * float(np.median(np.diff(times_s)))
    told = found.std_w**2 > least and found.std_w > 1e-6 * abs(model.mean_w) and lasts
    return Disturbance(found.std_w, found.time_s) if told else None

"""A Rint battery from a log of voltage and current: open-circuit voltage, linear in charge, and resistance.

The terminal voltage of the model is linear in what is sought, V = V₀ + (V₁ − V₀) b − R I, with the state of charge b
counted from the current. Capacity and k_b stand in b as one factor, and V₁ − V₀ takes up whatever they are wrong by:
they cannot be estimated from voltage and current, and are given.

Source: letter, Sec. III-C and Eq. 22 for the model; Huber 1964 for the weights; Newey and West 1987 for the covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray
from eadp.errors import Infeasible

HUBER = 1.345
"""Residuals beyond this many standard deviations count less: 95 % efficient where the noise is normal."""

PASSES = 50
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


def fit_battery(
    times_s: ArrayLike,
    voltage_v: ArrayLike,
    current_a: ArrayLike,
    capacity_ah: float,
    *,
    k_b_per_s: float = 1 / 3600,
    soc: float = 1.0,
) -> BatteryFit:
    """Fit a Rint battery to a log.

    Parameters
    ----------
    times_s, voltage_v, current_a : array, shape (n,)
        Times [s], increasing; voltage at the terminals [V]; current drawn [A].
    capacity_ah, k_b_per_s : float
        Capacity [Ah] and k_b [1/s], which such a log does not determine.
    soc : float
        State of charge at the start.

    Raises
    ------
    Infeasible
        If there are too few readings, or the current used is more than the charge there was.

    Source: letter, Sec. III-C.
    """
    t, volts, amps = (np.asarray(values, dtype=float) for values in (times_s, voltage_v, current_a))
    if len(t) < MIN_SAMPLES:
        raise Infeasible(f"{len(t)} readings of voltage and current; {MIN_SAMPLES} or more are needed")
    # ḃ = −k_b I/Q_c, the current straight between readings
    used = np.concatenate(([0.0], np.cumsum(np.diff(t) * (amps[1:] + amps[:-1]) / 2)))
    charge = soc - k_b_per_s * used / capacity_ah
    if charge.min() < -0.02:
        drawn = float(used.max()) / 3600
        raise Infeasible(f"the log draws {drawn:.3g} Ah, more than {soc:g} of a capacity of {capacity_ah:g} Ah")
    notes = ["capacity and k_b cannot be estimated from voltage and current: they are as given"]
    vary = float(np.ptp(charge)) >= MIN_CHARGE_USED
    if not vary:
        notes.append(
            f"only {100 * np.ptp(charge):.1f} % of the charge is used: the voltage is taken as the same at any charge"
        )
    constant = _regressed(np.stack([np.ones_like(amps), -amps], axis=1), volts, t)
    linear = _regressed(np.stack([np.ones_like(amps), -amps, charge], axis=1), volts, t) if vary else None
    if linear is not None and not linear.values[2] > SIGNIFICANCE * linear.std(2):
        notes.append("the voltage does not fall with the charge beyond doubt: it is taken as the same at any charge")
        linear = None
    fit = linear or constant
    ohm, ohm_std = float(fit.values[1]), fit.std(1)
    found = ohm > SIGNIFICANCE * ohm_std
    if not found:
        notes.append(
            "the resistance cannot be estimated: "
            f"the current varies by {np.std(amps):.3g} A about {np.mean(amps):.3g} A, "
            f"which gives {ohm:.3g} ± {ohm_std:.2g} Ω"
        )
        # without a resistance, fit the terminal voltage
        columns = [np.ones_like(amps), charge] if linear else [np.ones_like(amps)]
        fit = _regressed(np.stack(columns, axis=1), volts, t)
    ends = np.zeros((2, len(fit.values)))  # without charge, and full
    ends[:, 0] = 1.0
    if linear:
        ends[1, -1] = 1.0
    empty, full = (ends @ fit.values).tolist()
    empty_std, full_std = np.sqrt(np.einsum("ij,jk,ik->i", ends, fit.covariance, ends))
    return BatteryFit(
        full,
        empty if linear else None,
        ohm if found else None,
        float(full_std),
        float(empty_std) if linear else 0.0,
        ohm_std if found else 0.0,
        fit.rms,
        constant.rms,
        float(charge[0]),
        float(charge[-1]),
        fit.correlation_s,
        tuple(notes),
    )


@dataclass(frozen=True)
class _Regression:
    values: FloatArray
    covariance: FloatArray
    rms: float
    correlation_s: float

    def std(self, index: int) -> float:
        return math.sqrt(max(0.0, float(self.covariance[index, index])))


def _regressed(columns: FloatArray, target: FloatArray, times_s: FloatArray) -> _Regression:
    """Least squares with Huber's weights and an autocorrelation-consistent covariance."""
    weights: FloatArray = np.ones(len(target))
    values: FloatArray = np.zeros(columns.shape[1])
    residual: FloatArray = target
    for _ in range(PASSES):
        root = np.sqrt(weights)
        new: FloatArray = np.asarray(
            np.linalg.lstsq(columns * root[:, None], target * root, rcond=None)[0], dtype=np.float64
        )
        residual = target - columns @ new
        scale = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        done = bool(np.allclose(new, values, rtol=1e-10, atol=1e-12))
        values = new
        if done or scale == 0:
            break
        weights = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
    lags = _correlation_lags(residual)
    inner = columns.T @ (columns * weights[:, None])
    scores = columns * (weights * residual)[:, None]
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        # Bartlett's weights keep the sum of autocovariances positive
        cross = scores[lag:].T @ scores[:-lag]
        middle += (1 - lag / (lags + 1)) * (cross + cross.T)
    inverse: FloatArray = np.asarray(np.linalg.pinv(inner), dtype=np.float64)
    covariance = inverse @ middle @ inverse * len(target) / max(1, len(target) - len(values))
    rms = math.sqrt(float(np.mean(residual**2)))
    return _Regression(values, covariance, rms, lags / 2 * float(np.median(np.diff(times_s))))


def _correlation_lags(residual: FloatArray) -> int:
    """Lags over which residuals correlate: twice those until their autocorrelation falls below a twentieth."""
    n = len(residual)
    centred = residual - residual.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    correlation = np.fft.irfft(spectrum, size)[: n // 4 + 1]
    if correlation[0] <= 0:
        return 0
    below = np.flatnonzero(correlation < 0.05 * correlation[0])
    return int(min(n // 4, 2 * (below[0] if len(below) else n // 4)))

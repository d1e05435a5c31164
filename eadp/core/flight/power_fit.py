"""An aeroplane's power from a log of power, airspeed, bank and climb: level flight, turns and climbs.

In steady flight the electrical power is P = A V³ + B n²/V + C + k (ḣ + V V̇/g), n² = 1 + tan² φ: parasitic and induced
drag, what is drawn at any throttle, and the rise with the energy height. A = ½ρS C_D0/η, B = 2K W²/(ρSη), k = W/η. It
is linear in what is sought, so that means over windows obey it exactly; gusts, above all vertical ones, are its noise.

Source: Anderson 1999, chapters 2, 5 and 6; Huber 1964 and Newey and West 1987 for the regression.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eadp.core.arrays import FloatArray
from eadp.core.flight.aerodynamics import GRAVITY_MPS2
from eadp.core.signals.robust import regressed
from eadp.errors import Infeasible

WINDOW_S = 5.0
"""Length of the windows that are averaged [s]: in shorter ones, gusts that change airspeed and climb bias the rises."""

MIN_WINDOWS = 20
MIN_AIRSPEED_MPS = 3.0
"""Airspeed below which an aeroplane does not fly [m/s]."""

MAX_SINK_MPS, IDLE_SHARE = 0.5, 0.25
"""Windows that sink faster [m/s], or draw less than this share of the median power, are a glide: the motor idles."""

MIN_SPREAD = 1.2
"""Ratio of airspeeds, the 95th to the 5th percentile, from which on a drag polar is fitted."""

SLOPE = 2.0
"""Exponent of the airspeed in the power near one airspeed, where none can be fitted: between drag at its minimum (1)
and drag that is all parasitic (3)."""

MIN_BANK_RAD = math.radians(10)
"""Largest bank (95th percentile) below which its rise is not fitted."""

SIGNIFICANCE = 3.0
"""Distance from 0, in standard errors, at which a coefficient is significant."""


@dataclass(frozen=True)
class PowerFit:
    """Power of an aeroplane; standard errors hold under correlated noise.

    Attributes
    ----------
    airspeed_mps : float
        Median airspeed V₀ [m/s], at which the coefficients are powers.
    speeds_mps : tuple of float
        Airspeeds flown, the 5th and the 95th percentile [m/s].
    polar : bool
        Whether a drag polar is fitted; else the power near one airspeed.
    parasitic_w, induced_w, constant_w : float
        A V₀³, B/V₀ and C [W]; without a polar the level power at V₀, the rise with tan² φ, and 0.
    climb_w_per_mps : float or None
        Rise with climb k [W s/m]; None where it is not significant.
    bank_w : float or None
        Rise with tan² φ at V₀ [W]; None where it is not significant.
    stds : dict of str to float
        Standard errors of the level power at V₀, `level_w`, and of the coefficients by name, where they are estimated.
    rms_w, correlation_s : float
        Root mean square and correlation time of the residuals of windows [W, s].
    windows, idle : int
        Windows used, and windows left out because the motor idles.
    notes : tuple of str
        What could not be identified, and why.
    """

    airspeed_mps: float
    speeds_mps: tuple[float, float]
    polar: bool
    parasitic_w: float
    induced_w: float
    constant_w: float
    climb_w_per_mps: float | None
    bank_w: float | None
    stds: dict[str, float]
    rms_w: float
    correlation_s: float
    windows: int
    idle: int
    notes: tuple[str, ...]

    def level_power_w(self, airspeed_mps: float) -> float:
        """Power in straight level flight [W]."""
        ratio = airspeed_mps / self.airspeed_mps
        exponent = 3.0 if self.polar else SLOPE
        straight = self.parasitic_w * math.pow(ratio, exponent)
        return straight + self.induced_w / ratio + self.constant_w if self.polar else straight


def fit_power(
    times_s: FloatArray,
    power_w: FloatArray,
    airspeed_mps: FloatArray,
    bank_rad: FloatArray | None = None,
    climb_mps: FloatArray | None = None,
    *,
    constant_w: float | None = None,
) -> PowerFit:
    """Fit an aeroplane's power to a log.

    Parameters
    ----------
    times_s, power_w, airspeed_mps : array, shape (n,)
        Times [s], increasing; power [W]; true airspeed [m/s].
    bank_rad, climb_mps : array, shape (n,), optional
        Bank [rad] and rate of climb [m/s].
    constant_w : float, optional
        What is drawn at any throttle [W], where it is known: without it low speeds are less certain.

    Raises
    ------
    Infeasible
        If there are too few readings in flight, or the power does not rise with the drag.

    Source: Anderson 1999, chapters 2, 5 and 6.
    """
    tables = [times_s, power_w, airspeed_mps, *(each for each in (bank_rad, climb_mps) if each is not None)]
    known = np.isfinite(np.stack(tables)).all(axis=0) & (airspeed_mps >= MIN_AIRSPEED_MPS)
    if (count := np.count_nonzero(known)) < MIN_WINDOWS:
        raise Infeasible(f"{count} readings in flight with an airspeed; {MIN_WINDOWS} or more are needed")
    t, watts, speed = times_s[known], power_w[known], airspeed_mps[known]
    bank = np.zeros_like(t) if bank_rad is None else bank_rad[known]
    climb = np.zeros_like(t) if climb_mps is None else climb_mps[known]
    window = _Windows(t)
    if len(window.times_s) < MIN_WINDOWS:
        raise Infeasible(f"{len(window.times_s)} windows of {WINDOW_S:g} s in flight; {MIN_WINDOWS} or more are needed")
    middle = float(np.median(speed))
    low, high = (float(v) for v in np.percentile(speed, (5, 95)))
    mean_w, sink = window.mean(watts), window.mean(climb)
    # ḣ + V V̇/g
    rise = sink + window.mean(np.gradient(speed**2, t)) / (2 * GRAVITY_MPS2)
    flown = (sink > -MAX_SINK_MPS) & (mean_w > IDLE_SHARE * np.median(mean_w))
    if np.count_nonzero(flown) < MIN_WINDOWS:
        raise Infeasible(f"{np.count_nonzero(flown)} windows with the motor running; {MIN_WINDOWS} or more are needed")
    notes = []
    turned = window.mean(np.tan(np.clip(bank, -1.4, 1.4)) ** 2 * middle / speed)
    polar = high / low >= MIN_SPREAD
    if bank_rad is None or np.percentile(np.abs(bank), 95) < MIN_BANK_RAD:
        notes.append("the rise with bank: " + ("no bank in the log" if bank_rad is None else "no turns in the log"))
        turned = np.zeros_like(turned)
    if climb_mps is None:
        notes.append("the rise with climb: no climb or altitude in the log; it is that of the airspeed's changes")
    if not polar:
        notes.append(f"the drag polar: airspeeds from {low:.3g} to {high:.3g} m/s; a ratio of {MIN_SPREAD:g} is needed")
    columns = {"climb_w_per_mps": rise, **_drag_columns(window, speed / middle, turned, polar=polar)}
    fixed = (constant_w or 0.0) if polar else 0.0
    if polar and constant_w is None:
        columns["constant_w"] = np.ones_like(mean_w)
    table = np.stack(list(columns.values()), axis=1)[flown]
    fit = regressed(table, mean_w[flown] - fixed, window.times_s[flown])
    value: dict[str, float] = dict(zip(columns, fit.values.tolist(), strict=True))
    beside = {"climb_w_per_mps"} if polar else {"climb_w_per_mps", "induced_w"}
    level = np.array([float(name not in beside) for name in columns])
    stds = {name: max(fit.std(i), math.sqrt(fit.first_order[i, i])) for i, name in enumerate(columns)}
    stds["level_w"] = math.sqrt(max(float(level @ each @ level) for each in (fit.covariance, fit.first_order)))
    if polar and (value["parasitic_w"] <= 0 or value["induced_w"] <= 0):
        notes.append("the drag polar: the power does not have its form; windows or airspeeds are too few")

    climbs, turns = "the rise with climb [W s/m]", "the rise with tan² of the bank [W]"
    climb_w = _significant("climb_w_per_mps", climbs, value, stds, notes)
    bank_w = _significant("induced_w", turns, value, stds, notes) if turned.any() else None
    return PowerFit(
        middle,
        (low, high),
        polar,
        value["parasitic_w"],
        value.get("induced_w", 0.0),
        value.get("constant_w", fixed),
        climb_w,
        bank_w,
        stds,
        fit.rms,
        fit.correlation_s,
        int(np.count_nonzero(flown)),
        int(np.count_nonzero(~flown)),
        tuple(notes),
    )


def _drag_columns(window: _Windows, ratio: FloatArray, turned: FloatArray, *, polar: bool) -> dict[str, FloatArray]:
    """Regressors of the drag's power: the polar's, or a power of the airspeed where that is not identified."""
    if polar:
        return {"parasitic_w": window.mean(ratio**3), "induced_w": window.mean(1 / ratio) + turned}
    columns = {"parasitic_w": window.mean(ratio**SLOPE)}
    return {**columns, "induced_w": turned} if turned.any() else columns


def _significant(
    name: str, words: str, value: dict[str, float], stds: dict[str, float], notes: list[str]
) -> float | None:
    """A coefficient that is known to be above 0; None where it is not, with a note."""
    if name in value and value[name] <= SIGNIFICANCE * stds[name]:
        notes.append(f"{words}: {value[name]:.3g} ± {stds[name]:.2g}, too uncertain")
        return None
    return value.get(name)


class _Windows:
    """Windows of a log; one with less than half of its readings is left out."""

    def __init__(self, times_s: FloatArray) -> None:
        index = np.floor((times_s - times_s[0]) / WINDOW_S).astype(int)
        counts = np.bincount(index)
        full = counts >= 0.5 * WINDOW_S / float(np.median(np.diff(times_s)))
        full &= counts >= 2
        self._index, self._counts, self._full = index, np.maximum(counts, 1), full
        self.times_s = self.mean(times_s)

    def mean(self, values: FloatArray) -> FloatArray:
        """Means of readings, one for each window."""
        means: FloatArray = (np.bincount(self._index, weights=values) / self._counts)[self._full]
        return means

"""Power of the motion in flight: a regression on level flight, turns and climbs."""

from __future__ import annotations

import math
from typing import NamedTuple

from eadp.core.arrays import Column, columns
from eadp.core.compiled import jitted
from eadp.planning.state.known import MotionKnown
from eadp.planning.state.level_regression import (
    WINDOW_S,
    Prior,
    Regression,
    in_doubt,
    lasting_noise,
    started,
    with_window,
)

TURN_SHARE = 0.3
"""Prior mean and standard deviation of the power per tan² φ, as a share of level flight's: induced drag is about a
third of the drag at cruise."""

LEVEL_SHARE = 0.05
"""Relative prior standard deviation of level flight's power."""

CLIMB_SHARE = 0.3
"""Relative prior standard deviation of the power per climb rate: at full throttle the propulsion's efficiency is
another."""

STEP_SHARE = 0.15
"""The least lasting change of level flight's power to recognise, as a share of it: one of 20 % is, soon."""

UNKNOWN_W = (1000.0, 30.0)
"""Standard deviations of level flight's power and of a bank's without prior values [W]."""

POWER_SHARE, MIN_POWER_STD_W = 0.03, 0.2
"""Prior standard deviation of a window's mean power, as a share of the level's and at least [W]."""


class MotionWindow(NamedTuple):
    """Energy [J] of the window of readings that is open, its time [s], and its climb [m]."""

    energy_j: float
    seconds: float
    climb_m: float


class MotionState(NamedTuple):
    """State of `MotionPower`."""

    window: MotionWindow
    regression: Regression


class MotionPower:
    """Regression of the motion power, a + b tan² φ + c v_z, on means over short windows; see `level_regression`.

    Windows count as independent, which holds for gusts shorter than one.

    Parameters
    ----------
    level_w : float
        Prior power of level flight [W]; 0 where it is not known.
    level_share : float
        Its standard deviation, as a share of it.
    climb_j_per_m : float
        Prior energy of a metre of climb [J/m]: m g/η.

    Source: induced drag grows with the square of the load factor (Anderson 1999); Bayesian linear regression.
    """

    def __init__(self, level_w: float, level_share: float = LEVEL_SHARE, climb_j_per_m: float = 0.0) -> None:
        level_std, slope_std = (level_share * level_w, TURN_SHARE * level_w) if level_w else UNKNOWN_W
        climb_std = CLIMB_SHARE * climb_j_per_m or UNKNOWN_W[1]
        prior = Prior(
            a=level_w,
            b=TURN_SHARE * level_w,
            c=climb_j_per_m,
            information_a=1 / level_std**2,
            information_b=1 / slope_std**2,
            information_c=1 / climb_std**2,
            noise=WINDOW_S * max(POWER_SHARE * level_w, MIN_POWER_STD_W) ** 2,
        )
        self._state = MotionState(MotionWindow(0.0, 0.0, 0.0), started(prior))

    def ingest(self, powers_w: Column, beside_w: Column, steps_s: Column, slope: float, climb_mps: float = 0.0) -> None:
        """Add readings on one leg, in order, to the window that is open, and full windows to the regression.

        Parameters
        ----------
        powers_w, beside_w : sequence of float or array, shape (n,)
            Readings of power, NaN for none, and the part of each that is not the motion's [W].
        steps_s : sequence of float or array, shape (n,)
            Times since the last reading [s]; a reading without a time counts for nothing.
        slope : float
            Mean tan² φ of the leg.
        climb_mps : float
            Measured rate of climb [m/s].
        """
        ingested = jitted(_ingested)
        powers_w, beside_w, steps_s = columns(powers_w, beside_w, steps_s)
        self._state = ingested(self._state, powers_w, beside_w, steps_s, slope, climb_mps)

    def end_window(self, slope: float) -> None:
        """End the window of readings at the end of a leg, of mean tan² φ `slope`, and update the regression with it."""
        self._state = _window_ended(self._state, slope)

    def known(self, max_w: float = math.inf) -> MotionKnown:
        """What is known of the power, which reaches at most this [W]."""
        fit = self._state.regression.fit
        return MotionKnown(
            level_w=fit.a,
            slope_w=max(fit.b, 0.0),
            var_level=fit.aa,
            cov_level_slope=fit.ab,
            var_slope=fit.bb,
            noise=lasting_noise(self._state.regression),
            max_w=max_w,
            climb_j_per_m=max(fit.c, 0.0),
            in_doubt=in_doubt(self._state.regression),
        )


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(
    state: MotionState, powers_w: Column, beside_w: Column, steps_s: Column, slope: float, climb_mps: float
) -> MotionState:
    """The state after readings, see `MotionPower.ingest`: each adds to the window, which ends when it is full."""
    for i in range(len(powers_w)):
        if steps_s[i] > 0.0 and not math.isnan(powers_w[i]):
            window = state.window
            energy_j = window.energy_j + (powers_w[i] - beside_w[i]) * steps_s[i]
            climb_m = window.climb_m + climb_mps * steps_s[i]
            state = MotionState(MotionWindow(energy_j, window.seconds + steps_s[i], climb_m), state.regression)
            if state.window.seconds >= WINDOW_S - 1e-9:
                state = _window_ended(state, slope)
    return state


def _window_ended(state: MotionState, slope: float) -> MotionState:
    """The state after the window that is open: an empty one, and the regression with its means.

    One shorter than half of `WINDOW_S` is left out.
    """
    window, regression = state
    seconds = window.seconds
    if seconds >= WINDOW_S / 2:
        mean_w, climb_mps = window.energy_j / seconds, window.climb_m / seconds
        min_step_w = max(STEP_SHARE * abs(regression.fit.a), MIN_POWER_STD_W)
        regression = with_window(regression, seconds, mean_w, slope, climb_mps, min_step_w)
    return MotionState(MotionWindow(0.0, 0.0, 0.0), regression)

"""Power of the motion in flight: a regression on level flight, turns and climbs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from eadp.core.arrays import Column, FloatArray, columns
from eadp.core.compiled import jitted
from eadp.models.vehicle import LEVEL_SHARE, Airframe
from eadp.planning.state.known import MotionKnown, terms_of
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

POLAR_SHARE = 0.2
"""Relative prior standard deviation of the power per tan² φ by the airframe's polar: with level flight's power known,
by an Oswald efficiency known to 15 % and a C_D0 known to 20 %."""

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
    """A window of readings: energy [J], time [s], climb [m], and time integrals of `PowerTerms` [s].

    Numbers of the window that is open; of several readings, what each adds to it, columns.
    """

    energy_j: Any = 0.0
    seconds: Any = 0.0
    climb_m: Any = 0.0
    level_s: Any = 0.0
    flat_s: Any = 0.0
    turn_s: Any = 0.0


class MotionState(NamedTuple):
    """State of `MotionPower`."""

    window: MotionWindow
    regression: Regression


class MotionPower:
    """Regression of the motion power, a + b tan² φ + c v_z, on means over short windows; see `level_regression`.

    At another airspeed it is level · a + (flat + turn · tan² φ) · b + c v_z by `PowerTerms`: divided by `level`, with
    a weight by its square, a window of the same regression. Windows count as independent, which holds for gusts
    shorter than one.

    Parameters
    ----------
    level_w : float
        Prior power of level flight [W]; 0 where it is not known.
    airframe : Airframe
    level_share : float
        Its standard deviation, as a share of it.
    climb_j_per_m : float
        Prior energy of a metre of climb [J/m]: m g/η.
    by_polar : bool
        Whether the prior power of a bank is the airframe's own, as where other airspeeds are flown.

    Source: induced drag grows with the square of the load factor (Anderson 1999); Bayesian linear regression.
    """

    def __init__(
        self,
        level_w: float,
        airframe: Airframe,
        level_share: float = LEVEL_SHARE,
        climb_j_per_m: float = 0.0,
        *,
        by_polar: bool = False,
    ) -> None:
        self._airframe = airframe
        level_std, slope_std = (level_share * level_w, TURN_SHARE * level_w) if level_w else UNKNOWN_W
        slope_w = TURN_SHARE * level_w
        if by_polar:
            slope_w = airframe.level_power_w(airframe.airspeed_mps, math.pi / 4) - airframe.cruise_power_w
            slope_std = POLAR_SHARE * slope_w or slope_std
        climb_std = CLIMB_SHARE * climb_j_per_m or UNKNOWN_W[1]
        prior = Prior(
            a=level_w,
            b=slope_w,
            c=climb_j_per_m,
            information_a=1 / level_std**2,
            information_b=1 / slope_std**2,
            information_c=1 / climb_std**2,
            noise=WINDOW_S * max(POWER_SHARE * level_w, MIN_POWER_STD_W) ** 2,
        )
        self._state = MotionState(MotionWindow(), started(prior))

    def ingest(
        self,
        powers_w: Column,
        beside_w: Column | float,
        steps_s: Column,
        slope: float,
        climb_mps: float = 0.0,
        airspeeds_mps: FloatArray | None = None,
    ) -> None:
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
        airspeeds_mps : array, shape (n,), optional
            Airspeeds [m/s]; by default the airframe's own.
        """
        steps = np.asarray(steps_s, dtype=float)
        own = np.full(len(steps), self._airframe.airspeed_mps) if airspeeds_mps is None else airspeeds_mps
        *terms, own_w = terms_of(self._airframe, own)
        energies_j = (np.asarray(powers_w, dtype=float) - (own_w + beside_w)) * steps
        added = columns(energies_j, steps, climb_mps * steps, *(term * steps for term in terms))
        self._state = jitted(_ingested)(self._state, MotionWindow(*added), slope)

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
            airframe=self._airframe,
            in_doubt=in_doubt(self._state.regression),
        )


# The functions below may be compiled, see `eadp.core.compiled`.


def _ingested(state: MotionState, added: MotionWindow, slope: float) -> MotionState:
    """The state after readings, see `MotionPower.ingest`: each adds to the window, which ends when it is full."""
    energies_j, steps_s, climbs_m, levels_s, flats_s, turns_s = added
    for i in range(len(steps_s)):
        if steps_s[i] > 0.0 and not math.isnan(energies_j[i]):
            window = state.window
            window = MotionWindow(
                window.energy_j + energies_j[i],
                window.seconds + steps_s[i],
                window.climb_m + climbs_m[i],
                window.level_s + levels_s[i],
                window.flat_s + flats_s[i],
                window.turn_s + turns_s[i],
            )
            state = MotionState(window, state.regression)
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
        level = window.level_s / seconds
        # y/l = a + b x/l + c z/l, whose noise is that of y over l
        mean_w, climb_mps = window.energy_j / seconds / level, window.climb_m / seconds / level
        x = (window.flat_s / seconds + window.turn_s / seconds * slope) / level
        min_step_w = max(STEP_SHARE * abs(regression.fit.a), MIN_POWER_STD_W)
        regression = with_window(regression, seconds * level * level, mean_w, x, climb_mps, min_step_w)
    return MotionState(MotionWindow(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), regression)

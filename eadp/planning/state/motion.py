"""Power of the motion in flight: a regression on level flight, turns and climbs."""

from __future__ import annotations

import math

import numpy as np

from eadp.core.arrays import Column, FloatArray
from eadp.models.vehicle import LEVEL_SHARE, Airframe
from eadp.planning.state.known import MotionKnown, terms_of
from eadp.planning.state.level_regression import WINDOW_S, Prior, Regression

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


NO_WINDOW: FloatArray = np.zeros(6)
"""A window without readings: energy [J], time [s], climb [m], and time integrals of `PowerTerms` [s]."""


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
            mean=np.array([level_w, slope_w, climb_j_per_m]),
            information=1 / np.array([level_std, slope_std, climb_std]) ** 2,
            noise=WINDOW_S * max(POWER_SHARE * level_w, MIN_POWER_STD_W) ** 2,
        )
        self.regression, self._window = Regression.started(prior), NO_WINDOW

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
        own = np.full(len(steps_s), self._airframe.airspeed_mps) if airspeeds_mps is None else airspeeds_mps
        level, flat, turn, own_w = terms_of(self._airframe, own)
        steps, watts = np.asarray(steps_s, dtype=float), np.asarray(powers_w, dtype=float) - own_w - beside_w
        steps = np.where(np.isnan(watts), 0.0, steps)
        one, climb = np.ones(len(steps)), np.full(len(steps), climb_mps)
        integrals = steps * np.array([np.nan_to_num(watts), one, climb, level, flat, turn])
        while integrals.size:
            seconds = self._window[1] + np.cumsum(integrals[1])
            count = int(np.searchsorted(seconds, WINDOW_S - 1e-9)) + 1  # up to the reading with which it is full
            self._window = self._window + integrals[:, :count].sum(axis=1)
            integrals = integrals[:, count:]
            if count <= len(seconds):
                self.end_window(slope)

    def end_window(self, slope: float) -> None:
        """End the window of readings, as at the end of a leg of mean tan² φ `slope`, and update the regression with it.

        One shorter than half of `WINDOW_S` is left out.
        """
        window, self._window = self._window, NO_WINDOW
        seconds = float(window[1])
        if seconds < WINDOW_S / 2:
            return
        mean_w, _, climb_mps, level, flat, turn = (window / seconds).tolist()
        # y/l = a + b x/l + c z/l, whose noise is that of y over l
        x, min_step_w = (
            (flat + turn * slope) / level,
            max(STEP_SHARE * abs(self.regression.fit.mean[0]), MIN_POWER_STD_W),
        )
        self.regression = self.regression.with_window(
            seconds * level * level, mean_w / level, x, climb_mps / level, min_step_w
        )

    def known(self, max_w: float = math.inf) -> MotionKnown:
        """What is known of the power, which reaches at most this [W]."""
        fit = self.regression.fit
        level_w, slope_w, climb_j_per_m = fit.mean.tolist()
        return MotionKnown(
            level_w=level_w,
            slope_w=max(slope_w, 0.0),
            var_level=float(fit.covariance[0, 0]),
            cov_level_slope=float(fit.covariance[0, 1]),
            var_slope=float(fit.covariance[1, 1]),
            noise=self.regression.lasting_noise,
            max_w=max_w,
            climb_j_per_m=max(climb_j_per_m, 0.0),
            airframe=self._airframe,
            in_doubt=self.regression.in_doubt,
        )

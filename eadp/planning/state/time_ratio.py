"""Ratio of flown to forecast times of legs."""

from __future__ import annotations

import math

RATIO_STD = 0.02
"""Prior standard deviation of the ratio of flown to forecast time, common to all legs."""

TIME_NOISE_S, TIME_NOISE_LEGS = 0.002, 4
"""Prior variance of a leg's time per second of it [s²/s] without gusts, and its weight in legs."""


class TimeRatio:
    """Ratio of flown to forecast leg times, and the noise of each.

    A regression through the origin: flown − forecast = β · forecast + noise, whose variance grows with the time.

    Attributes
    ----------
    ratio : float
        1 + β.
    noise_s : float
        Variance of the noise per second [s²/s].

    Source: Bayesian linear regression with a normal prior.
    """

    def __init__(self) -> None:
        self.noise_s = TIME_NOISE_S
        self.ratio = 1.0
        # sums over the legs flown, Σ forecast and Σ (flown − forecast); and each leg's forecast and flown time [s]
        self._forecast_s = self._excess_s = 0.0
        self._legs: list[tuple[float, float]] = []

    def learn(
        self, forecast_s: float, flown_s: float, gust_std_mps: float, airspeed_mps: float, gust_time_s: float
    ) -> None:
        """Update with a flown leg.

        Parameters
        ----------
        forecast_s, flown_s : float
            Its forecast and its flown time [s].
        gust_std_mps, airspeed_mps, gust_time_s : float
            Standard deviation of the gusts, airspeed [m/s] and correlation time of the gusts [s], for the prior noise.
        """
        if not (forecast_s > 0 and math.isfinite(forecast_s)):
            return
        self._legs.append((forecast_s, flown_s))
        self._forecast_s += forecast_s
        self._excess_s += flown_s - forecast_s
        # β = Σ (flown − forecast) / (Σ forecast + σ²/σ_β²): first with the σ² so far, whose residuals give the new σ²
        prior_noise_s = _expected_noise_s(gust_std_mps, airspeed_mps, gust_time_s)
        beta = self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)
        squares = sum((flown - (1 + beta) * expected_s) ** 2 / expected_s for expected_s, flown in self._legs)
        self.noise_s = (TIME_NOISE_LEGS * prior_noise_s + squares) / (TIME_NOISE_LEGS + len(self._legs))
        self.ratio = 1.0 + self._excess_s / (self._forecast_s + self.noise_s / RATIO_STD**2)

    def expect(self, gust_std_mps: float, airspeed_mps: float, gust_time_s: float) -> None:
        """Set the prior noise from forecast gusts, before any leg is flown."""
        self.noise_s = _expected_noise_s(gust_std_mps, airspeed_mps, gust_time_s)

    @property
    def variance(self) -> float:
        """Variance of the ratio, of its posterior: σ² / (Σ forecast + σ²/σ_β²)."""
        return self.noise_s / (self._forecast_s + self.noise_s / RATIO_STD**2)


def _expected_noise_s(gust_std_mps: float, airspeed_mps: float, gust_time_s: float) -> float:
    """Prior variance of a leg's time per second of it, in gusts of a standard deviation and correlation time [s²/s]."""
    # a gust of σ and correlation time τ moves an aircraft by √(2 τ t) σ metres in t seconds
    return TIME_NOISE_S + 2 * gust_time_s * (gust_std_mps / airspeed_mps) ** 2

"""The voltage as a reading of the charge: a cell that is lost shows in it, and not in the charge drawn."""

from __future__ import annotations

import math

from eadp.models.battery import Battery
from eadp.planning.state.level_regression import WINDOW_S, Prior, started, with_window

LEVEL_SHARE, CURVE_SHARE, RESISTANCE_SHARE = 0.2, 0.5, 1.0
"""Prior standard deviations: of the full battery's voltage, as a share of that from empty to full; of the fall per
charge, for cells' curves are not straight; and of the resistance, with wires and temperature: as shares of them."""

NOISE_SHARE = 0.01
"""Prior standard deviation of a window's voltage, as a share of that from empty to full."""

STEP_SHARE = 0.1
"""The least lasting fall at the same current to recognise, as a share of the voltage from empty to full: so much is
unknown of the curve."""

LOSS_SHARE = 0.3
"""Standard deviation of a charge lost by the voltage, as a share of it: the curve's slope there."""

STRAIGHT_FROM = 0.1
"""State of charge below which usual cells' curves bend down: a fall there is no loss."""

MIN_SLOPE = 0.3
"""The least fall per charge that a loss is computed with, as a share of the straight line's: that of a plateau."""


class VoltageWatch:
    """Compares the voltage with that of the charge drawn and of the current: V = V₀ − s (1 − b) − R I.

    V₀, s and R are learned, see `level_regression`; a lasting fall of V₀ is a loss of charge, of its size over s.

    Parameters
    ----------
    battery : Battery

    Attributes
    ----------
    lost : float
        State of charge that the voltage has shown to be lost.
    """

    def __init__(self, battery: Battery) -> None:
        self.lost = 0.0
        # from empty to full [V]; 0 where the voltage shows nothing of the charge, so that nothing is learned
        self._rise_v = battery.voltage_at(1.0) - battery.voltage_at(0.0)
        self._last_s = math.nan
        # over the window that is open: t [s], ∫V dt [V s], ∫(1 − b) dt [s] and ∫I dt [A s]
        self._sums = 0.0, 0.0, 0.0, 0.0
        if self._rise_v <= 0 or battery.prescribed:  # a voltage without a curve
            self._rise_v = 0.0
            return
        resistance_ohm = max(battery.resistance_ohm, 1e-6)
        # y = V, x = 1 − b, z = I: a = V₀, b = −s, c = −R
        prior = Prior(
            a=battery.voltage_at(1.0),
            b=-self._rise_v,
            c=-resistance_ohm,
            information_a=1 / (LEVEL_SHARE * self._rise_v) ** 2,
            information_b=1 / (CURVE_SHARE * self._rise_v) ** 2,
            information_c=1 / (RESISTANCE_SHARE * resistance_ohm) ** 2,
            noise=WINDOW_S * (NOISE_SHARE * self._rise_v) ** 2,
        )
        self._regression = started(prior)

    @property
    def lost_std(self) -> float:
        """Standard deviation of `lost`."""
        return LOSS_SHARE * self.lost

    def ingest(self, time_s: float, voltage_v: float, power_w: float, soc: float) -> None:
        """Add a reading of the voltage [V], beside the power [W] and the gauge's charge, and update `lost`.

        Left out where the curve is not straight, and after a gap.
        """
        step_s, self._last_s = time_s - self._last_s, time_s
        straight = soc - self.lost >= STRAIGHT_FROM
        if not (self._rise_v and straight and voltage_v > 0 and 0 < step_s <= WINDOW_S):
            return
        integrals = step_s, step_s * voltage_v, step_s * (1 - soc), step_s * power_w / voltage_v
        seconds, volts, drawn, amps = (was + value for was, value in zip(self._sums, integrals, strict=True))
        self._sums = seconds, volts, drawn, amps
        if seconds < WINDOW_S:
            return
        # the window is full: its means go into the regression
        self._sums = 0.0, 0.0, 0.0, 0.0
        before, means = self._regression.steps, (volts / seconds, drawn / seconds, amps / seconds)
        self._regression = with_window(self._regression, seconds, *means, STEP_SHARE * self._rise_v)
        # a lasting fall of V₀ by ΔV, where one was recognised, is a loss of ΔV/s
        fell_v = -self._regression.step
        if self._regression.steps > before and fell_v > 0:
            self.lost = min(self.lost + fell_v / max(-self._regression.prior.b, MIN_SLOPE * self._rise_v), 1.0)

"""What the simulated aircraft's sensors make of the truth."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sensors:
    """Noise, delay and drop-outs of what a planner is told. By default there are none.

    `power_noise_w`, `position_noise_m` (each axis) and `soc_noise` are standard deviations of white noise on each
    observation; `delay_s` is how old what is told is; `drop_out_share` is the share of the time in which the power has
    no reading, in spells of `drop_out_s` on average.
    """

    power_noise_w: float = 0.0
    position_noise_m: float = 0.0
    soc_noise: float = 0.0
    delay_s: float = 0.0
    drop_out_share: float = 0.0
    drop_out_s: float = 2.0

    @property
    def ideal(self) -> bool:
        """Whether what is told is the truth."""
        noise = self.power_noise_w or self.position_noise_m or self.soc_noise
        return not (noise or self.delay_s or self.drop_out_share)

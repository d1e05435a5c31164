"""Errors of the simulated aircraft's sensors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from eadp.core.bounds import Duration, Share, Watts


@dataclass(frozen=True, slots=True)
class Sensors:
    """Noise, delay and drop-outs of the sensors. The noise is white; by default there is none."""

    power_noise_w: Watts = 0.0
    """Standard deviation of the power reading's noise [W]."""

    position_noise_m: Annotated[float, Ge(0), Le(1e4)] = 0.0
    """Standard deviation of the position's noise on each axis [m]."""

    soc_noise: Share = 0.0
    """Standard deviation of the noise of the state of charge, as a share of the full charge."""

    delay_s: Annotated[float, Ge(0), Le(60)] = 0.0
    """Age of every reading when the planner gets it [s]."""

    drop_out_share: Share = 0.0
    """Share of the time without a power reading."""

    drop_out_s: Duration = 2.0
    """Mean length of a drop-out of the power reading [s]."""

    @property
    def ideal(self) -> bool:
        """Whether the readings are exact: every field as by default, the length of drop-outs aside."""
        return self == Sensors(drop_out_s=self.drop_out_s)

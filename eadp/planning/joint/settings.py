"""Settings of planner `joint`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Lt

from eadp.core.arrays import NotNegative, Share
from eadp.planning.base import TradeOff


@dataclass(frozen=True)
class JointSettings:
    """Settings of planner `joint`."""

    reserve_probability: Annotated[float, Ge(0.5), Lt(1)] = 0.95
    """Probability with which the reserve is kept."""

    min_gain: Share = 0.01
    """Least gain of the quality U for which a path parameter is changed."""

    objective: Literal["quality"] = "quality"
    """What is maximised: the quality U, by the ground of the mission."""

    trade_offs: tuple[TradeOff, ...] = ()
    """Rows R c − r ≥ 0 that the computations keep to."""

    loss_rate_per_h: NotNegative = 0.5
    """Sudden losses of charge to expect before any is seen, of 2 to 12 % of the full charge each [1/h]."""

    max_interval_s: NotNegative = 30.0
    """Longest time between re-plannings [s]; the shortest is `planner.every_s`, which a flight with a home and
    `eadp replan` keep to."""

    airspeed: Literal["fixed", "when-short", "least-energy"] = "when-short"
    """Whether the airspeed is decided, within the aircraft's `airspeed_range_mps`: `when-short` slows the flight for as
    much quality as the battery allows, and no further; `least-energy` always takes the least energy for the ground."""

    start_after_s: NotNegative = 0.0
    """Time before which nothing is re-planned [s]."""

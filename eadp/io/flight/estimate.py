"""`estimate.csv`: what the planner knew of the power along a flight, and the battery that bounds it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from eadp.models.battery import Battery
from eadp.planning.estimation.estimator import LOOK_AHEADS, PowerEstimate
from eadp.simulation.loop import Step

DIGITS = 6


def estimate_rows(
    steps: Sequence[Step], estimates: Sequence[PowerEstimate], battery: Battery
) -> Iterator[Sequence[str | float]]:
    """Header and rows of `estimate.csv`: one for each logged step that has a new reading."""
    size = len(estimates[0].state) - 2
    yield [
        *("time_s", "period_s", *(f"q{i}_w" for i in range(size)), "computing_w", "battery_wh", "power_limit_w"),
        *("horizon_s", *(f"forecast_{k}_w" for k in range(LOOK_AHEADS + 1))),
    ]
    last_s = None
    for step, one in zip(steps, estimates, strict=True):
        if one.time_s == last_s:
            continue
        last_s, battery_wh = one.time_s, battery.energy_wh(step.soc)
        limits = one.computing_w, battery_wh, battery.power_limit_w(step.soc)
        values = [*one.state[:size].tolist(), *limits, one.horizon_s, *one.horizon_w().tolist()]
        period = "" if one.period_s is None else round(one.period_s, DIGITS)
        yield [round(one.time_s, 9), period, *("" if value == math.inf else round(value, DIGITS) for value in values)]

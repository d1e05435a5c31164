"""`estimate.csv`: what the planner knew of the power along a flight, and the battery that bounds it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from eadp.models.battery import Battery
from eadp.models.world import Step
from eadp.planning.estimation.estimator import LOOK_AHEADS, PowerEstimate

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
    read = []
    for step, one in zip(steps, estimates, strict=True):
        if one.time_s != last_s:
            last_s = one.time_s
            read.append((step, one))
    for _, same in itertools.groupby(read, key=lambda each: _horizon(each[1])):
        group = list(same)
        states = np.array([one.state for _, one in group])
        limits = [
            (one.computing_w, battery.energy_wh(step.soc), battery.power_limit_w(step.soc), one.horizon_s)
            for step, one in group
        ]
        first = group[0][1]
        forecasts_w = states @ first.horizon_rows().T + np.array([[one.computing_w] for _, one in group])
        period = "" if first.period_s is None else round(first.period_s, DIGITS)
        values = np.round(np.hstack([states[:, :size], limits, forecasts_w]), DIGITS)
        for (_, one), row in zip(group, values.tolist(), strict=True):
            yield [round(one.time_s, 9), period, *("" if value == math.inf else value for value in row)]


def _horizon(one: PowerEstimate) -> tuple[float | None, ...]:
    """What the forecasts of estimates are the same function of their states for."""
    return one.period_s, one.disturbance_s, one.horizon_s

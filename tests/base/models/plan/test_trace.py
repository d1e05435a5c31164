"""The nominal flight against hand-worked lengths."""

import math

import pytest
from common.plans import SHORT, plan_of

from eadp.errors import PathUndefined
from eadp.models.plan.trace import default_start, nominal_legs, trace, varied_legs

ON_CIRCLE = SHORT.replace("%: computations fps\n", "").replace("[2, 10]\n", "")


def test_a_plan_that_never_reaches_its_final_point_says_so():
    away = ON_CIRCLE.replace("180, 146", "-500, 146").replace("150 - 2*sqrt(4900 + c1)", "10")
    assert nominal_legs(plan_of(away), (0.0,))[-1].lap == 0, "beyond along the shift at once"
    with pytest.raises(PathUndefined, match="does not reach its final point"):
        nominal_legs(plan_of(ON_CIRCLE.replace("180, 146", "180, 300")), (0.0,))


def test_a_trace_without_end_is_refused():
    with pytest.raises(PathUndefined, match="5000000 points"):
        trace(plan_of(ON_CIRCLE), (0.0,), 1e-6)


def test_each_lap_alone_at_other_values_lies_where_the_laps_before_it_lead():
    """Lap k of ON_CIRCLE at c after k − 1 laps at 0: shifted k − 1 times by 10 m, and once by 150 − 2 √(4900 + c)."""
    laps = varied_legs(plan_of(ON_CIRCLE), (0.0,), (-900.0,))
    nominal = nominal_legs(plan_of(ON_CIRCLE), (0.0,))
    assert [len(lap) for lap in laps] == [sum(leg.lap == k for leg in nominal) for k in range(nominal[-1].lap + 1)]
    radius, shift = math.sqrt(4000), 150 - 2 * math.sqrt(4000)
    for k, lap in enumerate(laps):
        left = -115 + (10 * (k - 1) + shift if k else 0)
        assert lap[0].end_m == pytest.approx((left, 146))
        for point in lap[0].track.points((lap[0].start_m[0] - lap[0].offset_m[0], lap[0].start_m[1]), 50.0, 0.5, 5):
            x, y = point[0] + lap[0].offset_m[0], point[1]
            assert math.hypot(x - left - radius, y - 146) == pytest.approx(radius)
        for leg, (x, y) in zip(lap[1:], [(left, 0), (left + 150, 0), (left + 150, 146)], strict=False):
            assert leg.end_m == pytest.approx((x, y))
    assert laps[0][0].start_m == pytest.approx(default_start(plan_of(ON_CIRCLE), (-900.0,))[0])
    same = varied_legs(plan_of(ON_CIRCLE), (0.0,), (0.0,))
    ends = [leg.end_m for lap in same for leg in lap]
    assert ends == [pytest.approx(leg.end_m) for leg in nominal], "at the same values it is the nominal flight"

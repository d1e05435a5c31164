"""The picture of a plan: the range of its path parameters on every lap, and the names of stages and points."""

import numpy as np
import pytest
from common import ROOT
from common.plans import PARTS, plan_of
from matplotlib.figure import Figure

from eadp.io.figures.plan import _draw_range
from eadp.models.plan.trace import nominal_legs

SURVEY = (ROOT / "plans/survey.plan").read_text(encoding="utf-8")


def filled(text, parameters):
    """The filled areas [m²] and the extents [m] of the range."""
    axes = Figure().add_subplot()
    _draw_range(axes, plan_of(text), parameters)
    outlines = [path.vertices[:-1] for collection in axes.collections for path in collection.get_paths()]
    areas = [abs(np.sum(x * np.roll(y, 1) - y * np.roll(x, 1))) / 2 for x, y in (points.T for points in outlines)]
    return np.array(areas), outlines


@pytest.mark.parametrize(("text", "parameters"), [(SURVEY, (0.0, 10.0)), (PARTS, (0.0, 10.0))])
def test_every_lap_has_its_range(text, parameters):
    areas, outlines = filled(text, parameters)
    for leg in nominal_legs(plan_of(text), parameters):
        if leg.lap and leg.stage.kind == "circle":
            far_m = [np.hypot(points[:, 0] - leg.end_m[0], points[:, 1] - leg.end_m[1]).min() for points in outlines]
            assert areas[np.array(far_m) < 1].sum() > 100, f"lap {leg.lap}"

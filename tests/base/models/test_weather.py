"""The wind's vector from where it comes, or goes."""

import math

import pytest

from eadp.models.weather import Wind

EXACT = 1e-12


@pytest.mark.parametrize(
    ("angles", "vector"),
    [
        ({"from_deg": 270.0}, (4, 0)),  # a westerly wind blows to the east
        ({"from_deg": 0.0}, (0, -4)),
        ({"from_deg": 135.0}, (-4 * math.sqrt(0.5), 4 * math.sqrt(0.5))),
        ({"from_deg": 270.0, "towards_deg": 90.0}, (0, 4)),
        ({"towards_deg": 30.0}, (4 * math.sqrt(0.75), 2)),
    ],
)
def test_the_steady_winds_vector(angles, vector):
    assert Wind(speed_mps=4.0, **angles).steady_mps == pytest.approx(vector, abs=EXACT)

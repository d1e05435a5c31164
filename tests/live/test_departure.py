"""Whether the plan is flown: by the mode, else by the distance from the path."""

import pytest

from eadp.live.gate import FAR, Departure
from eadp.planning.base import Mode, Sample


def sample(time_s, flies_mission=None):
    return Sample(time_s, (0.0, 0.0), power_w=40.0, soc=0.9, mode=Mode(flies_mission))


@pytest.mark.parametrize("flies", [True, False])
def test_a_mode_decides_at_once_wherever_the_aircraft_is(flies):
    departure = Departure()
    departure.update(sample(0.0, flies), 0.0 if not flies else 100 * FAR)
    assert departure.away is not flies


def test_without_a_mode_the_distance_decides():
    departure = Departure()
    found = []
    for time_s, mismatch in enumerate([0.0, FAR + 1, FAR + 1, 0.0, FAR + 1, *[0.0] * 10, FAR + 1]):
        departure.update(sample(float(time_s)), mismatch)
        found.append(departure.away)
    # a circle that crosses the path for a moment is still away from it
    assert found == [False, *[True] * 8, *[False] * 6, True]
    assert departure.away_s == 1.0  # counts anew

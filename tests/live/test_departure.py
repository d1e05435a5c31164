"""Whether the plan is flown: by the mode, the distance from the path, and the airspeed."""

from __future__ import annotations

import numpy as np
import pytest

from eadp.live.gate import FAR, Departure
from eadp.planning.base import Mode, Sample

CRUISE_MPS = 15.0


def sample(time_s, airspeed_mps=None, flies_mission=None):
    return Sample(time_s, (0.0, 0.0), power_w=40.0, soc=0.9, airspeed_mps=airspeed_mps, mode=Mode(flies_mission))


@pytest.mark.parametrize("flies", [True, False])
def test_a_mode_decides_at_once_wherever_the_aircraft_is(flies):
    departure = Departure()
    departure.update(sample(0.0, CRUISE_MPS, flies), CRUISE_MPS, 0.0 if not flies else 100 * FAR)
    assert departure.away is not flies


def test_without_a_mode_the_distance_decides():
    departure = Departure()
    found = []
    for time_s, mismatch in enumerate([0.0, FAR + 1, FAR + 1, 0.0, FAR + 1, *[0.0] * 10, FAR + 1]):
        departure.update(sample(float(time_s)), CRUISE_MPS, mismatch)
        found.append(departure.away)
    # a circle that crosses the path for a moment is still away from it
    assert found == [False, *[True] * 8, *[False] * 6, True]
    assert departure.away_s == 1.0  # counts anew


def test_a_pilot_who_flies_faster_is_found_on_the_path():
    departure = Departure()
    for second in range(60):
        departure.update(sample(float(second), CRUISE_MPS), CRUISE_MPS, 0.0)
    found = []
    for second in range(60, 80):
        departure.update(sample(float(second), 20.0), CRUISE_MPS, 0.0)
        found.append(departure.away)
    assert found.index(True) <= 6
    assert all(found[6:])


def test_an_airspeed_that_is_commanded_is_no_pilots():
    """The aircraft takes 45 s from 15 to 10.5 m/s, as PX4 does; a minute later it flies at 15 m/s again, by a pilot."""
    departure, away = Departure(), []
    for second in range(240):
        commanded = CRUISE_MPS if second < 60 else 10.5
        flown = CRUISE_MPS if second >= 180 else float(np.interp(second, (60, 105), (CRUISE_MPS, 10.5)))
        departure.update(sample(float(second), flown), commanded, 0.0)
        away.append(departure.away)
    assert not any(away[:180])
    assert any(away[180:186])


def test_gusts_and_an_aircraft_that_is_slower_than_its_plan_are_no_pilot():
    """Gusts of 1.2 m/s that last for 2 s, about an airspeed of 13 m/s that the plan states as 15."""
    rng, departure, gust, away = np.random.default_rng(0), Departure(), 0.0, []
    for second in range(1200):
        gust = 0.6 * gust + 1.2 * 0.8 * rng.standard_normal()
        departure.update(sample(float(second), 13.0 + gust), CRUISE_MPS, 0.0)
        away.append(departure.away)
    assert sum(away[:60]) < 10  # until the aircraft's own airspeed is known
    assert not any(away[60:])


@pytest.mark.parametrize(("flies", "most_s"), [(True, 60), (None, 240)])
def test_another_airspeed_that_lasts_is_the_missions(flies, most_s):
    """15 to 11 m/s, as a ground station may command it: sooner where the mode says that the mission is flown."""
    departure, away = Departure(), 0
    for second in range(900):
        departure.update(sample(float(second), 15.0 if second < 300 else 11.0, flies), CRUISE_MPS, 0.0)
        away += departure.away
    assert not departure.away
    assert 0 < away <= most_s

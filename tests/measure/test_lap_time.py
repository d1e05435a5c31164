"""Laps told from positions: made tracks of known lap, and the published survey's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eadp.measure.power import MIN_POSITIONS, lap_time_s

LAP_S = 46.0


def track(times_s: np.ndarray, drift_mps: tuple[float, float] = (0.3, -0.05), noise_m: float = 2.0) -> np.ndarray:
    """A racetrack of two long lines and two turns that moves on from lap to lap."""
    turn = 2 * np.pi * times_s / LAP_S
    x = 70 * np.cos(turn) + drift_mps[0] * times_s
    y = 120 * np.clip(1.4 * np.sin(turn), -1, 1) + drift_mps[1] * times_s
    noise = np.random.default_rng(1).normal(0, noise_m, (2, len(times_s)))
    return np.stack([x, y], axis=1) + noise.T


@pytest.mark.parametrize("periods", [2.2, 3, 6.5, 30])
def test_lap_of_a_survey(periods: float) -> None:
    times = np.arange(0, periods * LAP_S, 1.0)
    assert lap_time_s(times, track(times)) == pytest.approx(LAP_S, rel=0.02)


def test_positions_that_are_not_known_are_skipped() -> None:
    rng = np.random.default_rng(2)
    times = np.sort(rng.uniform(0, 300, 600))
    position = track(times)
    position[rng.random(600) < 0.4] = np.nan
    position[200:240, 0] = np.nan
    assert lap_time_s(times, position) == pytest.approx(LAP_S, rel=0.02)


def test_metres_or_kilometres_and_any_start_are_the_same() -> None:
    times = np.arange(0, 300, 1.0)
    lap = lap_time_s(times, track(times))
    assert lap_time_s(times + 1e6, 1e-3 * track(times) + 5) == pytest.approx(lap, rel=1e-9)


@pytest.mark.parametrize("kind", ["straight", "still", "one circle", "walk", "unknown", "few"])
def test_a_flight_without_laps(kind: str) -> None:
    times = np.arange(0, 200, 1.0)
    walk = np.cumsum(np.random.default_rng(5).normal(size=(200, 2)), axis=0)
    position = {
        "straight": np.stack([15 * times, 3 * times], axis=1),
        "still": np.zeros((200, 2)),
        "one circle": np.stack([np.cos(times / 25), np.sin(times / 25)], axis=1),
        "walk": walk,
        "unknown": np.full((200, 2), np.nan),
        "few": np.where(np.arange(200)[:, np.newaxis] < MIN_POSITIONS - 1, track(times), np.nan),
    }[kind]
    assert lap_time_s(times, position) is None


def test_lap_of_the_published_survey(reference: Path) -> None:
    position = np.loadtxt(reference / "logs" / "opterra_position.csv", delimiter=",")
    assert lap_time_s(np.arange(len(position)), position) == pytest.approx(49.6, abs=0.3)

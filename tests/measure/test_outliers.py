"""Spikes: found where they were put, and nowhere else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.measure.noise import MAX_SHARE, WINDOW, spikes


def wavy(n: int = 600, noise_w: float = 0.5) -> np.ndarray:
    return 36 + 3 * np.sin(np.arange(n) / 9) + noise_w * np.random.default_rng(1).normal(size=n)


@pytest.mark.parametrize("height_w", [15.0, -15.0, 1e6])
@pytest.mark.parametrize("noise_w", [0.0, 0.5])
def test_spikes_are_found_where_they_are(height_w: float, noise_w: float) -> None:
    power = wavy(noise_w=noise_w)
    places = [0, 57, 58, 300, 599]
    power[places] += height_w
    assert np.flatnonzero(spikes(power)).tolist() == places


@pytest.mark.parametrize("kind", ["clean", "noise", "square", "peaks", "step", "quantised", "constant", "heavy tails"])
def test_what_is_no_spike(kind: str) -> None:
    n, rng = 900, np.random.default_rng(3)
    t = np.arange(n)
    power = {
        "clean": wavy(n, 0.0),
        "noise": rng.normal(size=n),
        "square": np.where(t % 40 < 13, 40.0, 30.0),
        "peaks": 30 + 10 * np.exp(-(((t % 50 - 25) / 3) ** 2)),
        "step": np.where(t > 400, 40.0, 30.0),
        "quantised": np.round(wavy(n)),
        "constant": np.full(n, 30.0),
        "heavy tails": rng.standard_t(1.2, n),
    }[kind]
    found = spikes(power)
    assert np.mean(found) <= (MAX_SHARE if kind == "heavy tails" else 0.0)


@given(st.lists(st.floats(-1e9, 1e9), min_size=WINDOW, max_size=60), st.floats(0.01, 100), st.floats(-1000, 1000))
def test_never_more_than_the_limit_whatever_comes(values: list[float], factor: float, offset: float) -> None:
    power = np.array(values)
    found = spikes(power)
    assert found.mean() <= MAX_SHARE
    assert len(spikes(factor * power + offset)) == len(found)

"""From samples to a model: spikes taken out, made signals as the oracle."""

import numpy as np
import pytest
from common import few
from scipy.signal import lfilter

from eadp.measure.power import fit_energy

PERIOD_S, STEP_S = 46.0, 0.5
TIMES = np.arange(0, 5 * PERIOD_S, STEP_S)
WAVE = 36 + 2 * np.cos(2 * np.pi * TIMES / PERIOD_S + 0.5) + np.cos(4 * np.pi * TIMES / PERIOD_S - 1)


def slow(time_s: float, seed: int = 0) -> np.ndarray:
    """A Matérn-3/2 process of variance 1, its sampling as fine as its own definition needs."""
    apart = np.sqrt(3) * np.abs(TIMES[:, np.newaxis] - TIMES) / time_s
    root = np.linalg.cholesky((1 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(TIMES)))
    return np.asarray(root @ np.random.default_rng(seed).normal(size=len(TIMES)))


def white(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=len(TIMES))


@pytest.mark.parametrize("seed", few(range(1, 4), 1))
def test_white_noise_is_the_noise(seed: int) -> None:
    model = fit_energy(TIMES, WAVE + 0.3 * white(seed)).model
    assert model.noise_std_w == pytest.approx(0.3, rel=0.1)
    assert model.period_s == pytest.approx(PERIOD_S, rel=0.005)


# nominally 95 % of three times as many; plain least squares' would hold for half
@pytest.mark.slow
def test_standard_deviations_hold_under_correlated_noise() -> None:
    inside = []
    for seed in range(12):
        normal = np.random.default_rng(seed).normal(size=960)
        noise = np.asarray(lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], normal)[-460:])
        model = fit_energy(TIMES, WAVE + 0.5 * noise).model
        assert model.mean_std_w is not None
        inside.append(abs(model.mean_w - 36) < 1.96 * model.mean_std_w)
        inside.append(abs(model.harmonics[0].amplitude_w - 2) < 1.96 * model.amplitude_std_w[0])
        inside.append(abs(model.period_s - PERIOD_S) < 1.96 * model.period_std_s)
    assert sum(inside) >= 29


def test_spikes_are_left_out_unless_they_are_to_be_kept() -> None:
    power = WAVE + 0.3 * white()
    places = [0, 100, 101, 300]
    power[places] += 500
    fitted = fit_energy(TIMES, power)
    assert fitted.spikes.tolist() == places
    assert fitted.model.samples == len(TIMES) - 4
    assert fitted.model.mean_w == pytest.approx(36, abs=0.05)
    assert fitted.model.period_s == pytest.approx(PERIOD_S, rel=0.005)
    assert fitted.times_s[0] == 0, "times from the first sample kept"

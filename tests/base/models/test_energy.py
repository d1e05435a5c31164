"""The energy model: its state, its coefficients, its power."""

import math

import numpy as np
import pytest

from eadp.models.energy import EnergyModel, Harmonic

PERIOD_S = 46.05
MODEL = EnergyModel(PERIOD_S, 36.4, (Harmonic(2.1, 0.8), Harmonic(1.4, -1.9), Harmonic(0.6, 2.6)), noise_std_w=0.5)


def series_w(t: float) -> float:
    terms = [(2.1, 0.8), (1.4, -1.9), (0.6, 2.6)]
    return 36.4 + sum(a * math.cos(2 * math.pi * j * t / PERIOD_S + f) for j, (a, f) in enumerate(terms, start=1))


def test_power_is_the_series() -> None:
    times = np.linspace(-10, 300, 101)
    np.testing.assert_allclose(MODEL.power_w(times), [series_w(t) for t in times], atol=1e-10)
    assert MODEL.power_w(3.0) == pytest.approx(series_w(3.0))


def test_state_at_the_start() -> None:
    state = MODEL.state_w(3)
    # q = [mean, A1 cos φ1, −A1 sin φ1, …]: y is its first and every cosine entry
    assert state[0] == 36.4
    assert state[1] == pytest.approx(2.1 * math.cos(0.8))
    assert state[2] == pytest.approx(-2.1 * math.sin(0.8))
    assert state[[0, 1, 3, 5]].sum() == pytest.approx(series_w(0))


def test_state_of_another_order_is_cut_off_or_filled_up() -> None:
    full = MODEL.state_w(3)
    assert MODEL.state_w(1).tolist() == full[:3].tolist()
    assert MODEL.state_w(0).tolist() == [36.4]
    assert MODEL.state_w(5).tolist() == [*full, 0, 0, 0, 0]


def test_coefficients_are_the_papers() -> None:
    a, b = MODEL.coefficients.a, MODEL.coefficients.b
    assert (MODEL.order, len(a), len(b)) == (3, 4, 3)
    for t in (0.0, 7.3, 40.0):
        angles = [2 * math.pi * j * t / PERIOD_S for j in (1, 2, 3)]
        terms = sum(a[j] * math.cos(x) + b[j - 1] * math.sin(x) for j, x in enumerate(angles, start=1))
        assert a[0] / PERIOD_S + 2 / PERIOD_S * terms == pytest.approx(series_w(t), abs=1e-10), "letter, Eq. 3"


def test_without_a_period_there_is_the_mean() -> None:
    model = EnergyModel(None, 73.0, noise_std_w=40.0)
    assert (model.periodic, model.order, model.coefficients.a, model.coefficients.b) == (False, 0, (), ())
    assert model.power_w([0.0, 1.0]).tolist() == [73.0, 73.0]
    assert model.state_w(2).tolist() == [73.0, 0, 0, 0, 0]

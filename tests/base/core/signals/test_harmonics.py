"""The Fourier state against scipy's matrix exponential and against the series written out term by term."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from eadp.core.signals import coefficients_of_state, output_row, signal_w, state_of_phases

EXACT = 1e-9  # of Lemma III.1, in watts on a signal of some 30 W

orders = st.integers(min_value=0, max_value=6)
periods_s = st.floats(min_value=0.5, max_value=500)
watts = st.floats(min_value=-50, max_value=50)


def forecast_w(state_w, period_s, ahead_s):
    """Power [W] that a state leads to, C e^{A t} q, at times ahead [s]. Source: letter, Eq. 4 with u = 0."""
    angle = 2 * np.pi / period_s * np.arange(1, (len(state_w) + 1) // 2) * np.asarray(ahead_s)[..., np.newaxis]
    return state_w[0] + np.cos(angle) @ state_w[1::2] + np.sin(angle) @ state_w[2::2]


def system_matrix(order: int, period_s: float) -> np.ndarray:
    """A of the letter's Eq. 6, entry by entry: q̇ = A q."""
    matrix = np.zeros((2 * order + 1, 2 * order + 1))
    for j in range(1, order + 1):
        matrix[2 * j - 1, 2 * j] = 2 * math.pi / period_s * j
        matrix[2 * j, 2 * j - 1] = -2 * math.pi / period_s * j
    return matrix


def series_w(t: float, a: list[float], b: list[float], period_s: float) -> float:
    """h(t) of the letter's Eq. 3, term by term."""
    total = a[0] / period_s
    for j in range(1, len(a)):
        angle = 2 * math.pi * j * t / period_s
        total += 2 / period_s * (a[j] * math.cos(angle) + b[j - 1] * math.sin(angle))
    return total


def state_of_coefficients(a, b, period_s: float):
    """q0 = (1/T) [a0, 2a1, 2b1, …]: the start that makes letter's Eqs. 3 and 4 one signal (Lemma III.1, corrected)."""
    return np.array([a[0], *(2 * part for pair in zip(a[1:], b, strict=True) for part in pair)]) / period_s


@given(st.data(), orders, periods_s, st.floats(min_value=0, max_value=1000))
def test_lemma_of_signal_and_output(data: st.DataObject, order: int, period_s: float, t: float) -> None:
    t = min(t, 5 * period_s)
    a = data.draw(st.lists(watts, min_size=order + 1, max_size=order + 1))
    b = data.draw(st.lists(watts, min_size=order, max_size=order))
    scale = max(1.0, max(map(abs, [*a, *b])) / period_s)
    expected = series_w(t, a, b, period_s)
    start = state_of_coefficients(a, b, period_s)
    output = output_row(order) @ expm(system_matrix(order, period_s) * t) @ start
    assert output == pytest.approx(expected, abs=EXACT * scale), "y = C e^{At} q0 is h"
    assert forecast_w(start, period_s, t) == pytest.approx(expected, abs=EXACT * scale)
    assert signal_w(t, a, b, period_s) == pytest.approx(expected, abs=EXACT * scale)


def test_the_printed_start_is_another_signal() -> None:
    a, b, period_s = [30 * 46.0, 20.0, 8.0], [-11.0, 5.0], 46.0
    times = np.linspace(0, 92, 200)
    printed = np.array([a[0], a[1] / 2, b[0] / 2, a[2] / 2, b[1] / 2]) / period_s
    signal = signal_w(times, a, b, period_s)
    assert np.max(np.abs(forecast_w(printed, period_s, times) - signal)) > 0.5
    corrected = state_of_coefficients(a, b, period_s)
    assert np.max(np.abs(forecast_w(corrected, period_s, times) - signal)) < EXACT


@given(st.data(), orders, periods_s)
def test_conversions_come_back(data: st.DataObject, order: int, period_s: float) -> None:
    state = np.array(data.draw(st.lists(watts, min_size=2 * order + 1, max_size=2 * order + 1)))
    a, b = coefficients_of_state(state, period_s)
    assert (len(a), len(b)) == (order + 1, order)
    np.testing.assert_allclose(state_of_coefficients(a, b, period_s), state, atol=1e-12)
    mean_w, amplitude_w, phase_rad = state[0], np.hypot(state[1::2], state[2::2]), np.arctan2(-state[2::2], state[1::2])
    np.testing.assert_allclose(state_of_phases(mean_w, amplitude_w, phase_rad), state, atol=1e-12)


def test_amplitude_and_phase_are_of_a_cosine() -> None:
    times = np.linspace(0, 100, 77)
    state = state_of_phases(36.4, [2.1, 0.6], [0.8, -2.5])
    turns = [2 * math.pi * t / 46 for t in times]
    expected = [36.4 + 2.1 * math.cos(turn + 0.8) + 0.6 * math.cos(2 * turn - 2.5) for turn in turns]
    np.testing.assert_allclose(forecast_w(state, 46.0, times), expected, atol=1e-12)


def test_coefficients_of_the_papers_scaling() -> None:
    # a0 = T · mean; a1 = T/2 · A cos φ, b1 = −T/2 · A sin φ
    a, b = coefficients_of_state(state_of_phases(36.0, [2.0], [math.pi / 6]), 50.0)
    np.testing.assert_allclose(a, [1800.0, 25 * 2 * math.cos(math.pi / 6)])
    np.testing.assert_allclose(b, [-25.0])

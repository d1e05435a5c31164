"""The Fourier state of a periodic power: its exact step, its output, and the papers' coefficients.

The state q = [α0, α1, β1, …, αr, βr] is carried in watts: α0 is the mean, and harmonic j adds
αj cos ωjt + βj sin ωjt with ω = 2π/T. The papers' coefficients a, b are T/2 times αj, βj (T times for α0).

Source: letter, Eqs. 3-7 and Lemma III.1, with the start of the lemma corrected: q0 = (1/T)[a0, 2a1, 2b1, …].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray


def output_row(order: int) -> FloatArray:
    """The row C that reads the power off the state.

    Parameters
    ----------
    order : int
        Number of harmonics r, 0 or more.

    Returns
    -------
    array, shape (2r + 1,)
        [1, 1, 0, …, 1, 0]. The letter's 1/T is in the state, which is in watts.

    Source: letter, Eq. 7.
    """
    row = np.zeros(2 * order + 1)
    row[0] = 1.0
    row[1::2] = 1.0
    return row


def rotation_matrix(order: int, period_s: float, step_s: float) -> FloatArray:
    """The exact step of the state, e^{A Δt}: one rotation for each harmonic.

    Parameters
    ----------
    order : int
        Number of harmonics r, 0 or more.
    period_s : float
        T [s], above 0.
    step_s : float
        Δt [s], of any size and sign.

    Returns
    -------
    array, shape (2r + 1, 2r + 1)

    Source: letter, Eqs. 4 and 6.
    """
    harmonic = np.arange(1, order + 1)
    angle = 2 * np.pi / period_s * harmonic * step_s
    cosine, sine = 2 * harmonic - 1, 2 * harmonic  # where α_j and β_j stand in the state
    matrix = np.eye(2 * order + 1)
    # A_j = [[0, ωj], [−ωj, 0]]  →  e^{A_j Δt} = [[cos ωjΔt, sin ωjΔt], [−sin ωjΔt, cos ωjΔt]]
    matrix[cosine, cosine] = matrix[sine, sine] = np.cos(angle)
    matrix[cosine, sine] = np.sin(angle)
    matrix[sine, cosine] = -np.sin(angle)
    return matrix


def rotated(state_w: ArrayLike, period_s: float | None, ahead_s: FloatArray) -> FloatArray:
    """The states that a state leads to, e^{A t} q, at many times ahead.

    Parameters
    ----------
    state_w : array, shape (2r + 1,)
        q now [W].
    period_s : float or None
        T [s], above 0; None without harmonics.
    ahead_s : array, shape (n,)
        Times from now [s].

    Returns
    -------
    array, shape (n, 2r + 1)
        States [W].

    Source: letter, Eqs. 4 and 6.
    """
    state = np.asarray(state_w, dtype=float)
    states = np.repeat(state[None], len(ahead_s), axis=0)
    if period_s is not None and len(state) > 1:
        angle = 2 * np.pi / period_s * np.arange(1, (len(state) + 1) // 2) * ahead_s[:, None]
        cosine, sine = np.cos(angle), np.sin(angle)
        states[:, 1::2] = cosine * state[1::2] + sine * state[2::2]
        states[:, 2::2] = cosine * state[2::2] - sine * state[1::2]
    return states


def design_matrix(times_s: FloatArray, frequency_hz: float, order: int) -> FloatArray:
    """Columns of harmonic least squares: 1, cos, sin, cos 2, sin 2, …, so that lower orders lead.

    Parameters
    ----------
    times_s : array, shape (n,)
        Times [s].
    frequency_hz : float
        1/T [Hz].
    order : int
        Number of harmonics r, 0 or more.

    Returns
    -------
    array, shape (n, 2r + 1)
    """
    turn = np.exp(2j * np.pi * frequency_hz * times_s)
    columns = np.ones((2 * order + 1, len(times_s)))
    power = turn
    for harmonic in range(1, order + 1):
        columns[2 * harmonic - 1], columns[2 * harmonic] = power.real, power.imag
        power = power * turn
    return columns.T


def signal_w(times_s: ArrayLike, a: ArrayLike, b: ArrayLike, period_s: float) -> FloatArray:
    """The papers' Fourier series at many times at once.

    Parameters
    ----------
    times_s : array, any shape
        Times [s].
    a : array, shape (r + 1,)
        Coefficients a0, a1, …, ar [W s].
    b : array, shape (r,)
        Coefficients b1, …, br [W s].
    period_s : float
        T [s], above 0.

    Returns
    -------
    array, shape of `times_s`
        Power [W].

    Source: letter, Eq. 3.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    angle = 2 * np.pi / period_s * np.arange(1, len(a)) * np.asarray(times_s, dtype=float)[..., np.newaxis]
    # h(t) = a0/T + (2/T) Σ_j (a_j cos ωjt + b_j sin ωjt)
    power: FloatArray = (a[0] + 2 * (np.cos(angle) @ a[1:] + np.sin(angle) @ b)) / period_s
    return power


def coefficients_of_state(state_w: ArrayLike, period_s: float) -> tuple[FloatArray, FloatArray]:
    """The papers' coefficients of a state.

    Parameters
    ----------
    state_w : array, shape (2r + 1,)
        q at t = 0 [W].
    period_s : float
        T [s], above 0.

    Returns
    -------
    a, b : array, shapes (r + 1,) and (r,)
        a0..ar and b1..br [W s].

    Source: letter, Lemma III.1, which prints a_j/2 where q0 has 2 a_j.
    """
    state = np.asarray(state_w, dtype=float)
    cosine = np.concatenate([state[:1], state[1::2] / 2])
    return cosine * period_s, state[2::2] / 2 * period_s


def state_of_phases(mean_w: float, amplitude_w: ArrayLike, phase_rad: ArrayLike) -> FloatArray:
    """State at t = 0 of mean + Σ_j amplitude_j cos(ωjt + phase_j).

    Parameters
    ----------
    mean_w : float
        Mean power [W].
    amplitude_w, phase_rad : array, shape (r,)
        Amplitude [W] and phase [rad] of each harmonic.

    Returns
    -------
    array, shape (2r + 1,)
        q [W].
    """
    amplitude, phase = np.asarray(amplitude_w, dtype=float), np.asarray(phase_rad, dtype=float)
    state = np.empty(2 * len(amplitude) + 1)
    # A cos(ωjt + φ) = A cos φ · cos ωjt − A sin φ · sin ωjt
    state[0], state[1::2], state[2::2] = mean_w, amplitude * np.cos(phase), -amplitude * np.sin(phase)
    return state


def phases_of_state(state_w: ArrayLike) -> tuple[float, FloatArray, FloatArray]:
    """Mean, amplitudes and phases of a state: the inverse of `state_of_phases`.

    Parameters
    ----------
    state_w : array, shape (2r + 1,)
        q at t = 0 [W].

    Returns
    -------
    mean_w : float
        Mean power [W].
    amplitude_w, phase_rad : array, shape (r,)
        Amplitudes, 0 or more [W], and phases in (−π, π] [rad].
    """
    state = np.asarray(state_w, dtype=float)
    cosine, sine = state[1::2], state[2::2]
    return float(state[0]), np.hypot(cosine, sine), np.arctan2(-sine, cosine)

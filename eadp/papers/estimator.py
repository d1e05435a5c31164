"""From power readings to an energy state, a period, and a forecast with its uncertainty.

Readings are of the motion alone: the computations' known power is taken off first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import ArrayLike

from eadp.core.arrays import FloatArray, NotNegative, Positive
from eadp.core.signals import output_row
from eadp.papers import forecasting
from eadp.papers.forecasting import stationary_covariance

PUBLISHED = "published"

FIRST_STD_W, FIRST_SHARE = 10.0, 0.5
"""Initial standard deviation of the level [W], and as a share of the first reading; the larger counts. Harmonics have
half of it."""

DRIFT_SHARE = 0.01
"""Smallest drift of level and harmonics per √s, as a share of the noise: it scales with the aircraft's power."""

NOMINAL_PERIOD_SHARE, ONE_LAP_SHARE = 0.05, 0.02
"""Relative standard deviation of a period: of a nominal one, and of one measured on fewer than three laps."""

EXACT_SENSOR_W = 1e-6
"""Smallest noise of a sensor, for one specified as exact."""

LOOK_AHEADS = 12
"""Parts of a horizon at whose ends the power is forecast for the records of a flight."""

PUBLISHED_STEP_S = 0.01
"""Largest step of the published filter: Euler's step of a tenth of a second makes its harmonics grow without bound."""


@dataclass(frozen=True, slots=True)
class EstimatorSettings:
    """Settings of every estimator; `published` uses `order` and `every_s` alone."""

    kind: Literal["exact", "published"] = "exact"
    """Kind of estimator: exact, or published: as the papers ran it, with `order` and `every_s` alone, in Euler steps of
    0.01 s."""

    order: Annotated[int, Ge(0), Le(20)] = 3
    """Number of harmonics of the lap."""

    gate_w: NotNegative = 0.0
    """A reading no farther than this from its forecast corrects nothing [W]: draft 002's ε. 0: every reading does."""

    every_s: Annotated[float, Ge(1e-3), Le(1e6)] = 0.1
    """Time between readings of the power sensor [s]."""

    noise_w: Positive = 0.5
    """Standard deviation of the readings' white noise [W]."""

    disturbance_std_w: Annotated[float, Ge(0), Le(1e6)] = 0.5
    """Standard deviation of the slow disturbance beside the laps' pattern [W]."""

    disturbance_time_s: Annotated[float, Ge(0.01), Le(1e6)] = 5.0
    """Time constant of the disturbance, a Matérn-3/2 process [s]."""

    level_drift_w_per_sqrt_s: NotNegative = 0.003
    """Random walk of the level [W/√s]."""

    harmonic_drift_w_per_sqrt_s: NotNegative = 0.003
    """Random walk of each harmonic's parts [W/√s]."""


class PowerEstimate(NamedTuple):
    """What a planner knows of the power after a reading: enough to forecast it.

    Attributes
    ----------
    time_s : float
        Time of the reading [s].
    period_s : float or None
        T [s]; None without a period.
    state : array, shape (2r + 3,)
        q [W], then the disturbance [W] and its rate [W/s].
    disturbance_s : float
        Time constant of the disturbance [s].
    computing_w : float
        Power of the computations in force [W].
    horizon_s : float
        How far the planner looks ahead at the power [s].
    """

    time_s: float
    period_s: float | None
    state: FloatArray
    disturbance_s: float
    computing_w: float
    horizon_s: float

    def forecast_w(self, ahead_s: ArrayLike) -> FloatArray:
        """Power of motion and computations [W], `ahead_s` [s] after the reading, of its shape: C e^{At} x and g(c)."""
        ahead = np.asarray(ahead_s, dtype=float)
        order = (len(self.state) - 3) // 2
        rows = _power_rows(order, self.period_s or 1.0, self.disturbance_s, ahead.ravel().tobytes())
        power: FloatArray = rows @ self.state + self.computing_w
        shaped: FloatArray = power.reshape(ahead.shape)[()]
        return shaped

    def horizon_w(self) -> FloatArray:
        """`forecast_w` over the horizon [W], shape (13,): now, and at the end of each twelfth of it."""
        return self.forecast_w(np.linspace(0.0, self.horizon_s, LOOK_AHEADS + 1))


@dataclass(frozen=True, eq=False)
class EnergyDynamics:
    """State-space model of the motion power: harmonics of a period that drift, a disturbance, and a sensor's noise.

    Units are as in `eadp.papers.forecasting`.
    """

    order: int
    period_s: float
    drift_w2_per_s: FloatArray
    std_w: float
    time_s: float
    noise_w: float

    @lru_cache(maxsize=4)  # noqa: B019 - few of few models, and steps are mostly alike
    def step(self, step_s: float) -> tuple[FloatArray, FloatArray]:
        """e^{A Δt}, which moves the state over a step [s], and Q, the covariance that it adds."""
        turn = forecasting.step_matrix(self.order, self.period_s, self.time_s, step_s)
        return turn, forecasting.step_noise(self.drift_w2_per_s, self.std_w, self.time_s, step_s)


class ExactEstimator:
    """Level, harmonics of the lap and a Matérn-3/2 disturbance, by a Kalman filter that is exact for any step.

    The period is the last lap's time; its standard deviation is that of the changes between laps, and harmonics drift
    at the rate at which it turns them.

    Parameters
    ----------
    settings : EstimatorSettings
    period_s : float or None
        T to start from [s]; None: there is no period, and no harmonics.
    state_w : array, optional
        q to start from [W]. Default: the first reading in α0, zeros elsewhere, as draft 002's Thm. III.1 does not sum
        to the reading. Either way the covariance is wide.
    period_std_s : float, optional
        Standard deviation of `period_s` [s]. Default: `NOMINAL_PERIOD_SHARE` of it.

    Attributes
    ----------
    follows_laps : bool
        Whether laps change the period.
    period_s, period_std_s : float
        T, None without a period, and its standard deviation [s].

    Source: letter, Alg. 2 l. 28-29; draft 002 l. 9-16 for the gate; docs/estimator.md.
    """

    def __init__(
        self,
        settings: EstimatorSettings,
        period_s: float | None,
        state_w: FloatArray | None = None,
        *,
        period_std_s: float | None = None,
    ) -> None:
        self._settings = settings
        self._order = settings.order if period_s else 0
        self.follows_laps = self._order > 0
        self.period_s = period_s
        self.period_std_s = NOMINAL_PERIOD_SHARE * (period_s or 0.0) if period_std_s is None else period_std_s
        self._output = forecasting.output(self._order)
        self._time_s: float | None = None  # of the last reading [s]
        self._lap_marks_s: list[float] = []  # starts of the laps in a row, and the end of the last [s]
        self._started = state_w is not None
        self._start(np.zeros(1) if state_w is None else state_w[: 2 * self._order + 1])

    def _start(self, known_w: FloatArray) -> None:
        """Set the state, of wide covariance, before the first correction: the first numbers of q [W], else zeros."""
        # q: the level and two numbers of each harmonic; then the disturbance and its rate
        size, s = 2 * self._order + 1, self._settings
        self._state: FloatArray = np.zeros(size + 2)
        self._covariance: FloatArray = np.zeros((size + 2, size + 2))
        self._state[: len(known_w)] = known_w
        spread_w = max(FIRST_STD_W, FIRST_SHARE * abs(self._state[0]))
        self._covariance[:size, :size] = np.diag([spread_w**2, *[spread_w**2 / 4] * (size - 1)])
        self._covariance[size:, size:] = stationary_covariance(s.disturbance_std_w, s.disturbance_time_s)
        self._dynamics: EnergyDynamics = self._dynamics_now()

    @property
    def state_w(self) -> FloatArray:
        """The energy state q [W]."""
        return self._state[:-2]

    # --- readings

    def observe(self, time_s: float, motion_w: float | None) -> float:
        """Update the state with a reading [W], None where there is none; return the forecast that it was before [W].

        Predicts to `time_s`, and corrects with the reading unless the gate holds. A step of 0 s is a second reading at
        one time.
        """
        step_s, self._time_s = time_s - (time_s if self._time_s is None else self._time_s), time_s
        if motion_w is not None and not self._started:
            self._started = True
            self._start(np.array([motion_w]))
        if step_s > 0:
            turn, noise = self._dynamics.step(round(step_s, 12))
            self._state, self._covariance = predict(self._state, self._covariance, turn, noise)
        expected, gate_w = float(self._output @ self._state), self._settings.gate_w
        # draft 002's ε: no update where |y − C q| ≤ ε
        if motion_w is not None and not (gate_w and abs(motion_w - expected) <= gate_w):
            variance = self._dynamics.noise_w**2
            self._state, self._covariance = update(self._state, self._covariance, self._output, motion_w, variance)
        return expected

    # --- laps

    def end_lap(self, time_s: float) -> None:
        """Take the time of the lap that ends as the period, if its start was marked: by `start_lap`, or by an end."""
        self._lap_marks_s.append(time_s)
        times = np.diff(self._lap_marks_s).tolist()
        if times and times[-1] > 0 and self._order:
            self.period_s = times[-1]
            self.period_std_s = _lap_time_std_s(times)
            self._dynamics = self._dynamics_now()  # the state keeps its meaning, so that phases continue

    def start_lap(self, time_s: float) -> None:
        """Start a lap that follows no other."""
        self._lap_marks_s = [time_s]

    # --- forecasts

    def shift_level(self, by_w: float) -> None:
        """Step α0 by a known change of power [W], as B u does. Source: letter, Eq. 8; draft 002, Eq. 7."""
        self._state = self._state.copy()  # estimates hold the one before
        self._state[0] += by_w

    def estimate(self, computing_w: float, horizon_s: float) -> PowerEstimate:
        """The estimate after the last reading, beside the power of the computations [W] and the horizon [s]."""
        disturbance_s = self._settings.disturbance_time_s
        return PowerEstimate(self._time_s or 0.0, self.period_s, self._state, disturbance_s, computing_w, horizon_s)

    def forecast(self, ahead_s: FloatArray) -> FloatArray:
        """Motion power [W], `ahead_s` [s] after the last reading: C e^{At} x, the decaying disturbance included."""
        return self.estimate(0.0, 0.0).forecast_w(ahead_s)

    # --- the model

    def _dynamics_now(self) -> EnergyDynamics:
        """The model with the period as estimated so far.

        Harmonics drift by their amplitudes in the state: they turn with the period, which is uncertain.
        """
        s, period_s = self._settings, self.period_s or 1.0
        noise_w, std_w = max(s.noise_w, EXACT_SENSOR_W), s.disturbance_std_w
        least = DRIFT_SHARE**2 * (noise_w**2 + std_w**2)
        drift = np.full(self._order + 1, max(s.harmonic_drift_w_per_sqrt_s**2, least))
        drift[0] = max(s.level_drift_w_per_sqrt_s**2, least)
        # |α_j + iβ_j|² (2πj std/T)² / 2T:
        # a lap that takes T ± std turns harmonic j by 2πj std/T, off by that share of its amplitude at its end
        turned = 2 * math.pi * np.arange(1, self._order + 1) * self.period_std_s / period_s
        squared_amplitudes = self._state[1:-2:2] ** 2 + self._state[2:-2:2] ** 2
        drift[1:] += squared_amplitudes * turned**2 / (2 * period_s)
        return EnergyDynamics(self._order, period_s, drift, std_w, s.disturbance_time_s, noise_w)


def _lap_time_std_s(times_s: list[float]) -> float:
    """Standard deviation of the next lap's time [s]: root mean square of the changes between laps."""
    if len(times_s) < 3:
        return ONE_LAP_SHARE * times_s[-1]
    return float(np.sqrt(np.mean(np.square(np.diff(times_s)))))


@lru_cache(maxsize=16)
def _power_rows(order: int, period_s: float, time_s: float, ahead: bytes) -> FloatArray:
    """`eadp.papers.forecasting.power_rows` of instants given as bytes, cached."""
    return forecasting.power_rows(order, period_s, time_s, np.frombuffer(ahead))


@lru_cache(maxsize=1)
def _published_step(order: int, turn_rad: float, steps: int) -> tuple[list[complex], list[float]]:
    """The published filter's factor of each harmonic's α + iβ in `steps` equal Euler steps of an angle, and its gain.

    Neither depends on the readings.
    """
    # q⁺ = (I + AΔt) q is (1 − iωjΔt)(α_j + iβ_j), step by step
    factors = [complex(1.0, -turn_rad * j) ** steps for j in range(1, order + 1)]
    # P⁻ = A 1 Aᵀ + 1 with 1 all ones: A·1 has every row's sum, so P⁻ = s sᵀ + 1
    sums = np.array([1.0] + [sign for j in range(1, order + 1) for sign in (1 + turn_rad * j, 1 - turn_rad * j)])
    output = output_row(order)
    shared = sums * (sums @ output) + output.sum()
    return factors, (shared / (output @ shared + 1.0)).tolist()


class PublishedEstimator:
    """The filter as the published flights ran it.

    All-ones covariances that are never carried forward, Euler's step I + AΔt, measurement noise 1, an initial state
    of ones, and a period that grows with the running lap from 1 s on. Between readings that are further apart than
    `PUBLISHED_STEP_S`, it takes several such steps.

    Source: the published flights (docs/reproduction.md); kept for reproduction, not for use.
    """

    follows_laps = False
    """Its period is that of the running lap where that is longer."""

    def __init__(self, settings: EstimatorSettings) -> None:
        self._order = settings.order
        self._state = [1.0] * (2 * settings.order + 1)
        self._lap_s, self._lap_started_s, self._time_s = 1.0, 0.0, 0.0
        self.period_s = 1.0

    @property
    def state_w(self) -> FloatArray:
        """The energy state q [W]."""
        return np.array(self._state)

    def observe(self, time_s: float, motion_w: float | None) -> float:
        """Predict to a time by equal Euler steps of at most `PUBLISHED_STEP_S`, and correct once with the reading.

        Returns the forecast of the reading [W]; see `ExactEstimator.observe`.
        """
        # the time of the last lap, or of this one once it is longer
        self._lap_s = max(self._lap_s, time_s - self._lap_started_s)
        self.period_s = self._lap_s
        step_s = round(time_s - self._time_s, 9)
        self._time_s = time_s
        steps = max(1, math.ceil(step_s / PUBLISHED_STEP_S - 1e-9))
        turn_rad = 2 * math.pi / self.period_s * (step_s / steps)
        factors, gain = _published_step(self._order, turn_rad, steps)
        old = self._state
        state = [old[0]]
        expected = old[0]
        for j, factor in enumerate(factors, 1):
            wave = complex(old[2 * j - 1], old[2 * j]) * factor
            state += wave.real, wave.imag
            expected += wave.real
        if motion_w is not None:
            error = motion_w - expected
            state = [q + k * error for q, k in zip(state, gain, strict=True)]
        self._state = state
        return expected

    def end_lap(self, time_s: float) -> None:
        """Take the time of the lap that ends as the period, and start the time of the next one."""
        self._lap_s, self._lap_started_s = time_s - self._lap_started_s, time_s

    def start_lap(self, time_s: float) -> None:
        """Start the time of a lap that follows no other."""
        self._lap_started_s = time_s

    def shift_level(self, by_w: float) -> None:
        """Step α0 by a known change of power [W]."""
        self._state[0] += by_w

    def estimate(self, computing_w: float, horizon_s: float) -> PowerEstimate:
        """As `ExactEstimator.estimate`; there is no disturbance."""
        state = np.array([*self._state, 0.0, 0.0])
        return PowerEstimate(self._time_s, self.period_s, state, 1.0, computing_w, horizon_s)

    def forecast(self, ahead_s: FloatArray) -> FloatArray:
        """Exact from the filter's state: Euler's step would grow the harmonics; see `ExactEstimator.forecast`."""
        return _power_rows(self._order, self.period_s, 1.0, ahead_s.tobytes())[:, :-2] @ self.state_w


Estimator = ExactEstimator | PublishedEstimator
"""Readings and laps in, forecast power out."""


def predict(
    state: FloatArray, covariance: FloatArray, transition: FloatArray, process_noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """One step ahead without a measurement.

    Parameters
    ----------
    state : array, shape (m,)
    covariance, transition, process_noise : array, shape (m, m)
        P, F and the Q of this step.

    Returns
    -------
    state, covariance
        F q and F P Fᵀ + Q.
    """
    return transition @ state, transition @ covariance @ transition.T + process_noise


def update(
    state: FloatArray, covariance: FloatArray, output: FloatArray, measured: float, noise_variance: float
) -> tuple[FloatArray, FloatArray]:
    """Correct with one scalar measurement.

    Parameters
    ----------
    state : array, shape (m,)
    covariance : array, shape (m, m)
    output : array, shape (m,)
        C, so that the measurement is C q + noise.
    measured, noise_variance : float
        y, and the variance R of its noise, above 0.

    Returns
    -------
    state, covariance
        The covariance in Joseph form, (I − K C) P (I − K C)ᵀ + K R Kᵀ: symmetric and positive but
        for the last bits, and never larger than before. The papers print (I + K C) P.
    """
    shared = covariance @ output
    gain = shared / (output @ shared + noise_variance)
    state = state + gain * (measured - output @ state)
    left = np.eye(len(state)) - np.outer(gain, output)
    covariance = left @ covariance @ left.T + noise_variance * np.outer(gain, gain)
    return state, covariance

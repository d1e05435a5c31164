"""Forecasts of the motion power in flight: ours beside the mean, statsmodels' and the papers' filter.

usage: python benchmarks/forecast.py [--runs 6] [--seed 0] [--opterra FILE] [--px4 FILE]
       python benchmarks/forecast.py --flights 300 [--jobs 2] [--out FILE] [--picture FILE.svg]

Two figures, each for every method, over the same instants of the same signals:

- one period ahead: from two periods on, the mean absolute error of a forecast of the whole period ahead against the
  readings, as a ratio to that of the mean of what has been seen so far;
- energy to the end: at each tenth of the mission, the absolute error of the energy of what remains, in per cent of it.

Simulations: three harmonics, white noise and a Matérn-3/2 disturbance, with little noise (the signal 21 dB above it)
and with much (10 dB); `floor` is a forecast that knows the harmonics. Flights: plans/survey.plan in gusts, with the
lift that makes its power periodic. Both have laps: the last one is the period of every method, and before there is one
ours starts from a lap that is 3 % too long. Logs have none, nor has the simulation "without laps": there the period is
what `eadp.core.signals.spectrum` finds in the readings so far, looked for again whenever there is a tenth more, and
none where it finds none.

Where a method has no period, or less than two, it tells the mean (seasonal naive: the last reading). Holt-Winters
(additive, without a trend) and ARIMA (1, 0, 1), the latter also with the period's Fourier terms as regressors, are
statsmodels'; they read means over 1 s. The papers' filter runs every 0.01 s on the last reading, as in their flights.
Needs statsmodels: pip install 'eadp[bench]'.

With `--flights`: how reliable the probabilities of a mission's end are, over flights of held parameters, see
`reliability`.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import multiprocessing
import statistics
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from measured import head, line, recorded
from quality import RESERVE, load, plans

from eadp.api.inputs import FlightInputs, load_flight
from eadp.core.signals import disturbance
from eadp.core.signals.spectrum import analyse
from eadp.errors import Infeasible
from eadp.io.figures.canvas import COLOURS, GREY, figure_file
from eadp.models.battery import Battery
from eadp.planning.base import Decision, Observation
from eadp.planning.estimation.estimator import EstimatorSettings, ExactEstimator, PublishedEstimator
from eadp.planning.forecast.held import HeldForecast, held_preflight
from eadp.planning.planner import Planner
from eadp.planning.state.flight_state import FlightState
from eadp.simulation.loop import Outcome, fly

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from forecast_variance import energy_forecast

try:
    from statsmodels.tsa.arima.model import ARIMA
    from statsmodels.tsa.holtwinters import ExponentialSmoothing
except ImportError:
    ARIMA = ExponentialSmoothing = None

ROOT = Path(__file__).resolve().parent.parent
ORDER = 3
PERIOD_S, DURATION_S, STEP_S = 46.7, 600.0, 0.1
LEVEL_W, AMPLITUDES_W = 31.0, (2.0, 1.2, 0.6)
CLEAN = (0.1, 0.1, 5.0)  # white noise [W], disturbance [W] and its time constant [s]
NOISY = (0.38, 0.38, 5.0)
ORIGINS_PER_PERIOD = 2
COARSE_S = 1.0
FILTER_STEP_S = 0.01
NO_PERIOD_HORIZON_S = 46.0
AGAIN = 1.1
NOMINAL_SHARE = 1.03
TENTHS = [k / 10 for k in range(1, 10)]


@dataclass
class Log:
    """Readings of a motion power, evenly spaced, and the ends of laps where they are known."""

    name: str
    times_s: np.ndarray
    power_w: np.ndarray
    laps_s: list[float] | None = None
    truth: Callable[[np.ndarray], np.ndarray] | None = None
    found: list[tuple[float, float | None, float]] = field(default_factory=list)

    @property
    def step_s(self) -> float:
        """Sampling step [s]."""
        return float(np.median(np.diff(self.times_s)))

    def period(self, time_s: float) -> tuple[float | None, float]:
        """Period known at a time and its standard deviation [s]: of the last lap, else found in what has been seen."""
        if self.laps_s is not None:
            ended = [lap for lap in self.laps_s if lap <= time_s]
            return (ended[-1] - ended[-2], 0.0) if len(ended) > 1 else (None, 0.0)
        seen_s = time_s - self.times_s[0]
        if not self.found or seen_s > AGAIN * (self.found[-1][0] - self.times_s[0]):
            self.found.append((time_s, *self._look(time_s)))
        return next((period, std) for at, period, std in reversed(self.found) if at <= time_s)

    def _look(self, time_s: float) -> tuple[float | None, float]:
        keep = self.times_s <= time_s
        every = max(1, round(0.3 / self.step_s))  # the spectrum of what is slower than a second
        try:
            spectrum = analyse(self.times_s[keep][::every], self.power_w[keep][::every])
        except Infeasible:
            return None, 0.0
        return (spectrum.period_s, spectrum.period_std_s) if spectrum.periodic else (None, 0.0)


Forecast = Callable[[np.ndarray], np.ndarray]


# --- methods: each takes a log and an instant, and returns a forecast of the power at later times


def the_mean(log: Log, now_s: float) -> Forecast:
    """The mean of the readings so far."""
    mean = log.power_w[log.times_s <= now_s].mean()
    return lambda times: np.full(len(times), mean)


def seasonal_naive(log: Log, now_s: float) -> Forecast:
    """The last period again; without a period the last reading."""
    period_s, _ = log.period(now_s)
    seen = log.times_s <= now_s
    times, power = log.times_s[seen], log.power_w[seen]
    if period_s is None or times[-1] - times[0] < period_s:
        return lambda later: np.full(len(later), power[-1])
    return lambda later: np.interp(later - period_s * np.ceil((later - now_s) / period_s + 1e-9), times, power)


def holt_winters(log: Log, now_s: float) -> Forecast:
    """Additive Holt-Winters of means over a second."""
    period_s, _ = log.period(now_s)
    times, power = coarse(log, now_s)
    if period_s is None or len(power) < 2 * round(period_s / COARSE_S):
        return the_mean(log, now_s)
    fit = ExponentialSmoothing(power, seasonal="add", seasonal_periods=round(period_s / COARSE_S)).fit()
    return stepped(lambda count, _: fit.forecast(count), times)


def arima(log: Log, now_s: float) -> Forecast:
    """ARIMA (1, 0, 1) with a mean, of means over a second."""
    times, power = coarse(log, now_s)
    fit = ARIMA(power, order=(1, 0, 1)).fit()
    return stepped(lambda count, _: fit.forecast(count), times)


def arima_fourier(log: Log, now_s: float) -> Forecast:
    """The same with three harmonics of the period as regressors."""
    period_s, _ = log.period(now_s)
    times, power = coarse(log, now_s)
    if period_s is None or times[-1] - times[0] < period_s:
        return arima(log, now_s)

    def terms(at_s: np.ndarray) -> np.ndarray:
        angle = 2 * np.pi / period_s * at_s
        return np.column_stack([wave(j * angle) for j in range(1, ORDER + 1) for wave in (np.cos, np.sin)])

    fit = ARIMA(power, order=(1, 0, 1), exog=terms(times)).fit()
    return stepped(lambda count, later: fit.forecast(count, exog=terms(later)), times)


def coarse(log: Log, now_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Means over a second each, and their middles: whole ones up to now."""
    seen = log.times_s <= now_s
    times, power = log.times_s[seen], log.power_w[seen]
    back = np.floor((now_s - times) / COARSE_S).astype(int)[::-1]
    sums, counts = np.bincount(back, power[::-1]), np.bincount(back)
    whole = counts >= max(1, 0.9 * COARSE_S / log.step_s - 1)
    middle = now_s - (np.arange(len(sums)) + 0.5) * COARSE_S
    return middle[whole][::-1], (sums[whole] / counts[whole])[::-1]


def stepped(forecast: Callable[[int, np.ndarray], np.ndarray], times_s: np.ndarray) -> Forecast:
    """A forecast of seconds after the last of some, at any later times."""

    def at(later: np.ndarray) -> np.ndarray:
        count = math.ceil((later[-1] - times_s[-1]) / COARSE_S) + 1
        middles = times_s[-1] + COARSE_S * np.arange(1, count + 1)
        return np.interp(later, middles, np.asarray(forecast(count, middles)))

    return at


class Published:
    """The papers' filter on a log, from its start to each instant in turn."""

    def __init__(self, log: Log) -> None:
        self._log, self._filter = log, PublishedEstimator(EstimatorSettings(order=ORDER))
        self._step, self._reading, self._laps, self._lap_s = 0, 0, 0, 0.0

    def __call__(self, log: Log, now_s: float) -> Forecast:
        """The forecast of the filter's state at an instant."""
        start_s = log.times_s[0]
        period_s, _ = log.period(now_s)
        while start_s + (self._step + 1) * FILTER_STEP_S <= now_s + 1e-9:
            self._step += 1
            time_s = start_s + self._step * FILTER_STEP_S
            while self._reading + 1 < len(log.times_s) and log.times_s[self._reading + 1] <= time_s + 1e-9:
                self._reading += 1
            if self._ended(time_s, period_s):
                self._filter.end_lap(time_s - start_s)
            self._filter.observe(time_s - start_s, float(log.power_w[self._reading]))
        return lambda later: self._filter.forecast(later - now_s)

    def _ended(self, time_s: float, period_s: float | None) -> bool:
        """Whether a lap ends in this step."""
        if self._log.laps_s is not None:
            if self._laps < len(self._log.laps_s) and self._log.laps_s[self._laps] <= time_s:
                self._laps += 1
                return True
            return False
        if period_s is not None and time_s - self._lap_s >= period_s:
            self._lap_s = time_s
            return True
        return False


class Exact:
    """Our estimator on a log, from its start to each instant in turn; where the period is found anew, once more."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._estimator: ExactEstimator | None = None
        self._known: tuple[float | None, float] = (None, 0.0)
        self._reading = 0

    def at(self, now_s: float) -> ExactEstimator:
        """The estimator when it has read all up to an instant."""
        log = self._log
        known = (NOMINAL_SHARE * (log.laps_s[1] - log.laps_s[0]), 0.0) if log.laps_s else log.period(now_s)
        if self._estimator is None or known != self._known:
            period_s, std_s = self._known = known
            nominal = None if log.laps_s else std_s
            self._estimator = ExactEstimator(EstimatorSettings(order=ORDER), period_s, period_std_s=nominal)
            self._reading = 0
        laps = log.laps_s or []
        while self._reading < len(log.times_s) and log.times_s[self._reading] <= now_s + 1e-9:
            time_s = float(log.times_s[self._reading])
            before_s = float(log.times_s[self._reading - 1]) if self._reading else -math.inf
            for lap in laps:
                if before_s < lap <= time_s:
                    self._estimator.end_lap(lap)
            self._estimator.observe(time_s, float(log.power_w[self._reading]))
            self._reading += 1
        return self._estimator

    def __call__(self, log: Log, now_s: float) -> Forecast:
        """Its forecast."""
        estimator = self.at(now_s)
        return lambda later: estimator.forecast(later - now_s)


# --- what is measured


def methods(log: Log) -> dict[str, Callable[[Log, float], Forecast]]:
    """Every method by name."""
    return {
        "mean": the_mean,
        "seasonal naive": seasonal_naive,
        "Holt-Winters": holt_winters,
        "ARIMA": arima,
        "ARIMA, Fourier": arima_fourier,
        "papers' filter": Published(log),
        "eadp": Exact(log),
    }


def origins(log: Log) -> list[tuple[float, float]]:
    """Instants from two periods on, and the period there [s]; as if it were 46 s where there is none."""
    found, end_s = [], float(log.times_s[-1])
    now_s = float(log.times_s[0])
    while now_s < end_s:
        period_s, _ = log.period(now_s)
        period_s = period_s or NO_PERIOD_HORIZON_S
        if now_s - log.times_s[0] >= 2 * period_s and now_s + period_s <= end_s:
            found.append((now_s, period_s))
        now_s += period_s / ORIGINS_PER_PERIOD
    return found


def one_period_ahead(log: Log) -> dict[str, float]:
    """Mean absolute error of each method [W]."""
    errors: dict[str, list[float]] = {}
    tried = methods(log)
    for now_s, period_s in origins(log):
        ahead = (log.times_s > now_s) & (log.times_s <= now_s + period_s)
        for name, method in tried.items():
            forecast = method(log, now_s)(log.times_s[ahead])
            errors.setdefault(name, []).append(float(np.abs(forecast - log.power_w[ahead]).mean()))
        if log.truth is not None:
            gap = np.abs(log.truth(log.times_s[ahead]) - log.power_w[ahead]).mean()
            errors.setdefault("floor", []).append(float(gap))
    return {name: statistics.fmean(values) for name, values in errors.items()}


def energy_to_the_end(log: Log) -> tuple[dict[str, list[float]], list[float]]:
    """Per cent of what remains that each method is off at each tenth; and our errors in standard deviations."""
    start_s, end_s = float(log.times_s[0]), float(log.times_s[-1])
    off: dict[str, list[float]] = {}
    standard: list[float] = []
    tried = methods(log)
    ours = tried.pop("eadp")
    for tenth in TENTHS:
        now_s = float(log.times_s[np.searchsorted(log.times_s, start_s + tenth * (end_s - start_s))])
        later = log.times_s > now_s
        right = float(log.power_w[later].sum()) * log.step_s
        for name, method in tried.items():
            energy = float(method(log, now_s)(log.times_s[later]).sum()) * log.step_s
            off.setdefault(name, []).append(100 * abs(energy / right - 1))
        assert isinstance(ours, Exact)
        estimator = ours.at(now_s)
        energy, variance = energy_forecast(estimator, int(later.sum()) * log.step_s)
        off.setdefault("eadp", []).append(100 * abs(energy / right - 1))
        sensor = log.step_s * estimator.noise_w * math.sqrt(later.sum())
        standard.append((energy - right) / math.sqrt(variance + sensor**2))
    return off, standard


# --- signals


def simulated(rng: np.random.Generator, noise: tuple[float, float, float], name: str, laps: bool = True) -> Log:
    """Three harmonics with any phases, a disturbance and white noise."""
    times = np.arange(0.0, DURATION_S, STEP_S)
    phases = rng.uniform(0, 2 * np.pi, len(AMPLITUDES_W))

    def truth(at_s: np.ndarray) -> np.ndarray:
        waves = [
            a * np.cos(2 * np.pi * j * at_s / PERIOD_S + p)
            for j, (a, p) in enumerate(zip(AMPLITUDES_W, phases, strict=True), 1)
        ]
        return LEVEL_W + np.sum(waves, axis=0)

    white_w, std_w, time_s = noise
    power = truth(times) + matern(rng, len(times), std_w, time_s) + white_w * rng.standard_normal(len(times))
    marks = np.arange(rng.uniform(0, PERIOD_S), DURATION_S, PERIOD_S).tolist()
    return Log(name, times, power, marks if laps else None, truth)


def matern(rng: np.random.Generator, count: int, std_w: float, time_s: float) -> np.ndarray:
    """A Matérn-3/2 process every STEP_S."""
    step = disturbance.transition(STEP_S, time_s)
    root = np.linalg.cholesky(disturbance.process_noise(STEP_S, std_w, time_s))
    state = np.sqrt(np.diag(disturbance.stationary_covariance(std_w, time_s))) * rng.standard_normal(2)
    result = np.empty(count)
    for k, noise in enumerate(rng.standard_normal((count, 2))):
        result[k] = state[0]
        state = step @ state + root @ noise
    return result


def flown(seed: int, gust_std_mps: float) -> Log:
    """The survey in gusts: motion power every tenth of a second, and the ends of its laps."""
    overrides = {
        "planner.name": "static",
        "battery.capacity_ah": 3.2,
        "wind.gust_std_mps": gust_std_mps,
        "faults": [],
        "seed": seed,
    }
    inputs = load_flight(
        str(ROOT / "plans/survey.plan"), scenario=str(ROOT / "scenarios/survey.yaml"), overrides=overrides
    )
    outcome = Outcome()
    steps = list(fly(inputs.world, inputs.flight(), outcome))[:-1]
    sets = inputs.world.plan.stages[0].sets
    computing_w = inputs.world.computing.power_w(steps[0].parameters, sets)
    stages = inputs.world.plan.primitive_stages
    laps = outcome.stage_times_s[stages - 1 :: stages]
    times, power = np.array([step.time_s for step in steps]), np.array([step.power_w for step in steps])
    return Log(f"flight in gusts of {gust_std_mps:g} m/s", times, power - computing_w, laps)


def opterra(path: str) -> Log:
    """A log of time and power every 0.5 s, its first 25 s left out."""
    with open(path, newline="", encoding="utf-8") as stream:
        rows = np.array([[float(cell) for cell in row[:2]] for row in csv.reader(stream) if row])
    rows = rows[rows[:, 0] >= 25.0]
    return Log("Opterra log", rows[:, 0], rows[:, 1])


def px4(path: str) -> Log:
    """A log of voltage and current."""
    with open(path, newline="", encoding="utf-8") as stream:
        rows = [(r["timestamp"], r["voltage_v"], r["current_a"]) for r in csv.DictReader(stream)]
    stamp, voltage, current = np.array(rows, dtype=float).T
    return Log("PX4 log", (stamp - stamp[0]) * 1e-6, voltage * current)


# --- the tables


def report(name: str, logs: list[Log], ahead_aim: float | None, energy_aim: float | None) -> None:
    """Print both figures of some logs of a kind."""
    ahead = [one_period_ahead(log) for log in logs]
    energy = [energy_to_the_end(log) for log in logs]
    found = {period for log in logs for _, period, _ in log.found}
    periods = "laps known" if logs[0].laps_s else "no period found" if found <= {None} else "period found"
    title = f"{name} ({len(logs)} run{'s' * (len(logs) > 1)}, {periods})"
    print(head(title, "one period ahead", "energy to the end, % off: mean", "worst"))
    for method in ("mean", "seasonal naive", "Holt-Winters", "ARIMA", "ARIMA, Fourier", "papers' filter", "eadp"):
        ratio = statistics.fmean(run[method] / run["mean"] for run in ahead)
        off = [value for run, _ in energy for value in run[method]]
        print(line(method, f"{ratio:.3f}", f"{statistics.fmean(off):.2f}", f"{max(off):.2f}"))
    if "floor" in ahead[0]:
        print(line("floor", f"{statistics.fmean(run['floor'] / run['mean'] for run in ahead):.3f}", "", ""))
    standard = [value for _, values in energy for value in values]
    print(f"  eadp's energy errors: {math.sqrt(statistics.fmean(z * z for z in standard)):.2f} standard deviations")
    verdict("one period ahead", "eadp", {m: statistics.fmean(run[m] / run["mean"] for run in ahead) for m in ahead[0]})
    verdict("energy", "eadp", {m: statistics.fmean(v for run, _ in energy for v in run[m]) for m in energy[0][0]})
    aims = [f"one period ahead {ahead_aim:g}" if ahead_aim else "", f"energy {energy_aim:g} %" if energy_aim else ""]
    if any(aims):
        print(f"  aims: {', '.join(aim for aim in aims if aim)}")


def verdict(what: str, own: str, figures: dict[str, float]) -> None:
    """Say who is better than we are."""
    better = [name for name, value in figures.items() if name not in (own, "floor") and value < figures[own]]
    if better:
        print(f"  {what}: better than eadp: {', '.join(better)}")


# --- the reliability of the probabilities

_FIRST_S = 5.0, 6.0, 12.0, 25.0, 30.0
_SHARES = 0.1, 0.25, 0.5, 0.75, 0.95
MOMENTS = {
    "take-off": 0.0,
    **{f"{at:g} s": at for at in _FIRST_S},
    **{f"{at:.0%}".replace("%", " %"): at for at in _SHARES},
}
"""When forecasts are made: 0 before take-off; a time [s], from the first decision on, or below 1 a share of the
flight."""
AIMS = {"take-off": 0.10, "25 %": 0.08, "95 %": 0.03}
TRUTHS = {"as stated": (1.0, 1.0, 1.0), "voltage falls": (1.0, 1.1, 0.9), "15 % less": (0.85, 1.0, 1.0)}
"""Batteries flown: capacity, voltage when full and voltage when empty, as shares of what is stated."""


class Recording(Planner):
    """Keeps its parameters, and an observation at every reading."""

    next_update_s = 0.0

    def __init__(self, inputs: FlightInputs) -> None:
        super().__init__(inputs.scenario.planner, inputs.mission)
        self.seen = list[Observation]()

    def update(self, state: FlightState) -> Decision:
        """Keep an observation."""
        self.seen.append(state.now)
        self.next_update_s = state.next_reading_s
        return super().update(state)


def reliability(count: int, seed: int, jobs: int, out: str | None, picture: str | None) -> None:
    """Brier scores, calibration in ten bins, and standardised errors of the charge at the end, by moment.

    Flights of random held parameters on the missions' plans of `quality.py`, in wind of 0 to 8 m/s with gusts of up to
    1.5 m/s and of 5 or 20 s; the battery has 0.9 to 1.1 of the charge that they need. Each flight is forecast with each
    of `TRUTHS`. Its gauge is exact, or shows whole per cents.
    """
    with tempfile.TemporaryDirectory() as folder:
        found = plans(Path(folder))
        tasks = [(found, seed, index) for index in range(count)]
        with multiprocessing.get_context("spawn").Pool(jobs) as pool:
            rows = [row for flight in pool.imap_unordered(forecasts_of, tasks, chunksize=2) for row in flight]
    if out:
        Path(out).write_text("".join(json.dumps(row) + "\n" for row in rows))
    print(f"seed {seed}, {count} flights")
    for truth in TRUTHS:
        print(head(f"battery {truth}", "Brier", "aim", "stated", "kept", "z mean", "z std", "z beyond ±4"))
        for moment in MOMENTS:
            some = [row for row in rows if row["truth"] == truth and row["moment"] == moment]
            stated, kept = np.array([row["stated"] for row in some]), np.array([row["kept"] for row in some])
            z = np.array([row["z"] for row in some])
            aim = f"{AIMS[moment]:.2f}" if moment in AIMS else ""
            score = f"{np.mean((stated - kept) ** 2):.3f}", aim, f"{stated.mean():.3f}", f"{kept.mean():.3f}"
            print(line(moment, *score, f"{z.mean():.2f}", f"{z.std():.2f}", int((abs(z) > 4).sum())))
    if picture:
        draw([row for row in rows if row["truth"] == next(iter(TRUTHS))], picture)


def forecasts_of(task: tuple[dict[str, str], int, int]) -> list[dict[str, Any]]:
    """One flight, and what was forecast of it at every moment, with every battery."""
    found, seed, index = task
    rng = np.random.default_rng([seed, index])
    place = list(found)[index % len(found)]
    wind = {
        "wind.speed_mps": float(rng.uniform(0, 8)),
        "wind.towards_deg": float(rng.uniform(0, 360)),
        "wind.gust_std_mps": float(rng.uniform(0, 1.5)),
        "wind.gust_time_s": float(rng.choice([5.0, 20.0])),
    }
    keys = {
        "vehicle.airframe.model": ("paper", "fixed-wing")[index // len(found) % 2],
        "guidance.k_d": 1.0,
        "planner.name": "static",
        "seed": int(rng.integers(1 << 30)),
        "battery.capacity_ah": 1000.0,
        "battery.voltage_empty_v": None,
        **wind,
    }
    share, quantum = float(rng.uniform(0.9, 1.1)), float(rng.choice([0.0, 0.01]))
    plan = load(found[place], keys).mission.plan
    boxes = [plan.hull(0), plan.hull(1)]
    starts = rng.uniform(0, 1, 2)
    keys["parameters"] = {
        "c1": boxes[0].lo + float(starts[0]) * (boxes[0].hi - boxes[0].lo),
        "c2": float(round(boxes[1].lo + float(starts[1]) * (boxes[1].hi - boxes[1].lo))),
    }
    inputs = load(found[place], keys)
    flight, outcome = inputs.flight(), Outcome()
    flight.planner = recording = Recording(inputs)
    for _ in fly(inputs.world, flight, outcome):
        pass
    if not outcome.completed:
        return []
    times = np.array([o.time_s for o in recording.seen])
    powers = np.array([o.sample.power_w for o in recording.seen])
    b = inputs.mission.battery
    need_ah = float(np.sum(b.drain_per_s(powers, b.voltage_v) * np.diff(times, prepend=0.0))) * b.capacity_ah
    rows = []
    for truth, (capacity, full, empty) in TRUTHS.items():
        true = replace(
            b,
            capacity_ah=share * need_ah / (1 - RESERVE),
            voltage_v=full * b.voltage_v,
            voltage_empty_v=empty * b.voltage_v,
        )
        stated = replace(b, capacity_ah=true.capacity_ah / capacity)
        charges = charges_of(true, times, powers)
        mission = replace(inputs.mission, battery=stated)
        settings, gusts = inputs.scenario.planner, inputs.world.wind
        held = HeldForecast(settings, mission)
        state = FlightState(mission, settings.weights, EstimatorSettings(every_s=1e-3))  # all are readings
        forecast = held_preflight(settings, mission, gusts.steady_mps, gusts.gust_std_mps)
        assert forecast is not None
        made = [("take-off", forecast.forecast)]
        due = {name: at if at >= 1 else at * outcome.duration_s for name, at in MOMENTS.items() if at}
        for o, charge in zip(recording.seen, charges.tolist(), strict=True):
            shown = math.ceil(charge / quantum - 1e-9) * quantum if quantum else charge
            observation = o._replace(sample=o.sample._replace(soc=shown), soc=shown)
            state.observe(observation)
            for name in [name for name, at_s in due.items() if o.time_s >= at_s]:
                del due[name]
                known = state.known(o.time_s, o.position_m)
                if (here := held.at(known, mission.parameters)) is not None:
                    made.append((name, here))
        end = float(charges[-1])
        for name, here in made:
            rows.append(
                {
                    "index": index,
                    "place": place,
                    **wind,
                    "quantum": quantum,
                    "truth": truth,
                    "moment": name,
                    "stated": here.reserve_probability,
                    "kept": bool(end >= RESERVE and charges.min() > 0),
                    "z": (end - here.soc_end) / here.soc_end_std,
                    "soc_end": here.soc_end,
                    "std": here.soc_end_std,
                    "end": end,
                }
            )
    return rows


def charges_of(b: Battery, times_s: np.ndarray, power_w: np.ndarray) -> np.ndarray:
    """State of charge of a battery under powers."""
    soc, charges = b.soc, []
    for step_s, watts in zip(np.diff(times_s, prepend=0.0).tolist(), power_w.tolist(), strict=True):
        soc -= b.drain_per_s(watts, b.voltage_at(max(soc, 0.0))) * step_s
        charges.append(soc)
    return np.array(charges)


def draw(rows: list[dict[str, Any]], picture: str) -> None:
    """Stated probabilities of the reserve against the shares that kept it, in ten bins."""
    with figure_file(picture, 9.0, 3.4) as figure:
        for axes, moment in zip(figure.subplots(1, len(AIMS), sharey=True), AIMS, strict=True):
            some = [row for row in rows if row["moment"] == moment]
            stated, kept = (np.array([row[key] for row in some], dtype=float) for key in ("stated", "kept"))
            bins = np.minimum((10 * stated).astype(int), 9)
            score = np.mean((stated - kept) ** 2)
            axes.plot([0, 1], [0, 1], color=GREY, linewidth=0.8)
            for k in sorted(set(bins.tolist())):
                mine = bins == k
                count, share = int(mine.sum()), float(kept[mine].mean())
                std = math.sqrt((share * count + 1) * ((1 - share) * count + 1) / (count + 2) ** 2 / (count + 3))
                axes.errorbar(stated[mine].mean(), share, std, color=COLOURS[0], marker="o", markersize=4)
                axes.annotate(str(count), (stated[mine].mean(), share), (5, -9), textcoords="offset points", fontsize=7)
            axes.set_ylim(-0.05, 1.05)
            axes.set_title(f"{moment}: Brier score {score:.3f}")
            axes.set_xlabel("stated probability of the reserve")
        figure.axes[0].set_ylabel("share of flights that kept it")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--runs", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--opterra", metavar="FILE")
    parser.add_argument("--px4", metavar="FILE")
    parser.add_argument("--flights", type=int, default=0, help="flights to judge the probabilities of the end by")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", metavar="FILE", help="the forecasts of --flights, JSON lines")
    parser.add_argument("--picture", metavar="FILE", help="stated against happened, SVG")
    parser.add_argument("--write", action="store_true", help="write docs/measured/forecast.md, or reliability.md")
    arguments = parser.parse_args()
    if arguments.flights:
        with recorded("reliability", write=arguments.write):
            reliability(arguments.flights, arguments.seed, arguments.jobs, arguments.out, arguments.picture)
        return
    if ARIMA is None:
        sys.exit("this benchmark compares with statsmodels, which is not installed: pip install 'eadp[bench]'")
    with recorded("forecast", write=arguments.write):
        warnings.simplefilter("ignore")  # statsmodels' about convergence and starting values
        tables(arguments)


def tables(arguments: argparse.Namespace) -> None:
    """Print the tables of all methods."""
    seeds = range(arguments.seed, arguments.seed + arguments.runs)
    print(f"seeds {seeds.start} to {seeds.stop - 1}")
    for noise, name, aim in ((CLEAN, "simulation, 21 dB", 0.12), (NOISY, "simulation, 10 dB", None)):
        report(name, [simulated(np.random.default_rng(seed), noise, name) for seed in seeds], aim, 0.3)
    name = "simulation without laps, 21 dB"
    report(name, [simulated(np.random.default_rng(seed), CLEAN, name, laps=False) for seed in seeds[:2]], 0.12, None)
    for gust in (0.0, 0.5):
        few = seeds[:1] if not gust else seeds[:3]
        report(
            f"survey flown, gusts {gust:g} m/s", [flown(seed, gust) for seed in few], 0.12 if not gust else None, 0.3
        )
    if arguments.opterra:
        report("Opterra log", [opterra(arguments.opterra)], 0.9, 2.0)
    if arguments.px4:
        report("PX4 log", [px4(arguments.px4)], 1.02, None)


if __name__ == "__main__":
    main()

"""How well `eadp fit` finds periods in simulated logs whose period is known, and its results for published ones.

    python benchmarks/fit.py [--runs 5] [--seed 0] [--only WORDS] [--write]

The logs have three harmonics of random amplitudes (2.1, 1.4 and 0.6 W, ± 30 %) and phases, periods of 30 to 60 s and
samples every 0.5 s. Noise AR(τ) has correlation e^(−t/τ); 0 dB is as much noise as signal. Columns:

claimed   logs that are said to have a period
error     median error of the period, of the best candidate where none is claimed
< 5 %     logs whose best period is within 5 %
false     of the claimed periods, those that are off by more than 5 %: multiples, fractions and others
T         how often ± 1.96 standard deviations hold the true period of logs in which it is claimed
FFT       the baseline: the highest peak of a detrended log's FFT, gaps filled in straight lines, in the same range
known     the likeliest period for one who knows the noise's correlation and the number of harmonics: as good as it gets
"""

from __future__ import annotations

import itertools
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from measured import options, recorded, share, table
from scipy.linalg import solve_triangular
from scipy.signal import lfilter

from eadp.core.arrays import FloatArray
from eadp.measure.spectrum import Spectrum, analyse

AMPLITUDES_W = np.array([2.1, 1.4, 0.6])
STEP_S = 0.5
MEAN_W = 36.0


@dataclass(frozen=True)
class Log:
    """A made log; the period that is in it [s], NaN where there is none, and the harmonics' amplitudes [W]."""

    times_s: FloatArray
    power_w: FloatArray
    period_s: float = float("nan")
    amplitude_w: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True)
class Case:
    """A kind of log; `prior` gives one that is off by up to a quarter, `known_s` is τ for the column `known`."""

    name: str
    make: Callable[[np.random.Generator], Log]
    prior: bool = False
    known_s: float = 0.0


# --- logs


def coloured(rng: np.random.Generator, n: int, step_s: float, time_s: float) -> FloatArray:
    """Noise of variance 1; white for a time of 0."""
    if not time_s:
        return rng.normal(size=n)
    memory = np.exp(-step_s / time_s)
    warm = int(20 * time_s / step_s)
    return np.asarray(lfilter([np.sqrt(1 - memory**2)], [1, -memory], rng.normal(size=n + warm))[warm:])


def periodic(periods: float, ratio_db: float, time_s: float = 0.0) -> Callable[[np.random.Generator], Log]:
    """Logs of so many periods, with noise that much below the signal."""

    def make(rng: np.random.Generator) -> Log:
        period_s = rng.uniform(30, 60)
        times = np.arange(0, periods * period_s, STEP_S)
        amplitude, phase = AMPLITUDES_W * rng.uniform(0.7, 1.3, 3), rng.uniform(-np.pi, np.pi, 3)
        angle = 2 * np.pi * np.outer(times / period_s, [1, 2, 3]) + phase
        std_w = np.sqrt(np.sum(amplitude**2) / 2 / 10 ** (ratio_db / 10))
        power = MEAN_W + np.cos(angle) @ amplitude + std_w * coloured(rng, len(times), STEP_S, time_s)
        return Log(times, power, period_s, amplitude)

    return make


def dropped(rng: np.random.Generator) -> Log:
    log = periodic(3, 10)(rng)
    kept = rng.random(len(log.times_s)) > 0.3
    return replace(log, times_s=log.times_s[kept], power_w=log.power_w[kept])


def gapped(rng: np.random.Generator) -> Log:
    log = periodic(3, 10)(rng)
    start = rng.uniform(0.1 * log.times_s[-1], 0.9 * log.times_s[-1] - log.period_s / 2)
    kept = (log.times_s < start) | (log.times_s > start + log.period_s / 2)
    return replace(log, times_s=log.times_s[kept], power_w=log.power_w[kept])


def noise(low_s: float, high_s: float, span_s: float = 200.0) -> Callable[[np.random.Generator], Log]:
    """Logs of noise alone, AR(τ) with τ between two times."""

    def make(rng: np.random.Generator) -> Log:
        times = np.arange(0, span_s, STEP_S)
        return Log(times, MEAN_W + coloured(rng, len(times), STEP_S, rng.uniform(low_s, high_s)))

    return make


def matern(rng: np.random.Generator) -> Log:
    """Matérn-3/2 noise of 2 to 20 s, by the Cholesky factor of its covariance, and a third as much white noise."""
    times = np.arange(0, 200, STEP_S)
    apart = np.sqrt(3) * np.abs(times[:, np.newaxis] - times) / rng.uniform(2, 20)
    root = np.linalg.cholesky((1 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(times)))
    return Log(times, MEAN_W + root @ rng.normal(size=len(times)) + 0.3 * rng.normal(size=len(times)))


def flicker(rng: np.random.Generator) -> Log:
    """1/f noise, cut from a stretch eight times as long; its mean over all that stretch is 0."""
    times = np.arange(0, 200, STEP_S)
    size = 8 * len(times)
    spectrum = np.fft.rfft(rng.normal(size=size))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0
    power = np.fft.irfft(spectrum, size)
    return Log(times, MEAN_W + power[: len(times)] / power.std())


def walk(rng: np.random.Generator) -> Log:
    times = np.arange(0, 200, STEP_S)
    return Log(times, MEAN_W + np.cumsum(rng.normal(size=len(times))))


CASES = (
    Case("white, 10 dB, 3 periods", periodic(3, 10)),
    Case("white, 10 dB, 30 % dropped", dropped),
    Case("white, 10 dB, gap of half a lap", gapped),
    Case("AR(5 s), 0 dB, 3 periods, prior", periodic(3, 0, 5), prior=True, known_s=5),
    Case("AR(5 s), 0 dB, 4 periods, prior", periodic(4, 0, 5), prior=True, known_s=5),
    Case("AR(5 s), 0 dB, 6 periods, prior", periodic(6, 0, 5), prior=True, known_s=5),
    Case("AR(5 s), 0 dB, 10 periods, prior", periodic(10, 0, 5), prior=True),
    Case("AR(5 s), 0 dB, 6 periods", periodic(6, 0, 5)),
    Case("AR(5 s), 5 dB, 6 periods", periodic(6, 5, 5)),
    Case("AR(15 s), 5 dB, 4 periods", periodic(4, 5, 15)),
    Case("AR(15 s), 5 dB, 8 periods", periodic(8, 5, 15)),
    Case("AR(15 s), 0 dB, 5 periods", periodic(5, 0, 15)),
    Case("AR(15 s), 0 dB, 8 periods", periodic(8, 0, 15)),
    Case("noise alone, white", noise(0, 0)),
    Case("noise alone, AR(1 to 20 s)", noise(1, 20)),
    Case("noise alone, AR(5 s), prior", noise(5, 5), prior=True),
    Case("noise alone, AR(5 s), 135 s, prior", noise(5, 5, 135), prior=True),
    Case("noise alone, Matérn(2 to 20 s)", matern),
    Case("noise alone, 1/f", flicker),
    Case("noise alone, random walk", walk),
)


# --- runs


def peak_s(log: Log, prior_s: float | None) -> float:
    """The baseline: period of the highest peak of an FFT, near a prior if there is one."""
    even = np.arange(0, log.times_s[-1], STEP_S)
    power = np.interp(even, log.times_s, log.power_w)
    power = (power - np.polyval(np.polyfit(even, power, 1), even)) * np.hanning(len(even))
    size = 16 * len(even)
    magnitude = np.abs(np.fft.rfft(power, size))
    longest_s = log.times_s[-1] / 1.9
    low_s, high_s = (0.0, longest_s) if prior_s is None else (prior_s / 1.3, min(1.3 * prior_s, longest_s))
    first = int(np.ceil(size * STEP_S / high_s))
    last = len(magnitude) - 1 if not low_s else int(size * STEP_S / low_s)
    return size * STEP_S / (first + int(np.argmax(magnitude[first : last + 1])))


def known_s(log: Log, time_s: float, prior_s: float) -> float:
    """Period of generalised least squares of three harmonics within a factor of 1.3 of a prior, in noise AR(τ)."""
    times = log.times_s
    root = np.linalg.cholesky(np.exp(-np.abs(times[:, np.newaxis] - times) / time_s))
    white = solve_triangular(root, log.power_w, lower=True)
    periods = 1 / np.linspace(1.3 / prior_s, 1 / min(1.3 * prior_s, times[-1] / 1.9), 300)
    explained = []
    for period_s in periods:
        angle = 2 * np.pi * np.outer(times / period_s, [1, 2, 3])
        columns = np.column_stack([np.ones(len(times)), np.cos(angle), np.sin(angle)])
        basis, _ = np.linalg.qr(solve_triangular(root, columns, lower=True))
        explained.append(np.sum((basis.T @ white) ** 2))
    return float(periods[np.argmax(explained)])


COLUMNS = (
    *("claimed", "error, median", "within 5 %", "false", "T in interval"),
    *("FFT: error", "within 5 %", "known: error", "CPU [s]"),
)


def within(value: float, true: float, std: float) -> bool:
    return abs(value - true) <= 1.96 * std


def run(case: Case, runs: int, seed: int) -> list[str]:
    """A kind's row."""
    errors, peaks, knowns, claimed, times = [], [], [], [], []
    ratios: list[float] = []
    inside: list[bool] = []
    for i in range(runs):
        rng = np.random.default_rng([seed, i])
        log = case.make(rng)
        there = bool(np.isfinite(log.period_s))
        prior_s = (log.period_s if there else 45.0) * rng.uniform(0.75, 1.25) if case.prior else None
        start = time.process_time()
        found: Spectrum = analyse(log.times_s, log.power_w, period_prior_s=prior_s)
        times.append(time.process_time() - start)
        claimed.append(found.periodic)
        if there:
            errors.append(abs(found.period_s / log.period_s - 1))
            peaks.append(abs(peak_s(log, prior_s) / log.period_s - 1))
            if case.known_s and prior_s is not None:
                knowns.append(abs(known_s(log, case.known_s, prior_s) / log.period_s - 1))
            if found.periodic:
                ratios.append(found.period_s / log.period_s)
                inside.append(within(found.period_s, log.period_s, found.period_std_s))
    return [
        *(case.name, share(claimed), median(errors), share([error < 0.05 for error in errors])),
        *(share([abs(ratio - 1) > 0.05 for ratio in ratios]), share(inside)),
        *(median(peaks), share([error < 0.05 for error in peaks]), median(knowns), f"{np.median(times):.2f}"),
    ]


def median(errors: list[float]) -> str:
    """The median of relative errors, in percent."""
    return f"{100 * np.median(errors):.2f}" if errors else ""


def long_log(seed: int) -> None:
    """30 minutes at 20 Hz: the analysis alone, and `eadp fit` in a process of its own with reading, start and all."""
    times = np.arange(0, 1800, 0.05)
    for name, time_s in (("white", 0.0), ("AR(5 s)", 5.0)):
        rng = np.random.default_rng(seed)
        angle = 2 * np.pi * np.outer(times / 46, [1, 2, 3])
        power = MEAN_W + np.cos(angle) @ AMPLITUDES_W + 0.6 * coloured(rng, len(times), 0.05, time_s)
        start = time.process_time()
        analyse(times, power)
        alone_s = time.process_time() - start
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "log.csv")
            np.savetxt(path, np.column_stack([times, power]), "%.6g", ",", header="time_s,power_w", comments="")
            command = [sys.executable, "-m", "eadp", "fit", path, "-o", os.path.join(folder, "model.yaml")]
            quiet = [(os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)]
            pid = os.posix_spawn(sys.executable, command, os.environ, file_actions=quiet)
            _, status, used = os.wait4(pid, 0)
        cpu_s, max_mb = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
        whole = f"eadp fit {cpu_s:.2f} CPU s, {max_mb:.0f} MB at most, exit {status >> 8}"
        print(f"{len(times)} samples, {name}: analysis {alone_s:.2f} CPU s; {whole}", flush=True)


SPANS_H, PERIODS_S, DRIFTS = (1, 3, 8, 22), (2, 7, 10, 23, 60), (0.0, 0.04, 0.0, -0.04)


def long_sines(seed: int) -> None:
    """A strong sine and its second harmonic in white noise, over hours; in each second log the period drifts."""
    print("\n## Long logs\n")
    rows = []
    for number, (span_h, period_s) in enumerate(itertools.product(SPANS_H, PERIODS_S)):
        drift = DRIFTS[number % 4]
        rng = np.random.default_rng([seed, number])
        times = np.arange(0, 3600 * span_h, max(0.2, period_s / 12))
        # the frequency changes by the drift from end to end, in a straight line
        turns = times / period_s * (1 + drift * (times / times[-1] - 1) / 2)
        power = (
            36 + 2 * np.cos(2 * np.pi * turns) + 0.3 * np.cos(4 * np.pi * turns + 1) + 0.5 * rng.normal(size=len(times))
        )
        start = time.process_time()
        found = analyse(times, power)
        cpu_s = time.process_time() - start
        low_s, high_s = found.drift_s or (found.period_s, found.period_s)
        if drift:  # said to drift, around the period; parts see less than the ends, but for their errors
            right = found.drift_s is not None and low_s < period_s < high_s
        else:
            right = found.periodic and found.drift_s is None and abs(found.period_s - period_s) < 4 * found.period_std_s
        off = f"{abs(found.period_s - period_s) / found.period_std_s:.1f}" if found.periodic and not drift else ""
        answer = f"{found.period_s:.7g} ± {found.period_std_s:.1g} s" if found.periodic else "no period"
        answer = f"{low_s:.4g} to {high_s:.4g} s" if found.drift_s else answer
        rows.append((span_h, period_s, f"{100 * drift:+.0f}", len(times), answer, off, right, f"{cpu_s:.1f}"))
    table(("hours", "period [s]", "drift [%]", "samples", "answer", "off by [σ]", "right", "CPU [s]"), rows)


def main() -> None:
    parser = options(__doc__, "fit")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", metavar="WORDS", help="the kinds with these words in their names")
    asked = parser.parse_args()
    with recorded("fit", write=asked.write):
        print(f"{asked.runs} runs of each kind, seed {asked.seed}")
        cases = [case for case in CASES if asked.only in case.name]
        table(("errors in %", *COLUMNS), (run(case, asked.runs, asked.seed) for case in cases))
        if not asked.only:
            long_log(asked.seed)
            long_sines(asked.seed)


if __name__ == "__main__":
    main()

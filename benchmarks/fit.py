"""How well `eadp fit` finds periods in made logs whose period is known, and what it says of published ones.

usage: python benchmarks/fit.py [--runs 60] [--seed 0] [--opterra LOG.csv] [--px4 LOG.csv]

Made logs have three harmonics of random amplitudes (2.1, 1.4 and 0.6 W, ± 30 %) and phases, periods of 30 to 60 s and
samples every 0.5 s. Beside the error of the period stands that of the highest peak of a periodogram (an FFT of the
detrended log, gaps filled in straight lines), as it is often done. `claimed` is how often a period is said to be
there, `within 5 %` counts logs in which none is claimed as misses, and `cover` is how often the true period lies in
the interval of ± 1.96 period_std_s. Noise AR(τ) has correlation e^(−t/τ).
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from eadp.core.spectrum import Spectrum, analyse
from eadp.io.power_log import Columns, read_power_log

FloatArray = NDArray[np.float64]
AMPLITUDES_W = np.array([2.1, 1.4, 0.6])
STEP_S = 0.5


@dataclass(frozen=True)
class Log:
    """A made log and the period that is in it [s]; NaN where there is none."""

    times_s: FloatArray
    power_w: FloatArray
    period_s: float


@dataclass(frozen=True)
class Case:
    """A kind of log; `prior` gives one that is off by up to a quarter."""

    name: str
    make: Callable[[np.random.Generator], Log]
    prior: bool = False


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
        return Log(times, 36 + np.cos(angle) @ amplitude + std_w * coloured(rng, len(times), STEP_S, time_s), period_s)

    return make


def dropped(rng: np.random.Generator) -> Log:
    log = periodic(3, 10)(rng)
    kept = rng.random(len(log.times_s)) > 0.3
    return Log(log.times_s[kept], log.power_w[kept], log.period_s)


def gapped(rng: np.random.Generator) -> Log:
    log = periodic(3, 10)(rng)
    begin = rng.uniform(0.1 * log.times_s[-1], 0.9 * log.times_s[-1] - log.period_s / 2)
    kept = (log.times_s < begin) | (log.times_s > begin + log.period_s / 2)
    return Log(log.times_s[kept], log.power_w[kept], log.period_s)


def noise(low_s: float, high_s: float) -> Callable[[np.random.Generator], Log]:
    """Logs of 200 s of noise alone."""

    def make(rng: np.random.Generator) -> Log:
        times = np.arange(0, 200, STEP_S)
        time_s = rng.uniform(low_s, high_s)
        return Log(times, 36 + coloured(rng, len(times), STEP_S, time_s), float("nan"))

    return make


def walk(rng: np.random.Generator) -> Log:
    times = np.arange(0, 200, STEP_S)
    return Log(times, 36 + np.cumsum(rng.normal(size=len(times))), float("nan"))


CASES = (
    Case("white, 10 dB, 3 periods", periodic(3, 10)),
    Case("  30 % of samples dropped", dropped),
    Case("  a gap of half a period", gapped),
    Case("AR(5 s), 0 dB, 3 periods, prior", periodic(3, 0, 5), prior=True),
    Case("AR(5 s), 0 dB, 4 periods, prior", periodic(4, 0, 5), prior=True),
    Case("AR(5 s), 0 dB, 6 periods, prior", periodic(6, 0, 5), prior=True),
    Case("AR(5 s), 0 dB, 10 periods, prior", periodic(10, 0, 5), prior=True),
    Case("AR(5 s), 0 dB, 6 periods", periodic(6, 0, 5)),
    Case("AR(5 s), 5 dB, 6 periods", periodic(6, 5, 5)),
    Case("AR(15 s), 5 dB, 8 periods", periodic(8, 5, 15)),
    Case("noise alone, white", noise(0, 0)),
    Case("noise alone, AR(1 to 20 s)", noise(1, 20)),
    Case("noise alone, AR(5 s), prior", noise(5, 5), prior=True),
    Case("noise alone, random walk", walk),
)


# --- runs


def peak_s(log: Log) -> float:
    """The baseline: period of the highest peak of an FFT."""
    even = np.arange(0, log.times_s[-1], STEP_S)
    power = np.interp(even, log.times_s, log.power_w)
    power = (power - np.polyval(np.polyfit(even, power, 1), even)) * np.hanning(len(even))
    size = 16 * len(even)
    magnitude = np.abs(np.fft.rfft(power, size))
    first = int(np.ceil(2 * size * STEP_S / (2 * log.times_s[-1])))
    return size * STEP_S / (first + int(np.argmax(magnitude[first:])))


def run(case: Case, runs: int, seed: int) -> None:
    errors, peaks, claimed, inside, times = [], [], [], [], []
    for i in range(runs):
        rng = np.random.default_rng([seed, i])
        log = case.make(rng)
        around = log.period_s if np.isfinite(log.period_s) else 45.0
        prior_s = around * rng.uniform(0.75, 1.25) if case.prior else None
        begin = time.process_time()
        found: Spectrum = analyse(log.times_s, log.power_w, period_prior_s=prior_s)
        times.append(time.process_time() - begin)
        claimed.append(found.periodic)
        if np.isfinite(log.period_s):
            errors.append(abs(found.period_s / log.period_s - 1))
            peaks.append(abs(peak_s(log) / log.period_s - 1))
            if found.periodic:
                inside.append(abs(found.period_s - log.period_s) <= 1.96 * found.period_std_s)
    share = 100 * float(np.mean(claimed))
    line = f"{case.name:33s} {share:6.1f} %"
    if errors:
        error, baseline = 100 * np.array(errors), 100 * float(np.median(peaks))
        close = 100 * float(np.mean((error < 5) & np.array(claimed)))
        near = 100 * float(np.mean(error < 5))
        cover = 100 * float(np.mean(inside))
        middle, high = np.median(error), np.quantile(error, 0.9)
        line += f" {middle:7.2f} % {high:7.2f} % {close:6.1f} % {near:6.1f} % {cover:6.1f} % {baseline:7.2f} %"
    else:
        line += " " * 53
    print(f"{line} {np.median(times):6.2f} s", flush=True)


def long_log(seed: int) -> None:
    """30 minutes at 20 Hz."""
    times = np.arange(0, 1800, 0.05)
    for name, time_s in (("white", 0.0), ("AR(5 s)", 5.0)):
        rng = np.random.default_rng(seed)
        angle = 2 * np.pi * np.outer(times / 46, [1, 2, 3])
        power = 36 + np.cos(angle) @ AMPLITUDES_W + 0.6 * coloured(rng, len(times), 0.05, time_s)
        begin = time.process_time()
        found = analyse(times, power)
        used = time.process_time() - begin
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"{len(times)} samples, {name}: {found.period_s:.4f} s, {used:.2f} CPU s, {most:.0f} MB at most")


def published(name: str, path: str, columns: Columns, begin_s: float) -> None:
    log = read_power_log(path, columns)
    kept = log.times_s >= begin_s
    found = analyse(log.times_s[kept], log.power_w[kept])
    answer = f"{found.period_s:.2f} ± {found.period_std_s:.2f} s" if found.periodic else "no period"
    print(f"{name}, from {begin_s:g} s: {answer}; R² of blocks held out {found.cv_r2:.3f} (the mean: 0)")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--opterra", default="", metavar="LOG", help="a survey's power, headerless")
    parser.add_argument("--px4", default="", metavar="LOG", help="a battery_status as CSV")
    arguments = parser.parse_args()
    print(f"{arguments.runs} runs of each kind, seed {arguments.seed}")
    print(f"{'':33s}  claimed    median     90 %  within 5 %  or best  cover  FFT peak    CPU")
    for case in CASES:
        run(case, arguments.runs, arguments.seed)
    long_log(arguments.seed)
    if arguments.opterra:
        for begin_s in (0.0, 25.0):
            published("survey", arguments.opterra, Columns(names=("time_s", "power_w")), begin_s)
    if arguments.px4:
        published("PX4", arguments.px4, Columns(), 0.0)


if __name__ == "__main__":
    main()

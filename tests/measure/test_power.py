"""From samples to a model: a log, a part of it, a prior, the computations' power, and spikes taken out."""

import math
from pathlib import Path

import numpy as np
import pytest
from common import few
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from eadp.errors import InputError
from eadp.measure.noise import MAX_SHARE, WINDOW, spikes
from eadp.measure.power import FitOptions, fit_power, read_fit
from eadp.measure.power_log import Columns

PERIOD_S, STEP_S = 46.0, 0.5


def log_file(folder: Path) -> str:
    """A log of five waves of 3 W about 30 W."""
    rng, path = np.random.default_rng(5), folder / "log.csv"
    times = np.arange(0, 5 * PERIOD_S, STEP_S)
    power = 30 + 3 * np.cos(2 * math.pi * times / PERIOD_S) + 0.2 * rng.normal(size=len(times))
    path.write_text("time_s,power_w\n" + "".join(f"{t},{w}\n" for t, w in zip(times, power, strict=True)))
    return str(path)


def faults(error: pytest.ExceptionInfo[InputError]) -> list[str]:
    return [str(fault) for fault in error.value.faults]


@pytest.mark.slow
def test_without_options_nothing_is_left_out_and_nothing_said(tmp_path: Path) -> None:
    fit = read_fit(log_file(tmp_path), Columns(), FitOptions())
    assert fit.fitted.model.period_s == pytest.approx(PERIOD_S, rel=0.005)
    assert (fit.prior_s, fit.counts, fit.warnings) == (None, {"rows": 460}, [])


def test_a_part_of_the_log_keeps_the_times_of_the_log(tmp_path: Path) -> None:
    path = log_file(tmp_path)
    fit = read_fit(path, Columns(), FitOptions(start_s=20.0, end_s=200.0))
    assert fit.counts == {"rows": 460, "outside": 99}
    assert (fit.fitted.model.samples, fit.fitted.model.span_s) == (361, 180.0)
    with pytest.raises(InputError) as error:
        read_fit(path, Columns(), FitOptions(start_s=500.0))
    assert faults(error) == ["--from:1:1: error: leaves nothing of the log; expected a time within its 229.5 s"]
    with pytest.raises(InputError) as error:
        read_fit(path, Columns(), FitOptions(start_s=20.1, end_s=20.2))
    assert faults(error)[0].startswith("--to:1:1: error: leaves nothing of the log")


TIMES = np.arange(0, 5 * PERIOD_S, STEP_S)
WAVE = 36 + 2 * np.cos(2 * np.pi * TIMES / PERIOD_S + 0.5) + np.cos(4 * np.pi * TIMES / PERIOD_S - 1)


def slow(time_s: float, seed: int = 0) -> np.ndarray:
    """A Matérn-3/2 process of variance 1, its sampling as fine as its own definition needs."""
    apart = np.sqrt(3) * np.abs(TIMES[:, np.newaxis] - TIMES) / time_s
    root = np.linalg.cholesky((1 + apart) * np.exp(-apart) + 1e-9 * np.eye(len(TIMES)))
    return np.asarray(root @ np.random.default_rng(seed).normal(size=len(TIMES)))


def white(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=len(TIMES))


@pytest.mark.slow
@pytest.mark.parametrize("seed", few(range(1, 4), 1))
def test_white_noise_is_the_noise(seed: int) -> None:
    model = fit_power(TIMES, WAVE + 0.3 * white(seed)).model
    assert model.noise_std_w == pytest.approx(0.3, rel=0.1)
    assert model.period_s == pytest.approx(PERIOD_S, rel=0.005)


# nominally 95 % of three times as many; plain least squares' would hold for half
@pytest.mark.slow
def test_standard_deviations_hold_under_correlated_noise() -> None:
    inside = []
    for seed in range(12):
        normal = np.random.default_rng(seed).normal(size=960)
        noise = np.asarray(lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], normal)[-460:])
        model = fit_power(TIMES, WAVE + 0.5 * noise).model
        assert model.mean_std_w is not None
        inside.append(abs(model.mean_w - 36) < 1.96 * model.mean_std_w)
        inside.append(abs(model.harmonics[0].amplitude_w - 2) < 1.96 * model.amplitude_std_w[0])
        inside.append(abs(model.period_s - PERIOD_S) < 1.96 * model.period_std_s)
    assert sum(inside) >= 29


@pytest.mark.slow
def test_spikes_are_left_out_unless_they_are_to_be_kept() -> None:
    power = WAVE + 0.3 * white()
    places = [0, 100, 101, 300]
    power[places] += 500
    fitted = fit_power(TIMES, power)
    assert fitted.spikes.tolist() == places
    assert fitted.model.samples == len(TIMES) - 4
    assert fitted.model.mean_w == pytest.approx(36, abs=0.05)
    assert fitted.model.period_s == pytest.approx(PERIOD_S, rel=0.005)
    assert fitted.times_s[0] == 0, "times from the first sample kept"


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

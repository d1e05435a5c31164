"""What `eadp fit` draws beside the fit: the fit, with or without a period, and the filter over the log."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from common import few
from common.answers import refused

from eadp.measure.figures import _broken, write_fit_figure
from eadp.measure.power import fit_power
from eadp.measure.spectrum import analyse, periodogram

LOG = "scenarios/example-power-log.csv"


def table(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(stream)]


def log_of(path, rows, header="time_s,power_w,x_m,y_m"):
    path.write_text(header + "\n" + "".join(",".join(f"{value:.9f}" for value in row) + "\n" for row in rows))
    return path


def waves(seconds):
    """A flight east at 10 m/s, its power a wave of 50 s."""
    return [(t, 40 + 2 * math.cos(2 * math.pi * t / 50), 10 * t, 0.0) for t in np.arange(0.0, seconds, 0.5)]


@pytest.mark.parametrize("suffix", few(["svg", "png"], 1))
def test_the_figures(eadp, tmp_path, suffix):
    run = tmp_path / f"filter.{suffix}"
    assert eadp("fit", LOG, "--to", "110", "--filter", run, "--gate", "1").code == 0
    assert run.stat().st_size > 5000


def test_the_filter_finds_the_harmonics_and_a_gate_holds_them(eadp, tmp_path):
    log = log_of(tmp_path / "log.csv", waves(200))
    found = {}
    for gate in ("0", "100"):
        out = tmp_path / f"filter-{gate}.csv"
        assert eadp("fit", log, "--order", "1", "--filter", out, "--gate", gate).code == 0
        found[gate] = table(out)
    last, held = found["0"][-1], found["100"]
    assert last["period_s"] == pytest.approx(50, rel=1e-3)
    assert last["alpha0_w"] == pytest.approx(40, abs=0.1)
    assert math.hypot(last["alpha1_w"], last["beta1_w"]) == pytest.approx(2, abs=0.1)
    assert last["forecast_w"] == pytest.approx(last["power_w"], abs=0.05)
    # within the gate nothing is corrected: the level stays at the first reading
    assert [row["alpha0_w"] for row in held] == pytest.approx([held[0]["power_w"]] * len(held))
    assert [row["power_w"] for row in found["0"]] == [row["power_w"] for row in held]


def test_what_cannot_be_drawn(eadp, tmp_path):
    log = log_of(tmp_path / "log.csv", [row[:2] for row in waves(120)], "time_s,power_w")
    picture = tmp_path / "p.svg"
    assert refused(eadp("fit", log, "--plot", picture, "--filter", "p.txt"), "a name that ends in .svg or .png")
    assert not picture.exists()


TIMES = np.arange(0, 200, 0.5)
POWER = 36 + 2 * np.cos(2 * np.pi * TIMES / 46) + 0.3 * np.random.default_rng(0).normal(size=len(TIMES))


@pytest.mark.quick(1)
@pytest.mark.parametrize("kind", ["noise", "constant"])
def test_a_log_without_a_period_has_a_picture(tmp_path: Path, kind: str) -> None:
    power = np.full(60, 36.0) if kind == "constant" else np.random.default_rng(1).normal(size=60)
    write_fit_figure(str(tmp_path / "a.svg"), fit_power(TIMES[:60], power))
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def test_scores_are_highest_at_the_period_and_agree_with_the_analysis() -> None:
    found = analyse(TIMES, POWER)
    period_s, r2 = periodogram(TIMES, POWER, 1)
    assert np.all(np.diff(period_s) > 0)
    assert period_s[np.argmax(r2)] == pytest.approx(46, rel=0.01)
    assert r2.max() == pytest.approx(found.cv_r2, abs=0.002)
    fine = np.arange(0, 200, 0.02)
    power = 36 + 2 * np.cos(2 * np.pi * fine / 46)
    period_s, r2 = periodogram(fine, power, 1)
    assert period_s[np.argmax(r2)] == pytest.approx(46, rel=0.01), "of many samples averages are taken"


def test_lines_break_at_gaps():
    times = np.array([0.0, 1, 2, 3, 50, 51, 52])
    broken_s, values = _broken(times, np.arange(7.0))
    assert broken_s.tolist() == [0, 1, 2, 3, 26.5, 50, 51, 52]
    assert np.isnan(values).tolist() == [False] * 4 + [True] + [False] * 3
    assert _broken(times[:4], np.arange(4.0))[0].tolist() == [0, 1, 2, 3]

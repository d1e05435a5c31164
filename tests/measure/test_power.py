"""A log, a part of it, a prior and the computations' power put together, and the faults that name their file."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from eadp.errors import InputError
from eadp.measure.power import FitOptions, read_fit
from eadp.measure.power_log import Columns

PERIOD_S, STEP_S = 46.0, 0.5
PROFILE = "fps,power_w\n2,3\n4,5\n6,9\n"
DREW_W = {2: 3.0, 4: 5.0, 6: 9.0}


def log_file(folder: Path, laps: float = 5, columns: str = "") -> str:
    """A log of a wave of 3 W about 30 W; with a column of fps by `columns`."""
    rng = np.random.default_rng(5)
    rows = ["time_s,power_w" + (f",{columns}" if columns else "")]
    for i in range(int(laps * PERIOD_S / STEP_S)):
        t = i * STEP_S
        turn = 2 * math.pi * t / PERIOD_S
        fps = 2 + 2 * (i // 100 % 3)
        power = 30 + 3 * math.cos(turn) + 0.2 * rng.normal() + (DREW_W[fps] if columns == "fps" else 0)
        rows.append(f"{t},{power}" + (f",{fps}" if columns else ""))
    path = folder / "log.csv"
    path.write_text("\n".join([*rows, ""]))
    return str(path)


def faults(error: pytest.ExceptionInfo[InputError]) -> list[str]:
    return [str(fault) for fault in error.value.faults]


def test_without_options_nothing_is_left_out_and_nothing_said(tmp_path: Path) -> None:
    fit = read_fit(log_file(tmp_path), Columns(), FitOptions())
    assert fit.fitted.model.period_s == pytest.approx(PERIOD_S, rel=0.005)
    assert (fit.prior_s, fit.counts, fit.warnings) == (None, {"rows": 460}, [])


def test_a_part_of_the_log_keeps_the_times_of_the_log(tmp_path: Path) -> None:
    path = log_file(tmp_path, columns="x_m,y_m")
    fit = read_fit(path, Columns(), FitOptions(start_s=20.0, end_s=200.0))
    assert fit.counts == {"rows": 460, "outside": 99}
    assert (fit.fitted.model.samples, fit.fitted.model.span_s) == (361, 180.0)
    with pytest.raises(InputError) as error:
        read_fit(path, Columns(), FitOptions(start_s=500.0))
    assert faults(error) == ["--from:1:1: error: leaves nothing of the log; expected a time within its 229.5 s"]
    with pytest.raises(InputError) as error:
        read_fit(path, Columns(), FitOptions(start_s=20.1, end_s=20.2))
    assert faults(error)[0].startswith("--to:1:1: error: leaves nothing of the log")


def test_what_the_computations_drew_is_taken_off_and_unknown_configurations_are_left_out(tmp_path: Path) -> None:
    path = Path(log_file(tmp_path, columns="fps"))
    profile = tmp_path / "profile.csv"
    profile.write_text(PROFILE)
    options = FitOptions(profile=str(profile))
    model = read_fit(str(path), Columns(), options).fitted.model
    assert model.mean_w == pytest.approx(30, abs=0.05), "the wave's own mean"
    assert model.harmonics[0].amplitude_w == pytest.approx(3, abs=0.1)
    rows = path.read_text().splitlines()
    for i in (7, 8, 9):
        rows[i] = rows[i].rsplit(",", 1)[0] + ","
    path.write_text("\n".join([*rows, ""]))
    fit = read_fit(str(path), Columns(), options)
    assert fit.counts["no_configuration"] == 3
    assert fit.fitted.model.samples == 457


def test_a_spike_is_a_warning_at_its_time_in_the_log(tmp_path: Path) -> None:
    path = Path(log_file(tmp_path))
    rows = path.read_text().splitlines()
    rows[101] = "50,900"
    path.write_text("\n".join([*rows, ""]))
    fit = read_fit(str(path), Columns(), FitOptions(start_s=10.0))
    assert fit.counts["spikes"] == 1
    assert [fault.message for fault in fit.warnings] == ["1 spike left out, the first at 50 s"]

"""A log, a part of it, a prior and the computations' power put together, and the faults that name their file."""

import math
from pathlib import Path

import numpy as np
import pytest

from eadp.errors import InputError
from eadp.measure.power import FitOptions, read_fit
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

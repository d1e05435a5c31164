"""The picture of a fit is drawn, the same each time, with or without a period."""

from pathlib import Path

import numpy as np
import pytest

from eadp.measure.figures import _broken, write_fit_figure
from eadp.measure.power import fit_energy
from eadp.measure.spectrum import analyse, periodogram

TIMES = np.arange(0, 200, 0.5)
POWER = 36 + 2 * np.cos(2 * np.pi * TIMES / 46) + 0.3 * np.random.default_rng(0).normal(size=len(TIMES))


@pytest.mark.quick(1)
@pytest.mark.parametrize("kind", ["noise", "constant"])
def test_a_log_without_a_period_has_a_picture(tmp_path: Path, kind: str) -> None:
    power = np.full(60, 36.0) if kind == "constant" else np.random.default_rng(1).normal(size=60)
    write_fit_figure(str(tmp_path / "a.svg"), fit_energy(TIMES[:60], power))
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

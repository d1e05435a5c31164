"""What `eadp fit` draws beside the fit: the spectrum, the filter over the log, the track beside a plan."""

import csv
import math

import numpy as np
import pytest
from common import few
from common.answers import refused

from eadp.core.geometry.geodesy import to_geodetic_deg

LOG = "scenarios/example-power-log.csv"
LINE = "%: trigger-radius 5\n0.05; 270; y\n300, 0\n0.05; 270; y\n600, 0\n"
ORIGIN = (55.37, 10.43)


def table(path):
    with path.open(newline="", encoding="utf-8") as stream:
        return [{key: float(value) for key, value in row.items()} for row in csv.DictReader(stream)]


def log_of(path, rows, header="time_s,power_w,x_m,y_m"):
    path.write_text(header + "\n" + "".join(",".join(f"{value:.9f}" for value in row) + "\n" for row in rows))
    return path


def waves(seconds=400, y_m=0.0, x_m=0.0):
    """A flight east at 10 m/s, its power a wave of 50 s."""
    return [(t, 40 + 2 * math.cos(2 * math.pi * t / 50), x_m + 10 * t, y_m) for t in np.arange(0.0, seconds, 0.5)]


@pytest.mark.parametrize("suffix", few(["svg", "png"], 1))
def test_the_figures(eadp, tmp_path, suffix):
    spectrum, run = tmp_path / f"spectrum.{suffix}", tmp_path / f"filter.{suffix}"
    assert eadp("fit", LOG, "--to", "110", "--spectrum", spectrum, "--filter", run, "--gate", "1").code == 0
    for picture in (spectrum, run):
        assert picture.stat().st_size > 5000


def test_the_filter_finds_the_harmonics_and_a_gate_holds_them(eadp, tmp_path):
    log = log_of(tmp_path / "log.csv", waves())
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


@pytest.mark.quick(1)
@pytest.mark.parametrize("degrees", [False, True])
def test_the_track_beside_the_plan(eadp, tmp_path, degrees):
    plan, out = tmp_path / "round.plan", tmp_path / "track.csv"
    plan.write_text(f"%: origin {ORIGIN[0]} {ORIGIN[1]}\n{LINE}")
    rows, header = waves(40, 3.0, 200.0), "time_s,power_w,x_m,y_m"
    if degrees:
        header = "time_s,power_w,lat,lon"
        rows = [(t, w, *to_geodetic_deg(x, y, ORIGIN)) for t, w, x, y in rows]
    log = log_of(tmp_path / "log.csv", rows, header)
    picture = tmp_path / "track.svg"
    for name in (out, picture)[: 1 + degrees]:
        assert eadp("fit", log, "--plan", plan, "--track", name).code in (0, 1)
    assert [row["cross_track_m"] for row in table(out)] == pytest.approx([3.0] * len(rows), abs=0.02)
    assert picture.exists() == degrees
    assert not degrees or picture.stat().st_size > 5000


def test_the_track_of_a_lap_is_beside_its_own_lap(eadp, tmp_path):
    """Lines 10 m apart, flown 7 m off: the nearest line would be another lap's, 3 m away."""
    lines = "".join(
        f"0.05; {270 if k % 2 == 0 else 90}; y-{10 * k}\n{300 if k % 2 == 0 else 0}, {10 * k}\n" for k in range(6)
    )
    plan, out = tmp_path / "lines.plan", tmp_path / "track.csv"
    plan.write_text(f"%: trigger-radius 1\n{lines}")
    rows = []
    for k in range(6):
        for step in range(30):
            x = 10.0 * step if k % 2 == 0 else 300.0 - 10.0 * step
            rows.append((float(len(rows)), 40 + math.cos(len(rows)), x, 10 * k + 7.0))
    log = log_of(tmp_path / "log.csv", rows)
    assert eadp("fit", log, "--plan", plan, "--track", out).code in (0, 1)
    off = [row["cross_track_m"] for row in table(out)]
    assert np.median(off) == pytest.approx(7.0, abs=0.1)


def test_what_cannot_be_drawn(eadp, tmp_path):
    plan = tmp_path / "round.plan"
    plan.write_text(LINE)
    log = log_of(tmp_path / "log.csv", [row[:2] for row in waves(120)], "time_s,power_w")
    picture = tmp_path / "p.svg"
    assert refused(eadp("fit", log, "--track", picture), "beside no plan")
    assert refused(eadp("fit", log, "--plan", plan, "--track", picture), "the log has no positions")
    for option in ("--spectrum", "--filter"):
        assert refused(eadp("fit", log, "--plot", picture, option, "p.txt"), "a name that ends in .svg or .png")
    assert not picture.exists()

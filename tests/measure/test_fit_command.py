"""`eadp fit` as it is called: exit codes, stdout and stderr, the model written."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from common import ROOT, few_rows, with_header

from eadp.core.arrays import FloatArray
from eadp.io.energy import parse_energy
from eadp.io.text.streams import read_text

Run = Callable[..., tuple[int, str, str]]

EXAMPLE = str(ROOT / "scenarios" / "example-power-log.csv")
KEYS = [
    "schema", "periodic", "period_s", "period_std_s", "order", "mean_w", "mean_std_w", "harmonics",
    "amplitude_std_w", "coefficients", "noise_std_w", "cv_r2", "samples", "span_s", "candidate", "range_s",
    "drift_s", "prior", "log",
]  # fmt: skip


@pytest.fixture
def noise(tmp_path: Path) -> str:
    """A log without a period."""
    power = 30 + np.random.default_rng(1).normal(size=60)
    file = tmp_path / "noise.csv"
    file.write_text("time_s,power_w\n" + "".join(f"{i},{value}\n" for i, value in enumerate(power)))
    return str(file)


@pytest.mark.slow
def test_example_as_json(eadp: Run) -> None:
    code, out, err = eadp("fit", EXAMPLE, "--format", "json")
    document = json.loads(out)
    assert (code, err, list(document)) == (0, "", KEYS)
    # the log was made with these values and noise of 0.5 W
    assert document["schema"] == "eadp.energy/1"
    assert document["periodic"] is True
    assert abs(document["period_s"] - 46.05) < 3 * document["period_std_s"] < 0.1
    assert document["mean_w"] == pytest.approx(36.4, abs=0.03)
    assert document["noise_std_w"] == pytest.approx(0.5, abs=0.03)
    assert (document["order"], document["samples"], document["span_s"]) == (3, 2303, pytest.approx(230.2))
    made = (2.1, 0.8), (1.4, -1.9), (0.6, 2.6)
    for harmonic, (amplitude_w, phase_rad) in zip(document["harmonics"], made, strict=True):
        assert list(harmonic) == ["amplitude_w", "phase_rad"]
        assert harmonic["amplitude_w"] == pytest.approx(amplitude_w, abs=0.05)
        assert harmonic["phase_rad"] == pytest.approx(phase_rad, abs=0.1)
    a, b = document["coefficients"]["a"], document["coefficients"]["b"]
    assert (len(a), len(b)) == (4, 3)
    assert a[0] / document["period_s"] == pytest.approx(document["mean_w"])
    assert np.hypot(a[2], b[1]) * 2 / document["period_s"] == pytest.approx(document["harmonics"][1]["amplitude_w"])


def test_a_log_without_a_period_is_a_no_with_its_document(eadp: Run, noise: str, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    code, out, err = eadp("fit", noise, "--format", "json", "-o", str(model))
    document = json.loads(out)
    assert (code, err, list(document)) == (1, "", KEYS)
    assert (document["periodic"], document["period_s"], document["period_std_s"]) == (False, None, None)
    assert (document["order"], document["harmonics"]) == (0, [])
    assert document["coefficients"] == {"a": [], "b": []}
    assert parse_energy(read_text(str(model))).mean_w == document["mean_w"] == pytest.approx(30, abs=0.5)


def test_a_log_without_a_period_in_words(eadp: Run, noise: str, tmp_path: Path) -> None:
    code, out, _ = eadp("fit", noise)
    assert code == 1
    assert out.startswith("no period: the best")
    constant = tmp_path / "constant.csv"
    constant.write_text("time_s,power_w\n" + "".join(f"{i},30\n" for i in range(50)))
    said = "no period: the power is constant\nmean     30 W\nstd dev  0 W\nsamples  50 over 49 s\n"
    assert eadp("fit", str(constant))[:2] == (1, said)


@pytest.mark.slow
def test_model_written_is_the_document_printed(eadp: Run, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    short = ("fit", EXAMPLE, "--to", "110")
    code, out, err = eadp(*short, "--format", "json", "-o", str(model))
    assert (code, err) == (0, "")
    written = parse_energy(read_text(str(model)))
    assert written.period_s == json.loads(out)["period_s"]
    assert [each.amplitude_w for each in written.harmonics] == [h["amplitude_w"] for h in json.loads(out)["harmonics"]]
    code, out, _ = eadp(*short, "-o", "-")
    assert (code, out) == (0, model.read_text()), "the model alone on standard output"


@pytest.mark.slow
def test_columns_units_order_and_prior_by_option(eadp: Run, tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = [line.split(",") for line in Path(EXAMPLE).read_text().splitlines()[1:1101]]
    log.write_text("when,u_v,i_a,w_w\n" + "".join(f"{1000 * float(t)},10,{float(p) / 10},{p}\n" for t, p in rows))
    arguments = ["fit", str(log), "--time", "when", "--time-unit", "ms", "--format", "json"]
    code, out, _ = eadp(*arguments, "--voltage", "u_v", "--current", "i_a", "--order", "2", "--period-prior", "50")
    document = json.loads(out)
    assert (code, document["order"]) == (0, 2)
    assert document["period_s"] == pytest.approx(46.05, abs=0.3)
    code, out, err = eadp(*arguments, "--power", "w_w")
    assert (code, json.loads(out)["order"], err.count("warning")) == (0, 3, 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["no-such-file.csv"], "no-such-file.csv:1:1: error: cannot be read: No such file or directory"),
        ([EXAMPLE, "--time-unit", "parsec"], "eadp: error: Invalid value for '--time-unit'"),
        ([EXAMPLE, "--to", "110", "--order", "900"], f"{EXAMPLE}:1:1: error: order 900 is too high"),
        ([EXAMPLE, "--period-prior", "900"], f"{EXAMPLE}:1:1: error: no period near 900 s can be found"),
        ([EXAMPLE, "--to", "110", "-o", "/no/such/m.yaml"], "/no/such/m.yaml:1:1: error: cannot be written"),
        ([EXAMPLE, "-o", "-", "--format", "json"], "--output:1:1: error: standard output is taken by --format json"),
        ([], "eadp: error: Missing argument"),
    ],
)
def test_errors_leave_stdout_empty(eadp: Run, arguments: list[str], message: str) -> None:
    code, out, err = eadp("fit", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(message)


def flight(tmp_path: Path, header: str, row: str, noise_w: float = 0.2, n: int = 500) -> str:
    """A log of 46 s laps, 0.5 s a row; {t}, {w} and what `row` computes from i."""
    rng, rows = np.random.default_rng(5), []
    for i in range(n):
        t = i / 2
        w = 30 + 3 * np.cos(2 * np.pi * t / 46) + noise_w * rng.normal()
        names = {"t": t, "w": w, "i": i, "fps": 2 + 2 * (i // 100)}
        rows.append(row.format(**names))
    log = tmp_path / "flight.csv"
    log.write_text("\n".join([header, *rows, ""]))
    return str(log)


def test_known_power_of_the_computations_is_taken_off(eadp: Run, tmp_path: Path) -> None:
    profile = str(ROOT / "profiles" / "pednet-jetson-nano.csv")
    log = flight(tmp_path, "time_s,power_w,fps", "{t},{w},{fps}")
    code, out, _ = eadp("fit", log, "--profile", profile, "--format", "json")
    document = json.loads(out)
    said = [eadp("profile", profile, "--at", f"fps={fps}")[1] for fps in (2, 4, 6, 8, 10)]
    powers = [float(text.split(": ")[1].split()[0]) for text in said]
    assert code == 0
    assert document["mean_w"] == pytest.approx(30 - np.mean(powers), abs=0.15)
    code, out, err = eadp("fit", flight(tmp_path, "time_s,power_w", "{t},{w}"), "--profile", profile)
    assert (code, out) == (2, "")
    assert ":1:1: error: no column fps; expected one beside time_s, power_w" in err
    code, out, err = eadp("fit", flight(tmp_path, "time_s,power_w,fps", "{t},{w},900"), "--profile", profile)
    assert (code, out) == (2, "")
    assert err.startswith(f"{profile}:1:1: error: the log has a configuration outside the profile: ")


def test_what_is_left_out_is_said(eadp: Run, tmp_path: Path) -> None:
    log = Path(flight(tmp_path, "time_s,power_w", "{t},{w}"))
    rows = log.read_text().splitlines()
    rows[50] = rows[50].split(",")[0] + ",900"
    del rows[200:240]
    log.write_text("\n".join([*rows, "400,nan", ""]))
    code, out, err = eadp("fit", str(log), "--period-prior", "46")
    assert code == 0
    assert "\ngaps     1, the longest 20.5 s\n" in out
    assert "1 spike left out, the first at 24.5 s" in err
    code, out, _ = eadp("fit", str(log), "--period-prior", "46", "--format", "json")
    counts = {"rows": 461, "not_finite": 1, "gaps": 1, "longest_gap_s": 20.5, "spikes": 1}
    assert (code, json.loads(out)["log"]) == (0, counts)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "period_s"),
    few_rows(
        [
            ("flights/static-I_energy.csv", pytest.approx(46.05, abs=0.3)),  # its laps take 45.8 to 46.3 s
            ("logs/opterra_power.csv", pytest.approx(50, abs=1.5)),
            ("logs/px4_battery_first900s.csv", None),  # a real flight without a usable period
        ],
        1,
    ),
)
def test_published_logs(eadp: Run, tmp_path: Path, name: str, period_s: object) -> None:
    reference = ROOT.parent / "shared" / "reference"
    if not reference.is_dir():
        pytest.skip("the published reference data are not on this machine")
    log = reference / name if "px4" in name else with_header(reference / name, tmp_path)
    code, out, _ = eadp("fit", str(log), "--format", "json")
    found = json.loads(out)
    assert (code, found["period_s"] if found["periodic"] else None) == (period_s is None, period_s)


@pytest.mark.slow
def test_what_a_period_may_hide_is_stated(eadp: Run, tmp_path: Path) -> None:
    times = np.arange(0.0, 1800.0, 0.5)
    period = 46 * (0.92 + 0.16 * times / 1800)
    log = tmp_path / "log.csv"

    def write(power: FloatArray) -> None:
        np.savetxt(log, np.stack([times, power], axis=1), "%.6f", ",", header="time_s,power_w", comments="")

    write(36 + 2 * np.cos(2 * np.pi * times / 3))
    code, out, err = eadp("fit", str(log), "--period-prior", "9")
    assert (code, out.splitlines()[0][:12]) == (0, "period   9 s")
    code, out, err = eadp("fit", str(log))
    assert (code, err) == (0, "")
    assert "period   3 s" in out
    assert "; periods of 4.499 s to 947.1 s searched\n" in out
    write(36 + 2 * np.cos(2 * np.pi * np.cumsum(0.5 / period)) + np.random.default_rng(0).normal(0, 0.5, len(times)))
    code, out, err = eadp("fit", str(log))
    assert code == 0
    low, high = map(float, re.findall(r"the period drifts: ([\d.]+) s to ([\d.]+) s in parts of the log", err)[0])
    assert (low, high) == (pytest.approx(period[0], rel=0.02), pytest.approx(period[-1], rel=0.02))
    code, out, err = eadp("fit", str(log), "--to", "600")
    assert (code, "warning: the period drifts" in err) == (0, True)

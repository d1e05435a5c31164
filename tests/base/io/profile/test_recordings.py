"""What the programs of power sensors record, as profiles of several configurations."""

from __future__ import annotations

import pytest

from eadp.errors import InputError
from eadp.io.profile.configurations import as_trace
from eadp.io.text.streams import Text

TEGRA = (
    "10-01-2025 20:05:5{i} RAM 2274/6834MB (lfb 27x4MB) SWAP 542/3417MB CPU [99%@1189,off] {rail} VDD_SOC 900mW/950mW"
)


def watts(body):
    head, *rows = as_trace(Text("t", body)).body.split()
    assert head == "power_w"
    return [float(row) for row in rows]


def test_tegrastats_by_the_rail_of_the_board():
    body = "\n".join(
        TEGRA.format(i=i, rail=f"CPU@40C VDD_CPU_GPU_CV 1594mW/1594mW VDD_IN {5000 + i}mW/1mW") for i in range(3)
    )
    assert watts(body) == [5.0, 5.001, 5.002]
    assert watts(TEGRA.format(i=0, rail="POM_5V_IN 2345/2300")) == [2.345]
    with pytest.raises(InputError, match="is a log of tegrastats without a power; expected a rail of VDD_IN"):
        as_trace(Text("t", TEGRA.format(i=0, rail="")))


def test_nvidia_smi_and_ina():
    assert watts("timestamp, power.draw [W], clocks\n2024/01/01 10:00:00, 23.45 W, 5\nx, [N/A], 5\n") == [23.45]
    assert watts("time_s,bus_voltage_v,current_ma\n0,5,1000\n1,5.1,900\n") == [5.0, 4.59]
    assert watts("Bus Voltage (V);Current (mA);Power (mW)\n5;1000;4990\n") == [4.99]
    table = Text("t", "fps,power_w\n2,5\n")
    assert as_trace(table) is table


def test_recordings_make_a_profile(eadp, tmp_path):
    for fps, milliwatts in ((1, 4000), (5, 6000)):
        rows = [TEGRA.format(i=0, rail=f"VDD_IN {milliwatts + i}mW/1mW") for i in range(20)]
        (tmp_path / f"{fps}.log").write_text("\n".join(rows) + "\n")
    logs = [tmp_path / "1.log", tmp_path / "5.log"]
    answer = eadp("profile", *logs, "--config", "fps=1", "--config", "fps=5", "--at", "fps=3")
    assert answer.code == 0
    assert "fps=3: 5.0" in answer.out

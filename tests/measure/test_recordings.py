"""What programs record of a computer's power: the board's power, or a question, and never another's."""

import json
import statistics

import pytest
from common.answers import refused

from eadp.errors import InputError
from eadp.io.text.streams import Text
from eadp.measure.recordings import read_recording

TEGRA = "04-02-2026 09:00:0{i} RAM 2274/6834MB (lfb 27x4MB) SWAP 542/3417MB CPU [99%@1189,off] {rails}"
XAVIER = "GPU 1000/9 CPU 500mW/9mW SOC 900/9 CV 0/0 VDDRQ 300/9 SYS5V 1500/9"
ORIN = "VDD_GPU_SOC 2750mW/9mW VDD_CPU_CV 490mW/9mW VIN_SYS_5V0 3050mW/9mW"


def tegra(rails: str) -> str:
    return "\n".join(TEGRA.format(i=i, rails=rails) for i in range(3))


def watts(body: str, *asked: str) -> list[float]:
    found = read_recording(Text("t", body), asked)
    assert found is not None
    return [each for each in found.powers_w() if each is not None]


@pytest.mark.parametrize(
    ("rails", "power_w"),
    [
        ("VDD_CPU_GPU_CV 1594mW/1594mW VDD_IN 5000mW/1mW", 5.0),
        ("POM_5V_IN 2345/2300 POM_5V_GPU 80/80 POM_5V_CPU 500/500", 2.345),
        (XAVIER, 4.2),
        (ORIN, 6.29),
        (f"{ORIN} VDDQ_VDD2_1V8AO 400mW/9mW", 6.69),
        ("VDD_GPU 0mW/0mW VIN_SYS_5V0 3000mW/9mW VIN 24000mW/9mW", 24.0),
    ],
)
def test_tegrastats_by_the_rails_of_the_board(rails, power_w):
    assert watts(tegra(rails)) == pytest.approx([power_w] * 3)


def test_an_unknown_board_is_asked_for():
    for rails in ("VDD_FOO 900mW/9mW VDD_BAR 100mW/9mW", "VDD_IN 900mW/9mW VDD_MUX 100mW/9mW"):
        with pytest.raises(InputError, match=r"which column is the power of the computer.*--power"):
            watts(tegra(rails))
    assert watts(tegra("VDD_FOO 900mW/9mW VDD_BAR 100mW/9mW"), "VDD_FOO", "VDD_BAR") == pytest.approx([1.0] * 3)
    with pytest.raises(InputError, match="is a log of tegrastats without a power"):
        watts(tegra(""))


@pytest.mark.parametrize(
    ("body", "expected_w"),
    [
        ("timestamp, power.draw [W], clocks [MHz]\n2024/01/01 10:00:00, 23.45 W, 5 MHz\nx, [N/A], 5 MHz\n", [23.45]),
        ("time,uptime,GPU,Power VDD_IN,Power VDD_SOC,Power TOT,nvp model\n1,1,20,5157,1733,6900,15W\n", [5.157]),
        ("time,uptime,GPU,Power VDD_CPU_GPU_CV,Power TOT\n1,1,20,1000,6900\n", [6.9]),
        ("time,uptime,CPU1,power cur,power avg\n1,1,20,4859,4899\n", [4.859]),
        (
            "time,GPU,Power GPU,Power CPU,Power SOC,Power CV,Power VDDRQ,Power SYS5V\n1,20,1000,500,900,0,300,1500\n",
            [4.2],
        ),
        ("time_s,bus_voltage_v,current_ma\n0,5,1000\n1,5.1,900\n", [5.0, 4.59]),
        ("Bus Voltage (V);Current (mA);Power (mW)\n5;1000;4990\n", [4.99]),
        ("timestamp,in1_input,curr1_input\n1,5000,1040\n", [5.2]),
        ("time_s,package-0 (W),core (W),dram (W)\n0,12,8,1.5\n", [13.5]),
        ("CPU\tBusy%\tPkgWatt\tCorWatt\tRAMWatt\n-\t3\t12\t8\t1.5\n0\t3\n", [13.5]),
        ("fps,watts\n2,5.1\n", [5.1]),
        ("gpu_soc_mw,cpu_cv_mw,total_mw\n1000,1000,4000\n", [4.0]),
    ],
)
def test_tables_of_programs(body, expected_w):
    assert watts(body) == pytest.approx(expected_w)


@pytest.mark.parametrize(
    ("body", "asked", "question"),
    [
        ("fps,PWR_AVG\n2,5.1\n", (), r"These may be: PWR_AVG; expected --power 'PWR_AVG \[W\]'"),
        ("fps,PWR_AVG\n2,5.1\n", ("PWR_AVG",), "PWR_AVG has no unit of power"),
        ("fps,VDD_IN\n2,5.1\n", (), r"VDD_IN has no unit.*--power 'VDD_IN \[W\]'"),
        ("t_s,ch1_voltage_v,ch1_current_a,ch1_power_w,ch2_power_w\n1,5,1,5,5\n", (), "several columns of power"),
    ],
)
def test_questions(body, asked, question):
    with pytest.raises(InputError, match=question):
        watts(body, *asked)


def test_units_that_are_stated():
    body = "fps,PWR_AVG,VDD_IN\n2,5.1,900\n"
    assert watts(body, "PWR_AVG [W]") == [5.1]
    assert watts(body, "PWR_AVG [W]", "VDD_IN") == [6.0]
    with pytest.raises(InputError, match=r"W is not the unit of the column GPU \[mW\]"):
        watts("t,GPU [mW]\n0,2\n", "GPU [W]")
    assert watts("time_s,board [µW]\n0,2000000\n", "board [µW]") == watts("t,power.draw\n0,2\n", "power.draw") == [2.0]


def test_another_table_is_left_as_it_is():
    for body in ("fps,power_w\n2,5\n", "2,5\n4,6\n", "200,100\n1,5\n", "", "x_m,y_m\n1,2\n"):
        assert read_recording(Text("t", body)) is None


def test_recordings_make_a_profile(eadp, tmp_path):
    for fps, milliwatts in ((1, 4000), (5, 6000)):
        rows = [
            TEGRA.partition(" RAM")[2].join(("RAM", "")).format(rails=f"VDD_IN {milliwatts + i}mW/1mW")
            for i in range(20)
        ]
        (tmp_path / f"{fps}.log").write_text("\n".join(rows) + "\n")
    logs = [tmp_path / "1.log", tmp_path / "5.log"]
    answer = eadp("profile", *logs, "--config", "fps=1", "--config", "fps=5", "--at", "fps=3")
    assert answer.code == 0
    assert "fps=3: 5.0" in answer.out
    assert refused(eadp("profile", *logs), "--config fps=2 --config fps=10")
    fitted = eadp("fit", logs[0], "--format", "json")
    assert abs(json.loads(fitted.out)["mean_w"] - statistics.fmean(4 + i / 1000 for i in range(20))) < 0.01


def test_idle_ends_are_left_out_where_asked(eadp, tmp_path):
    for name, busy in (("a", 6000), ("b", 9000)):
        rows = [busy] * 40
        rows[:3] = rows[-3:] = [busy - 2000] * 3
        body = "\n".join(f"{TEGRA.format(i=0, rails=f'VDD_IN {each}mW/1mW')}" for each in rows)
        (tmp_path / f"{name}.log").write_text(body)
    files = tmp_path / "a.log", tmp_path / "b.log", "--config", "fps=1", "--config", "fps=2", "--at", "fps=1"
    assert "fps=1: 5.7 W" in eadp("profile", *files).out
    assert "fps=1: 6 W" in eadp("profile", *files, "--trim", "3").out
    (tmp_path / "a.log").write_text("time_s,power_w\n" + "".join(f"{i},{each / 1000}\n" for i, each in enumerate(rows)))
    assert "fps=1: 9 W" in eadp("profile", *files, "--trim", "3").out


def test_parameters_are_named_or_asked_for(eadp, tmp_path):
    table = tmp_path / "results.csv"
    table.write_text("model,fps,keysize,POM_5V_IN (mW),POM_5V_GPU (mW)\n" + "yolo,2,32,5000,900\nyolo,4,32,6000,900\n")
    answer = eadp("profile", table)
    assert refused(answer, "3 columns beside the power: model, fps, keysize; expected", "--of fps,keysize")
    assert "fps=3: 5.5 W" in eadp("profile", table, "--of", "fps", "--at", "fps=3").out
    table.write_text("fps,POM_5V_IN,POM_5V_GPU\n2,5000,900\n4,6000,950\n")
    assert "fps=3: 5.5 W" in eadp("profile", table, "--at", "fps=3").out
    table.write_text("fps,power\n2,5000\n4,6000\n")
    assert eadp("profile", table).code == 2  # in W, or in mW

"""Power sensors in a made-up sysfs: found, named, chosen and read."""

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.measure.power_sensor import Meter, Sensor, choose_sensor, find_sensors

Tree = Callable[[dict[str, object]], str]

ZONE = "class/powercap/intel-rapl"
RAPL = {
    "class/powercap/intel-rapl/enabled": 1,
    "class/powercap/intel-rapl:0/name": "package-0",
    "class/powercap/intel-rapl:0/energy_uj": 1_000_000,
    "class/powercap/intel-rapl:0/max_energy_range_uj": 5_000_000,
    "class/powercap/intel-rapl:0:0/name": "core",
    "class/powercap/intel-rapl:0:0/energy_uj": 400_000,
    "class/powercap/intel-rapl:0:0/max_energy_range_uj": 5_000_000,
}
JETSON = {
    "class/hwmon/hwmon3/name": "ina3221", "class/hwmon/hwmon3/in1_input": 5000, "class/hwmon/hwmon3/curr1_input": 1200,
    "class/hwmon/hwmon3/in1_label": "VDD_IN", "class/hwmon/hwmon3/in2_input": 4900,
    "class/hwmon/hwmon3/curr2_input": 300, "class/hwmon/hwmon3/in2_label": "VDD_CPU",
    "class/hwmon/hwmon3/in7_input": 4900,
}  # fmt: skip
CHIP = {"class/hwmon/hwmon1/name": "amdgpu", "class/hwmon/hwmon1/power1_average": 7_250_000}
CELL = {
    "class/power_supply/BAT0/type": "Battery",
    "class/power_supply/BAT0/voltage_now": 12_000_000,
    "class/power_supply/BAT0/current_now": -2_500_000,
    "class/power_supply/AC/type": "Mains",
    "class/power_supply/AC/online": 1,
}


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    """Write files under a root, by their paths, and return the root."""

    def write(files: dict[str, object]) -> str:
        for name, content in files.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(f"{content}\n", encoding="utf-8")
        return str(tmp_path)

    return write


def still() -> float:
    return 0.0


def fault_of(root: str, wanted: str = "") -> list[str]:
    with pytest.raises(InputError) as caught:
        choose_sensor(root, wanted)
    return [line.strip() for line in str(caught.value).splitlines()]


def test_all_kinds_are_found_in_their_order(tree: Tree) -> None:
    root = tree({**RAPL, **CELL, **CHIP, **JETSON})
    assert [sensor.label for sensor in find_sensors(root)] == [
        "ina3221:ina3221/VDD_IN", "ina3221:ina3221/VDD_CPU", "hwmon:amdgpu/power1", "powercap:package-0",
        "powercap:core", "power_supply:BAT0",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("files", "label"),
    [
        ({**RAPL, **JETSON}, "ina3221:ina3221/VDD_IN"),
        ({**RAPL, **CHIP}, "hwmon:amdgpu/power1"),
        ({**RAPL, "class/powercap/intel-rapl-mmio:0/energy_uj": 1}, "powercap:package-0"),
        ({**RAPL, "class/powercap/intel-rapl:1/name": "psys", f"{ZONE}:1/energy_uj": 1}, "powercap:psys"),
        ({**CELL, "class/hwmon/hwmon0/name": "x", "class/hwmon/hwmon0/power1_input": "ENODATA"}, "power_supply:BAT0"),
    ],
)
def test_the_whole_of_the_first_kind_is_chosen(tree: Tree, files: dict[str, object], label: str) -> None:
    assert choose_sensor(tree(files)).label == label


def test_the_sum_of_an_ina3221_is_no_rail(tree: Tree) -> None:
    """The kernel shows the sum of the currents as curr4, and as in4 the voltage of a shunt [µV]."""
    rail = {"name": "ina3221", "in2_input": 5000, "curr2_input": 1200, "in4_input": 2416, "curr4_input": 1200}
    root = tree({f"class/hwmon/hwmon3/{name}": value for name, value in rail.items()})
    assert [sensor.label for sensor in find_sensors(root)] == ["ina3221:ina3221/channel2"]
    assert Meter(choose_sensor(root), still).power_w() == pytest.approx(6.0)


@pytest.mark.parametrize("wanted", ["powercap:core", f"{ZONE}:0:0", f"{ZONE}:0:0/energy_uj", f"{{root}}/{ZONE}:0:0"])
def test_a_sensor_by_name_or_path(tree: Tree, wanted: str) -> None:
    root = tree({**RAPL, **JETSON})
    assert choose_sensor(root, wanted.format(root=root)).label == "powercap:core"


def test_what_was_found_is_listed(tree: Tree) -> None:
    second = {name.replace("hwmon3", "hwmon10"): value for name, value in JETSON.items()}
    root = tree({**JETSON, **second, **CELL})
    listed = [
        "ina3221:ina3221/VDD_IN at class/hwmon/hwmon3/in1_input",
        "ina3221:ina3221/VDD_CPU at class/hwmon/hwmon3/in2_input",
        "ina3221:ina3221/VDD_IN at class/hwmon/hwmon10/in1_input",
        "ina3221:ina3221/VDD_CPU at class/hwmon/hwmon10/in2_input",
        "power_supply:BAT0 at class/power_supply/BAT0",
    ]
    head, *rest = fault_of(root)
    assert head == "--sensor:1:1: error: several sensors of the kind ina3221; expected one of these by name or path:"
    assert rest == listed
    assert fault_of(root, "ina3221:ina3221/VDD_IN")[0].startswith("--sensor:1:1: error: 2 sensors have this name;")
    assert fault_of(root, "powercap:core")[0].startswith("--sensor:1:1: error: no such sensor;")
    assert choose_sensor(root, "class/hwmon/hwmon10/in1_input").path.parent.name == "hwmon10"


def test_no_sensor_and_no_root(tree: Tree, tmp_path: Path) -> None:
    assert fault_of(tree({"class/hwmon/hwmon0/name": "coretemp", "class/hwmon/hwmon0/temp1_input": 40000})) == [
        "--sysfs:1:1: error: no power sensor that this user can read; expected one of ina3221, hwmon, powercap, "
        f"power_supply under {tmp_path}"
    ]
    assert "is no folder" in fault_of(str(tmp_path / "nowhere"))[0]


def test_a_sensor_that_cannot_be_read_is_told(tree: Tree) -> None:
    root = tree({**RAPL, "class/powercap/intel-rapl:0/energy_uj": "", "class/powercap/intel-rapl:0:0/energy_uj": ""})
    head, *rest = fault_of(root)
    assert head.startswith("--sysfs:1:1: error: no power sensor that this user can read; expected one of these")
    assert rest[0] == "powercap:package-0 at class/powercap/intel-rapl:0 (not readable by this user)"


@pytest.mark.parametrize(
    ("files", "power_w"),
    [(JETSON, 6.0), (CHIP, 7.25), (CELL, 30.0), ({"class/power_supply/BAT1/power_now": 9_500_000}, 9.5)],
)
def test_powers(tree: Tree, files: dict[str, object], power_w: float) -> None:
    meter = Meter(choose_sensor(tree(files)), still)
    meter.start()
    assert meter.power_w() == pytest.approx(power_w)


@given(st.integers(1_000, 10**12), st.lists(st.tuples(st.floats(0.05, 5), st.floats(0, 1)), min_size=1, max_size=20))
def test_a_counter_gives_back_the_energy_that_went_in(
    tmp_path_factory: pytest.TempPathFactory, largest: int, steps: list
) -> None:
    # the energy of each step is below the range, else nobody could tell how often it began again
    folder = tmp_path_factory.mktemp("zone")
    energy, limit = folder / "energy_uj", folder / "max_energy_range_uj"
    limit.write_text(str(largest), encoding="ascii")
    energy.write_text("0", encoding="ascii")
    now_s, total = 0.0, 0
    meter = Meter(Sensor("powercap", "x", folder, (energy,), 1e-6, limit), lambda: now_s)
    meter.start()
    for duration_s, share in steps:
        step = int(share * (largest - 1))
        total += step
        now_s += duration_s
        energy.write_text(str(total % largest), encoding="ascii")
        assert meter.power_w() * duration_s == pytest.approx(step * 1e-6, rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("content", ["", "1.5", "9" * 40])
def test_what_is_no_reading(tree: Tree, content: str) -> None:
    root = tree(CHIP)
    meter = Meter(choose_sensor(root), still)
    tree({"class/hwmon/hwmon1/power1_average": content})
    with pytest.raises(InputError, match="expected a whole number"):
        meter.power_w()
    (Path(root) / "class/hwmon/hwmon1/power1_average").unlink()
    with pytest.raises(InputError, match=r"power1_average:1:1: error: cannot be read"):
        meter.power_w()

"""Bags of ROS 1 and 2, written by rosbags itself, and read as logs."""

import warnings
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags are read by rosbags: pip install 'eadp[ros]'")

from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from eadp.cli.main import main
from eadp.errors import InputError
from eadp.measure.formats import read_power_log
from eadp.measure.power_log import Columns, PowerLog

BATTERY, FIX, TEXT = "sensor_msgs/msg/BatteryState", "sensor_msgs/msg/NavSatFix", "std_msgs/msg/String"
NAMES = {"ROS 1": "flight.bag", "SQLite": "flight", "MCAP": "flight"}
FORMS = [*NAMES]
SECONDS, VOLTS = np.arange(0.0, 90.0, 0.5), 12.0
AMPS = 3.0 + np.sin(2 * np.pi * SECONDS / 20)
STAMP_S = 1_700_000_000


def bag(path: Path, form: str, topics: dict[str, str], current: float = -1.0, stamp_s: int = STAMP_S) -> str:
    """A bag with messages of each topic, of a kind; the batteries' currents are multiples of `AMPS`."""
    store = get_typestore(Stores.ROS1_NOETIC if form == "ROS 1" else Stores.ROS2_HUMBLE)
    kinds = store.types
    plugin = StoragePlugin.MCAP if form == "MCAP" else StoragePlugin.SQLITE3
    writer = rosbag1.Writer(path) if form == "ROS 1" else rosbag2.Writer(path, version=9, storage_plugin=plugin)

    def message(kind: str, k: int, factor: float) -> object:
        if kind == TEXT:
            return kinds[kind](data="x")
        time = kinds["builtin_interfaces/msg/Time"]
        stamp = time(stamp_s + int(SECONDS[k]), int(SECONDS[k] % 1 * 1e9)) if stamp_s else time(0, 0)
        header = kinds["std_msgs/msg/Header"](**({"seq": k} if form == "ROS 1" else {}), stamp=stamp, frame_id="")
        status = kinds["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        given = {
            "header": header, "voltage": VOLTS, "current": factor * AMPS[k], "percentage": 0.5, "present": True,
            "status": status, "latitude": 55.4 + 1e-5 * k, "longitude": 10.4, "altitude": 70.0,
            "position_covariance": np.zeros(9), "position_covariance_type": 0,
        }  # fmt: skip
        empty = {"cell": np.zeros(0, np.float32), "serial": "", "location": "", "power": 0, "temperature": 0.0}
        names = kinds[kind].__dataclass_fields__
        known = {name: given.get(name, empty.get(name.split("_")[0], 0.0)) for name in names if name != "__msgtype__"}
        return kinds[kind](**known)

    with warnings.catch_warnings(action="ignore"), writer:
        opened = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}
        serialize = store.serialize_ros1 if form == "ROS 1" else store.serialize_cdr
        for k, second in enumerate(SECONDS):
            for i, (topic, kind) in enumerate(topics.items()):
                raw = serialize(message(kind, k, current * (1 + i)), kind)
                writer.write(opened[topic], int((STAMP_S + second) * 1e9), raw)
    return str(path)


def read(path: str, **columns: object) -> PowerLog:
    """The log of a bag."""
    return read_power_log(path, Columns(**columns))


@pytest.mark.parametrize(("form", "stamp_s"), [*((form, STAMP_S) for form in FORMS), ("MCAP", 0)])
def test_a_bag_is_a_power_log(tmp_path: Path, form: str, stamp_s: int) -> None:
    """Times are the messages' stamps, and where they have none those of the recording."""
    topics = {"/text": TEXT, "/mavros/battery": BATTERY, "/mavros/fix": FIX}
    log = read(bag(tmp_path / NAMES[form], form, topics, current=-0.5, stamp_s=stamp_s))
    assert log.times_s == pytest.approx(SECONDS)
    assert log.power_w == pytest.approx(VOLTS * AMPS)
    assert not log.warnings


@pytest.mark.parametrize("form", FORMS[1:])
def test_one_file_of_a_folder_is_a_bag(tmp_path: Path, form: str) -> None:
    bag(tmp_path / "flight", form, {"/battery": BATTERY})
    (file,) = (each for each in (tmp_path / "flight").iterdir() if each.suffix != ".yaml")
    assert read(str(file)).power_w == pytest.approx(VOLTS * AMPS)


def test_a_current_above_0_is_a_discharge(tmp_path: Path) -> None:
    log = read(bag(tmp_path / "flight.bag", "ROS 1", {"/battery": BATTERY}, current=1.0))
    assert log.power_w == pytest.approx(VOLTS * AMPS)
    assert ["against BatteryState's definition" in fault.message for fault in log.warnings] == [True]


def test_of_two_batteries_it_asks_which(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bag(tmp_path / "flight.bag", "ROS 1", {"/front/battery": BATTERY, "/back/battery": BATTERY})
    assert main(["fit", path]) == 2
    said = capsys.readouterr().err
    assert "--instance:1:1: error: 2 batteries in" in said
    assert "expected one of 0 is /back/battery, 1 is /front/battery" in said
    assert read(path, instance=1).power_w == pytest.approx(VOLTS * AMPS)
    with pytest.raises(InputError, match="no battery 2"):
        read(path, instance=2)


def test_a_bag_without_a_battery_names_its_topics(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", bag(tmp_path / "flight", "MCAP", {"/chatter": TEXT, "/fix": FIX})]) == 2
    said = capsys.readouterr().err
    assert f"has no messages of sensor_msgs/BatteryState; its topics: /chatter ({TEXT}), /fix ({FIX})" in said


@pytest.mark.quick(1)
@pytest.mark.parametrize("form", FORMS)
def test_a_broken_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], form: str) -> None:
    whole = Path(bag(tmp_path / NAMES[form], form, {"/battery": BATTERY}))
    (file,) = [whole] if whole.is_file() else (each for each in whole.iterdir() if each.suffix != ".yaml")
    data = file.read_bytes()
    rng = np.random.default_rng(0)
    start = len(b"#ROSBAG V2.0\n")
    damaged = [data[: len(data) // 2], data[:start] + bytes(rng.integers(0, 256, 4000, dtype=np.uint8))]
    for part in damaged:
        file.write_bytes(part)
        assert main(["fit", str(whole)]) == 2
        assert "cannot be read by rosbags" in capsys.readouterr().err


def test_a_folder_that_is_no_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_without_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path / "flight.bag", "ROS 1", {"/battery": BATTERY})
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"rosbags, .* is missing; expected pip install 'eadp\[ros\]'"):
        read(path)

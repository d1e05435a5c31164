"""Autopilots' logs, made byte by byte here, as pyulog and pymavlink read them in a process with limits."""

import importlib.util
import os
import random
import struct
import threading
from pathlib import Path

import numpy as np
import pytest
from common import few

from eadp.errors import InputError
from eadp.measure import autopilot_logs as messages
from eadp.measure.battery import BatteryOptions, read_battery_fit
from eadp.measure.formats import is_dataflash_text, read_power_log
from eadp.measure.power_log import Columns, PowerLog

pytest.importorskip("pyulog")
pytest.importorskip("pymavlink")

N = 40


# a ULog


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


STATUS = (
    "battery_status:uint64_t timestamp;float voltage_v;float current_a;float current_average_a;"
    "float[3] voltage_cell_v;cell cells;uint8_t id;uint8_t[3] _padding0;"
)


def ulog(instances: int = 1, unknown: tuple[int, ...] = (), current: float = 2.0, status: str = STATUS) -> bytes:
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)]
    parts.append(message("B", bytes(40)))
    parts.append(message("F", b"cell:float volt;uint16_t[2] id;"))
    parts.append(message("F", status.encode()))
    position = b"vehicle_local_position:uint64_t timestamp;float x;float y;bool ok;uint8_t[7] _padding0;"
    parts.append(message("F", position))
    parts.append(message("I", struct.pack("<B", 13) + b"char[5] sys_name" + b"PX4!!"))
    for instance in range(instances):
        parts.append(message("A", struct.pack("<BH", instance, 3 + instance) + b"battery_status"))
    parts.append(message("A", struct.pack("<BH", 0, 9) + b"vehicle_local_position"))
    for i in range(N):
        time_us = 5_000_000 + 300_000 * i
        for instance in range(instances):
            amps = -1.0 if i in unknown else current * (instance + 1)
            row = struct.pack("<Qfff3ff2HB", time_us, 15.0 + i / 8, amps, current, 1, 2, 3, 4, 5, 6, instance)
            parts.append(message("D", struct.pack("<H", 3 + instance) + row))
        if i % 2 == 0:
            parts.append(message("D", struct.pack("<H", 9) + struct.pack("<QffB", time_us, 10.0 * i, -i, 1)))
        parts.append(message("L", struct.pack("<BQ", 54, time_us) + b"hello"))
    return b"".join(parts)


def stored(tmp_path: Path, name: str, data: bytes | str) -> str:
    file = tmp_path / name
    file.write_bytes(data.encode() if isinstance(data, str) else data)
    return str(file)


def assert_read(log: PowerLog, n: int = N, factor: float = 2.0) -> None:
    np.testing.assert_allclose(log.times_s, 0.3 * np.arange(n), atol=1e-9)
    np.testing.assert_allclose(log.power_w, factor * (15 + np.arange(n) / 8))
    assert log.voltage_v is not None
    np.testing.assert_allclose(log.voltage_v, 15 + np.arange(n) / 8)


@pytest.mark.usefixtures("process")
def test_ulog(tmp_path: Path) -> None:
    log = read_power_log(stored(tmp_path, "flight.ulg", ulog()))
    assert_read(log)
    assert (log.warnings, log.counts) == ([], {"rows": N})


def test_ulog_with_a_signalling_nan(tmp_path: Path) -> None:
    data = ulog().replace(struct.pack("<f", 15.0 + 1 / 8), b"\x01\x00\x80\x7f", 1)
    assert len(read_power_log(stored(tmp_path, "flight.ulg", data)).times_s) == N - 1


def test_ulog_of_several_batteries(tmp_path: Path) -> None:
    file = stored(tmp_path, "flight.ulg", ulog(instances=2))
    log = read_power_log(file)
    assert_read(log)
    assert [fault.message for fault in log.warnings] == ["battery 0 of several is read; --instance takes another: 1"]
    assert_read(read_power_log(file, Columns(instance=1)), factor=4.0)
    with pytest.raises(InputError, match=r"--instance:1:1: error: no battery 7 in .*; expected 0, 1"):
        read_power_log(file, Columns(instance=7))


def test_ulog_readings_that_are_unknown(tmp_path: Path) -> None:
    log = read_power_log(stored(tmp_path, "flight.ulg", ulog(unknown=(N - 1, N - 2))))
    assert_read(log, N - 2)
    assert log.counts == {"rows": N, "unknown": 2}
    assert str(log.warnings[0]).endswith("2 rows with an unknown voltage (0 or -1) or current (-1) left out")
    # a whole column of unknown: a mean that the autopilot makes up of it is no reading
    with pytest.raises(InputError, match="no current is measured: it is -1 or 0 throughout"):
        read_power_log(stored(tmp_path, "other.ulg", ulog(unknown=tuple(range(N)))))


def test_an_autopilots_log_has_no_columns(tmp_path: Path) -> None:
    file = stored(tmp_path, "flight.ulg", ulog())
    for option, given in (("power", ["power_w"]), ("voltage", "volts")):
        with pytest.raises(InputError, match=f"--{option}:1:1: error: an autopilot's log has no such columns"):
            read_power_log(file, Columns(**{option: given}))


@pytest.mark.parametrize("lost", [1, 5, 30])
def test_ulog_cut_off(tmp_path: Path, lost: int) -> None:
    assert len(read_power_log(stored(tmp_path, "flight.ulg", ulog()[:-lost])).times_s) >= N - 1


HEAD = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1)


def nested(depth: int, times: int) -> bytes:
    parts = [f"level{i}:level{i + 1}[{times}] a;level{i + 1}[{times}] b;" for i in range(depth)]
    parts += [f"level{depth}:uint8_t x;", "battery_status:uint64_t timestamp;float voltage_v;level0 a;"]
    subscription = message("A", struct.pack("<BH", 0, 3) + b"battery_status")
    return HEAD + b"".join(message("F", part.encode()) for part in parts) + subscription


@pytest.mark.usefixtures("process")
@pytest.mark.parametrize(
    ("data", "said"),
    [
        (nested(10, 60), "level0 has 619173642240000000000 fields; at most 10000 are read"),
        (nested(0, 1).replace(b"uint8_t x", b"level0 xy"), "RecursionError"),
        (b"ULog", "Invalid file format"),
    ],
)
def test_ulog_that_declares_what_no_log_has(tmp_path: Path, data: bytes, said: str) -> None:
    with pytest.raises(InputError, match=f"cannot be read by pyulog: .*{said}.*; expected a PX4 ULog"):
        read_power_log(stored(tmp_path, "flight.ulg", data))


def test_ulog_messages_shorter_than_declared_are_left_out(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no messages of a battery"):
        read_power_log(stored(tmp_path, "flight.ulg", ulog(status=f"{STATUS}uint8_t[9000] b;")))


# a DataFlash log

FORMATS = {
    # type, name, format, columns
    0x80: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    0x81: ("BAT", "QBfffhc", "TimeUS,Instance,Volt,Curr,CurrTot,Temp,Res"),
    0x82: ("POS", "QLLf", "TimeUS,Lat,Lng,Alt"),
    0x83: ("MSG", "QZ", "TimeUS,Message"),
}
CODES = {"Q": "Q", "B": "B", "f": "f", "h": "h", "c": "h", "L": "i", "Z": "64s", "n": "4s", "N": "16s"}


def size(form: str) -> int:
    return 3 + struct.calcsize("<" + "".join(CODES[c] for c in form))


def row(number: int, *values: object) -> bytes:
    form = FORMATS[number][1]
    return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(CODES[c] for c in form), *values)


def dataflash(instances: int = 1) -> bytes:
    parts = [row(0x80, n, size(f), name.encode(), f.encode(), c.encode()) for n, (name, f, c) in FORMATS.items()]
    for i in range(N):
        time_us = 5_000_000 + 300_000 * i
        for instance in range(instances):
            parts.append(row(0x81, time_us, instance, 15 + i / 8, 2.0 * (instance + 1), 0, 30, 250))
        parts.append(row(0x82, time_us, 553_700_000 + 1000 * i, 104_300_000, 25.0))
        parts.append(row(0x83, time_us, b"hello"))
    return b"".join(parts)


@pytest.mark.usefixtures("process")
def test_dataflash(tmp_path: Path) -> None:
    log = read_power_log(stored(tmp_path, "flight.bin", dataflash()))
    assert_read(log)
    both = read_power_log(stored(tmp_path, "both.bin", dataflash(instances=2)), Columns(instance=1))
    assert_read(both, factor=4.0)


def test_dataflash_with_bytes_that_are_no_message(tmp_path: Path) -> None:
    data = dataflash()
    place = data.index(b"\xa3\x95\x82", 400)
    log = read_power_log(stored(tmp_path, "flight.bin", data[:place] + b"rubbish" + data[place:]))
    assert len(log.times_s) == N
    assert [fault.message for fault in log.warnings] == ["7 bytes that are no message skipped"]
    assert len(read_power_log(stored(tmp_path, "cut.bin", data[:-4])).times_s) == N


def test_dataflash_fields_that_are_no_numbers_and_that_are_scaled(tmp_path: Path) -> None:
    tables = messages.read_tables("f", stored(tmp_path, "flight.bin", dataflash()), "dataflash", ["BAT", "MSG"])
    battery = tables.columns["BAT"]
    assert (battery["Res"][0], battery["Temp"][0], len(battery["Volt"])) == (2.5, 30, N)
    assert np.isnan(tables.columns["MSG"]["Message"]).all()


@pytest.mark.usefixtures("process")
@pytest.mark.parametrize("length", [0, 5])
def test_dataflash_messages_of_another_length_than_declared(tmp_path: Path, length: int) -> None:
    head = b"".join(row(0x80, n, length, name.encode(), f.encode(), b"A") for n, (name, f, _) in FORMATS.items())
    with pytest.raises(InputError, match=r"cannot be read by pymavlink|no messages of a battery"):
        read_power_log(stored(tmp_path, "flight.bin", head + 100 * b"\xa3\x95\x81ab"))


def text_log(kind: str = "BAT", labels: str = "TimeUS,Instance,Volt,Curr,CurrTot", lead: str = "0, ") -> str:
    head = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        f"FMT, 129, 30, {kind}, {'QBfff'[-len(labels.split(',')) :]}, {labels}",
        "FMT, 131, 75, MSG, QZ, TimeUS,Message",
        "MSG, 4000000, ArduPlane V4.5",
    ]
    scale = 1 if "TimeUS" in labels else 1000
    body = [f"{kind}, {(5_000_000 + 300_000 * i) // scale}, {lead}{15 + i / 8}, 2, 0.5" for i in range(N)]
    return "\n".join([*head, *body, f"{kind}, 1, 2", ""])


def test_dataflash_text(tmp_path: Path) -> None:
    log = read_power_log(stored(tmp_path, "flight.log", text_log().replace("\n", "\r\n")))
    assert_read(log)
    assert log.warnings == []  # the line that is too short is skipped


def test_dataflash_of_whole_numbers_is_in_hundredths(tmp_path: Path) -> None:
    body = text_log("CURR", "TimeMS,Volt,Curr,CurrTot", lead="").replace("Bfff", "Ihhf").replace("Qfff", "Ihhf")
    lines = [line.split(", ") for line in body.splitlines()]
    for line in lines:
        if line[0] == "CURR" and len(line) > 4:
            line[2:4] = (f"{float(value) * 100:.0f}" for value in line[2:4])
    old = "\n".join(map(", ".join, lines)).replace("QBfff", "Ihhf")
    log = read_power_log(stored(tmp_path, "flight.log", f"{old}\n"))
    np.testing.assert_allclose(log.power_w, [2 * (15 + i / 8) for i in range(N)], rtol=1e-3)


def test_dataflash_text_is_told_from_a_table() -> None:
    assert is_dataflash_text(text_log().encode())
    assert not is_dataflash_text(b"time_s,power_w\n1,2\n")
    assert not is_dataflash_text(b"FMT,power_w\n1,2\n")


@pytest.mark.parametrize("data", [b"ULog\x01\x12\x35\x01\xff", HEAD, b"\xa3\x95\x80"])
def test_a_pipe_is_refused_with_what_to_do(tmp_path: Path, data: bytes) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(data,))
    writer.start()
    with pytest.raises(InputError, match="a ULog or a binary DataFlash log as a file"):
        read_power_log(str(pipe))
    writer.join()


def test_no_battery_and_no_time(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no messages of a battery; expected battery_status, BAT or CURR"):
        read_power_log(stored(tmp_path, "f.log", text_log("XYZ")))
    with pytest.raises(InputError, match="messages of the battery have no time"):
        read_power_log(stored(tmp_path, "f.log", text_log(labels="When,Instance,Volt,Curr,CurrTot")))


@pytest.mark.usefixtures("process")
@pytest.mark.parametrize("seed", few(range(3), 1))
def test_damaged_logs_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    random_ = random.Random(seed)
    for name, data in (("f.ulg", bytearray(ulog())), ("f.bin", bytearray(dataflash()))):
        for _ in range(10):
            data[random_.randrange(4, len(data))] = random_.randrange(256)
        try:
            read_power_log(stored(tmp_path, name, bytes(data)))
        except InputError:
            continue


@pytest.mark.usefixtures("process")
def test_memory_and_time_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Path(messages.__file__).with_name("autopilot_process.py").read_text(encoding="utf-8")

    def changed(*changes: tuple[str, str]) -> None:
        text = source
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        monkeypatch.setattr(messages, "_PROCESS", Path(stored(tmp_path, "process.py", text)))

    file = stored(tmp_path, "flight.ulg", ulog())
    changed(("400_000_000", "20_000_000"))
    with pytest.raises(InputError, match="cannot be read by pyulog"):
        read_power_log(file)
    endless = "    while True:\n        pass\n    from pyulog"
    changed(("CPU_S, BYTES_PER_S = 10", "CPU_S, BYTES_PER_S = 1"), ("    from pyulog", endless))
    with pytest.raises(InputError, match="more memory or time than a log of its size"):
        read_power_log(file)


def test_without_the_libraries(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for name, data in (("f.ulg", ulog()), ("f.bin", dataflash()), ("f.log", text_log())):
        with pytest.raises(InputError, match=r"is missing; expected pip install 'eadp\[logs\]'"):
            read_power_log(stored(tmp_path, name, data))


def test_what_the_autopilot_says_of_its_battery(tmp_path: Path) -> None:
    lines = text_log(labels="TimeUS,Instance,Volt,Curr,CurrTot").replace(", 2, 0.5", ", 2, 1790").splitlines()
    head = ["FMT, 132, 31, PARM, QNff, TimeUS,Name,Value,Default", "PARM, 1, BATT_CAPACITY, 3300, 0"]
    log = read_power_log(stored(tmp_path, "flight.log", "\n".join([*lines[:3], *head, *lines[3:]]) + "\n"))
    assert log.battery == {"capacity_ah": 3.3, "used_ah": 1.79, "counted_ah": 0.0}
    path = tmp_path / "flight.log"
    found = read_battery_fit(str(path), Columns(), BatteryOptions(capacity_ah=3.3))
    assert found.fit.charge_from == pytest.approx(1 - 1.79 / 3.3)
    assert "1.79 Ah were used before" in str(found.warnings[0])
    assert found.fit.notes[-1] == "the autopilot's parameters state a capacity of 3.3 Ah"
    assert read_battery_fit(str(path), Columns(), BatteryOptions(capacity_ah=3.3, soc=0.9)).fit.charge_from == 0.9

"""Autopilots' logs, made byte by byte here; pyulog and pymavlink, where installed, read the same from them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.io.log.autopilot_battery import battery_table
from eadp.io.log.dataflash import KINDS as DATAFLASH_KINDS
from eadp.io.log.dataflash import is_dataflash_text, read_dataflash, read_dataflash_text
from eadp.io.log.formats import read_power_log
from eadp.io.log.power_log import Columns, PowerLog
from eadp.io.log.ulog import KINDS as ULOG_KINDS
from eadp.io.log.ulog import read_ulog

N = 40
unhurried = settings(deadline=None, max_examples=60)  # no test depends on the clock


# a ULog


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


STATUS = (
    "battery_status:uint64_t timestamp;float voltage_v;float current_a;float current_average_a;"
    "float[3] voltage_cell_v;cell cells;uint8_t id;uint8_t[3] _padding0;"
)


def ulog(instances: int = 1, unknown: tuple[int, ...] = (), current: float = 2.0) -> bytes:
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)]
    parts.append(message("B", bytes(40)))
    parts.append(message("F", b"cell:float volt;uint16_t[2] id;"))
    parts.append(message("F", STATUS.encode()))
    parts.append(
        message("F", b"vehicle_local_position:uint64_t timestamp;float x;float y;bool ok;uint8_t[7] _padding0;")
    )
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


def test_ulog(tmp_path: Path) -> None:
    log = read_power_log(stored(tmp_path, "flight.ulg", ulog()))
    assert_read(log)
    assert (log.warnings, log.counts) == ([], {"rows": N})
    assert log.position_m is not None
    # PX4's x is north, its y east
    np.testing.assert_allclose(log.position_m[3], [-3, 30])


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
    assert str(log.warnings[0]).endswith("2 rows with an unknown voltage or current (0 or -1) left out")
    # a whole column of unknown: the next name is taken
    assert_read(read_power_log(stored(tmp_path, "other.ulg", ulog(unknown=tuple(range(N))))))


def test_ulog_fields_by_name(tmp_path: Path) -> None:
    file = stored(tmp_path, "flight.ulg", ulog(instances=2))
    assert_read(read_power_log(file, Columns(current="current_average_a", instance=1)))
    with pytest.raises(InputError, match="--voltage:1:1: error: no field volts; expected one of timestamp, voltage_v"):
        read_power_log(file, Columns(voltage="volts"))
    with pytest.raises(InputError, match="--power:1:1: error: an autopilot's log has no such columns"):
        read_power_log(file, Columns(power="power_w"))


@pytest.mark.parametrize("lost", [1, 5, 30])
def test_ulog_cut_off(tmp_path: Path, lost: int) -> None:
    log = read_power_log(stored(tmp_path, "flight.ulg", ulog()[:-lost]))
    assert len(log.times_s) >= N - 1
    assert [fault.message for fault in log.warnings] == ["the log ends in the middle of a message"]


def test_ulog_as_pyulog_reads_it(tmp_path: Path) -> None:
    pyulog = pytest.importorskip("pyulog")
    data = ulog(instances=2)
    theirs = pyulog.ULog(stored(tmp_path, "flight.ulg", data))
    ours = read_ulog("flight.ulg", data, ULOG_KINDS).columns
    assert len(theirs.data_list) == len(ours) == 3
    for dataset in theirs.data_list:
        table = ours[f"{dataset.name} {dataset.multi_id}"]
        for label, values in table.items():
            np.testing.assert_array_equal(values, dataset.data[label].astype(float))


@pytest.mark.parametrize(
    ("old", "new", "message_"),
    [
        (b"float voltage_v", b"fl@at voltage_v", "the format of battery_status cannot be read"),
        (b"cell cells", b"sell cells", "the type sell is not described"),
    ],
)
def test_ulog_that_describes_itself_badly(tmp_path: Path, old: bytes, new: bytes, message_: str) -> None:
    with pytest.raises(InputError, match=message_):
        read_power_log(stored(tmp_path, "flight.ulg", ulog().replace(old, new, 1)))


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


def test_dataflash(tmp_path: Path) -> None:
    log = read_power_log(stored(tmp_path, "flight.bin", dataflash()))
    assert_read(log)
    assert log.position_m is not None
    # 1e-4 degrees of latitude a reading, of 111.3 km each
    np.testing.assert_allclose(log.position_m[10], [0, 10 * 11.134], atol=0.1)
    both = read_power_log(stored(tmp_path, "both.bin", dataflash(instances=2)), Columns(instance=1))
    assert_read(both, factor=4.0)


def test_dataflash_with_bytes_that_are_no_message(tmp_path: Path) -> None:
    data = dataflash()
    place = data.index(b"\xa3\x95\x82", 400)
    log = read_power_log(stored(tmp_path, "flight.bin", data[:place] + b"rubbish" + data[place:-4]))
    assert len(log.times_s) == N
    assert [fault.message for fault in log.warnings] == [
        "the log ends in the middle of a message",
        "7 bytes that are no message skipped",
    ]


def test_dataflash_values_are_scaled_as_the_format_says() -> None:
    table = read_dataflash("flight.bin", dataflash(), DATAFLASH_KINDS).columns["BAT"]
    assert table["Res"][0] == 2.5
    assert table["Temp"][0] == 30


def test_dataflash_as_pymavlink_reads_it(tmp_path: Path) -> None:
    reader = pytest.importorskip("pymavlink.DFReader")
    data = dataflash(instances=2)
    theirs = reader.DFReader_binary(stored(tmp_path, "flight.bin", data))
    ours = read_dataflash("flight.bin", data, DATAFLASH_KINDS).columns
    seen = {"BAT": 0, "POS": 0}
    while (found := theirs.recv_msg()) is not None:
        if found.get_type() in seen:
            i = seen[found.get_type()]
            seen[found.get_type()] += 1
            for label, values in ours[found.get_type()].items():
                assert values[i] == pytest.approx(getattr(found, label), abs=1e-9)
    theirs.filehandle.close()
    assert seen == {"BAT": 2 * N, "POS": N}


def text_log(kind: str = "BAT", labels: str = "TimeUS,Instance,Volt,Curr,CurrTot", lead: str = "0, ") -> str:
    head = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        f"FMT, 129, 30, {kind}, QBfff, {labels}",
        "FMT, 131, 75, MSG, QZ, TimeUS,Message",
        "MSG, 4000000, ArduPlane V4.5",
    ]
    scale = 1 if "TimeUS" in labels else 1000
    body = [f"{kind}, {(5_000_000 + 300_000 * i) // scale}, {lead}{15 + i / 8}, 2, 0.5" for i in range(N)]
    return "\n".join([*head, *body, f"{kind}, 1, 2", ""])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_dataflash_text(tmp_path: Path, end: str) -> None:
    log = read_power_log(stored(tmp_path, "flight.log", text_log().replace("\n", end)))
    assert_read(log)
    assert [fault.message for fault in log.warnings] == ["10 bytes that are no message skipped"]


def test_dataflash_of_older_versions(tmp_path: Path) -> None:
    body = text_log("CURR", "TimeMS,Volt,Curr,CurrTot", lead="")
    assert_read(read_power_log(stored(tmp_path, "flight.log", body)))


def test_dataflash_text_is_told_from_a_table() -> None:
    assert is_dataflash_text(text_log().encode())
    assert not is_dataflash_text(b"time_s,power_w\n1,2\n")
    assert not is_dataflash_text(b"FMT,power_w\n1,2\n")


def test_no_battery_and_no_time() -> None:
    tables = read_dataflash_text("f.log", text_log("XYZ"), DATAFLASH_KINDS)
    with pytest.raises(InputError, match="no messages of a battery; expected battery_status, BAT or CURR"):
        battery_table("f.log", tables)
    tables = read_dataflash_text("f.log", text_log(labels="When,Instance,Volt,Curr,CurrTot"), DATAFLASH_KINDS)
    with pytest.raises(InputError, match="messages of the battery have no time"):
        battery_table("f.log", tables)


@unhurried
@given(st.integers(0, 2000), st.binary(max_size=60))
def test_damaged_logs_are_read_or_refused(place: int, rubbish: bytes) -> None:
    for read, data, kinds in ((read_ulog, ulog(), ULOG_KINDS), (read_dataflash, dataflash(), DATAFLASH_KINDS)):
        damaged = data[:place] + rubbish + data[place + len(rubbish) :]
        try:
            battery_table("f", read("f", damaged, kinds))
        except InputError:
            continue

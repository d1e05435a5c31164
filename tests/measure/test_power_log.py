"""Power logs: what is read, what is left out with a warning, what is refused and where."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from common.answers import faults_by, first_lines
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import FAULTS_READ, FAULTS_SHOWN, InputError
from eadp.io.text.streams import Text
from eadp.measure.formats import read_power_log
from eadp.measure.power_log import Columns, PowerLog, read_csv_log
from eadp.measure.spectrum import MIN_SAMPLES

N = 25


def parse(body: str, **columns: object) -> PowerLog:
    return read_csv_log(Text("log.csv", body), Columns(**columns))  # type: ignore[arg-type]


faults_of = partial(faults_by, parse, name="log.csv")


def table(header: str, row: str, n: int = N, first: int = 0) -> str:
    """A log of n rows; {i} is their number."""
    return "".join([f"{header}\n"] * bool(header) + [row.format(i=i) + "\n" for i in range(first, first + n)])


def rows(*lines: str) -> str:
    """A log of these rows after N good ones, from line N + 2 on."""
    return table("time_s,power_w", "{i},3{i}.5") + "".join(f"{line}\n" for line in lines)


# columns and units


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("time_s,power_w", "{i}.5,3{i}"),
        ("power_w,time_s", "3{i},{i}.5"),
        ("time_ms,power_mw", "{i}500,3{i}000"),
        ("time [s],power [W]", "{i}.5,3{i}"),
        ('"time_s","power_w"', '"{i}.5","3{i}"'),
        ("step,time_us,total_power_w,cpu_w", "7,{i}500000,3{i},x"),
    ],
)
def test_columns_and_their_units(header: str, row: str) -> None:
    log = parse(table(header, row))
    np.testing.assert_allclose(log.times_s, np.arange(N), atol=1e-12)
    np.testing.assert_allclose(log.power_w, [float(f"3{i}") for i in range(N)])
    assert log.warnings == []


def test_voltage_times_current() -> None:
    log = parse(table("timestamp,voltage_v,voltage_filtered_v,current_a", "{i}000000,1{i},99,2"))
    np.testing.assert_allclose(log.power_w, [2 * float(f"1{i}") for i in range(N)])
    named = parse(
        table("timestamp,voltage_v,voltage_filtered_v,current_a", "{i}000000,1{i},10,2"), voltage="voltage_filtered_v"
    )
    assert set(named.power_w.tolist()) == {20.0}


def test_power_comes_before_voltage_and_current() -> None:
    body = table("time_s,voltage_v,current_a,power_w", "{i},10,2,33")
    assert set(parse(body).power_w.tolist()) == {33.0}
    assert set(parse(body, voltage="voltage_v", current="current_a").power_w.tolist()) == {20.0}
    assert set(parse(body, current="current_a").power_w.tolist()) == {20.0}


def test_columns_by_option() -> None:
    body = table("elapsed thing,motor_w,power_w", "{i},3{i},1")
    log = parse(body, time="elapsed thing", power=["motor_w"], time_unit="min")
    np.testing.assert_allclose(log.times_s, 60.0 * np.arange(N))
    assert (log.power_w[5], log.warnings) == (35, [])


def test_a_unit_by_option_beats_the_names() -> None:
    assert parse(table("timestamp,power_w", "{i},5"), time_unit="s").times_s[-1] == N - 1
    assert parse(table("time,power_w", "{i},5"), time_unit="ms").times_s[-1] == pytest.approx((N - 1) / 1000)


def test_dates_in_microseconds_keep_their_digits() -> None:
    log = parse(table("timestamp,power_w", "17000000000000{i}", 0) + table("", "173210000{i:02d}000001,5"))
    np.testing.assert_array_equal(log.times_s, np.arange(N))


@pytest.mark.parametrize(
    ("step", "refused"), [(100, True), (4_000, True), (5_000, False), (50_000_000, False), (10**8, True)]
)
def test_times_without_a_unit_have_the_steps_of_a_log_of_px4(step: int, refused: bool) -> None:
    body = "timestamp,power_w\n" + "".join(f"{10**12 + step * i},{5 + i % 3}\n" for i in range(N))
    parse(body, time_unit="us")
    if not refused:
        parse(body)
        return
    with pytest.raises(InputError, match=r"log.csv:1:1: error: a row every .* s, if timestamp is in µs; expected a na"):
        parse(body)


@pytest.mark.parametrize("mark", [";", "\t"])
def test_other_separators(mark: str) -> None:
    body = "time_s,power_w\n" + "".join(f"{i},{5 + i % 3}\n" for i in range(N))
    np.testing.assert_array_equal(parse(body.replace(",", mark)).power_w, parse(body).power_w)


def test_a_date_and_a_battery_are_named() -> None:
    with pytest.raises(InputError, match="2024-05-01 is a date; expected a number, of a time in seconds"):
        parse("time_s,power_w\n2024-05-01,5\n")
    with pytest.raises(InputError, match="--instance:1:1: error: a table has no batteries"):
        parse("time_s,power_w\n1,5\n", instance=0)


@pytest.mark.parametrize(
    ("header", "columns", "fault"),
    [
        ("time,power_w", {}, "1:1: error: time has no unit of time; expected a name such as time_s, or --time-unit s"),
        ("time_parsec,power_w", {}, "1:1: error: no column for the time; expected time_s, or --time NAME"),
        ("time_s,power", {}, "1:8: error: power has no unit of power; expected a name such as power_w"),
        ("time_s,m", {"power": ["m"]}, "1:8: error: m has no unit of power; expected --power 'm [W]', or 'm [mW]'"),
        ("time_s,energy_j", {}, "1:1: error: no column for the power; expected power_w, or voltage_v and current_a"),
        ("time_s,power_w,power_w", {}, "1:16: error: the name power_w stands twice"),
        ("time_s,power_w,total_power_w", {}, "1:16: error: several columns of power: power_w, total_power_w"),
        ("time_s,power_w", {"power": ["p"]}, "--power:1:1: error: no column p; expected one of time_s, power_w"),
        ("time_s,power_w", {"power": ["power_w"], "voltage": "v"}, "--power:1:1: error: and --voltage or --current"),
        ("0.5,38.2", {}, "1:1: error: the first row has numbers, not the names of columns; expected a header"),
    ],
)
def test_columns_that_cannot_be_told(header: str, columns: dict[str, object], fault: str) -> None:
    assert faults_of(table(header, "{i},3,4"[: 2 * header.count(",") + 3]), **columns)[0].startswith(fault)


# rows


def test_rows_that_are_no_readings_are_counted_in_warnings() -> None:
    log = parse(rows("30,", "31,nan", ",5", "32,inf", "33,-Infinity", "34", "35,30"))
    assert (len(log.times_s), log.times_s[-1]) == (N + 1, 35)
    assert first_lines(log.warnings, "log.csv") == [
        "27:1: warning: 3 rows with an empty cell left out, the first of them here",
        "28:1: warning: 3 rows with a cell that is not finite left out, the first of them here",
    ]


def test_autopilots_say_unknown_by_minus_one_and_zero() -> None:
    good = table("timestamp,voltage_v,current_a", "{i}000000,15,2")
    log = parse(good + "30000000,15,-1\n31000000,0,2\n32000000,15,0\n33000000,-1,-1\n34000000,15,2.5\n")
    assert log.power_w[-2:].tolist() == [0, 37.5]
    message = "27:1: warning: 3 rows with an unknown voltage (0 or -1) or current (-1) left out, the first of them here"
    assert first_lines(log.warnings, "log.csv") == [message]


def test_a_power_of_no_such_aircraft_is_refused() -> None:
    with pytest.raises(InputError, match=r"4\.05e\+06 W \(mean of the columns: voltage_v 1500, current_a 2700"):
        parse(table("timestamp,voltage_v,current_a", "{i}000000,1500,2700"))


def test_order_and_repetition() -> None:
    log = parse(rows("32,1", "31,2", "30,3", "32,4", "33,5"))
    assert log.times_s[-4:].tolist() == [30, 31, 32, 33]
    assert log.power_w[-4:].tolist() == [3, 2, 1, 5], "of two rows at one time the first is kept"
    assert first_lines(log.warnings, "log.csv") == [
        "28:1: warning: 2 rows earlier than one before: sorted by time, the first of them here",
        "30:1: warning: 1 row at the time of another left out",
    ]


def test_a_gap_of_half_the_log_is_worth_a_warning() -> None:
    log = parse(rows("1000,30"))
    assert first_lines(log.warnings, "log.csv") == [
        "27:1: warning: a gap of 976 s before this row, more than half of the log"
    ]


def test_blank_lines_and_comments_are_skipped() -> None:
    body = "# a log\n\n" + table("time_s,power_w", "{i},30\n\n# {i}")
    assert len(parse(body).times_s) == N


def test_bad_cells_are_all_reported() -> None:
    faults = faults_of(rows("1oo,30", "100, thirty", '101,"a b"', "1_0,5", "1e13,5", "5,1e10", "1,2,3", "1,2,,"))
    assert faults == [
        "27:1: error: 1oo is not a number; expected a number",
        "28:6: error: thirty is not a number; expected a number",
        "29:5: error: a b is not a number; expected a number",
        "30:1: error: 1_0 is not a number; expected a number",
        "31:1: error: 1e13 is too large; expected a number of at most 1e+12",
        "32:3: error: 1e10 is too large; expected a number of at most 1e+09",
        "33:5: error: 3 fields; expected 2, as in the header",
    ]


def test_many_bad_cells_are_counted() -> None:
    faults = faults_of(rows(*["x,1"] * 100))
    assert len(faults) == FAULTS_SHOWN + 1
    assert faults[-1].endswith(f": {100 - FAULTS_SHOWN} more faults from here on")
    faults = faults_of(rows(*["x,1"] * 2 * FAULTS_READ))
    assert faults[-1].endswith(f"at least {FAULTS_READ - FAULTS_SHOWN} more faults from here on")


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("", "1:1: error: no readings; expected a header such as time_s,power_w, and a row for each"),
        (table("time_s,power_w", "{i},5", MIN_SAMPLES - 1), f"1:1: error: {MIN_SAMPLES - 1} readings; expected"),
        (table("time_s,power_w", "7,5"), "1:1: error: 1 readings at different times, over 0 s; expected"),
        (table("time_ns,power_w", "{i},5"), "1:1: error: 25 readings at different times, over 2.4e-08 s; expected"),
    ],
)
def test_too_few_readings(body: str, fault: str) -> None:
    assert any(line.startswith(fault) for line in faults_of(body))


def test_a_clock_set_back_keeps_the_longest_run() -> None:
    log = parse(table("time_s,power_w", "{i},3", 40) + table("", "{i},5", 60) + table("", "{i},7", 30))
    assert set(log.power_w.tolist()) == {5.0}
    assert len(log.times_s) == 60
    assert log.counts["restart"] == 70
    assert first_lines(log.warnings, "log.csv") == [
        "42:1: warning: the clock is set back here: 70 rows outside the longest run left out"
    ]
    log = parse(table("time_s,power_w", "{i},3", 40) + table("", "{i},5", 25))
    assert set(log.power_w.tolist()) == {3.0}


def test_what_was_left_out_is_counted() -> None:
    log = parse(rows("30,", "31,nan", "31,5", "31,6", "30.5,1", "90,1", "34", "135,30"))
    assert log.counts == {
        "rows": N + 8, "empty": 2, "not_finite": 1, "late": 1, "repeated": 1, "gaps": 3, "longest_gap_s": 59.0,
    }  # fmt: skip
    assert parse(rows()).counts == {"rows": N}


def test_other_columns() -> None:
    log = parse(table("time_s,x_m,power_w,fps", "{i},1{i},5,{i}"), also=["fps"])
    assert log.also["fps"].tolist() == list(range(N))
    with pytest.raises(InputError, match="no column fps; expected one beside time_s, power_w"):
        parse(table("time_s,power_w", "{i},5"), also=["fps"])


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_file_with_a_byte_order_mark_and_any_line_ends(tmp_path: Path, end: str) -> None:
    file = tmp_path / "log.csv"
    file.write_bytes(b"\xef\xbb\xbf" + table("time_s,power_w", "{i},5").replace("\n", end).encode())
    assert len(read_power_log(str(file)).times_s) == N


@given(st.text(max_size=300))
def test_any_text_is_read_or_refused(body: str) -> None:
    for head in ("", "time_s,power_w\n"):
        try:
            log = parse(head + body)
        except InputError:
            continue
        assert np.all(np.diff(log.times_s) > 0)


def test_semicolons_decimal_commas_and_dates(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"2024-05-01T12:00:{i / 2:06.3f}Z;{30 + i / 4:.2f}".replace(".", ",", 2) for i in range(60)]
    rows = [row.replace(",", ".", 1) for row in rows]  # the decimal comma of the power alone
    path.write_text("time;power_w\n" + "\n".join(rows) + "\n")
    log = read_power_log(str(path))
    np.testing.assert_allclose(log.times_s, np.arange(60) / 2, atol=1e-6)
    np.testing.assert_allclose(log.power_w, 30 + np.arange(60) / 4)


def test_dates_with_zones_and_without(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(
        "timestamp,power_w\n" + "".join(f"2024-05-01 {12 + i // 60:02d}:{i % 60:02d}:00+02:00,5\n" for i in range(90))
    )
    assert read_power_log(str(path)).times_s[-1] == 89 * 60
    path.write_text("time,power_w\n" + "".join(f"2024-05-01T12:00:{i:02d},5\n" for i in range(50)) + "yesterday,5\n")
    with pytest.raises(InputError, match=r"log\.csv:52:1: error: yesterday is no time by ISO 8601"):
        read_power_log(str(path))

"""Measurements and models of the computations in files: what is read, refused and where, and written."""

import json
import statistics
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from common import ROOT
from common.answers import faults_by, first_lines
from hypothesis import given
from hypothesis import strategies as st

from eadp.core.signals import average
from eadp.errors import FAULTS_READ, FAULTS_SHOWN, InputError
from eadp.io.profile.model_file import parse_profile, profile_document, profile_yaml
from eadp.io.text.streams import Text, read_text
from eadp.models.profile import Profile


def parse(body: str) -> Profile:
    return parse_profile(Text("m.csv", body))[0]


def warnings_of(body: str) -> list[str]:
    return first_lines(parse_profile(Text("m.csv", body))[1], "m.csv")


faults_of = partial(faults_by, parse, name="m.csv")


def points_of(profile: Profile) -> dict[tuple[float, ...], float]:
    return dict(zip(map(tuple, profile.configurations.tolist()), profile.power_w.tolist(), strict=True))


# measurements


@pytest.mark.parametrize(
    "header", ["fps [1/s],power [mW]", "fps [1/s],power_mw", "fps (1/s) , Power (mW)", '"fps [1/s]","power_mW"']
)
def test_units_of_header(header: str) -> None:
    profile = parse(f"{header}\n2,5214.38\n4,6942.12\n")
    assert (profile.names, profile.units) == (("fps",), ("1/s",))
    assert points_of(profile) == {(2,): 5.21438, (4,): 6.94212}


def test_columns_that_are_no_parameters_are_ignored_with_a_warning() -> None:
    body = "time_s,fps,cpu_power_w,power_w\n0,2,1,5\n1,2,nan,5.1\n2,4,,7\n"
    assert points_of(parse(body)) == {(2,): pytest.approx(5.05), (4,): 7}
    assert warnings_of(body) == [
        "1:1: warning: time_s is no parameter of the computations: ignored",
        "1:12: warning: cpu_power_w is no parameter of the computations: ignored",
    ]


@pytest.mark.parametrize("column", ["std_w", "extrapolated"])
def test_what_eadp_writes_beside_the_power_is_no_computation(column: str) -> None:
    body = f"fps,power_w,{column}\n2,5,0.1\n4,7,0.2\n"
    assert parse(body).names == ("fps",)
    assert warnings_of(body) == [f"1:13: warning: {column} is no parameter of the computations: ignored"]


def test_power_without_a_unit_is_taken_as_watts_with_a_warning() -> None:
    assert warnings_of("fps,power\n2,5\n4,7\n") == [
        "1:5: warning: power without a unit: taken as W; expected power_w, or power [W]"
    ]


def test_repeated_configurations_are_averaged_with_their_spread() -> None:
    profile = parse("fps,power_w\n2,5\n4,7\n2,5.5\n2,5.25\n")
    assert points_of(profile) == {(2,): 5.25, (4,): 7}
    assert profile.std_w.tolist() == pytest.approx([statistics.stdev([5, 5.5, 5.25]), 0])
    assert profile.samples.tolist() == [3, 1]


def test_comments_blank_lines_and_the_source() -> None:
    profile = parse("\n# a comment\n# Source: the bench,\n#source: in June\nfps,power_w\n\n2,5\n # fast\n4,7\n\n")
    assert profile.source == "the bench, in June"
    assert points_of(profile) == {(2,): 5, (4,): 7}


def test_the_source_is_the_files_name_where_nothing_says_more(tmp_path: Path) -> None:
    file = tmp_path / "bench.csv"
    file.write_bytes(b"\xef\xbb\xbffps,power_w\r\n2,5\r\n4,7\r\n")  # a BOM and CRLF, as spreadsheets write
    profile, warnings = parse_profile(read_text(str(file)))
    assert (profile.source, profile.names, warnings) == ("bench.csv", ("fps",), [])


def test_numbers_alone() -> None:
    assert parse("\n2,5\n4,7\n").names == ("c",)
    assert points_of(parse("2,5\n4,7\n")) == {(2,): 5, (4,): 7}
    assert points_of(parse("200,130\n210,131\n")) == {(200,): 130, (210,): 131}


def test_powprofilers_flags() -> None:
    rows = "2,32,5,3,1,900,1,x\n2,64,6,4,1,1,1,\n4,32,7,3,1,1,1,1\n4,64,8,1,1,1,1,1\n"
    body = f"200,201,100,101,102,130,131,160\n{rows}"
    profile = parse(body)
    assert profile.names == ("p200", "p201")
    assert points_of(profile) == {(2, 32): 5, (2, 64): 6, (4, 32): 7, (4, 64): 8}


def test_powprofilers_total_and_none_of_its_energy_and_charge() -> None:
    rows = "2,5,3,1,900,540,180,0.9,0.8,0.7\n2,6,3,1,1100,550,180,1,0.8,\n4,7,3,2,x,1,1,,0.8,0.6\n"
    profile = parse(f"200,100,101,102,130,131,132,160,161,162\n{rows}")
    assert profile.power_w.tolist() == [5.5, 7]
    assert profile_document(parse(profile_yaml(profile))) == profile_document(profile)


# standard errors


def test_the_standard_error_is_that_of_the_runs() -> None:
    first, second = [5.0, 5.1, 5.2, 5.1, 5.0], [5.3, 5.4, 5.2]
    rows = [f"2,{power_w}" for power_w in first] + ["4,7"] + [f"2,{power_w}" for power_w in second]
    profile = parse("fps,power_w\n" + "\n".join(rows))
    assert profile.standard_error_w[0] == average([first, second]).standard_error
    assert np.isnan(profile.standard_error_w[1]), "of one reading nothing is known"


# measurements that are refused


@pytest.mark.parametrize(
    ("body", "faults"),
    [
        (
            "fps,power_w\n2,nan\n4,-3\nx,inf\n,5\n5\n6,1e999\n6,7,8\n",
            [
                "2:3: error: nan is not finite; expected a finite number",
                "3:3: error: a power of -3 W; expected a power of 0 or more",
                "4:1: error: x is not a number; expected a number",
                "4:3: error: inf is not finite; expected a finite number",
                "5:1: error: an empty field is not a number; expected a number",
                "6:2: error: 1 fields; expected 2, as in the first row",
                "7:3: error: 1e999 is too large; expected a number of at most 1e+30",
                "8:5: error: 3 fields; expected 2, as in the first row",
            ],
        ),
        ("fps,power_w\n2,5\n2,5\n", ["1:1: error: one configuration only; expected measurements of two conf"]),
        ("fps,power_w\n", ["1:1: error: no measurements; expected measurements of two configurations or more"]),
        ("fps|power_w\n2|5\n", ["1:1: error: one column only; expected a header such as fps,power_w, fields sep"]),
        ("fps,watt_hours\n2,5\n", ["1:1: error: no column for the power; expected a header such as fps,power_w, or"]),
        ("time_s,power_w\n2,5\n", ["1:1: error: no column for the configuration: it is a trace; expected that of"]),
        ("fps,power_w,power_mw\n2,5,5\n", ["1:13: error: several columns of power: power_w, power_mw; expected one"]),
        ("fps,power [MW]\n2,5\n", ["1:5: error: MW is no known unit of power; expected a header such as fps,power_w"]),
        (
            "fps,2nd,fps,,power_w\n2,5,5,5,5\n",
            [
                "1:5: error: 2nd is no name; expected a header such as fps,power_w",
                "1:9: error: the column fps stands twice; expected each once",
                "1:13: error: an empty field is no name; expected a header such as fps,power_w",
            ],
        ),
        ("2,32,5\n2,64,6\n", ["1:1: error: 3 columns without names; expected a header such as fps,power_w"]),
        ("a,b,c,d,e,f,g,h,i,power_w\n1,1,1,1,1,1,1,1,1,1\n", ["1:17: error: 9 columns of parameters; expected at"]),
        ("fps,k,power_w\n2,32,5\n6,240,6\n10,448,7\n", ["2:1: error: the configurations are no full grid and lie on"]),
    ],
)
def test_what_is_refused_and_where(body: str, faults: list[str]) -> None:
    found = faults_of(body)
    assert len(found) == len(faults)
    for line, start in zip(found, faults, strict=True):
        assert line.startswith(start)


def test_a_name_that_stands_twice_is_escaped() -> None:
    assert "1:6: error: the column \\x1bfps stands twice; expected each once" in faults_of("\x1bfps,\x1bfps,power_w\n")


def test_faults_are_capped_and_the_rest_counted() -> None:
    faults = faults_of("fps,power_w\n" + "2,x\n" * (FAULTS_SHOWN + 5))
    assert len(faults) == FAULTS_SHOWN + 1
    assert faults[-1] == f"{FAULTS_SHOWN + 2}:3: error: 5 more faults from here on"
    faults = faults_of("fps,power_w\n" + "2,x\n" * 2 * FAULTS_READ)
    assert faults[-1].endswith(f"at least {FAULTS_READ - FAULTS_SHOWN} more faults from here on")


@given(st.text(st.sampled_from('0123456789.,-e#\n "[]()fpsower_wW{:'), max_size=60))
def test_any_text_is_read_or_refused(body: str) -> None:
    try:
        profile = parse(body)
    except InputError:
        return
    assert np.all(np.isfinite(profile.power_w))
    assert np.all(profile.power_w >= 0)


# the model

MODEL = """\
schema: eadp.profile/1
source: "the bench"
parameters:
  - {name: "fps", unit: "1/s"}
  - {name: "keysize"}
interpolation: linear
points:
  - {at: [2, 32], power_w: 5}
  - {at: [2, 448], power_w: 6.25, std_w: 0.125, samples: 3}
  - {at: [10, 32], power_w: 9.5}
"""


def test_model_is_read_and_written_back_the_same() -> None:
    profile = parse(MODEL)
    assert (profile.names, profile.units, profile.source) == (("fps", "keysize"), ("1/s", ""), "the bench")
    assert points_of(profile) == {(2, 32): 5, (2, 448): 6.25, (10, 32): 9.5}
    assert (profile.std_w.tolist(), profile.samples.tolist()) == ([0, 0.125, 0], [1, 3, 1])
    assert profile_yaml(profile) == MODEL


def test_a_model_is_known_by_its_content_or_its_ending(tmp_path: Path) -> None:
    profile = parse(MODEL)
    assert profile_document(parse("# a comment\n\n---\n" + MODEL)) == profile_document(profile)
    assert profile_document(parse(json.dumps(profile_document(profile)))) == profile_document(profile)
    (tmp_path / "m.yaml").write_text("source: s\n")
    with pytest.raises(InputError, match=r"has no key schema; expected schema: eadp\.profile/1"):
        parse_profile(read_text(str(tmp_path / "m.yaml")))


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (
            "eadp.profile/1",
            "eadp.profile/2",
            "1:1: error: is a file of eadp.profile/2; expected schema: eadp.profile/1",
        ),
        ("source:", "sauce:", "2:1: error: unknown key sauce"),
        ("linear", "cubic", "6:1: error: interpolation cannot be 'cubic'; expected 'linear' or 'pchip'"),
        ("linear", "pchip", "6:1: error: pchip needs one changing parameter, and 2 change"),
        ("power_w: 5}", "std_w: 5}", "8:5: error: the key points.0.power_w is missing"),
        ("power_w: 5}", "power_w: 5, powr: 5}", "8:31: error: unknown key points.0.powr"),
        ("power_w: 5}", "power_w: -5}", "8:19: error: points.0.power_w cannot be -5; expected greater than or equal"),
        ("power_w: 5}", "power_w: .nan}", "8:28: error: .nan is not a finite number; expected a finite number"),
        ("at: [10, 32]", "at: [10]", "10:6: error: 1 values for 2 parameters; expected one for each"),
        ("at: [10, 32]", "at: [2, 32]", "7:1: error: the configuration fps=2, keysize=32 stands twice"),
        ('name: "keysize"', 'name: "fps"', "5:6: error: the name fps stands twice; expected each once"),
    ],
)
def test_what_is_wrong_with_a_model_and_where(old: str, new: str, fault: str) -> None:
    assert MODEL.count(old) == 1
    (found,) = faults_of(MODEL.replace(old, new))
    assert found.startswith(fault)


def test_a_model_of_nothing_has_each_of_its_faults() -> None:
    first, second = faults_of("schema: eadp.profile/1\nparameters: []\npoints: [3]\n")
    assert first.startswith("2:1: error: parameters cannot be a list of 0; expected at least 1 item")
    assert second.startswith("3:10: error: points.0 cannot be 3; expected a mapping of keys")


number = st.floats(0, 1e12, allow_subnormal=False)
name = st.from_regex(r"[a-zA-Zé][a-z0-9 _-]{0,8}[a-z0-9]", fullmatch=True)


@st.composite
def profiles(draw: st.DrawFn) -> Profile:
    d = draw(st.integers(1, 2))
    names = draw(st.lists(name, min_size=d, max_size=d, unique=True))
    axes = [draw(st.lists(number, min_size=2, max_size=3, unique=True)) for _ in range(d)]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, d)
    n = len(points)
    column = st.lists(number, min_size=n, max_size=n).map(np.array)
    samples = draw(st.lists(st.integers(1, 2**53), min_size=n, max_size=n).map(np.array))
    units = tuple(draw(st.text(max_size=5)) for _ in range(d))
    errors_w = draw(st.lists(st.one_of(st.just(float("nan")), number.map(abs)), min_size=n, max_size=n).map(np.array))
    measured = (draw(column), draw(column), samples, "linear", draw(st.text()), errors_w)
    return Profile(tuple(names), units, points, *measured)


@given(profiles())
def test_round_trip_is_exact(profile: Profile) -> None:
    text = profile_yaml(profile)
    again = parse(text)
    assert profile_document(again) == profile_document(profile)
    assert profile_yaml(again) == text
    assert profile_document(parse(json.dumps(profile_document(profile)))) == profile_document(profile)


# files that are shipped, and published data


@pytest.mark.parametrize("stem", ["pednet-jetson-nano", "pednet-letter"])
def test_shipped_models_are_those_of_their_measurements(stem: str) -> None:
    profile, warnings = parse_profile(read_text(str(ROOT / "profiles" / f"{stem}.csv")))
    assert warnings == []
    assert profile.names == ("fps",)
    assert "Seewald, García de Marina, Midtiby, Schultz" in profile.source
    assert (ROOT / "profiles" / f"{stem}.yaml").read_text(encoding="utf-8") == profile_yaml(profile)

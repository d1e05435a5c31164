"""YAML read strictly: the scalars of YAML 1.2's core, and every refusal with its place."""

import json
import math
from functools import partial

import pytest
from common.answers import faults_by
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.io.text.streams import Text
from eadp.io.text.yaml import DIGITS_LIMIT, LIMIT_CHARACTERS, NESTING_LIMIT, Document, read_yaml


def read(body) -> Document:
    return read_yaml(Text("s.yaml", body))


def value_of(scalar):
    return read(f"a: {scalar}\n").value["a"]


faults_of = partial(faults_by, read)


# --- scalars ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scalar", "value"),
    [
        ("1", 1),
        ("012", 12),  # ten and two: 1.1 read it as octal
        ("0x1F", 31),
        ("1.5", 1.5),
        ("1e3", 1000.0),
        ("null", None),
        ("", None),
        # strings in 1.2
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("١", "١"),  # an Arabic digit
        # quoted: strings
        ('"a\\tb"', "a\tb"),
        ("|\n  1\n", "1\n"),
    ],
)
def test_scalars_of_the_core_schema(scalar, value):
    got = value_of(scalar)
    assert got == value
    assert type(got) is type(value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_float_keeps_its_digits(value):
    assert value_of(repr(value)) == value


json_values = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(10**9), 10**9),
        st.floats(allow_nan=False, allow_infinity=False),
        st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), max_size=8),
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text("abcdefgh_", min_size=1, max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)


@given(json_values)
def test_json_is_yaml(value):
    assert read(json.dumps(value, ensure_ascii=False)).value == value
    assert read(json.dumps(value, ensure_ascii=False, indent=2)).value == value


@pytest.mark.parametrize(
    ("scalar", "value"), [('"\\ud83d\\ude80"', "\N{ROCKET}"), ('"\\ud800"', "\N{REPLACEMENT CHARACTER}")]
)
def test_escaped_surrogates_are_one_character(scalar, value):
    assert value_of(scalar) == value


# --- documents and places ---------------------------------------------------------------------------------------------

SCENARIO = """\
schema: eadp.scenario/1
# a comment
wind: {speed_mps: 5, towards_deg: 90}
faults:
  - at_s: 93
    soc_drop: 0.06
  - {at_s: 270, soc_drop: 0.09}
empty:
"""


@pytest.mark.parametrize(
    ("path", "place"),
    [
        ((), (1, 1)),
        (("schema",), (1, 1)),
        (("wind", "towards_deg"), (3, 22)),
        (("faults", 0), (5, 5)),
        (("faults", 0, "soc_drop"), (6, 5)),
        (("faults", 1, "soc_drop"), (7, 17)),
        (("wind", "gust"), (3, 1)),  # its nearest parent
        (("faults", 7, "at_s"), (4, 1)),
    ],
)
def test_places_of_values(path, place):
    fault = read(SCENARIO).fault(path, "is wrong", "right")
    assert (fault.line, fault.column) == place
    assert str(fault).startswith(f"s.yaml:{place[0]}:{place[1]}: error: is wrong; expected right\n")
    assert fault.source == SCENARIO.split("\n")[place[0] - 1]


def test_values_that_came_from_elsewhere():
    document = read(SCENARIO)
    document.overrides["wind", "gust"] = "--set wind.gust=x"
    assert str(document.fault(("wind", "gust"), "is wrong")) == "--set wind.gust=x:1:1: error: is wrong"


@pytest.mark.parametrize("body", ["", "\n\n", "# nothing\n", "null\n"])
def test_an_empty_document(body):
    document = read(body)
    assert document.value is None
    assert document.fault(("a",), "is missing").line == 1


@pytest.mark.parametrize(
    ("body", "value"), [("5", 5), ("- 1\n- 2\n", [1, 2]), ("a", "a"), ("---\na: 1\n...\n", {"a": 1})]
)
def test_documents_that_are_no_mapping(body, value):
    assert read(body).value == value


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "faults"),
    [
        ("a: 1\nb: 2\na: 3\n", ["s.yaml:3:1: error: the key a stands twice; expected it once"]),
        ("a: .nan\n", ["s.yaml:1:4: error: .nan is not a finite number; expected a finite number"]),
        ("a: 1e999\n", ["s.yaml:1:4: error: 1e999 is not a finite number; expected a finite number"]),
        ("a: &x 1\nb: *x\n", ["s.yaml:1:4: error: a YAML alias or anchor; expected the value written out"]),
        ("a: !!python/object/apply:os.system [ls]\n", None),
        ("? [a, b]\n: 1\n", ["s.yaml:1:3: error: a key that is not a name; expected a name"]),
        ("a: 1\n---\nb: 2\n", None),
        ("a: [1\n", None),
        ("a: b: c\n", None),
        ("%YAML 3.0\n---\na: 1\n", None),
        ("a: \x00\n", None),
    ],
)
def test_what_is_refused_and_where(body, faults):
    said = faults_of(body)
    if faults is not None:
        assert said == faults
    assert all(line.startswith("s.yaml:") and line.isprintable() for line in said)


def test_all_the_faults_of_a_document_at_once():
    places = [fault.split(" error:")[0] for fault in faults_of("a: .nan\nb: {c: 1e999, c: 2}\nd: .inf\n")]
    assert places == ["s.yaml:1:4:", "s.yaml:2:8:", "s.yaml:2:15:", "s.yaml:3:4:"]


def test_nesting_has_a_limit():
    assert read("[" * NESTING_LIMIT + "]" * NESTING_LIMIT).value is not None
    for levels in (NESTING_LIMIT + 1, 100_000):
        (said,) = faults_of("[" * levels)
        assert said == f"s.yaml:1:{NESTING_LIMIT + 1}: error: nested deeper than {NESTING_LIMIT} levels"
    (said,) = faults_of("\n".join(" " * k + f"k{k}:" for k in range(60)))
    assert "nested deeper than 50 levels" in said


def test_digits_have_a_limit():
    assert value_of("1" * DIGITS_LIMIT) == int("1" * DIGITS_LIMIT)
    assert value_of("1" * (DIGITS_LIMIT + 1)) == float("1" * (DIGITS_LIMIT + 1))
    for scalar in ("1" * 100_000, "0x" + "1" * DIGITS_LIMIT):
        (said,) = faults_of(f"a: {scalar}\n")
        assert said.endswith(" is not a finite number; expected a finite number")


# --- whatever comes ---------------------------------------------------------------------------------------------------


@given(st.integers(0, len(SCENARIO)), st.integers(0, 4), st.text(max_size=3))
def test_a_document_that_is_tampered_with_is_read_or_refused(at, dropped, inserted):
    read_or_refuse(SCENARIO[:at] + inserted + SCENARIO[at + dropped :])


def read_or_refuse(body):
    try:
        document = read(body)
    except InputError as error:
        for fault in error.faults:
            assert fault.line >= 1
            assert fault.column >= 1
            assert all(line.isprintable() for line in str(fault).split("\n"))
        return
    assert only_plain(document.value)


def only_plain(value):
    if isinstance(value, dict):
        return all(isinstance(key, str) and only_plain(item) for key, item in value.items())
    if isinstance(value, list):
        return all(only_plain(item) for item in value)
    if isinstance(value, float):
        return math.isfinite(value)
    return value is None or isinstance(value, bool | int | str)


def test_a_document_that_is_too_long():
    assert read_yaml(Text("f", "a: 1\n" + " " * 1000)).value == {"a": 1}
    with pytest.raises(
        InputError, match=f"f:1:1: error: is too large for YAML; expected at most {LIMIT_CHARACTERS} char"
    ):
        read_yaml(Text("f", "a: 1\n" + " " * LIMIT_CHARACTERS))

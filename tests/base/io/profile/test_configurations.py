"""Configurations as options state them."""

from __future__ import annotations

import itertools
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.io.profile.configurations import configuration_in_name, configurations_to_measure, parse_configuration
from eadp.io.profile.measurements import Configuration

number = st.integers(-10_000, 10_000).map(lambda k: k / 16)


def values(*stated: str) -> list[tuple[float, ...]]:
    return [each.values for each in configurations_to_measure(stated)]


def fault_of(call: object, *arguments: object) -> str:
    with pytest.raises(InputError) as caught:
        call(*arguments)  # type: ignore[operator]
    return str(caught.value).splitlines()[0]


def test_of_a_trace() -> None:
    assert parse_configuration("fps [1/s]=0.5, keysize=32") == Configuration(("fps", "keysize"), ("1/s", ""), (0.5, 32))
    assert str(parse_configuration("fps=0.5,keysize=32")) == "fps=0.5,keysize=32"


@given(number, number)
def test_in_a_files_name(fps: float, keysize: float) -> None:
    found = configuration_in_name(f"some/folder_9fps/landing_{fps!r}fps_{keysize!r}bit.csv", "*_{fps}fps_{keysize}bit")
    assert found == Configuration(("fps", "keysize"), ("", ""), (fps, keysize))


def test_the_ending_counts_only_where_the_pattern_has_it() -> None:
    for pattern in ("landing_trace_{fps}fps", "landing_trace_{fps}fps.csv", "*{fps}fps.*"):
        assert configuration_in_name("landing_trace_10fps.csv", pattern).values == (10,)
    assert configuration_in_name("landing_trace_10fps.csv", "*_{fps}fps").names == ("fps",)


def test_combinations_and_unions() -> None:
    assert values("fps=2,4,6") == [(2,), (4,), (6,)]
    assert values("fps=2,4,keysize=32,448") == [(2, 32), (2, 448), (4, 32), (4, 448)]
    assert values("fps=2,keysize=32", "keysize=448,fps=4", "fps=2,keysize=32") == [(2, 32), (4, 448)]


@given(
    st.lists(number, min_size=1, max_size=5, unique=True),
    st.lists(number, min_size=1, max_size=5, unique=True),
)
def test_combinations_are_the_product(first: list[float], second: list[float]) -> None:
    lists = [",".join(map(repr, each)) for each in (first, second)]
    assert values(f"a={lists[0]},b={lists[1]}") == list(itertools.product(first, second))


@pytest.mark.parametrize(
    ("raw", "start"),
    [
        ("", "--config:1:1: error: an empty text is no name=value; expected NAME=VALUE"),
        ("5,fps=2", "--config:1:1: error: 5 is no name=value"),
        ("fps=2,,4", "--config:1:7: error: fps is empty, not a finite number"),
        ("fps=nan", "--config:1:1: error: fps is nan, not a finite number"),
        ("fps=1e31", "--config:1:1: error: fps is 1e31, not a finite number"),
        ("fps=2,fps=4", "--config:1:7: error: fps stands twice; expected each once"),
        ("2nd=4", "--config:1:1: error: 2nd is no name"),
        ("power_w=4", "--config:1:1: error: a power is no parameter"),
        ("fps=2,4", "--config:1:1: error: 2 values of fps; expected one"),
    ],
)
def test_stated_wrongly(raw: str, start: str) -> None:
    assert fault_of(parse_configuration, raw).startswith(start)


@pytest.mark.parametrize(
    ("stated", "start"),
    [
        ([], "--config:1:1: error: nothing to measure"),
        (["fps=2,keysize=32", "fps=4"], "--config:1:1: error: other parameters than before; expected values of fps, k"),
        (
            ["a=" + "1," * 98 + "1,b=" + "1," * 98 + "1"],
            "--config:1:1: error: 9801 configurations; expected at most 10",
        ),
        ([",".join(f"p{i}=1" for i in range(9))], "--config:1:1: error: 9 parameters; expected at most 8"),
    ],
)
def test_what_cannot_be_measured(stated: list[str], start: str) -> None:
    assert fault_of(configurations_to_measure, stated).startswith(start)


@pytest.mark.parametrize(
    ("path", "pattern", "start"),
    [
        ("a/x_2fps.csv", "y_{fps}fps", "a/x_2fps.csv:1:1: error: the name does not match y_{fps}fps"),
        ("x_fastfps.csv", "*_{fps}fps", "x_fastfps.csv:1:1: error: the name does not match"),
        ("x_1e99fps.csv", "*_{fps}fps", "x_1e99fps.csv:1:1: error: the name does not match"),
        ("x_2fps.csv", "x_2fps", "--from-name:1:1: error: a pattern without parameters"),
        ("x_2_2.csv", "x_{a}_{a}", "--from-name:1:1: error: a pattern without parameters, or with one twice"),
        ("x_2_3.csv", "*_*_*{a}", "--from-name:1:1: error: a pattern that matches in too many ways"),
        ("x_23.csv", "x_{a}{b}", "--from-name:1:1: error: a pattern that matches in too many ways"),
        ("x_1.2.3.csv", "x_{a}", "x_1.2.3.csv:1:1: error: the name does not match x_{a}"),
        ("x_2.csv", "x_{}", "--from-name:1:1: error: an empty text is no name"),
    ],
)
def test_names_that_do_not_tell(path: str, pattern: str, start: str) -> None:
    assert fault_of(configuration_in_name, path, pattern).startswith(start)


@given(st.text(st.sampled_from("fps=2,:.-e[ ]k{}*_"), max_size=20))
def test_any_text_is_read_or_refused(raw: str) -> None:
    for call in (
        parse_configuration,
        lambda text: configurations_to_measure([text]),
        lambda text: configuration_in_name("x_2fps.csv", text),
    ):
        with suppress(InputError):
            call(raw)  # type: ignore[no-untyped-call]

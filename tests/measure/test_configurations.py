"""Configurations as options state them."""

import itertools
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.measure.measuring import Configuration, configurations_to_measure, parse_configuration

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


def test_combinations_and_unions() -> None:
    assert values("fps=2,4,6") == [(2,), (4,), (6,)]
    assert values("fps=2,4,keysize=32,448") == [(2, 32), (2, 448), (4, 32), (4, 448)]
    assert values("fps=2,keysize=32", "keysize=448,fps=4", "fps=2,keysize=32") == [(2, 32), (4, 448)]


@given(st.lists(number, min_size=1, max_size=5, unique=True), st.lists(number, min_size=1, max_size=5, unique=True))
def test_combinations_are_the_product(first: list[float], second: list[float]) -> None:
    lists = [",".join(map(repr, each)) for each in (first, second)]
    assert values(f"a={lists[0]},b={lists[1]}") == list(itertools.product(first, second))


@pytest.mark.parametrize(
    ("raw", "start"),
    [
        ("", "--config:1:1: error: an empty text is no name=value; expected NAME=VALUE"),
        ("fps=2,,4", "--config:1:7: error: fps is empty, not a finite number"),
        ("fps=nan", "--config:1:1: error: fps is nan, not a finite number"),
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
        (["a=" + "1," * 98 + "1,b=" + "1," * 98 + "1"], "--config:1:1: error: 9801 configurations; expected at"),
    ],
)
def test_what_cannot_be_measured(stated: list[str], start: str) -> None:
    assert fault_of(configurations_to_measure, stated).startswith(start)


@given(st.text(st.sampled_from("fps=2,:.-e[ ]k{}*_"), max_size=20))
def test_any_text_is_read_or_refused(raw: str) -> None:
    for call in (parse_configuration, lambda text: configurations_to_measure([text])):
        with suppress(InputError):
            call(raw)  # type: ignore[no-untyped-call]

"""n and d(c) found in explicit stages."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eadp.io.plan.reader import read_plan
from eadp.io.plan.writer import plan_text
from eadp.io.text.streams import Text, read_text


def plan(text):
    return read_plan(Text("p", text))


def survey(laps, *, spacing="150 - 2*sqrt(4900 + c1)", rise="15 - sqrt(4900 + c1)/5", sets="[-1000, 0]\n"):
    """The survey's stages written out, every place a function of c1."""
    lines = []
    for k in range(laps):
        dx, dy = f"{k}*({spacing})", f"{k}*({rise})"
        r = "sqrt(4900 + c1)"
        lines += [
            f"0.006; 90; (x - {dx} - {r} + 115)^2 + (y - 146 - {dy})^2 - 4900 - c1",
            f"-115 + {dx}, 146 + {dy}\n{sets}".rstrip(),
            f"0.1; 270; x + 115 - {dx}",
            f"-115 + {dx}, -11 + {dy}\n{sets}".rstrip(),
            f"0.006; 90; (x + 40 - {dx})^2 + (y - 11 - {dy})^2 - 75^2",
            f"35 + {dx}, -11 + {dy}\n{sets}".rstrip(),
            f"0.1; 90; x - 35 - {dx}",
            f"35 + {dx}, 146 + {dy}\n{sets}".rstrip(),
        ]
    return "\n".join(lines) + "\n"


def test_the_published_plan_has_four_stages_and_its_header_the_other_sign(reference):
    found, findings = read_plan(read_text(str(reference / "plans/plan_specification.pln")))
    assert found.primitive_stages == 4
    assert [part.value({}) for part in found.shift] == [10, 1]
    assert [part.value({}) for part in found.header_shift] == [-10, -1]
    assert findings == []
    assert found.whole_laps


@pytest.mark.parametrize("laps", [2, 3, 7])
def test_a_shift_that_depends_on_a_parameter_is_found_as_a_formula(laps, root):
    found, _ = plan(survey(laps))
    assert found.primitive_stages == 4
    short, _ = read_plan(read_text(str(root / "plans/survey.plan")))
    for c1 in (-1000.0, -377.7, 0.0):
        for ours, known in zip(found.shift, short.shift, strict=True):
            assert ours.value({"c1": c1}) == pytest.approx(known.value({"c1": c1}), abs=1e-9)
    assert len(found.shift[0].text) < 40, "as simple as it can be written"


def test_a_lap_that_is_cut_short_still_shows_its_structure():
    text = "".join(survey(3).splitlines(keepends=True)[:-3])  # eleven stages: two whole laps and three stages
    found, _ = plan(text)
    assert found.primitive_stages == 4
    assert not found.whole_laps
    assert found.laps() is found


def test_the_smallest_n_is_found():
    lines = "".join(f"0.1; 90; x - {10 * k}\n{10 * k}, {100 + k}\n" for k in range(6))
    found, _ = plan(lines)
    assert found.primitive_stages == 1
    assert [part.value({}) for part in found.shift] == [10, 1]


@pytest.mark.parametrize(
    "change",
    [
        ("0.1; 90; x - 35 - 1*", "0.1; 270; x - 35 - 1*"),  # the other direction
        ("- 75^2\n35 + 1*", "- 76^2\n35 + 1*"),  # another radius: Eq. 2 with e_j other than 0
        ("35 + 1*(150 - 2*sqrt(4900 + c1)), -11", "36 + 1*(150 - 2*sqrt(4900 + c1)), -11"),  # a trigger moved
    ],
)
def test_one_stage_that_differs_breaks_the_structure(change):
    text = survey(3)
    assert text.count(change[0]) == 1
    assert plan(text.replace(*change))[0].primitive_stages is None


def test_laps_that_differ_in_gain_or_sets_are_not_flown_as_laps():
    text = survey(2)
    last = text.rindex("[-1000, 0]")
    found, _ = plan(text[:last] + "[-500, 0]\n")
    assert found.primitive_stages == 4
    assert not found.whole_laps


def test_found_laps_are_flown_as_laps_to_the_last_trigger():
    flown = plan(survey(3))[0].laps()
    assert flown.repeats
    assert len(flown.stages) == 4
    assert flown.ends_at_trigger
    x, y = (part.value({"c1": 0.0}) for part in flown.final)
    assert (x, y) == pytest.approx((55, 148))


@given(
    st.integers(1, 4),
    st.integers(2, 4),
    st.floats(-50, 50).map(lambda v: round(v, 2)),
    st.floats(1, 50).map(lambda v: round(v, 2)),
    st.randoms(use_true_random=False),
)
def test_generated_laps(n, laps, dx, dy, random):
    """Random circles and lines, moved: n is found, or a smaller one that also fits."""
    base = [
        (random.choice(["circle", "line"]), random.uniform(-99, 99), random.uniform(-99, 99), random.uniform(20, 80))
        for _ in range(n)
    ]
    lines = []
    for k in range(laps):
        for kind, x, y, r in base:
            x0, y0 = repr(x + k * dx), repr(y + k * dy)
            path = f"(x-({x0}))^2+(y-({y0}))^2-{r!r}^2" if kind == "circle" else f"x-({x0})+0.5*(y-({y0}))"
            lines.append(f"0.1; 90; {path}\n{x0}, {y0}\n")
    found, _ = plan("".join(lines))
    assert found.primitive_stages is not None
    assert n % found.primitive_stages == 0
    share = found.primitive_stages / n
    assert [part.value({}) for part in found.shift] == pytest.approx([dx * share, dy * share], abs=1e-6)
    assert read_plan(Text("q", plan_text(found)))[0].primitive_stages == found.primitive_stages

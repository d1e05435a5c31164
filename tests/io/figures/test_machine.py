"""The picture of a state machine: its states, the points between them, the loop of laps, and the end."""

from __future__ import annotations

from contextlib import contextmanager

import pytest
from common import ROOT
from common.plans import PARTS, WAVES
from matplotlib.figure import Figure

from eadp.io.figures import machine
from eadp.io.figures.machine import SHOWN, write_machine_figure
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text

SURVEY = (ROOT / "plans/survey.plan").read_text(encoding="utf-8")


@pytest.fixture
def drawn(monkeypatch):
    """The texts of a plan's picture."""

    def draw(plan_text, parameters=()):
        figure = Figure()

        @contextmanager
        def canvas(*_, formulas):
            yield figure

        monkeypatch.setattr(machine, "figure_file", canvas)
        write_machine_figure("machine.svg", read_plan(Text("p", plan_text))[0], parameters)
        return [text.get_text() for text in figure.axes[0].texts if text.get_text()]

    return draw


def states(texts):
    return [text for text in texts if text.startswith("$\\Gamma")]


def test_a_plan_that_repeats(drawn):
    texts = drawn(SURVEY, (-1000, 2))
    assert states(texts) == [f"$\\Gamma_{{{i}}}$" for i in (1, 2, 3, 4, "f")]
    paths = [text for text in texts if text.startswith("$\\varphi")]
    assert [text.partition(", ")[2] for text in paths] == ["circle", "line", "circle", "line"]
    assert "$p_{\\Gamma_{2}}$\n(-115, -11)" in texts
    # d = (150 − 2 √(4900 + c1), (75 − √(4900 + c1))/5) at c1 = −1000
    assert "$p_{\\Gamma_{4}}$: next lap, moved by d = (25.1, 2.5) m" in texts
    assert "from any stage:\nbeyond $p_{\\Gamma_{f}}$\n(175, 161) m" in texts


def test_laps_found_in_explicit_stages_end_at_their_last_trigger(drawn):
    stages = "".join(
        f"0.1; 90; x - {10 * k}\n{10 * k}, 100\n0.1; 270; x - {10 * k + 5}\n{10 * k + 5}, 0\n" for k in range(4)
    )
    texts = drawn(stages)
    assert len(states(texts)) == 3
    assert "$p_{\\Gamma_{2}}$: next lap, moved by d = (10, 0) m" in texts
    assert "$p_{\\Gamma_{2}}$ at or\nbeyond $p_{\\Gamma_{f}}$\n(35, 0) m" in texts


def test_segments_are_a_row_each_with_their_conditions(drawn):
    texts = drawn(PARTS, (0, 10))
    assert len(states(texts)) == 7
    assert "$p_{\\Gamma_{5}}$: next lap" in texts
    assert "$p_{\\Gamma_{5}}$ (34, 0) and s ≥ 90" in texts
    assert "$p_{\\Gamma_{6}}$\n(100, 518)" in texts
    assert len(states(drawn(WAVES))) == 3


def test_a_long_plan_leaves_out_its_middle(drawn):
    texts = drawn("".join(f"0.1; 90; x\n0, {k * k + 1}\n" for k in range(1, 100)))
    assert len(states(texts)) == SHOWN
    assert "…" in texts
    assert states(texts)[-2:] == ["$\\Gamma_{99}$", "$\\Gamma_{f}$"]

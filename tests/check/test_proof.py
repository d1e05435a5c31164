"""What sympy proves of plans, against the check by value; the limits of its process."""

import signal
import subprocess
import sys

import pytest
import sympy
from common import few
from common.plans import APPENDIX_PRINTED, APPENDIX_RIGHT, PARTS

from eadp.check import proof
from eadp.check.check import check_plan
from eadp.check.proof import AlgebraProcess, StageProof, prove_plan
from eadp.core.expressions.reader import read_expression
from eadp.errors import EadpError, ExpressionError
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text

HOSTILE = [f"max({','.join(f'c{i} - {i}*x' for i in range(1, 60))})", "0", "0"]
"""A stage whose derivatives take sympy minutes."""


def plan(text):
    return read_plan(Text("p", text))[0]


def line(path, x, y="500", box="[0, 5]"):
    return f"0.1; 90; {path}\n{x}, {y}\n{box}\n"


@pytest.mark.slow
def test_the_appendix_as_corrected_is_proven():
    proofs = prove_plan(plan(APPENDIX_RIGHT))
    assert proofs == (*[StageProof("0", "0", True)] * 4, StageProof("0"))


@pytest.mark.slow
def test_the_misprints_come_out_as_formulas():
    found = plan(APPENDIX_PRINTED)
    report = check_plan(found, proofs=prove_plan(found))
    formulas = {(item.stage, item.code): item.formula for item in report.findings if item.proven}
    assert formulas == {
        (1, "trigger-off-path"): "2*c1",
        (4, "trigger-off-next"): "5*c1 - 840*sqrt(c1 + 4900) + 58800",
        (5, "trigger-off-path"): "17*c1 - 1680*sqrt(c1 + 4900) + 117600",
    }
    # the independent value: φ at the trigger, compiled
    for (index, code), formula in formulas.items():
        on = found.stages[index - 1 if code == "trigger-off-path" else index]
        for c1 in (-2871.3, -400.0):
            value = on.path_at([c1])(*found.stages[index - 1].trigger_at([c1]))[0]
            assert float(sympy.sympify(formula).subs("c1", c1)) == pytest.approx(value, rel=1e-9)
    assert "where φ = 2*c1" in next(item.message for item in report.findings if item.stage == 1)


@pytest.mark.slow
def test_laps_are_proven_for_every_value_of_their_variables():
    proofs = prove_plan(plan(PARTS))
    assert [item.own for item in proofs] == ["0"] * 6
    assert [item.next for item in proofs] == [None, "0", "0", "0", None, None]


DIRECTIONS = [
    (line("x - c1", "c1") + line("2*x - 2*c1", "c1"), True),
    (line("3*x + 4*y - c1", "c1/3", "0") + line("6*x + 8*y - 2*c1", "c1/3", "0"), True),
    (line("x - c1", "c1") + line("2*c1 - 2*x", "c1"), False),  # the opposite sense
    (line("x - c1", "c1") + line("x - c1 + (y - 500)/9", "c1"), False),
    (line("c1*x - c1^2", "c1") + line("x - c1", "c1"), None),  # c1 may be 0: no direction there
    (line("(c1 + 1)*(x - c1)", "c1") + line("x - c1", "c1"), True),
    (line("(c1 - 6)*(x - c1)", "c1") + line("x - c1", "c1"), False),
    (line("(c1 - 3)*(x - c1)", "c1") + line("x - c1", "c1"), None),  # one sense at one end, the other at the other
]


@pytest.fixture(scope="module")
def directions():
    """Of the pairs of stages, in one plan."""
    return prove_plan(plan("".join(stages for stages, _ in DIRECTIONS)))[::2]


@pytest.mark.parametrize("pair", range(len(DIRECTIONS)))
def test_the_direction_of_travel(directions, pair):
    assert directions[pair].direction is DIRECTIONS[pair][1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", few(["75*cos(c1)*x + 75*sin(c1)*y - 5625", "(x^2 + y^2 - 5625)*exp(c1)", "sqrt(x^2 + y^2) - 75"], 1)
)
def test_identities_that_need_more_than_multiplying_out(path):
    assert prove_plan(plan(line(path, "75*cos(c1)", "75*sin(c1)")))[0].own == "0"


@pytest.mark.slow
def test_a_proof_that_takes_too_long_is_given_up_and_the_next_one_made(monkeypatch):
    monkeypatch.setattr(proof, "ANSWER_LIMIT_S", 0.5)
    with AlgebraProcess() as process:
        assert process.ask("lines", HOSTILE, [], 1, "sympy") is None
        assert process.ask("remainder", "c1 - c1", []) == "0"


@pytest.mark.slow
def test_what_sympy_cannot_do_has_no_answer():
    with AlgebraProcess() as process:
        assert process.ask("remainder", "1/(x - x)", []) is None
        assert process.ask("remainder", "*".join(f"(x-{i})" for i in range(1000)), []) is None
        assert process.ask("remainder", "x", []) == "x"


def test_no_time_no_proof(monkeypatch):
    monkeypatch.setattr(proof, "PROOFS_LIMIT_S", -1.0)
    assert prove_plan(plan(APPENDIX_RIGHT)) == (StageProof(),) * 5


def test_an_interrupt_ends_the_process(monkeypatch):
    def interrupted(_stream):
        raise KeyboardInterrupt

    process = AlgebraProcess()
    assert process.ask("remainder", "c1", []) == "c1"
    other = process._process
    monkeypatch.setattr(proof, "_read", interrupted)
    with pytest.raises(KeyboardInterrupt), process:
        process.ask("lines", HOSTILE, [], 1, "sympy")
    assert other.returncode == -signal.SIGKILL, "it did not wait for the answer"


@pytest.mark.parametrize("where", [{"executable": ""}, {"executable": "/nowhere/python"}, {"frozen": True}])
def test_without_an_interpreter_nothing_is_proven(monkeypatch, where):
    for name, value in where.items():
        monkeypatch.setattr(sys, name, value, raising=False)
    assert prove_plan(plan(APPENDIX_RIGHT)) == (StageProof(),) * 5


def test_a_missing_sympy_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(EadpError, match="sympy cannot be imported"):
        prove_plan(plan("0.1; 90; x\n0, 200\n"))


@pytest.mark.quick(1)
@pytest.mark.parametrize("options", few([("--check",), ("--format", "sympy"), ("--format", "latex")], 2))
def test_a_broken_sympy_is_bad_input_not_a_bug(tmp_path, root, options):
    (tmp_path / "sympy.py").write_text("raise ImportError('no such thing')\n")
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from eadp.__main__ import run; run()"
    command = [sys.executable, "-c", code, "plan", "plans/survey.plan", *options]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    said = "sympy cannot be imported (no such thing); install it, as in: pip install sympy\n"
    assert done.stderr == f"eadp: error: {said}"


def test_the_expressions_of_a_stage():
    x, y, c1 = sympy.symbols("x y c1", real=True)
    circle = "(x - c1)^2 + 3*y^2*x - 4", "c1 + 2", "0"
    found = proof.lines(circle, [], 3, "sympy")
    path = (x - c1) ** 2 + 3 * y**2 * x - 4
    expected = (path, path.diff(x), path.diff(y), 2, 6 * y, 6 * x, c1 + 2, 0)
    names = ["phi_3", "phi_3_x", "phi_3_y", "phi_3_xx", "phi_3_xy", "phi_3_yy", "trigger_3_x", "trigger_3_y"]
    for line, value, name in zip(found, expected, names, strict=True):
        text, named = line.split("  # ")
        assert named == name
        assert sympy.expand(sympy.sympify(text, {"x": x, "y": y, "c1": c1}) - value) == 0
    latex = proof.lines(circle, [], 3, "latex")
    assert [line.split(" = ")[0].count("{3}") for line in latex] == [1, 1, 1, 1]
    assert latex[0].endswith(sympy.latex(path))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("(c1 + 2)^2 - c1^2 - 4*c1 - 4", "0"),
        ("(c1 + 2)^2 - c1^2", "4*c1 + 4"),
        ("sin(c1)^2 + cos(c1)^2 - 1", "0"),
        ("1/(c1 - c1)", None),
        ("((c1^10)^10)^10", "c1**1000"),
    ],
)
def test_remainders(text, expected):
    assert proof.remainder(text, []) == expected


@pytest.mark.parametrize(
    ("here", "there", "sense", "sets", "expected"),
    [
        # ∇ = (1, 0) and (c1, 0)
        (("x", "0", "0"), ("c1*x", "0", "0"), 1, {"c1": (1.0, 2.0)}, True),
        (("x", "0", "0"), ("c1*x", "0", "0"), -1, {"c1": (1.0, 2.0)}, False),
        (("x", "0", "0"), ("c1*x", "0", "0"), -1, {"c1": (-2.0, -1.0)}, True),
        (("x", "0", "0"), ("c1*x", "0", "0"), 1, {"c1": (-1.0, 2.0)}, None),
        (("x", "0", "0"), ("c1*x", "0", "0"), 1, {}, None),
        (("x", "0", "0"), ("2*x", "0", "0"), 1, {}, True),
        (("x", "0", "0"), ("-2*x", "0", "0"), 1, {}, False),
        # (1, 0) and (0, 1) are not parallel; nor are (1, 0) and (1, c1)
        (("x", "0", "0"), ("y", "0", "0"), 1, {}, False),
        (("x", "0", "0"), ("x + c1*y", "0", "0"), 1, {"c1": (0.0, 1.0)}, False),
        # a circle round (0, 0) at its top, (0, 20), and a line along y, at each one's own trigger
        (("x^2 + y^2 - 100", "0", "10"), ("y", "5", "0"), 1, {}, True),
        (("x^2 + y^2 - 100", "10", "0"), ("x", "5", "7"), 1, {}, True),
        (("y", "5", "0"), ("x^2 + y^2 - 100", "0", "-10"), 1, {}, False),
    ],
)
def test_directions_at_triggers(here, there, sense, sets, expected):
    assert proof.same_direction(here, there, [], sense, sets) is expected


def test_what_sympy_says_in_words_of_its_own_is_refused():
    c1 = sympy.Symbol("c1", real=True)
    for value in (sympy.Piecewise((c1, c1 > 0), (0, True)), sympy.zoo):
        with pytest.raises(ExpressionError):
            proof.remainder(*proof._text_of(value))
    text, names = proof._text_of(sympy.Max(c1, sympy.Abs(c1)))
    assert read_expression(text, names).non_smooth in ("max", "abs")

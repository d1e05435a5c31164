"""Stages as sympy objects, against the compiled derivatives."""

import numpy as np
import pytest
import sympy
from common.plans import APPENDIX_RIGHT, PARTS, WAVES

from eadp.errors import EadpError
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import Text, read_text

ROUNDING = 1e-9


def values_at(stage, expressions, place):
    """Floats of sympy expressions at values of their symbols, by 30 digits of exact ones."""
    exact = {sympy.Symbol(name, real=True): sympy.Rational(value) for name, value in place.items()}
    return [float(expression.xreplace(exact).evalf(30)) for expression in expressions]


def check_against_derivatives(plan, seed):
    rng = np.random.default_rng(seed)
    for stage in plan.stages[:12]:
        symbolic = stage.sympy
        assert symbolic.hessian == symbolic.hessian.T
        for _ in range(3):
            c = rng.uniform(-900, 0, len(plan.names)).tolist()
            x, y = rng.uniform(-200, 200, 2).tolist()
            place = {"x": x, "y": y, **dict(zip(plan.names, c, strict=True))}
            if stage.segment:
                place |= stage.segment.values(c, stage.segment.start(c))
            (xx, xy), (_, yy) = symbolic.hessian.tolist()
            got = values_at(stage, (symbolic.path, *symbolic.gradient, xx, xy, yy), place)
            # φ is a difference of squares of hundreds of metres
            assert got == pytest.approx(stage.path_at(c)(x, y), rel=ROUNDING, abs=1e-7)
            assert values_at(stage, symbolic.trigger, place) == pytest.approx(stage.trigger_at(c), rel=ROUNDING)


def test_the_shipped_plans(root):
    files = sorted((root / "plans").glob("*.plan"))
    assert files
    for seed, file in enumerate(files):
        check_against_derivatives(read_plan(read_text(str(file)))[0], seed)


@pytest.mark.parametrize("text", [APPENDIX_RIGHT, PARTS, WAVES])
def test_plans_of_every_form(text):
    check_against_derivatives(read_plan(Text("p", text))[0], 7)


@pytest.mark.parametrize("path", ["*".join(f"(x-{i})" for i in range(1000)), "x + " + "(" * 9 + "0.5" + ")^64" * 9])
def test_what_would_keep_sympy_busy_for_hours_is_refused(path):
    stage = read_plan(Text("p", f"0.1; 90; {path}\n0, 200\n"))[0].stages[0]
    with pytest.raises(EadpError, match="too large for sympy"):
        _ = stage.sympy

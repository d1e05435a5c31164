"""Every cell of docs/notebook.ipynb and every block of docs/library.md is run, in order."""

import ast
import json
import re

import pytest
from common import ROOT

PAGE = ROOT / "docs/notebook.ipynb"


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.slow
def test_the_cells_run(monkeypatch):
    monkeypatch.chdir(ROOT / "docs")
    notebook = json.loads(PAGE.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    names: dict[str, object] = {}
    shown = []
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        assert cell["outputs"] == []
        body = ast.parse("".join(cell["source"])).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), str(PAGE), "exec"), names)
        if last is not None:
            shown.append(eval(compile(ast.Expression(last.value), str(PAGE), "eval"), names))
    assert any(line.startswith("covers") for line in names["covered"].lines)
    flight = names["flight"]
    assert repr(flight).startswith("<Flight of meadow.geojson: completed, ")
    assert len(repr(flight)) < 200
    assert [each.completed for each in names["flights"]].count(True) >= 3
    assert "waypoint" in names["mission"] or "mission" in names["mission"]


def test_repr_of_what_a_notebook_holds_is_short(monkeypatch):
    import eadp

    monkeypatch.chdir(ROOT)
    flight = eadp.simulate("plans/survey.plan", "scenarios/survey.yaml", overrides={"time_limit_s": 5})
    plan = flight.inputs.mission.plan
    assert repr(plan) == "<Plan survey.plan: 4 stages, parameters spacing, fps>"
    assert "NOT completed: time limit" in repr(flight)


LIBRARY = ROOT / "docs/library.md"


@pytest.mark.slow
def test_the_blocks_of_the_page_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    blocks = re.findall(r"```python\n(.*?)```", LIBRARY.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block.replace("runs/", f"{tmp_path}/"), str(LIBRARY), "exec"), names)
    assert len(blocks) == 9
    printed = capsys.readouterr().out
    assert "4 stages" in printed
    assert "period " in printed
    assert "wind.speed_mps cannot be -1\n" in printed
    assert (tmp_path / "notebook/flight.csv").exists()
    assert (tmp_path / "notebook/path-and-power.png").stat().st_size > 10_000

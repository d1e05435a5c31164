"""Every block of docs/library.md is run, in order."""

import re

import pytest
from common import ROOT

PAGE = ROOT / "docs/library.md"


@pytest.mark.slow
def test_the_blocks_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block.replace("runs/", f"{tmp_path}/"), str(PAGE), "exec"), names)
    assert len(blocks) == 9
    printed = capsys.readouterr().out
    assert "4 stages" in printed
    assert "period " in printed
    assert "wind.speed_mps cannot be -1\n" in printed
    assert (tmp_path / "notebook/flight.csv").exists()
    assert (tmp_path / "notebook/path-and-power.png").stat().st_size > 10_000

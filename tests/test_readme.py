"""The blocks of the README, the tutorial and the aircraft's page show what their commands print.

`PYTHONPATH=tests/support python tests/test_readme.py` writes the present output into the pages.
"""

import io
import os
import re
import shlex
import tempfile
from pathlib import Path

import pytest
from common import ROOT, few
from common.console import Console, blocks, commands, missing_links, update

from eadp.cli.main import main

README = ROOT / "README.md"
IN_ORDER = [ROOT / "docs/tutorial.md", ROOT / "docs/sorties.md", ROOT / "docs/aircraft.md"]
"""Pages whose commands use the files of those before."""
PAGES = [README, *IN_ORDER]


def test_there_is_a_block_for_each_of_the_four_commands():
    shown = {command[1] for block in blocks(README) for command in commands(block)}
    assert {"plan", "profile", "fit", "simulate"} <= shown


@pytest.mark.quick(1)
@pytest.mark.parametrize("block", blocks(README), ids=lambda block: " ".join(commands(block)[0])[:60])
def test_a_block_of_the_readme_shows_what_its_commands_print(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Console(tmp_path).fresh(block) == block


@pytest.mark.parametrize("page", few(IN_ORDER[::-1], 1), ids=lambda page: page.name)
def test_the_blocks_show_what_their_commands_print_in_this_order(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    console = Console(tmp_path)
    console.write_files(page.read_text(encoding="utf-8"))
    for block in blocks(page):
        assert console.fresh(block) == block


def test_the_pipe_of_the_readme_flies_a_mission_beside_zones(tmp_path, monkeypatch, capsys):
    (pipe,) = re.findall(r"^\| `(eadp plan .*?\| eadp simulate -)`", README.read_text(encoding="utf-8"), re.MULTILINE)
    items = "0 16 0 0 0 0 55.5 10.5 0", "3 16 0 0 0 0 55.505 10.5 60", "3 16 0 0 0 0 55.505 10.51 60"
    rows = (f"{i} 0 {item} 1" for i, item in enumerate(items))
    (tmp_path / "mission.waypoints").write_text("\n".join(["QGC WPL 110", *rows, ""]))
    (tmp_path / "zones.geojson").write_text(
        '{"type": "Polygon", "coordinates": [[[10.503, 55.504], [10.504, 55.504], [10.504, 55.506], [10.503, 55.504]]]}'
    )
    changed, flown = (shlex.split(typed)[1:] for typed in pipe.split(r" \| "))
    monkeypatch.chdir(tmp_path)
    assert main(changed) == 0
    plan = capsys.readouterr()
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(plan.out.encode())))
    assert main(flown) == 1
    answer = capsys.readouterr()
    assert (plan.err + answer.err).endswith(
        ": warning: the path leads through obstacle 1, first on the way to item 2\n"
    )
    assert "NOT completed: entered obstacle 1" in answer.out


def test_the_readme_stops_where_a_newcomer_stops():
    assert len(README.read_text(encoding="utf-8").splitlines()) < 150


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_page_and_picture_that_is_linked_exists(page):
    assert missing_links(page) == []


if __name__ == "__main__":
    for page in PAGES:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            update(page, Console(Path(folder)))

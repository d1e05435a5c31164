"""The README's blocks and the tutorial's: every command is run, and what a page shows is what its commands print.

`PYTHONPATH=tests/support python tests/test_readme.py` writes the present output into both pages.
"""

from __future__ import annotations

import os
import re
import tempfile
from pathlib import Path

import pytest
from common import ROOT
from common.console import Console, blocks, commands, missing_links, update

README = ROOT / "README.md"
TUTORIAL = ROOT / "docs/tutorial.md"
PAGES = [README, TUTORIAL]


def first_words(block):
    return " ".join(commands(block)[0])[:60]


def test_there_is_a_block_for_each_of_the_four_commands():
    shown = {command[1] for block in blocks(README) for command in commands(block)}
    assert {"plan", "profile", "fit", "simulate"} <= shown


@pytest.mark.parametrize("block", blocks(README), ids=first_words)
def test_a_block_of_the_readme_shows_what_its_commands_print(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Console(tmp_path).fresh(block) == block


def test_the_tutorials_blocks_show_what_their_commands_print_in_this_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    console = Console(tmp_path)
    console.write_files(TUTORIAL.read_text(encoding="utf-8"))
    for block in blocks(TUTORIAL):
        assert console.fresh(block) == block


def test_the_readmes_python_block_is_a_call_of_the_library(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (block,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(block, str(README), "exec"), {})
    assert capsys.readouterr().out.startswith("True 0.76")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_page_and_picture_that_is_linked_exists(page):
    assert missing_links(page) == []


if __name__ == "__main__":
    for page in PAGES:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            update(page, Console(Path(folder)))

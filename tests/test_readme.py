"""The README's blocks: every command is run, and what it shows is what comes out.

`python tests/test_readme.py` writes the present output into the README.
"""

from __future__ import annotations

import io
import re
import shlex
from contextlib import redirect_stderr, redirect_stdout

import pytest
from common import ROOT

from eadp.cli.main import main

README = ROOT / "README.md"
BLOCK = re.compile(r"```console\n\$ (?P<command>eadp (?:[^\n]*\\\n)*[^\n]*)\n(?P<output>.*?)```", re.DOTALL)
ELLIPSIS = "…\n"


def blocks():
    return list(BLOCK.finditer(README.read_text(encoding="utf-8")))


def words(block):
    return shlex.split(block["command"].replace("\\\n", " "))[1:]


def run(arguments):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        main(arguments)
    return out.getvalue() + err.getvalue()


def test_there_is_a_block_for_each_of_the_four_commands():
    commands = {words(block)[0] for block in blocks()}
    assert {"plan", "profile", "fit", "simulate"} <= commands


@pytest.mark.parametrize("block", blocks(), ids=lambda block: " ".join(words(block))[:60])
def test_a_block_shows_what_comes_out(block, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    shown = block["output"]
    arguments = [word.replace("runs/", f"{tmp_path}/runs/") for word in words(block)]
    actual = run(arguments).replace(f"{tmp_path}/", "")
    if shown.endswith(ELLIPSIS):
        assert actual.startswith(shown.removesuffix(ELLIPSIS))
    else:
        assert actual == shown


def test_every_picture_and_page_that_is_linked_is_there():
    links = re.findall(r"\]\(([^)#]+)\)|src=\"([^\"]+)\"", README.read_text(encoding="utf-8"))
    targets = [a or b for a, b in links]
    assert len(targets) >= 4
    for target in targets:
        assert target.startswith("http") or (ROOT / target).exists(), target


def update():
    """Write the present output of every block into the README; blocks cut short stay as long as they are."""

    def fresh(block):
        actual = run(words(block))
        if block["output"].endswith(ELLIPSIS):
            count = block["output"].count("\n") - 1
            actual = "".join(line + "\n" for line in actual.splitlines()[:count]) + ELLIPSIS
        return f"```console\n$ {block['command']}\n{actual}```"

    README.write_text(BLOCK.sub(fresh, README.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    update()

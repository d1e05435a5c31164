"""Places and helpers that tests share."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import pytest
from common import ROOT
from hypothesis import settings

from eadp.cli.main import main
from eadp.core import compiled

# a build is judged by the same examples each time; at a desk every run looks at new ones
settings.register_profile("build", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("build")


@dataclass
class Solution:
    """What a command line answered."""

    code: int
    out: str
    err: str


@pytest.fixture
def eadp(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    """Run a command line in the repository's root."""
    monkeypatch.chdir(ROOT)

    def run(*arguments: str) -> Solution:
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return Solution(code, captured.out, captured.err)

    return run


@pytest.fixture(autouse=True)
def _plain_code():
    """Compiled code, which a sweep in this process switches on, is off again for the next test."""
    yield
    compiled.enable(False)


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's root."""
    return ROOT


@pytest.fixture(scope="session")
def reference() -> Path:
    """Published data to compare with; tests that use it are skipped where it is absent."""
    folder = ROOT.parent / "shared" / "reference"
    if not folder.is_dir():
        pytest.skip("the published reference data are not on this machine")
    return folder

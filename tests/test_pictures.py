"""The pictures of the pages are what their commands draw today."""

import re

import numpy as np
import pytest
from common import ROOT, few
from matplotlib.image import imread
from pictures import MADE, PICTURES, make


@pytest.mark.parametrize("name", few(sorted(MADE), 1))
def test_a_picture_is_what_its_commands_draw(name, tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    kept, drawn = imread(PICTURES / name), imread(make(name, tmp_path))
    assert abs(np.array(kept.shape) - drawn.shape).max() <= 2  # of fonts drawn by another version
    height, width = np.minimum(kept.shape, drawn.shape)[:2]
    apart = np.abs(kept[:height, :width] - drawn[:height, :width]).max(axis=-1)
    assert (apart > 0.5).mean() < 0.002


def test_every_picture_is_shown():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    shown = {name for page in pages for name in re.findall(r"pictures/([\w-]+\.png)", page.read_text())}
    assert {path.name for path in PICTURES.iterdir()} == shown

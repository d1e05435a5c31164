"""Inputs that seem to mean something else than they say: an error or a warning that says so."""

from __future__ import annotations

import os

import pytest
from common.answers import refused

MEADOW = ("plans/meadow.geojson", "--min-radius", "30", "--swath", "30")


# --- names of files


@pytest.mark.parametrize(
    "command",
    [
        ("cover", "FILE", "--min-radius", "30", "--swath", "30"),
        ("cover", *MEADOW, "--avoid", "FILE"),
        ("plan", "FILE"),
        ("profile", "FILE"),
        ("fit", "FILE"),
        ("simulate", "FILE"),
        ("simulate", "plans/survey.plan", "--profile", "FILE"),
        ("simulate", "plans/survey.plan", "--energy", "FILE"),
        ("simulate", "plans/survey.plan", "--scenario", "FILE"),
        ("sweep", "FILE"),
        ("replan", "plans/survey.plan", "--telemetry", "FILE"),
        ("export", "FILE", "--to", "kml"),
        ("vehicle", "FILE"),
        ("report", "FILE"),
    ],
    ids=" ".join,
)
def test_names_that_no_file_can_have(eadp, tmp_path, command):
    os.symlink(tmp_path / "loop", tmp_path / "loop")
    for name in (tmp_path / "loop", "x" * 300, "a\0b"):
        assert refused(eadp(*(name if word == "FILE" else word for word in command)))


def test_outputs_that_no_file_can_be_are_refused_before_any_is_written(eadp, tmp_path):
    plan, picture = tmp_path / "a.plan", f"{'x' * 300}.svg"
    assert refused(eadp("cover", *MEADOW, "-o", plan, "--plot", picture), "cannot be written: File name too long")
    assert not plan.exists()

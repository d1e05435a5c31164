"""Legs in arrays: rows stay as they are while the table grows, and times are integrals over a row's nodes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from common import ROOT

from eadp.core.geometry.curves import Nodes
from eadp.io.plan.reader import read_plan
from eadp.io.text.streams import read_text
from eadp.models.plan.route import LegTable, leg_times_s

WIND, AIRSPEED = (3.0, -4.0), 15.0


@lru_cache
def survey():
    return read_plan(read_text(str(ROOT / "plans/survey.plan")))[0]


def nodes_of(rng):
    count = int(rng.integers(1, 9))
    course = rng.uniform(-math.pi, math.pi, count)
    return Nodes(rng.uniform(1, 9, count), np.cos(course), np.sin(course), rng.uniform(-0.05, 0.05, count))


def time_s(nodes, airspeed_mps):
    """The wind triangle, node by node: the nose points so that what is left across the course is nothing."""
    total = 0.0
    for metres, cosine, sine in zip(*nodes[:3], strict=True):
        course, wind = complex(cosine, sine), complex(*WIND) / complex(cosine, sine)
        nose = course * np.exp(-1j * math.asin(wind.imag / airspeed_mps))
        total += metres / ((airspeed_mps * nose + complex(*WIND)) / course).real
    return total


def test_rows_stay_as_they_are_while_the_table_grows():
    rng, plan = np.random.default_rng(3), survey()
    table, expected = LegTable(plan), []
    slower = replace(plan.stages[1], airspeed_mps=12.0)
    for _ in range(60):
        nodes, stage = nodes_of(rng), (plan.stages[0], slower)[int(rng.integers(2))]
        c1 = float(rng.uniform(-1200, 200))
        row = table.row(stage, (c1, 10.0), nodes)
        assert row == len(expected) == table.row(stage, (c1, 10.0), nodes), "one row for one leg"
        box = plan.quality_sets[stage.index - 1][0]
        share = min(max((c1 - box.lo) / (box.hi - box.lo), 0.0), 1.0) if box.hi > box.lo else 0.0
        expected.append((stage.index, share, time_s(nodes, stage.airspeed_mps or AIRSPEED)))
        if rng.integers(4) == 0:  # the arrays are asked for while it grows
            assert table.rows.stages[: row + 1].tolist() == [stage for stage, *_ in expected]
    order = rng.integers(0, 60, 200)
    rows = table.rows
    ((times,), _) = leg_times_s(rows, order, AIRSPEED, np.array([WIND]))
    stages, shares, seconds = (np.array(column)[order] for column in zip(*expected, strict=True))
    assert (rows.stages[order] == stages).all()
    assert rows.shares[order, 0] == pytest.approx(shares)
    assert times == pytest.approx(seconds, rel=1e-12)


def test_a_leg_that_the_wind_forbids_takes_for_ever():
    table = LegTable(survey())
    upwind = Nodes(np.array([5.0]), np.array([-1.0]), np.array([0.0]), np.array([0.0]))
    row = table.row(survey().stages[0], (0.0, 10.0), upwind)
    ((times,), _) = leg_times_s(table.rows, np.array([row]), AIRSPEED, np.array([(AIRSPEED + 1, 0.0)]))
    assert times.tolist() == [math.inf]

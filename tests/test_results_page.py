"""docs/results.md names what a flight's result folder holds: its files, columns and keys, no more and no fewer."""

import csv
import itertools
import json
import math
import re

import numpy as np
import pytest
from common import ROOT
from common.console import missing_links

import eadp

PAGE = ROOT / "docs/results.md"
PLAN, SCENARIO = ROOT / "plans/survey.plan", ROOT / "scenarios/survey.yaml"


def expanded(name):
    """The names that a name with braces stands for: `a.{b,c}` for `a.b` and `a.c`."""
    parts = re.split(r"\{([^}]*)\}", name)
    return ["".join(one) for one in itertools.product(*(part.split(",") for part in parts))]


def documented(section):
    """The names at the head of a section's items, in order; of the text before the first section for ""."""
    text = PAGE.read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## `(\S+)`\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE))
    rows = (sections[section] if section else text.split("\n## ")[0]).splitlines()
    heads = [row.split(": ")[0] for row in rows if row.startswith("- `")]
    return [own for row in heads for name in re.findall(r"`([^`]+)`", row) for own in expanded(name)]


def keys(value, names, prefix=""):
    """The keys of nested objects and lists of objects, dotted; parameters' names as NAME."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [key for item in value for key in keys(item, names, f"{prefix}[]")]
    if not isinstance(value, dict):
        return [prefix]
    inner = [(("NAME" if key in names else key), item) for key, item in value.items()]
    return [key for name, item in inner for key in keys(item, names, f"{prefix}.{name}" if prefix else name)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The result folder of a flight that ends early, of a plan with an origin."""
    target = tmp_path_factory.mktemp("results") / "flight"
    plan = target.parent / "survey.plan"
    known = "%: origin 55.37 10.43\n%: field -200 -200, 200 -200, 200 100, -200 100\n%: field-name Meadow\n"
    plan.write_text(known + PLAN.read_text(encoding="utf-8"), encoding="utf-8")
    overrides = {"time_limit_s": 30, "step_s": 0.05}
    overrides["vehicle.airframe.airspeed_range_mps"] = [10, 15]
    eadp.simulate(plan, scenario=SCENARIO, overrides=overrides).write(target, figure="paper")
    return target


def test_the_files(folder):
    assert {path.name + "/" * path.is_dir() for path in folder.iterdir()} == set(documented(""))
    inputs = {path.name for path in (folder / "inputs").rglob("*.*")}
    assert inputs == {"survey.plan", "survey.yaml", "pednet-jetson-nano.yaml", "overrides.txt"}


def test_the_columns_of_the_flight(folder):
    with (folder / "flight.csv").open(encoding="utf-8", newline="") as stream:
        header = next(csv.reader(stream))
    assert header == [name for name in documented("flight.csv") if name != "…"]
    rows = np.genfromtxt(folder / "flight.csv", delimiter=",", names=True)
    # latitude and longitude by the local radii of the WGS-84 ellipsoid
    a, e2, latitude = 6378137.0, 0.00669437999014, math.radians(55.37)
    across = a / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
    along = across * (1 - e2) / (1 - e2 * math.sin(latitude) ** 2)
    assert rows["lat_deg"] == pytest.approx(55.37 + np.degrees(rows["y_m"] / along), abs=1e-7)
    assert rows["lon_deg"] == pytest.approx(10.43 + np.degrees(rows["x_m"] / across / math.cos(latitude)), abs=1e-6)


@pytest.mark.quick(1)
@pytest.mark.parametrize("planner", ["joint", "paper", "static"])
def test_the_columns_of_the_estimate(folder, tmp_path, planner):
    if planner != "joint":
        folder, overrides = tmp_path / planner, {"planner.name": planner, "time_limit_s": 2}
        eadp.simulate(PLAN, scenario=SCENARIO, overrides=overrides).write(folder)
    with (folder / "estimate.csv").open(encoding="utf-8", newline="") as stream:
        header = next(csv.reader(stream))
    assert header == documented("estimate.csv")


def test_the_keys_of_the_summary(folder):
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    slowed = {"airspeeds_mps", "at_cruise"}  # where airspeeds are decided, in a sentence of the page
    assert slowed <= summary["energy_forecast"].keys()
    summary["energy_forecast"] = {key: v for key, v in summary["energy_forecast"].items() if key not in slowed}
    found = keys(summary, summary["parameters"])
    assert list(dict.fromkeys(found)) == documented("summary.json")


def test_the_keys_of_the_decisions(folder):
    lines = (folder / "decisions.jsonl").read_text(encoding="utf-8").splitlines()
    for line in lines:
        decision = json.loads(line)
        assert list(dict.fromkeys(keys(decision, decision["parameters"]))) == documented("decisions.jsonl")
        assert f"`{decision['cause']}`" in PAGE.read_text(encoding="utf-8")
        assert f"`{decision['status']}`" in PAGE.read_text(encoding="utf-8")
    assert lines


def test_the_pages_links():
    assert missing_links(PAGE) == []

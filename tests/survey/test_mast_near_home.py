"""A mast in a field, near home, that the survey's altitude clears: the climb circles above it first."""

import csv
import json

import pytest
from common import ROOT

import eadp as library

MAPPER = str(ROOT / "vehicles/mapper.yaml")
MAST = 9 + 40 / 63_000, 55.5 + 150 / 111_300


@pytest.fixture
def mast(tmp_path):
    """A field, a home 20 m beside it, and a mast of 50 m in it, 60 m from home."""

    def ring(west, south, east, north):
        corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
        return [[9 + x / 63_000, 55.5 + y / 111_300] for x, y in corners]

    field, area = ring(0, 0, 400, 300), ring(37, 147, 43, 153)
    (tmp_path / "field.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [field]}))
    feature = {"type": "Feature", "properties": {"name": "mast", "height": 50}}
    feature["geometry"] = {"type": "Polygon", "coordinates": [area]}
    (tmp_path / "mast.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    home = f"{55.5 + 150 / 111_300},{9 - 20 / 63_000}"
    return (
        tmp_path / "field.geojson",
        "--avoid",
        tmp_path / "mast.geojson",
        "--swath",
        30,
        "--altitude",
        90,
        "--home",
        home,
    )


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["dubins", "zamboni"])
def test_a_climb_circles_above_a_mast_near_home_that_the_altitude_clears(eadp, mast, tmp_path, pattern):
    """As it is covered without the mast; and above the mast flights keep half of the clearance."""
    plan, given = tmp_path / "a.plan", ("--vehicle", MAPPER, "--pattern", pattern)
    answer = eadp("cover", *mast, *given, "-o", plan)
    assert answer.code == 0
    assert "covers     100.00 %" in answer.out
    assert "an obstacle is flown over at 90 m, the highest mast of 50 m" in answer.err
    assert "before the first line" in answer.out
    wind, out = ("--set", "wind.speed_mps=3", "--set", "wind.from_deg=270"), tmp_path / "flown"
    assert eadp("simulate", plan, "--set", f"vehicle={MAPPER}", "--planner", "static", *wind, "-o", out).code == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["obstacles"] == summary["energy_forecast"]["obstacles"] == []
    above_m = [
        float(row["altitude_m"])
        for row in csv.DictReader((out / "flight.csv").read_text().splitlines())
        if abs(float(row["lon_deg"]) - MAST[0]) * 63_000 < 6 and abs(float(row["lat_deg"]) - MAST[1]) * 111_300 < 6
    ]
    assert min(above_m) > 60


@pytest.mark.slow
def test_sorties_circle_above_a_mast_near_home(eadp, mast, tmp_path):
    given = ("--vehicle", MAPPER, "--pattern", "dubins", "--sorties", 2, "-o", tmp_path / "job")
    answer = eadp("cover", *mast, *given)
    assert answer.code == 0
    assert "100.00 % covered" in answer.out
    assert "an obstacle is flown over at 90 m" in answer.err
    for row in json.loads((tmp_path / "job" / "sorties.json").read_text())["sorties"]:
        expected = library.forecast(tmp_path / "job" / row["plan"], tmp_path / "job" / "scenario.yaml")
        assert expected["obstacles"] == []

"""A survey pilot's job: a field with a pole and a boundary, flown with several packs, by the commands of its steps."""

from __future__ import annotations

import contextlib
import json

import pytest
from common import ROOT

from eadp.cli.main import main
from eadp.core.geometry.geodesy import to_geodetic_deg

pytestmark = pytest.mark.slow  # its parts have quick tests of their own
ORIGIN = (55.4, 10.3)
HOME = ",".join(map(str, to_geodetic_deg(-40, -40, ORIGIN)))


def ring(west, south, east, north):
    """A rectangle [m] as a polygon in degrees."""
    corners = [(west, south), (east, south), (east, north), (west, north), (west, south)]
    return {"type": "Polygon", "coordinates": [[[*reversed(to_geodetic_deg(*corner, ORIGIN))] for corner in corners]]}


def feature(name, *box, **properties):
    return {"type": "Feature", "properties": {"name": name} | properties, "geometry": ring(*box)}


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    """The pilot's folder: the field with its pole, the boundary, the day."""
    folder = tmp_path_factory.mktemp("pilot")
    pole = feature("avoid pole", 390, 110, 410, 130, height=35)
    features = [feature("field", 0, 0, 800, 500), pole, feature("avoid mast", 600, 300, 620, 320)]
    (folder / "field.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    (folder / "inside.geojson").write_text(json.dumps(ring(-150, -150, 950, 650)))
    day = {
        "schema": "eadp.scenario/1",
        "vehicle": str(ROOT / "vehicles/foam-wing.yaml"),
        "battery": {"capacity_ah": 0.7},
        "profile": str(ROOT / "profiles/pednet-letter.yaml"),
        "step_s": 0.05,
        "planner": {"every_s": 10},
    }
    (folder / "day.yaml").write_text(json.dumps(day))
    assert run(folder, *COVER, "--sorties", "auto", "-o", "DIR/job") == 0
    assert run(folder, "simulate", "DIR/job", "-o", "DIR/flown") == 0
    return folder


def run(folder, *words):
    with contextlib.chdir(ROOT):
        return main([word.replace("DIR", str(folder)) for word in words])


COVER = ("cover", "DIR/field.geojson", "--feature", "field", "--scenario", "DIR/day.yaml",
         "--inside", "DIR/inside.geojson", "--altitude", "102", "--swath", "60",
         "--pattern", "dubins", "--heading", "90", f"--home={HOME}")  # fmt: skip


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        ((*COVER, "--sorties", "auto"), 0, "min in the air"),
        ((*COVER, "--sorties", "auto", "--resume", "DIR/flown/sortie-01"), 0, "sorties    2, the fewest found"),
        # done is as planned, though ground beside the mast is left
        (("simulate", "DIR/job", "--set", "fps=5"), 0, "done: "),
    ],
)
def test_each_step(eadp, job, words, code, said):
    answer = eadp(*(word.replace("DIR", str(job)) for word in words))
    assert answer.code == code, answer.err
    assert said in answer.out + answer.err

"""`eadp cover --sorties`, and the doors that its folder goes through: simulate, sweep, export, resume."""

import contextlib
import csv
import json
import shutil
from dataclasses import replace

import pytest
import shapely
from common import ROOT
from common.answers import refused

import eadp as library
from eadp.cli.main import main
from eadp.survey.options import CoverageOptions
from eadp.survey.sorties import SortieOptions

MEADOW, WING = "plans/meadow.geojson", "vehicles/foam-wing.yaml"
HOME = "55.4715,10.333"
SCENARIO = {
    "schema": "eadp.scenario/1",
    "vehicle": str(ROOT / WING),
    "battery": {"capacity_ah": 1.0},
    "wind": {"speed_mps": 3, "from_deg": 240, "gust_std_mps": 0.3},
    "step_s": 0.05,
    "planner": {"every_s": 10},
}
COVER = ("cover", MEADOW, "--swath", "20", "--home", HOME, "--pattern", "dubins", "--heading", "94")


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    path = tmp_path_factory.mktemp("given") / "given.yaml"
    path.write_text(json.dumps(SCENARIO))
    return str(path)


def run(*arguments):
    """A command in the repository's root, for fixtures of the module."""
    with contextlib.chdir(ROOT):
        return main([str(argument) for argument in arguments])


@pytest.fixture(scope="module")
def folder(scenario, tmp_path_factory):
    """The sorties of the meadow."""
    target = tmp_path_factory.mktemp("job") / "job"
    assert run(*COVER, "--scenario", scenario, "--sorties", "auto", "-o", target) == 0
    return target


@pytest.fixture(scope="module")
def document(folder):
    return json.loads((folder / "sorties.json").read_text())


@pytest.fixture(scope="module")
def flown(folder, tmp_path_factory):
    """The job, flown."""
    target = tmp_path_factory.mktemp("flown") / "flown"
    assert run("simulate", folder, "-o", target) == 0
    return target


def test_each_sortie_starts_and_ends_at_home_and_keeps_the_reserve(folder, document):
    home = tuple(document["home_m"])
    assert {"scenario.yaml", "sorties.json", "sorties.svg", "sorties.png"} <= {path.name for path in folder.iterdir()}
    assert [row["plan"] for row in document["sorties"]] == [
        f"sortie-{i + 1:02d}.plan" for i in range(document["count"])
    ]
    for row in document["sorties"]:
        plan = library.read_plan(folder / row["plan"])
        x, y = (point.value([0.0] * 9) if hasattr(point, "value") else point for point in plan.site.home_m)
        assert (x, y) == pytest.approx(home, abs=1e-3)
        assert row["reserve_probability"] >= 0.95
        forecast = library.forecast(folder / row["plan"], folder / "scenario.yaml")
        assert forecast["energy_wh"] == pytest.approx(row["energy_wh"], rel=1e-9)
        assert forecast["batteries"] == 1


def ground_of(folder, rows):
    """The parts of a field that sorties of a folder cover, by their rows in sorties.json."""
    fields = (library.read_plan(folder / row["plan"]).site.field for row in rows)
    return [shapely.union_all([shapely.Polygon(ring[0]) for ring in field.parts]) for field in fields]


def test_lines_cover_the_field_once(folder, document):
    assert document["coverage"] >= 0.9999
    parts = ground_of(folder, document["sorties"])
    whole = shapely.union_all([shapely.Polygon(ring[0]) for ring in document["parts"]])
    assert shapely.union_all(parts).area == pytest.approx(whole.area, rel=1e-3)
    # no ground twice but for the overlap of lines that are cut
    assert sum(part.area for part in parts) <= whole.area * 1.02


def test_all_sorties_are_flown_with_a_fresh_pack_each(flown, document):
    job = json.loads((flown / "job.json").read_text())
    assert job["completed"]
    assert job["batteries"] == document["count"]
    assert job["reserve_kept"]
    assert job["coverage"] > 0.99
    for row in job["flights"]:
        summary = json.loads((flown / row["sortie"] / "summary.json").read_text())
        assert summary["energy_wh"] == row["energy_wh"]
        start = float((flown / row["sortie"] / "flight.csv").read_text().splitlines()[1].split(",")[8])
        assert start > 0.999, "a fresh pack"


def test_a_rest_is_planned_whatever_the_rates_of_take_off(tmp_path):
    """The forecast of a sortie holds each rate at its minimum; one that is set is of the flight."""
    (tmp_path / "field.csv").write_text("x,y\n0,0\n300,0\n300,200\n0,200\n")
    options = CoverageOptions(swath_m=60, min_radius_m=30, metres=True, home=(-30, 0), turns_off=True)
    profile = str(ROOT / "profiles/pednet-letter.yaml")
    job = library.cover_in_sorties(str(tmp_path / "field.csv"), options, SortieOptions(), profile)
    energies = [
        [sortie.spare for sortie in replace(job.planner, overrides=keys).plan().divided.sorties]
        for keys in ({}, {"parameters.fps": 10.0})
    ]
    assert energies[0] == energies[1]


@pytest.mark.usefixtures("drawn")
def test_the_camera_goes_with_the_sorties(eadp, tmp_path):
    """The size of a pixel is that asked for, not that from the aircraft's cruise altitude."""
    field, out, camera = tmp_path / "field.csv", tmp_path / "job", tmp_path / "own.yaml"
    field.write_text("x_m,y_m\n0,0\n600,0\n600,400\n0,400\n")
    camera.write_text(
        "{schema: eadp.camera/1, name: mine, sensor_width_mm: 12, sensor_height_mm: 8, image_width_px: 6000, "
        "focal_length_mm: 10, picture_interval_s: 1}"
    )
    given = ("cover", field, "--metres", "--vehicle", WING, "--home", "-50,0", "--sorties", "2", "--pattern", "dubins")
    pictures = ("--camera", camera, "--gsd", "1", "--side-overlap", "50", "--forward-overlap", "75", "-o", out)
    text = eadp(*given, *pictures).out
    assert (out / "sorties.svg").stat().st_size > 10_000
    document = json.loads((out / "sorties.json").read_text())
    # 6000 pixels of 1 cm are 60 m, 12 mm by 10 mm from 50 m; a quarter of 40 m
    assert document["gsd_cm"] == pytest.approx(1)
    shot = {"name": "mine", "altitude_m": 50, "width_m": 60, "distance_m": 10}
    assert document["camera"] == pytest.approx(shot)
    assert document["pictures"] == sum(row["pictures"] for row in document["sorties"])
    assert document["pictures"] == pytest.approx(600 * 400 / (30 * 10), rel=0.15)
    said = "camera     mine from 50 m: pictures of 60.0 m across; 1 cm a pixel; one each 10.0 m, forward overlap 75 %; "
    assert f"{said}{document['pictures']} in all" in text
    for row in document["sorties"]:
        assert library.read_plan(out / row["plan"]).site.camera == ("mine", 50, 1)


@pytest.mark.slow
def test_a_windy_day_leaves_ground_that_a_resumed_job_covers(eadp, folder, scenario, document, tmp_path):
    windy, wind = tmp_path / "windy", ("--set", "wind.speed_mps=9")
    answer = eadp("simulate", folder, *wind, "--format", "json", "--seed", "2", "-o", windy)
    job = json.loads(answer.out)
    assert (answer.code, job["completed"], job["batteries"]) == (1, False, document["count"])
    assert job["reason"] == "ground is left; eadp cover --resume plans it"
    missed = job["planned_coverage"] - job["coverage"]
    assert sum(each["share"] for each in job["left"]) == pytest.approx(missed, abs=0.01)
    rest = ("--scenario", scenario, "--wind", "9,240", "--sorties", "auto", "--resume", windy, "-o", tmp_path / "rest")
    answer = eadp(*COVER, *rest)
    assert answer.code == 0, answer.err
    again = json.loads(eadp("simulate", tmp_path / "rest", *wind, "--format", "json").out)
    assert again["completed"]
    assert job["coverage"] + again["coverage"] > 0.99


def log_of(flight, path, share=1.0):
    """A flight's folder as telemetry, up to a share of it."""
    with (flight / "flight.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    kept = rows[: int(share * len(rows))]
    lines = [{key: float(row[key]) for key in ("time_s", "x_m", "y_m")} for row in kept]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


FLOWN_SHARE = 0.4
"""Where the second flight stops: within a line, so that what it leaves of it is more than 1 % of the field."""


def test_a_job_goes_on_where_it_stopped(eadp, scenario, folder, flown, document, tmp_path):
    first, second = flown / "sortie-01", log_of(flown / "sortie-02", tmp_path / "log.jsonl", FLOWN_SHARE)
    out = tmp_path / "rest"
    answer = eadp(*COVER, "--scenario", scenario, "--sorties", "auto", "-o", out, "--resume", first, "--resume", second)
    assert answer.code == 0, answer.err
    rest = json.loads((out / "sorties.json").read_text())
    assert rest["count"] <= document["count"]
    ground = shapely.union_all(ground_of(out, rest["sorties"]))
    whole = shapely.union_all([shapely.Polygon(ring[0]) for ring in document["parts"]])
    done, begun, *others = ground_of(folder, document["sorties"])
    assert ground.intersection(done).area <= 0.02 * whole.area
    assert shapely.union_all(others).difference(ground.buffer(0.5)).area <= 0.002 * whole.area
    # of the second flight's the lines after where it stopped; a part of its time is the way
    assert begun.intersection(ground).area / begun.area == pytest.approx(1 - FLOWN_SHARE, abs=0.15)
    # as shares of the whole field, what is planned and what is flown of it
    summary = library.simulate_sorties(out, warn=lambda _: None).summary
    assert summary["planned_coverage"] == pytest.approx(ground.area / whole.area, abs=0.02)
    assert summary["coverage"] == pytest.approx(summary["planned_coverage"], abs=0.01)


@pytest.mark.slow
def test_laps_keep_their_spacing_free(eadp, tmp_path, scenario):
    out = tmp_path / "laps"
    answer = eadp("cover", MEADOW, "--swath", "20", "--min-radius", "30", "--radius", "31", "--home", HOME,
                  "--pattern", "zamboni", "--scenario", scenario, "--sorties", "auto", "-o", out)  # fmt: skip
    assert answer.code == 0, answer.err
    document = json.loads((out / "sorties.json").read_text())
    assert document["pattern"] == "zamboni"
    for row in document["sorties"]:
        plan = library.read_plan(out / row["plan"])
        assert plan.path_count == 1
        assert row["spacing_m"] <= 20 + 1e-6


@pytest.mark.parametrize(
    ("extra", "code", "words"),
    [
        (("--sorties", "0"), 2, "--sorties:1:1: error: 0 is out of range; expected from 1 to 200"),
        (("--sorties", "many"), 2, "auto, or a whole number"),
        (("--sorties", "auto", "--start", HOME), 2, "--start:1:1: error: sorties start and end at home"),
        (("--sorties", "auto", "--home", "55.9,10.333"), 1, "a pack does not last for the way to the field"),
        (("--sorties", "auto", "--resume", "plans/nothing"), 2, "cannot be read"),
        (("--sorties", "auto", "--resume", "plans"), 2, "has no flight"),
    ],
)
def test_bad_input(eadp, scenario, tmp_path, extra, code, words):
    answer = eadp(*COVER, "--scenario", scenario, "-o", tmp_path / "out", *extra)
    assert answer.code == code, answer.err
    assert words in answer.err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_too_few_sorties_are_refused(eadp, scenario, folder, document):
    count = document["count"]
    few = eadp(*COVER, "--scenario", scenario, "--sorties", str(count - 1))
    assert refused(few, "error: too few for the packs", f"expected {count} or more")
    enough = eadp(*COVER, "--scenario", scenario, "--sorties", str(count)).out
    assert f"sorties    {count}, as asked for: " in enough


@pytest.mark.slow
def test_sorties_fly_by_the_planner_of_their_scenario(eadp, tmp_path):
    """One that does not forecast turns no flight back, and decides no airspeed."""
    given = tmp_path / "given.yaml"
    given.write_text(json.dumps({**SCENARIO, "planner": {"name": "static"}}))
    assert eadp(*COVER, "--scenario", given, "--sorties", "auto", "-o", tmp_path / "job").code == 0
    one = eadp("simulate", tmp_path / "job/sortie-01.plan", "--scenario", tmp_path / "job/scenario.yaml")
    assert one.code == 0, one.err


def test_no_home_a_home_in_an_obstacle_and_a_pack_that_cannot_lift_off(eadp, scenario, tmp_path):
    bare = ("cover", MEADOW, "--swath", "20", "--scenario", scenario, "--sorties", "auto")
    assert refused(eadp(*bare), "--home:1:1: error: sorties start and end at home")
    lat, lon = map(float, HOME.split(","))
    ring = [
        [lon + dx, lat + dy] for dx, dy in ((-1e-3, -1e-3), (1e-3, -1e-3), (1e-3, 1e-3), (-1e-3, 1e-3), (-1e-3, -1e-3))
    ]
    avoid = tmp_path / "avoid.geojson"
    avoid.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    assert refused(eadp(*bare, "--home", HOME, "--avoid", avoid), "lies in an obstacle")
    weak = tmp_path / "weak.yaml"
    weak.write_text(json.dumps(SCENARIO | {"battery": {"capacity_ah": 1.0, "resistance_ohm": 5.0}}))
    assert refused(eadp(*COVER, "--scenario", weak, "--sorties", "auto"), "level flight: 80.5 W exceeds the")


@pytest.mark.slow
def test_resume_refuses_what_is_not_of_this_field(eadp, scenario, flown, tmp_path):
    target = flown
    away = tmp_path / "away.jsonl"
    away.write_text("".join(json.dumps({"time_s": t, "x_m": 9000 + 15 * t, "y_m": 9000}) + "\n" for t in range(60)))
    assert refused(eadp(*COVER, "--scenario", scenario, "--sorties", "auto", "--resume", away), "covers no ground")
    other = tmp_path / "other"
    library.simulate(ROOT / "plans/survey.plan", ROOT / "scenarios/survey.yaml",
                     overrides={"time_limit_s": 30}, warn=lambda _: None).write(other)  # fmt: skip
    assert refused(eadp(*COVER, "--scenario", scenario, "--sorties", "auto", "--resume", other), "is of another field")
    done = eadp(*COVER, "--scenario", scenario, "--sorties", "auto", "--resume", target)
    assert refused(done, "nothing is left to cover")


def test_a_damaged_folder_is_a_fault_of_its_file(eadp, folder, tmp_path):
    damaged = tmp_path / "damaged"
    shutil.copytree(folder, damaged)
    (damaged / "sorties.json").write_text('{"schema": "eadp.sorties/1"}')
    assert refused(eadp("simulate", damaged), "sorties.json:1:1: error: is damaged")
    (damaged / "sorties.json").write_text('{"schema": "eadp.sorties/9"}')
    assert refused(eadp("simulate", damaged), "schema is eadp.sorties/9")
    assert refused(eadp("simulate", folder, "--scenario", "scenarios/survey.yaml"), "beside a folder of sorties")

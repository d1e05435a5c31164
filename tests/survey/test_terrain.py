"""`eadp cover --terrain`: plans that are flown over the ground as said, exported and divided; and refusals."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from common import ROOT, few
from common.answers import refused
from common.terrains import from_corner, write_degrees, write_geotiff
from scipy.ndimage import gaussian_filter

import eadp
from eadp.api.flight import forecast
from eadp.api.inputs import load_flight
from eadp.api.plan import read_plan
from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.core.geometry.polygons import holding
from eadp.io.text.streams import read_text
from eadp.io.vehicle import read_vehicle
from eadp.survey.terrain import read_terrain

pytest.importorskip("rasterio")

ORIGIN = (55.5, 10.5)
METRES = 111_320 * math.cos(math.radians(ORIGIN[0])), 111_330.0
"""Of a degree of longitude and of latitude, about [m]."""
WING = ("--vehicle", str(ROOT / "vehicles/survey-wing.yaml"))
ENERGY_SHARE = 0.015
ROUNDING_M = 1e-6
FOLLOWED_M = 0.5
"""Difference of a height as planned and as flown, on ground of 60 %: a metre of the path, and the climb's steps [m]."""


def write_field(path, centre_deg, width_m, depth_m):
    """A rectangle round a place, as GeoJSON."""
    corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5)]
    places = [to_geodetic_deg(u * width_m, v * depth_m, centre_deg)[::-1] for u, v in corners]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [places]}))
    return str(path)


def ground(path, height):
    """A GeoTIFF of a function of x and y from the origin [m], of cells of 10 m by 15 m."""

    def of_degrees(latitudes, longitudes):
        return 100 + height((longitudes - ORIGIN[1]) * METRES[0], (latitudes - ORIGIN[0]) * METRES[1])

    return write_degrees(path, of_degrees, (55.47, 10.45), (55.53, 10.55), 1 / 7200)


def _noise(seed, cells, height_m):
    heights_m = gaussian_filter(np.random.default_rng(seed).normal(0, 1, (400, 400)), cells)
    heights_m *= height_m / heights_m.std()
    return lambda x, y: heights_m[(y / 15 + 200).astype(int) % 400, (x / 15 + 200).astype(int) % 400]


GROUNDS = {
    "3 % to the east": lambda x, y: 0.03 * x + 0 * y,
    "30 % to the east": lambda x, y: 0.3 * x + 0 * y,
    "5 % to the north": lambda x, y: 0.05 * y + 0 * x,
    "hills of 40 m, 500 m apart": lambda x, y: 40 * np.sin(np.pi * x / 250) * np.cos(np.pi * y / 250),
    "a ridge of 60 m": lambda x, y: 60 * np.exp(-(((x - 50) / 80) ** 2)) + 0 * y,
    "a step of 30 m": lambda x, y: np.where(x + 0.5 * y > 0, 30, 0.0),
    "noise 10 10": _noise(10, 10, 10),
}
GENTLE = ("3 % to the east", "5 % to the north", "noise 10 10")
"""What the wing follows everywhere."""


def flown_as_planned(field, terrain, wind, *, gentle=False, folder):
    """Plan a field over terrain, fly it, and compare heights above ground and energy with what was said."""
    plan = folder / "over.plan"
    options = eadp.CoverageOptions(swath_m=60.0, altitude_m=80.0, wind=wind, terrain=[terrain])
    found = eadp.cover(field, options, vehicle=WING[1], warn=lambda _: None)
    plan.write_text(found.text)
    speed, from_deg = map(float, wind.split(","))
    overrides = {"vehicle": WING[1], "wind.speed_mps": speed, "wind.from_deg": from_deg, "battery.capacity_ah": 30.0}
    overrides |= {"planner.name": "static"}
    flight = eadp.simulate(str(plan), overrides=overrides, warn=lambda _: None)
    assert flight.summary["completed"]
    profile, limits = found.heights, found.heights.ground.limits
    columns = flight.columns
    points = np.column_stack([columns["x_m"], columns["y_m"]])
    site = found.plan.site
    # the ground by the file again
    again = read_terrain([terrain], points[::50], site.origin_deg)
    above_m = columns["altitude_m"] + site.ground_m - again.heights_m(points)
    straight = np.array([stage.kind == "line" for stage in found.plan.stages])[columns["stage"].astype(int) - 1]
    on_line = straight & holding([found.field.outline], points)[0]
    assert on_line.sum() > 100
    assert above_m[on_line].min() >= limits.line_m - ROUNDING_M
    assert above_m.min() >= limits.clearance_m
    assert above_m[on_line].min() == pytest.approx(profile.above_m.min(), abs=FOLLOWED_M)
    assert above_m[on_line].max() == pytest.approx(profile.above_m.max(), abs=FOLLOWED_M)
    if gentle:
        assert above_m[on_line].max() <= limits.line_m + limits.tolerance_m
    said = flight.summary["energy_forecast"]["energy_wh"]
    assert said == pytest.approx(flight.summary["energy_wh"], rel=ENERGY_SHARE)
    return found, flight


@pytest.mark.slow
@pytest.mark.parametrize("name", few(GROUNDS, 2))
def test_heights_are_flown_as_planned(tmp_path, name):
    winds = ("0,0", "4,240", "7,100")
    wind = winds[list(GROUNDS).index(name) % 3]
    field = write_field(tmp_path / "field.geojson", ORIGIN, 600, 400)
    terrain = ground(tmp_path / "ground.tif", GROUNDS[name])
    flown_as_planned(field, terrain, wind, gentle=name in GENTLE, folder=tmp_path)


@pytest.mark.slow
def test_a_narrow_ridge_of_a_fine_terrain_is_flown_over_as_planned(tmp_path):
    from rasterio.warp import transform

    heights_m = np.full((600, 900), 100.0)
    for wall in range(4, 900, 37):  # 4 m wide, of cells of 2 m: most of them lie between two places 10 m apart
        heights_m[:, wall : wall + 2] += 12
    terrain = write_geotiff(tmp_path / "fine.tif", heights_m, from_corner(500000, 6150000, 2.0), "EPSG:32632")
    (longitude,), (latitude,) = transform("EPSG:32632", "EPSG:4326", [500900], [6149400])
    field = write_field(tmp_path / "field.geojson", (latitude, longitude), 500, 350)
    flown_as_planned(field, terrain, "4,240", folder=tmp_path)


@pytest.fixture(scope="module")
def slope(tmp_path_factory):
    """A field on a slope of 5 %, by a GeoTIFF and by an .hgt."""
    folder = tmp_path_factory.mktemp("slope")
    field = write_field(folder / "field.geojson", ORIGIN, 600, 400)
    return field, ground(folder / "slope.tif", lambda x, y: 0.05 * x + 0 * y)


CAMERA = ("--sensor-width-mm", 13.2, "--focal-length-mm", 8.8, "--side-overlap", "70:60", "--image-width-px", 4000)


@pytest.mark.slow
def test_json_text_and_picture_have_the_heights(eadp, slope, tmp_path):
    field, terrain = slope
    plan, plot = tmp_path / "slope.plan", tmp_path / "slope.png"
    given = (field, *WING, *CAMERA, "--altitude", "80", "--terrain", terrain)
    document = json.loads(eadp("cover", *given, "--format", "json", "-o", plan, "--plot", plot).out)
    heights = document["terrain"]
    least, mean, most = heights["height_m"]
    assert 80 - ROUNDING_M <= least < mean < most <= 88 + ROUNDING_M
    # a picture is 13.2/8.8 as wide as its height above ground, of 4000 pixels
    assert heights["gsd_cm"] == pytest.approx([100 * 1.5 * each / 4000 for each in heights["height_m"]])
    apart_m = document["spacing_m"][0]
    assert heights["side_overlap"][0] == pytest.approx(1 - apart_m / (1.5 * least), abs=0.002)
    assert heights["side_overlap"][0] >= 0.6
    assert heights["zero_m"] == pytest.approx(float(plan.read_text().split("%: ground ")[1].split()[0]), abs=0.01)
    # straight ways home over a plane: its highest place, and the clearance
    assert heights["home_altitude_m"] == pytest.approx(heights["ground_m"][1] + 20, abs=1)
    assert plot.stat().st_size > 10_000


def test_an_export_is_above_home_and_read_back_as_written(eadp, slope, tmp_path):
    field, terrain = slope
    plan, out = tmp_path / "slope.plan", tmp_path / "slope.waypoints"
    eadp("cover", field, *WING, "--swath", "60", "--altitude", "80", "--terrain", terrain, "-o", plan)
    assert eadp("export", plan, "--to", "ardupilot", "-o", out).code == 0
    assert {row.split("\t")[2] for row in out.read_text().splitlines()[2:]} == {"2", "3"}
    again = eadp("plan", out, "--format", "plan").out
    commanded = {
        line.split()[2] for text in (plan.read_text(), again) for line in text.splitlines() if "altitude" in line
    }
    assert commanded == {line.split()[2] for line in plan.read_text().splitlines() if "%: altitude" in line}
    elsewhere = eadp("export", plan, "--to", "qgc", "--home", "55.501,10.501")
    assert "the ground at the plan's home or start" in elsewhere.err


LANDING = (-450.0, 100.0, 90.0)
"""Where flights over the slope land, and how [m, °]: 35 m below home."""
HOME = (250.0, -280.0)
SLOPE_M = 0.2
"""Error of the slope's heights by the origin's distance: a degree of longitude is 0.2 % longer on the ellipsoid [m]."""


@pytest.fixture(scope="module")
def landing(slope):
    """A flight over the slope that takes off, and lands elsewhere: its plan."""
    field, terrain = slope
    place, home = (",".join(map(repr, to_geodetic_deg(*each[:2], ORIGIN))) for each in (LANDING, HOME))
    ends = {"home": home, "takeoff_deg": 45.0, "landing": f"{place},{LANDING[2]}", "wind": "0,0"}
    options = eadp.CoverageOptions(swath_m=60.0, altitude_m=80.0, terrain=[terrain], **ends)
    found = eadp.cover(field, options, vehicle=WING[1], warn=lambda _: None)
    plan = Path(field).parent / "landing.plan"
    plan.write_text(found.text)
    return plan, found


def test_a_flight_over_terrain_lands_on_the_ground_as_planned_and_forecast(landing):
    plan, found = landing
    *_, before, last = found.plan.stages
    down_m = 0.05 * (LANDING[0] - HOME[0])
    assert last.altitude_m == pytest.approx(down_m, abs=SLOPE_M)
    # as high above the ground where it lands as the known ground is long enough for; commands are quarters of a metre
    length_m = math.dist(before.trigger_at(()), last.trigger_at(()))
    assert before.altitude_m == pytest.approx(down_m + length_m * math.tan(math.radians(5)), abs=SLOPE_M + 0.25)
    assert 30 <= before.altitude_m - last.altitude_m <= 80 + 0.25
    overrides = {"vehicle": WING[1], "battery.capacity_ah": 30.0, "planner.name": "static"}
    flight = eadp.simulate(str(plan), overrides=overrides, warn=lambda _: None)
    assert flight.summary["completed"]
    assert flight.summary["energy_forecast"]["energy_wh"] == pytest.approx(flight.summary["energy_wh"], rel=0.015)
    columns = flight.columns
    up_m, above_m = columns["altitude_m"], columns["altitude_m"] - 0.05 * (columns["x_m"] - HOME[0])
    assert up_m[0] < 1
    # of an altitude commanded a model is so far behind at its greatest rate
    wing = read_vehicle(read_text(WING[1])).airframe
    behind_m = wing.climb_rates_mps(wing.airspeed_mps)[1] / wing.altitude_gain_per_s
    assert up_m[-1] == pytest.approx(down_m, abs=behind_m)
    stages = columns["stage"].astype(int)
    approach = stages == len(found.plan.stages)
    climbed = np.maximum.accumulate(above_m >= 20)
    assert above_m[climbed & ~approach].min() >= 20
    # the ground rises towards the approach by 5 %, which descends more
    height_m = up_m[approach] - down_m
    assert (above_m[approach] >= np.minimum(20, height_m / 2) - FOLLOWED_M).all()


@pytest.mark.quick(1)
@pytest.mark.parametrize("to", ["qgc", "px4", "ardupilot"])
def test_a_landing_over_terrain_is_exported_and_read_back(eadp, landing, tmp_path, to):
    plan, found = landing
    out = tmp_path / ("mission.waypoints" if to == "ardupilot" else "mission.plan")
    assert eadp("export", plan, "--to", to, "-o", out).code == 0
    overrides = {"vehicle": WING[1]}
    there, here = (load_flight(str(file), overrides=overrides) for file in (plan, out))
    assert here.world.mission.plan.stages[-1].altitude_m == pytest.approx(found.plan.stages[-1].altitude_m, abs=0.01)
    assert here.world.mission.plan.stages[-2].altitude_m == found.plan.stages[-2].altitude_m
    forecasts = [each.preflight().forecast for each in (there, here)]
    assert forecasts[1].energy_wh == pytest.approx(forecasts[0].energy_wh, rel=0.01)
    assert forecasts[1].remaining_s == pytest.approx(forecasts[0].remaining_s, rel=0.01)


def written_above_ground(eadp, plan, terrain, to, file):
    """A mission as other software has it: its altitudes above the ground of `slope`."""
    zero_m = float(plan.read_text().split("%: ground ")[1].split()[0])
    model = read_terrain([str(terrain)], np.array([HOME, LANDING[:2], (-1000.0, 0.0)]), ORIGIN)

    def ground_m(latitude, longitude):
        return float(model.known_m(np.array([to_local_m(latitude, longitude, ORIGIN)]))[0])

    text = eadp("export", plan, "--to", to).out
    if to == "qgc":
        mission = json.loads(text)
        mission["mission"]["plannedHomePosition"][2] = zero_m
        for item in mission["mission"]["items"]:
            if item.get("frame") == 3 and item["params"][4]:
                sea_m = zero_m + item["Altitude"]
                item["params"][6] = item["Altitude"] = sea_m - ground_m(*item["params"][4:6])
                item |= {"frame": 10, "AltitudeMode": 4, "AMSLAltAboveTerrain": sea_m}
        file.write_text(json.dumps(mission))
        return
    first, home, *lines = text.splitlines()
    rows = [line.split("\t") for line in lines]
    for row in rows:
        if row[2] == "3" and float(row[8]):
            row[2] = "10"
            row[10] = repr(float(row[10]) + zero_m - ground_m(float(row[8]), float(row[9])))
    file.write_text("\n".join([first, home, *("\t".join(row) for row in rows)]) + "\n")


@pytest.mark.quick(1)
@pytest.mark.parametrize(("to", "known"), [("qgc", False), ("ardupilot", True), ("ardupilot", False)])
def test_altitudes_above_ground_are_read_back_above_home(eadp, landing, slope, tmp_path, to, known):
    """Of QGroundControl with heights above the sea, too, as its `SimpleMissionItem::save` writes them."""
    plan, terrain, above, again = landing[0], slope[1], tmp_path / "above", tmp_path / "again"
    written_above_ground(eadp, plan, terrain, to, above)
    answer = eadp("plan", above, *(("--terrain", terrain) if known else ("--format", "plan")))
    again.write_text(answer.out)
    relative = tmp_path / "relative"
    eadp("export", plan, "--to", to, "-o", relative)
    there, here = (read_plan(file, warn=lambda _: None) for file in (relative, again))
    altitudes = [[stage.altitude_m for stage in each.stages] for each in (there, here)]
    if to == "ardupilot" and not known:
        assert "item 3: an altitude above ground, taken as above home; eadp plan --terrain has the ground" in answer.err
        assert altitudes[1] != pytest.approx(altitudes[0], abs=1)
        return
    assert "above ground" not in answer.err
    assert altitudes[1] == altitudes[0]
    assert here.site.ground_m == pytest.approx(float(plan.read_text().split("%: ground ")[1].split()[0]), abs=0.05)
    # forecast, flight and export read it as well
    forecasts = [forecast(file, overrides={"vehicle": WING[1]}, warn=lambda _: None) for file in (relative, again)]
    assert forecasts[1]["energy_wh"] == pytest.approx(forecasts[0]["energy_wh"], rel=1e-3)
    out = eadp("export", again, "--to", "ardupilot").out
    rows = [
        [line.split("\t")[10] for line in text.splitlines()[2:]]
        for text in (out, eadp("export", relative, "--to", "ardupilot").out)
    ]
    assert rows[0] == rows[1]


@pytest.mark.quick(1)
@pytest.mark.parametrize(("west_m", "works"), [(700, True), (200, False)])
def test_an_approach_that_meets_the_ground_is_refused(eadp, tmp_path, west_m, works):
    # a ridge across the final approach to the east, which begins about 950 m before its end
    terrain = ground(tmp_path / "ridge.tif", lambda x, y: 45 * np.exp(-(((x + 410 + west_m) / 80) ** 2)) + 0 * y)
    field = write_field(tmp_path / "field.geojson", ORIGIN, 600, 400)
    given = ("cover", field, *WING, "--swath", "60", "--altitude", "80", "--terrain", terrain)
    place = ",".join(map(repr, to_geodetic_deg(-410.0, 0.0, ORIGIN)))
    answer = eadp(*given, "--landing", f"{place},90")
    if not works:
        assert answer.code == 1
        assert "the final approach towards 90° leads into the ground at 55.5" in answer.err
        return
    assert answer.code == 0
    laps = eadp(*given, "--pattern", "zamboni")
    assert (laps.code, "laps have one altitude, and do not follow a terrain" in laps.err) == (1, True)


def test_a_mast_whose_top_is_below_home_is_in_a_plan_that_can_be_read(eadp, tmp_path):
    # home is 40 m above the ground at the mast
    terrain = ground(tmp_path / "slope.tif", lambda x, y: 0.08 * x)
    field = write_field(tmp_path / "field.geojson", ORIGIN, 500, 400)
    mast = write_field(tmp_path / "mast.geojson", to_geodetic_deg(-200, 0, ORIGIN), 10, 10)
    text = json.dumps({"type": "Feature", "properties": {"height": 10}, "geometry": json.loads(Path(mast).read_text())})
    (tmp_path / "mast.geojson").write_text(text)
    latitude, longitude = to_geodetic_deg(300, 0, ORIGIN)
    plan = tmp_path / "mast.plan"
    given = ("--swath", "60", "--altitude", "80", "--avoid", mast, "--terrain", terrain)
    answer = eadp("cover", field, *WING, *given, "--home", f"{latitude},{longitude}", "-o", plan)
    assert answer.code == 0
    assert re.search(r"height     [\d.]+ to [\d.]+ m above ground on lines, mean [\d.]+ m", answer.out)
    assert re.search(r"way home   clear of ground and obstacles at [\d.]+ m", answer.out)
    assert " height 0" in plan.read_text()
    assert eadp("plan", plan).code == 0


@pytest.mark.slow
def test_flat_ground_is_said_of_large_fields_alone(eadp, slope, tmp_path):
    small, terrain = slope
    large = write_field(tmp_path / "large.geojson", ORIGIN, 1010, 300)
    note = "the ground is taken as flat over 1.0 km; --terrain has its heights"
    given = ("--min-radius", "30", "--swath", "60")
    assert note in eadp("cover", large, *given).err
    assert note not in eadp("cover", small, *given).err
    assert note not in eadp("cover", large, *WING, "--swath", "60", "--altitude", "80", "--terrain", terrain).err


def test_what_is_refused(eadp, slope, tmp_path):
    field, terrain = slope
    given = (*WING, "--swath", "60", "--altitude", "80")
    far = write_field(tmp_path / "far.geojson", (56.5, 10.5), 600, 400)
    metres = tmp_path / "metres.csv"
    metres.write_text("x_m,y_m\n0,0\n400,0\n400,300\n0,300\n")
    over = ("--terrain", terrain)
    paper = ("--scenario", "scenarios/paper-I-static.yaml")
    for answer, message in (
        (eadp("cover", far, *given, *over), "no height at 56.49820,10.49513"),
        (eadp("cover", field, *given, "--terrain", tmp_path / "no.tif"), "no such file"),
        (eadp("cover", metres, *given, *over), "the field has no place on the earth"),
        (eadp("cover", field, *WING, "--swath", "60", *over), "no height to keep above the ground"),
        (eadp("cover", field, *given, "--height-tolerance", "5"), "no ground to be above"),
        (eadp("cover", field, *given, *over, "--height-tolerance", "0.5"), "height-tolerance"),
        (eadp("cover", field, *given, *over, "--clearance", "90"), "80 m, less than the clearance"),
        (eadp("cover", field, *paper, "--swath", "60", "--altitude", "80", *over), "holds its own altitude"),
    ):
        refused(answer, message)

"""What a log of a flight has left of a field: it covers what was photographed; its area on a raster, and its place."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from common.autopilot_logs import dataflash, ulog
from common.plans import ORIGIN

from eadp.models.airspace import Field
from eadp.survey.report import left_ground, left_text

pytest.importorskip("pymavlink")
pytest.importorskip("pyulog")

from mavlink_vehicle import Autopilot

from eadp.api.inputs import Files
from eadp.core.geometry.geodesy import to_geodetic_deg, to_local_m
from eadp.errors import InputError
from eadp.models.airspace import Airspace
from eadp.survey.cover import coverage_task
from eadp.survey.options import CoverageOptions
from eadp.survey.resume import flown_again, left_of, resumed
from eadp.survey.sorties import SortieOptions, SortiePlanner

LENGTH_M, SWATH_M, SPEED_MPS, EVERY_S = 600.0, 40.0, 10.0, 0.5
LINES = 4
WIDTH_M = LINES * SWATH_M - 0.1  # no fifth line by rounding


@pytest.fixture
def planner(tmp_path):
    """A field of four lines to the east."""
    corners = ((0, 0), (LENGTH_M, 0), (LENGTH_M, WIDTH_M), (0, WIDTH_M))
    ring = [[*reversed(to_geodetic_deg(x, y, ORIGIN))] for x, y in (*corners, corners[0])]
    path = tmp_path / "field.geojson"
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    options = CoverageOptions(min_radius_m=10, swath_m=SWATH_M, heading_deg=90, pattern="dubins", home=ORIGIN)
    task = coverage_task(str(path), options, None, None, None, lambda _: None)
    return SortiePlanner(task, SortieOptions(), Files())


def flown():
    """Times, places, whether the camera is on, and whether a picture is taken: the third line has none."""
    rows = []
    for number, on in ((0, True), (2, False)):
        for k in range(round(LENGTH_M / SPEED_MPS / EVERY_S) + 1):
            way_m = k * SPEED_MPS * EVERY_S
            x, y = LENGTH_M - way_m if number else way_m, (number + 0.5) * SWATH_M
            rows.append((100 + len(rows) * EVERY_S, *to_geodetic_deg(x, y, ORIGIN), on, on and k % 4 == 0))
    return rows


def px4(rows, *, pictures, before=False):
    """Such a flight as a ULog; with a picture before the take-off, too."""
    times = [round(1e6 * row[0]) for row in rows]
    places = [(t, *row[1:3]) for t, row in zip(times, rows, strict=True)]
    tables = {"vehicle_land_detected": ("QB", ("timestamp", "landed"), [(times[0] - 2, 0)])}
    tables["vehicle_global_position"] = ("Qdd", ("timestamp", "lat", "lon"), places)
    if before:
        tables["vehicle_land_detected"][2].insert(0, (times[0] - 4, 1))
        tables["camera_capture"] = ("QB", ("timestamp", "result"), [(times[0] - 3, 0)])
    if pictures:
        taken = [(t + 1, 0) for t, row in zip(times, rows, strict=True) if row[4]]
        return ulog(tables | {"camera_capture": ("QB", ("timestamp", "result"), taken)})
    off = next(t for t, row in zip(times, rows, strict=True) if not row[3])
    switched = [(times[0] - 1, 206.0, 20.0), (off - 1, 206.0, 0.0)]
    return ulog(tables | {"vehicle_command": ("Qff", ("timestamp", "command", "param1"), switched)})


def ardupilot(rows, *, pictures):
    """As a DataFlash log."""
    times = [round(1e6 * row[0]) for row in rows]
    places = [(t, *(round(1e7 * each) for each in row[1:3])) for t, row in zip(times, rows, strict=True)]
    tables = {"STAT": ("QB", ("TimeUS", "isFlying"), [(times[0] - 2, 1)])}
    tables["POS"] = ("QLL", ("TimeUS", "Lat", "Lng"), places)
    if pictures:
        taken = [(t + 1, 0) for t, row in zip(times, rows, strict=True) if row[4]]
        return dataflash(tables | {"CAM": ("QB", ("TimeUS", "Img"), taken)})
    off = next(t for t, row in zip(times, rows, strict=True) if not row[3])
    switched = [(times[0] - 1, 1, 206, 20.0), (off - 1, 3, 206, 0.0)]
    return dataflash(tables | {"MISE": ("QHHf", ("TimeUS", "CNum", "CId", "Prm1"), switched)})


def station(rows, *, pictures):
    """As a ground station's telemetry log, with another vehicle in it."""
    own, other, data = Autopilot(), Autopilot(system=7), b""
    frames = [(99.0, own.heartbeat(armed=True, active=True)), (99.0, other.heartbeat(armed=True, active=True))]
    for time_s, lat, lon, _, taken in rows:
        x, y = to_local_m(lat, lon, ORIGIN)
        frames.append((time_s, own.position(time_s, x, y, [SPEED_MPS, 0.0], 90.0)))
        frames.append((time_s, other.position(time_s, x, y + SWATH_M, [SPEED_MPS, 0.0], 90.0)))
        if taken and pictures:
            frames.append((time_s, own.frame("camera_trigger", round(1e6 * time_s), 0)))
    for time_s, frame in frames:
        data += struct.pack(">Q", round((1.7e9 + time_s) * 1e6)) + frame
    return data


@pytest.mark.quick(2)
@pytest.mark.parametrize("pictures", [True, False])
@pytest.mark.parametrize("made", [px4, ardupilot, station])
def test_a_log_covers_what_was_photographed(planner, tmp_path, made, pictures):
    """A line flown with the camera off is left; where a log knows no camera, each line that was flown is covered."""
    log, lines = tmp_path / "flight", 2 if made is station and not pictures else 1
    log.write_bytes(made(flown(), pictures=pictures))
    _, left = resumed(planner, [str(log)], lambda _: None)
    assert left.area_m2 == pytest.approx((LINES - lines) * SWATH_M * LENGTH_M, rel=0.01)


def test_a_picture_on_the_ground_is_none_of_the_flight(planner, tmp_path):
    """The camera's switch says what was photographed in the air."""
    log = tmp_path / "flight"
    log.write_bytes(px4(flown(), pictures=False, before=True))
    _, left = resumed(planner, [str(log)], lambda _: None)
    assert left.area_m2 == pytest.approx((LINES - 1) * SWATH_M * LENGTH_M, rel=0.01)


def test_pictures_that_are_missing_leave_ground(planner, tmp_path):
    rows = [(*row[:4], row[4] and not 120 <= row[0] < 140) for row in flown()]
    log = tmp_path / "flight"
    log.write_bytes(px4(rows, pictures=True))
    _, left = resumed(planner, [str(log)], lambda _: None)
    # 20 s without a picture, from one before to one after them, less the half pictures at either end
    missed_m = 20 * SPEED_MPS + 20 - SWATH_M
    assert left.area_m2 == pytest.approx(SWATH_M * (3 * LENGTH_M + missed_m), rel=0.01)


def test_a_log_of_the_ground_and_a_table_are_no_flight(planner, tmp_path):
    log, table, warned = tmp_path / "flight", tmp_path / "flight.csv", []
    log.write_bytes(px4(flown()[:1], pictures=True))
    table.write_text("time_s,x_m,y_m\n" + "0,0,0\n" * 100)
    for path, fault in ((log, "has no positions in the air"), (table, "is no flight; expected a folder of eadp sim")):
        with pytest.raises(InputError, match=fault):
            resumed(planner, [str(path)], warned.extend)
    assert warned == [], "once, and not of each line"


def test_the_rest_is_whole_lines(planner):
    """Lines beside each other that leave scraps between them, and short gaps along one, are no lines of their own."""
    swaying = [[(0, 20), (150, 12), (300, 27), (LENGTH_M, 20)], [(0, 60), (LENGTH_M, 68)], [(40, 100), (560, 100)]]
    lines = [tuple(tuple(map(float, point)) for point in line) for line in swaying]
    origin = to_local_m(*ORIGIN, planner.task.field.origin_deg)
    left = left_of(planner, [tuple((x + origin[0], y + origin[1]) for x, y in line) for line in lines])
    spans = planner.grid().extents(left)
    # the ends of the third line, with more than a turn between them, and the fourth
    assert sorted(map(len, spans)) == [0, 0, 1, 2]
    assert left.area_m2 == pytest.approx(SWATH_M * (LENGTH_M + 80), rel=0.01)
    again = left_of(planner, [tuple((x + origin[0], y + origin[1]) for x, y in ((0.0, 20.0), (270.0, 20.0)))])
    assert again.area_m2 == pytest.approx(SWATH_M * (4 * LENGTH_M - 270), rel=0.01)


def test_a_log_of_eadp_is_telemetry_without_its_other_lines(planner, tmp_path):
    """Its own keys are no unknown ones, and its decisions no telemetry."""
    rows = [{"time_s": k, "x_m": k * SPEED_MPS, "y_m": SWATH_M / 2} for k in range(round(LENGTH_M / SPEED_MPS) + 1)]
    plain, log = tmp_path / "telemetry.jsonl", tmp_path / "log.jsonl"
    plain.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    decision = {"kind": "decision", "time_s": 0.0, "stage": 1, "parameters": {}, "reason": "kept", "warnings": []}
    lines = [
        {"kind": "start", "schema": "eadp.replan-log/1", "eadp": "0", "inputs": ""},
        *(line for row in rows for line in ({"kind": "telemetry", **row}, decision)),
        {"kind": "mission", "items": "{}"},
    ]
    log.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    warned = []
    left = [resumed(planner, [str(path)], warned.extend)[1] for path in (plain, log)]
    assert left[0] == left[1]
    assert warned == []


def test_ground_without_room_for_a_turn_is_not_left(planner, tmp_path):
    """Within a boundary that is the field's own, lines end before it: what is beyond them is flown by no sortie."""
    task = planner.task
    bounded = replace(task.field, airspace=Airspace(boundary=(task.field.outline,)))
    home = replace(task.options, home=to_geodetic_deg(LENGTH_M / 2, WIDTH_M / 2, ORIGIN))
    wide = replace(task.motion, min_radius_m=30)
    bounded = replace(planner, task=replace(task, field=bounded, options=home, motion=wide))
    lines = bounded.free_lines(bounded.task.field)
    log = tmp_path / "log.jsonl"

    def flown_along(lines):
        rows, time_s = [], 0.0
        for (x0, y0), (x1, y1) in lines:
            count = round(abs(x1 - x0) / SPEED_MPS)
            for k in range(count + 1):
                x, y = x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count
                rows.append({"time_s": time_s + k, "x_m": x, "y_m": y})
            time_s = rows[-1]["time_s"] + 10
        log.write_text("".join(json.dumps(row) + "\n" for row in rows))
        return [str(log)]

    with pytest.raises(InputError, match="nothing is left to cover"):
        resumed(bounded, flown_along(lines), lambda _: None)
    _, left = resumed(bounded, flown_along(lines[1:]), lambda _: None)
    assert left.area_m2 > SWATH_M * LENGTH_M / 2
    assert planner.free_lines(planner.task.field) is None


@pytest.mark.parametrize(("min_share", "again"), [(0.02, True), (0.04, False)])
def test_scraps_are_measured_by_their_bare_ground(planner, monkeypatch, min_share, again):
    """A line flown 14 m beside its own leaves a strip of 14 m by 240 m, 0.035 of the field: a line is 0.25 of it."""
    x, y = to_local_m(*ORIGIN, planner.task.field.origin_deg)
    lines = [[(0, 20), (LENGTH_M, 20)], [(0, 60), (LENGTH_M, 60)], [(0, 100), (LENGTH_M, 100)],
             [(0, 140), (360, 140)], [(360, 154), (LENGTH_M, 154)]]  # fmt: skip
    flown = [tuple((a + x, b + y) for a, b in line) for line in lines]
    left = left_of(planner, flown)
    assert left is not None
    assert left.area_m2 > 0.09 * planner.task.field.area_m2
    monkeypatch.setattr("eadp.survey.resume.MIN_PART_SHARE", min_share)
    assert (flown_again(planner, left, flown) is not None) == again


BOX = ((0.0, 0.0), (600.0, 0.0), (600.0, 400.0), (0.0, 400.0))


def lines(cut=None):
    """Lines to the east over the whole field, some of them cut: number → intervals."""
    cut = cut or {}
    spans = [(20.0 + SWATH_M * i, cut.get(i, [(0.0, 600.0)])) for i in range(10)]
    return [((a, y), (b, y)) for y, parts in spans for a, b in parts]


def left_on_raster(flown, step=1.0):
    """Cells of the field beyond half a swath of every line [m²]."""
    x, y = np.meshgrid(np.arange(step / 2, 600, step), np.arange(step / 2, 400, step))
    covered = np.zeros(x.shape, dtype=bool)
    for (a, at), (b, _) in flown:
        covered |= (np.abs(y - at) < SWATH_M / 2) & (x > a) & (x < b)
    return float((~covered).sum()) * step**2


@pytest.mark.parametrize("cut", [{4: [(0, 190), (350, 600)]}, {5: [(0, 500)]}, {2: []}])
def test_a_place_has_its_area(cut):
    flown = lines(cut)
    (found,) = left_ground(Field(BOX).parts, flown, SWATH_M)
    assert found.area_m2 == pytest.approx(left_on_raster(flown), rel=0.01)
    (x, y), (number,) = found.place_m, cut
    assert abs(y - (20 + SWATH_M * number)) <= SWATH_M / 2
    assert all(not a < x < b for a, b in cut[number])


def test_all_places_the_largest_first():
    cut = {0: [(0, 550)], 2: [(0, 400)], 4: [(100, 600)], 6: [(0, 580)], 8: []}
    found = left_ground(Field(BOX).parts, lines(cut), SWATH_M)
    assert [each.area_m2 for each in found] == [pytest.approx(SWATH_M * w) for w in (600, 200, 100, 50, 20)]
    total, *places = left_text(found, 0.1617, None)
    assert total == "left       16.17 % of the field, 3.88 ha in 5 places; the largest:"
    assert [line.split(" at ")[0].strip() for line in places] == ["2.40 ha", "0.80 ha", "0.40 ha"]
    assert left_ground(Field(BOX).parts, lines(), SWATH_M) == []
    assert left_text([], 0.0, None) == []

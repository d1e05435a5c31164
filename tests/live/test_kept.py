"""What autopilots keep of items, beside missions that were sent to ArduPlane and PX4 and read back from them."""

import ast
import itertools
import json
import re

import pytest

pytest.importorskip("pymavlink")

from eadp.exchange.items import MissionItem
from eadp.exchange.writer import same_items
from eadp.live.mission import equal_items


def item(values):
    """An item of a ground station's notes: frame, command, and seven numbers, of which positions may be whole."""
    frame, command, *numbers = values[:9]
    *first, x, y, z = numbers
    scale = 1e7 if isinstance(x, int) else 1.0
    return MissionItem(command, frame, (*first, x / scale, y / scale, z))


def rows_of(path):
    """The items of a WPL file; that of a ground station has six digits of the distance between pictures."""
    rows = [line.split("\t") for line in path.read_text().splitlines()[2:]]
    rows = [[*row[:4], f"{float(row[4]):.6g}", *row[5:]] for row in rows]
    return [MissionItem(int(row[3]), int(row[2]), tuple(map(float, row[4:11]))) for row in rows]


@pytest.mark.parametrize("flight", ["A", "Lu", "X", "Z"])
def test_what_ardupilot_holds_is_what_was_sent(reference, flight):
    """Its acceptance radii are cut to whole metres, the fourth number of a landing becomes 1, frames are lost."""
    folder = reference / "autopilot/second" / flight
    pairs = re.findall(r"DIFFERS \d+ (\(.*?\)) (\(.*?\))\n", (folder / "ground-station.txt").read_text())
    for held, sent in (map(ast.literal_eval, pair) for pair in pairs):
        assert equal_items([item(held)], [item(sent)]), (held, sent)
    # items that were not replaced in flight lie where they were exported, from the first on and from the last back
    sent, held = rows_of(folder / "mission.waypoints"), rows_of(folder / "held.waypoints")
    for ours, its in ((sent, held), (sent[::-1], held[::-1])):
        kept = list(itertools.takewhile(lambda pair: same_items([pair[0]], [pair[1]]), zip(ours, its, strict=False)))
        assert len(kept) > 4
        assert all(equal_items([one], [other]) for other, one in kept)


def test_what_px4_holds_is_what_was_sent(reference):
    """Frame 3 becomes 6, and the pitch of a take-off is lost; nothing else changes."""
    folders = [path.parent for path in (reference / "autopilot/px4").glob("*/mission-held.json")]
    assert len(folders) >= 7
    for folder in folders:
        sent, held = (
            [
                item((row["frame"], row["command"], *row["p"]))
                for row in json.loads((folder / f"mission-{name}.json").read_text())
            ]
            for name in ("sent", "held")
        )
        assert equal_items(held, sent), folder.name


@pytest.mark.parametrize(
    ("command", "sent", "kept", "same"),
    [
        (16, (0.0, 50.957, 0.0, 0.0), (0.0, 50.0, 0.0, 0.0), True),
        (16, (0.0, 50.957, 0.0, 0.0), (0.0, 51.0, 0.0, 0.0), False),
        (16, (0.0, 300.0, 0.0, 0.0), (0.0, 255.0, 0.0, 0.0), True),
        (21, (0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), True),
        (21, (0.0, 0.0, 0.0, -1.0), (0.0, 0.0, 0.0, 1.0), False),
        (22, (12.4, 0.0, 0.0, 0.0), (12.0, 0.0, 0.0, 0.0), True),
        (22, (12.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), True),
        (18, (0.5, 0.0, 80.0, 1.0), (0.0, 0.0, 80.0, 1.0), False),
        (18, (1.0, 0.0, 1234.0, 1.0), (1.0, 0.0, 1230.0, 1.0), True),
        (18, (1.0, 0.0, 40.5, 1.0), (1.0, 0.0, -40.0, 1.0), False),
        (178, (0.0, 15.0, -1.0, 0.0), (0.0, 12.0, -1.0, 0.0), False),
        (2000, (0.0, 1.5, 0.0, float("nan")), (0.0, 1.0, 0.0, 0.0), True),
    ],
)
def test_a_number_is_kept_or_is_another(command, sent, kept, same):
    held, written = (MissionItem(command, 3, (*numbers, 55.0, 10.0, 60.0)) for numbers in (kept, sent))
    assert equal_items([held], [written]) is same


@pytest.mark.parametrize(("held_m", "same"), [(60.12, True), (60.14, False), (60.1239, True)])
def test_an_altitude_is_kept_in_whole_centimetres(held_m, same):
    held, written = (MissionItem(16, 3, (0.0, 2.0, 0.0, 0.0, 55.0, 10.0, up)) for up in (held_m, 60.124))
    assert equal_items([held], [written]) is same

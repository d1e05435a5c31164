"""The map of a mission's items to the stages of its plan, beside the plan's own legs and as a file."""

import json
import math

import pytest

from eadp import read_plan
from eadp.core.geometry.geodesy import to_local_m
from eadp.errors import InputError
from eadp.exchange.items import WAYPOINT
from eadp.exchange.path import PlannedPath, planned_sections
from eadp.exchange.writer import items_text, mapped_items, mission_items, parse_items, same_items
from eadp.io.text.streams import Text
from eadp.models.plan.trace import nominal_route

ORIGIN = (55.37, 10.43)


@pytest.fixture(scope="module")
def survey():
    return read_plan("plans/survey.plan")


def mapped(plan, parameters, **given):
    planned = nominal_route(plan, parameters).planned()
    path = PlannedPath("a path", planned_sections(planned.legs), ORIGIN, 50.0, 11.0, **given)
    return planned, mapped_items(mission_items(path), planned, plan.path_count)


@pytest.mark.parametrize("c1", [0.0, -400.0, -1000.0])
def test_each_waypoint_lies_on_or_outside_the_path_of_its_stage(survey, c1):
    planned, items = mapped(survey, (c1, 2.0))
    assert items[-1].last == max(k for k, leg in enumerate(planned.legs, 1) if leg.distance_m > 1e-6)
    for each in items:
        assert 1 <= each.first <= each.last <= len(planned.legs)
        assert each.parameters == (planned.parameters[each.first - 1][0],)
        if each.item.command != WAYPOINT:
            continue
        x, y = to_local_m(*each.item.parameters[4:6], ORIGIN)
        off = []
        for leg in planned.legs[each.first - 1 : each.last]:
            value, gx, gy, *_ = leg.path(x - leg.offset_m[0], y - leg.offset_m[1])
            off.append(abs(value) / max(math.hypot(gx, gy), 1e-9))
        # a corner of a fillet lies outside of its arc, by up to tan² of half an eighth of a turn
        assert min(off) < 25.0


def test_a_map_survives_its_file(survey):
    _, items = mapped(survey, (-400.0, 2.0), home_deg=(55.371, 10.431))
    again = parse_items(Text("s.items.json", items_text(items, ("c1",))), ("c1",))
    assert [each[1:] for each in again] == [each[1:] for each in items]
    assert same_items([each.item for each in items], [each.item for each in again])


def test_a_mission_that_was_changed_is_another(survey):
    items = [each.item for each in mapped(survey, (-400.0, 2.0))[1]]
    assert not same_items(items, items[:-1])
    moved = items[5]._replace(parameters=(*items[5].parameters[:4], items[5].parameters[4] + 1e-5, 10.43, 50.0))
    assert not same_items(items, [*items[:5], moved, *items[6:]])
    rounded = [
        item._replace(parameters=(*item.parameters[:4], *(round(v, 7) for v in item.parameters[4:6]), 50.0))
        for item in items
    ]
    assert same_items(items, rounded)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"path_parameters": ["c2"]}, "is of another plan"),
        ({"items": [[16, 55, 10, 1, 1]]}, "is no row of an item"),
        ({"items": [[16.5, 55, 10, 1, 1, 0]]}, "is no row of an item"),
        ({"items": [[16, 55, 10, 2, 2, 0], [16, 55, 10, 1, 1, 0]]}, "is no row of an item"),
        ({"items": "x"}, "items"),
        ({"schema": "eadp.plan/1"}, "schema"),
    ],
)
def test_a_wrong_map_is_refused_where_it_is_wrong(change, message):
    value = {"schema": "eadp.items/1", "path_parameters": ["c1"], "items": [[16, 55.0, 10.0, 1, 1, 0.0]]}
    assert parse_items(Text("m", json.dumps(value)), ("c1",))
    with pytest.raises(InputError, match=message):
        parse_items(Text("m", json.dumps(value | change)), ("c1",))

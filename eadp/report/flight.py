"""The data of a flight's page: what was flown, forecast and decided, in words and as series."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eadp.api.flight import AIRSPEEDS, REPORT, Flight, record_row
from eadp.core.geometry.curves import LINE, Point
from eadp.errors import EadpError
from eadp.io.flight import account
from eadp.io.scenario import Scenario
from eadp.io.text.json import significant
from eadp.models.plan.cursor import PlanCursor
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import Leg, leg_points, point_at
from eadp.models.plan.trace import PlanReplay, legs_from, nominal_legs
from eadp.models.weather import Wind
from eadp.models.world import World
from eadp.planning.base import TURNS_BACK
from eadp.report.page import page_html

MAX_SAMPLES = 5000
"""Most samples of a series: several for each pixel of a chart."""

DIGITS = {"t": 6, "lat": 7, "lon": 7}
"""Decimal places of series that have others than 4."""


def changes(times_s: Sequence[float], values: Sequence[Any]) -> dict[str, Any]:
    """A series that is constant between its changes: `t`, when each value starts, and `v`, the values."""
    starts = [i for i, value in enumerate(values) if i == 0 or value != values[i - 1]]
    return {"t": [round(times_s[i], 6) for i in starts], "v": [values[i] for i in starts]}


def evenly(count: int, limit: int) -> list[int]:
    """At most `limit` of the indices below `count`, evenly, the last among them."""
    every = max(1, math.ceil(count / limit))
    return [*range((count - 1) % every, count, every)]


def sampled(columns: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Some columns of `flight.csv` and their times `t`, at most `MAX_SAMPLES` rows evenly."""
    kept = evenly(len(columns["t"]), MAX_SAMPLES)
    return {name: [round(values[i], DIGITS.get(name, 4)) for i in kept] for name, values in columns.items()}


LEVEL_M = 1.0
"""Range of altitudes above which they are drawn [m]."""

MAX_HORIZONS, MAX_ROUTES = 300, 40
MAX_POINTS = 60_000
"""Most points of the plan's lines, but for two a leg."""

FAINT = 5
"""Values across the sets of the path parameters at which the plan's lines are drawn."""

CURVE_PARTS = 24
"""Most parts in which a leg that is no line is drawn, of 1 m at least."""

Row = Mapping[str, Any]


@dataclass(frozen=True)
class FlownFlight:
    """A flight as its result folder keeps it.

    Attributes
    ----------
    world : World
    scenario : Scenario
    summary : mapping
        As `summary.json`.
    columns : mapping of str to sequence of float
        The columns of `flight.csv`.
    estimates : sequence of sequences
        The rows of `estimate.csv`, its header first.
    decisions : sequence of mappings
        The lines of `decisions.jsonl`.
    """

    world: World
    scenario: Scenario
    summary: Mapping[str, Any]
    columns: Mapping[str, Sequence[float]]
    estimates: Sequence[Sequence[Any]]
    decisions: Sequence[Row]


def write_page(flight: Flight, folder: Path) -> None:
    """Write the page of a flight into its result folder."""
    rows = [record_row(record, flight.inputs.mission.plan.names) for record in flight.decisions]
    inputs, table = flight.inputs, flight.estimate_rows
    columns = {name: column.tolist() for name, column in flight.columns.items()}
    flown = FlownFlight(inputs.world, inputs.scenario, flight.summary, columns, table, rows)
    (folder / REPORT).write_text(page_html("flight", flight_data(flown)), encoding="utf-8")


def flight_data(flight: FlownFlight) -> dict[str, Any]:
    """The data of a flight's page."""
    world, summary, columns = flight.world, flight.summary, flight.columns
    plan = world.mission.plan
    rows, times = account(summary, flight.scenario, plan), columns["time_s"]
    flown = _replayed(world, columns)
    has_battery = not world.mission.battery.prescribed
    return {
        "title": plan.name.rpartition("/")[2],
        "words": [text for label, text in rows if not label],
        "completed": summary["completed"],
        "end": {key: summary[key] for key in ("reason", "duration_s", "energy_wh", "soc_final", "quality")},
        "reserve": summary["soc_reserve"] if has_battery else None,
        "reserve_kept": summary["reserve_kept"] if has_battery else None,
        "parameters": _parameters(plan, columns),
        "stage": changes(times, [*map(int, columns["stage"])]),
        "lap": changes(times, flown.laps),
        **_series(columns),
        "horizons": _horizons(flight.estimates),
        "wind": {"rows": _wind_rows(world.wind), "gust_std_mps": world.wind.gust_std_mps},
        "faults": [[fault.at_s, fault.soc_drop] for fault in world.faults],
        "field": _field(plan),
        "airspace": {
            "obstacles": [[obstacle.name, obstacle.outline] for obstacle in plan.site.airspace.obstacles],
            "boundary": plan.site.airspace.boundary,
        },
        "plan": _plan_lines(plan, flown, world.start.position_m, world.way_home and world.way_home.position_m),
        "decisions": decisions_data(
            [{**row, "parameters": plan.shown(row["parameters"])} for row in flight.decisions],
            columns,
            plan.shown(dict(zip(plan.names, world.mission.parameters, strict=True))),
        ),
        "facts": [row for row in rows if row[0]],
    }


def _parameters(plan: Plan, columns: Mapping[str, Sequence[float]]) -> list[dict[str, Any]]:
    """The parameters as they are shown: names, sets, and values over time."""
    return [
        {
            "name": parameter.label,
            "title": parameter.kind,
            "unit": parameter.unit,
            "low": parameter.shown(plan.hull(i).lo),
            "high": parameter.shown(plan.hull(i).hi),
            **changes(columns["time_s"], [*map(parameter.shown, columns[parameter.name])]),
        }
        for i, parameter in enumerate(plan.parameters)
    ]


def _replayed(world: World, columns: Mapping[str, Sequence[float]]) -> PlanReplay:
    """The plan as it was flown: its laps and turns by the logged stages, positions and parameters."""
    mission = world.mission
    names = mission.plan.names
    values = zip(*(columns[name] for name in names), strict=True) if names else itertools.repeat(())
    stages = map(int, columns["stage"])
    logged = zip(columns["time_s"], stages, columns["x_m"], columns["y_m"], values, strict=False)
    start = PlanCursor.start(mission.plan, mission.parameters, mission.rules)
    return PlanReplay(start, world.start.position_m, logged)


def _wind_rows(wind: Wind) -> list[list[float]]:
    """Times [s], and the steady wind from then on, linear in between (east, north) [m/s]."""
    return [[t, *wind.steady_at_mps(t)] for t in [row[0] for row in wind.profile] or [0.0]]


# --- series


def _series(columns: Mapping[str, Sequence[float]]) -> dict[str, Any]:
    """Position, power, charge and altitude, at fewer times."""
    times = columns["time_s"]
    path = {"x": columns["x_m"], "y": columns["y_m"], "heading": np.unwrap(columns["heading_rad"]).tolist()}
    if "lat_deg" in columns:
        path |= {"lat": columns["lat_deg"], "lon": columns["lon_deg"]}
    series = {
        "path": path,
        "power": {"w": columns["power_w"], "forecast_w": columns["power_forecast_w"]},
        "charge": {"soc": columns["soc"]},
    }
    altitude = columns.get("altitude_m", [0.0])
    if max(altitude) - min(altitude) > LEVEL_M:
        series["altitude"] = {"m": altitude}
    if AIRSPEEDS[0] in columns:
        series["airspeed"] = {"mps": columns[AIRSPEEDS[0]], "commanded_mps": columns[AIRSPEEDS[1]]}
    return {name: sampled({"t": times, **values}) for name, values in series.items()}


def _horizons(rows: Sequence[Sequence[Any]]) -> dict[str, Any]:
    """Forecasts of the power over the planner's horizon, some of them: times, horizons [s] and values [W]."""
    head, *body = rows or [[]]
    if not body:
        return {"t": [], "s": [], "w": []}
    first, horizon = head.index("forecast_0_w"), head.index("horizon_s")
    chosen = [body[i] for i in evenly(len(body), MAX_HORIZONS)]
    return {
        "t": [float(row[0]) for row in chosen],
        "s": [round(float(row[horizon]), 3) for row in chosen],
        "w": [[round(float(value), 2) for value in row[first:]] for row in chosen],
    }


def _field(plan: Plan) -> dict[str, Any] | None:
    """The field and its swath."""
    if plan.site.field is None:
        return None
    return {"rings": [ring for part in plan.site.field.parts for ring in part], "swath_m": plan.site.swath_m}


# --- decisions


def decisions_data(
    rows: Sequence[Row], columns: Mapping[str, Sequence[Any]], parameters: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """Re-plannings by column, texts by their number in a list, with the energy that was used after each.

    `parameters` are those before the first, if they are known.
    """
    changed = [
        (before is not None and row["parameters"] != before) or str(row.get("reason", "")).startswith(TURNS_BACK)
        for row, before in zip(rows, [parameters, *(row["parameters"] for row in rows)], strict=False)
    ]
    data: dict[str, Any] = {"changed": changed}
    for name in rows[0] if rows else ():
        values = [row[name] for row in rows]
        if all(value is None for value in values):
            continue
        if name in ("time_s", "stage", "lap"):
            data[name] = values
        elif any(isinstance(value, str | dict | list | tuple | bool) for value in values):
            data[name] = _coded([_short(value) for value in values])
        else:
            data[name] = [significant(value) for value in values]
    data["used_after_wh"] = _energy_after_wh(columns, [row["time_s"] for row in rows])
    return data


def _short(value: Any) -> Any:
    """A value with numbers of six significant digits."""
    if isinstance(value, dict):
        return {key: significant(number) for key, number in value.items()}
    if isinstance(value, list | tuple):
        return [significant(item) if isinstance(item, float) else item for item in value]
    return value


def _coded(values: Sequence[Any]) -> dict[str, Any]:
    """Values by their number in a list of those that differ."""
    known: dict[str, int] = {}
    places = [known.setdefault(repr(value), len(known)) for value in values]
    firsts = dict(zip(reversed(places), reversed(values), strict=True))
    return {"of": [firsts[place] for place in range(len(known))], "at": places}


def _energy_after_wh(columns: Mapping[str, Sequence[Any]], times_s: Sequence[float]) -> list[float | None]:
    """Energy used from some times to the end [Wh], of the logged power."""
    logged_s = np.array(columns["time_s"])
    power_w = np.array(columns["power_w"])
    if len(logged_s) < 2:
        return [None] * len(times_s)
    used_wh = np.concatenate([[0.0], np.cumsum(np.diff(logged_s) * (power_w[1:] + power_w[:-1]) / 7200)])
    return [significant(value) for value in (used_wh[-1] - np.interp(times_s, logged_s, used_wh)).tolist()]


# --- the plan's lines


def _plan_lines(plan: Plan, flown: PlanReplay, start: Point, home: Point | None) -> dict[str, Any]:
    """The plan's lines at all parameters and at those in force, start, final point and home."""
    turns = [flown.turns[i] for i in evenly(len(flown.turns), MAX_ROUTES)]
    routes = [(time_s, legs) for time_s, cursor, joined in turns if (legs := legs_from(cursor, joined))]
    faint = list(_faint(plan, flown.turns[0][1].parameters, start))
    count = sum(map(len, [*faint, *(legs for _, legs in routes)]))
    parts = max(2, min(CURVE_PARTS, MAX_POINTS // max(count, 1) - 1))
    last = flown.turns[-1][1]
    return {
        "stages": [stage.kind for stage in plan.stages],
        "shown": len(routes),
        "turns": len(flown.turns),
        "faint": [_polyline(legs, parts) for legs in faint],
        "routes": [[time_s, _polyline(legs, parts)] for time_s, legs in routes],
        "start": start,
        "final": point_at(plan.final_point, last.parameters, "the final point"),
        "home": home,
    }


def _faint(plan: Plan, parameters: Sequence[float], start: Point) -> Iterator[Sequence[Leg]]:
    """The nominal flight at values across the sets of the path parameters."""
    boxes = [plan.hull(i) for i in range(plan.path_count)] if plan.has_sets else []
    if all(box.fixed for box in boxes):
        return
    for share in np.linspace(0.0, 1.0, FAINT).tolist():
        values = [*(box.lo + share * (box.hi - box.lo) for box in boxes), *parameters[plan.path_count :]]
        try:
            yield nominal_legs(plan, values, start)
        except EadpError:
            continue


def _polyline(legs: Sequence[Leg], parts: int) -> list[float]:
    """Points along legs as x, y, x, y, …, rounded to 0.1 m."""
    points: list[Point] = []
    for leg in legs:
        step_m = leg.distance_m / (1 if leg.stage.kind == LINE else parts)
        points += leg_points(leg, max(step_m, 1.0))[:, :2].tolist()
    rounded = [(round(x, 1), round(y, 1)) for x, y in points]
    return [value for point, _ in itertools.groupby(rounded) for value in point]

"""The data of the page of a flight on telemetry, of the log that `eadp replan --log` keeps."""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from eadp.core.expressions.reader import read_expression
from eadp.core.geometry.geodesy import heading_rad, to_near_local_m
from eadp.errors import InputError
from eadp.io.flight import time_text
from eadp.io.page import Decisions, PageSource, Series, Steps
from eadp.io.text.json import json_lines
from eadp.io.text.streams import Text, read_text
from eadp.live.replanner import MISSION, SCHEMA, START, TELEMETRY
from eadp.models.plan.stage import PATH, Parameter

GAP_S, GAP_INTERVALS = 10.0, 10.0
"""A line breaks where samples are farther apart than this time [s], and than so many of the usual intervals."""

Row = Mapping[str, Any]

NOWHERE = {"start": None, "final": None, "home": None}
NO_PLAN: Row = {"stages": [], "shown": 0, "turns": 0, "faint": [], "routes": [], **NOWHERE}


def log_data(text: Text) -> dict[str, Any]:
    """The data of a log's page; times are from its first line.

    Raises
    ------
    InputError
        If the text is no such log, or has no telemetry.
    """
    head, *lines = json_lines(text)
    if head.get("kind") != START or head.get("schema") != SCHEMA:
        raise InputError.at(text.name, 1, 1, "is no log of eadp replan", f"a log of {SCHEMA}")
    names = _names(head)
    first_s, telemetry, decisions = _split([line for line in lines if line.get("kind") != MISSION], names)
    if not telemetry:
        raise InputError.at(text.name, 1, 1, "has no telemetry", "a log with lines of telemetry")
    times = [row["time_s"] for row in decisions]
    telemetry = _in_plane(_with_charge(telemetry, head))
    charges, end_s = _known(telemetry, "soc"), telemetry[-1]["time_s"]
    position = _series(telemetry, ("x_m", "y_m"))
    drawn = _series(telemetry, ("current_consumed_ah",))
    power = _series(telemetry, ("power_w",))
    charge = _series(telemetry, ("soc",))
    return {
        "title": text.name.rpartition("/")[2],
        "words": log_words(first_s, telemetry, decisions),
        "completed": None,
        "end": {
            "reason": "the log ends",
            "duration_s": end_s,
            "energy_wh": None,
            "soc_final": charges[-1] if charges else None,
            "quality": None,
        },
        "reserve": head.get("reserve_soc"),
        "reserve_kept": None,
        "parameters": _parameters(decisions, {each.label: each.unit for each in names.values()}),
        "stage": Steps(times, [row["stage"] for row in decisions]),
        "lap": Steps(times, [row["lap"] for row in decisions]),
        "path": Series(position[0], {"x": position[1], "y": position[2], "heading": _headings(telemetry, position)}),
        "power": Series(power[0], {"w": power[1]}),
        "charge": Series(charge[0], {"soc": charge[1]}),
        "drawn": None if charges or not drawn[0] else Series(drawn[0], {"ah": drawn[1]}),
        "horizons": {"t": [], "s": [], "w": []},
        "wind": None,
        "faults": [],
        "field": None,
        "plan": NO_PLAN,
        "decisions": Decisions(decisions, {"time_s": [], "power_w": []}),
        "facts": [["lines of telemetry", str(len(telemetry))], ["decisions", str(len(decisions))]],
    }


def _names(head: Row) -> dict[str, Parameter]:
    """What people call parameters, of the first line of a log; none of a log that does not have it."""
    return {
        each["name"]: Parameter(
            each["name"],
            PATH,
            each["title"],
            each["unit"],
            read_expression(each["stands_for"]) if "stands_for" in each else None,
        )
        for each in head.get("parameters", ())
    }


def _with_charge(telemetry: Sequence[Row], head: Row) -> list[Row]:
    """Telemetry with the charge that is left of a battery by the charge drawn, where it has that alone."""
    start, per_ah = head.get("soc"), head.get("soc_per_ah")
    if start is None or per_ah is None:
        return list(telemetry)
    drawn = "current_consumed_ah"
    return [
        {**row, "soc": max(start - per_ah * row[drawn], 0.0)}
        if row.get("soc") is None and row.get(drawn) is not None
        else row
        for row in telemetry
    ]


def _in_plane(telemetry: Sequence[Row]) -> list[Row]:
    """Telemetry with positions in metres round its first one, where it has latitudes and longitudes alone."""
    result = list[Row]()
    origin_deg: tuple[float, float] | None = None
    for row in telemetry:
        latitude, longitude = row.get("lat_deg"), row.get("lon_deg")
        point = None
        if row.get("x_m") is None and latitude is not None and longitude is not None:
            origin_deg = origin_deg or (latitude, longitude)
            point = to_near_local_m(latitude, longitude, origin_deg)
        result.append(row if point is None else {**row, "x_m": point[0], "y_m": point[1]})
    return result


def _split(lines: Sequence[Row], names: Mapping[str, Parameter]) -> tuple[float, list[Row], list[Row]]:
    """The time of the first line, telemetry in the order of time, and decisions with the names of `decisions.jsonl`.

    Parameters of decisions are as people read them, by `names`.
    """
    telemetry: list[Row] = []
    decisions: list[Row] = []
    first_s: float | None = None
    for line in lines:
        time_s = float(line["time_s"])
        first_s = time_s if first_s is None else first_s
        moved = {**line, "time_s": round(time_s - first_s, 6)}
        kept = telemetry if moved.pop("kind") == TELEMETRY else decisions
        if kept and kept[-1]["time_s"] >= moved["time_s"]:
            continue  # a clock that went back
        if kept is decisions:
            moved["soc_end"] = moved.pop("soc_end_forecast")
            for key in ("parameters", "in_force"):
                moved[key] = {
                    names[name].label if name in names else name: names[name].shown(value) if name in names else value
                    for name, value in moved[key].items()
                }
        kept.append(moved)
    return first_s or 0.0, telemetry, decisions


def _known(telemetry: Sequence[Row], name: str) -> list[float]:
    return [row[name] for row in telemetry if row.get(name) is not None]


def _series(telemetry: Sequence[Row], names: Sequence[str]) -> tuple[list[float], ...]:
    """Times and values of the lines that have all of some names, with None where there is a gap."""
    rows = [row for row in telemetry if all(row.get(name) is not None for name in names)]
    times = [row["time_s"] for row in rows]
    usual_s = statistics.median(b - a for a, b in itertools.pairwise(times)) if len(times) > 1 else 0.0
    columns: list[list[Any]] = [[] for _ in range(len(names) + 1)]
    for row in rows:
        if columns[0] and row["time_s"] - columns[0][-1] > max(GAP_S, GAP_INTERVALS * usual_s):
            for column, value in zip(columns, (columns[0][-1] + 1e-3, *[None] * len(names)), strict=True):
                column.append(value)
        for column, value in zip(columns, (row["time_s"], *(row[name] for name in names)), strict=True):
            column.append(value)
    return tuple(columns)


def _headings(telemetry: Sequence[Row], position: Sequence[Sequence[Any]]) -> list[float | None]:
    """Headings as measured, else the directions of travel [rad], without jumps of a whole turn."""
    known = {row["time_s"]: heading_rad(row["heading_deg"]) for row in telemetry if row.get("heading_deg") is not None}
    times, x, y = position
    headings: list[float | None] = []
    before = 0.0
    for i, time_s in enumerate(times):
        j = min(i + 1, len(times) - 1)
        heading = known.get(time_s)
        if x[i] is None:
            headings.append(None)
            continue
        if heading is None and x[j] is not None and (x[j], y[j]) != (x[i], y[i]):
            heading = math.atan2(y[j] - y[i], x[j] - x[i])
        before += 0.0 if heading is None else math.remainder(heading - before, math.tau)
        headings.append(before)
    return headings


def _parameters(decisions: Sequence[Row], units: Mapping[str, str]) -> list[dict[str, Any]]:
    """Parameters in force, with the range that was decided in place of their sets."""
    names = dict.fromkeys(name for row in decisions for name in row["parameters"])
    times, parameters = [row["time_s"] for row in decisions], []
    for name in names:
        values = [row["in_force"].get(name) for row in decisions]
        seen = [*filter(lambda value: value is not None, values), *(row["parameters"][name] for row in decisions)]
        range_ = {"low": min(seen), "high": max(seen)}
        unit, steps = units.get(name, ""), Steps(times, values)
        parameters.append({"name": name, "title": "range decided", "unit": unit, **range_, "steps": steps})
    return parameters


def log_words(
    first_s: float, telemetry: Sequence[Mapping[str, Any]], decisions: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Sentences on a flight on telemetry, as far as its log goes."""
    took = time_text(telemetry[-1]["time_s"])
    return [
        f"A flight on telemetry: {len(telemetry)} lines over {took}, {len(decisions)} decisions.",
        f"Times on this page are from the first line, at {first_s:.15g} s.",
    ]


PAGE = PageSource("flight", lambda _: True, lambda path, page, keep: log_data(read_text(str(path))))
"""It takes what no other takes, and says what is wrong with it."""

"""A flight's settings and figures in words, as commands and pages print them."""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eadp.core.arrays import Column
from eadp.core.geometry.curves import LINE, Point
from eadp.core.geometry.geodesy import compass_deg
from eadp.errors import counted
from eadp.io.scenario import Scenario, battery_keys
from eadp.models.airspace import BOUNDARY, risk_text
from eadp.models.battery import LOSS
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import TRIGGER_DISTANCE
from eadp.models.plan.trace import nominal_legs


def setting_text(scenario: Scenario) -> str:
    """The aircraft, battery and wind of a flight, and which of them are defaults."""
    keys, chosen = scenario.keys, scenario.chosen
    airframe, battery, wind = keys.vehicle.airframe, keys.battery, keys.wind
    east, north = wind.steady_mps
    speed = math.hypot(east, north)
    mass = f" of {airframe.mass_kg:g} kg" if airframe.takes_commands else ""
    stated = f", by its data sheet: power ± {100 * airframe.power_std_share:.0f} %" if keys.vehicle.data_sheet else ""
    stated_ohm = "resistance_ohm" in battery_keys(scenario.document, keys.vehicle.battery) or battery.cells is None
    assumed = "" if stated_ohm else f" (assumed: {1000 * battery.resistance_ohm:.3g} mΩ)"
    shown = {
        "airframe": f"{keys.vehicle.name or airframe.model}{mass} at {airframe.airspeed_mps:g} m/s{stated}",
        "battery": f"battery {battery.voltage_v:.4g} V, {battery.capacity_ah:.4g} Ah{assumed}",
        "wind": f"wind {speed:g} m/s"
        + (f" from {(compass_deg(math.atan2(north, east)) + 180) % 360:.0f}°" if speed else "")
        + (f" at take-off, up to {wind.speeds_mps[1]:g} m/s" if wind.profile else ""),
    }
    return "; ".join(text + ("" if key in chosen else " (default)") for key, text in shown.items())


def counted_text(scenario: Scenario, plan: Plan, expected: Mapping[str, Any]) -> str:
    """What a forecast before take-off counts: the parameters, the airspeed and the losses."""
    cruise_mps = scenario.keys.vehicle.airframe.airspeed_mps
    parts = [
        f"{item.label} {item.shown(value):.4g} {item.unit}".strip()
        for item in plan.parameters
        if isinstance(value := expected["parameters"].get(item.name), int | float)
    ]
    speeds = expected.get("airspeeds_mps") or [stage.airspeed_mps or cruise_mps for stage in plan.stages]
    return "; ".join([*parts, airspeeds_text(speeds), losses_text(scenario)])


def losses_text(scenario: Scenario) -> str:
    """The sudden losses of charge that a forecast before take-off counts."""
    rate = getattr(scenario.planner.own, "loss_rate_per_h", 0.0)
    return f"{rate:g} sudden losses of charge an hour, {100 * LOSS:.0f} % each" if rate else "no sudden loss of charge"


Account = list[tuple[str, str]]
"""Labels and texts."""


def account(summary: Mapping[str, Any], scenario: Scenario, plan: Plan) -> Account:
    """A flight for people, as commands and pages print it; how it ended has no label."""
    power, decisions, endurance_s = summary["power_w"], summary["decisions"], summary["endurance_s"]
    done = "completed" if summary["completed"] else "NOT completed"
    km = f"{summary['distance_m'] / 1000:.2f} km"
    energy = f"{summary['energy_wh']:.3f} Wh; power mean {power['mean']:.2f} W"
    kept = f"reserve of {100 * summary['soc_reserve']:g} % {'kept' if summary['reserve_kept'] else 'not kept'}"
    rows = [
        ("aircraft", setting_text(scenario)),
        *_expected(summary, scenario, plan),
        ("", f"{done}: {summary['reason']} after {summary['duration_s']:.2f} s, {km}"),
        *(("airspace", _entry_text(each)) for each in summary["obstacles"]),
        ("energy", f"{energy}, from {power['min']:.2f} to {power['max']:.2f} W"),
        ("battery", f"{100 * summary['soc_final']:.1f} % of the charge at the end; {kept}"),
    ]
    if summary["turned_back_m"] is not None:
        x, y = summary["turned_back_m"]
        rows.append(("home", f"decided at {summary['turned_back_s']:.2f} s, at ({x:.0f}, {y:.0f}) m"))
    if endurance_s is not None:
        rows.append(("endurance", f"{endurance_s / 60:.1f} min on a full battery, as flown"))
    rows += [(values.get("title") or name, parameter_text(values)) for name, values in summary["parameters"].items()]
    if summary["quality"] is not None:
        ends = "0: widest lines, lowest rates; 1: densest lines, full rates, to the end"
        rows.append(("quality", f"{summary['quality']:.3f} of 1 ({ends})"))
    if summary["coverage"] is not None:
        rows.append(("covered", f"{100 * summary['coverage']:.2f} % of the field, by the lines flown"))
    replans = f"; re-planned {decisions} times" if decisions else ""
    rows.append(("planner", f"{summary['planner']}{replans}"))
    return [*rows, *([("solver", failures)] if (failures := solver_text(summary)) else [])]


def _entry_text(entry: Mapping[str, Any]) -> str:
    """An obstacle that a flight was in, or the boundary that it was beyond."""
    where = "beyond" if entry["name"] == BOUNDARY else "in"
    return f"{where} {entry['name']} from {entry['entered_s']:.1f} s on, {entry['inside_m']:.0f} m"


def _slowed(expected: Mapping[str, Any]) -> Account:
    """What another airspeed than the aircraft's own buys."""
    if "at_cruise" not in expected:
        return []
    own = expected["at_cruise"]
    minutes = f"{expected['time_s'] / 60:.0f} min"
    if (own["completes_probability"] or 0.0) < 0.5:
        instead = "the battery does not last"
    else:
        instead = f"{own['time_s'] / 60:.0f} min"
        if expected["quality"] is not None and own["quality"] is not None:
            better, worse = (f"with a quality of {each['quality']:.2f}" for each in (expected, own))
            minutes, instead = f"{minutes} {better}", f"{instead} {worse}"
    flown = airspeeds_text(expected["airspeeds_mps"])
    return [("airspeed", f"{flown}: {minutes}; at {own['airspeed_mps']:g} m/s {instead}")]


def _reach(expected: Mapping[str, Any]) -> Account:
    """How far one pack carries a mission that it does not finish, and how many it takes."""
    if expected["batteries"] == 1:
        return []
    if expected["batteries"] is None:
        return [("one pack", "leaves no reserve anywhere")]
    x, y = expected["reach_m"]
    covers = f"covers {100 * expected['reach_share']:.0f} % with its reserve kept, to ({x:.0f}, {y:.0f}) m at "
    more = f"{expected['reach_s']:.0f} s; without ways home it takes {expected['batteries']} or more: "
    return [("one pack", f"{covers}{more}eadp cover --sorties auto")]


def _expected(summary: Mapping[str, Any], scenario: Scenario, plan: Plan) -> Account:
    """What was to be expected before take-off, with what is counted."""
    expected = summary["energy_forecast"]
    if expected is None:
        past = summary["never_past"]
        return [("forecast", f"finishes: 0 % sure, never past {past}")] if past else []
    energy = f"{expected['energy_wh']:.2f} ± {expected['energy_std_wh']:.2f} Wh"
    times = f"{expected['time_s']:.0f} ± {expected['time_std_s']:.0f} s"
    left = expected["soc_end"]
    charge = f"{'lands with' if left > 0 else 'short by'} {100 * abs(left):.0f} ± {100 * expected['soc_end_std']:.0f} %"
    home = []
    if expected["turn_back_s"] is not None:
        x, y = expected["turn_back_m"]
        at = f"at {expected['turn_back_s']:.0f} s, ({x:.0f}, {y:.0f}) m"
        home = [("home", f"latest turn-back to keep the reserve: {at}")]
    finishes, keeps = (f"{100 * expected[f'{what}_probability']:.0f} % sure" for what in ("completes", "reserve"))
    stated = f"{charge} of the charge; keeps the reserve: {keeps}; {energy} in {times}"
    autopilot = f"{expected.get('autopilot')}; the simulated flight does not"
    return [
        ("forecast", f"finishes: {finishes}; {stated}"),
        ("counts", counted_text(scenario, plan, expected)),
        *_slowed(expected),
        *_reach(expected),
        *home,
        *([("autopilot", autopilot)] if "autopilot" in expected else []),
        *(("airspace", risk_text(each["name"], each["probability"])) for each in expected["obstacles"]),
    ]


def airspeeds_text(airspeeds_mps: Sequence[float]) -> str:
    """The least and the greatest of airspeeds, which may be one."""
    low, high = f"{min(airspeeds_mps):.3g}", f"{max(airspeeds_mps):.3g}"
    return f"{low} m/s" if low == high else f"{low} to {high} m/s"


def value_of(values: Mapping[str, Any], key: str) -> str:
    """A parameter's first, last or mean value as people read it: of what it stands for, with its unit."""
    shown = values.get("shown")
    return f"{values[key]:.4g}" if shown is None else f"{shown[key]:.4g} {values['unit']}".strip()


def parameter_text(values: Mapping[str, Any]) -> str:
    """A parameter over a flight: its mean, its first and last value, and its changes."""
    first, last, changes = value_of(values, "first"), value_of(values, "last"), values["changes"]
    if not changes:
        return f"{first}, no change"
    return f"mean {value_of(values, 'mean')}, first {first}, last {last}, {counted(changes, 'change')}"


MAX_INTERVAL_S = 2.0
"""Longest interval of a log from which the ground covered can be computed [s]."""

Line = tuple[Point, ...]


def covering_stages(plan: Plan) -> list[bool]:
    """Whether each stage covers ground: lines, as turns are banked; with a camera, those on which it is on."""
    switches = [[c[1] > 0 for c in stage.commands if c[0] == TRIGGER_DISTANCE] for stage in plan.stages]
    on, found = not any(switches), []
    for stage, states in zip(plan.stages, switches, strict=True):
        on = states[-1] if states else on
        found.append(on and stage.kind == LINE)
    return found


def planned_lines(plan: Plan, parameters: Sequence[float]) -> list[Line]:
    """The lines of a plan that cover ground. Raises PathUndefined."""
    covers = covering_stages(plan)
    legs = (leg for leg in nominal_legs(plan, parameters) if leg.stage.kind == LINE)
    return [(leg.start_m, leg.end_m) for leg in legs if covers[leg.stage.index - 1]]


def flown_lines(plan: Plan, columns: Mapping[str, Column]) -> list[Line]:
    """The paths flown on stages that cover ground; `columns` are those of `flight.csv`."""
    stages = np.array(columns["stage"], dtype=int)
    on_line = np.array(covering_stages(plan))[stages - 1]
    ends = [0, *(np.flatnonzero(np.diff(stages)) + 1).tolist(), len(stages)]
    x, y = columns["x_m"], columns["y_m"]
    # to the first sample of the next stage, which starts between the two
    return [tuple(zip(x[a : b + 1], y[a : b + 1], strict=True)) for a, b in itertools.pairwise(ends) if on_line[a]]


def flown_of_plan(columns: Mapping[str, Column], turned_back_s: float | None) -> Mapping[str, Column]:
    """The columns of `flight.csv` up to where the flight turned back for home [s], if it did."""
    if turned_back_s is None:
        return columns
    end = bisect.bisect_right(columns["time_s"], turned_back_s)
    return {name: values[:end] for name, values in columns.items()}


def flown_coverage(plan: Plan, columns: Mapping[str, Column]) -> float | None:
    """The share of the plan's field that is covered; None where it has none or no swath, or the log is too coarse."""
    times = columns["time_s"]
    if plan.site.field is None or plan.site.swath_m is None or len(times) < 2 or max(np.diff(times)) > MAX_INTERVAL_S:
        return None
    from eadp.core.geometry.polygons import covered_share

    return covered_share(plan.site.field.parts, flown_lines(plan, columns), plan.site.swath_m)


def solver_text(summary: Mapping[str, Any]) -> str | None:
    """Runs of the solver that failed, and the decisions of the fallback, of a flight's summary; None without any."""
    solver = summary["solver"]
    if not (solver["failed"] or solver["fallbacks"]):
        return None
    runs = f"{solver['failed']} of {solver['calls']} runs FAILED"
    return f"{solver['fallbacks']} of {summary['replans']} decisions by the fallback: OSQP did not solve ({runs})"

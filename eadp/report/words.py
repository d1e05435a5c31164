"""What happened in a flight, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from eadp.io.flight import label_of, percent_text, reserve_text, time_text, times_text, value_of
from eadp.models.airspace import risk_text
from eadp.models.battery import LIMITS, BatteryFault
from eadp.planning.base import INFEASIBLE, TURNS_BACK

SHOWN = 3
"""Most changes that are named one by one."""


def flight_words(
    summary: Mapping[str, Any], decisions: Sequence[Mapping[str, Any]], faults: Sequence[BatteryFault]
) -> list[str]:
    """Sentences on a flight: how it ended, its charge, what was forecast, what decided, what it cost."""
    return [
        _end(summary),
        *_charge(summary, faults),
        *_forecast(summary),
        *_changes(summary, decisions),
        *_turned_back(decisions),
        *_quality(summary),
        *_coverage(summary),
    ]


def _end(summary: Mapping[str, Any]) -> str:
    verb = "completed" if summary["completed"] else "did not complete"
    after = f"after {time_text(summary['duration_s'])} and {summary['distance_m'] / 1000:.2f} km"
    return f"The flight {verb}: {summary['reason']} {after}."


def _charge(summary: Mapping[str, Any], faults: Sequence[BatteryFault]) -> list[str]:
    soc, reserve, power = summary["soc_final"], summary["soc_reserve"], summary["power_w"]["mean"]
    kept = reserve_text(summary)
    mean = f", {power:.1f} W on average" if power is not None else ""
    words = [
        f"It used {summary['energy_wh']:.2f} Wh{mean}. The charge at the end was {percent_text(soc)}; "
        f"the reserve of {percent_text(reserve)} was {kept}."
    ]
    for fault in faults:
        if fault.at_s <= summary["duration_s"]:
            words.append(f"At {fault.at_s:g} s the battery lost {percent_text(fault.soc_drop)} of its charge at once.")
    if summary["battery_limit"]:
        words.append(f"Of the battery's limits, {LIMITS[summary['battery_limit']]} bound.")
    return words


def _forecast(summary: Mapping[str, Any]) -> list[str]:
    expected = summary["energy_forecast"]
    if expected is None:
        stuck = summary["never_past"]
        return [f"There was no forecast before take-off: {stuck} has a turn that is never got past."] if stuck else []
    came = ""
    if summary["completed"]:
        took_s, used_wh = summary["duration_s"] - expected["time_s"], summary["energy_wh"] - expected["energy_wh"]
        came = f"; the flight differed by {_difference(used_wh, 2)} Wh and {_difference(took_s, 0)} s"
    home = []
    if expected["turn_back_s"] is not None:
        x, y = expected["turn_back_m"]
        until = f"{expected['turn_back_s']:.0f} s, at ({x:.0f}, {y:.0f}) m"
        home = [f"By it, home was within reach with the reserve until {until}."]
    return [
        f"The forecast before take-off was {expected['energy_wh']:.2f} ± {expected['energy_std_wh']:.2f} Wh in "
        f"{expected['time_s']:.0f} ± {expected['time_std_s']:.0f} s, and to complete with a probability of "
        f"{percent_text(expected['completes_probability'])}{came}.",
        *home,
        *(f"By it, the flight {risk_text(*each.values())}." for each in expected["obstacles"]),
    ]


def _difference(value: float, digits: int) -> str:
    """A difference with its sign."""
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def _changes(summary: Mapping[str, Any], decisions: Sequence[Mapping[str, Any]]) -> list[str]:
    """What the planner decided: how often, what changed and when, and what was never feasible."""
    planner, parameters = summary["planner"], summary["parameters"]
    changed = {name: values for name, values in parameters.items() if values["changes"]}
    if not parameters:
        return ["The plan has no parameters to choose."]
    if not changed:
        return [f"Planner {planner} kept all parameters{_often(decisions)}."]
    parts = [
        f"{label_of(name, values)} {times_text(values['changes'])}, from {value_of(values, 'first')} to "
        f"{value_of(values, 'last')}"
        for name, values in changed.items()
    ]
    words = [f"Planner {planner} changed {', and '.join(parts)}{_often(decisions)}."]
    named = [row for row in decisions if row["reason"] not in ("", "kept") and "→" in row["reason"]]
    for row in named[:SHOWN]:
        words.append(f"At {row['time_s']:g} s it decided: {row['reason']}.")
    if len(named) > SHOWN:
        more = len(named) - SHOWN
        words.append(f"{more} more decision{'s' if more > 1 else ''} changed parameters.")
    infeasible = sum(row["status"] == INFEASIBLE for row in decisions)
    if infeasible:
        words.append(f"Nothing was feasible in {infeasible} of {len(decisions)} re-plannings.")
    return words


def _turned_back(decisions: Sequence[Mapping[str, Any]]) -> list[str]:
    """The decision to fly home, if there was one."""
    return [
        f"At {row['time_s']:g} s it decided: {row['reason']}."
        for row in decisions
        if str(row["reason"]).startswith(TURNS_BACK)
    ]


def _often(decisions: Sequence[Mapping[str, Any]]) -> str:
    return f" in {len(decisions)} re-plannings" if decisions else ""


def _quality(summary: Mapping[str, Any]) -> list[str]:
    if summary["quality"] is None:
        return []
    parameters = summary["parameters"].items()
    means = ", ".join(f"{label_of(name, values)} {value_of(values, 'mean')}" for name, values in parameters)
    return [f"The quality U was {summary['quality']:.3f} of 1, at mean parameters {means}."]


def _coverage(summary: Mapping[str, Any]) -> list[str]:
    share = summary["coverage"]
    return [] if share is None else [f"Its lines covered {percent_text(share)} of the field."]

"""What happened in a flight or in a sweep, in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from eadp.core.geometry.bearings import compass_deg
from eadp.errors import printable
from eadp.io.scenario.scenario_file import Scenario
from eadp.io.sweep.statistics import SweepFlight, completed_interval, distinct, marginal, wilson_interval
from eadp.models.airspace import risk_text
from eadp.models.battery import LIMITS, BatteryFault
from eadp.models.vehicle import PaperVehicle
from eadp.planning.base import INFEASIBLE, TURNS_BACK

SHOWN = 3
"""Most changes that are named one by one."""


def setting_text(scenario: Scenario) -> str:
    """The aircraft, battery and wind of a flight, and which of them are defaults."""
    keys, chosen = scenario.keys, scenario.chosen
    airframe, battery, wind = keys.vehicle.airframe, keys.battery, keys.wind
    east, north = wind.steady_mps
    speed = wind.steady_speed_mps
    mass = "" if isinstance(airframe, PaperVehicle) else f" of {airframe.mass_kg:g} kg"
    shown = {
        "airframe": f"{keys.vehicle.name or airframe.model}{mass} at {airframe.airspeed_mps:g} m/s",
        "battery": f"battery {battery.voltage_v:.4g} V, {battery.capacity_ah:g} Ah",
        "wind": f"wind {speed:g} m/s"
        + (f" from {(compass_deg(math.atan2(north, east)) + 180) % 360:.0f}°" if speed else "")
        + (f" at take-off, up to {wind.speeds_mps[1]:g} m/s" if wind.profile else ""),
    }
    return "; ".join(text + ("" if key in chosen else " (default)") for key, text in shown.items())


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


def reserve_text(summary: Mapping[str, Any]) -> str:
    """Whether the reserve was kept; a flight that does not complete keeps none."""
    if summary["reserve_kept"]:
        return "kept"
    unspent = summary["soc_final"] >= summary["soc_reserve"]
    return "not kept, as the flight did not complete" if unspent else "not kept"


def time_text(time_s: float) -> str:
    """A time in minutes and seconds."""
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes} min {seconds} s" if minutes else f"{time_s:.1f} s"


def _percent(share: float) -> str:
    return f"{100 * share:.3g} %"


def _end(summary: Mapping[str, Any]) -> str:
    verb = "completed" if summary["completed"] else "did not complete"
    after = f"after {time_text(summary['duration_s'])} and {summary['distance_m'] / 1000:.2f} km"
    return f"The flight {verb}: {summary['reason']} {after}."


def _charge(summary: Mapping[str, Any], faults: Sequence[BatteryFault]) -> list[str]:
    soc, reserve, power = summary["soc_final"], summary["soc_reserve"], summary["power_w"]["mean"]
    kept = reserve_text(summary)
    mean = f", {power:.1f} W on average" if power is not None else ""
    words = [
        f"It used {summary['energy_wh']:.2f} Wh{mean}. The charge at the end was {_percent(soc)}; "
        f"the reserve of {_percent(reserve)} was {kept}."
    ]
    for fault in faults:
        if fault.at_s <= summary["duration_s"]:
            words.append(f"At {fault.at_s:g} s the battery lost {_percent(fault.soc_drop)} of its charge at once.")
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
        f"{_percent(expected['completes_probability'])}{came}.",
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
        f"{label_of(name, values)} {_times(values['changes'])}, from {value_of(values, 'first')} to "
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


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _quality(summary: Mapping[str, Any]) -> list[str]:
    if summary["quality"] is None:
        return []
    parameters = summary["parameters"].items()
    means = ", ".join(f"{label_of(name, values)} {value_of(values, 'mean')}" for name, values in parameters)
    return [f"The quality U was {summary['quality']:.3f} of 1, at mean parameters {means}."]


def _coverage(summary: Mapping[str, Any]) -> list[str]:
    share = summary["coverage"]
    return [] if share is None else [f"Its lines covered {_percent(share)} of the field."]


def flight_facts(summary: Mapping[str, Any]) -> list[list[str]]:
    """Figures of a flight, each with its name."""
    power, solver, laps = summary["power_w"], summary["solver"], summary["lap_times_s"]
    facts = [
        ("planner", summary["planner"]),
        ("duration", f"{summary['duration_s']:.2f} s"),
        ("distance", f"{summary['distance_m']:.0f} m"),
        ("energy", f"{summary['energy_wh']:.3f} Wh"),
        ("power", f"{power['min']:.2f} to {power['max']:.2f} W"),
        ("charge at the end", f"{_percent(summary['soc_final'])}, reserve {_percent(summary['soc_reserve'])}"),
    ]
    facts += [(label_of(name, values), parameter_text(values)) for name, values in summary["parameters"].items()]
    if laps:
        facts.append(("laps", f"{len(laps)} after the first, {min(laps):.2f} to {max(laps):.2f} s"))
    if summary["period_s"] is not None:
        facts.append(("period of the power", f"{summary['period_s']:.3f} s"))
    runs = (
        f"{summary['decisions']}; {solver['calls']} runs of OSQP, {solver['failed']} failed; {solver['skipped']} kept, "
    )
    runs += f"{solver['infeasible']} infeasible"
    facts += [("re-plannings", runs), ("seed", str(summary["seed"]))]
    return [list(fact) for fact in facts]


def label_of(name: str, values: Mapping[str, Any]) -> str:
    """What people read for a parameter of `summary.json`: its title where it has one."""
    return str(values.get("title") or name)


def value_of(values: Mapping[str, Any], key: str) -> str:
    """A parameter's first, last or mean value as people read it: of what it stands for, with its unit."""
    shown = values.get("shown")
    return f"{values[key]:.4g}" if shown is None else f"{shown[key]:.4g} {values['unit']}".strip()


def parameter_text(values: Mapping[str, Any]) -> str:
    """A parameter over a flight: its mean, its first and last value, and its changes."""
    ran = f", ran at {values['actual_mean']:.4g}" if "actual_mean" in values else ""
    first, last, changes = value_of(values, "first"), value_of(values, "last"), values["changes"]
    if not changes:
        return f"{first}{ran}, no change"
    return f"mean {value_of(values, 'mean')}{ran}, from {first} to {last}, {changes} change{'s' if changes > 1 else ''}"


def log_words(
    first_s: float, telemetry: Sequence[Mapping[str, Any]], decisions: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Sentences on a flight on telemetry, as far as its log goes."""
    took_s = telemetry[-1]["time_s"]
    words = [f"A flight on telemetry: {len(telemetry)} lines over {time_text(took_s)}, {len(decisions)} decisions."]
    words.append(f"Times on this page are from the first line, at {first_s:.15g} s.")
    if decisions:
        last = decisions[-1]
        parameters = ", ".join(f"{name} {value:.6g}" for name, value in last["parameters"].items())
        words.append(
            f"The last decision, at {last['time_s']:g} s in stage {last['stage']}: {last['reason']} ({parameters})."
        )
        if last["completes_probability"] is not None:
            words.append(f"It forecast to complete with a probability of {_percent(last['completes_probability'])}.")
        warned = Counter(code for row in decisions for code in dict.fromkeys(row["warnings"]))
        if warned:
            words.append(f"Warnings: {', '.join(f'{code} {_times(count)}' for code, count in warned.items())}.")
    return words


def sweep_words(
    count: int,
    completed: int,
    reasons: Mapping[str, int],
    errors: Mapping[str, int],
    flights: Sequence[SweepFlight],
    keys: Sequence[str],
) -> list[str]:
    """Sentences on a sweep: counts over all runs, and by key over the flights of the page."""
    made, failed = count - sum(errors.values()), sum(errors.values())
    words = [f"{count} runs."]
    if made:
        own = distinct(flights)
        repeated = len(own) < sum(flight.error is None for flight in flights)
        low, high = (completed_interval(own) if repeated else None) or wilson_interval(completed, made)
        of = f" of {len(own)} distinct flights" if repeated else ""
        words[0] = (
            f"{completed} of {made} flights completed: {_percent(completed / made)} "
            f"(95 % interval{of} {_percent(low)} to {_percent(high)})."
        )
        words.append(f"They ended so: {_counts(reasons)}.")
    if failed:
        words.append(f"{failed} of {count} runs could not be made: {_counts(errors)}.")
    for key in keys:
        shares = {group.label: group.completed for group in marginal(flights, key) if group.flights}
        if made and len(shares) > 1 and key != "seed":
            least, best = min(shares, key=shares.__getitem__), max(shares, key=shares.__getitem__)
            if shares[least] != shares[best]:
                ends = (f"{_percent(shares[end])} complete at {printable(end, 60)}" for end in (least, best))
                words.append(f"By {key}: {', '.join(ends)}.")
    if len(flights) < count:
        words.append(f"The charts and the list show {len(flights)} of the {count} runs, a random sample.")
    return words


def _counts(found: Mapping[str, int]) -> str:
    """The most frequent texts with their counts."""
    first = sorted(found.items(), key=lambda item: -item[1])
    more = [f"{len(first) - SHOWN} other texts"] if len(first) > SHOWN else []
    return "; ".join([f"{printable(text)} ({number})" for text, number in first[:SHOWN]] + more)

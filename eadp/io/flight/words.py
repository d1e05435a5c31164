"""A flight's settings and figures in words, as commands and pages print them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from eadp.core.geometry.bearings import compass_deg
from eadp.io.scenario.scenario_file import Scenario
from eadp.models.vehicle import PaperVehicle


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


def percent_text(share: float) -> str:
    """A share in percent."""
    return f"{100 * share:.3g} %"


def times_text(count: int) -> str:
    """How often."""
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def flight_facts(summary: Mapping[str, Any]) -> list[list[str]]:
    """Figures of a flight, each with its name."""
    power, solver, laps = summary["power_w"], summary["solver"], summary["lap_times_s"]
    facts = [
        ("planner", summary["planner"]),
        ("duration", f"{summary['duration_s']:.2f} s"),
        ("distance", f"{summary['distance_m']:.0f} m"),
        ("energy", f"{summary['energy_wh']:.3f} Wh"),
        ("power", f"{power['min']:.2f} to {power['max']:.2f} W"),
        ("charge at the end", f"{percent_text(summary['soc_final'])}, reserve {percent_text(summary['soc_reserve'])}"),
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

"""Turns that an aircraft cannot follow, by what is flown instead."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from eadp.core.geometry.curves import CIRCLE
from eadp.core.guidance import GRAVITY_MPS2
from eadp.models.plan.plan import Finding, Plan
from eadp.models.plan.trace import nominal_route
from eadp.models.vehicle import FixedWing, Guidance
from eadp.simulation.nominal import NominalFlight, Overshoot

NAMED_M = 10.0
"""Distance from the path beyond which a turn is named [m]: how near to a waypoint PX4 has to be, by default."""
MOST = 3
"""How many turns of a plan are named where a flight in wind leaves all of them: what mends one mends the others."""
NEAR = 0.95
"""Turns of so much of the least radius stay within `NAMED_M` of their paths without wind."""


def is_tight(plan: Plan, turn_radius_m: float) -> bool:
    """Whether a mission's plan has a turn that is clearly tighter than a radius [m], as one without room for it has."""
    circles = [stage for stage in plan.stages if stage.kind == CIRCLE]
    tracks = [stage.track(stage.path_at(()), stage.trigger_at(())) for stage in circles]
    return any(track.radius_m() < NEAR * turn_radius_m for track in tracks)


def calm_findings(plan: Plan, turn_radius_m: float) -> list[Finding]:
    """As `overshoot_findings`, of the default aircraft with turns of a radius [m], without wind."""
    speed, route = FixedWing.airspeed_mps, nominal_route(plan, ())
    bank_deg = math.degrees(math.atan(speed**2 / (GRAVITY_MPS2 * turn_radius_m)))
    airframe = replace(FixedWing(), max_bank_deg=bank_deg)
    return overshoot_findings(NominalFlight(airframe, Guidance()).times_s(route, (0.0, 0.0))[1])


def overshoot_findings(overshoots: Sequence[Overshoot], most: int | None = None) -> list[Finding]:
    """Warnings of the turns that are flown far off their paths, each item once; of more than `most`, the worst are
    named, and the others counted."""
    found: dict[str, Finding] = {}
    worst_first = sorted(overshoots, key=lambda one: -one.excess_s)
    for first, last, excess_s, off_m in worst_first:
        if math.isinf(excess_s):
            flown = "it circles, and never gets past it"
        elif off_m > NAMED_M:
            back = "" if last.label == first.label else f", back on it before {last.label}"
            flown = f"it flies up to {off_m:.0f} m beside the path, in {excess_s:+.1f} s{back}"
        else:
            continue
        message = f"{first.label}: a turn tighter than the aircraft's: {flown}"
        found.setdefault(first.label, Finding("warning", first.index, first.line, "overshoot", message))
    named, rest = list(found.values()), []
    if most is not None and len(named) > most + 1:
        message = f"{len(named) - most} more turns tighter than the aircraft's, each with less delay"
        named, rest = named[:most], [replace(named[most], message=message)]
    return sorted(named, key=lambda one: one.line) + rest

"""Turns that an aircraft cannot follow, as it flies them: guidance, bank limit, overshoot and all.

Elsewhere the aircraft follows its path, and the path's own length tells the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point, tangent
from eadp.errors import PathUndefined
from eadp.models.battery import Battery
from eadp.models.plan.executor import PlanExecutor
from eadp.models.plan.plan import Finding
from eadp.models.plan.route import OVERSHOOT_M, Route, follows
from eadp.models.plan.stage import Leg, Stage
from eadp.models.vehicle import FixedWing, Guidance, PowerCurve
from eadp.models.weather import Wind
from eadp.models.world import Excess
from eadp.simulation.aircraft import HEIGHT_GAIN, X, Y, constants_of, state_of
from eadp.simulation.inner_loop import ENERGY, LOST, InnerLoop

STEP_S = 0.05
"""Time step [s]: a sixth of the default aircraft's time constant of the roll."""
CHECK_S = 1.0
"""Time between two measurements of how far the aircraft is off its path [s]."""
STUCK_S, STUCK_TIMES = 300.0, 10.0
"""A leg has no end that takes longer than `STUCK_TIMES` the time that its length takes, and `STUCK_S` more [s]."""
LAPS = 2
"""A plan that repeats is flown for so many laps: the others are as the last of them."""
MAX_STEPS = 1 << 40
"""A step that no flight reaches."""
LASTING = Battery(capacity_ah=1e9, resistance_ohm=0.0)
"""A battery that no flight empties: only power and time are of interest."""


class Overshoot(NamedTuple):
    """A stage as flown: what it takes beside its path, and the greatest distance from that [m]."""

    stage: Stage
    excess: Excess
    off_m: float


def overshoots(
    route: Route, airframe: FixedWing | PowerCurve, guidance: Guidance, wind_mps: Point
) -> dict[int, Overshoot]:
    """The stages of a route that are flown off their paths in a steady wind [m/s], without noise, by number.

    A time is infinite where the aircraft never gets past a stage.
    """
    radius_m, speed_mps = airframe.turn_radius_m, airframe.airspeed_mps
    if follows(route, radius_m, speed_mps, math.hypot(*wind_mps)):
        return {}
    found = dict[int, Overshoot]()
    executor = PlanExecutor(route.cursor, route.legs[0].start_m)
    loop = _loop(route, airframe, guidance, wind_mps)
    k, began_j, check = 0, 0.0, round(CHECK_S / STEP_S)
    times = (array.tolist() for array in route.times_s(speed_mps, wind_mps))
    for leg, leg_s, turning_s in zip(route.legs, *times, strict=True):
        if leg.lap >= route.cursor.lap + LAPS or not math.isfinite(leg_s):
            break
        loop.start_stage(executor, 0.0)
        began, events, off_m = k, 0, 0.0
        limit = k + math.ceil((STUCK_TIMES * leg_s + STUCK_S) / STEP_S)
        while not events and k < limit:
            k, events = loop.run(k, min(k + check, limit))
            off_m = max(off_m, _off_m(leg, (loop.variable(X), loop.variable(Y))))
        if events & LOST or not events:  # it never gets to the end
            found[leg.stage.index] = Overshoot(leg.stage, Excess(math.inf, 0.0), off_m)
            break
        flown_s, energy_j = (k - began) * STEP_S, loop.variable(ENERGY) * STEP_S
        flown_turning_s = _turning_s(airframe, leg.stage.airspeed_mps or speed_mps, flown_s, energy_j - began_j)
        began_j = energy_j
        if off_m > OVERSHOOT_M:
            excess = Excess(max(flown_s - leg_s, 0.0), flown_turning_s - turning_s)
            found[leg.stage.index] = Overshoot(leg.stage, excess, off_m)
        executor.handle(events, loop.variable(X), loop.variable(Y))
        if executor.complete:
            break
    return found


def _loop(route: Route, airframe: FixedWing | PowerCurve, guidance: Guidance, wind_mps: Point) -> InnerLoop:
    """A simulated aircraft at the start of a route, on its course, in level flight and a steady wind [m/s]."""
    wind = Wind(math.hypot(*wind_mps), towards_deg=math.degrees(math.atan2(wind_mps[1], wind_mps[0])))
    leg, course = route.legs[0], float(route.table.rows.courses_rad[route.order[0], 0])
    speed = leg.stage.airspeed_mps or airframe.airspeed_mps
    # the heading that holds the course: V sin(θ − χ) is the wind from the left
    cross = wind_mps[0] * math.sin(course) - wind_mps[1] * math.cos(course)
    heading = course + math.asin(min(max(cross / speed, -1.0), 1.0))
    state = state_of(replace(airframe, airspeed_mps=speed), wind_mps, leg.start_m, heading, leg.stage.altitude_m or 0.0)
    constants = constants_of(airframe, guidance, wind, STEP_S)
    constants[HEIGHT_GAIN] = 0.0  # no climb
    loop = InnerLoop(state, constants, LASTING, wind, np.random.default_rng(0))
    loop.set_records(MAX_STEPS, 0, MAX_STEPS)
    return loop


def _turning_s(airframe: FixedWing | PowerCurve, speed_mps: float, flown_s: float, energy_j: float) -> float:
    """∫ tan² φ dt of a bank φ that takes an energy in the time of a leg as flown [s]."""
    # E = P(0) t + (P(45°) − P(0)) ∫ tan² φ dt
    level_w = airframe.level_power_w(speed_mps)
    bank_w = airframe.level_power_w(speed_mps, math.pi / 4) - level_w  # tan² 45° = 1
    return max(energy_j - level_w * flown_s, 0.0) / bank_w if bank_w > 0 else 0.0


def _off_m(leg: Leg, position: Point) -> float:
    """How far a position is from a leg's path [m]; 0 where the path has no direction."""
    here = leg.local_m(position)
    try:
        tangent(leg.path, here, leg.stage.sense)
        return math.dist(here, leg.track.nearest(here))
    except PathUndefined:
        return 0.0


# --- what is said of them

NAMED_M = 10.0
"""Distance from the path beyond which a turn is named [m]: how near to a waypoint PX4 has to be, by default."""
MOST = 3
"""How many turns of a plan are named where a flight in wind leaves all of them: what mends one mends the others."""


def overshoot_findings(found: Sequence[Overshoot]) -> list[Finding]:
    """Warnings of the turns that are flown far off their paths, each item once: of more than `MOST`, the worst are
    named, and the others counted."""
    by_label: dict[str, Finding] = {}
    for stage, (excess_s, _), off_m in sorted(found, key=lambda one: -one.off_m):
        if math.isinf(excess_s):
            flown = "it circles, and never gets past it"
        elif off_m > NAMED_M:
            flown = f"it flies up to {off_m:.0f} m beside the path, in {excess_s:+.1f} s"
        else:
            continue
        message = f"{stage.label}: a turn tighter than the aircraft's: {flown}"
        by_label.setdefault(stage.label, Finding("warning", stage.index, stage.line, "overshoot", message))
    named, rest = list(by_label.values()), []
    if len(named) > MOST + 1:
        message = f"{len(named) - MOST} more turns tighter than the aircraft's, each nearer to its path"
        named, rest = named[:MOST], [replace(named[MOST], message=message)]
    return sorted(named, key=lambda one: one.line) + rest

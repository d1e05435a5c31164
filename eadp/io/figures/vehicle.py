"""The figure of an aircraft: its power over its airspeed."""

from __future__ import annotations

import math

import numpy as np

from eadp.io.figures.canvas import COLOURS, GREY, figure_file, write_headline
from eadp.models.performance import Performance
from eadp.models.vehicle import Airframe, FixedWing

ABOVE = 1.6
"""Right end of the axis, over the airspeed held."""


def write_vehicle_figure(path: str, name: str, airframe: Airframe, found: Performance, computing_w: float) -> None:
    """Draw the power of an aircraft over its airspeed, computations among it.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    """
    low, high = airframe.level_speeds_mps()
    speeds = np.linspace(low, max(min(high, ABOVE * max(found.airspeed_mps, found.range_mps)), low), 300)
    banks = [0.0, 30.0, airframe.max_bank_deg] if airframe.takes_commands else [0.0]
    with figure_file(path, 7.0, 4.4) as figure:
        axes = figure.subplots()
        for bank, colour in zip(banks, COLOURS, strict=False):
            label = f"bank {bank:g}°" if bank else "level flight"
            powers = [airframe.level_power_w(float(v), math.radians(bank)) + computing_w for v in speeds]
            if isinstance(airframe, FixedWing):  # no curve where the wing stalls
                slow = speeds < airframe.stall_in_turn_mps(math.radians(bank))
                powers = np.where(slow, math.nan, powers).tolist()
            axes.plot(speeds, powers, color=colour, label=label, marker="" if high > low else "s")
        held_w = found.level_power_w + computing_w
        axes.plot(found.airspeed_mps, held_w, "o", color="black", label=f"as it flies, {held_w:.3g} W")
        for speed, mark, text in ((found.endurance_mps, "v", "longest time"), (found.range_mps, "^", "longest way")):
            watts = airframe.level_power_w(speed) + computing_w
            axes.plot(speed, watts, mark, color=GREY, label=f"{text}, {speed:.3g} m/s")
        if found.range_w > 0:
            # the tangent from the origin touches the curve where power over airspeed is least
            axes.plot([0, found.range_mps * 1.25], [0, found.range_w * 1.25], color=GREY, linewidth=0.6)
        if found.stall_mps is not None:
            axes.axvline(found.stall_mps, color=GREY, linestyle=":", label=f"stall, {found.stall_mps:.3g} m/s")
        axes.set(xlabel="airspeed [m/s]", ylabel="electrical power [W]", xlim=(0, None), ylim=(0, None))
        axes.legend(loc="upper left")
        write_headline(figure, [name or "aircraft", f"turning radius {found.turn_radius_m:.0f} m"])

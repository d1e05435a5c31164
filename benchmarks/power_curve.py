"""Draw the power curve of the default fixed-wing aircraft.

usage: python benchmarks/power_curve.py docs/pictures/fixed-wing-power.png
"""

from __future__ import annotations

import math
import sys

import matplotlib as mpl
import numpy as np

from eadp.core.flight.aerodynamics import speed_of_least_power_mps
from eadp.models.vehicle import FixedWing

mpl.use("Agg")

import matplotlib.pyplot as plt

PUBLISHED_W = (30.4, 40.4)


def main(path: str) -> None:
    """Power over airspeed in straight flight and in banks, with what bounds it."""
    wing = FixedWing()
    speeds = np.linspace(wing.stall_mps, 24, 200)
    figure, axes = plt.subplots(figsize=(7, 4.2), dpi=120, layout="constrained")
    for bank, colour in ((0, "#3b6fb6"), (30, "#d1752b"), (45, "#a2437c")):
        powers = [
            wing.level_power_w(v, math.radians(bank))
            if wing.lift_coefficient(v, math.radians(bank)) <= wing.max_lift_coefficient
            else math.nan
            for v in speeds
        ]
        axes.plot(speeds, powers, color=colour, label=f"bank {bank}°, n = {1 / math.cos(math.radians(bank)):.2f}")
    axes.axhspan(*PUBLISHED_W, color="#3f8f5b", alpha=0.12, label="published survey flight, 30.4 to 40.4 W")
    axes.plot(wing.airspeed_mps, wing.cruise_power_w, "o", color="black", label=f"cruise, {wing.cruise_power_w:.1f} W")
    axes.axvline(wing.stall_mps, color="#8a8f98", linestyle=":", label=f"stall, {wing.stall_mps:.1f} m/s")
    area, density, zero_lift = wing.wing_area_m2, wing.air_density_kgpm3, wing.zero_lift_drag_coefficient
    slow_mps = speed_of_least_power_mps(wing.weight_n, area, density, zero_lift, wing.induced_drag)
    axes.axvline(slow_mps, color="#8a8f98", linestyle="--", label=f"minimum power, {slow_mps:.1f} m/s")
    axes.set(xlabel="airspeed [m/s]", ylabel="electrical power [W]", ylim=(0, 110), xlim=(5, 24))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    figure.savefig(path)


if __name__ == "__main__":
    main(sys.argv[1])

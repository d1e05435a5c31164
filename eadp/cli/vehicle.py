"""`eadp vehicle`."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument

from eadp.cli.output import emit, emit_json, usage_fault
from eadp.io.text.json import aligned
from eadp.io.text.options import Flag, check_range
from eadp.models.data_sheet import estimate
from eadp.models.vehicle import FixedWing

if TYPE_CHECKING:
    from eadp.io.vehicle import VehicleFile
    from eadp.models.performance import Performance, SpeedRange


@dataclass(frozen=True)
class VehicleOptions:
    """In which wind and with which load, and what is printed and drawn."""

    wind: Annotated[str, Flag(metavar="MPS,…")] = "0,5,8"
    """Speeds of the wind, for endurance and range."""

    computing_w: float = 0.0
    """Power of the computations, beside the motion's."""

    reserve: Annotated[float, Flag(metavar="SHARE")] = 0.05
    """Charge to keep, as a share of the full charge."""

    plot: Annotated[str, Flag("--plot -o", metavar="FILE")] = ""
    """Draw the power curve: FILE.svg or FILE.png."""

    format: Literal["text", "json"] = "text"
    """How to print."""


def command(
    file: Annotated[str, Argument(metavar="FILE", help="Vehicle file, - for standard input.")], options: VehicleOptions
) -> int:
    """Example: eadp vehicle vehicles/data-sheet.yaml

    Print what an aircraft can do: stall, best speeds, level power, turning radius, endurance and range in wind.
    Of a file with a data_sheet (span, mass, airspeed, endurance) also the drag and the efficiency that follow.

    Exit code 0 if it can fly as described, 1 if it cannot (it stalls, or its motor or battery is too weak), 2 on bad
    input.
    """
    from eadp.api import vehicle as use_case

    computing, reserve = options.computing_w, options.reserve
    check_range("--computing", computing, 0, 1e6, closed=True)
    check_range("--reserve", reserve, 0, 1, closed=True)
    winds = _winds(options.wind)
    vehicle, found = use_case.vehicle(file, winds, computing_w=computing, reserve_soc=reserve)
    if options.plot:
        from eadp.io.figures.vehicle import write_vehicle_figure

        write_vehicle_figure(options.plot, vehicle.name, vehicle.airframe, found, computing)
    if options.format == "json":
        named = {"schema": "eadp.performance/1", "name": vehicle.name, "model": vehicle.airframe.model}
        emit_json(named | asdict(found))
    else:
        pack, lines = vehicle.battery, [vehicle.name] if vehicle.name else []
        lines += [*_sheet(vehicle), *_lines(found, computing)]
        milliohm = 1000 * pack.resistance_ohm
        lines.append(f"battery        {pack.voltage_v:.4g} V, {pack.capacity_ah:.4g} Ah, {milliohm:.3g} mΩ")
        emit("\n".join([*lines, "", *_table(found), *_speeds(found)]))
    return 1 if found.faults else 0


def _winds(raw: str) -> list[float]:
    try:
        winds = [float(part) for part in raw.split(",")]
    except ValueError:
        winds = [math.nan]
    if not all(0 <= wind <= 100 for wind in winds) or len(winds) > 100:
        raise usage_fault("--wind", raw, "no speeds of the wind", "numbers from 0 to 100 m/s, as in 0,5,8")
    return winds


def _sheet(vehicle: VehicleFile) -> list[str]:
    """What the data sheet of an aircraft leads to, how well it is known, and what is assumed beside it."""
    if vehicle.data_sheet is None or not isinstance(wing := vehicle.airframe, FixedWing):
        return []
    found = estimate(vehicle.data_sheet, wing.avionics_w, wing.air_density_kgpm3)
    sheet, own = found.sheet, FixedWing(**found.keys)
    powers = [
        f"{own.level_power_w(speed):.4g} W ± {100 * found.power_std_at(speed):.0f} % at {speed:.3g} m/s"
        for speed in (ratio * sheet.airspeed_mps for ratio in (0.8, 1.0, 1.2))
    ]
    return [
        f"data sheet     {', '.join(powers)}",
        f"               wing area {own.wing_area_m2:.2g} m², drag coefficient "
        f"C_D0 {own.zero_lift_drag_coefficient:.2g}, efficiency of the propulsion {own.propulsive_efficiency:.2g}, "
        f"Oswald's e {own.oswald_efficiency:.2g}",
        f"assumed        avionics {wing.avionics_w:.3g} W, motor up to {wing.max_power_w:.3g} W, stall at a lift "
        f"coefficient of {wing.max_lift_coefficient:g}; eadp fit LOG --vehicle measures the power",
    ]


def _lines(found: Performance, computing_w: float) -> list[str]:
    """All powers are those of motion and computations."""
    level_w, bank_w = found.level_power_w + computing_w, found.bank_power_w + computing_w
    rows = [
        f"flies          at {found.airspeed_mps:.4g} m/s: {level_w:.4g} W level, "
        f"{bank_w:.4g} W at its greatest bank, turning radius {found.turn_radius_m:.3g} m"
    ]
    if computing_w:
        rows.insert(0, f"powers         count {computing_w:g} W of computations")
    if found.stall_mps is not None and found.stall_in_turn_mps is not None:
        in_turn = f"{found.stall_in_turn_mps:.3g} m/s at its greatest bank"
        rows.append(f"stalls         at {found.stall_mps:.3g} m/s, {in_turn}")
    rows.append(f"flies longest  at {found.endurance_mps:.3g} m/s: {found.endurance_w:.4g} W")
    rows.append(f"flies farthest at {found.range_mps:.3g} m/s: {found.range_w:.4g} W")
    if found.glide_ratio is not None:
        rows.append(f"glides best    at {found.glide_mps:.3g} m/s: {found.glide_ratio:.3g} m for each metre of height")
    if found.max_speed_mps is not None:
        climb = f"climb up to {found.climb_mps:.3g} m/s"
        rows.append(f"motor          level flight up to {found.max_speed_mps:.3g} m/s, {climb}")
    return [*rows, *(f"cannot fly so: {fault}" for fault in found.faults)]


def _table(found: Performance) -> list[str]:
    head = ["wind [m/s]", "", "airspeed [m/s]", "power [W]", "time [min]", "against [km]", "with [km]", "and back [km]"]
    rows = [head]
    for each in found.winds:
        flown = {"as it flies": each.held, "longest": each.endurance, "farthest": each.range}
        rows += [_row(each.wind_mps, name, one) for name, one in flown.items() if one is not None]
    too_windy = [each.wind_mps for each in found.winds if each.range is None]
    return [*aligned(rows), *(f"cannot fly against a wind of {wind_mps:g} m/s" for wind_mps in too_windy)]


def _speeds(found: Performance) -> list[str]:
    """Energy a kilometre by airspeed and wind, for the airspeeds that may be decided."""
    if not any(each.speeds for each in found.winds):
        return []
    rows = [["out and back [Wh/km]", *(f"{one.airspeed_mps:g} m/s" for one in found.winds[0].speeds)]]
    for each in found.winds:
        energies = (f"{one.wh_per_km:.2f}" if math.isfinite(one.wh_per_km) else "-" for one in each.speeds)
        rows.append([f"in {each.wind_mps:g} m/s", *energies])
    return ["", *aligned(rows)]


def _row(wind_mps: float, name: str, one: SpeedRange) -> list[str]:
    far = [f"{metres / 1000:.1f}" for metres in (one.against_m, one.with_m, one.out_and_back_m)]
    return [f"{wind_mps:g}", name, f"{one.airspeed_mps:.1f}", f"{one.power_w:.1f}", f"{one.endurance_s / 60:.1f}", *far]

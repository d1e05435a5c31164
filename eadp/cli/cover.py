"""`eadp cover`."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eadp.cli.output import emit, emit_json, usage_fault, warn

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eadp.core.geometry import Point
    from eadp.io.scenario_file import Scenario
    from eadp.models.computing import Computing
    from eadp.models.field import Field
    from eadp.models.plan import Plan
    from eadp.models.profile_sum import AnyProfile
    from eadp.planning.coverage import Solution
    from eadp.planning.coverage_plan import Sensors
    from eadp.planning.coverage_report import Flown, Power
    from eadp.planning.sweep import Motion, Way


class Pattern(enum.StrEnum):
    """How the lines follow one another."""

    auto = "auto"
    zamboni = "zamboni"
    dubins = "dubins"


class CoverFormat(enum.StrEnum):
    """Output formats of `eadp cover`."""

    plan = "plan"
    text = "text"
    json = "json"


def command(
    file: Annotated[
        str,
        typer.Argument(help="Field outline: GeoJSON, KML or CSV of vertices, - for standard input.", metavar="FIELD"),
    ],
    min_radius: Annotated[float, typer.Option(help="Smallest turning radius of the aircraft [m].", metavar="METRES")],
    swath: Annotated[float, typer.Option(help="Width of ground that a line covers [m].", metavar="METRES")],
    radius: Annotated[
        float | None,
        typer.Option(help="Ideal turning radius [m]; 1.5 times the smallest unless given.", metavar="METRES"),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Distance of the lines [m]; at c1 = 0 where c1 widens it up to the swath, 0.75 of which it is unless "
            "given. Lines in an order lie a swath apart unless given.",
            metavar="METRES",
        ),
    ] = None,
    heading: Annotated[
        float | None,
        typer.Option(help="Heading of the lines [°], 0 east, 90 north; the quickest unless given.", metavar="DEG"),
    ] = None,
    pattern: Annotated[
        Pattern, typer.Option(help="Zamboni-like laps, lines in an order with Dubins turns, or the shorter.")
    ] = Pattern.auto,
    turns_off: Annotated[bool, typer.Option("--turns-off", help="Computations rest on turns.")] = False,
    metres: Annotated[bool, typer.Option("--metres", help="The file is in local metres, not degrees.")] = False,
    feature: Annotated[
        str | None, typer.Option(help="Which polygon of a file that holds several: id, name or number.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="Where the flight begins: X,Y [m], or LAT,LON [°].", metavar="POINT")
    ] = None,
    home: Annotated[str | None, typer.Option(help="Where the flight ends; as --start.", metavar="POINT")] = None,
    wind: Annotated[
        str | None, typer.Option(help="Wind: speed [m/s] and direction it blows towards [°].", metavar="SPEED,DEG")
    ] = None,
    airspeed: Annotated[
        float | None, typer.Option(help="Airspeed [m/s]; the scenario's vehicle's unless given.", metavar="MPS")
    ] = None,
    profile: Annotated[
        str | None, typer.Option(help="Computation profile: its computations get sets.", metavar="FILE")
    ] = None,
    scenario: Annotated[
        str | None, typer.Option(help="Scenario, for the vehicle, the wind and the energy.", metavar="FILE")
    ] = None,
    out: Annotated[str | None, typer.Option("-o", "--out", help="Write the plan here.", metavar="PLAN")] = None,
    format_: Annotated[
        CoverFormat | None,
        typer.Option("--format", help="What to print: the plan, a summary (the default with -o), or JSON."),
    ] = None,
    plot: Annotated[str | None, typer.Option(help="Draw field and plan: FILE.svg or FILE.png.", metavar="FILE")] = None,
) -> int:
    """Example: eadp cover plans/meadow.geojson --min-radius 30 --swath 30 --pattern zamboni

    Cover a field: from its outline to a plan, with spacing that a battery can vary.

    Exit code 0 if a plan covers the field, 1 if the pattern asked for does not fit it, 2 on bad input.
    """
    from eadp.errors import Infeasible
    from eadp.io.fields import read_field
    from eadp.io.plan_text import plan_text
    from eadp.io.streams import read_text, write_text
    from eadp.planning.coverage import Request, cover
    from eadp.planning.coverage_plan import plan_of
    from eadp.planning.coverage_report import flown

    setting = _scenario(scenario)
    measured = _profile(profile, setting)
    sensors = _sensors(measured, turns_off)
    motion = _motion(setting, min_radius, swath, radius, spacing, wind, airspeed)
    text = read_text(file)
    field, mended = read_field(text, metres=metres, feature=feature)
    request = Request(
        field,
        motion,
        pattern.value,
        _heading_rad(heading),
        _point("--start", start, field),
        _point("--home", home, field),
        order_spacing_m=spacing,
    )
    try:
        solution = cover(request)
    except Infeasible as error:
        warn([usage_fault("--pattern", pattern.value, str(error), "another pattern, or auto").faults[0]])
        return 1
    plan = plan_of(solution, name=text.name, sensors=sensors, min_radius_m=min_radius, origin_deg=field.origin_deg)
    power = _power(plan, measured, setting, sensors)
    ends = [flown(solution, field, motion, c1, power) for c1 in dict.fromkeys((0.0, solution.lowest_c1))]
    body = "".join(f"% {line}\n" for line in _comments(text.name, solution, motion, ends)) + plan_text(plan)
    if plot is not None:
        from eadp.io.figures import write_coverage_figure

        write_coverage_figure(plot, field, _titled(solution, ends), swath)
    if out is not None:
        write_text(out, body)
    wanted = format_ or (CoverFormat.plan if out is None else CoverFormat.text)
    if wanted is not CoverFormat.json:
        warn([_note(text.name, what) for what in mended])
    if turns_off and measured is None:
        warn([_note("--turns-off", "no computations to rest on turns; --profile names some")])
    if wanted is CoverFormat.json:
        emit_json(_document(solution, ends, mended, body, field.origin_deg))
    elif wanted is CoverFormat.plan:
        emit(body)
    else:
        emit(_text(solution, motion, ends, field, out))
    return 0


def _note(name: str, what: str) -> Any:
    from eadp.errors import Fault

    return Fault(name, 1, 1, what, severity="note")


# --- options ----------------------------------------------------------------------------------------------------------


def _scenario(path: str | None) -> Scenario:
    from eadp.io.scenario_file import read_scenario

    return read_scenario(path, {})


def _profile(path: str | None, setting: Scenario) -> AnyProfile | None:
    from eadp.io.profile_file import read_profile

    used = path or setting.profile_path
    if used is None:
        return None
    profile, warnings = read_profile(used)
    warn(warnings)
    return profile


def _sensors(profile: AnyProfile | None, turns_off: bool) -> Sensors:
    """The computations that a profile measures, over what it measures in whole numbers."""
    import math

    from eadp.models.plan import Box
    from eadp.planning.coverage_plan import Sensors

    if profile is None:
        return Sensors()
    sets = []
    for name in profile.names:
        lo, hi = profile.range_of(name)
        whole = Box(float(math.ceil(lo)), float(math.floor(hi))) if math.ceil(lo) <= math.floor(hi) else Box(lo, hi)
        sets.append(whole)
    return Sensors(tuple(zip(profile.names, profile.units, strict=True)), tuple(sets), turns_off)


def _motion(
    setting: Scenario,
    min_radius: float,
    swath: float,
    radius: float | None,
    spacing: float | None,
    wind: str | None,
    airspeed: float | None,
) -> Motion:
    from eadp.planning.sweep import RADIUS_SHARE, SPACING_SHARE, Motion

    ideal = RADIUS_SHARE * min_radius if radius is None else radius
    apart = SPACING_SHARE * swath if spacing is None else spacing
    speed = setting.vehicle.airspeed_mps if airspeed is None else airspeed
    for option, value, least, most in (
        ("--min-radius", min_radius, 0.0, 1e5),
        ("--swath", swath, 0.0, 1e5),
        ("--radius", ideal, min_radius, 1e5),
        ("--spacing", apart, 0.0, swath),
        ("--airspeed", speed, 0.0, 1e3),
    ):
        inside = least <= value if option == "--radius" else least < value
        if not (inside and value <= most):
            expected = f"from {least:g} to {most:g}" if option == "--radius" else f"above {least:g}, at most {most:g}"
            raise usage_fault(option, f"{value:g}", f"{value:g} cannot stand here", expected)
    blowing = setting.wind.steady_mps if wind is None else _wind_mps(wind)
    speed_of_wind = (blowing[0] ** 2 + blowing[1] ** 2) ** 0.5
    if speed_of_wind >= speed:
        message = f"a wind of {speed_of_wind:g} m/s, no slower than the aircraft"
        raise usage_fault("--wind", wind or "", message, f"less than its {speed:g} m/s")
    return Motion(swath, min_radius, ideal, apart, speed, blowing)


def _wind_mps(raw: str) -> Point:
    from eadp.models.weather import Wind

    speed, towards = _two("--wind", raw, "a speed [m/s] and a direction [°], like 5,90")
    if speed < 0:
        raise usage_fault("--wind", raw, f"a speed of {speed:g}", "0 or more")
    return Wind(speed_mps=speed, towards_deg=towards).steady_mps


def _heading_rad(heading_deg: float | None) -> float | None:
    import math

    if heading_deg is None:
        return None
    if not math.isfinite(heading_deg):
        raise usage_fault("--heading", f"{heading_deg}", "no heading", "degrees, 0 east, 90 north")
    return math.radians(heading_deg % 360)


def _point(option: str, raw: str | None, field: Field) -> Point | None:
    """A place in the field's own terms: metres, or latitude and longitude where it was given in degrees."""
    from eadp.core.geodesy import to_local_m

    if raw is None:
        return None
    if field.origin_deg is None:
        return _two(option, raw, "X,Y in metres, like -50,20")
    lat, lon = _two(option, raw, "LAT,LON in degrees, like 55.37,10.43")
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise usage_fault(option, raw, "no latitude and longitude", "LAT,LON in degrees, like 55.37,10.43")
    return to_local_m(lat, lon, field.origin_deg)


def _two(option: str, raw: str, expected: str) -> Point:
    import math

    words = raw.replace(",", " ").replace("@", " ").split()
    try:
        first, second = (float(word) for word in words)
    except ValueError:
        first = second = math.nan
    if not (math.isfinite(first) and math.isfinite(second)):
        raise usage_fault(option, raw, "not two numbers", expected)
    return first, second


def _power(plan: Plan, profile: AnyProfile | None, setting: Scenario, sensors: Sensors) -> Power | None:
    """The power drawn with every computation at its highest; None where no profile says what that is."""
    from eadp.errors import EadpError, InputError
    from eadp.models.computing import join_profile
    from eadp.planning.coverage_report import Power

    if profile is None:
        return None
    try:
        computing: Computing = join_profile(plan, profile)
        highest = [plan.hull(i).hi for i in range(len(plan.parameters))]
        path = plan.stages[0].sets[: plan.path_count]
        drawn = [computing.power_w(highest, [*path, *sensors.sets_for(sensing)]) for sensing in (True, False)]
    except EadpError as error:
        raise InputError.at("--profile", 1, 1, str(error), "a profile that measures whole settings") from None
    return Power(setting.vehicle.cruise_power_w, *drawn)


# --- what is printed --------------------------------------------------------------------------------------------------


def _document(
    solution: Solution, ends: Sequence[Flown], mended: Sequence[str], plan: str, origin_deg: Point | None
) -> dict[str, Any]:
    """`eadp.cover/1`."""
    import math

    full, least = ends[0], ends[-1]
    document: dict[str, Any] = {
        "schema": "eadp.cover/1",
        "pattern": solution.pattern,
        "heading_deg": round(math.degrees(solution.heading_rad), 9),
        "coverage": full.coverage,
        "coverage_min": least.coverage,
        "length_m": full.length_m,
        "time_s": full.time_s,
        "lines": full.lines,
        "min_radius_m": round(min(full.min_radius_m, least.min_radius_m), 6),
        "c1": [least.c1, full.c1] if least is not full else None,
        "at_lowest_c1": {"length_m": least.length_m, "time_s": least.time_s, "lines": least.lines},
        "blocks": len(solution.blocks),
        "other_pattern_share": solution.other_share,
        "origin_deg": origin_deg,
        "normalised": list(mended),
        "plan": plan,
    }
    if full.energy_wh is not None:
        document["energy_wh"] = full.energy_wh
        document["at_lowest_c1"]["energy_wh"] = least.energy_wh
    if not math.isfinite(document["min_radius_m"]):  # a single line
        document["min_radius_m"] = None
    return document


def _titled(solution: Solution, ends: Sequence[Flown]) -> dict[str, Way]:
    """The way at each end of c1 under its title."""
    return {
        (f"c1 = {end.c1:g}: " if len(ends) > 1 else "")
        + f"{end.lines} lines, {end.length_m / 1000:.2f} km, {100 * end.coverage:.2f} % covered": solution.way(end.c1)
        for end in ends
    }


def _comments(name: str, solution: Solution, motion: Motion, ends: Sequence[Flown]) -> list[str]:
    import math

    from eadp.errors import printable

    full, least = ends[0], ends[-1]
    lines = [
        f"Covers {printable(name, 100)} with a swath of {motion.swath_m:g} m and turns of {motion.min_radius_m:g} m or "
        f"more; lines heading {math.degrees(solution.heading_rad):.1f} deg.",
        f"{full.lines} lines, {full.length_m:.0f} m",
    ]
    if least is not full:
        lines[1] += f" at c1 = 0; {least.lines} lines, {least.length_m:.0f} m at c1 = {least.c1:g}"
    return lines


def _text(solution: Solution, motion: Motion, ends: Sequence[Flown], field: Field, out: str | None) -> str:
    """A summary for people."""
    import math

    what = {
        "zamboni": f"Zamboni-like, {len(solution.blocks)} block{'s' if len(solution.blocks) != 1 else ''}",
        "dubins": "lines in an order, Dubins turns",
    }[solution.pattern]
    lines = [
        f"field      {field.area_m2 / 1e4:.2f} ha" + (f", {len(field.holes)} holes" if field.holes else ""),
        f"pattern    {what}; lines heading {math.degrees(solution.heading_rad):.1f}°",
    ]
    for end in ends:
        at = f" at c1 = {end.c1:g}" if len(ends) > 1 else ""
        energy = f", {end.energy_wh:.2f} Wh" if end.energy_wh is not None else ""
        lines.append(
            f"{'covers' if end is ends[0] else '':<10} {100 * end.coverage:.2f} %{at}: {end.lines} lines, "
            f"{end.length_m / 1000:.2f} km, {end.time_s:.0f} s{energy}"
        )
    lines.append(f"turns      {min(end.min_radius_m for end in ends):.2f} m or wider")
    if solution.other_share is not None:
        other = "lines in an order" if solution.pattern == "zamboni" else "the Zamboni-like motion, whose c1 varies it,"
        lines.append(f"instead    {other} would take {solution.other_share:.2f} times as long")
    if motion.wind_mps != (0.0, 0.0):
        lines.append(f"wind       {math.hypot(*motion.wind_mps):g} m/s; times are in it")
    if out is not None and out != "-":
        lines.append(f"written    {out}")
    return "\n".join(lines)

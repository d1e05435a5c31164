"""`eadp cover`."""

from __future__ import annotations

import enum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eadp.cli.output import emit, emit_json, usage_fault, warn

LEAST_RADIUS_M = 0.1
FARTHEST_M = 50_000.0

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eadp.core.geometry.curves import Point
    from eadp.coverage.cover import CoverageSolution
    from eadp.coverage.plan_builder import FieldComputations
    from eadp.coverage.report import PathReport, PowerDraw
    from eadp.coverage.swaths import CoveragePath, MotionLimits
    from eadp.errors import Fault
    from eadp.io.scenario.scenario_file import Scenario
    from eadp.models.computing import Computing
    from eadp.models.field import Field
    from eadp.models.plan.plan import Plan
    from eadp.models.profile_sum import AnyProfile


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
            help="Distance of the lines [m]; at c1 = 0 where c1 widens it up to the swath, half of which it is unless "
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
    from eadp.coverage.cover import CoverageRequest, cover
    from eadp.coverage.plan_builder import plan_of
    from eadp.coverage.report import flown
    from eadp.errors import Fault, Infeasible
    from eadp.io.field.reader import read_field
    from eadp.io.plan.text import plan_text
    from eadp.io.text.streams import read_text, write_text

    setting = _scenario(scenario)
    measured = _profile(profile, setting)
    sensors = _sensors(measured, turns_off)
    motion = _motion(setting, min_radius, swath, radius, spacing, wind, airspeed)
    text = read_text(file)
    field, mended = read_field(text, metres=metres, feature=feature)
    request = CoverageRequest(
        field,
        motion,
        pattern.value,
        _heading_rad(heading),
        _point("--start", start, field),
        _point("--home", home, field),
        order_spacing_m=spacing,
    )
    _check_places(file, out, plot)
    try:
        solution = cover(request)
    except Infeasible as error:
        warn([Fault(text.name, 1, 1, str(error), "a field, a pattern, a swath and a spacing that go together")])
        return 1
    plan = plan_of(solution, name=text.name, sensors=sensors, min_radius_m=min_radius, origin_deg=field.origin_deg)
    power = _power(plan, measured, setting, sensors)
    ends = [flown(solution, field, motion, c1, power) for c1 in dict.fromkeys((0.0, solution.lowest_c1))]
    body = "".join(f"% {line}\n" for line in _comments(text.name, solution, motion, ends)) + plan_text(plan)
    wanted = format_ or (CoverFormat.plan if out in (None, "-") else CoverFormat.text)
    if out == "-" and wanted is not CoverFormat.plan:
        raise usage_fault("--out", out, f"standard output is taken by --format {wanted.value}", "a file")
    if out not in (None, "-"):
        write_text(out, body)
    if plot is not None:
        from eadp.io.figures.pictures import write_coverage_figure

        write_coverage_figure(plot, field, _titled(solution, ends), swath)
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


def _note(name: str, what: str) -> Fault:
    from eadp.errors import Fault

    return Fault(name, 1, 1, what, severity="note")


def _check_places(file: str, out: str | None, plot: str | None) -> None:
    """Refuse places that cannot be written to before anything is written, and one place for two files."""
    from pathlib import Path

    from eadp.io.figures.pictures import check_picture_name

    places = {"--out": out, "--plot": plot}
    taken = [Path(file).resolve()] if file != "-" else []
    for option, place in places.items():
        if place is None or place == "-":
            continue
        if option == "--plot":
            check_picture_name(place)
        if not Path(place).absolute().parent.is_dir():
            raise usage_fault(option, place, "no such folder", "a place that can be written to")
        if Path(place).resolve() in taken:
            raise usage_fault(option, place, "is the field's own file, or the plan's", "a file of its own")
        taken.append(Path(place).resolve())


# --- options ----------------------------------------------------------------------------------------------------------


def _scenario(path: str | None) -> Scenario:
    from eadp.io.scenario.scenario_file import read_scenario

    return read_scenario(path, {})


def _profile(path: str | None, setting: Scenario) -> AnyProfile | None:
    from eadp.io.profile.model_file import read_profile

    used = path or setting.profile_path
    if used is None:
        return None
    profile, warnings = read_profile(used)
    warn(warnings)
    return profile


def _sensors(profile: AnyProfile | None, turns_off: bool) -> FieldComputations:
    """The computations that a profile measures, over what it measures in whole numbers."""
    import math

    from eadp.coverage.plan_builder import FieldComputations
    from eadp.models.plan.plan import Box

    if profile is None:
        return FieldComputations()
    sets = []
    for name in profile.names:
        lo, hi = profile.range_of(name)
        lo = max(lo, 0.0)  # computations' sets begin at 0 or more
        whole = Box(float(math.ceil(lo)), float(math.floor(hi))) if math.ceil(lo) <= math.floor(hi) else Box(lo, hi)
        sets.append(whole)
    return FieldComputations(tuple(zip(profile.names, profile.units, strict=True)), tuple(sets), turns_off)


def _motion(
    setting: Scenario,
    min_radius: float,
    swath: float,
    radius: float | None,
    spacing: float | None,
    wind: str | None,
    airspeed: float | None,
) -> MotionLimits:
    from eadp.coverage.swaths import RADIUS_SHARE, SPACING_SHARE, MotionLimits

    ideal = min(RADIUS_SHARE * min_radius, 1e5) if radius is None else radius
    apart = SPACING_SHARE * swath if spacing is None else spacing
    speed = setting.keys.vehicle.airframe.airspeed_mps if airspeed is None else airspeed
    for option, value, least, most in (
        ("--min-radius", min_radius, LEAST_RADIUS_M, 1e5),
        ("--swath", swath, 0.0, 1e5),
        ("--radius", ideal, min_radius, 1e5),
        ("--spacing", apart, 0.0, swath),
        ("--airspeed", speed, 0.0, 1e3),
    ):
        closed = option in ("--radius", "--min-radius")
        if not ((least <= value if closed else least < value) and value <= most):
            expected = f"from {least:g} to {most:g}" if closed else f"above {least:g}, at most {most:g}"
            raise usage_fault(option, f"{value:g}", f"{value:g} cannot stand here", expected)
    blowing = setting.keys.wind.steady_mps if wind is None else _wind_mps(wind)
    speed_of_wind = (blowing[0] ** 2 + blowing[1] ** 2) ** 0.5
    if speed_of_wind >= speed:
        message = f"a wind of {speed_of_wind:g} m/s, no slower than the aircraft"
        raise usage_fault("--wind", wind or "", message, f"less than its {speed:g} m/s")
    return MotionLimits(swath, min_radius, ideal, apart, speed, blowing)


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
    from eadp.core.geometry.geodesy import to_local_m

    if raw is None:
        return None
    if field.origin_deg is None:
        return _near(option, raw, _two(option, raw, "X,Y in metres, like -50,20"), field)
    lat, lon = _two(option, raw, "LAT,LON in degrees, like 55.37,10.43")
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise usage_fault(option, raw, "no latitude and longitude", "LAT,LON in degrees, like 55.37,10.43")
    return _near(option, raw, to_local_m(lat, lon, field.origin_deg), field)


def _near(option: str, raw: str, point: Point, field: Field) -> Point:
    """A place no farther from the field than a flight could mean."""
    import math

    away_m = min(math.dist(point, vertex) for vertex in field.outline)
    if away_m > FARTHEST_M:
        message = f"{away_m / 1000:.0f} km from the field"
        raise usage_fault(option, raw, message, f"{FARTHEST_M / 1000:g} km or less (LAT,LON in that order, or X,Y)")
    return point


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


def _power(plan: Plan, profile: AnyProfile | None, setting: Scenario, sensors: FieldComputations) -> PowerDraw | None:
    """The power drawn with every computation at its highest; None where no profile says what that is."""
    from eadp.coverage.report import PowerDraw
    from eadp.errors import EadpError, InputError
    from eadp.models.computing import join_profile

    if profile is None:
        return None
    try:
        computing: Computing = join_profile(plan, profile)
        highest = [plan.hull(i).hi for i in range(len(plan.parameters))]
        path = plan.stages[0].sets[: plan.path_count]
        drawn = [computing.power_w(highest, [*path, *sensors.sets_for(sensing)]) for sensing in (True, False)]
    except EadpError as error:
        raise InputError.at("--profile", 1, 1, str(error), "a profile that measures whole settings") from None
    return PowerDraw(setting.keys.vehicle.airframe.cruise_power_w, *drawn)


# --- what is printed --------------------------------------------------------------------------------------------------


def _document(
    solution: CoverageSolution, ends: Sequence[PathReport], mended: Sequence[str], plan: str, origin_deg: Point | None
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
        "c1_steps": solution.blocks[0].steps() if solution.blocks else [],
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


def _titled(solution: CoverageSolution, ends: Sequence[PathReport]) -> dict[str, CoveragePath]:
    """The way at each end of c1 under its title."""
    from eadp.core.expressions.expression import number_text

    return {
        (f"c1 = {number_text(end.c1)}: " if len(ends) > 1 else "")
        + f"{end.lines} lines, {end.length_m / 1000:.2f} km, {100 * end.coverage:.2f} % covered": solution.way(end.c1)
        for end in ends
    }


def _comments(name: str, solution: CoverageSolution, motion: MotionLimits, ends: Sequence[PathReport]) -> list[str]:
    import math

    from eadp.core.expressions.expression import number_text
    from eadp.errors import printable

    full, least = ends[0], ends[-1]
    lines = [
        f"Covers {printable(name, 100)} with a swath of {motion.swath_m:g} m and turns of {motion.min_radius_m:g} m or "
        f"more; lines heading {math.degrees(solution.heading_rad):.1f} deg.",
        f"{full.lines} lines, {full.length_m:.0f} m",
    ]
    if least is not full:
        at = number_text(least.c1)
        lines[1] += f" at c1 = 0; {least.lines} lines, {least.length_m:.0f} m at c1 = {at}"
        lines.append(f"A lap less in each block at c1 = {', '.join(f'{c1:.0f}' for c1 in solution.blocks[0].steps())}")
    return lines


def _text(
    solution: CoverageSolution, motion: MotionLimits, ends: Sequence[PathReport], field: Field, out: str | None
) -> str:
    """A summary for people."""
    import math

    from eadp.core.expressions.expression import number_text

    what = {
        "zamboni": f"Zamboni-like, {len(solution.blocks)} block{'s' if len(solution.blocks) != 1 else ''}",
        "dubins": "lines in an order, Dubins turns",
    }[solution.pattern]
    lines = [
        f"field      {field.area_m2 / 1e4:.2f} ha"
        + (f", {len(field.holes)} hole{'s' if len(field.holes) > 1 else ''}" if field.holes else ""),
        f"pattern    {what}; lines heading {math.degrees(solution.heading_rad):.1f}°",
    ]
    for end in ends:
        at = f" at c1 = {number_text(end.c1)}" if len(ends) > 1 else ""
        energy = f", {end.energy_wh:.2f} Wh" if end.energy_wh is not None else ""
        lines.append(
            f"{'covers' if end is ends[0] else '':<10} {100 * end.coverage:.2f} %{at}: {end.lines} lines, "
            f"{end.length_m / 1000:.2f} km, {end.time_s:.0f} s{energy}"
        )
    if solution.blocks:
        steps = ", ".join(f"{c1:.0f}" for c1 in solution.blocks[0].steps())
        lines.append(f"laps       one less in each block at c1 = {steps}")
    tightest = min(end.min_radius_m for end in ends)
    lines.append(f"turns      {f'{tightest:.2f} m or wider' if math.isfinite(tightest) else 'none'}")
    if solution.other_share is not None:
        other = "lines in an order" if solution.pattern == "zamboni" else "the Zamboni-like motion, whose c1 varies it,"
        lines.append(f"instead    {other} would take {solution.other_share:.2f} times as long")
    if motion.wind_mps != (0.0, 0.0):
        lines.append(f"wind       {math.hypot(*motion.wind_mps):g} m/s; times are in it")
    if out is not None and out != "-":
        lines.append(f"written    {out}")
    return "\n".join(lines)

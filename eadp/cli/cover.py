"""`eadp cover`."""

from __future__ import annotations

import enum
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from eadp.cli.output import emit, emit_json, usage_fault, warn
from eadp.errors import Fault, Infeasible

if TYPE_CHECKING:
    from eadp.core.geometry.curves import Point
    from eadp.coverage.swaths import MotionLimits
    from eadp.io.scenario.scenario_file import Scenario
    from eadp.models.field import Field

MIN_RADIUS_M = 0.1
MAX_LENGTH_M = 1e5
MAX_AIRSPEED_MPS = 1e3
MAX_DISTANCE_M = 50_000.0
"""Largest distance of the start and home points from the field [m]."""


class Pattern(enum.StrEnum):
    """Coverage patterns."""

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
        typer.Option(help="Ideal turning radius [m]; by default 1.5 times the smallest.", metavar="METRES"),
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option(
            help="Distance of the lines [m]. Of Zamboni-like laps at c1 = 0, by default half the swath, up to which c1 "
            "widens it; of lines in an order by default the swath.",
            metavar="METRES",
        ),
    ] = None,
    heading: Annotated[
        float | None,
        typer.Option(help="Heading of the lines [°], a compass bearing; the quickest by default.", metavar="DEG"),
    ] = None,
    pattern: Annotated[
        Pattern, typer.Option(help="Zamboni-like laps, lines in an order with Dubins turns, or the shorter.")
    ] = Pattern.auto,
    turns_off: Annotated[bool, typer.Option("--turns-off", help="Computations stop on turns.")] = False,
    metres: Annotated[bool, typer.Option("--metres", help="The file is in local metres, not degrees.")] = False,
    feature: Annotated[
        str | None, typer.Option(help="Which polygon of a file that holds several: id, name or number.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="Where the flight starts: X,Y [m], or LAT,LON [°].", metavar="POINT")
    ] = None,
    home: Annotated[str | None, typer.Option(help="Where the flight ends; as --start.", metavar="POINT")] = None,
    wind: Annotated[
        str | None, typer.Option(help="Wind: speed [m/s] and the bearing it blows from [°].", metavar="SPEED,FROM_DEG")
    ] = None,
    airspeed: Annotated[
        float | None, typer.Option(help="Airspeed [m/s]; by default that of the scenario's vehicle.", metavar="MPS")
    ] = None,
    profile: Annotated[
        str | None, typer.Option(help="Computation profile: the plan gets its computations.", metavar="FILE")
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

    Plan the coverage of a field: from its outline to a plan whose line spacing can vary in flight.

    Exit code 0 if a plan covers the field, 1 if the pattern asked for does not fit it, 2 on bad input.
    """
    from eadp.coverage.cover import CoverageRequest
    from eadp.io.field.coverage import plan_coverage
    from eadp.io.field.reader import read_field
    from eadp.io.profile.model_file import read_profile
    from eadp.io.scenario.scenario_file import read_scenario
    from eadp.io.text.streams import read_text, write_text

    setting = read_scenario(scenario, {})
    profile_path = profile or setting.profile_path
    measured, warnings = read_profile(profile_path) if profile_path is not None else (None, [])
    warn(warnings)
    motion = _motion(setting, min_radius, swath, radius, spacing, wind, airspeed)
    text = read_text(file)
    field, repairs = read_field(text, metres=metres, feature=feature)
    request = CoverageRequest(
        field,
        motion,
        pattern.value,
        _heading_rad(heading),
        _point("--start", start, field),
        _point("--home", home, field),
        order_spacing_m=spacing,
    )
    wanted = format_ or (CoverFormat.plan if out in (None, "-") else CoverFormat.text)
    if out == "-" and wanted is not CoverFormat.plan:
        raise usage_fault("--out", out, f"standard output is taken by --format {wanted.value}", "a file")
    _check_outputs([] if file == "-" else [Path(file).resolve()], {"--out": out, "--plot": plot})
    try:
        report, plan = plan_coverage(
            request,
            text.name,
            profile=measured,
            cruise_power_w=setting.keys.vehicle.airframe.cruise_power_w,
            off_on_turns=turns_off,
        )
    except Infeasible as error:
        warn([_fault(text.name, str(error), "a field, a pattern, a swath and a spacing that fit together")])
        return 1
    if out not in (None, "-"):
        write_text(out, plan)
    if plot is not None:
        from eadp.io.figures.coverage import write_coverage_figure

        write_coverage_figure(plot, field, report.titled_paths(), swath)
    if turns_off and measured is None:
        warn([_fault("--turns-off", "no computations to stop on turns; --profile names some", severity="note")])
    if wanted is CoverFormat.json:
        emit_json(report.document(repairs, plan))
        return 0
    warn([_fault(text.name, repair, severity="note") for repair in repairs])
    written = [f"written    {out}"] if out else []
    emit(plan if wanted is CoverFormat.plan else "\n".join([*report.text(), *written]))
    return 0


def _fault(name: str, message: str, expected: str = "", severity: str = "error") -> Fault:
    return Fault(name, 1, 1, message, expected, severity=severity)


def _check_outputs(taken: list[Path], outputs: dict[str, str | None]) -> None:
    """Refuse, before anything is written, a file that cannot be written and one that is used twice."""
    from eadp.io.figures.canvas import check_figure_name

    for option, name in outputs.items():
        if name is None or name == "-":
            continue
        if option == "--plot":
            check_figure_name(name)
        path = Path(name).resolve()
        if not Path(name).absolute().parent.is_dir():
            raise usage_fault(option, name, "no such folder", "a file in an existing folder")
        if path in taken:
            raise usage_fault(option, name, "is the field's own file, or the plan's", "a file of its own")
        taken.append(path)


# --- options ----------------------------------------------------------------------------------------------------------


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

    ideal = min(RADIUS_SHARE * min_radius, MAX_LENGTH_M) if radius is None else radius
    apart = SPACING_SHARE * swath if spacing is None else spacing
    speed = setting.keys.vehicle.airframe.airspeed_mps if airspeed is None else airspeed
    for option, value, low, high, closed in (
        ("--min-radius", min_radius, MIN_RADIUS_M, MAX_LENGTH_M, True),
        ("--swath", swath, 0.0, MAX_LENGTH_M, False),
        ("--radius", ideal, min_radius, MAX_LENGTH_M, True),
        ("--spacing", apart, 0.0, swath, False),
        ("--airspeed", speed, 0.0, MAX_AIRSPEED_MPS, False),
    ):
        if not (low < value <= high or (closed and value == low)):
            expected = f"from {low:g} to {high:g}" if closed else f"above {low:g}, at most {high:g}"
            raise usage_fault(option, f"{value:g}", f"{value:g} is out of range", expected)
    wind_mps = setting.keys.wind.steady_mps if wind is None else _wind_mps(wind)
    if math.hypot(*wind_mps) >= speed:
        message = f"a wind of {math.hypot(*wind_mps):g} m/s, no slower than the aircraft"
        raise usage_fault("--wind", wind or "", message, f"less than its {speed:g} m/s")
    return MotionLimits(swath, min_radius, ideal, apart, speed, wind_mps)


def _wind_mps(raw: str) -> Point:
    """The wind's vector (east, north), of its speed and the compass bearing that it blows from."""
    speed, from_deg = _two_numbers("--wind", raw, "a speed [m/s] and a bearing [°], like 5,270 for a west wind")
    if speed < 0:
        raise usage_fault("--wind", raw, f"a speed of {speed:g}", "0 or more")
    angle = math.radians((270 - from_deg) % 360)
    return speed * math.cos(angle), speed * math.sin(angle)


def _heading_rad(heading_deg: float | None) -> float | None:
    """The mathematical heading (0 east, counter-clockwise) of a compass bearing."""
    if heading_deg is None:
        return None
    if not math.isfinite(heading_deg):
        raise usage_fault("--heading", f"{heading_deg}", "no heading", "a compass bearing [°]: 0 north, 90 east")
    return math.radians((90 - heading_deg) % 360)


def _point(option: str, raw: str | None, field: Field) -> Point | None:
    """A point in the field's coordinates: metres, or latitude and longitude if the field was given in degrees."""
    from eadp.core.geometry.geodesy import to_local_m

    if raw is None:
        return None
    if field.origin_deg is None:
        point = _two_numbers(option, raw, "X,Y in metres, like -50,20")
    else:
        expected = "LAT,LON in degrees, like 55.37,10.43"
        lat, lon = _two_numbers(option, raw, expected)
        if not (abs(lat) <= 90 and abs(lon) <= 180):
            raise usage_fault(option, raw, "no latitude and longitude", expected)
        point = to_local_m(lat, lon, field.origin_deg)
    distance_m = min(math.dist(point, vertex) for vertex in field.outline)
    if distance_m > MAX_DISTANCE_M:
        message = f"{distance_m / 1000:.0f} km from the field"
        raise usage_fault(option, raw, message, f"{MAX_DISTANCE_M / 1000:g} km or less (LAT,LON in that order, or X,Y)")
    return point


def _two_numbers(option: str, raw: str, expected: str) -> Point:
    try:
        first, second = (float(word) for word in raw.replace(",", " ").replace("@", " ").split())
    except ValueError:
        first = second = math.nan
    if not (math.isfinite(first) and math.isfinite(second)):
        raise usage_fault(option, raw, "not two numbers", expected)
    return first, second

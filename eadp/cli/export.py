"""`eadp export`."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from eadp.cli.options import LapsOption, ScenarioOption
from eadp.cli.output import emit, usage_fault, warn
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.errors import Fault, InputError, PathUndefined, printable
from eadp.io.mission import EXPORT_NAMES
from eadp.models.airspace import risk_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eadp.io.flight.inputs import FlightInputs
    from eadp.models.plan.legs import Leg
    from eadp.models.plan.plan import Plan
    from eadp.models.vehicle import Airframe
    from eadp.planning.forecast.held import Preflight

ExportName = StrEnum("ExportName", {name: name for name in EXPORT_NAMES})  # type: ignore[misc]
"""Formats by name."""


def command(
    plan: Annotated[
        str, Argument(help="Plan, or mission (QGroundControl's plan, WPL), - for standard input.", metavar="PLAN")
    ],
    to: Annotated[
        ExportName,
        Option(help="Plan of QGroundControl, WPL for ArduPilot, flight plan of Paparazzi, or a map or track."),
    ],
    altitude: Annotated[
        float | None,
        Option(help="Altitude above home [m], where the plan has none; by default the aircraft's.", metavar="METRES"),
    ] = None,
    home: Annotated[
        str | None, Option(help="Where to take off and return to: LAT,LON [°]; by default neither.", metavar="POINT")
    ] = None,
    origin: Annotated[
        str | None, Option(help="Where the plan's (0, 0) lies: LAT,LON [°], for a plan without.", metavar="POINT")
    ] = None,
    set_: Annotated[
        list[str] | None,
        Option("--set", help="A parameter, as in c1=-500; with --scenario any of its keys.", metavar="C=VALUE"),
    ] = None,
    scenario: ScenarioOption = None,
    trigger_distance: Annotated[
        float | None, Option(help="Take a picture every so many metres [m].", metavar="METRES")
    ] = None,
    tolerance: Annotated[
        float, Option(help="Largest distance of the exported path from the plan's [m].", metavar="METRES")
    ] = 1.0,
    min_radius: Annotated[
        float | None, Option(help="Turning radius of a mission's turns [m].", metavar="METRES")
    ] = None,
    laps: LapsOption = None,
    from_: Annotated[
        str | None, Option("--from", help="Write the rest, from this stage of this lap on.", metavar="STAGE,LAP")
    ] = None,
    telemetry: Annotated[
        str | None,
        Option(help="Write what is left where this telemetry ends, as then decided; with --scenario.", metavar="FILE"),
    ] = None,
    out: Annotated[str | None, Option("-o", "--out", help="Write it here.", metavar="FILE")] = None,
) -> int:
    """Example: eadp export plans/survey.plan --to qgc --origin 55.37,10.43 --set c1=-500

    Write a plan as the mission of an autopilot, or as a map: at parameters, by default each at its maximum; with
    --scenario at those that the forecast before take-off chooses, or those decided at the end of --telemetry.

    Exit code 0 if it is written, 2 on bad input.
    """
    from eadp.cli.plan import parameters_of
    from eadp.core.geometry.geodesy import FARTHEST_M, to_near_local_m
    from eadp.io.mission.export import FENCED
    from eadp.io.mission.path import PlannedPath, planned_sections
    from eadp.io.mission.reader import PlanReader
    from eadp.io.text.streams import read_text, write_text
    from eadp.models.plan.trace import nominal_legs

    if telemetry is not None and (scenario is None or from_ is not None):
        raise usage_fault("--telemetry", telemetry, "needs a planner", "--scenario, and no --from")
    for option, value in (
        ("--trigger-distance", trigger_distance), ("--tolerance", tolerance), ("--min-radius", min_radius),
    ):  # fmt: skip
        if value is not None and not 0.01 <= value <= 10_000:
            raise usage_fault(option, f"{value:g}", f"{value:g} m is out of range", "from 0.01 to 10000")
    if altitude is not None and not abs(altitude) <= 10_000:
        raise usage_fault("--altitude", f"{altitude:g}", f"{altitude:g} m is out of range", "from -10000 to 10000")
    places = {"--home": home, "--origin": origin}
    points = {option: _position_deg(option, raw) for option, raw in places.items() if raw is not None}
    forecast, airframe = None, _default_airframe()
    if scenario is None:
        text = read_text(plan)
        flown, findings = PlanReader(laps=laps).turning(min_radius)(text)
        warn([finding.fault(text.name) for finding in findings])
        name, parameters = text.name, parameters_of(flown, set_)
    else:
        from eadp.io.flight.inputs import load_flight
        from eadp.io.scenario.scenario_file import override_texts, read_overrides

        overrides = read_overrides(override_texts(set_ or (), laps=laps))
        inputs = load_flight(plan, scenario_path=scenario, overrides=overrides)
        warn(inputs.warnings)
        forecast = inputs.preflight() if telemetry is None else None
        if forecast is None and telemetry is None:
            message = "the forecast before take-off finds no parameters"
            raise usage_fault("--scenario", scenario, message, "a battery that is drained, or --set without --scenario")
        flown, name = inputs.world.plan, inputs.texts["plan"].name
        airframe = inputs.world.vehicle
    if flown.site.origin_deg is not None and "--origin" in points:
        raise usage_fault("--origin", origin or "", "the plan has an origin", "no --origin")
    place = flown.site.origin_deg or points.get("--origin")
    if place is None:
        raise InputError.at(name, 1, 1, "the plan has no place on the earth", "--origin LAT,LON")
    if "--home" in points and to_near_local_m(*points["--home"], place) is None:
        expected = f"LAT,LON in that order, within {FARTHEST_M / 1000:g} km"
        raise usage_fault("--home", home or "", "is far from the plan's origin", expected)
    if altitude is None and any(stage.altitude_m is None for stage in flown.stages):
        message = f"altitude {airframe.cruise_altitude_m:g} m, the aircraft's; --altitude sets another"
        warn([Fault(name, 1, 1, message, severity="note")])
    try:
        if telemetry is not None:
            legs = _after(inputs, telemetry, name)
        else:
            legs = nominal_legs(flown, parameters) if forecast is None else forecast.legs(inputs.mission)
    except PathUndefined as error:
        raise InputError.at(name, flown.stages[0].line, 1, str(error), "a path that can be flown") from None
    if forecast is not None:
        warn([Fault(name, 1, 1, _forecast_text(forecast, flown, legs), severity="note")])
    if from_ is not None:
        legs = _rest(legs, from_)
    if any(flown.site.airspace) and to.value not in FENCED:
        message = f"obstacles and boundary are not in the format {to.value}"
        warn([Fault(name, 1, 1, message, severity="note")])
    home_m = flown.site.home_m if "--home" not in points else None
    path = PlannedPath(
        (flown.site.field.name if flown.site.field else "") or printable(name.rpartition("/")[2]),
        planned_sections(legs),
        place,
        airframe.cruise_altitude_m if altitude is None else altitude,
        airframe.airspeed_mps,
        points.get("--home") if home_m is None else to_geodetic_deg(*home_m, place),
        trigger_distance,
        tolerance,
        flown.site.airspace,
    )
    from eadp.io.mission.export import EXPORTS

    written = EXPORTS[to.value](path)
    if out is None or out == "-":
        emit(written)
    else:
        write_text(out, written)
    return 0


def _forecast_text(forecast: Preflight, plan: Plan, legs: Sequence[Leg]) -> str:
    """The forecast that is exported, for people."""
    segments = forecast.segments(plan)
    chosen = []
    for item in plan.parameters[: plan.path_count]:
        values = segments.get(item.name, (forecast.parameters[item.name],))
        chosen.append(f"{item.label} = {' then '.join(map(item.text, values[:2]))}")
    end, length_m = forecast.forecast, sum(leg.distance_m for leg in legs)
    reserve = f"; keeps the reserve with {100 * (end.reserve_probability or 0.0):.1f} %"
    energy = "" if end.energy_wh is None else f", {end.energy_wh:.2f} Wh"
    at = f"at {', '.join(chosen)}: " if chosen else ""
    risks = "".join(f"; {risk_text(name, share)}" for name, share in forecast.entering.items())
    return f"forecast {at}{length_m / 1000:.2f} km, {end.remaining_s:.0f} s{energy}{reserve}{risks}"


def _after(inputs: FlightInputs, telemetry: str, name: str) -> tuple[Leg, ...]:
    """The legs that are left after telemetry; what was decided is said."""
    from eadp.io.telemetry.replan import rest_after

    legs, decision = rest_after(inputs, telemetry, lambda fault: warn([fault]))
    if not legs or decision is None:
        raise usage_fault("--telemetry", telemetry, "leaves nothing to fly", "telemetry of a flight that goes on")
    parameters = inputs.world.plan.parameters
    values = ", ".join(f"{item.label} = {item.text(decision['parameters'][item.name])}" for item in parameters)
    length_m, end = sum(leg.distance_m for leg in legs), decision["soc_end_forecast"]
    message = f"after {decision['time_s']:g} s, in stage {decision['stage']} of lap {decision['lap']}, at {values}: "
    message += f"{length_m / 1000:.2f} km left, SoC {math.nan if end is None else end:.3f} at the end"
    warn([Fault(name, 1, 1, message, severity="note")])
    return legs


def _rest(legs: tuple[Leg, ...], raw: str) -> tuple[Leg, ...]:
    """The legs from a stage of a lap on."""
    try:
        stage, lap = map(int, raw.split(","))
    except ValueError:
        raise usage_fault("--from", raw, "no stage and lap", "two whole numbers, as in 3,2") from None
    for i, leg in enumerate(legs):
        if (leg.stage.index, leg.lap) == (stage, lap):
            return legs[i:]
    last = max((leg.lap for leg in legs if leg.stage.index == stage), default=None)
    known = "one of the plan" if last is None else f"a lap from 0 to {last}"
    raise usage_fault("--from", raw, f"stage {stage} is not flown in lap {lap}", known)


def _default_airframe() -> Airframe:
    from eadp.models.vehicle import FixedWing

    return FixedWing()


def _position_deg(option: str, raw: str) -> tuple[float, float]:
    """Latitude and longitude of an option [°]."""
    try:
        latitude, longitude = (float(part) for part in raw.split(","))
    except ValueError:
        latitude = longitude = math.nan
    if not (abs(latitude) <= 85 and abs(longitude) <= 180):
        raise usage_fault(option, raw, "no position", "a latitude within ±85° and a longitude, as in 55.37,10.43")
    return latitude, longitude

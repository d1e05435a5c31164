"""A flight in simulation, its forecast before take-off, and its results: a folder, tables, figures."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from eadp.api.given import File, Overrides, Warn, python_warnings
from eadp.api.inputs import FlightInputs, load_flight
from eadp.core.arrays import FloatArray
from eadp.core.geometry.geodesy import to_geodetic_deg
from eadp.io.flight import flown_coverage, flown_of_plan
from eadp.io.scenario import override_texts, read_overrides
from eadp.io.text.csv import write_rows
from eadp.io.text.streams import Text, new_folder
from eadp.models.energy import EnergyModel
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import PATH
from eadp.models.profile import Profile
from eadp.models.world import Step, World
from eadp.planning.base import DecisionRecord, Ending, HomeRecord, PlannerSettings
from eadp.planning.forecast.held import Preflight
from eadp.planning.registry import PlannedFlight
from eadp.plug_ins import plug_in, plug_ins
from eadp.simulation.loop import RETURNED, Outcome, fly

SCHEMA: Literal["eadp.flight/1"] = "eadp.flight/1"
SUMMARY, OVERRIDES, REPORT = "summary.json", "overrides.txt", "report.html"
"""Files of a flight's folder."""
CLOCKED = ("median_ms", "max_ms")
"""Keys of a summary's solver that depend on the machine and its load."""
COUNTED = "calls", "solved", "retried", "failed", "fallbacks", "skipped"
"""Counts of a summary's solver, as of `SolverReport`."""
AIRSPEEDS = "airspeed_mps", "airspeed_commanded_mps"
"""Columns of `flight.csv` where the airspeed is decided."""

WHOLE = 0.995
"""Share of a way that is printed as 100 %: one pack is enough for it, if not with the probability that is asked for."""


def summarise(
    world: World,
    flight: PlannedFlight,
    outcome: Outcome,
    settings: PlannerSettings,
    expected: Preflight | None = None,
    never_past: str = "",
) -> dict[str, Any]:
    """The summary of a flight as `summary.json` holds it; units end the keys' names.

    `settings` are the planner's; `expected` is the forecast before take-off, `never_past` as of `FlightInputs`.
    """
    log, report = outcome.parameters, flight.planner.report
    parameters: dict[str, dict[str, Any]] = {}
    for i, parameter in enumerate(world.mission.plan.parameters):
        record = log.records[i]
        first, last, changes = record.first, record.last, len(record.history)
        own: dict[str, Any] = {"mean": log.mean(i), "first": first, "last": last, "changes": changes}
        if parameter.kind == PATH:
            own["changes_at"] = [list(change) for change in record.history]
        if parameter.title:
            own |= {"title": parameter.title, "unit": parameter.unit}
        if parameter.stands_for is not None:
            shown = parameter.shown
            own["shown"] = {"mean": log.mean(i, shown), "first": shown(first), "last": shown(last)}
        parameters[parameter.name] = own
    duration_s = outcome.duration_s
    mean_w = outcome.energy_j / duration_s if duration_s else None
    return {
        "schema": SCHEMA,
        "completed": outcome.completed,
        "reserve_kept": (outcome.completed or outcome.reason == RETURNED) and outcome.soc_final >= settings.reserve_soc,
        "turned_back_s": None if outcome.turned_back_s is None else round(outcome.turned_back_s, 9),
        "turned_back_m": None if outcome.turned_back_m is None else list(outcome.turned_back_m),
        "reason": outcome.reason,
        "planner": settings.name,
        "field": None if world.mission.plan.site.field is None else world.mission.plan.site.field.summary,
        "duration_s": round(duration_s, 9),
        "distance_m": outcome.distance_m,
        "energy_wh": outcome.energy_j / 3600,
        "power_w": {"mean": mean_w, "min": outcome.power_min_w, "max": outcome.power_max_w},
        "soc_final": outcome.soc_final,
        "soc_reserve": settings.reserve_soc,
        "period_s": None if flight.power is None else flight.power.period_s,
        "parameters": parameters,
        "quality": log.quality(settings.weights),
        "coverage": None,
        "obstacles": [each._asdict() for each in outcome.entries],
        "paper_metric": log.paper_metric(outcome.soc_final),
        "endurance_s": world.mission.battery.endurance_s(mean_w) if mean_w else None,
        "decisions": len(outcome.records),
        "replans": report.replans,
        "solver": {
            **{name: getattr(report, name) for name in COUNTED},
            "by_status": dict(sorted(report.by_status.items())),
            "gap_max": max(report.gaps, default=None),
            "median_ms": statistics.median(report.solve_ms) if report.solve_ms else None,
            "max_ms": max(report.solve_ms, default=None),
        },
        "energy_forecast": None if expected is None else forecast_values(expected),
        "never_past": never_past or None,
        "seed": world.seed,
    }


def repeatable(summary: Mapping[str, Any]) -> dict[str, Any]:
    """A summary without what the clock of the machine gives: `CLOCKED`."""
    solver = {key: value for key, value in summary["solver"].items() if key not in CLOCKED}
    return {**summary, "solver": solver}


def forecast_values(expected: Preflight) -> dict[str, Any]:
    """The content of `energy_forecast`."""
    forecast = expected.forecast
    values: dict[str, Any] = {
        "completes": (forecast.completes_probability or 0.0) >= 0.5,
        "completes_probability": forecast.completes_probability,
        "reserve_probability": forecast.reserve_probability,
        "time_s": forecast.remaining_s,
        "time_std_s": forecast.remaining_std_s,
        "energy_wh": forecast.energy_wh,
        "energy_std_wh": forecast.energy_std_wh,
        "computing_wh": expected.computing_wh,
        "soc_end": forecast.soc_end,
        "soc_end_std": forecast.soc_end_std,
        "parameters": expected.parameters,
        "quality": expected.quality,
        "turn_back_s": None if expected.turn_back is None else expected.turn_back.time_s,
        "turn_back_m": None if expected.turn_back is None else list(expected.turn_back.position_m),
        "batteries": batteries(expected),
        "reach_share": None if expected.reach is None else expected.reach.share,
        "reach_s": None if expected.reach is None else expected.reach.time_s,
        "reach_m": None if expected.reach is None else list(expected.reach.position_m),
        "obstacles": [{"name": name, "probability": share} for name, share in expected.entering.items()],
        "stages": [
            {"stage": stage, "time_s": seconds, "energy_wh": energy_wh}
            for stage, (seconds, energy_wh) in sorted(expected.stages.items())
        ],
    }
    if expected.autopilot_text:
        values["autopilot"] = expected.autopilot_text
    if (own := expected.at_cruise) is not None:
        values["airspeeds_mps"] = list(expected.airspeeds_mps)
        values["at_cruise"] = {
            "airspeed_mps": own.evaluated[0].known.airspeed_mps,
            "completes_probability": own.forecast.completes_probability,
            "time_s": own.forecast.remaining_s,
            "soc_end": own.forecast.soc_end,
            "quality": own.quality,
        }
    return values


def batteries(expected: Preflight) -> int | None:
    """Packs that a mission takes at least, each down to the reserve with its probability; None if one is of no use.

    Ways home and back to the mission are not in it.
    """
    share = 0.0 if expected.reach is None else expected.reach.energy_share
    if expected.feasible or (expected.reach is not None and expected.reach.share > WHOLE):
        return 1
    return max(2, math.ceil(1 / share - 1e-9)) if share > 0 else None


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight that was flown.

    Attributes
    ----------
    inputs : FlightInputs
        What was flown.
    summary : dict
        The content of `summary.json`, and the solver's times of `timings.json`.
    steps : list of Step
        The logged moments, the rows of `flight.csv`.
    decisions : list of DecisionRecord
        The re-plannings, the lines of `decisions.jsonl`; empty for a planner that records none.
    estimates : sequence of estimates
        That of the power at each step, the rows of `estimate.csv`.
    overrides : sequence of str
        The overrides of the scenario's keys, each as key=value.
    """

    inputs: FlightInputs
    summary: dict[str, Any]
    steps: list[Step]
    decisions: Sequence[DecisionRecord] = ()
    overrides: Sequence[str] = ()
    estimates: Sequence[Any] = ()

    @cached_property
    def estimate_rows(self) -> list[Sequence[str | float]]:
        """Header and rows of `estimate.csv`; empty without a log."""
        table = plug_in("estimators", "power").table
        return list(table(self.steps, self.estimates, self.inputs.mission.battery)) if self.estimates else []

    def __repr__(self) -> str:
        """One line, not the log."""
        summary, name = self.summary, self.inputs.mission.plan.name.rpartition("/")[2]
        ended = "completed" if summary["completed"] else f"NOT completed: {summary['reason']}"
        used = f"{summary['duration_s']:.0f} s, {summary['energy_wh']:.2f} Wh"
        return f"<Flight of {name}: {ended}, {used}, {100 * summary['soc_final']:.0f} % of the charge left>"

    @cached_property
    def columns(self) -> dict[str, FloatArray]:
        """The columns of `flight.csv` by name, such as time_s, x_m, soc and c1; each an array, shape (steps,)."""
        names, *rows = self._table
        return dict(zip(names, np.array(rows, dtype=float).T, strict=True))

    @cached_property
    def _table(self) -> list[list[Any]]:
        """Names and rows of `flight.csv`, which has airspeeds where they are decided."""
        plan, origin_deg = self.inputs.mission.plan, self.inputs.mission.plan.site.origin_deg
        speeds = () if self.inputs.mission.vehicle.airspeed_range_mps is None else AIRSPEEDS
        fixed, earth = [name for name in Step._fields[:-1] if name not in AIRSPEEDS], ["lat_deg", "lon_deg"]
        rows: list[list[Any]] = [[*fixed, *plan.names, *(earth if origin_deg else []), *speeds]]
        for step in self.steps:
            row = [round(step.time_s, 9), *(getattr(step, name) for name in fixed[1:]), *step.parameters]
            if origin_deg is not None:
                row += [round(each, 9) for each in to_geodetic_deg(step.x_m, step.y_m, origin_deg)]
            rows.append([*row, *(getattr(step, name) for name in speeds)])
        return rows

    def write(self, folder: str | Path, *, force: bool = False, figure: str | None = None) -> None:
        """Write the result folder, whole or not at all.

        Parameters
        ----------
        folder : str or Path
        force : bool, optional
            Whether a folder of this name is replaced.
        figure : str, optional
            One more figure: `paper`, the letter's Figs. 6b and 1, as `paper.svg` and `.png`.

        Raises
        ------
        InputError
            If the name is taken and `force` is not set, or the folder cannot be written.
        """
        from eadp.io.figures.plan import write_flight_figure

        world = self.inputs.world
        with new_folder(str(folder), force=force) as target:
            _write_csv(target / "flight.csv", self._table)
            _write_csv(target / "estimate.csv", self.estimate_rows)
            solver: Mapping[str, Any] = self.summary["solver"]
            timings: dict[str, Any] = {"schema": "eadp.timings/1", "solver": {key: solver[key] for key in CLOCKED}}
            for name, content in ((SUMMARY, repeatable(self.summary)), ("timings.json", timings)):
                text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
                (target / name).write_text(f"{text}\n", encoding="utf-8")
            rows = [record_row(record, world.mission.plan.names) for record in self.decisions]
            if rows:
                lines = (json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows)
                (target / "decisions.jsonl").write_text("".join(lines), encoding="utf-8")
            write_flight_figure(target / "flight", world, self.steps, self.summary, self.decisions)
            figures = [] if figure is None else [plug_in("result_figures", figure)]
            for write in (*figures, *plug_ins("result_writers")):
                write(self, target)
            _copy_inputs(target / "inputs", self.inputs.sources, self.overrides)


def fly_flight(
    inputs: FlightInputs,
    expected: Preflight | None = None,
    on_step: Callable[[Step], None] = lambda _step: None,
    overrides: Sequence[str] = (),
) -> Flight:
    """Fly; `expected` is the forecast before take-off, for the summary, and `on_step` is called with each step."""
    planned, flown, steps = inputs.flight(), Outcome(), []
    for step in fly(inputs.world, planned, outcome=flown):
        steps.append(step)
        on_step(step)
    summary = summarise(inputs.world, planned, flown, inputs.scenario.planner, expected, inputs.never_past)
    flight = Flight(inputs, summary, steps, flown.records, overrides, flown.estimates)
    plan = inputs.mission.plan
    if steps and plan.site.field is not None:
        flight.summary["coverage"] = flown_coverage(plan, flown_of_plan(flight.columns, flown.turned_back_s))
    return flight


def _write_csv(path: Path, rows: Iterable[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        write_rows(stream, rows)


def record_row(record: DecisionRecord, names: Sequence[str]) -> dict[str, Any]:
    """A re-planning's record as a line of `decisions.jsonl`; see `DecisionRecord` for its keys."""
    row: dict[str, Any] = {}
    for key, value in record._asdict().items():
        row |= value._asdict() if isinstance(value, (Ending, HomeRecord)) else {key: value}
    row["time_s"] = round(record.time_s, 9)
    row["parameters"] = dict(zip(names, record.parameters, strict=True))
    return row


def _copy_inputs(folder: Path, sources: Mapping[str, Text], overrides: Sequence[str]) -> None:
    """Copy inputs into a folder, each into one of its kind."""
    for kind, text in sources.items():
        copy = folder / kind / (Path(text.name).name if text.name != "<stdin>" else "stdin")
        copy.parent.mkdir(parents=True)
        copy.write_text(text.body, encoding="utf-8")
    if overrides:
        lines = "".join(f"{line}\n" for line in overrides)
        (folder / OVERRIDES).write_text(lines, encoding="utf-8", errors="surrogateescape")


def simulate(
    plan: File | Plan,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | Profile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Overrides = (),
    *,
    planner: str | None = None,
    seed: int | None = None,
    on_step: Callable[[Step], None] = lambda _step: None,
    warn: Warn = python_warnings,
) -> Flight:
    """Fly a plan in simulation, re-planning on the way.

    Parameters
    ----------
    plan : path or Plan
        A path may be that of a mission of other software.
    scenario : path or mapping, optional
        A scenario file, or its keys; by default the defaults.
    profile : path or profile, optional
        By default the scenario's.
    energy : path or EnergyModel, optional
    overrides : mapping, or iterable of str, optional
        Values by the scenario's dotted keys, as in {"wind.speed_mps": 8}, or texts, as in "wind.speed_mps=8".
    planner : str, optional
        Name of the planner, by default the scenario's.
    seed : int, optional
        Seed of gusts and noise, by default the scenario's.
    on_step : function, optional
        Called with each logged step, such as for a progress bar.
    warn : function, optional

    Returns
    -------
    Flight
        Its summary, columns and decisions; `write` writes the result folder.

    Raises
    ------
    InputError
        With every fault of the first file that has any.
    """
    texts = override_texts(overrides, planner, seed)
    inputs = load_flight(plan, scenario=scenario, profile=profile, energy=energy, overrides=read_overrides(texts))
    warn(inputs.warnings)
    return fly_flight(inputs, inputs.preflight(), on_step, texts)


def forecast(
    plan: File | Plan,
    scenario: File | Mapping[str, Any] | None = None,
    profile: File | Profile | None = None,
    energy: File | EnergyModel | None = None,
    overrides: Overrides = (),
    *,
    planner: str | None = None,
    warn: Warn = python_warnings,
) -> dict[str, Any] | None:
    """Forecast a flight before take-off, without flying it.

    Parameters
    ----------
    plan, scenario, profile, energy, overrides, planner, warn
        As `simulate`.

    Returns
    -------
    dict or None
        The content of `energy_forecast` in `summary.json`: the probabilities to complete and to keep the reserve, time,
        energy, charge at the end, parameters. None where the charge is prescribed.

    Raises
    ------
    InputError
        As `simulate`.
    """
    keys = read_overrides(override_texts(overrides, planner))
    inputs = load_flight(plan, scenario=scenario, profile=profile, energy=energy, overrides=keys)
    warn(inputs.warnings)
    found = inputs.preflight()
    return None if found is None else forecast_values(found)

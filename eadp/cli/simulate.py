"""`eadp simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from eadp.api.flight import simulate
from eadp.api.given import FlightOptions, JobKind, job_in
from eadp.cli.output import Progress, alarm, emit, emit_json, usage_fault, warn
from eadp.errors import one_of
from eadp.io.page import REPORT
from eadp.io.text.options import Flag
from eadp.io.text.streams import check_new_folder
from eadp.models.airspace import BOUNDARY, risk_text
from eadp.plug_ins import OWN, added_names, plug_in

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eadp.api.flight import Flight
    from eadp.models.world import Step


@dataclass(frozen=True)
class SimulateOutputs:
    """What is written and printed, and what the exit code says."""

    out: Annotated[str | None, Flag("-o --out", metavar="DIR")] = None
    """Folder for the results."""

    force: bool = False
    """Replace the folder, if it holds a result and nothing else."""

    figure: Annotated[str | None, Flag(metavar="NAME")] = None
    """Draw one more figure into the folder: paper, the letter's Figs. 6b and 1."""

    require_reserve: bool = False
    """Exit 1 also where the flight ends below the reserve."""

    strict_solver: bool = False
    """Exit 1 also where a run of the solver fails."""

    verbose: Annotated[bool, Flag("-v --verbose")] = False
    """Say more: the papers' quantities, the solver's runs."""

    format: Literal["text", "json"] = "text"
    """How to print."""


def command(
    plan: Annotated[
        str,
        Argument(
            help="Plan, or mission (QGroundControl's plan, WPL), - for standard input; or a folder of sorties.",
            metavar="PLAN",
        ),
    ],
    options: FlightOptions,
    output: SimulateOutputs,
    seed: Annotated[int | None, Option(min=0, help="Seed of gusts and noise.")] = None,
) -> int:
    """Example: eadp simulate plans/survey.plan --scenario scenarios/paper-i-dynamic.yaml

    Fly a plan in simulation, re-planning on the way.

    Exit code 0 if the flight completes, 1 if it does not, 2 on bad input.
    """
    if output.out is not None:
        check_new_folder(output.out, force=output.force)
    if job := job_in(plan):
        names = ("scenario", "profile", "energy")
        alone = {name: getattr(options, name) or None for name in names}
        for name, value in {**alone, "figure": output.figure}.items():
            if value is not None:
                raise usage_fault(f"--{name}", str(value), "beside a folder of sorties", "its scenario, or --set")
        from eadp.io.scenario import override_texts

        return _job(job, plan, override_texts(options.set_, options.planner), seed, output)
    if output.figure is not None and output.out is None:
        raise usage_fault("--figure", output.figure, "a figure without a folder for it", "-o DIR")
    if output.figure is not None and plug_in("result_figures", output.figure) is None:
        figures = [*OWN["result_figures"], *added_names("result_figures")]
        raise usage_fault("--figure", output.figure, "is no figure", one_of(figures, output.figure))
    progress = Progress("flying")

    def show(step: Step) -> None:
        progress.show(f"{step.time_s:.0f} s, stage {step.stage}, charge {100 * step.soc:.0f} %")

    flight = simulate(
        plan,
        options.scenario,
        options.profile,
        options.energy,
        options.set_,
        planner=options.planner,
        seed=seed,
        on_step=show,
        warn=warn,
    )
    progress.close()
    summary = flight.summary
    if output.out is not None:
        flight.write(output.out, force=output.force, figure=output.figure)
    if output.format == "json":
        emit_json(summary)
    else:
        emit(_text(flight, output))
    return _answer(summary, output)


def _job(kind: JobKind, folder: str, texts: list[str], seed: int | None, output: SimulateOutputs) -> int:
    """Fly all flights of a folder that stands for a job."""
    progress = Progress("flying")
    job = kind.simulate(folder, texts, seed or 0, on_flight=progress.show, warn=warn)
    progress.close()
    if output.out is not None:
        job.write(output.out, force=output.force)
    if output.format == "json":
        emit_json(job.summary)
    else:
        emit("\n".join([*job.text(), *([f"written    {output.out}"] if output.out else [])]))
    return _answer(job.summary, output)


def _answer(summary: Mapping[str, Any], output: SimulateOutputs) -> int:
    """The exit code of a summary; its failures of the solver are warned of."""
    from eadp.io.flight import solver_text

    failures = solver_text(summary)
    alarm(failures)
    kept = summary["reserve_kept"] or not output.require_reserve
    return 0 if summary["completed"] and kept and not (output.strict_solver and failures) else 1


def _text(flight: Flight, output: SimulateOutputs) -> str:
    """The summary for people."""
    from eadp.io.flight import counted_text, label_of, parameter_text, reserve_text, setting_text, solver_text

    summary, inputs, decisions = flight.summary, flight.inputs, len(flight.decisions)
    done = "completed" if summary["completed"] else "NOT completed"
    power, solver = summary["power_w"], summary["solver"]
    expected = summary["energy_forecast"]
    lines = [
        f"aircraft   {setting_text(inputs.scenario)}",
        *_forecast(
            expected, summary["never_past"], expected and counted_text(inputs.scenario, inputs.world.plan, expected)
        ),
        f"{done}: {summary['reason']} after {summary['duration_s']:.2f} s, {summary['distance_m'] / 1000:.2f} km",
        *(
            f"airspace   {'beyond' if each['name'] == BOUNDARY else 'in'} {each['name']} from "
            f"{each['entered_s']:.1f} s on, {each['inside_m']:.0f} m"
            for each in summary["obstacles"]
        ),
        f"energy     {summary['energy_wh']:.3f} Wh; power mean {power['mean']:.2f} W, "
        f"from {power['min']:.2f} to {power['max']:.2f} W",
        f"battery    {100 * summary['soc_final']:.1f} % of the charge at the end; reserve of "
        f"{100 * summary['soc_reserve']:g} % {reserve_text(summary)}",
    ]
    if summary["turned_back_m"] is not None:
        x, y = summary["turned_back_m"]
        lines.append(f"home       decided at {summary['turned_back_s']:.2f} s, at ({x:.0f}, {y:.0f}) m")
    lines += _endurance(summary["endurance"], verbose=output.verbose)
    parameters = summary["parameters"].items()
    lines += [f"{label_of(name, values):<10} {parameter_text(values)}" for name, values in parameters]
    if summary["quality"] is not None:
        ends = "0: widest lines, lowest rates; 1: densest lines, full rates, to the end"
        lines.append(f"quality    {summary['quality']:.3f} of 1 ({ends})")
    if summary["coverage"] is not None:
        lines.append(f"covered    {100 * summary['coverage']:.2f} % of the field, by the lines flown")
    replans = f"; re-planned {decisions} times" if decisions else ""
    if output.verbose:
        replans += f"; {summary['replans']} by OSQP ({solver['calls']} runs, {solver['failed']} failed), "
        replans += f"{solver['skipped']} kept, {solver['fallbacks']} by the fallback, {solver['infeasible']} infeasible"
    lines.append(f"planner    {summary['planner']}{replans}")
    if failures := solver_text(summary):
        lines.append(f"solver     {failures}")
    if output.out is not None:
        decided = "decisions.jsonl, " if decisions else ""
        names = [f"{kind}.{ending}" for kind in ("flight", output.figure) if kind for ending in ("svg", "png")]
        written = ", ".join([*names, REPORT])
        lines.append(f"written    {output.out}/flight.csv, estimate.csv, summary.json, {decided}{written}")
    return "\n".join(lines)


def _endurance(endurance: Mapping[str, Any] | None, *, verbose: bool) -> list[str]:
    """How long a full battery lasts with the computations as flown; `verbose` adds the ends of their sets."""
    if endurance is None or endurance["gain_min_per_h"] is None:
        return []
    low, flown, high = (f"{endurance[key]['time_s'] / 60:.1f}" for key in ("lowest", "flown", "highest"))
    line = f"endurance  {flown} min on a full battery, as flown"
    if verbose and endurance["gain_min_per_h"]:
        gain = f"{endurance['gain_min_per_h']:.1f} min more in an hour"
        line += f"; {high} at the highest computations, {low} at the lowest: {gain}"
    return [line]


def _slowed(expected: Mapping[str, Any]) -> list[str]:
    """What another airspeed than the aircraft's own buys."""
    if "at_cruise" not in expected:
        return []
    from eadp.io.flight import airspeeds_text

    own = expected["at_cruise"]
    minutes = f"{expected['time_s'] / 60:.0f} min"
    if (own["completes_probability"] or 0.0) < 0.5:
        instead = "the battery does not last"
    else:
        instead = f"{own['time_s'] / 60:.0f} min"
        if expected["quality"] is not None and own["quality"] is not None:
            better, worse = (f"with a quality of {each['quality']:.2f}" for each in (expected, own))
            minutes, instead = f"{minutes} {better}", f"{instead} {worse}"
    flown = airspeeds_text(expected["airspeeds_mps"])
    return [f"airspeed   {flown}: {minutes}; at {own['airspeed_mps']:g} m/s {instead}"]


def _reach(expected: Mapping[str, Any]) -> list[str]:
    """How far one pack carries a mission that it does not finish, and how many it takes."""
    if expected["batteries"] == 1:
        return []
    if expected["batteries"] is None:
        return ["one pack   leaves no reserve anywhere"]
    x, y = expected["reach_m"]
    return [
        f"one pack   covers {100 * expected['reach_share']:.0f} % with its reserve kept, to ({x:.0f}, {y:.0f}) m at "
        f"{expected['reach_s']:.0f} s; without ways home it takes {expected['batteries']} or more: "
        "eadp cover --sorties auto"
    ]


def _forecast(expected: Mapping[str, Any] | None, never_past: str | None, counted: str | None) -> list[str]:
    """What was to be expected before take-off, with what is counted."""
    if expected is None:
        return [f"forecast   finishes: 0 % sure, never past {never_past}"] if never_past else []
    energy = f"{expected['energy_wh']:.2f} ± {expected['energy_std_wh']:.2f} Wh"
    times = f"{expected['time_s']:.0f} ± {expected['time_std_s']:.0f} s"
    left = expected["soc_end"]
    charge = f"{'lands with' if left > 0 else 'short by'} {100 * abs(left):.0f} ± {100 * expected['soc_end_std']:.0f} %"
    home = []
    if expected["turn_back_s"] is not None:
        x, y = expected["turn_back_m"]
        home = [
            f"home       latest turn-back to keep the reserve: at {expected['turn_back_s']:.0f} s, ({x:.0f}, {y:.0f}) m"
        ]
    finishes, keeps = (f"{100 * expected[f'{what}_probability']:.0f} % sure" for what in ("completes", "reserve"))
    return [
        f"forecast   finishes: {finishes}; {charge} of the charge; keeps the reserve: {keeps}; {energy} in {times}",
        f"counts     {counted}",
        *_slowed(expected),
        *_reach(expected),
        *home,
        *([f"autopilot  {expected['autopilot']}; the simulated flight does not"] if "autopilot" in expected else []),
        *(f"airspace   {risk_text(each['name'], each['probability'])}" for each in expected["obstacles"]),
    ]

"""`eadp simulate`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from eadp.api.flight import simulate
from eadp.api.given import FlightOptions, JobKind, job_in
from eadp.cli.output import Progress, alarm, emit, emit_json, usage_fault, warn
from eadp.errors import one_of
from eadp.io.text.options import Flag
from eadp.io.text.streams import check_new_folder
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
        alone = {**vars(options), "figure": output.figure}
        for name in ("scenario", "profile", "energy", "figure"):
            if alone[name]:
                raise usage_fault(f"--{name}", alone[name], "beside a folder of sorties", "its scenario, or --set")
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
    from eadp.io.flight import account

    rows = account(flight.summary, flight.inputs.scenario, flight.inputs.mission.plan)
    if output.out is not None:
        rows.append(("written", output.out))
    return "\n".join(f"{label:<10} {text}" if label else text for label, text in rows)

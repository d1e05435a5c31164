"""The folder of sorties: written, read back, and flown in turn, each flight with a fresh pack."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from eadp.api.flight import Flight, fly_flight
from eadp.api.given import File, JobKind, Overrides, Warn, python_warnings
from eadp.api.inputs import Files, load_flight
from eadp.core.geometry.curves import Point
from eadp.core.geometry.polygons import Ring, covered_share, ground_m2, strips
from eadp.errors import InputError
from eadp.io.flight import flown_lines, flown_of_plan, planned_lines
from eadp.io.scenario import override_texts, read_overrides
from eadp.io.text.json import json_lines
from eadp.io.text.streams import new_folder, read_text
from eadp.survey.figures import write_sorties_figure
from eadp.survey.report import LeftGround, left_ground, left_text
from eadp.survey.resume import MIN_PART_SHARE, SLIVER_SHARE
from eadp.survey.sorties import SCHEMA, SortiePlan

SORTIES: str = "sorties.json"
SORTIES_SCENARIO: str = "scenario.yaml"
"""Files of a folder of sorties: what was planned, and the scenario that flies it."""

FIGURE = "sorties"

FLOWN = ("completed", "reason", "duration_s", "energy_wh", "distance_m", "soc_final", "reserve_kept", "quality")
"""What a job says of each of its flights, as its summary does."""


def write_sorties(plan: SortiePlan, folder: str, *, force: bool = False) -> None:
    """Write the folder of sorties, whole or not at all.

    Parameters
    ----------
    plan : SortiePlan
    folder : str
    force : bool, optional
        Whether a folder of this name is replaced.

    Raises
    ------
    InputError
        If the name is taken, or the folder cannot be written.
    """
    document, rows = plan.document(), plan.rows()
    with new_folder(folder, force=force) as target:
        profile = None
        if (text := plan.sorties[0].inputs.sources.get("profile")) is not None:
            profile = f"profile{Path(text.name).suffix or '.csv'}"
            (target / profile).write_text(text.body, encoding="utf-8")
        scenario = plan.scenario_text(profile)
        (target / SORTIES_SCENARIO).write_text(scenario, encoding="utf-8")
        for row, sortie in zip(rows, plan.sorties, strict=True):
            (target / row["plan"]).write_text(sortie.plan.text, encoding="utf-8")
        (target / SORTIES).write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        drawn, task = [(f"{i:02d}", each.path()) for i, each in enumerate(plan.sorties, 1)], plan.planner.task
        write_sorties_figure(target / FIGURE, task.field, drawn, task.motion.swath_m, task.home_m, plan.covered.left)


# --- read back


class PlannedJob(NamedTuple):
    """Sorties of a folder: the path of each one's plan by its name, and the field that they cover.

    `parts` are the field's, each its outline and its holes [m].
    """

    plans: dict[str, str]
    parts: list[list[Ring]]
    origin_deg: Point | None
    swath_m: float


def read_sorties(folder: str) -> PlannedJob:
    """The sorties of a folder.

    Raises
    ------
    InputError
        If the document of the folder is missing or damaged.
    """
    path = Path(folder) / SORTIES
    (document,) = json_lines(read_text(str(path)), whole=True)
    try:
        if document["schema"] != SCHEMA:
            raise InputError.at(str(path), 1, 1, f"schema is {document['schema']}", SCHEMA)
        return PlannedJob(
            {row["sortie"]: str(Path(folder) / row["plan"]) for row in document["sorties"]},
            [[tuple((float(x), float(y)) for x, y in ring) for ring in part] for part in document["parts"]],
            document["origin_deg"] and tuple(map(float, document["origin_deg"])),
            float(document["swath_m"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError.at(str(path), 1, 1, f"is damaged: {error!r}", "a file of eadp cover --sorties") from None


# --- flown

JOB = "job.json"


@dataclass(frozen=True, eq=False)
class JobFlight:
    """All flights of a job.

    Attributes
    ----------
    summary : dict
        The values of `eadp.job/1`.
    flights : dict of str to Flight
        By their names, in the order of take-off.
    """

    summary: dict[str, Any]
    flights: dict[str, Flight]
    left: Sequence[LeftGround] = ()
    """The places that were planned and are not covered."""

    def write(self, folder: str | Path, *, force: bool = False) -> None:
        """Write the folder: `job.json`, and a result folder of each flight.

        Raises
        ------
        InputError
            If the name is taken and `force` is not set, or the folder cannot be written.
        """
        with new_folder(str(folder), force=force) as target:
            for name, flight in self.flights.items():
                flight.write(target / name)
            body = json.dumps(self.summary, indent=2, allow_nan=False) + "\n"
            (target / JOB).write_text(body, encoding="utf-8")

    def text(self) -> list[str]:
        """A summary for people, line by line."""
        summary = self.summary
        outcome = "done" if summary["completed"] else f"NOT done: {summary['reason']}"
        covered = f"{100 * summary['coverage']:.2f} % of the field, {100 * summary['planned_coverage']:.2f} % planned"
        lines = [
            f"{outcome}: {covered}, with {summary['batteries']} batteries",
            *left_text(self.left, sum(each["share"] for each in summary["left"]), summary["origin_deg"]),
            f"time       {summary['duration_s'] / 60:.0f} min, {summary['distance_m'] / 1000:.1f} km",
            f"energy     {summary['energy_wh']:.1f} Wh; least charge at a landing {100 * summary['soc_final']:.1f} %, "
            f"reserve {'kept' if summary['reserve_kept'] else 'NOT kept'} in all flights",
        ]
        for row in summary["flights"]:
            end = "completed" if row["completed"] else row["reason"]
            lines.append(
                f"{row['sortie']:<10} {row['duration_s'] / 60:5.1f} min, {row['energy_wh']:6.1f} Wh, "
                f"{100 * row['soc_final']:.1f} % left: {end}"
            )
        return lines


def simulate_sorties(
    folder: File,
    overrides: Overrides = (),
    seed: int = 0,
    *,
    on_flight: Callable[[str], None] = lambda _name: None,
    warn: Warn = python_warnings,
) -> JobFlight:
    """Fly all sorties of a folder in turn, each with a fresh pack.

    Parameters
    ----------
    folder : path
        Of `eadp cover --sorties`.
    overrides
        As for `simulate`, in every flight.
    seed : int, optional
        Of the first flight's gusts and noise; each later one's is one more.
    on_flight : function, optional
        Called with the name of each flight before it.
    warn : function, optional

    Raises
    ------
    InputError
        With the faults of the folder.
    """
    folder, texts = str(folder), override_texts(overrides)
    job, scenario, given = read_sorties(folder), str(Path(folder) / SORTIES_SCENARIO), {**read_overrides(texts)}
    files, flights, warned = Files(), dict[str, Flight](), set[str]()
    rows: list[dict[str, Any]] = []
    lines, planned = list[Sequence[Point]](), list[Sequence[Point]]()
    replans, solver = 0, Counter(calls=0, failed=0, fallbacks=0)
    for number, (name, plan) in enumerate(job.plans.items(), seed):
        inputs = load_flight(plan, scenario=scenario, overrides={**given, "seed": number}, files=files)
        warn([fault for fault in inputs.warnings if fault.message not in warned])  # each in its first flight
        warned |= {fault.message for fault in inputs.warnings}
        on_flight(name)
        flight = fly_flight(inputs, inputs.preflight(), overrides=[*texts, f"seed={number}"])
        flights[name], summary = flight, flight.summary
        rows.append({"sortie": name, **{key: summary[key] for key in FLOWN}})
        replans += summary["replans"]
        found: Mapping[str, Any] = summary["solver"]
        solver.update({key: found[key] for key in solver})
        planned += planned_lines(inputs.mission.plan, inputs.mission.parameters)
        lines += flown_lines(inputs.mission.plan, flown_of_plan(flight.columns, summary["turned_back_s"]))
    field_m2, on_lines = sum(ground_m2(*part) for part in job.parts), strips(job.parts, planned, job.swath_m)
    left = left_ground(on_lines, lines, job.swath_m, SLIVER_SHARE)
    completed = sum(each.area_m2 for each in left) < MIN_PART_SHARE * field_m2
    qualities = [row["quality"] for row in rows if row["quality"] is not None]
    job_summary: dict[str, Any] = {
        "schema": "eadp.job/1",
        "completed": completed,
        "reason": "all that was planned is covered" if completed else "ground is left; eadp cover --resume plans it",
        "batteries": len(rows),
        "coverage": covered_share(job.parts, lines, job.swath_m),
        "planned_coverage": covered_share(job.parts, planned, job.swath_m),
        "left": [{**each.document(job.origin_deg), "share": each.area_m2 / field_m2} for each in left],
        **{key: sum(row[key] for row in rows) for key in ("duration_s", "distance_m", "energy_wh")},
        "soc_final": min(row["soc_final"] for row in rows),
        "reserve_kept": all(row["reserve_kept"] for row in rows),
        "quality": sum(qualities) / len(qualities) if qualities else None,
        "replans": replans,
        "solver": dict(solver),
        "flights": rows,
        "origin_deg": job.origin_deg,
        "seed": seed,
    }
    return JobFlight(job_summary, flights, left)


SORTIE_JOBS = JobKind(SORTIES, simulate_sorties)
"""Folders of sorties as jobs."""

"""All sorties of a folder flown in turn, each with a fresh pack, and what they leave of the field."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eadp.api.flight import Flight, fly_flight
from eadp.api.given import Around, File, Overrides, Warn, python_warnings
from eadp.api.inputs import Files, load_flight
from eadp.core.geometry.curves import Point
from eadp.core.geometry.polygons import covered_shares, ground_m2, inner_point, strips, uncovered
from eadp.io.flight import flown_lines, flown_of_plan, planned_lines
from eadp.io.scenario import override_texts, read_overrides
from eadp.io.text.streams import new_folder
from eadp.survey.folder import SORTIES, SORTIES_SCENARIO, read_sorties
from eadp.survey.report import MIN_SHARE, LeftGround, left_text
from eadp.survey.resume import MIN_PART_SHARE, SLIVER_SHARE

SCHEMA = "eadp.job/1"
JOB = "job.json"

FLOWN = ("completed", "reason", "duration_s", "energy_wh", "distance_m", "soc_final", "reserve_kept", "quality")
"""Figures of each flight."""


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
            f"energy     {summary['energy_wh']:.1f} Wh; least charge at a landing {summary['soc_final']:.3f}, "
            f"reserve {'kept' if summary['reserve_kept'] else 'NOT kept'} in all flights",
        ]
        for row in summary["flights"]:
            end = "completed" if row["completed"] else row["reason"]
            lines.append(
                f"{row['sortie']:<10} {row['duration_s'] / 60:5.1f} min, {row['energy_wh']:6.1f} Wh, "
                f"SoC {row['soc_final']:.3f}: {end}"
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
    around, files = Around(terrain=job.terrain if all(map(os.path.isfile, job.terrain)) else ()), Files()
    flights, rows, warned, at_s = dict[str, Flight](), list[dict[str, Any]](), set[str](), 0.0
    lines, planned = list[Sequence[Point]](), list[Sequence[Point]]()
    for number, (name, plan) in enumerate(job.plans.items(), seed):
        inputs = load_flight(plan, scenario=scenario, overrides={**given, "seed": number}, files=files, around=around)
        warn([fault for fault in inputs.warnings if fault.message not in warned])  # each in its first flight
        warned |= {fault.message for fault in inputs.warnings}
        on_flight(name)
        flight = fly_flight(inputs, inputs.preflight(), overrides=[*texts, f"seed={number}"])
        flights[name], summary = flight, flight.summary
        rows.append({"sortie": name, "take_off_s": at_s, **{key: summary[key] for key in FLOWN}})
        at_s += summary["duration_s"] + job.swap_s
        planned += planned_lines(inputs.world.plan, inputs.world.parameters)
        lines += flown_lines(inputs.world.plan, flown_of_plan(flight.lists, summary["turned_back_s"]))
    field_m2, on_lines = sum(ground_m2(*part) for part in job.parts), strips(job.parts, planned, job.swath_m)
    places = uncovered(on_lines, lines, job.swath_m, SLIVER_SHARE * job.swath_m)
    left = [LeftGround(rings, ground_m2(*rings), inner_point(*rings), "not flown") for rings in places]
    left = sorted((each for each in left if each.area_m2 >= MIN_SHARE * field_m2), key=lambda each: -each.area_m2)
    completed = sum(each.area_m2 for each in left) < MIN_PART_SHARE * field_m2
    qualities = [row["quality"] for row in rows if row["quality"] is not None]
    summary = {
        "schema": SCHEMA,
        "completed": completed,
        "reason": "all that was planned is covered" if completed else "ground is left; eadp cover --resume plans it",
        "batteries": len(rows),
        "coverage": covered_shares(job.parts, [lines], job.swath_m)[-1],
        "planned_coverage": covered_shares(job.parts, [planned], job.swath_m)[-1],
        "left": [each.document(job.origin_deg) | {"share": each.area_m2 / field_m2} for each in left],
        "duration_s": rows[-1]["take_off_s"] + rows[-1]["duration_s"],
        "distance_m": sum(row["distance_m"] for row in rows),
        "energy_wh": sum(row["energy_wh"] for row in rows),
        "soc_final": min(row["soc_final"] for row in rows),
        "reserve_kept": all(row["reserve_kept"] for row in rows),
        "quality": sum(qualities) / len(qualities) if qualities else None,
        "flights": rows,
        "origin_deg": job.origin_deg,
        "seed": seed,
    }
    return JobFlight(summary, flights, left)


class _SortieJobs:
    """Folders of sorties as jobs."""

    document, scenario, plan = SORTIES, SORTIES_SCENARIO, "sortie-01.plan"
    simulate = staticmethod(simulate_sorties)


SORTIE_JOBS = _SortieJobs()

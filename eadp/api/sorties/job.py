"""All sorties of a folder flown in turn, each with a fresh pack; what they leave is planned again and flown."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from eadp.api.flight import Flight, fly_flight
from eadp.api.given import Around, File, Overrides, Warn, python_warnings
from eadp.api.inputs import FlightInputs, load_flight
from eadp.api.sorties import SORTIES, SORTIES_SCENARIO
from eadp.api.sorties.folder import read_sorties
from eadp.api.sorties.plan import SortiePlanner
from eadp.api.sorties.resume import MIN_PART_SHARE, SLIVER_SHARE, flown_again, left_of
from eadp.core.geometry.curves import Point
from eadp.core.geometry.polygons import covered_shares, strips
from eadp.coverage.left import LeftGround, left_ground, left_text
from eadp.coverage.separation import LATE_S, Nearest, TimedTrack, nearest
from eadp.errors import Fault, Infeasible
from eadp.io.flight.coverage import flown_lines, flown_of_plan, planned_lines
from eadp.io.scenario.scenario_file import override_texts, read_overrides
from eadp.io.text.streams import new_folder
from eadp.models.field import Field
from eadp.models.plan.plan import Plan

SCHEMA = "eadp.job/1"
JOB = "job.json"
MAX_ROUNDS = 5
"""Most times that what is left is planned again."""

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
        more = summary["batteries"] - summary["planned"]
        again = f"; {more} more than planned, for what was left" if more else ""
        covered = f"{100 * summary['coverage']:.2f} % of the field, {100 * summary['planned_coverage']:.2f} % planned"
        lines = [
            f"{outcome}: {covered}, with {summary['batteries']} batteries{again}",
            *left_text(self.left, sum(each["share"] for each in summary["left"]), summary["origin_deg"]),
            f"time       {summary['duration_s'] / 60:.0f} min, {summary['distance_m'] / 1000:.1f} km",
            f"energy     {summary['energy_wh']:.1f} Wh; least charge at a landing {summary['soc_final']:.3f}, "
            f"reserve {'kept' if summary['reserve_kept'] else 'NOT kept'} in all flights",
        ]
        if summary["nearest_m"] is not None:
            x, y = summary["nearest_at_m"]
            where = f"at {summary['nearest_s']:.0f} s at ({x:.0f}, {y:.0f}) m"
            lines.append(f"apart      {summary['nearest_m']:.0f} m or more: {where}")
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
    min_part: float = 100 * MIN_PART_SHARE,
    on_flight: Callable[[str], None] = lambda _name: None,
    warn: Warn = python_warnings,
) -> JobFlight:
    """Fly all sorties of a folder in turn, each with a fresh pack, and then what they leave of the field.

    Parameters
    ----------
    folder : path
        Of `eadp cover --sorties`.
    overrides
        As for `simulate`, in every flight.
    seed : int, optional
        Of the first flight's gusts and noise; each later one's is one more. Of late take-offs, too.
    min_part : float, optional
        Percent of the field below which a part that is left is not flown again.
    on_flight : function, optional
        Called with the name of each flight before it.
    warn : function, optional

    Raises
    ------
    InputError
        With the faults of the folder.
    """
    folder, texts = str(folder), override_texts(overrides)
    planner, document = read_sorties(folder)
    job = _Job(planner, document, {**read_overrides(texts)}, texts, seed, min_part / 100, on_flight, warn)
    scenario = str(Path(folder) / SORTIES_SCENARIO)
    tours: list[list[str]] = [[] for _ in range(document["aircraft"])]
    for row in document["sorties"]:
        inputs = job.load(str(Path(folder) / row["plan"]), scenario)
        job.planned += planned_lines(inputs.world.plan, inputs.world.parameters)
        job.fly(row["sortie"], inputs)
        tours[row["aircraft"] - 1].append(row["sortie"])
    for _ in range(MAX_ROUNDS):
        left = job.left_to_fly()
        if left is None:
            break
        try:
            again = replace(planner, overrides=job.overrides).plan(left)
        except Infeasible as error:
            job.reason = str(error)
            break
        before = job.coverage(job.lines)
        for k, sortie in enumerate(again.sorties):
            name = f"sortie-{len(job.flights) + 1:02d}"
            job.fly(name, job.load(sortie.plan.plan, scenario))
            tours[k * len(tours) // len(again.sorties)].append(name)  # as many to each aircraft, in order
        if job.coverage(job.lines) <= before:
            break
    return job.result(tours)


@dataclass
class _Job:
    """Flights so far: the lines flown, the lines `planned` of the folder's sorties, and the messages `warned` of.

    `reason` is why the job stops where ground is left.
    """

    planner: SortiePlanner
    document: Mapping[str, Any]
    overrides: dict[str, Any]
    texts: list[str]
    seed: int
    min_share: float
    on_flight: Callable[[str], None]
    warn: Warn
    flights: dict[str, Flight] = field(default_factory=dict)
    lines: list[tuple[Point, ...]] = field(default_factory=list)
    planned: list[tuple[Point, ...]] = field(default_factory=list)
    warned: set[str] = field(default_factory=set)
    reason: str = "ground is left"

    def load(self, plan: str | Plan, scenario: str) -> FlightInputs:
        """The inputs of the next flight, with a seed of its own; a warning is given in the first flight that has it."""
        overrides = {**self.overrides, "seed": self.seed + len(self.flights)}
        terrain = self.planner.task.options.terrain
        around = Around(terrain=terrain if all(map(os.path.isfile, terrain)) else ())
        inputs = load_flight(plan, scenario=scenario, overrides=overrides, files=self.planner.files, around=around)
        new = [fault for fault in inputs.warnings if fault.message not in self.warned]
        self.warned |= {fault.message for fault in new}
        self.warn(new)
        return inputs

    def fly(self, name: str, inputs: FlightInputs) -> None:
        """Fly, and add the flight under its name to `flights`, and its lines to `lines`."""
        self.on_flight(name)
        flight = fly_flight(
            inputs, inputs.preflight(), overrides=[*self.texts, f"seed={self.seed + len(self.flights)}"]
        )
        self.flights[name] = flight
        columns = flown_of_plan(flight.lists, flight.summary["turned_back_s"])
        self.lines += flown_lines(inputs.world.plan, columns)

    def left_to_fly(self) -> Field | None:
        """Ground left of what the sorties were to cover, in parts large enough to be flown; None without any."""
        left = left_of(self.planner, self.lines)
        return left and flown_again(self.planner, left, self.lines, self.planned, self.min_share)

    def uncovered_places(self, *, only_slivers: bool) -> list[LeftGround]:
        """The places that were planned and are not covered; `only_slivers`: each is too small to be flown again."""
        task = self.planner.task
        planned_ground = task.field.with_parts(strips(task.field.parts, self.planned, task.motion.swath_m))
        why = f"below {100 * self.min_share:g} % of the field, not flown again" if only_slivers else "not flown"
        return left_ground(planned_ground, self.lines, task.motion, width_share=SLIVER_SHARE, why=why)

    def coverage(self, lines: Sequence[tuple[Point, ...]]) -> float:
        """Share of the whole field that lines cover."""
        task = self.planner.task
        return covered_shares(task.field.parts, [lines], task.motion.swath_m)[-1]

    def result(self, tours: Sequence[Sequence[str]]) -> JobFlight:
        """The job as it was flown by the tours of the aircraft; warns of aircraft that came too near."""
        starts, tracks = self._starts_s(tours)
        flights = {name: self.flights[name].summary for name in sorted(self.flights, key=starts.__getitem__)}
        near = nearest(tracks)
        if near is not None and near.distance_m < self.document["separation_m"]:
            self._warn_near(near)
        completed, field = self.left_to_fly() is None, self.planner.task.field
        left = self.uncovered_places(only_slivers=completed)
        rows = [
            {
                "sortie": name,
                "take_off_s": starts[name],
                **{key: one[key] for key in FLOWN},
            }
            for name, one in flights.items()
        ]
        qualities = [row["quality"] for row in rows if row["quality"] is not None]
        summary = {
            "schema": SCHEMA,
            "completed": completed,
            "reason": "all that was planned is covered" if completed else self.reason,
            "planned": len(self.document["sorties"]),
            "batteries": len(rows),
            "coverage": self.coverage(self.lines),
            "planned_coverage": self.coverage(self.planned),
            "left": [each.document(field.origin_deg) | {"share": each.area_m2 / field.area_m2} for each in left],
            "duration_s": max(row["take_off_s"] + row["duration_s"] for row in rows),
            "distance_m": sum(row["distance_m"] for row in rows),
            "energy_wh": sum(row["energy_wh"] for row in rows),
            "soc_final": min(row["soc_final"] for row in rows),
            "reserve_kept": all(row["reserve_kept"] for row in rows),
            "quality": sum(qualities) / len(qualities) if qualities else None,
            "nearest_m": None if near is None else near.distance_m,
            "nearest_s": None if near is None else near.time_s,
            "nearest_at_m": None if near is None else list(near.place_m),
            "flights": rows,
            "origin_deg": field.origin_deg,
            "seed": self.seed,
        }
        return JobFlight(summary, {name: self.flights[name] for name in flights}, left)

    def _starts_s(self, tours: Sequence[Sequence[str]]) -> tuple[dict[str, float], list[TimedTrack]]:
        """Take-off of each flight [s], late by a drawn time, and the track of each aircraft through its flights."""
        starts, tracks, draws = {}, [], np.random.default_rng(self.seed)
        for k, tour in enumerate(tours):
            at_s = k * self.document["stagger_s"]
            track: TimedTrack | None = None
            for name in tour:
                at_s += float(draws.uniform(0.0, LATE_S))
                starts[name] = at_s
                columns = self.flights[name].columns
                points = np.stack([columns["x_m"], columns["y_m"]], axis=1)
                own = TimedTrack(columns["time_s"], points).later(at_s)
                track = own if track is None else track.then(own, own.times_s[0] - track.times_s[-1])
                at_s += float(self.flights[name].summary["duration_s"]) + self.document["swap_s"]
            if track is not None:
                tracks.append(track)
        return starts, tracks

    def _warn_near(self, near: Nearest) -> None:
        """Warn of two aircraft that come nearer than the separation."""
        one, other = (i + 1 for i in near.pair)
        message = f"aircraft {one} and {other} come within {near.distance_m:.0f} m at {near.time_s:.0f} s, at "
        message += f"({near.place_m[0]:.0f}, {near.place_m[1]:.0f}) m"
        expected = f"{self.document['separation_m']:g} m: a later take-off, or altitudes apart"
        self.warn([Fault(SORTIES, 1, 1, message, expected, severity="warning")])

"""The use case of `eadp cover --sorties`: a field and an aircraft in, the fewest flights and their forecasts out."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from typing import Annotated, Any, ClassVar, Final

import numpy as np

from eadp.api.inputs import HELD, Files, FlightInputs, load_flight
from eadp.core.geometry.curves import Point
from eadp.core.geometry.dubins import straight
from eadp.core.geometry.geodesy import heading_rad, place_text
from eadp.core.geometry.polygons import hull
from eadp.errors import Infeasible, InputError
from eadp.io.flight import losses_text, setting_text
from eadp.io.scenario import value_text
from eadp.io.text.json import aligned
from eadp.io.text.options import Flag, check_range
from eadp.models.airspace import Field
from eadp.planning.forecast.evaluate import Objective
from eadp.planning.registry import planner_class
from eadp.survey.airspace import free_lines
from eadp.survey.camera import Pictures, pictures_document
from eadp.survey.cover import CoverageTask, held_at
from eadp.survey.coverage import AUTO, DUBINS, PATTERNS, ZAMBONI, CoverageRequest, LineGrid, cover
from eadp.survey.packs import MAX_SORTIES, Divided, Divider, Division, PlannedSortie
from eadp.survey.report import CoveragePlan, Covered, HeightReport, rounded_deg
from eadp.survey.swaths import CoveragePath

SCHEMA: Final = "eadp.sorties/1"
OVERLAP_M = 20.0
"""Length that both parts of a line that is cut have in common [m]."""

LEAST_SHARE = 0.02
"""Share of a flight for which a pack lasts, where it lasts for less, or for none."""

DRAFT_SHARE = 0.02
"""Share of the charge that lines in a draft's order take at most beyond what they need: 0.011 measured."""

_DEVIATIONS = statistics.NormalDist().inv_cdf(Objective.probability)
"""Standard deviations of the charge at the end that the probability of the reserve takes."""


@dataclass(frozen=True)
class SortieOptions:
    """How a field is divided among flights. Faults name the options as the command `eadp cover` does."""

    SECTION: ClassVar = "Sorties"

    sorties: Annotated[int | str | None, Flag(metavar="NUMBER")] = None
    """Divide the field among flights from home: auto for the fewest, or a number."""

    resume: Annotated[Sequence[str], Flag(metavar="FLOWN")] = ()
    """Flights flown, as result folders, telemetry, .bin, .ulg or .tlog: what they covered is left out."""

    @property
    def count(self) -> int | None:
        """The number of sorties; None for the fewest."""
        return None if self.sorties in (None, "auto") else int(self.sorties)

    def __post_init__(self) -> None:
        if not (self.sorties in (None, "auto") or str(self.sorties).isdecimal()):
            expected = f"auto, or a whole number from 1 to {MAX_SORTIES}"
            raise InputError.at("--sorties", 1, 1, "no number of sorties", expected, str(self.sorties))
        check_range("--sorties", 1 if self.count is None else self.count, 1, MAX_SORTIES, closed=True)


@dataclass(frozen=True)
class SortiePlanner:
    """Plans sorties over the ground of a field, or of what is left of it.

    Attributes
    ----------
    task : CoverageTask
        With a home.
    files : Files
        Of the flights.
    scenario : str or None
        Path of the scenario, of which `overrides` replace keys.
    profile : str or None
        Path of the profile.
    on_part : function
        Called with the progress before each forecast of a part.
    """

    task: CoverageTask
    options: SortieOptions
    files: Files
    scenario: str | None = None
    profile: str | None = None
    overrides: Mapping[str, Any] = field(default_factory=dict)
    lines: tuple[float, str] | None = None
    """Compass bearing of the lines [°] and pattern, where they are known."""
    on_part: Callable[[str], None] = field(default=lambda _: None, repr=False, compare=False)

    @cached_property
    def _request(self) -> CoverageRequest:
        """The pattern and the heading of the whole field, from home to home."""
        request = self.task.request
        if request.home_m is None:
            expected = "--home LAT,LON, or X,Y of a field in metres"
            raise InputError.at("--home", 1, 1, "sorties start and end at home", expected)
        if self.task.options.start is not None:
            raise InputError.at("--start", 1, 1, "sorties start and end at home", "no --start")
        if request.pattern not in PATTERNS:
            expected = f"one of {', '.join(PATTERNS)}"
            raise InputError.at("--pattern", 1, 1, "covers a field in one flight", expected, request.pattern)
        if self.lines is not None:
            request = replace(request, heading_rad=heading_rad(self.lines[0]), pattern=self.lines[1])
        if request.heading_rad is None or request.pattern == AUTO:
            # as the whole field is covered, without the ways from and to home
            alone = replace(request, start_m=None, home_m=None, climb_out=None, approach=None)
            whole = cover(alone, draft=True)
            request = replace(request, pattern=whole.pattern, heading_rad=whole.heading_rad)
        return request

    @property
    def heading_rad(self) -> float:
        """The mathematical heading of the lines."""
        assert self._request.heading_rad is not None
        return self._request.heading_rad

    def grid(self, request: CoverageRequest | None = None) -> LineGrid:
        """The lines of the whole field, by a request of it."""
        request = request or self._request
        swath_m = self.task.motion.swath_m
        apart_m = swath_m if request.pattern == ZAMBONI else request.order_spacing_m or swath_m
        return LineGrid.over(self.task.field, self.heading_rad, swath_m, apart_m)

    def free_lines(self, ground: Field) -> list[tuple[Point, Point]] | None:
        """The lines over a ground that have room for their turns; None where nothing is in their way."""
        space = self._request.space
        if space is None:
            return None
        lines = free_lines(self.grid().whole_lines(ground)[::2], space, self.task.motion)
        return [(line.start[:2], line.end[:2]) for line in lines[::2]]

    @property
    def laps(self) -> bool:
        """Whether the field is flown in laps."""
        return self._request.pattern == ZAMBONI

    def plan(self, ground: Field | None = None) -> SortiePlan:
        """Sorties over a field's ground, by default the whole.

        Raises
        ------
        Infeasible
            If the field is out of reach, or the pattern fits no part of it.
        InputError
            Of `--home`, and of a number of sorties that is too small.
        """
        ground = ground or self.task.field
        if self.laps:
            try:
                return self._planned(ground, self._request)
            except Infeasible as error:
                if self.task.request.pattern == ZAMBONI:
                    raise Infeasible(f"{error}; in sorties, --pattern dubins") from None
        # along lines where no laps fit
        return self._planned(ground, replace(self._request, pattern=DUBINS))

    def _planned(self, ground: Field, request: CoverageRequest) -> SortiePlan:
        """Sorties over a ground by a request's pattern: side by side, or along a tour of its lines if that is less."""
        motion, laps, grid = self.task.motion, request.pattern == ZAMBONI, self.grid(request)

        @cache
        def planned(part: Field, *, draft: bool) -> PlannedSortie:
            covered = _without_bays(part) if laps else part  # laps cover bays and holes as if they were field
            part_of = replace(request, field=covered, grid=None if laps else grid)
            return self.sortie(self.task.planned(cover(part_of, draft=draft), part))

        def forecast(part: Field) -> PlannedSortie:
            """The sortie over a part: as a draft where that decides whether it can be flown."""
            found = planned(part, draft=True)
            return planned(part, draft=False) if -DRAFT_SHARE * found.used <= found.spare < 0 else found

        def divided(order: Sequence[int] | None = None) -> Divided:
            """The fewest sorties over the lines in an order, by default side by side."""
            division = Division(ground, grid, OVERLAP_M, order)
            divider = Divider(division, forecast, cuts=not laps, on_part=self.on_part)
            return divider.fewest(max(min_count, self.options.count or 1))

        self.on_part("the lines are chosen")
        side_by_side = Division(ground, grid, OVERLAP_M)
        sample = forecast(side_by_side.part(0.0, side_by_side.total_m if laps else side_by_side.end_of_first_m))
        min_count = self._min_count(sample.inputs, side_by_side)
        found = divided()
        width_m = side_by_side.lines / len(found.sorties) * float(np.diff(grid.edges_m).mean())
        if not laps and width_m < 4 * motion.min_radius_m and len(found.sorties) > 1:
            # a strip narrower than two turns has no room to leave lines out and come back for them
            tour = divided(grid.order_of(cover(replace(request, field=ground, grid=grid))))
            found = min(found, tour, key=lambda each: (len(each.sorties), sum(one.energy_wh for one in each.sorties)))
        if self.options.count is not None and len(found.sorties) > self.options.count:
            expected = f"{len(found.sorties)} or more"
            raise InputError.at("--sorties", 1, 1, "too few for the packs", expected, f"{self.options.count}")
        if not laps and self._request.space is not None:
            whole = [planned(each.plan.field, draft=False) for each in found.sorties]
            found = found._replace(sorties=whole)
        return SortiePlan(self, ground, found)

    def sortie(self, planned: CoveragePlan, *, held: bool = True) -> PlannedSortie:
        """A sortie by the plan of a part, forecast by its planner; with `held`, at the lowest parameters."""
        plan = held_at(planned.plan, "lo", "lo") if held else planned.plan
        given = self.overrides
        if held:  # the plan has its parameters, whatever the scenario sets at take-off
            given = {key: value for key, value in given.items() if key.partition(".")[0] != "parameters"}
        inputs = load_flight(plan, scenario=self.scenario, profile=self.profile, overrides=given, files=self.files)
        found = inputs.at_one_airspeed().preflight(whole=False)
        if found is None or found.forecast.soc_end is None or found.forecast.soc_end_std is None:
            raise Infeasible("a sortie has no forecast: the battery's charge is prescribed, or the wind is too strong")
        reserve_soc = inputs.scenario.keys.reserve_soc
        kept_soc = max(reserve_soc, found.turns_back_soc)
        spare = found.forecast.soc_end - _DEVIATIONS * found.forecast.soc_end_std - kept_soc
        if not found.feasible:
            spare = min(spare, -1e-6)  # cannot be flown
        if not found.forecast.soc_end:  # the pack is empty before the end: it lasts for a share of the flight
            share = max(0.0 if found.reach is None else found.reach.share, LEAST_SHARE)
            spare = (inputs.mission.battery.soc - reserve_soc) * (1 - 1 / share)
        return PlannedSortie(planned, inputs, found, spare)

    def _min_count(self, sample: FlightInputs, division: Division) -> int:
        """Fewer sorties are not tried: level flight along the lines, as often either way, and half a circle to each."""
        motion, world, heading_rad = self.task.motion, sample.world, self.heading_rad
        computing_w = world.mission.computing.min_power_w(world.mission.plan)
        power_w, battery = world.mission.vehicle.cruise_power_w + computing_w, world.mission.battery
        kept_s = battery.endurance_s(power_w, sample.scenario.keys.reserve_soc)
        pack_s = kept_s - battery.endurance_s(power_w, battery.soc)
        ahead = (math.cos(heading_rad), math.sin(heading_rad))
        metre_s = motion.time_s([straight((0.0, 0.0), ahead), straight(ahead, (0.0, 0.0))]) / 2
        turns_m = (division.lines - 1) * math.pi * motion.min_radius_m
        flown_s = division.total_m * metre_s + turns_m / motion.ground_limit_mps
        return max(1, math.ceil(flown_s / pack_s)) if pack_s > 0 else 1


def _without_bays(part: Field) -> Field:
    """The convex hull of a field's parts."""
    outline = hull(np.concatenate([np.array(rings[0]) for rings in part.parts]))
    return replace(part, outline=outline, holes=(), others=())


@dataclass(frozen=True)
class SortiePlan:
    """Sorties over a field, in the order of its lines.

    Attributes
    ----------
    planner : SortiePlanner
    ground : Field
        What they cover.
    divided : Divided
        The sorties at the lowest parameters, by which they were divided.
    """

    planner: SortiePlanner
    ground: Field
    divided: Divided

    @cached_property
    def sorties(self) -> list[PlannedSortie]:
        """The sorties as the scenario's planner forecasts them."""
        return [self.planner.sortie(each.plan, held=False) for each in self.divided.sorties]

    @property
    def names(self) -> list[str]:
        """Names of their files, without an ending."""
        return [f"sortie-{i:02d}" for i in range(1, len(self.divided.sorties) + 1)]

    @cached_property
    def _heights(self) -> HeightReport | None:
        """The heights of all sorties; None without a terrain."""
        heights = [each.plan.heights for each in self.sorties if each.plan.heights is not None]
        if not heights:
            return None
        width_m, _, gsd_cm = self.sorties[0].plan.on_ground
        middles_m = self.planner.grid().middles_m  # lines beside each other are those of several sorties
        apart_m = float(np.diff(middles_m)[0]) if len(middles_m) > 1 else None
        return HeightReport(heights, width_m, apart_m, gsd_cm)

    @cached_property
    def covered(self) -> Covered:
        """What their lines cover of the ground."""
        path = CoveragePath(tuple(leg for sortie in self.sorties for leg in sortie.path().legs))
        return Covered(self.ground, path, self.planner.task.motion.swath_m)

    @property
    def pictures(self) -> Pictures | None:
        """The camera's pictures of all sorties together; None without a camera."""
        shots = [shot for each in self.sorties if (shot := each.plan.pictures) is not None]
        if not shots or shots[0].number is None:
            return shots[0] if shots else None
        return shots[0]._replace(number=sum(shot.number or 0 for shot in shots))

    def rows(self) -> list[dict[str, Any]]:
        """The figures of each sortie, by key."""
        rows: list[dict[str, Any]] = []
        keys = ("energy_wh", "energy_std_wh", "soc_end", "soc_end_std", "reserve_probability")
        for name, each in zip(self.names, self.sorties, strict=True):
            end, path = each.forecast.forecast, each.path()
            spacing = each.forecast.parameters.get("c1") if each.plan.solution.min_c1 < 0 else None
            rows.append(
                {
                    "sortie": name,
                    "plan": f"{name}.plan",
                    "lines": path.lines,
                    "spacing_m": None if spacing is None else each.plan.plan.parameters[0].shown(spacing),
                    "length_m": path.length_m,
                    "pictures": None if each.plan.pictures is None else each.plan.pictures.number,
                    "time_s": end.remaining_s,
                    "time_std_s": end.remaining_std_s,
                    **{key: getattr(end, key) for key in keys},
                }
            )
        return rows

    def document(self) -> dict[str, Any]:
        """The values of `eadp.sorties/1`."""
        task, rows = self.planner.task, self.rows()
        first = self.divided.sorties[0].plan.solution
        return {
            "schema": SCHEMA,
            "file": task.file,
            "field": task.field.summary,
            "pattern": first.pattern,
            "heading_deg": rounded_deg(first.heading_rad, 9),
            "origin_deg": task.field.origin_deg,
            "home_m": task.home_m,
            "swath_m": task.motion.swath_m,
            "count": len(rows),
            "energy_wh": sum(row["energy_wh"] for row in rows),
            "length_m": sum(row["length_m"] for row in rows),
            "time_s": sum(row["time_s"] for row in rows),
            "coverage": self.covered.share,
            "left": [each.document(task.field.origin_deg) for each in self.covered.left],
            "overlap_m": OVERLAP_M,
            **pictures_document(self.pictures),
            "terrain": self._heights and self._heights.document(),
            "options": {key: value for key, value in asdict(task.options).items() if value is not None},
            "sorties": rows,
            "parts": task.field.parts,
        }

    def lines(self) -> list[str]:
        """A summary for people, line by line, with a table of the sorties."""
        document, task = self.document(), self.planner.task
        scenario = self.divided.sorties[0].inputs.scenario
        name = f"{task.field.name}, " if task.field.name else ""
        count, minutes = document["count"], document["time_s"] / 60
        why = "as asked for" if count == self.planner.options.count else "the fewest found"
        place = f" at {place_text(task.field.origin_deg)}" if task.field.origin_deg else ""
        energy = f"{document['energy_wh']:.1f} Wh, {document['length_m'] / 1000:.1f} km, {minutes:.0f} min in the air"
        lines = [
            f"field      {name}{self.ground.area_m2 / 1e4:.2f} ha{place}, {100 * document['coverage']:.2f} % covered",
            f"sorties    {count}, {why}: {energy}",
        ]
        lines += [] if self.pictures is None else self.pictures.lines()
        lines += [] if self._heights is None else self._heights.text()
        lines += self.covered.lines()
        lines += [task.motion.wind_text, f"aircraft   {setting_text(scenario)}", f"counts     {losses_text(scenario)}"]
        table = [["sortie", "lines", "km", "time", "energy", "lands with", "keeps the reserve"]]
        for row in document["sorties"]:
            table.append(
                [
                    row["sortie"].removeprefix("sortie-"),
                    str(row["lines"]),
                    f"{row['length_m'] / 1000:.2f}",
                    f"{row['time_s'] / 60:.1f} min",
                    f"{row['energy_wh']:.1f} ± {row['energy_std_wh']:.1f} Wh",
                    f"{100 * row['soc_end']:.0f} ± {100 * row['soc_end_std']:.0f} %",
                    f"{100 * row['reserve_probability']:.1f} %",
                ]
            )
        return [*lines, "", *aligned(table)]

    def scenario_text(self, profile: str | None) -> str:
        """A scenario that flies the sorties: all of the given one and its vehicle, from the ground at home."""
        value = dict(self.divided.sorties[0].inputs.scenario.document.value)
        value.pop("home", None)
        value.pop("parameters", None)
        inputs = self.sorties[0].inputs
        name = inputs.scenario.keys.planner.name
        value["planner"] = {**(value.get("planner") or {}), "name": name}
        planner, ranged = planner_class(name), inputs.mission.vehicle.airspeed_range_mps is not None
        if ranged and hasattr(planner.own_settings, "airspeed"):  # the sorties are forecast at one airspeed
            value["planner"][name] = {**(value["planner"].get(name) or {}), "airspeed": HELD}
        if profile is not None:
            value["profile"] = profile
        if self._heights is not None:
            value["home"] = {"altitude_m": self._heights.home_altitude_m}
        if planner.optimises_to_end:
            value.setdefault("on_infeasible", "home")  # what a sortie leaves is flown by another
        value = {"schema": "eadp.scenario/1", **value}
        head = "# One sortie: eadp simulate sortie-01.plan --scenario scenario.yaml. All: eadp simulate of the folder."
        return f"{head}\n" + "".join(f"{key}: {value_text(part)}\n" for key, part in value.items())

"""The folder of sorties: plans, the scenario that flies them, a table, a picture and a page. It is read back, too."""

from __future__ import annotations

import base64
import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eadp.api.cover import CoverageOptions, CoverageTask
from eadp.api.export import ExportOptions, exported
from eadp.api.inputs import Files
from eadp.api.profile import profile_of_scenario
from eadp.api.sorties import SORTIES, SORTIES_SCENARIO
from eadp.api.sorties.plan import SCHEMA, SortieOptions, SortiePlan, SortiePlanner
from eadp.core.geometry.curves import Point
from eadp.errors import InputError, one_of
from eadp.io.figures.sorties import DrawnSortie, write_sorties_figure
from eadp.io.mission import ENDINGS, EXPORT_NAMES, WITH_ITEMS
from eadp.io.mission.export import writer_of
from eadp.io.report.page import page_html
from eadp.io.text.json import json_lines
from eadp.io.text.streams import new_folder, read_text
from eadp.models.airspace import Airspace, Obstacle
from eadp.models.autopilot import ARDUPILOT, PX4
from eadp.models.field import Field

TABLE, FIGURE, PAGE = "sorties.csv", "sorties", "index.html"


def write_sorties(plan: SortiePlan, folder: str, *, force: bool = False, exports: Sequence[str] = ()) -> None:
    """Write the folder of sorties, whole or not at all.

    Parameters
    ----------
    plan : SortiePlan
    folder : str
    force : bool, optional
        Whether a folder of this name is replaced.
    exports : sequence of str, optional
        Formats in which each sortie is written besides.

    Raises
    ------
    InputError
        If the name is taken, a format is unknown, or the folder cannot be written.
    """
    for name in exports:
        if writer_of(name) is None:
            raise InputError.at("--export", 1, 1, "is no format", one_of(EXPORT_NAMES, name), name)
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
        for to, row in ((to, row) for to in exports for row in rows):
            # of those for PX4, a mission for ArduPilot ends by its own rules
            other = to in WITH_ITEMS and (to == PX4) != (plan.planner.task.autopilot.kind == PX4)
            kind = (f"autopilot.kind={ARDUPILOT}",) if other else ()
            options = ExportOptions(kind, scenario=str(target / SORTIES_SCENARIO))
            mission = exported(str(target / row["plan"]), to, options, lambda _: None)
            mission.write(str(target / f"{row['sortie']}-{to}{ENDINGS.get(to, '.' + to)}"))
        (target / SORTIES).write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        (target / TABLE).write_text(_csv(rows), encoding="utf-8")
        drawn = [
            DrawnSortie(
                row["sortie"].removeprefix("sortie-"),
                row["aircraft"],
                sortie.path(),
                sortie.plan.heights and sortie.plan.heights.profile,
            )
            for row, sortie in zip(rows, plan.sorties, strict=True)
        ]
        task = plan.planner.task
        write_sorties_figure(target / FIGURE, task.field, drawn, task.motion.swath_m, task.home_m, plan.left)
        figure = (target / f"{FIGURE}.svg").read_bytes()
        page = {
            "title": f"{len(rows)} sorties",
            "note": "; ".join(" ".join(line.split()) for line in plan.summary()),
            "figure": base64.b64encode(figure).decode(),
            "table": plan.table(),
        }
        (target / PAGE).write_text(page_html("flights", page), encoding="utf-8")


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as the text of a CSV file, with a header."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


# --- read back


def read_sorties(folder: str) -> tuple[SortiePlanner, dict[str, Any]]:
    """What plans the sorties of a folder again, and its document.

    Raises
    ------
    InputError
        If a file of the folder is missing or damaged.
    """
    path = Path(folder) / SORTIES
    (document,) = json_lines(read_text(str(path)), whole=True)
    try:
        if document["schema"] != SCHEMA:
            raise InputError.at(str(path), 1, 1, f"schema is {document['schema']}", SCHEMA)
        scenario, files = str(Path(folder) / SORTIES_SCENARIO), Files()
        setting = files.scenario(scenario, {})
        keys, (profile, _) = setting.keys, profile_of_scenario(setting)
        options = CoverageOptions(**document["options"])
        motion = options.motion(keys.vehicle.airframe, keys.wind.steady_mps)
        name, airframe = keys.vehicle.name, keys.vehicle.airframe
        task = CoverageTask(
            document["file"],
            _field(document),
            (),
            options,
            motion,
            name,
            airframe,
            profile,
            autopilot=keys.autopilot,
            circles_first=bool(document.get("circles_first")),
        )
        division = {key: document[key] for key in ("aircraft", "overlap_m", "separation_m", "swap_s")}
        lines = document["heading_deg"], document["pattern"]
        profile_path = setting.profile_path
        return SortiePlanner(task, SortieOptions(**division), files, scenario, profile_path, lines=lines), document
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError.at(str(path), 1, 1, f"is damaged: {error!r}", "a file of eadp cover --sorties") from None


def _field(document: Mapping[str, Any]) -> Field:
    """The whole field of a document."""

    def ring(points: Sequence[Sequence[float]]) -> tuple[Point, ...]:
        return tuple((float(x), float(y)) for x, y in points)

    (outline, *holes), *others = (tuple(map(ring, part)) for part in document["parts"])
    obstacles = tuple(Obstacle(ring(each["outline"]), each["name"], each["height_m"]) for each in document["obstacles"])
    origin = document["origin_deg"]
    return Field(
        outline,
        holes=tuple(holes),
        name=document["field"]["name"],
        origin_deg=None if origin is None else (origin[0], origin[1]),
        airspace=Airspace(obstacles, tuple(map(ring, document["boundary"]))),
        others=tuple(others),
    )

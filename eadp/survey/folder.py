"""The folder of sorties: plans, the scenario that flies them, a table, a picture and a page. It is read back, too."""

from __future__ import annotations

import base64
import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from eadp.core.geometry.curves import Point
from eadp.core.geometry.polygons import Ring
from eadp.errors import InputError
from eadp.io.page import page_html
from eadp.io.text.json import json_lines
from eadp.io.text.streams import new_folder, read_text
from eadp.plug_ins import plug_in
from eadp.survey.figures import write_sorties_figure
from eadp.survey.sorties import SCHEMA, SortiePlan

SORTIES: str = "sorties.json"
SORTIES_SCENARIO: str = "scenario.yaml"
"""Files of a folder of sorties: what was planned, and the scenario that flies it."""

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
    exporter = plug_in("exporters", "mission")
    for name in exports:
        exporter.check(name)
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
            stem, kind = str(target / f"{row['sortie']}-{to}"), plan.planner.task.autopilot.kind
            exporter.write(str(target / row["plan"]), to, str(target / SORTIES_SCENARIO), kind, stem)
        (target / SORTIES).write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        (target / TABLE).write_text(_csv(rows), encoding="utf-8")
        heights = [sortie.plan.heights and sortie.plan.heights.profile for sortie in plan.sorties]
        drawn = [
            (name.removeprefix("sortie-"), sortie.path(), profile_m)
            for name, sortie, profile_m in zip(plan.names, plan.sorties, heights, strict=True)
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


class PlannedJob(NamedTuple):
    """Sorties of a folder: the path of each one's plan by its name, and the field that they cover.

    `parts` are the field's, each its outline and its holes [m].
    """

    plans: dict[str, str]
    parts: list[list[Ring]]
    origin_deg: Point | None
    swath_m: float
    swap_s: float


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
            float(document["swap_s"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError.at(str(path), 1, 1, f"is damaged: {error!r}", "a file of eadp cover --sorties") from None

"""What another package adds beside a planner: an airframe, cells, a pattern, formats, a file of results, a command."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from typer import Option

from eadp.api.flight import simulate
from eadp.cli.output import emit, warn
from eadp.exchange.items import RELATIVE, WAYPOINT, DraftItem, MissionDraft
from eadp.exchange.reader import MissionFormat
from eadp.extend import FixedWing, InputError
from eadp.measure.formats import LogFormat
from eadp.measure.power_log import PowerLog
from eadp.survey.coverage import LineGrid


@dataclass(frozen=True)
class Glider(FixedWing):
    """An aeroplane with keys of its own, of which its induced drag follows."""

    model: Literal["glider"] = "glider"
    aspect_ratio: float = 18.0
    zero_lift_drag_coefficient: float = 0.012
    winglet_share: float = 0.9

    @cached_property
    def induced_drag(self):
        """K of the drag polar: winglets take a share of it."""
        return self.winglet_share * super().induced_drag


def sodium(soc):
    """Open-circuit voltage of a cell [V] at a state of charge: it falls all the way, and faster at its end."""
    return 2.6 + 1.3 * soc - 0.9 * (1 - soc) ** 6


def rows(request, heading_rad):
    """Lines from one side of the field to the other, each in the direction opposite to the last."""
    swath_m = request.motion.swath_m
    grid = LineGrid.over(request.field, heading_rad, swath_m, request.order_spacing_m or swath_m)
    return [leg.backward() if i % 2 else leg for i, leg in enumerate(grid.whole_lines(request.field)[::2])]


def read_bars(source, columns):
    """A log of `seconds|watts` under the line `bars`."""
    try:
        numbers = np.array([line.split("|") for line in source.text.body.splitlines()[1:]], dtype=float)
        return PowerLog(source.name, numbers[:, 0] - numbers[0, 0], numbers[:, 1])
    except (ValueError, IndexError):
        raise InputError.at(source.name, 2, 1, "is no row of two numbers", "seconds|watts") from None


BARS = LogFormat("bars", lambda head: head.startswith(b"bars\n"), read_bars)


def read_corners(source):
    """A mission of `latitude longitude altitude` under the line `corners`; the first of them is home."""
    items = []
    for i, line in enumerate(source.lines[1:]):
        try:
            place = tuple(map(float, line.split())) if line else ()
        except ValueError:
            raise source.error((i + 2, 1), "is no place", "latitude longitude altitude") from None
        if place:
            parameters = (0.0, 0.0, 0.0, math.nan, *place)
            items.append(DraftItem(f"corner {i}", i, WAYPOINT, RELATIVE, parameters, ((i + 2, 1),) * 9))
    return MissionDraft(items[0].parameters[4:], items[0].locations[6], items[1:])


CORNERS = MissionFormat("corners", lambda head: head.startswith("corners\n"), read_corners)


def corners_text(path):
    """The path as the format of `read_corners`."""
    return "corners\n" + "".join(f"{lat:.7f} {lon:.7f} {altitude:g}\n" for lat, lon, altitude in path.drawn())


def stage_lines(flight):
    """The energy of each stage of a flight, as lines of a table."""
    columns = flight.columns
    energies_wh = columns["power_w"] * np.diff(columns["time_s"], prepend=0.0) / 3600
    stages = np.unique(columns["stage"]).astype(int).tolist()
    return ["stage,energy_wh", *(f"{stage},{energies_wh[columns['stage'] == stage].sum():.3f}" for stage in stages)]


def write_stages(flight, folder):
    """Write `stages.csv` into the folder of a flight."""
    (folder / "stages.csv").write_text("\n".join(stage_lines(flight)) + "\n")


def stages(plan: str, profile: Annotated[str | None, Option(help="Computation profile.")] = None) -> int:
    """Example: eadp stages plans/survey.plan --profile profiles/pednet-letter.yaml

    Fly a plan, and print the energy of each stage.
    """
    emit("\n".join(stage_lines(simulate(plan, profile=profile, warn=warn))))
    return 0

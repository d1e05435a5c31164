"""The figure of a coverage path: the field, the ground covered, lines and turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from eadp.core.geometry.curves import Point
from eadp.io.figures.canvas import (
    COLOURS,
    START,
    Axes,
    draw_area,
    draw_arrow,
    draw_ground,
    figure_file,
    figure_pair,
    fit_legend,
    label_map,
)
from eadp.models.airspace import Field
from eadp.survey.report import LeftGround
from eadp.survey.swaths import CoverageLeg, CoveragePath

STEP_M = 3.0
"""Distance between points of a turn, about [m]."""


def write_coverage_figure(
    path: str, field: Field, ways: Mapping[str, CoveragePath], swath_m: float, left: Sequence[LeftGround] = ()
) -> None:
    """Draw a field and coverage paths side by side under their titles: ground covered and left, lines, turns.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    """
    x, y = zip(*(corner for part in field.parts for corner in part[0]), strict=True)
    wide = min(1.6, max(0.5, (max(x) - min(x) + 150) / (max(y) - min(y) + 150)))
    with figure_file(path, 0.8 + 5.5 * wide * len(ways), 6.5) as figure:
        all_axes = figure.subplots(1, len(ways), sharex=True, sharey=True, squeeze=False)[0]
        for axes, (title, way) in zip(all_axes, ways.items(), strict=True):
            draw_ground(axes, field, field.airspace)
            draw_left(axes, left)
            _draw_way(axes, way, swath_m)
            label_map(axes, title)
            axes.set_aspect("equal", adjustable="box")
            axes.label_outer()
        fit_legend(figure, 6, loc="outside lower center", fontsize=9)


def draw_left(axes: Axes, left: Sequence[LeftGround]) -> None:
    """Ground that is not covered, hatched."""
    style = {"facecolor": "white", "edgecolor": "#00000070", "hatch": "xx", "linewidth": 0.6, "zorder": 1.9}
    for each in left:
        draw_area(axes, each.rings, **style, label="not covered")


def _draw_way(axes: Axes, way: CoveragePath, swath_m: float) -> None:
    """Strips of ground covered, lines and turns over them, arrows on the lines, start and end."""
    for leg in way.legs:
        if leg.sensing:
            label = f"ground covered, {swath_m:g} m wide"
            axes.fill(*ground_of(leg, swath_m), color=COLOURS[0], alpha=0.13, linewidth=0, zorder=2, label=label)
            axes.plot(*line_of(leg), color=COLOURS[0], linewidth=1.3, label="line", zorder=3)
        else:
            axes.plot(*line_of(leg), color=COLOURS[1], linewidth=1.0, label="turn", zorder=3)
    _draw_arrows(axes, way)
    axes.plot(*way.pieces[0].start[:2], **START)
    axes.plot(*way.pieces[-1].end[:2], "s", color="black", markersize=5, zorder=4, label="end")


def _draw_arrows(axes: Axes, way: CoveragePath) -> None:
    """An arrow in the middle of the longest piece of each run of lines, all of one length."""
    arrow_m = max(piece.length_m for piece in way.pieces) / 30
    for run in way.runs:
        longest = max((leg.piece for leg in run), key=lambda piece: piece.length_m)
        x, y, heading = longest.pose_at(longest.length_m / 2)
        draw_arrow(axes, (x, y), (x + arrow_m * math.cos(heading), y + arrow_m * math.sin(heading)), COLOURS[0])


def line_of(leg: CoverageLeg) -> list[tuple[float, ...]]:
    """x and y along a leg [m]: both ends, and points of an arc."""
    piece = leg.piece
    steps = max(1, math.ceil(piece.length_m / STEP_M)) if piece.turn else 1
    return [*zip(*(piece.pose_at(piece.length_m * i / steps) for i in range(steps + 1)), strict=True)][:2]


def ground_of(leg: CoverageLeg, swath_m: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """x and y of the corners of the ground that a line covers [m]."""
    (x0, y0, heading), (x1, y1, _) = leg.start, leg.end
    dx, dy = -swath_m / 2 * math.sin(heading), swath_m / 2 * math.cos(heading)
    return (x0 + dx, x1 + dx, x1 - dx, x0 - dx), (y0 + dy, y1 + dy, y1 - dy, y0 - dy)


def write_sorties_figure(
    path: Path,
    field: Field,
    sorties: Sequence[tuple[str, CoveragePath]],
    swath_m: float,
    home_m: Point | None,
    left: Sequence[LeftGround] = (),
) -> None:
    """Draw sorties, each its number and its path. Written to `path` with the endings .svg and .png."""
    with figure_pair(path, 8.5, 8.0) as figure:
        axes = figure.subplots()
        draw_ground(axes, field, field.airspace)
        draw_left(axes, left)
        for i, (number, way) in enumerate(sorties):
            colour = COLOURS[i % len(COLOURS)]
            lines, turns = ([leg for leg in way.legs if leg.sensing is on] for on in (True, False))
            middles = [leg.piece.pose_at(leg.piece.length_m / 2)[:2] for leg in lines]
            for leg in lines:
                axes.fill(*ground_of(leg, swath_m), color=colour, alpha=0.22, linewidth=0, zorder=2)
            for legs, width in ((lines, 1.2), (turns, 0.6)):
                # as one line with breaks, which is quicker to draw
                xy = [point for leg in legs for point in (*zip(*line_of(leg), strict=True), (math.nan, math.nan))]
                axes.plot(*zip(*xy, strict=True), color=colour, linewidth=width, zorder=3, label=f"sortie {number}")
            if middles:
                at = middles[len(middles) // 2]
                box = {"boxstyle": "circle", "facecolor": "white", "edgecolor": colour}
                axes.text(*at, number.lstrip("0"), ha="center", va="center", fontsize=9, zorder=5, bbox=box)
        if home_m is not None:
            axes.plot(*home_m, **{**START, "label": "home"})
        label_map(axes, "Sorties")
        fit_legend(figure, 5, loc="outside lower center", fontsize=8)

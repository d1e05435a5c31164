"""The figure of a coverage path: the field, the ground covered, lines and turns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from eadp.coverage.heights import HeightProfile
from eadp.coverage.left import LeftGround
from eadp.coverage.swaths import CoverageLeg, CoveragePath
from eadp.io.figures.canvas import (
    COLOURS,
    START,
    Axes,
    draw_area,
    draw_arrow,
    draw_ground,
    figure_file,
    fit_legend,
    label_map,
)
from eadp.models.field import Field

STEP_M = 3.0
"""Distance between points of a turn, about [m]."""


def write_coverage_figure(
    path: str,
    field: Field,
    ways: Mapping[str, CoveragePath],
    swath_m: float,
    *,
    profile: HeightProfile | None = None,
    left: Sequence[LeftGround] = (),
) -> None:
    """Draw a field and coverage paths side by side under their titles: ground covered and left, lines, turns.

    Over terrain the ground and the flight are drawn below.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    """
    x, y = zip(*(corner for part in field.parts for corner in part[0]), strict=True)
    wide = min(1.6, max(0.5, (max(x) - min(x) + 150) / (max(y) - min(y) + 150)))
    below = 0 if profile is None else 1
    with figure_file(path, max(0.8 + 5.5 * wide * len(ways), 6.0 * below), 6.5 + 2.2 * below) as figure:
        rows = figure.add_gridspec(1 + below, 1, height_ratios=[3, 1][: 1 + below])
        grid = rows[0].subgridspec(1, len(ways))
        all_axes = grid.subplots(sharex=True, sharey=True, squeeze=False)[0]
        if profile is not None:
            draw_profile(figure.add_subplot(rows[1]), profile)
        for axes, (title, way) in zip(all_axes, ways.items(), strict=True):
            draw_ground(axes, field, field.airspace)
            draw_left(axes, left)
            _draw_way(axes, way, swath_m)
            label_map(axes, title)
            axes.set_aspect("equal", adjustable="box")
            axes.label_outer()
        fit_legend(figure, 6, loc="outside lower center", fontsize=9)


def draw_profile(axes: Axes, profile: HeightProfile, from_km: float = 0.0) -> float:
    """The ground and the flight over the distance flown, and where it ends [km]; on lines the heights allowed, too."""
    km, on_line, limits = from_km + profile.samples.places_m / 1000, profile.samples.on_line, profile.ground.limits
    axes.fill_between(km, profile.ground_m, profile.ground_m.min(), color="#b7a98f", linewidth=0, label="ground")
    low_m = profile.ground_m + limits.line_m
    band = (low_m, low_m + limits.tolerance_m)
    label = f"{limits.line_m:.4g} to {limits.line_m + limits.tolerance_m:.4g} m above ground"
    axes.fill_between(km, *band, where=on_line, color=COLOURS[2], alpha=0.3, linewidth=0, label=label)
    axes.plot(km, profile.flown_m, color=COLOURS[1], linewidth=1.0)
    axes.plot(km, np.where(on_line, profile.flown_m, np.nan), color=COLOURS[0], linewidth=1.3)
    axes.set_xlabel("distance flown [km]")
    axes.set_ylabel("altitude [m]")
    axes.margins(x=0)
    return float(km[-1])


def draw_left(axes: Axes, left: Sequence[LeftGround]) -> None:
    """Ground that is not covered, hatched."""
    style = {"facecolor": "white", "edgecolor": "#00000070", "hatch": "xx", "linewidth": 0.6, "zorder": 1.9}
    for each in left:
        draw_area(axes, each.rings, **style, label="not covered")


def _draw_way(axes: Axes, way: CoveragePath, swath_m: float) -> None:
    """Strips of ground covered, lines and turns over them, arrows on the lines, start and end."""
    pieces = way.pieces
    arrow = max((piece.length_m for piece in pieces), default=1.0) / 30
    for line in way.runs:
        piece = max((leg.piece for leg in line), key=lambda piece: piece.length_m)
        x, y, heading = piece.pose_at(piece.length_m / 2)
        draw_arrow(axes, (x, y), (x + arrow * math.cos(heading), y + arrow * math.sin(heading)), COLOURS[0])
    for leg in way.legs:
        if not leg.sensing:
            axes.plot(*line_of(leg), color=COLOURS[1], linewidth=1.0, label="turn", zorder=3)
            continue
        label = f"ground covered, {swath_m:g} m wide"
        axes.fill(*ground_of(leg, swath_m), color=COLOURS[0], alpha=0.13, linewidth=0, zorder=2, label=label)
        axes.plot(*line_of(leg), color=COLOURS[0], linewidth=1.3, label="line", zorder=3)
    axes.plot(*pieces[0].start[:2], **START)
    axes.plot(*pieces[-1].end[:2], "s", color="black", markersize=5, zorder=4, label="end")


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

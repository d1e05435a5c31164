"""The figure of sorties: the field, and the lines of each flight in a colour of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from eadp.core.geometry.curves import Point
from eadp.coverage.heights import HeightProfile
from eadp.coverage.left import LeftGround
from eadp.coverage.swaths import CoveragePath
from eadp.io.figures.canvas import COLOURS, START, Axes, draw_ground, figure_pair, fit_legend, label_map
from eadp.io.figures.coverage import draw_left, draw_profile, ground_of, line_of
from eadp.models.field import Field


def write_sorties_figure(
    path: Path,
    field: Field,
    sorties: Sequence[tuple[str, CoveragePath, HeightProfile | None]],
    swath_m: float,
    home_m: Point | None,
    left: Sequence[LeftGround] = (),
) -> None:
    """Draw sorties, over terrain with ground and flights below. Written to `path` with the endings .svg and .png.

    Each of `sorties` is its number, its path, and over terrain its heights.
    """
    flown = [(number, profile) for number, _, profile in sorties if profile is not None]
    with figure_pair(path, 8.5, 8.0 + 2.2 * bool(flown)) as figure:
        axes, *below = figure.subplots(1 + bool(flown), 1, height_ratios=[3, 1][: 1 + bool(flown)], squeeze=False)[:, 0]
        for panel in below:
            _draw_profiles(panel, flown)
        draw_ground(axes, field, field.airspace)
        draw_left(axes, left)
        for i, (number, way, _) in enumerate(sorties):
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


def _draw_profiles(axes: Axes, flown: Sequence[tuple[str, HeightProfile]]) -> None:
    """The heights of flights, one after the other, with their numbers."""
    from_km = 0.0
    for number, profile in flown:
        to_km = draw_profile(axes, profile, from_km)
        axes.axvline(to_km, color="#00000060", linewidth=0.8)
        at = ((from_km + to_km) / 2, 0.02)
        axes.text(*at, number.lstrip("0"), transform=axes.get_xaxis_transform(), ha="center", va="bottom", fontsize=9)
        from_km = to_km
    axes.set_xlabel("distance flown, sortie after sortie [km]")

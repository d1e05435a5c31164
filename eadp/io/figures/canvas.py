"""Figures saved as SVG or PNG, their common colours, legends, callouts and arrows; the only import of matplotlib."""

from __future__ import annotations

import tempfile
import textwrap
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eadp.core.arrays import FloatArray
from eadp.core.geometry.curves import CIRCLE, CURVE, LINE
from eadp.errors import InputError
from eadp.io.text.streams import write_bytes
from eadp.models.airspace import Airspace, Field
from eadp.models.plan.stage import Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure
else:  # matplotlib is imported when a figure is drawn
    Axes = Figure = Any

MAX_NAMED = 20
"""Most obstacles whose names are written."""

HEADLINE_PER_IN, LABEL_CHARACTERS, LINES = 10, 24, 3
"""Characters of the headline in an inch; most characters in a line of a label, and its most lines."""

CALLOUT_CHARACTERS, CALLOUT_LINES = 36, 8
"""Most characters in a line of a callout, and most lines."""

ROWS, TALL = (0.98, 0.66, 0.34), 0.2
"""Tops of the rows of callouts, and the height of one, as shares of the axes."""

COLOURS = ("#3b6fb6", "#d1752b", "#3f8f5b", "#a2437c", "#7a6a4f", "#5b5bb0", "#b0413e", "#2f8f8f")
GREY = "#8a8f98"
START: dict[str, Any] = {
    "marker": "o",
    "color": "black",
    "markersize": 9,
    "markerfacecolor": "none",
    "linewidth": 0,
    "label": "start",
    "zorder": 6,
}
"""The marker of a start: a ring, in which the marker of an end at the same point shows."""

FIELD: dict[str, Any] = {
    "facecolor": "#eef3e6",
    "edgecolor": "#6f8f4f",
    "linewidth": 1.4,
    "zorder": 0.5,
    "label": "field",
}
CALLOUT: dict[str, Any] = {
    "textcoords": "axes fraction",
    "va": "top",
    "ma": "left",
    "fontsize": 8,
    "fontweight": "bold",
    "zorder": 7,
    "bbox": {"boxstyle": "round", "facecolor": "white", "edgecolor": GREY, "alpha": 0.9},
    "arrowprops": {"arrowstyle": "-", "color": GREY},
    "in_layout": False,
}
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.titley": 1.0,  # above the axes, wherever their ticks are: matplotlib would look for them in each drawing
    "axes.formatter.useoffset": False,
    "text.parse_math": False,  # names may hold any character
    "legend.frameon": False,
    "legend.fontsize": 8,
    "svg.hashsalt": "eadp",
    "svg.fonttype": "path",
    "figure.dpi": 110,
}

METADATA: dict[str, dict[Any, Any]] = {".svg": {"Date": None, "Creator": "eadp"}, ".png": {"Software": "eadp"}}
"""Formats of figures, and what each says of its making: nothing that changes from run to run."""

Point = tuple[float, float]
_KINDS = (LINE, CIRCLE, CURVE)


def stage_style(stages: Sequence[Stage], index: int) -> tuple[str, str]:
    """Colour and name of a stage, by its index from 1, in a legend: its own where they are few, else its kind's."""
    kind = stages[index - 1].kind
    if len(stages) <= len(COLOURS):
        return COLOURS[index - 1], f"stage {index} ({kind})"
    return COLOURS[_KINDS.index(kind)], f"{kind}s"


@contextmanager
def figure_pair(
    path: Path, width_in: float, height_in: float, suffixes: Sequence[str] = tuple(METADATA)
) -> Iterator[Figure]:
    """A figure saved as SVG and PNG under a name without its ending; same data, same bytes."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # of a name: it is drawn as a box
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        engine = figure.get_layout_engine()
        assert engine is not None
        engine.execute(figure)  # once for both files: with an engine, each would lay out and draw twice
        figure.set_layout_engine(None)
        for axes in figure.axes:  # the engine's last digits change from run to run
            x, y, width, height = (round(v, 6) for v in axes.get_position(original=True).bounds)
            axes.set_position((x, y, width, height))
        for suffix in suffixes:
            figure.savefig(path.with_suffix(suffix), metadata=METADATA[suffix])


def check_figure_name(path: str) -> None:
    """Refuse a figure's name that ends in neither .svg nor .png; raises InputError."""
    if Path(path).suffix.lower() not in METADATA:
        raise InputError.at(path, 1, 1, "is not the name of a figure", "a name that ends in .svg or .png")


@contextmanager
def figure_file(path: str, width_in: float, height_in: float) -> Iterator[Figure]:
    """A figure saved as SVG or PNG, by the ending of its name; as `figure_pair`.

    Raises
    ------
    InputError
        If the name ends in neither, or the file cannot be written.
    """
    check_figure_name(path)
    suffix = Path(path).suffix.lower()
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "figure"
        with figure_pair(draft, width_in, height_in, [suffix]) as figure:
            yield figure
        write_bytes(path, draft.with_suffix(suffix).read_bytes())


def write_headline(figure: Figure, parts: Sequence[str]) -> None:
    """The bold line above all panels, or several where it is long."""
    text = textwrap.fill("  ·  ".join(parts), int(HEADLINE_PER_IN * figure.get_figwidth()))
    figure.suptitle(text, x=0.01, ha="left", fontsize=11, fontweight="bold")


def label_map(axes: Axes, title: str) -> None:
    """Equal scales, and the labels of a map in local metres."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, east [m]")
    axes.set_ylabel("y, north [m]")
    axes.set_title(title)


def fit_legend(owner: Any, columns: int, wide: float = 1.0, **style: Any) -> None:
    """A legend of axes or of a figure, at most so many times as wide: in fewer columns and more lines where needed.

    `handles` are the marks, by default all that are labelled; of several with one label it has the first.
    """
    panels = owner.axes if isinstance(owner.axes, list) else [owner]
    marks = style.pop("handles", [mark for axes in panels for mark in axes.get_legend_handles_labels()[0]])
    first: dict[str, Any] = {}
    for mark in marks:
        first.setdefault(textwrap.fill(mark.get_label(), 2 * LABEL_CHARACTERS, max_lines=LINES), mark)
    style |= {"handles": [*first.values()], "labels": [*first]}
    while (legend := owner.legend(ncols=columns, **style)).get_window_extent().width > wide * owner.bbox.width:
        if columns == 1:
            return
        legend.remove()
        columns -= 1


def legend_above(axes: Axes, columns: int = 2, **style: Any) -> None:
    """A legend on the line of the title, at its right."""
    fit_legend(axes, columns, loc="lower right", bbox_to_anchor=(1.0, 1.0), **style)


def legend_below(axes: Axes, columns: int = 4, below: float = 0.08, **style: Any) -> None:
    """A legend under the labels of the x axis."""
    fit_legend(axes, columns, 1.3, loc="upper center", bbox_to_anchor=(0.5, -below), **style)


def scale_by_decades(axes: Axes) -> None:
    """A logarithmic x axis with plain numbers."""
    from matplotlib.ticker import LogFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(LogFormatter(minor_thresholds=(1.0, 0.4)))


def write_none(axes: Axes, text: str) -> None:
    """What is not there to be drawn, in the middle of axes."""
    axes.tick_params(bottom=False, labelbottom=False, left=False, labelleft=False)
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=GREY)


def write_callouts(axes: Axes, callouts: Sequence[tuple[str, Point]]) -> None:
    """Texts at points, the last first, each in a free row on its point's side of the axes, which they do not change."""
    rows = list(ROWS)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    for text, (x, y) in callouts[: -len(ROWS) - 1 : -1]:
        up = (y - low) / (high - low)
        top = min(rows, key=lambda row: abs(abs(row - TALL / 2 - up) - TALL))  # beside the point, not on it
        rows.remove(top)
        lines = [line for part in text.splitlines() for line in textwrap.wrap(part, CALLOUT_CHARACTERS)]
        if len(lines) > CALLOUT_LINES:
            lines[CALLOUT_LINES - 1 :] = ["…"]
        place, side = (0.98, "right") if x > (left + right) / 2 else (0.02, "left")
        axes.annotate("\n".join(lines), (x, y), (place, top), ha=side, **CALLOUT)


def draw_arrow(axes: Axes, tail: Point, tip: Point, colour: str) -> None:
    """An arrow from one point to another, in the coordinates of the data."""
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=tip, xytext=tail, arrowprops=style)


def draw_area(axes: Axes, rings: Sequence[Sequence[Point]], **style: Any) -> None:
    """A filled polygon: its outline, then its holes, of the opposite winding."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    outline = Outline.make_compound_path(*(Outline((*ring, ring[0]), closed=True) for ring in rings))
    axes.add_patch(PathPatch(outline, **style))


def draw_ground(axes: Axes, field: Field | None, airspace: Airspace) -> None:
    """The parts of a field; obstacles, hatched, with their names, and the boundary."""
    for part in field.parts if field else ():
        draw_area(axes, part, **FIELD)
    style = {"facecolor": "#d1752b22", "edgecolor": COLOURS[6], "hatch": "///", "linewidth": 1.2, "zorder": 2}
    for obstacle in airspace.obstacles:
        draw_area(axes, (obstacle.outline,), **style, label="obstacle")
        if len(airspace.obstacles) <= MAX_NAMED:
            x, y = (sum(values) / len(values) for values in zip(*obstacle.outline, strict=True))
            name = textwrap.fill(obstacle.name, LABEL_CHARACTERS, max_lines=LINES)
            axes.annotate(name, (x, y), zorder=6, color=COLOURS[6], fontsize=7, ha="center", va="center")
    for ring in airspace.boundary:
        x, y = zip(*ring, ring[0], strict=True)
        axes.plot(x, y, color=COLOURS[6], linestyle="--", linewidth=1.2, label="boundary")


def draw_areas(axes: Axes, outlines: Sequence[FloatArray], **style: Any) -> None:
    """Filled polygons of one style, each of corners, shape (n, 2)."""
    from matplotlib.collections import PolyCollection

    axes.add_collection(PolyCollection(outlines, **style))


def span_text(values: Iterable[float]) -> str:
    """The smallest and the largest of some values, or the one that they all are."""
    ordered = sorted(values)
    return " to ".join(f"{value:g}" for value in dict.fromkeys((ordered[0], ordered[-1])))


def draw_circles(axes: Axes, centres: Sequence[Point], radii: Sequence[float]) -> None:
    """Dotted circles."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    circles = [Circle(*each) for each in zip(centres, radii, strict=True)]
    axes.add_collection(PatchCollection(circles, facecolor="#00000008", edgecolor=GREY, linewidth=0.6, linestyle=":"))

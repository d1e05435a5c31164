"""Texts of figures lie within the figure, off one another, and change no axes."""

import pytest
from matplotlib.text import Text

from eadp.io.figures.canvas import (
    ROWS,
    draw_ground,
    figure_pair,
    legend_above,
    legend_below,
    write_callouts,
    write_headline,
)
from eadp.models.airspace import Airspace, Obstacle

LONG = "even the computations of minimum power exceed what the battery allows; no path that is left keeps the reserve"


def box(text):
    """Where a text is, without the arrow of an annotation."""
    return Text.get_window_extent(text)


def title_of(axes):
    return next(
        each for each in axes.get_children() if isinstance(each, Text) and each.get_text() == axes.get_title("left")
    )


def texts(figure):
    """Every text that is written, but for the numbers of the axes."""
    for axes in figure.axes:
        yield from (title_of(axes), axes.xaxis.label, axes.yaxis.label, *axes.texts)
        yield from axes.get_legend().get_texts() if axes.get_legend() else ()
    for legend in figure.legends:
        yield from legend.get_texts()
    yield from (each for each in figure.get_children() if isinstance(each, Text))


def check(figure):
    """Every text lies in the figure, and no legend on a title."""
    for text in filter(Text.get_text, texts(figure)):
        (x0, y0), (x1, y1) = box(text).min, box(text).max
        assert (min(x0, y0) >= -1, x1 <= figure.bbox.width + 1, y1 <= figure.bbox.height + 1) == (True,) * 3, text
    for axes in figure.axes:
        legend = axes.get_legend()
        assert not (legend and legend.get_window_extent().overlaps(box(title_of(axes))))


def limits(figure):
    return [(axes.get_xlim(), axes.get_ylim(), axes.get_position().bounds) for axes in figure.axes]


def drawn(folder, callouts=()):
    with figure_pair(folder / "a", 8.0, 6.0, [".png"]) as figure:
        axes = figure.add_subplot()
        axes.plot([0, 100, 100, 0], [0, 0, 60, 60])
        axes.set_aspect("equal", adjustable="datalim")
        write_callouts(axes, callouts)
    return figure


@pytest.mark.slow
@pytest.mark.parametrize("text", [LONG, "x" * 400, "a, b\n" * 30, r"$\bad$ costs $3"])
def test_callouts_change_nothing_and_lie_within(tmp_path, text):
    points = [(5 * i, 60.0 * (i % 2)) for i in range(20)]
    figure = drawn(tmp_path, [(text, point) for point in points])
    assert limits(figure) == limits(drawn(tmp_path))
    boxes = [box(text) for text in figure.axes[0].texts]
    assert [text.xy for text in figure.axes[0].texts] == points[: -len(ROWS) - 1 : -1], "the last, and no others"
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    check(figure)


@pytest.mark.quick(1)
@pytest.mark.parametrize("legend", [legend_above, legend_below])
@pytest.mark.parametrize("label", ["short", LONG])
def test_long_headlines_and_legends_are_wrapped(tmp_path, legend, label):
    with figure_pair(tmp_path / "a", 8.0, 5.0, [".png"]) as figure:
        axes = figure.add_subplot()
        for i in range(2):
            axes.plot([0, 1], [0, i], label=f"{i} {label}")
        axes.set(title="Power", xlabel="time [s]", ylabel="power [W]")
        legend(axes)
        write_headline(figure, [LONG, LONG])
    check(figure)


def test_a_name_may_hold_any_character(tmp_path):
    square = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0))
    with figure_pair(tmp_path / "a", 4.0, 5.0, [".png"]) as figure:
        draw_ground(figure.add_subplot(), None, Airspace((Obstacle(square, r"$\bad$ 草地"),)))
    assert [text.get_text() for text in figure.axes[0].texts] == [r"$\bad$ 草地"]

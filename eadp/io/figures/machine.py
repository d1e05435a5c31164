"""The figure of a plan's state machine: stages as states, triggers as transitions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from eadp.errors import printable
from eadp.io.figures.canvas import COLOURS, GREY, Axes, Point, draw_arrow, figure_file, span_text
from eadp.models.plan.plan import Plan
from eadp.models.plan.segments import Segment
from eadp.models.plan.stage import Stage, point_at

ACROSS = 6
"""Most states in a row."""

SHOWN = 36
"""Most stages of a segment that are drawn: of more, the first ones and the last."""

RADIUS, STEP, ROW = 0.45, 2.3, 2.1
"""Radius of a state, and the distance from one to the next and from row to row, in units of the drawing."""

WRITTEN = 40
"""Most characters of a condition that are written at a transition."""

SHORT = 12
"""Most characters of a point that are written in one line."""

INK = "#444"


@dataclass(frozen=True)
class _Block:
    """Stages flown once, or lap by lap, from a height [units] on; None stands for those left out."""

    stages: Sequence[Stage | None]
    top: float
    loop: str
    until: str

    @property
    def places(self) -> list[Point]:
        return [((i % ACROSS) * STEP, self.top - i // ACROSS * ROW) for i in range(len(self.stages))]

    @property
    def bottom(self) -> float:
        return self.places[-1][1] - (1.6 if self.loop else 0.8)


def write_machine_figure(path: str, plan: Plan, parameters: Sequence[float]) -> None:
    """Draw a plan as a finite state machine: stages Γ_i, the points that end them, the loop of laps, and the end Γ_f.

    Raises
    ------
    InputError
        If the name ends in neither .svg nor .png, or the file cannot be written.
    PathUndefined
        If a trigger, the shift or the final point has no value at these parameters.

    Source: letter, Def. II.1 and Fig. 3.
    """
    plan = plan.laps()
    blocks = _blocks(plan, parameters)
    right = max(x for block in blocks for x, _ in block.places) + STEP
    width, height = right + 3.7, 1.5 - blocks[-1].bottom
    with figure_file(path, 0.75 * width, 0.75 * height, formulas=True) as figure:
        axes = figure.add_subplot()
        axes.set_aspect("equal")
        axes.set_axis_off()
        radius = span_text(plan.radius_m(stage) for stage in plan.stages)
        axes.set_title(f"State machine; a transition within {radius} m of its point")
        axes.plot(-1.7, 0, "o", color="black", markersize=9)
        axes.text(-1.7, 0.25, "start", ha="center", fontsize=8)
        _draw_transition(axes, [(-1.7, 0), (-RADIUS, 0)])
        for i, block in enumerate(blocks):
            _draw_block(axes, block, parameters)
            if i + 1 < len(blocks):
                label = _trigger(block.stages[-1], parameters).replace("\n", " ")
                until = f" and {block.until}" if block.until else ""
                _draw_next_row(axes, block.places[-1], blocks[i + 1].places[0], label + until)
        _draw_end(axes, blocks[-1], plan, parameters, right)
        axes.set(xlim=(-2.2, right + 1.5), ylim=(blocks[-1].bottom, 1.5))


def _blocks(plan: Plan, parameters: Sequence[float]) -> list[_Block]:
    blocks: list[_Block] = []
    for segment in plan.segments or (Segment(0, len(plan.stages)),):
        stages: list[Stage | None] = [*plan.stages[segment.first : segment.first + segment.count]]
        if len(stages) > SHOWN:
            stages = [*stages[: SHOWN - ACROSS], None, *stages[1 - ACROSS :]]
        loop = "next lap" if segment.repeats or plan.repeats else ""
        if plan.repeats and plan.shift is not None:
            loop += f", moved by d = {_numbers(point_at(plan.shift, parameters, 'the shift'))} m"
        until = " ≥ ".join(side.text for side in segment.until) if segment.until else ""
        top = blocks[-1].bottom - 1.3 if blocks else 0.0
        blocks.append(_Block(stages, top, loop, printable(until, WRITTEN)))
    return blocks


def _trigger(stage: Stage | None, parameters: Sequence[float]) -> str:
    """The point that ends a stage: its name, and where it is in the first lap."""
    if stage is None:
        return ""
    where = _numbers(stage.trigger_at(parameters))
    return f"{_name('p', stage.index)}\n{where if len(where) <= SHORT else where.replace(' ', chr(10))}"


def _numbers(point: Point) -> str:
    return f"({round(point[0], 1):g}, {round(point[1], 1):g})"


def _name(kind: str, index: int | str) -> str:
    """Γ_i, φ_i or p_Γi."""
    return f"$p_{{\\Gamma_{{{index}}}}}$" if kind == "p" else f"$\\{kind}_{{{index}}}$"


def _draw_block(axes: Axes, block: _Block, parameters: Sequence[float]) -> None:
    """States in rows, and the transitions between them."""
    places = block.places
    for i, (stage, (x, y)) in enumerate(zip(block.stages, places, strict=True)):
        if stage is None:
            axes.text(x, y, "…", ha="center", va="center", fontsize=16)
        else:
            _draw_state(axes, (x, y), _name("Gamma", stage.index), COLOURS[(stage.index - 1) % len(COLOURS)])
            below = f"{_name('varphi', stage.index)}, {stage.kind}"
            axes.text(x, y - RADIUS - 0.08, below, ha="center", va="top", fontsize=8)
        label = _trigger(stage, parameters)
        if i + 1 == len(places):
            continue
        if places[i + 1][1] == y:
            _draw_transition(axes, [(x + RADIUS, y), (x + STEP - RADIUS, y)])
            axes.text(x + STEP / 2, y + 0.06, label, ha="center", va="bottom", fontsize=8)
        else:
            _draw_next_row(axes, (x, y), places[i + 1], label.replace("\n", " "))
    if block.loop:
        (_, y0), (x1, y1) = places[0], places[-1]
        low = y1 - 1.2
        _draw_transition(
            axes, [(x1 + 0.4, y1 - 0.2), (x1 + 0.4, low), (-1.05, low), (-1.05, y0 - 0.2), (-0.4, y0 - 0.2)]
        )
        text = f"{label.partition(chr(10))[0]}: {block.loop}"
        axes.text(x1 / 2 - 0.3, low - 0.06, text, ha="center", va="top", fontsize=8)


def _draw_end(axes: Axes, block: _Block, plan: Plan, parameters: Sequence[float], right: float) -> None:
    """Γ_f, and what leads to it: the last trigger, or from any stage a position beyond the final point."""
    x, y = block.places[-1]
    label = _trigger(block.stages[-1], parameters)
    middle = (x + right) / 2
    if plan.repeats:
        middle = right
        final = f"{_numbers(point_at(plan.final_point, parameters, 'the final point'))} m"
        way = f"{label.partition(chr(10))[0]} at or" if plan.ends_at_trigger else "from any stage:"
        label = f"{way}\nbeyond {_name('p', 'f')}\n{final}"
        if not plan.ends_at_trigger:
            x = max(x for x, _ in block.places) + STEP / 2 - 0.2
            box = [(-1.3, block.top + 1.0), (x, block.top + 1.0), (x, block.bottom + 0.05), (-1.3, block.bottom + 0.05)]
            axes.fill(*zip(*box, strict=True), fill=False, edgecolor=GREY, linewidth=0.9, linestyle="--")
            x -= RADIUS
    _draw_transition(axes, [(x + RADIUS, y), (right - RADIUS, y)])
    raised = RADIUS if plan.repeats else 0.0
    axes.text(middle, y + raised + 0.06, label, ha="center", va="bottom", fontsize=8)
    _draw_state(axes, (right, y), _name("Gamma", "f"), "black")
    _draw_state(axes, (right, y), "", "black", RADIUS - 0.08)


def _draw_next_row(axes: Axes, start: Point, end: Point, label: str) -> None:
    """A transition from the end of a row to the start of another."""
    (x0, y0), (x1, y1) = start, end
    aside, above = x0 + RADIUS + 0.25, y1 + RADIUS + 0.35
    _draw_transition(
        axes, [(x0 + RADIUS, y0), (aside, y0), (aside, above), (x1 - 0.8, above), (x1 - 0.8, y1), (x1 - RADIUS, y1)]
    )
    axes.text((x1 - 0.8 + aside) / 2, above + 0.04, label, ha="center", va="bottom", fontsize=8)


def _draw_state(axes: Axes, centre: Point, text: str, colour: str, radius: float = RADIUS) -> None:
    turn = [2 * math.pi * k / 72 for k in range(72)]
    x = [centre[0] + radius * math.cos(angle) for angle in turn]
    y = [centre[1] + radius * math.sin(angle) for angle in turn]
    axes.fill(x, y, fill=False, edgecolor=colour, linewidth=1.6)
    axes.text(*centre, text, ha="center", va="center", fontsize=12, color=colour)


def _draw_transition(axes: Axes, corners: Sequence[Point]) -> None:
    axes.plot(*zip(*corners[:-1], strict=True), color=INK, linewidth=1.0)
    draw_arrow(axes, corners[-2], corners[-1], INK)

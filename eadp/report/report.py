"""A result as its HTML page: a flight's folder, the log of a flight on telemetry, a sweep; and of several flights."""

from __future__ import annotations

import base64
import math
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from eadp.api.flight import OVERRIDES, SUMMARY
from eadp.api.given import File
from eadp.api.inputs import Files, FlightInputs, load_flight
from eadp.core.expressions.tree import number_text
from eadp.errors import EadpError, Fault, InputError, printable, refuse
from eadp.io.figures.canvas import COLOURS, GREY, START, Axes, draw_ground, figure_pair, label_map, legend_above
from eadp.io.flight import label_of, parameter_text
from eadp.io.page import PageSource, check_page, page_html, page_of
from eadp.io.plan.reader import read_plan
from eadp.io.plan.sources import is_mission
from eadp.io.scenario import read_overrides, vehicle_path
from eadp.io.text.csv import number_fault, read_rows
from eadp.io.text.json import aligned, json_lines
from eadp.io.text.streams import Text, output_file, read_text, write_bytes, write_text
from eadp.io.text.yaml import read_yaml
from eadp.models.plan.plan import Plan
from eadp.plug_ins import plug_ins
from eadp.report.flight import FlownFlight, finished, flight_data

Row = tuple[str, Callable[[Mapping[str, Any]], str]]


UNKNOWN = "–"
ROWS: tuple[Row, ...] = (
    ("completed", lambda s: "yes" if s["completed"] else f"NO: {s['reason']}"),
    ("time [s]", lambda s: f"{s['duration_s']:.1f}"),
    ("distance [km]", lambda s: f"{s['distance_m'] / 1000:.2f}"),
    ("energy [Wh]", lambda s: f"{s['energy_wh']:.3f}"),
    ("charge at the end", lambda s: f"{s['soc_final']:.3f}"),
    ("reserve kept", lambda s: "yes" if s["reserve_kept"] else "NO"),
    ("quality", lambda s: UNKNOWN if s["quality"] is None else f"{s['quality']:.3f}"),
    ("ground covered", lambda s: UNKNOWN if s["coverage"] is None else f"{100 * s['coverage']:.1f} %"),
    ("re-plannings", lambda s: f"{s.get('decisions', UNKNOWN)}, failed runs of the solver {s['solver']['failed']}"),
    ("obstacles entered", lambda s: ", ".join(entry["name"] for entry in s["obstacles"]) or "none"),
)
"""What is compared: its name, and how it is written of a summary."""


def comparison(flights: Sequence[DrawnFlight]) -> list[list[str]]:
    """A table: a header with the flights' names, and a row for each figure and each parameter."""
    table = [["", *(flight.name for flight in flights)]]
    rows = [[name, *(text(flight.summary) for flight in flights)] for name, text in ROWS]
    table += [row for row in rows if set(row[1:]) != {UNKNOWN}]
    parameters = [
        {label_of(name, values): parameter_text(values) for name, values in flight.summary["parameters"].items()}
        for flight in flights
    ]
    for label in dict.fromkeys(label for each in parameters for label in each):
        table.append([label, *(each.get(label, UNKNOWN) for each in parameters)])
    return table


def table_text(table: Sequence[Sequence[str]]) -> str:
    """A table for people."""
    return "\n".join(aligned(table, "<", "<"))


def draw_flights(flights: Sequence[DrawnFlight]) -> dict[str, bytes]:
    """The figure of several flights, drawn once: its files by their endings, .svg and .png."""
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "figure"
        write_flights_figure(draft, flights)
        return {path.suffix: path.read_bytes() for path in draft.parent.iterdir()}


def flights_data(flights: Sequence[DrawnFlight], svg: bytes) -> dict[str, Any]:
    """The data of the page: the figure as an image, and the table."""
    plans = {flight.plan.name.rpartition("/")[2] for flight in flights}
    return {
        "title": f"{len(flights)} flights",
        "plans": sorted(plans),
        "figure": base64.b64encode(svg).decode(),
        "table": comparison(flights),
    }


COLUMNS = 4
"""Most paths side by side."""

DASHES: tuple[Any, ...] = ("-", *((0, dashes) for dashes in ((8, 4), (3, 3), (10, 3, 2, 3), (14, 4), (5, 2, 1, 2))))
"""Of the curves, as in the pages: where some have one value, each shows in the gaps of the next."""


class DrawnFlight(NamedTuple):
    """A flight with its name in the figure: its plan, `summary.json`, and the columns of `flight.csv`."""

    name: str
    plan: Plan
    summary: Mapping[str, Any]
    columns: Mapping[str, Sequence[float]]


def write_flights_figure(path: Path, flights: Sequence[DrawnFlight]) -> None:
    """Draw several flights. Written to `path` with the endings .svg and .png.

    Parameters
    ----------
    path : Path
    flights : sequence of DrawnFlight
        Two or more, with names of their own.
    """
    names = list(dict.fromkeys(item.label for flight in flights for item in flight.plan.parameters))
    across = min(len(flights), COLUMNS)
    maps = -(-len(flights) // across)
    charts = ["power_w", "soc", *names]
    heights = [2.6] * maps + [1.0] * len(charts)
    with figure_pair(path, 11.5, 1.5 * sum(heights)) as figure:
        grid = figure.add_gridspec(len(heights), across, height_ratios=heights)
        xy = [[value for flight in flights for value in flight.columns[name]] for name in ("x_m", "y_m")]
        corners = [tuple(map(min, xy)), tuple(map(max, xy))]
        for i, flight in enumerate(flights):
            axes = figure.add_subplot(grid[i // across, i % across])
            _draw_path(axes, flight, COLOURS[i % len(COLOURS)])
            axes.update_datalim(corners)  # all maps show the same ground
        time: Axes | None = None
        for row, column in enumerate(charts, maps):
            time = figure.add_subplot(grid[row, :], sharex=time)
            _draw_column(time, flights, column)
            if column != charts[-1]:
                time.tick_params(labelbottom=False)
            if row == maps:
                legend_above(time, len(flights), handlelength=3)
        assert time is not None
        time.set_xlabel("time [s]")


def _draw_path(axes: Axes, flight: DrawnFlight, colour: str) -> None:
    columns, site = flight.columns, flight.plan.site
    draw_ground(axes, site.field, site.airspace)
    axes.plot(columns["x_m"], columns["y_m"], color=colour, linewidth=1.0)
    axes.plot(columns["x_m"][0], columns["y_m"][0], **START)
    completed = flight.summary["completed"]
    end: dict[str, Any] = {"marker": "s", "markersize": 4} if completed else {"marker": "X", "markersize": 9}
    axes.plot(columns["x_m"][-1], columns["y_m"][-1], color=colour, **end)
    label_map(axes, flight.name)


def _draw_column(axes: Axes, flights: Sequence[DrawnFlight], column: str) -> None:
    """One column of `flight.csv`, or a parameter by its label, over time, of the flights that have it."""
    title = {"power_w": "Power [W]", "soc": "State of charge"}.get(column)
    steps = "steps-post" if title is None else "default"
    axes.set_title(title or column)
    for i, flight in enumerate(flights):
        item = next((item for item in flight.plan.parameters if item.label == column), None)
        if item is None and title is None:
            continue
        if item is not None and item.unit:
            axes.set_title(f"{item.label} [{item.unit}]")
        values = flight.columns[column] if item is None else [*map(item.shown, flight.columns[item.name])]
        time, colour = flight.columns["time_s"], COLOURS[i % len(COLOURS)]
        style: dict[str, Any] = {"linewidth": 0.6 if column == "power_w" else 1.4, "linestyle": DASHES[i % len(DASHES)]}
        axes.plot(time, values, color=colour, drawstyle=steps, label=flight.name, **style)
        if not flight.summary["completed"]:
            axes.plot(time[-1], values[-1], "X", color=colour, markersize=9)
    if column == "soc":
        for reserve in {flight.summary["soc_reserve"] for flight in flights}:
            axes.axhline(reserve, color=GREY, linewidth=0.9, dashes=(4, 3))
            axes.annotate(f"reserve {number_text(reserve)}", (0, reserve), fontsize=7, color=GREY, va="bottom")


COMPARISON = "comparison.html"


def write_comparison(folders: Sequence[str], out: str | None = None) -> tuple[str, str]:
    """Write the page of several flights, and their figure beside it as .svg and .png; return its path and the table.

    Parameters
    ----------
    folders : sequence of str
        Result folders, two or more.
    out : str, optional
        By default `comparison.html` beside the first folder; `-` is standard output, without a figure.

    Raises
    ------
    InputError
        If one is no result folder or stands twice, or a file cannot be written.
    """
    for folder in folders:
        if not os.path.isdir(folder):
            raise InputError.at(folder, 1, 1, "is no folder of a flight", "folders of eadp simulate, one or more")
    with _whole(folders[0]):
        flights = read_flights(folders)
        pictures = draw_flights(flights)
        table, data = table_text(comparison(flights)), flights_data(flights, pictures[".svg"])
    page = Path(folders[0]).resolve().parent / COMPARISON if out is None else Path(out)
    if out != "-":
        output_file(str(page))
        check_page(page)
        beside = [page.with_suffix(suffix) for suffix in pictures]
        taken = [] if page.exists() else [each for each in beside if os.path.lexists(each)]
        refuse([Fault(str(each), 1, 1, "is no picture of this page", "another -o FILE") for each in taken])
        for suffix, picture in pictures.items():
            write_bytes(str(page.with_suffix(suffix)), picture)
    write_text(str(page) if out != "-" else "-", page_html("flights", data))
    return str(page), table


def _data(path: Path, page: Path, keep: str | None) -> tuple[str, dict[str, Any]]:
    """The kind of a result's page, and its data."""
    faulty = path / SUMMARY if os.path.isdir(path) else path
    with _whole(str(faulty)):
        source: PageSource = next(each for each in plug_ins("pages") if each.recognises(path))
        return source.kind, finished(source.data(path, page, keep))


@contextmanager
def _whole(name: str) -> Iterator[None]:
    """Errors of a result that is damaged as faults of its file."""
    try:
        yield
    except EadpError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        what = f"is damaged: {type(error).__name__}: {printable(str(error))}"
        raise InputError.at(name, 1, 1, what, "a result of eadp, whole") from None


def report(result: File | Sequence[File], out: File | None = None, keep: File | None = None) -> str:
    """Write a result as one HTML page that needs no network.

    Parameters
    ----------
    result : path, or sequence of paths
        A result folder, the results file of a sweep, or a log of `eadp replan`. Several folders of flights are drawn
        beside each other.
    out : path, optional
        By default `report.html` in the folder, or beside the file under its name; `-` is standard output.
    keep : path, optional
        Where the folders of a sweep's flights are, for links to them.

    Returns
    -------
    str
        The page's path.

    Raises
    ------
    InputError
        If it is no result, is damaged, or the page cannot be written.
    """
    if not isinstance(result, str | PathLike):
        return write_comparison([*map(str, result)], None if out is None else str(out))[0]
    page = page_of(str(result))
    target = str(page) if out is None else str(out)
    if target != "-":
        check_page(output_file(target))
    data = _data(Path(result), page if target == "-" else Path(target), None if keep is None else str(keep))
    write_text(target, page_html(*data))
    return target


def read_folder(folder: Path) -> FlownFlight:
    """The flight of a result folder.

    Raises
    ------
    InputError
        If a file is missing or damaged.
    """
    if not (folder / SUMMARY).exists():
        raise InputError.at(str(folder), 1, 1, "is no folder of a flight", "a folder of eadp simulate -o DIR")
    (summary,) = json_lines(read_text(str(folder / SUMMARY)), whole=True)
    estimates, decisions = folder / "estimate.csv", folder / "decisions.jsonl"
    head, *rows = _table(folder / "flight.csv")
    inputs = _inputs(folder / "inputs")
    return FlownFlight(
        world=inputs.world,
        scenario=inputs.scenario,
        summary=summary,
        columns=dict(zip(head, map(list, zip(*rows, strict=True)), strict=True)),
        estimates=_table(estimates) if estimates.exists() else [],
        decisions=json_lines(read_text(str(decisions))) if decisions.exists() else [],
    )


FOLDER = PageSource("flight", os.path.isdir, lambda path, page, keep: flight_data(read_folder(path)))
"""The page of a result folder."""


def read_flights(folders: Sequence[str]) -> list[DrawnFlight]:
    """The flights of result folders, each named by its planner, or by its folder where two have one planner.

    Raises
    ------
    InputError
        If a folder stands twice, or as `read_folder`.
    """
    places = [Path(folder).resolve() for folder in folders]
    for i, place in enumerate(places):
        if place in places[:i]:
            raise InputError.at(folders[i], 1, 1, "stands twice", "folders of different flights")
    flights = [read_folder(Path(folder)) for folder in folders]
    planners = [flight.summary["planner"] for flight in flights]
    names = planners if len(set(planners)) == len(planners) else [place.name for place in places]
    if len(set(names)) < len(names):
        names = list(folders)
    return [
        DrawnFlight(
            name if flight.summary["completed"] else f"{name}: NOT completed",
            flight.world.plan,
            flight.summary,
            flight.columns,
        )
        for name, flight in zip(names, flights, strict=True)
    ]


def _table(path: Path) -> list[list[Any]]:
    """Head and rows of a table of numbers; an empty field is None."""
    rows = read_rows(str(path), read_text(str(path)).body)
    head = next(rows, None)
    if head is None:
        raise InputError.at(str(path), 1, 1, "is empty", "a table of a result folder")
    numbers: list[list[Any]] = []
    for row in rows:
        if len(row.fields) != len(head.fields):
            raise InputError(row.fault(0, f"{len(row.fields)} fields", f"{len(head.fields)}"))
        try:
            values = [float(field) if field else None for field in row.fields]
        except ValueError:
            values = [math.nan]  # found below, with its column
        if not all(value is None or math.isfinite(value) for value in values):
            faults = ((i, number_fault(field)) for i, field in enumerate(row.fields) if field)
            raise InputError(*(row.fault(i, *fault) for i, fault in faults if fault))
        numbers.append(values)
    if not numbers:
        raise InputError.at(str(path), 2, 1, "no rows", "a row for each logged moment")
    return [head.fields, *numbers]


# --- inputs


def _inputs(folder: Path) -> FlightInputs:
    """The flight of the copies of its inputs, which are recognised by their content."""
    paths = _paths(folder)
    if "plan" not in paths:
        raise InputError.at(str(folder), 1, 1, "has no plan", "the copies of a flight's inputs")
    given = folder / OVERRIDES
    overrides = read_overrides(read_text(str(given)).body.splitlines()) if given.exists() else {}
    files = Files()
    if "vehicle" in paths:
        document = files.document(paths.get("scenario"))
        named = vehicle_path(document, overrides)
        if named is not None:
            files.texts[named] = files.text(paths["vehicle"])
    chosen: dict[str, Any] = {kind: paths.get(kind) for kind in ("scenario", "profile", "energy")}
    return load_flight(paths["plan"], **chosen, overrides=overrides, files=files)


def _paths(folder: Path) -> dict[str, str]:
    """The paths of the inputs by kind."""
    paths: dict[str, str] = {}
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.name != OVERRIDES and path.is_file():
            paths[_kind(read_text(str(path)))] = str(path)
    return paths


def _kind(text: Text) -> str:
    """What an input is: of YAML its schema says it; else a plan or a mission, or a profile's measurements."""
    if is_mission(text):
        return "plan"
    try:
        document = read_yaml(text).value
        return str(document["schema"]).removeprefix("eadp.").partition("/")[0]
    except (InputError, TypeError, KeyError):
        pass
    try:
        read_plan(text)
    except InputError:
        return "profile"
    return "plan"

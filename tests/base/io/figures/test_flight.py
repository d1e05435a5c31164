"""The pictures of a flight: its own, and the letter's figures of it."""

import itertools
from contextlib import contextmanager

import numpy as np
import pytest
from common import ROOT
from matplotlib.figure import Figure

import eadp
from eadp.io.figures import plan as flight_figure
from eadp.io.figures.canvas import COLOURS, fit_legend, stage_style
from eadp.io.figures.plan import _draw_decisions, _draw_parameters, _draw_path
from eadp.papers import figures as paper
from eadp.papers.figures import write_paper_figure
from eadp.planning.base import DecisionRecord

PLAN = ROOT / "plans/survey.plan"


@pytest.fixture(scope="module")
def flight():
    """Flight I, its first 200 s."""
    return eadp.simulate(PLAN, ROOT / "scenarios/paper-I-static.yaml", overrides={"time_limit_s": 200})


def drawn(monkeypatch, flight):
    """The panels of the letter's figures by title."""
    figure = Figure()

    @contextmanager
    def canvas(*_):
        yield figure

    monkeypatch.setattr(paper, "figure_pair", canvas)
    write_paper_figure(ROOT, flight.inputs.world, flight.steps, flight.estimates)
    return {axes.get_title(loc="left") or axes.get_title(): axes for axes in figure.axes}


def lines(axes):
    return {line.get_label(): np.array(line.get_data()) for line in axes.lines}


def test_two_parameters_have_axes_in_their_units(flight):
    axes = Figure().add_subplot()
    _draw_parameters(axes, flight.columns["time_s"], flight.steps, flight.inputs.world)
    spacing, fps = axes.figure.axes
    assert (spacing.get_ylabel(), fps.get_ylabel()) == ("spacing [m]", "fps")
    assert set(spacing.lines[0].get_ydata()) == {10.0}, "the least spacing, at the highest c1"
    low, high = spacing.get_ylim()
    assert low < 10 < 25.1 < high
    assert set(fps.lines[0].get_ydata()) == {10.0}


def test_the_letters_panels(monkeypatch, flight):
    panels = drawn(monkeypatch, flight)
    assert list(panels) == [
        "Power and estimate",
        "Detail: the first periods",
        "Period T",
        "Battery and horizon",
        "",
        "State q: the mean of the motion, α0",
        "State q: harmonics",
        "Power spectrum of the motion",
        "Periodogram of the motion",
    ]
    for title, axes in panels.items():
        assert axes.get_ylabel().endswith("]") or "R²" in axes.get_ylabel(), title
    period_s = flight.estimates[-1].period_s
    whole = lines(panels["Power and estimate"])
    assert whole["power Υ"][1] == pytest.approx(flight.columns["power_w"])
    assert whole["estimate y"][1][-1] == pytest.approx(flight.columns["power_w"][-1], abs=0.01)
    assert lines(panels["Battery and horizon"])["limit b Q_c V"][1] == pytest.approx(flight.columns["soc"] * 14.8 * 3.2)
    assert set(lines(panels["State q: harmonics"])) == {"α1", "β1", "α2", "β2", "α3", "β3"}
    frequency, density = lines(panels["Power spectrum of the motion"])["_child0"]
    assert 1 / frequency[np.argmax(density)] == pytest.approx(period_s, rel=0.2)
    period, r2 = lines(panels["Periodogram of the motion"])["_child0"]
    assert period[np.argmax(r2)] == pytest.approx(period_s, rel=0.05)


def test_forecasts_start_at_their_reading_and_do_not_overlap(monkeypatch, flight):
    axes = drawn(monkeypatch, flight)["Detail: the first periods"]
    forecasts = [line for line in axes.lines if line.get_color() == "black" and len(line.get_xdata()) > 1]
    ends = [(line.get_xdata()[0], line.get_xdata()[-1]) for line in forecasts]
    assert len(ends) > 3
    assert all(end <= start + 0.1 for (_, end), (start, _) in itertools.pairwise(ends))
    one = next(one for one in flight.estimates if one.time_s == ends[-1][0])
    assert forecasts[-1].get_ydata()[-1] == pytest.approx(one.forecast_w(np.array([one.horizon_s]))[0])


def test_an_estimator_without_harmonics_has_its_figures(monkeypatch):
    overrides = {"time_limit_s": 20, "estimator.order": 0}
    panels = drawn(monkeypatch, eadp.simulate(PLAN, ROOT / "scenarios/survey.yaml", overrides=overrides))
    assert [text.get_text() for text in panels["State q: harmonics"].texts] == ["no harmonics"]


@pytest.mark.parametrize("overrides", [{}, {"time_limit_s": 0.05}])
def test_a_flight_without_a_period_has_its_figures(tmp_path, monkeypatch, overrides):
    plan = tmp_path / "line.plan"
    plan.write_text("0.1; 90; x\n0, 400\n")
    panels = drawn(monkeypatch, eadp.simulate(plan, overrides=overrides))
    assert [text.get_text() for text in panels["Period T"].texts] == ["no period"]
    assert [text.get_text() for text in panels["Periodogram of the motion"].texts] == ["no spectrum"]


@pytest.mark.parametrize(
    ("headers", "sets", "panels"),
    [
        ("", "", ["Parameters"]),
        ("%: altitude 60\n", "", ["Altitude"]),
        ("%: altitude 60\n", "[0, 1]\n", ["Altitude", "Parameters"]),
    ],
)
def test_altitudes_that_stages_command_are_drawn(tmp_path, monkeypatch, headers, sets, panels):
    figure, plan = Figure(), tmp_path / "a.plan"

    @contextmanager
    def canvas(*_):
        yield figure

    name = "+c1" if sets else ""
    plan.write_text(f"{headers}0.1; 270; y{name}\n300, 0{name.replace('+', '-')}\n{sets}")
    keys = {"time_limit_s": 5, "start.altitude_m": 50, "parameters": {"c1": 0} if sets else {}}
    flight = eadp.simulate(plan, overrides={**keys, "planner.name": "static"})
    monkeypatch.setattr(flight_figure, "figure_pair", canvas)
    flight_figure.write_flight_figure(tmp_path, flight.inputs.world, flight.steps, flight.summary)
    axes = {each.get_title(loc="left") or each.get_title(): each for each in figure.axes}
    assert list(axes)[3:] == panels
    if "Altitude" in axes:
        assert np.array_equal(axes["Altitude"].lines[0].get_ydata(), flight.columns["altitude_m"])


def legend(axes):
    fit_legend(axes, 4)
    return [text.get_text() for text in axes.get_legend().get_texts()]


def test_many_stages_are_named_by_their_kind(tmp_path):
    stages = "".join(f"0.1; 90; y - {40 * i + i**3}\n{100 * i}, {40 * i + i**3}\n" for i in range(12))
    plan = tmp_path / "lines.plan"
    plan.write_text(stages)
    flown = eadp.simulate(plan, overrides={"time_limit_s": 60, "step_s": 0.05})
    axes = Figure().add_subplot()
    _draw_path(axes, flown.inputs.world, flown.steps)
    assert legend(axes) == ["lines", "start", "final point", "end of the flight"]
    assert len({line.get_color() for line in axes.lines if line.get_linewidth() == 1.2}) == 1
    few = eadp.read_plan(PLAN).stages
    assert stage_style(few, 1) == (COLOURS[0], "stage 1 (circle)")


def test_the_path_is_drawn_with_the_wind(flight):
    axes = Figure().add_subplot()
    _draw_path(axes, flight.inputs.world, flight.steps)
    flown = np.stack([flight.columns["x_m"], flight.columns["y_m"]])
    stages = [line.get_data() for line in axes.lines if len(line.get_xdata()) > 1]
    assert np.concatenate([np.stack(one)[:, :-1] for one in stages], axis=1) == pytest.approx(flown[:, :-1])
    (arrow,) = [text for text in axes.texts if not text.get_text()]
    along = np.subtract(arrow.xy, arrow.xyann)
    wind = np.array(flight.inputs.world.wind.steady_mps)
    assert along / np.hypot(*along) == pytest.approx(wind / np.hypot(*wind), abs=1e-6)


def test_a_time_without_a_feasible_solution_is_in_the_legend(flight):
    times = [1 + t / 10 for t in range(39)]
    parameters = [(-float(i), 2.0) for i in range(39)]
    status = ["infeasible" if 10 <= i < 14 else "solved" for i in range(39)]
    records = [
        DecisionRecord(t, "time", 1, 0, values, state, 0, 0, None, "")
        for t, values, state in zip(times, parameters, status, strict=True)
    ]
    path, lower = Figure().subplots(1, 2)
    _draw_decisions(path, lower, flight.steps, records)
    assert legend(lower) == ["nothing was feasible"]
    (marks,) = path.lines
    assert (len(marks.get_xdata()), marks.get_label()) == (39, "decision")

"""The pictures of a flight: its own, and the letter's figures of it; of a plan: its range on every lap."""

from contextlib import contextmanager

import numpy as np
import pytest
from common import ROOT
from common.plans import PARTS, plan_of
from matplotlib.figure import Figure

import eadp
from eadp.io.figures import plan as flight_figure
from eadp.io.figures.plan import _draw_parameter, _draw_path, _draw_range
from eadp.models.plan.trace import nominal_legs
from eadp.papers import figures as paper
from eadp.papers.figures import write_paper_figure

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


def test_a_parameter_is_drawn_in_its_unit(flight):
    spacing, fps = Figure().subplots(2, 1)
    for i, axes in enumerate((spacing, fps)):
        _draw_parameter(axes, flight.columns["time_s"], flight.steps, flight.inputs.mission.plan, i)
    assert (spacing.get_title(), spacing.get_ylabel(), fps.get_title()) == ("spacing", "[m]", "fps")
    assert set(spacing.lines[0].get_ydata()) == {10.0}, "the least spacing, at the highest c1"
    low, high = spacing.get_ylim()
    assert low < 10 < 25.1 < high
    assert set(fps.lines[0].get_ydata()) == {10.0}


def test_the_letters_panels(monkeypatch, flight):
    panels = drawn(monkeypatch, flight)
    assert list(panels) == [
        "Power and estimate", "Detail: the first periods", "Period T", "Battery and horizon", "",
        "State q: the mean of the motion, α0", "State q: harmonics", "Power spectrum of the motion",
        "Periodogram of the motion",
    ]  # fmt: skip
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


@pytest.mark.parametrize("overrides", [{}, {"time_limit_s": 0.05}])
def test_a_flight_without_a_period_has_its_figures(tmp_path, monkeypatch, overrides):
    plan = tmp_path / "line.plan"
    plan.write_text("0.1; 90; x\n0, 400\n")
    panels = drawn(monkeypatch, eadp.simulate(plan, overrides=overrides))
    assert [text.get_text() for text in panels["Period T"].texts] == ["no period"]
    assert [text.get_text() for text in panels["Periodogram of the motion"].texts] == ["no spectrum"]


@pytest.mark.parametrize(
    ("headers", "sets", "panels"),
    [("", "", []), ("%: altitude 60\n", "", ["Altitude"]), ("%: altitude 60\n", "[0, 1]\n", ["Altitude", "c1"])],
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


# --- of a plan

SURVEY = (ROOT / "plans/survey.plan").read_text(encoding="utf-8")


def filled(text, parameters):
    """The filled areas [m²] and the extents [m] of the range."""
    axes = Figure().add_subplot()
    _draw_range(axes, plan_of(text), parameters)
    outlines = [path.vertices[:-1] for collection in axes.collections for path in collection.get_paths()]
    areas = [abs(np.sum(x * np.roll(y, 1) - y * np.roll(x, 1))) / 2 for x, y in (points.T for points in outlines)]
    return np.array(areas), outlines


@pytest.mark.parametrize(("text", "parameters"), [(SURVEY, (0.0, 10.0)), (PARTS, (0.0, 10.0))])
def test_every_lap_has_its_range(text, parameters):
    areas, outlines = filled(text, parameters)
    for leg in nominal_legs(plan_of(text), parameters):
        if leg.lap and leg.stage.kind == "circle":
            far_m = [np.hypot(points[:, 0] - leg.end_m[0], points[:, 1] - leg.end_m[1]).min() for points in outlines]
            assert areas[np.array(far_m) < 1].sum() > 100, f"lap {leg.lap}"

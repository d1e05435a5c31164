"""`eadp replan` on flights of ArduPlane and PX4 that were recorded: take-offs, pilots, a draw that rises, a lost cell.

    python benchmarks/autopilot.py [--folder ../shared/reference] [--write]

The folder has `autopilot/`, flights of ArduPlane and of PX4 in their own simulators, and `logs/`. Each log is replayed;
what is decided now is not flown. The logs of `eadp replan` have no voltage and altitude: where a ground station's track
has them, they are added, and so are modes where a row says so. The power of `level` is scaled from an instant on, for
lasting steps of several sizes.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
import re
import statistics
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from measured import options, recorded, table

from eadp import read_plan
from eadp.api.given import FlightOptions
from eadp.core.geometry.geodesy import to_local_m
from eadp.live.flight import COMPLETED, UNDECIDED
from eadp.live.link import LinkOptions
from eadp.live.replan import ReplanOptions, replan
from eadp.models.airspace import HOME_RADII
from eadp.models.battery import Battery
from eadp.planning.state.voltage import VoltageWatch

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT.parent / "shared/reference"
STEPS, STEP_TIMES_S = (-0.2, 0.2, 0.3, 0.5, 1.0), (240.0, 303.0, 366.0, 429.0, 492.0)
"""Sizes of steps of `level`'s power, and when after its first line [s]."""
RESERVE, AIRSPEED_MPS, TURN_RADIUS_M = 0.2, 15.0, 27.4
"""Of the scenarios: the reserve, and the aeroplane's airspeed and radius at 40° of bank."""
CAPACITY_AH, PX4_AH = 0.95, 5.0
PX4_RETURNS_AH = 1.2
LAP_STAGES = 6
"""Stages up to the end of the first lap."""

Line = dict[str, Any]


class Replay(NamedTuple):
    """A flight: its lines of telemetry, and what is decided on them."""

    lines: list[Line]
    decisions: list[Line]

    @property
    def start_s(self) -> float:
        """Time of the first line [s]."""
        return float(self.lines[0]["time_s"])

    def at(self, time_s: float) -> Line:
        """The last decision up to a time of the log [s]."""
        return [each for each in self.decisions if each["time_s"] <= time_s][-1]

    def mean_w(self, from_s: float, to_s: float) -> float:
        """Mean power measured between two times [s]."""
        rows = [each for each in self.lines if from_s <= each["time_s"] <= to_s and each["power_w"] is not None]
        times, powers = ([row[key] for row in rows] for key in ("time_s", "power_w"))
        return float(np.trapezoid(powers, times)) / (times[-1] - times[0])


def forecast_w(decision: Mapping[str, Any]) -> tuple[float, float]:
    """Mean power to the end that a decision forecasts, and its standard deviation at the time forecast [W]."""
    scale = 3600 / decision["remaining_s"]
    return decision["energy_wh"] * scale, decision["energy_std_wh"] * scale


def read_lines(flight: Path) -> list[Line]:
    """The lines of telemetry of a flight, with voltage and altitude where a track has them."""
    entries = [json.loads(text) for text in (flight / "log.jsonl").read_text().splitlines()]
    lines = [entry for entry in entries if entry["kind"] == "telemetry"]
    if not (flight / "track.csv").exists():
        return lines
    with (flight / "track.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["voltage_v"]]
    times, volts, metres = (
        np.array([float(row[key]) for row in rows]) for key in ("time_s", "voltage_v", "altitude_m")
    )
    for each in lines:
        last = max(int(np.searchsorted(times, each["time_s"], side="right")) - 1, 0)
        each |= {"voltage_v": float(volts[last]), "altitude_m": float(np.interp(each["time_s"], times, metres))}
    return lines


class Inputs(NamedTuple):
    """What a flight was planned with: files in the folder."""

    scenario: str
    plan: str = "survey.plan"
    items: str = ""
    """By default those beside the flight."""
    autopilot: str = ""
    """What the scenario states."""


FIELD = Inputs("px4/plan/scenario.yaml", "px4/plan/field.plan", "px4/plan/field-mission.plan.items.json")
LANDS = Inputs("px4/plan/scenario.yaml", "px4/plan/land.plan", "px4/plan/land-mission.plan.items.json")
CMAC = Inputs("second/right-1.2.yaml", "second/cmac.plan")
CROSS = Inputs("second/right-0.95.yaml", "second/cross.plan", autopilot="ardupilot")
LAND = Inputs("second/right-0.95.yaml", "second/land.plan")


def modes_of(flight: Path) -> list[tuple[float, str]]:
    """The modes of an autopilot's flight, each with the time from which on it holds [s]."""
    text = (flight / "ground-station.txt").read_text()
    found = re.findall(r"^\[ *([\d.]+)[^\]]*\] MODE (\w+) \w+", text, re.MULTILINE)
    return [(float(time_s), mode) for time_s, mode in found]


def with_modes(flight: Path, lines: list[Line]) -> list[Line]:
    """Lines with what the autopilot's mode says of the mission, as the lines of a link have it."""
    modes, found = modes_of(flight), []
    for each in lines:
        mode = [name for at_s, name in modes if at_s <= each["time_s"]][-1]
        found.append(each | {"flies_mission": mode in ("AUTO", "MISSION"), "returns_home": mode == "RTL"})
    return found


def replayed(folder: Path, flight: str, inputs: Inputs | str, lines: list[Line] | None = None) -> Replay:
    """A flight again, with a return home as an option; `lines` in place of its own."""
    own = read_lines(folder / flight) if lines is None else lines
    inputs = Inputs(inputs) if isinstance(inputs, str) else inputs
    items = inputs.items or f"{flight}/mission.waypoints.items.json"
    decisions: list[Line] = []
    with tempfile.TemporaryDirectory() as place:
        log = Path(place) / "log.jsonl"
        start = (folder / flight / "log.jsonl").read_text().splitlines()[0]
        log.write_text("\n".join([start, *(json.dumps({"kind": "telemetry"} | each) for each in own)]) + "\n")
        replan(
            str(folder / inputs.plan),
            ReplanOptions(replay=str(log)),
            FlightOptions(
                scenario=str(folder / inputs.scenario),
                set_=[f"autopilot.kind={inputs.autopilot}"] if inputs.autopilot else [],
            ),
            LinkOptions(items=str(folder / items), return_home=True),
            decided=decisions.append,
            warn=lambda _faults: None,
        )
    return Replay(own, decisions)


def until(lines: list[Line], time_s: float) -> list[Line]:
    """The lines up to a time [s]."""
    return [each for each in lines if each["time_s"] <= time_s]


def event_s(folder: Path, flight: str, name: str) -> float:
    """When a ground station notes an event [s]: its clock is the autopilot's within a second."""
    found = re.search(rf"\[ *([\d.]+)\] EVENT {name}", (folder / flight / "ground-station.txt").read_text())
    assert found is not None
    return float(found[1])


# --- the aims


class Row(NamedTuple):
    """What a flight shows: an aim, what was measured, and whether it is met."""

    flight: str
    what: str
    aim: str
    measured: str
    met: bool


def take_off(folder: Path) -> Iterator[Row]:
    """The power 180 s into a flight whose aircraft file says twice as much, and what a full-throttle take-off does."""
    level = Replay(read_lines(folder / "level"), [])
    at_s = level.start_s + 180
    true_w = level.mean_w(at_s, level.lines[-1]["time_s"] - 60)
    mean_w, std_w = forecast_w(replayed(folder, "level", "hungry.yaml", until(level.lines, at_s)).at(at_s))
    near, aim = abs(mean_w / true_w - 1) <= 0.05, f"within 5 % of {true_w:.1f} W"
    yield Row("level", "forecast of mean power at 180 s", aim, f"{mean_w:.1f} ± {std_w:.1f} W", near)
    name = "full-throttle-take-off"
    lines = read_lines(folder / name)
    lap_s = next(each["time_s"] for each in lines if (each.get("stages_started") or 0) > LAP_STAGES)
    flight = replayed(folder, name, "right-1.2Ah.yaml", until(lines, lap_s))
    lap = [each for each in flight.decisions if each["time_s"] < lap_s]
    first = next(each for each in lap if each["reason"] not in ("take-off", "kept"))
    hopeless = sum("battery short" in each["reason"] for each in lap)
    yield Row(name, "decisions with the reason “battery short” in the first lap", "0", str(hopeless), hopeless == 0)
    after_s = first["time_s"] - flight.start_s
    yield Row(name, "first change", "after the take-off of 17 s", f"{after_s:.0f} s", after_s > 17)
    exported, coarsest = (spacing_m(folder, c1) for c1 in (0.0, min(each["parameters"]["c1"] for each in lap)))
    what = "coarsest spacing decided before the first lap is over"
    yield Row(name, what, f"{exported:.1f} m", f"{coarsest:.1f} m", coarsest <= exported)


def drawn(folder: Path) -> Iterator[Row]:
    """The charge at the end as forecast on the ground, of a flight that began with a take-off at full throttle."""
    name = "second/X"
    lines = read_lines(folder / name)
    flight = replayed(folder, name, CROSS, lines[:5])
    over_s = event_of(folder / name, r"MODE RTL")
    left = [1 - each["current_consumed_ah"] / CAPACITY_AH for each in lines if each["time_s"] <= over_s][-1]
    told = flight.decisions[1]["soc_end_forecast"]  # the first one knows no wind
    what = "charge at the end, as forecast at the start of the take-off"
    yield Row(name, what, f"{left:.3f} ± 0.05", f"{told:.3f}", bool(abs(told - left) <= 0.05))


def spacing_m(folder: Path, c1: float, plan: str = "survey.plan") -> float:
    """The spacing of lines at a parameter, as people read it [m]."""
    return float(read_plan(str(folder / plan), warn=lambda _: None).parameters[0].shown(c1))


def rises(folder: Path) -> Iterator[Row]:
    """A draw that doubles and trebles: when the forecast follows, the lines after it, and the return."""
    for name in ("double-draw", "triple-draw"):
        flight, rise_s = replayed(folder, name, "right-0.95Ah.yaml"), event_s(folder, name, "param BATT_AMP_PERVLT")
        true_w = flight.mean_w(rise_s + 5, rise_s + 120)
        after = [each for each in flight.decisions if each["time_s"] >= rise_s and each["remaining_s"]]
        follows_s = next(each["time_s"] for each in after if abs(forecast_w(each)[0] / true_w - 1) <= 0.05) - rise_s
        yield Row(name, f"forecast within 5 % of {true_w:.1f} W", "60 s", f"{follows_s:.0f} s", follows_s <= 60)
        c1s = flight.at(rise_s)["parameters"]["c1"], max(each["parameters"]["c1"] for each in after)
        before_m, finest_m = (spacing_m(folder, c1) for c1 in c1s)
        what = "finest spacing decided after it"
        yield Row(name, what, f"{before_m:.1f} m or more", f"{finest_m:.1f} m", finest_m >= before_m)
        home = next((each for each in after if each["returns_home"]), None)
        left = -math.inf if home is None else charge_at_home(folder, flight, home)
        what = "charge at home by the draw, from the return commanded on"
        yield Row(name, what, f"{RESERVE} or more", f"{left:.3f}", left >= RESERVE)


def charge_at_home(folder: Path, flight: Replay, home: Line) -> float:
    """Charge that a straight flight home leaves from a decision on, with a turn, at the draw of the minute before."""
    plan = read_plan(str(folder / "survey.plan"), warn=lambda _: None)
    recent = [each for each in flight.lines if home["time_s"] - 60 <= each["time_s"] <= home["time_s"]]
    first, last = recent[0], recent[-1]
    per_s = (last["current_consumed_ah"] - first["current_consumed_ah"]) / (last["time_s"] - first["time_s"])
    assert plan.site.origin_deg is not None
    assert plan.site.home_m is not None
    x, y = to_local_m(last["lat_deg"], last["lon_deg"], plan.site.origin_deg)
    way = plan.site.home_m[0] - x, plan.site.home_m[1] - y
    distance_m, wind = math.hypot(*way), home["wind_mps"]
    along = (wind[0] * way[0] + wind[1] * way[1]) / distance_m
    across = math.hypot(*wind) ** 2 - along**2
    seconds = distance_m / (along + math.sqrt(AIRSPEED_MPS**2 - across))
    seconds += 2 * math.pi * HOME_RADII * TURN_RADIUS_M / AIRSPEED_MPS
    return 1 - (last["current_consumed_ah"] + per_s * seconds) / CAPACITY_AH


PILOTED = {"second/Z": CMAC, "px4/pilot-in-posctl": FIELD, "lost-cell-and-outage": Inputs("right-0.95Ah.yaml")}


def pilots(folder: Path, flights: int = len(PILOTED)) -> Iterator[Row]:
    """What is decided while the mission is not flown, in so many flights, and how well the rest is known after it."""
    for name, inputs in itertools.islice(PILOTED.items(), flights):
        lines = with_modes(folder / name, read_lines(folder / name))
        for what, replayed_lines in (("", lines), (", modes unknown", without_modes(lines))):
            flight = replayed(folder, name, inputs, replayed_lines)
            count = len(decided_by_hand(folder / name, flight))
            yield Row(name, f"decisions while the mission is not flown{what}", "0", str(count), count == 0)
    name = "second/X"
    late_s = event_of(folder / name, r"Passed waypoint #5")
    lines = with_modes(folder / name, until(read_lines(folder / name), late_s + 3))
    flight = replayed(folder, name, CROSS, lines)
    before, after = (flight.at(late_s + delay_s)["energy_std_wh"] for delay_s in (-2, 3))
    what = "deviation of the energy left after a leg flown ten times later than forecast, to that before"
    yield Row(name, what, "1.5 at most", f"{after / before:.2f}", after / before <= 1.5)
    # the mission is over
    name = "second/A"
    flight = replayed(folder, name, CMAC, with_modes(folder / name, read_lines(folder / name)))
    over_s = event_of(folder / name, r"RTL over home")
    late = [each for each in flight.decisions if each["time_s"] > over_s and each["returns_home"]]
    yield Row(name, "decisions to fly home once the mission is over", "0", str(len(late)), not late)


def without_modes(lines: list[Line]) -> list[Line]:
    """The same lines where the autopilot's mode is not known."""
    return [
        {key: value for key, value in each.items() if key not in ("flies_mission", "returns_home")} for each in lines
    ]


def decided_by_hand(flight: Path, replay: Replay) -> list[Line]:
    """New decisions while another mode than the mission's holds, from 5 s after it was chosen on, when it is seen."""
    modes, found = [*modes_of(flight), (math.inf, "")], []
    for (from_s, mode), (to_s, _) in itertools.pairwise(modes):
        if mode not in ("AUTO", "MISSION"):
            for before, each in itertools.pairwise(replay.decisions):
                new = re.sub(r"[-\d.]+", "", each["reason"]) != re.sub(r"[-\d.]+", "", before["reason"])
                if from_s + 5 <= each["time_s"] < to_s and new and each["reason"] not in (*UNDECIDED, COMPLETED):
                    found.append(each)
    return found


def event_of(flight: Path, pattern: str) -> float:
    """When a ground station notes a text first [s]."""
    found = re.search(rf"^\[ *([\d.]+)[^\]]*\].*{pattern}", (flight / "ground-station.txt").read_text(), re.MULTILINE)
    assert found is not None
    return float(found[1])


def starts(folder: Path) -> Iterator[Row]:
    """The lines that the first decision is of: those of the mission that was exported."""
    for name, inputs in {"second/A": CMAC, "second/Z": CMAC, "second/Lu": LAND, "px4/untouched": FIELD}.items():
        items = json.loads((folder / (inputs.items or f"{name}/mission.waypoints.items.json")).read_text())["items"]
        flight = replayed(folder, name, inputs, read_lines(folder / name)[:5])
        aim, first = (
            spacing_m(folder, c1, inputs.plan) for c1 in (items[-1][5], flight.decisions[0]["parameters"]["c1"])
        )
        what = "spacing that the first decision is of"
        yield Row(name, what, f"{aim:.1f} m, as exported", f"{first:.1f} m", abs(first - aim) < 0.05)


def returns(folder: Path) -> Iterator[Row]:
    """The end of the charge where PX4 turns back by itself, as forecast 10 s later."""
    name = "px4/px4-returns-at-50-percent"
    lines = with_modes(folder / name, read_lines(folder / name))
    flight, back_s = replayed(folder, name, LANDS, lines), event_of(folder / name, r"MODE RTL")
    drawn_ah = [each["current_consumed_ah"] for each in lines if each.get("current_consumed_ah") is not None]
    true, told = 1 - drawn_ah[-1] / PX4_RETURNS_AH, flight.at(back_s + 10)["soc_end_forecast"]
    what = "charge at the end of its own return, forecast after 10 s"
    yield Row(name, what, f"{true:.3f} ± 0.03", f"{told:.3f}", bool(abs(told - true) <= 0.03))


def cells(folder: Path) -> Iterator[Row]:
    """A loss that the voltage alone shows, and flights without one."""
    name = "lost-cell-and-outage"
    lost_s = event_s(folder, name, "lose")
    flight = replayed(folder, name, "right-0.95Ah.yaml", until(read_lines(folder / name), lost_s + 40))
    found = next((each["time_s"] for each in flight.decisions if "cell-lost" in each["warnings"]), math.inf)
    late_s = found - lost_s
    yield Row(name, "a loss of 20 % is found after", "30 s", f"{late_s:.0f} s", 0 <= late_s <= 30)
    watch = VoltageWatch(Battery(cells=4, chemistry="lipo", capacity_ah=PX4_AH, resistance_ohm=0.03))
    with (folder.parent / "logs/px4_battery_first900s.csv").open() as stream:
        for row in csv.DictReader(stream):
            volts, amps = float(row["voltage_v"]), float(row["current_a"])
            soc = 1 - float(row["discharged_mah"]) / 1000 / PX4_AH
            watch.ingest(float(row["timestamp"]) / 1e6, volts, volts * amps, soc)
    yield Row("a log of PX4, 900 s", "charge lost by the voltage", "0", f"{watch.lost:g}", watch.lost == 0)
    own_log = replayed_bin(folder, "upload-in-flight", "fitted-0.95Ah.yaml")
    yield without_loss("upload-in-flight", own_log)
    yield without_loss("level", replayed(folder, "level", "hungry.yaml").decisions)


def without_loss(flight: str, decisions: list[Line]) -> Row:
    """A flight that loses no charge."""
    false = sum("cell-lost" in each["warnings"] for each in decisions)
    return Row(flight, "decisions with a loss that is none", "0", str(false), false == 0)


def replayed_bin(folder: Path, flight: str, scenario: str) -> list[Line]:
    """What is decided on an autopilot's own log."""
    decisions: list[Line] = []
    replan(
        str(folder / "survey.plan"),
        ReplanOptions(replay=str(folder / flight / "flight.bin")),
        FlightOptions(scenario=str(folder / scenario)),
        LinkOptions(items=str(folder / flight / "mission.waypoints.items.json")),
        decided=decisions.append,
        warn=lambda _faults: None,
    )
    return decisions


class Step(NamedTuple):
    """Lasting steps of one size: how often the mean is within 2 σ at 30 s, and relative errors at 90 s."""

    share: float
    within: int
    errors: list[float]


def step_of(folder: Path, share: float, times_s: Sequence[float] = STEP_TIMES_S) -> Step:
    """Lasting steps of the power of `level`, at several instants."""
    lines = read_lines(folder / "level")
    within, errors = 0, []
    for at_s in times_s:
        rise_s = lines[0]["time_s"] + at_s
        flight = replayed(folder, "level", "hungry.yaml", list(stepped(lines, rise_s, share)))
        true_w = flight.mean_w(rise_s, rise_s + 90)
        mean_w, std_w = forecast_w(flight.at(rise_s + 30))
        within += abs(mean_w - true_w) <= 2 * std_w
        errors.append(abs(forecast_w(flight.at(rise_s + 90))[0] / true_w - 1))
    return Step(share, within, errors)


def stepped(lines: Sequence[Line], rise_s: float, share: float) -> Iterator[Line]:
    """Lines up to 95 s after a step of power and draw."""
    before_ah = next(each["current_consumed_ah"] for each in lines if each["time_s"] >= rise_s)
    for each in lines:
        if each["time_s"] > rise_s + 95:
            return
        if each["time_s"] < rise_s:
            yield each
        else:
            drawn_ah = before_ah + (1 + share) * (each["current_consumed_ah"] - before_ah)
            yield each | {"power_w": (1 + share) * each["power_w"], "current_consumed_ah": round(drawn_ah, 3)}


def main() -> None:
    parser = options(__doc__, "autopilot")
    parser.add_argument("--folder", type=Path, default=FOLDER)
    asked = parser.parse_args()
    folder = asked.folder / "autopilot"
    if not folder.is_dir():
        sys.exit(f"{folder} is absent: no flights to replay")
    with recorded("autopilot", write=asked.write):
        kinds = (take_off, drawn, starts, pilots, returns, rises, cells)
        table(("flight", "", "aim", "measured", "met"), (row for rows in kinds for row in rows(folder)))
        titles = "lasting step of the power of `level`", "mean within 2 σ at 30 s", "mean error at 90 s", "largest"
        table(titles, (step_row(step_of(folder, share)) for share in STEPS))


def step_row(step: Step) -> list[str]:
    """A row of lasting steps of one size."""
    errors = f"{statistics.fmean(step.errors):.1%}", f"{max(step.errors):.1%}"
    return [f"{step.share:+.0%}", f"{step.within} of {len(step.errors)}", *errors]


if __name__ == "__main__":
    main()

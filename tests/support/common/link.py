"""Flights in a closed loop: the simulated aircraft flies what `eadp replan` decides by disturbed lines of telemetry."""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from eadp.api.inputs import FlightInputs
from eadp.errors import Fault
from eadp.live.replanner import Replanner
from eadp.planning.base import Decision, Observation, SolverReport
from eadp.planning.state.flight_state import FlightState
from eadp.simulation.loop import Outcome, fly

LINES_EVERY_S = 1.0
Line = dict[str, Any]
StageAndLap = tuple[int, int]
Link = Callable[[float, Line], Iterator[Line]]
"""Lines that arrive at a time [s], when one is sent."""


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of the telemetry: its name, when it ends after its start [s], and the link from that start on."""

    name: str
    lasts_s: float
    link: Callable[[float], Link]


def through(change: Callable[[Line], Line | None], lasts_s: float = math.inf) -> Callable[[float], Link]:
    """A link that changes every line, or loses it, from a start on."""

    def link(start_s: float) -> Link:
        def lines(time_s: float, line: Line) -> Iterator[Line]:
            changed = change(line) if start_s <= time_s < start_s + lasts_s else line
            if changed is not None:
                yield changed

        return lines

    return link


def kept(keys: tuple[str, ...], lasts_s: float = math.inf) -> Callable[[float], Link]:
    """A link on which some keys keep their values of the start."""

    def link(start_s: float) -> Link:
        first: Line = {}

        def hold(line: Line) -> Line:
            first.update({} if first else {key: line[key] for key in keys})
            return line | first

        return through(hold, lasts_s)(start_s)

    return link


def twice(_start_s: float) -> Link:
    """A link that repeats every line."""
    return lambda _, line: iter((line, line))


def late(delay_s: float) -> Callable[[float], Link]:
    """A link that delivers every line so much later [s]."""

    def link(_start_s: float) -> Link:
        queue: list[Line] = []

        def lines(time_s: float, line: Line) -> Iterator[Line]:
            queue.append(line)
            while queue[0]["time_s"] <= time_s - delay_s + 1e-6:
                yield queue.pop(0)

        return lines

    return link


def clock(by_s: float) -> Callable[[float], Link]:
    """A link whose clock jumps by a time [s] at the start."""
    return through(lambda line: line | {"time_s": line["time_s"] + by_s})


UNDISTURBED = Disturbance("undisturbed", 0.0, through(lambda line: line))
DISTURBANCES = (
    Disturbance("gap 30 s", 30.0, through(lambda line: None, 30.0)),
    Disturbance("gap 120 s", 120.0, through(lambda line: None, 120.0)),
    Disturbance("frozen position 20 s", 20.0, kept(("x_m", "y_m"), 20.0)),
    Disturbance("NaN power 60 s", 60.0, through(lambda line: line | {"power_w": math.nan}, 60.0)),
    Disturbance("null charge 60 s", 60.0, through(lambda line: line | {"soc": None}, 60.0)),
    Disturbance("clock + 7,200 s", 0.0, clock(7200.0)),
    Disturbance("clock back 50 s", 0.0, clock(-50.0)),
    Disturbance("duplicate lines", 0.0, twice),
    Disturbance("gauge stuck from the start on", 0.0, kept(("soc",))),
    Disturbance("delay 5 s", 0.0, late(5.0)),
)


@dataclass
class Autopilot:
    """The planner on the other end of a link, as the simulated aircraft meets it."""

    inputs: FlightInputs
    link: Link
    report: SolverReport = field(default_factory=SolverReport)
    warnings: list[Fault] = field(default_factory=list)
    stages: list[tuple[float, StageAndLap, StageAndLap]] = field(default_factory=list)
    """Time of each line that was answered [s], the true stage and lap then, and those of the answer."""
    answers: list[Line] = field(default_factory=list)
    next_update_s = LINES_EVERY_S

    def __post_init__(self) -> None:
        self._replanner = Replanner(self.inputs, "telemetry", None, self.answers.append, self.warnings.append)
        self._decision = Decision(self.inputs.mission.parameters)
        self._numbers = 0

    def update(self, state: FlightState) -> Decision:
        """Send a line if one is due, and take the last answer to the lines that arrive."""
        o = state.now
        if o.time_s < self.next_update_s - 1e-6:
            return self._decision
        self.next_update_s = o.time_s + LINES_EVERY_S
        for line in self.link(o.time_s, self._line(o)):
            self._numbers += 1
            about = line.pop("_sent")
            count = len(self.answers)
            self._replanner.take(self._replanner.reader.read(self._numbers, json.dumps(line).encode()))
            line["_sent"] = about
            if len(self.answers) == count:
                continue
            answer = self.answers[-1]
            self.stages.append((*about, (answer["stage"], answer["lap"])))
            parameters = tuple(answer["parameters"].values())
            if parameters != self._decision.parameters:
                self._decision = Decision(parameters)
        return self._decision

    def _line(self, o: Observation) -> Line:
        line: Line = {
            "time_s": round(o.time_s, 3),
            "x_m": round(o.position_m[0], 2),
            "y_m": round(o.position_m[1], 2),
            "power_w": round(o.sample.power_w or 0.0, 2),
            "soc": round(o.soc, 5),
            "velocity_mps": [round(value, 2) for value in o.sample.velocity_mps or ()],
            "heading_deg": round(90 - math.degrees(o.sample.heading_rad or 0.0), 1) % 360,
            "parameters": dict(zip(self.inputs.mission.plan.names, o.parameters, strict=True)),
        }
        return line | {"_sent": (o.time_s, (o.stage, o.cursor.lap))}


@dataclass(frozen=True)
class Flown:
    """A flight through a link: its outcome, U, and how long after the disturbance stage or lap were wrong [s]."""

    outcome: Outcome
    quality: float
    wrong_s: float
    answers: list[Line]
    warnings: list[str]


def flown(inputs: FlightInputs, disturbance: Disturbance, start_s: float = 0.0) -> Flown:
    """Fly with a disturbance from a start on [s]."""
    flight, outcome = inputs.flight(), Outcome()
    flight.planner = autopilot = Autopilot(inputs, disturbance.link(start_s))
    for _ in fly(inputs.world, flight, outcome):
        pass
    assert outcome.parameters is not None
    quality = outcome.parameters.quality(inputs.scenario.planner.weights) or 0.0
    # a stage that has started since the last line is the true one a line later
    end_s, changes_s = start_s + disturbance.lasts_s, outcome.stage_times_s
    wrong = [
        time_s
        for time_s, true, found in autopilot.stages
        if time_s > end_s and found != true and not any(abs(time_s - t) <= 1.5 * LINES_EVERY_S for t in changes_s)
    ]
    wrong_s = max(wrong) - end_s + LINES_EVERY_S if wrong else 0.0
    return Flown(outcome, quality, wrong_s, autopilot.answers, [str(fault) for fault in autopilot.warnings])

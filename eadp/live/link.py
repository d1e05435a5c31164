"""A flight over a link: messages in, through lines of telemetry to decisions, which are sent back."""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, BinaryIO

from eadp.api.inputs import FlightInputs
from eadp.core.geometry.geodesy import to_near_local_m
from eadp.errors import Fault, InputError
from eadp.exchange.autopilot import read_parameters, speed_limits, stated_parameters, wanted_parameters
from eadp.exchange.items import MissionItem
from eadp.exchange.writer import MappedItem, items_text, parse_items, read_items, same_items
from eadp.io.text.options import Flag
from eadp.live.autopilot import ACCEPTED, CRITICAL, CommandedAirspeed, HeardAutopilot, Pilot
from eadp.live.mavlink import COMPONENT, Link, Message, require_pymavlink, tlog_messages
from eadp.live.messages import WANTED, LineMaker, ParameterCheck, values_of
from eadp.live.mission import PROTOCOL, HeldMission, Holds, Mapped, Noted, Outgoing, Output, Warned
from eadp.live.recorded import TLOG, form_of, log_values
from eadp.live.replanner import DECIDES_AIRSPEED, START, TELEMETRY, Emit, ReplanLog, Replanner, Warn
from eadp.live.telemetry import numbered_lines, open_telemetry
from eadp.models.performance import calibrated_over_true
from eadp.models.plan.plan import Plan
from eadp.models.plan.stage import RETURN

NEAR_M, NEAR_SIZES = 5000.0, 3.0
"""How far from its plan a flight that is replayed may be: a distance [m], or as many times the plan's extent."""
WAIT_S = 0.2
"""How long to wait for messages [s]."""
OTHER_MISSION = "another mission than that of --items is flown: the stage is found by the position"

Send = Callable[[int, str, Mapping[str, Any]], None]


@dataclass(frozen=True)
class LinkOptions:
    """What a link may do."""

    items: Annotated[str | None, Flag(metavar="FILE")] = None
    """Stages of the mission's items, as eadp export writes them."""

    system: Annotated[int | None, Flag(metavar="N", low=1, high=255)] = None
    """The autopilot's MAVLink system; by default the first one heard."""

    upload: bool = False
    """Replace the rest of the autopilot's mission where another path is decided."""

    return_home: bool = False
    """Command the autopilot to return where only home can be reached."""

    command_airspeed: bool = False
    """Decide the airspeed within the aircraft's range, and command it while the mission is flown."""

    def check(self, inputs: FlightInputs) -> None:
        """Refuse what the inputs of a flight do not allow; raises InputError."""
        if inputs.mission.plan.site.origin_deg is None:
            message = "the plan has no place on the earth, and an autopilot's positions have"
            raise InputError.at(inputs.sources["plan"].name, 1, 1, message, "%: origin")
        if self.command_airspeed and inputs.mission.vehicle.airspeed_range_mps is None:
            message, keys = "the planner decides no airspeed", "planner.joint.airspeed: when-short"
            if inputs.scenario.keys.vehicle.airframe.airspeed_range_mps is None:
                message = "the aircraft states no airspeeds to choose from"
                keys = "vehicle.airframe.airspeed_range_mps: [LOW, HIGH]"
            raise InputError.at("--command-airspeed", 1, 1, message, keys)
        if self.upload and self.items is None:
            raise InputError.at("--upload", 1, 1, "the mission is unknown", "--items, as eadp export writes them")


@dataclass
class _WayHome:
    """Where a flight home stands: whether it may be commanded yet, is decided, and is accepted by the autopilot."""

    may_command: bool
    decided: bool = False
    accepted: bool = False


class LinkFlight:
    """The planner on an autopilot's messages.

    Parameters
    ----------
    inputs : FlightInputs
    name : str
        Name of the link in messages.
    options : LinkOptions
    log, emit, warn
        As those of `replan`.
    send : function, optional
        Takes the system, the name and the fields of a message to send.

    Raises
    ------
    InputError
        If the plan has no place on the earth, or the map is not one of its mission.
    """

    def __init__(
        self,
        inputs: FlightInputs,
        name: str,
        options: LinkOptions,
        log: ReplanLog | None,
        emit: Emit,
        warn: Warn,
        send: Send | None = None,
    ) -> None:
        options.check(inputs)
        plan = inputs.mission.plan
        self._inputs, self._emit, self._send, self._log = inputs, emit, send, log
        # the map of the mission's items, as exported; None without --items
        exported = self._exported = None if options.items is None else read_items(options.items, self._path_names)
        inputs = with_mission(inputs, exported)
        inputs = self._inputs = inputs if options.command_airspeed else inputs.at_one_airspeed()
        # path parameters that the mission shall have; None before the first plan, and once only home can be reached
        self._decided_path: tuple[float, ...] | None = None
        self._home = _WayHome(may_command=options.return_home)
        self._pilot = Pilot(name, plan, inputs.mission.parameters, warn, self._give, lambda: self._lines.count)
        self._autopilot = HeardAutopilot(options.system, self._give, self._pilot)
        self._replanner = Replanner(inputs, name, log, self._decided, self._pilot.once)
        self._lines = LineMaker(self._replanner.reader, inputs.mission, exported, self._pilot.say)
        self._replanner.restore()
        # after a restart the log has the map of the mission that was uploaded last
        if exported is not None and log is not None and log.items is not None:
            self._lines.items = parse_items(log.items, self._path_names)
        calibrated = calibrated_over_true(plan.site, inputs.mission.vehicle)
        self._airspeed = CommandedAirspeed(inputs.mission.cruise_mps, calibrated, self._autopilot, self._pilot)
        self._mission: HeldMission | None = None
        if exported is not None and send is not None:
            self._mission = HeldMission(plan, inputs.mission.cruise_mps, exported, self._lines.items, calibrated)
        self._uploads = options.upload
        self._check: ParameterCheck | None = None  # from the first heartbeat on

    @property
    def _path_names(self) -> tuple[str, ...]:
        """Names of the path parameters."""
        plan = self._inputs.mission.plan
        return plan.names[: plan.path_count]

    @property
    def over(self) -> bool:
        """Whether the aircraft has flown, is disarmed, and does not move."""
        return self._lines.landed

    @property
    def completes(self) -> bool:
        """Whether the plan is complete, or forecast to be before the battery is empty."""
        return self._replanner.completes

    @property
    def used(self) -> bool:
        """Whether any line could be used."""
        return self._replanner.used

    def take(self, message: Message, now_s: float = 0.0) -> None:
        """Take a message that has come at a time of any clock [s].

        In this order: note what it says of the autopilot and its mission, re-plan with the lines that it makes, and
        replace the mission where another path is decided.
        """
        autopilot, pilot, mission = self._autopilot, self._pilot, self._mission
        first, lost = not autopilot.component, autopilot.lost
        if not autopilot.hear(message, now_s):
            return
        if message.kind in PROTOCOL:
            self._take_transfer(message, now_s)
            return
        try:
            values = values_of(message.kind, message.fields)
        except (ArithmeticError, LookupError, TypeError, ValueError):
            pilot.say(f"{message.kind} that makes no sense; ignored")
            return
        begins = False
        if message.kind == "HEARTBEAT":
            begins = first or lost or (values["armed"] and not autopilot.armed)
            self._take_heartbeat(values, first=first)
        if message.kind == "MISSION_CURRENT":
            autopilot.judge(values["valid"], now_s)
            if mission is not None:
                self._do(mission.count(values["item_count"], now_s))
        self._note(values, now_s)
        if mission is not None and self._uploads:
            self._lines.decided = self._decided_path if mission.gets(self._decided_path) else None
        restarts = self._lines.heard.restarts
        self.update(values)
        self._airspeed.pass_items(self._lines.items, self._lines.index)
        if begins or self._lines.heard.restarts > restarts:
            self._ask(now_s)
        uploads = self._uploads and self._lines.flies_mission is not False
        if mission is not None and uploads and self._decided_path is not None:
            self._do(mission.decide(now_s, self._decided_path, self._replanner.rest))

    def _ask(self, now_s: float) -> None:
        """Ask an autopilot that is heard, or armed, anew for its messages and its mission."""
        self._autopilot.ask()
        if self._mission is not None:
            self._do(self._mission.read(now_s))

    def _note(self, values: Mapping[str, Any], now_s: float) -> None:
        """Note what the autopilot says in words, of a parameter, and in answer to a command."""
        if values.get("said") is not None:
            self._autopilot.read_text(values["said"], now_s)
        if self._check is not None and values.get("parameter") is not None:
            name, *number = values["parameter"]
            if (value := self._check.take(name, *number)) is not None:
                self._lines.autopilot[name] = value
        if values.get("answer") is not None:
            command, result = values["answer"]
            if (command, result) == (RETURN, ACCEPTED) and self._autopilot.was_commanded:
                self._home.may_command, self._home.accepted = False, True
                self._pilot.note("the autopilot returns")
            if limit := self._airspeed.take(command, result):
                self._lines.autopilot |= limit

    def _take_transfer(self, message: Message, now_s: float) -> None:
        """Take a message of the mission protocol if it is for this computer, and of a mission (`mission_type` 0)."""
        fields, here = message.fields, (self._autopilot.system, COMPONENT, 0)
        to = fields["target_system"], fields["target_component"], fields.get("mission_type", 0)
        if self._mission is not None and to == here:
            self._do(self._mission.take(message.kind, fields, now_s))

    def _take_heartbeat(self, values: Mapping[str, Any], *, first: bool) -> None:
        """Note what a heartbeat says of the autopilot; by the first one choose the parameters to compare."""
        autopilot = self._autopilot
        autopilot.armed, autopilot.ardupilot = values["armed"], values["home_is_item"]
        if first and self._send is not None:
            known, vehicle = self._inputs.mission, self._inputs.mission.vehicle
            home_m = known.way_home and known.way_home.altitude_m
            wanted = wanted_parameters(
                known.plan, vehicle, known.battery, ardupilot=autopilot.ardupilot, home_altitude_m=home_m
            )
            wanted += stated_parameters(known.autopilot, wanted, ardupilot=autopilot.ardupilot)
            wanted += speed_limits(known.plan, vehicle, ardupilot=autopilot.ardupilot)
            read = read_parameters(wanted, ardupilot=autopilot.ardupilot)
            self._check = ParameterCheck(read, as_bytes=not autopilot.ardupilot)
        if self._mission is not None:
            self._mission.ardupilot = autopilot.ardupilot

    def update(self, values: Mapping[str, Any]) -> None:
        """Take what a message, or a row of a log, says, and re-plan with the lines that are due.

        Without a link to read the mission by, another number of items than the map's is another mission: stages are
        found by the position then, with a warning.
        """
        if self._mission is None and self._exported is not None and (count := values.get("item_count")) is not None:
            if count != len(self._exported):
                self._leave_map()
            elif not self._lines.flown:  # in flight as many items may be those of another mission
                self._lines.items = self._exported
        for reading in self._lines.update(values):
            self._replanner.take(reading)

    def hold(self, items: Sequence[MissionItem]) -> None:
        """Take the items of the mission that the autopilot holds, home aside, where something else reads them."""
        if self._exported is None:
            return
        if same_items([each.item for each in self._exported], items):
            self._lines.items = self._exported
        else:
            self._leave_map()

    def _leave_map(self) -> None:
        """Find stages by the position from here on, as another mission than that of the map is held; say so."""
        self._lines.items = None
        self._pilot.say(OTHER_MISSION)

    def tick(self, now_s: float) -> None:
        """Do what is due by the time alone: a heartbeat, what is asked or commanded again with it, and the mission's.

        Notes where the autopilot's heartbeats are lost.
        """
        autopilot = self._autopilot
        if autopilot.beat(now_s):
            autopilot.ask_again()
            self._check_parameters()
            home = self._home
            if home.decided and home.may_command and not autopilot.lost and self._lines.flies_by_itself:
                home.may_command = not autopilot.command_return()
            if limit := self._airspeed.command(flies=None if autopilot.lost else self._lines.flies_by_itself):
                self._lines.autopilot |= limit
        if self._mission is not None:
            self._do(self._mission.tick(now_s, self._lines.item))

    # --- the autopilot

    def _check_parameters(self) -> None:
        """Ask for the autopilot's parameters, and warn once of those that the forecast does not hold for."""
        if self._check is None or self._autopilot.lost:
            return
        for name in self._check.names():
            self._autopilot.give("PARAM_REQUEST_READ", {"param_id": name.encode(), "param_index": -1})
        if differences := self._check.result():
            self._pilot.tell(f"the forecast does not hold: {differences}")

    def _do(self, outputs: Iterable[Output]) -> None:
        """Do what an event of the mission asks for."""
        for output in outputs:
            match output:
                case Outgoing(kind, fields):
                    self._autopilot.give(kind, fields)
                case Warned(text):
                    self._pilot.tell(text)
                case Noted(text):
                    self._pilot.note(text)
                case Holds(items):
                    holds = f"the autopilot holds the mission of --items: {items} items"
                    if refusal := self._autopilot.refusal:
                        self._pilot.tell(f"{holds}, and refuses it: {refusal}")
                    else:
                        self._pilot.note(holds)
                case Mapped(mapped):
                    self._map(mapped)

    def _map(self, items: list[MappedItem] | None) -> None:
        """Find stages by another map from now on, or, where it is None, by the position; log a new map."""
        if items is not None and items != self._lines.items and self._log is not None:
            self._log.mission(items_text(items, self._path_names))
        self._lines.items = items

    # --- what goes out

    def _decided(self, line: dict[str, Any]) -> None:
        """Take a line of decisions: emit it, note the path that the mission shall have, show it to the pilot."""
        self._emit(line)
        self._airspeed.decided_mps = line["airspeed_mps"]
        # before the first plan the parameters are those of take-off
        if self._replanner.planned and not self._home.decided:
            self._decided_path = tuple([line["parameters"][name] for name in self._path_names])
        if line["returns_home"] and not (self._home.decided or self._lines.returns):
            self._home.decided, self._decided_path = True, None
            self._pilot.show("only home can be reached: fly home", CRITICAL)
        flown = self._lines.flies_mission is not False
        returns = self._home.accepted or self._lines.returns
        self._pilot.decision(line, completes=self._replanner.completes, flown=flown, returns=returns)

    def _give(self, kind: str, values: Mapping[str, Any]) -> None:
        """Send a message, where there is a link to send on: a flight that is replayed has none."""
        if self._send is not None:
            self._send(self._autopilot.system or 1, kind, values)


def with_mission(inputs: FlightInputs, items: Sequence[MappedItem] | None) -> FlightInputs:
    """Inputs of a flight that begins with the path parameters that its mission has to its end.

    The items of the first stage may have others: a parameter takes effect with the next stage.
    """
    if not items:
        return inputs
    mission, path = inputs.mission, items[-1].parameters
    return inputs.with_mission(parameters=(*path, *mission.parameters[len(path) :]))


def fly(
    address: str, inputs: FlightInputs, options: LinkOptions, log: ReplanLog | None, emit: Emit, warn: Warn
) -> bool:
    """Re-plan a flight over a link until the aircraft is disarmed; see `LinkFlight`.

    Returns
    -------
    bool
        Whether the plan is complete, or forecast to be.

    Raises
    ------
    InputError
        If the address cannot be opened.
    """
    require_pymavlink("--mavlink", address)
    opened: list[Link] = []  # the link, once it is open: a fault of the flight's files is found before

    def send(*message: Any) -> None:
        """Send a message on the link; nothing before it is open."""
        for link in opened:
            link.send(*message)

    flight = LinkFlight(inputs, address, options, log, emit, warn, send)
    link = Link(address, WANTED)
    opened.append(link)
    try:
        while not flight.over:
            for message in link.receive(WAIT_S):
                flight.take(message, time.monotonic())
            flight.tick(time.monotonic())
    finally:
        link.close()
    return flight.completes


def replay_flight(
    path: str, inputs: FlightInputs, options: LinkOptions, log: ReplanLog | None, emit: Emit, warn: Warn, hashed: str
) -> bool:
    """Re-plan a recorded flight: a log of `eadp replan`, a telemetry log, or an autopilot's own log. Returns as `fly`.

    `hashed` is the hash of the inputs, which a log of other inputs does not have.

    Raises
    ------
    InputError
        If the file cannot be read, or has no flight.
    """
    flight: Replanner | LinkFlight
    with open_telemetry(path) as stream:
        head = stream.readline(10_000)
        start = _entry(head)
        if start.get("kind") == START:
            if start.get("inputs") != hashed:
                what = "is of another plan, scenario or settings: decisions may be others"
                warn(Fault(path, 1, 1, what, severity="warning"))
            flight = Replanner(_as_logged(inputs, options, start), path, log, emit, warn)
            flight.restore()
            for number, raw in numbered_lines(stream, path):
                line = _entry(raw)
                if line.pop("kind", None) == TELEMETRY:
                    flight.take(flight.reader.reading(number + 1, line))
        else:
            flight = LinkFlight(inputs, path, options, log, emit, warn)
            _replay_messages(flight, path, inputs.mission.plan, head, stream)
    if not flight.used:
        what = "a log of eadp replan, or a log (.tlog, .bin, .ulg) of a flight of the plan"
        raise InputError.at(path, 1, 1, "has no flight that can be used", what)
    return flight.completes


def _as_logged(inputs: FlightInputs, options: LinkOptions, start: Mapping[str, Any]) -> FlightInputs:
    """Inputs with the mission of `--items`, and at one airspeed where the first line of a log says so."""
    names = inputs.mission.plan.names[: inputs.mission.plan.path_count]
    inputs = with_mission(inputs, None if options.items is None else read_items(options.items, names))
    return inputs.at_one_airspeed() if start.get(DECIDES_AIRSPEED) is False else inputs


def _replay_messages(flight: LinkFlight, path: str, plan: Plan, head: bytes, stream: BinaryIO) -> None:
    """Pass what a telemetry log, or an autopilot's own log, says to a flight, until that is over.

    `head` is the first line of the file, and `stream` the rest of it.
    """
    form = form_of(head)
    if form in (None, TLOG):
        require_pymavlink("--replay", path)
        messages = list(tlog_messages(head + stream.read(), WANTED))
        places = [values_of(each.kind, each.fields) for each in messages if each.kind == "GLOBAL_POSITION_INT"]
        _check_place(path, plan, places)
        for message in itertools.takewhile(lambda _: not flight.over, messages):
            flight.take(message)
    else:
        rows = list(log_values(path, str(form)))
        _check_place(path, plan, rows)
        for values in itertools.takewhile(lambda _: not flight.over, rows):
            flight.update(values)


def _check_place(path: str, plan: Plan, rows: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a flight with positions of which none is near the plan's ends of stages."""
    positions = [(row["lat_deg"], row["lon_deg"]) for row in rows if row.get("lat_deg") is not None]
    if plan.site.origin_deg is None or not positions:
        return
    # where the stages end, in the first lap and with the path parameters at their highest
    ends = [stage.trigger_at([plan.hull(i).hi for i in range(plan.path_count)]) for stage in plan.stages]
    reach_m = max(NEAR_M, NEAR_SIZES * max(math.dist(end, ends[0]) for end in ends))
    points = [to_near_local_m(*position, plan.site.origin_deg) for position in positions]
    if all(point is None or min(math.dist(point, end) for end in ends) > reach_m for point in points):
        message = f"is a flight elsewhere, as at {positions[0][0]:.4f}, {positions[0][1]:.4f}"
        raise InputError.at(path, 1, 1, message, f"a log of a flight within {reach_m / 1000:.3g} km of the plan")


def _entry(raw: bytes) -> dict[str, Any]:
    """A line of a log of `eadp replan`; empty where it is no JSON object."""
    try:
        line = json.loads(raw)
    except (ValueError, RecursionError):
        return {}
    return line if isinstance(line, dict) else {}

"""A flight over a link: messages in, through lines of telemetry to decisions, which are sent back."""

from __future__ import annotations

import itertools
import json
import math
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from eadp.api.inputs import FlightInputs
from eadp.api.replan.replanner import Emit, Replanner, Warn
from eadp.core.geometry.geodesy import to_near_local_m
from eadp.errors import Fault, InputError
from eadp.io.link.lines import LINE_S, LineMaker
from eadp.io.link.mavlink import COMPONENT, SHARE, Link, Message, Throttle, read_key, require_pymavlink, tlog_messages
from eadp.io.link.messages import TIMED, WANTED, is_autopilot, values_of
from eadp.io.link.mission import PROTOCOL, Outgoing
from eadp.io.link.parameters import ParameterCheck
from eadp.io.link.recorded import MISSION, TLOG, form_of, log_values
from eadp.io.link.upload import HeldMission, Mapped, Noted, Output, Warned
from eadp.io.mission.autopilot import wanted_parameters
from eadp.io.mission.draft import MissionItem
from eadp.io.mission.items import MappedItem, items_text, parse_items, read_items, same_items
from eadp.io.telemetry.log import START, TELEMETRY, ReplanLog
from eadp.io.telemetry.reader import numbered_lines, open_telemetry
from eadp.io.text.options import Flag
from eadp.models.plan.plan import Plan
from eadp.planning.state.flight_state import CELL_LOST
from eadp.planning.track.live import KEPT, TAKE_OFF

NEAR_M, NEAR_SIZES = 5000.0, 3.0
"""How far from its plan a flight may be that is replayed [m], or in sizes of the plan."""
WAIT_S, HEARTBEAT_S, LOST_S = 0.2, 1.0, 5.0
"""How long to wait for messages, how often to send a heartbeat, and when the autopilot's are lost [s]."""

ONBOARD, INVALID = 18, 8
NOTICE, WARNING, CRITICAL = 5, 4, 2
RETURN, ACCEPTED, MAX_COMMANDS = 20, 0, 10
"""The command to return to launch, the answer that it is accepted, and how often a command is given at most."""
TEXT_CHARACTERS, NAME_CHARACTERS, MAX_TEXT = 50, 10, 200
"""Characters of a piece of a text, of a name, and of a text at most."""
SET_INTERVAL = 511
"""The command that asks for a message at an interval."""
INTERVALS = {
    "GLOBAL_POSITION_INT": (33, 200_000),
    "VFR_HUD": (74, 500_000),
    "BATTERY_STATUS": (147, 500_000),
    "WIND": (168, 1_000_000),
    "WIND_COV": (231, 1_000_000),
    "EXTENDED_SYS_STATE": (245, 1_000_000),
    "SYSTEM_TIME": (2, 1_000_000),
    "MISSION_CURRENT": (42, 1_000_000),
}
"""The messages that are asked for: their numbers and intervals [µs]."""

OTHER_MISSION = "another mission than that of --items is flown: the stage is found by the position"

_NUMBERS = re.compile(r"[-+.\d]+")

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

    signing_key: Annotated[str | None, Flag(metavar="FILE")] = None
    """Passphrase of MAVLink's signatures: others' messages are ignored, ours signed."""


class _Requests:
    """Asks for the messages that are read, at the rates that are needed; again for those of which none has come."""

    def __init__(self, ask: Callable[[int, int], None]) -> None:
        self._ask, self._count = ask, 0
        self.missing: set[str] = set()

    def start(self, ardupilot: bool) -> None:
        # ArduPilot has a message of its own for the wind, and shows each request of the other one to the pilot
        self.missing, self._count = set(INTERVALS) - {"WIND_COV" if ardupilot else "WIND"}, 0
        self.repeat()

    def repeat(self) -> None:
        self._count += 1
        for kind in sorted(self.missing) if self._count <= MAX_COMMANDS else ():
            self._ask(*INTERVALS[kind])


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
        plan = inputs.mission.plan
        if plan.site.origin_deg is None:
            text = inputs.sources["plan"].name
            raise InputError.at(
                text, 1, 1, "the plan has no place on the earth, and an autopilot's positions have", "%: origin"
            )
        path_names = plan.names[: plan.path_count]
        mapped = None if options.items is None else read_items(options.items, path_names)
        if options.upload and mapped is None:
            raise InputError.at("--upload", 1, 1, "the mission is unknown", "--items, as eadp export writes them")
        self._name, self._warn, self._emit, self._send, self._log = name, warn, emit, send, log
        self._warned: set[str] = set()
        self._plan = plan
        self._decided_path: tuple[float, ...] | None = None
        self._system, self._component = options.system, 0
        self._heard_s: float | None = None
        self._sent_s = -1e9
        self._lost = False
        self._may_return, self._returns, self._commands = options.return_home, False, 0
        self._requests = _Requests(lambda *numbers: self._command(SET_INTERVAL, numbers))
        self._text, self._armed, self._ardupilot = "", False, False
        self._said_path, self._texts = inputs.mission.parameters[: plan.path_count], 0
        self._replanner = Replanner(inputs, name, log, self._decided, self._warn_once)
        self._replanner.restore()
        exported = self._exported = mapped
        if mapped is not None and log is not None and log.items is not None:
            mapped = parse_items(log.items, path_names)
        self._lines = LineMaker(self._replanner.reader, inputs.mission, mapped, self._say)
        self._mission: HeldMission | None = None
        if mapped is not None and send is not None:
            self._mission = HeldMission(plan, inputs.mission.cruise_mps, exported or mapped, mapped)
        self._uploads = options.upload
        self._aircraft = plan, inputs.world.vehicle, inputs.mission.battery
        self._check: ParameterCheck | None = None

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
        """Take a message that has come at a time of any clock [s]."""
        first, lost = not self._component, self._lost
        if not self._hear(message, now_s):
            return
        self._requests.missing.discard(message.kind)
        if message.kind in PROTOCOL:
            to = (
                message.fields["target_system"],
                message.fields["target_component"],
                message.fields.get("mission_type", 0),
            )
            if self._mission is not None and to == (self._system, COMPONENT, 0):
                self._do(self._mission.take(message.kind, message.fields, now_s))
            return
        try:
            values = values_of(message.kind, message.fields)
        except (ArithmeticError, LookupError, TypeError, ValueError):
            self._say(f"{message.kind} that makes no sense; ignored")
            return
        mission, begins = self._mission, False
        if message.kind == "HEARTBEAT":
            begins = first or lost or (values["armed"] and not self._armed)
            if first and self._send is not None:
                aircraft = self._aircraft
                self._check = ParameterCheck(wanted_parameters(*aircraft, ardupilot=values["home_is_item"]))
            self._armed, self._ardupilot = values["armed"], values["home_is_item"]
            if mission is not None:
                mission.ardupilot = self._ardupilot
        if message.kind == "MISSION_CURRENT":
            if mission is not None:
                self._do(mission.count(values["item_count"], now_s))
            elif self._lines.items is not None and values["item_count"] not in (None, len(self._lines.items)):
                self._say(OTHER_MISSION)
                self._lines.items = None
        if self._check is not None and values.get("parameter") is not None:
            self._check.take(*values["parameter"])
        if values.get("answer") == (RETURN, ACCEPTED) and self._commands:
            self._may_return = False
            self._note("the autopilot returns")
        if mission is not None and self._uploads:
            self._lines.decided = self._decided_path if mission.gets(self._decided_path) else None
        restarts = self._lines.restarts
        self.update(values)
        if begins or self._lines.restarts > restarts:
            self._requests.start(self._ardupilot)
            if mission is not None:
                self._do(mission.read(now_s))
        if mission is not None and self._uploads and self._decided_path is not None:
            self._do(mission.decide(now_s, self._decided_path, self._replanner.rest))

    def lost(self, damaged: int, refused: int, left_out: int) -> None:
        """Say that so many frames were no messages, so many not signed, and so many positions too many."""
        if damaged:
            self._say("damaged frames are ignored")
        if refused:
            self._say("messages without the signature of --signing-key are ignored")
        if left_out:
            self._say(f"positions come faster than {SHARE:.0%} of a core can take: some are left out")

    def update(self, values: Mapping[str, Any]) -> None:
        """Take what a message says, and re-plan with the lines that are due."""
        if MISSION in values:
            self._is_held(values[MISSION])
            return
        for reading in self._lines.update(values):
            self._replanner.take(reading)

    def tick(self, now_s: float) -> None:
        """Send a heartbeat if one is due, and say where the autopilot's are lost."""
        if self._heard_s is not None and not self._lost and now_s - self._heard_s > LOST_S:
            self._lost = True
            self._note("the autopilot's heartbeats are lost")
        if now_s - self._sent_s >= HEARTBEAT_S:
            self._sent_s = now_s
            beat = {"type": ONBOARD, "autopilot": INVALID, "base_mode": 0, "custom_mode": 0, "system_status": 4}
            self._give("HEARTBEAT", beat | {"mavlink_version": 3})
            self._requests.repeat()
            self._check_parameters()
            if self._returns and self._may_return and not self._lost and self._lines.flies_by_itself:
                self._return()
        if self._mission is not None:
            self._do(self._mission.tick(now_s, self._lines.item))

    # --- the autopilot

    def _hear(self, message: Message, now_s: float) -> bool:
        """Note who sends, and whether the autopilot's heartbeats are back; return whether the message is to be taken.

        It is of the autopilot, the first one heard, or of another computer of its aircraft that reports what it runs.
        """
        beats = is_autopilot(message.kind, message.fields)
        if message.kind == "HEARTBEAT" and not beats:
            return False
        if self._system in (None, message.system) and beats and self._component in (0, message.component):
            if not self._component:
                self._note(f"autopilot of system {message.system}, component {message.component}")
            self._system = message.system
            self._component, self._heard_s = message.component, now_s
            if self._lost:
                self._lost, self._commands = False, 0
                self._note("the autopilot's heartbeats are back")
        if message.system != self._system or not self._component:
            if self._system not in (None, message.system):
                self._say(f"messages of system {message.system} are ignored")
            return False
        if message.kind == "NAMED_VALUE_FLOAT":  # not our own, which a router may send back
            return message.component != COMPONENT
        return message.component == self._component

    def _check_parameters(self) -> None:
        """Ask for the autopilot's parameters, and say once which the forecast does not hold for."""
        if self._check is None or self._lost:
            return
        for name in self._check.names():
            self._to_autopilot("PARAM_REQUEST_READ", {"param_id": name.encode(), "param_index": -1})
        if said := self._check.result():
            self._tell(f"the forecast does not hold: {said}")

    def _return(self) -> None:
        """Command the autopilot to return; until it accepts, once with each heartbeat, `MAX_COMMANDS` times at most."""
        self._commands += 1
        if self._commands > MAX_COMMANDS:
            self._may_return = False
            self._tell(f"return not accepted by the autopilot, commanded {MAX_COMMANDS} times")
            return
        self._command(RETURN, (), self._commands - 1)

    def _to_autopilot(self, kind: str, values: Mapping[str, Any]) -> None:
        self._give(kind, {"target_system": self._system, "target_component": self._component, **values})

    def _is_held(self, items: list[MissionItem]) -> None:
        """Go on by the items of a log, or where they are others by the position."""
        if self._exported is not None:
            same = same_items([each.item for each in self._exported], items)
            self._lines.items = self._exported if same else None
            if not same:
                self._say(OTHER_MISSION)

    def _do(self, outputs: Iterable[Output]) -> None:
        """Do what an event of the mission asks for."""
        for output in outputs:
            match output:
                case Outgoing(kind, fields):
                    self._to_autopilot(kind, fields)
                case Warned(text):
                    self._tell(text)
                case Noted(text):
                    self._note(text)
                case Mapped(items):
                    self._map(items)

    def _map(self, items: list[MappedItem] | None) -> None:
        if items is not None and items != self._lines.items and self._log is not None:
            self._log.mission(items_text(items, self._plan.names[: self._plan.path_count]))
        self._lines.items = items

    def _command(self, command: int, numbers: Sequence[float], repeated: int = 0) -> None:
        values = {f"param{k}": float(value) for k, value in enumerate((*numbers, *(0.0,) * 7)[:7], 1)}
        self._to_autopilot("COMMAND_LONG", {"command": command, "confirmation": repeated, **values})

    # --- what goes out

    def _decided(self, line: dict[str, Any]) -> None:
        """Send a decision, and print it."""
        self._emit(line)
        if self._replanner.planned and not self._returns:  # before the first plan the parameters are those of take-off
            self._decided_path = tuple([line["parameters"][name] for name in self._plan.names[: self._plan.path_count]])
        boot_ms = max(0, round(line["time_s"] * 1000)) % 2**32
        shown = {p.label: p.shown(line["parameters"][p.name]) for p in self._plan.parameters}
        shown |= {"soc_end": line["soc_end_forecast"], "p_done": line["completes_probability"]}
        for name, value in shown.items():
            if value is not None:
                fields = {"time_boot_ms": boot_ms, "name": _ascii(name)[:NAME_CHARACTERS].encode(), "value": value}
                self._give("NAMED_VALUE_FLOAT", fields)
        if line["returns_home"] and not self._returns:
            self._returns, self._decided_path = True, None
            self._show("only home can be reached: fly home", CRITICAL)
        # a reason whose numbers alone change is said once; another path always, and first
        about = repr(line["parameters"]) + _NUMBERS.sub("", line["reason"])
        path = self._new_path(line)
        if (line["reason"] != KEPT or path) and about != self._text:
            self._text = about
            named = not path or line["reason"].startswith(path.partition(" ")[0])
            text = line["reason"] if named else f"{path}: {line['reason']}"
            self._show(text, NOTICE if self._replanner.completes or line["reason"] == TAKE_OFF else WARNING)
        if CELL_LOST in line["warnings"]:
            self._tell("the voltage fell for good: a cell, or its charge, is lost")

    def _new_path(self, line: Mapping[str, Any]) -> str:
        """Path parameters that are others than those said before, for people; empty if none are."""
        parameters = self._plan.parameters[: self._plan.path_count]
        before, self._said_path = self._said_path, tuple([line["parameters"][each.name] for each in parameters])
        new = zip(parameters, before, self._said_path, strict=True)
        return ", ".join(f"{each.label} now {each.text(now)}" for each, was, now in new if now != was)

    def _show(self, what: str, severity: int) -> None:
        """Show a text at the ground station, in pieces where it is long."""
        text = _ascii(f"eadp: {what}")[:MAX_TEXT].encode()
        if len(text) <= TEXT_CHARACTERS:
            self._give("STATUSTEXT", {"severity": severity, "text": text})
            return
        self._texts = self._texts % 65_535 + 1
        # the last piece is shorter than the others, if need be empty
        for number, start in enumerate(range(0, len(text) + 1, TEXT_CHARACTERS)):
            piece = {"text": text[start : start + TEXT_CHARACTERS], "id": self._texts, "chunk_seq": number}
            self._give("STATUSTEXT", {"severity": severity, **piece})

    def _give(self, kind: str, values: Mapping[str, Any]) -> None:
        if self._send is not None:
            self._send(self._system or 1, kind, values)

    # --- warnings

    def _say(self, what: str) -> None:
        self._warn_once(Fault(self._name, max(self._lines.count, 1), 1, what, severity="warning"))

    def _tell(self, what: str) -> None:
        """Warn the pilot, too, and once."""
        before = len(self._warned)
        self._say(what)
        if len(self._warned) > before:
            self._show(what, WARNING)

    def _note(self, what: str) -> None:
        self._warn(Fault(self._name, max(self._lines.count, 1), 1, what, severity="note"))

    def _warn_once(self, fault: Fault) -> None:
        """Warn of each thing once: a link repeats what is wrong with it many times a second."""
        kind = _NUMBERS.sub("", fault.message)
        if kind not in self._warned:
            self._warned.add(kind)
            self._warn(fault)


def _ascii(text: str) -> str:
    return text.replace("→", "->").replace("−", "-").encode("ascii", "replace").decode()


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
        If the address cannot be opened, or the key not be read.
    """
    require_pymavlink("--mavlink", address)
    key = None if options.signing_key is None else read_key(options.signing_key)
    opened: list[Link] = []

    def send(*message: Any) -> None:
        for link in opened:
            link.send(*message)

    flight = LinkFlight(inputs, address, options, log, emit, warn, send)
    link, throttle, left_out = Link(address, WANTED, key), Throttle(LINE_S), 0
    opened.append(link)
    try:
        while not flight.over:
            for message in link.receive(WAIT_S):
                if message.kind not in TIMED or throttle.passes():
                    flight.take(message, time.monotonic())
                else:
                    left_out += 1
            flight.lost(link.damaged, link.refused, left_out)
            flight.tick(time.monotonic())
    finally:
        link.close()
    return flight.completes


def replay_flight(
    path: str, inputs: FlightInputs, options: LinkOptions, log: ReplanLog | None, emit: Emit, warn: Warn, hashed: str
) -> bool:
    """Re-plan a flight again, of a log of `eadp replan`, a telemetry log, or an autopilot's own; as `fly`.

    `hashed` is the hash of the inputs, which a log of other inputs does not have.

    Raises
    ------
    InputError
        If the file cannot be read, or has no flight.
    """
    with open_telemetry(path) as stream:
        head = stream.readline(10_000)
        if _kind(head) == START:
            if json.loads(head).get("inputs") != hashed:
                what = "is of another plan, scenario or settings: decisions may be others"
                warn(Fault(path, 1, 1, what, severity="warning"))
            replanner = Replanner(inputs, path, log, emit, warn)
            replanner.restore()
            for number, raw in numbered_lines(stream, path):
                if _kind(raw) == TELEMETRY:
                    line = {key: value for key, value in json.loads(raw).items() if key != "kind"}
                    replanner.take(replanner.reader.reading(number + 1, line))
            used, completes = replanner.used, replanner.completes
        else:
            flight = LinkFlight(inputs, path, options, log, emit, warn)
            form = form_of(head)
            if form in (None, TLOG):
                require_pymavlink("--replay", path)
                messages = list(tlog_messages(head + stream.read(), WANTED))
                places = [values_of(each.kind, each.fields) for each in messages if each.kind == "GLOBAL_POSITION_INT"]
                _check_place(path, inputs.world.plan, places)
                for message in itertools.takewhile(lambda _: not flight.over, messages):
                    flight.take(message)
            else:
                rows = list(log_values(path, str(form)))
                _check_place(path, inputs.world.plan, rows)
                for values in itertools.takewhile(lambda _: not flight.over, rows):
                    flight.update(values)
            used, completes = flight.used, flight.completes
    if not used:
        what = "a log of eadp replan, or a log (.tlog, .bin, .ulg) of a flight of the plan"
        raise InputError.at(path, 1, 1, "has no flight that can be used", what)
    return completes


def _check_place(path: str, plan: Plan, rows: Sequence[Mapping[str, Any]]) -> None:
    """Refuse a flight that is nowhere near its plan: none of its positions is."""
    found = [(row["lat_deg"], row["lon_deg"]) for row in rows if row.get("lat_deg") is not None]
    if plan.site.origin_deg is None or not found:
        return
    ends = [stage.trigger_at([plan.hull(i).hi for i in range(plan.path_count)]) for stage in plan.stages]
    reach_m = max(NEAR_M, NEAR_SIZES * max(math.dist(end, ends[0]) for end in ends))
    points = [to_near_local_m(*place, plan.site.origin_deg) for place in found]
    if all(point is None or min(math.dist(point, end) for end in ends) > reach_m for point in points):
        message = f"is a flight elsewhere, as at {found[0][0]:.4f}, {found[0][1]:.4f}"
        raise InputError.at(path, 1, 1, message, f"a log of a flight within {reach_m / 1000:.3g} km of the plan")


def _kind(raw: bytes) -> str | None:
    """The kind of a line of a log; None where it is none."""
    try:
        line = json.loads(raw)
    except (ValueError, RecursionError):
        return None
    return str(line.get("kind")) if isinstance(line, dict) else None

"""Telemetry in and decisions out, one JSON object a line; an invalid value gives a warning and counts as null."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Annotated, Any, BinaryIO, Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eadp.core.geometry.geodesy import heading_rad, to_near_local_m
from eadp.errors import Fault, InputError, printable
from eadp.io.text.json import JsonObject, JsonReader
from eadp.io.text.streams import Text
from eadp.live.flight import Advice
from eadp.models.autopilot import Autopilot
from eadp.models.battery import Battery
from eadp.models.world import Mission
from eadp.planning.base import Mode, Sample

LINE_LIMIT_BYTES = 65_536
MAX_UNKNOWN_KEYS = 100
"""Maximum number of warnings about unknown keys."""

MAX_SPEED_SHARE = 2.5
"""Largest ground speed over the airspeed, which a wind below it at most doubles; most speeds in km/h are above."""
MAX_CAPACITY_SHARE = 2.0
"""Largest charge drawn over the battery's capacity, which may be stated too small; a charge in mAh is above."""

BOM = b"\xef\xbb\xbf"

Time = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
Metres = Annotated[float, Field(ge=-1e7, le=1e7, allow_inf_nan=False)]
Watts = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Speed = Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class AutopilotLine(BaseModel):
    """What a line has of the autopilot: its kind, and parameters by their names."""

    model_config = ConfigDict(strict=True, frozen=True, extra="allow", use_attribute_docstrings=True)
    __pydantic_extra__: dict[str, Finite]

    kind: Literal["ardupilot", "px4"] | None = None
    """the autopilot's software"""


class TelemetryLine(BaseModel):
    """A line of telemetry: any value but the time may be null. Other keys are ignored."""

    model_config = ConfigDict(strict=True, frozen=True, use_attribute_docstrings=True)

    time_s: Time
    """a time in seconds, of any clock that rises"""

    x_m: Metres | None = None
    """a position in metres, east"""

    y_m: Metres | None = None
    """a position in metres, north"""

    lat_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    """a latitude in degrees, in place of x_m and y_m where the plan has an origin"""

    lon_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    """a longitude in degrees"""

    power_w: Watts | None = None
    """a power in watts, or null where the sensor has no reading"""

    soc: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = None
    """a state of charge, 0 to 1"""

    current_consumed_ah: Annotated[float, Field(ge=0, le=1e6)] | None = None
    """the charge drawn since take-off in ampere-hours, in place of soc"""

    airspeed_mps: Annotated[float, Field(ge=0, le=1000)] | None = None
    """an airspeed in metres per second"""

    stage: Annotated[int, Field(ge=1)] | None = None
    """the stage being flown, a whole number from 1"""

    wind_mps: tuple[Speed, Speed] | None = None
    """[x, y]: the vector that the wind blows towards, in metres per second"""

    velocity_mps: tuple[Speed, Speed] | None = None
    """[x, y]: ground velocity in metres per second"""

    heading_deg: Finite | None = None
    """the heading of the nose in degrees, 0 north, 90 east"""

    parameters: dict[str, Finite | None] | None = None
    """parameters in force by name, as in {"c1": -500}; null where a value is on its way to the aircraft"""

    stages_started: Annotated[int, Field(ge=1)] | None = None
    """the number of stages started over the whole flight, the first included"""

    altitude_m: Metres | None = None
    """the altitude above the place of take-off in metres"""

    voltage_v: Annotated[float, Field(ge=0, le=1000)] | None = None
    """the battery's voltage in volts"""

    flies_mission: bool | None = None
    """true where an autopilot flies a mission laid out before, so that its end is certain; false where it holds,
    returns, or a pilot flies"""

    returns_home: bool | None = None
    """true where the autopilot flies home"""

    autopilot: AutopilotLine | None = None
    """the kind of the autopilot, ardupilot or px4, and its parameters by name, as in {"kind": "px4", "RTL_TYPE": 1}"""


KEYS = tuple(TelemetryLine.model_fields)
EXPECTED = ("time_s", "x_m", "y_m", "power_w", "soc")
"""Keys that every line should have."""
INSTEAD = {"x_m": "lat_deg", "y_m": "lon_deg", "soc": "current_consumed_ah"}
"""What a line may have in place of them."""


class Reading(NamedTuple):
    """A sample of telemetry, or None where there is none, and what it was read from.

    Attributes
    ----------
    sample : Sample or None
    line : JsonObject
        The values as given, which a log keeps; invalid ones are null.
    warnings : list of Fault
    number : int
        Number of the line, from 1.
    """

    sample: Sample | None
    line: JsonObject
    warnings: list[Fault]
    number: int


class TelemetryReader:
    """Reads the lines of one stream, and warns once of each key that is unknown or missing.

    Parameters
    ----------
    name : str
        Name of the stream in messages.
    mission : Mission, optional
        Its plan's origin and its battery give position and charge from what a line has in place of them.
    origin_deg : (float, float), optional
        Latitude and longitude of the origin [°], without a mission.
    """

    def __init__(
        self, name: str, mission: Mission | None = None, origin_deg: tuple[float, float] | None = None
    ) -> None:
        self._name = name
        self._origin_deg = mission.plan.site.origin_deg if mission is not None else origin_deg
        self._battery = mission.battery if mission is not None else Battery()
        self._fastest_mps = math.inf
        if mission is not None:
            commanded = [stage.airspeed_mps for stage in mission.plan.stages if stage.airspeed_mps is not None]
            self._fastest_mps = MAX_SPEED_SHARE * max([mission.cruise_mps, *commanded])
        self._placed = True
        self._unknown: set[str] = set()
        self._missing: set[str] = set()

    def read(self, number: int, raw: bytes) -> Reading:
        """Read one line; there is no sample without a time, or with nothing but a time.

        Parameters
        ----------
        number : int
            Number of the line, from 1.
        raw : bytes
            The line, with or without its end.
        """
        try:
            document = self._document(number, raw)
        except InputError as error:
            fault = replace(error.faults[0], line=number, source="", severity="warning")
            return Reading(None, JsonObject(), [fault], number)
        return self.reading(number, document)

    def reading(self, number: int, values: Mapping[str, Any]) -> Reading:
        """As `read`, of the values of a line; what is wrong is null in its object."""
        document = (
            values
            if isinstance(values, JsonObject)
            else JsonObject({key: tuple(value) if isinstance(value, list) else value for key, value in values.items()})
        )
        warnings = self._unknown_keys(number, document)
        line, faults = self._line(number, document)
        if line is not None and (beyond := self._beyond(line)):
            faults += [self.fault(number, document, key, what, expected) for key, (what, expected) in beyond.items()]
            document.update(dict.fromkeys(beyond))
            line = line.model_copy(update=dict.fromkeys(beyond))
        sample, more = (None, []) if line is None else self._sample(number, line, document)
        missing = [key for key in EXPECTED if key not in document and INSTEAD.get(key) not in document]
        of_use = () if sample is None else (sample.position_m, sample.power_w, sample.soc, sample.stage)
        useless = all(value is None for value in of_use)
        fresh = missing if useless else [key for key in missing if key not in self._missing]
        if fresh and not faults:  # of a line with other faults at the next one
            self._missing.update(fresh)
            what = f"{', '.join(fresh)} {'are' if len(fresh) > 1 else 'is'} missing"
            faults = [self.fault(number, document, "", what, f"the keys {', '.join(EXPECTED)}")]
        return Reading(None if useless else sample, document, [*warnings, *faults, *more], number)

    def fault(self, number: int, document: JsonObject, key: str, message: str, expected: str) -> Fault:
        """A warning about a key of a line that has been read."""
        column = document.offsets.get(key, 0) + 1
        return Fault(self._name, number, column, message, expected, severity="warning")

    def _document(self, number: int, raw: bytes) -> JsonObject:
        if len(raw) > LINE_LIMIT_BYTES:
            raise self._error("the line is too long", f"at most {LINE_LIMIT_BYTES} bytes")
        if number == 1:
            raw = raw.removeprefix(BOM)
        raw = raw.rstrip(b"\r\n")
        try:
            text = raw.decode("utf-8")
        except UnicodeDecodeError as error:
            column = len(raw[: error.start].decode("utf-8")) + 1
            raise self._error(f"is not UTF-8 text: byte 0x{raw[error.start]:02x}", "UTF-8 text", column) from None
        if not text.strip():
            raise self._error("the line is blank", "a JSON object")
        value = JsonReader(Text(self._name, text), not_finite=True).document()
        if not isinstance(value, JsonObject):
            raise self._error("is no JSON object", 'an object such as {"time_s": 0, …}')
        return value

    def _unknown_keys(self, number: int, document: JsonObject) -> list[Fault]:
        warnings = []
        for key in document:
            if key in KEYS or key in self._unknown or len(self._unknown) >= MAX_UNKNOWN_KEYS:
                continue
            self._unknown.add(key)
            message = f"unknown key {printable(key, 60)}; ignored here and from now on"
            warnings.append(self.fault(number, document, key, message, f"one of {', '.join(KEYS)}"))
        return warnings

    def _line(self, number: int, document: JsonObject) -> tuple[TelemetryLine | None, list[Fault]]:
        """The line with its valid values, None without a time; and a warning about each of the others."""
        known = {key: value for key, value in document.items() if key in KEYS}
        try:
            return TelemetryLine.model_validate(known), []
        except ValidationError as error:
            wrong = sorted(
                {str(problem["loc"][0]) for problem in error.errors() if problem["type"] != "missing"},
                key=lambda key: document.offsets.get(key, 0),
            )
        faults = [self._fault_of(number, document, key) for key in wrong]
        document.update(dict.fromkeys(wrong))
        if document.get("time_s") is None:
            return None, faults
        return TelemetryLine.model_validate({key: document[key] for key in known}), faults

    def _beyond(self, line: TelemetryLine) -> dict[str, tuple[str, str]]:
        """Values that the aircraft cannot have, by key: what is wrong, and what is expected."""
        found = {}
        for key, vector in (("velocity_mps", line.velocity_mps), ("wind_mps", line.wind_mps)):
            if vector is not None and math.hypot(*vector) > self._fastest_mps:
                expected = f"at most {self._fastest_mps:g} m/s: {MAX_SPEED_SHARE:g} times the airspeed"
                found[key] = f"{key} is {math.hypot(*vector):.3g} m/s", expected
        drawn_ah, max_ah = line.current_consumed_ah, MAX_CAPACITY_SHARE * self._battery.capacity_ah
        if drawn_ah is not None and drawn_ah > max_ah:
            expected = f"at most {max_ah:g} Ah: {MAX_CAPACITY_SHARE:g} times the battery's capacity"
            found["current_consumed_ah"] = f"current_consumed_ah is {drawn_ah:g} Ah", expected
        return found

    def _sample(self, number: int, line: TelemetryLine, document: JsonObject) -> tuple[Sample, list[Fault]]:
        """The sample of a line, and a warning where its latitude and longitude are no position."""
        values = line.model_dump(exclude={"x_m", "y_m", "heading_deg", "parameters", "autopilot", *INSTEAD.values()})
        position, faults = None if line.x_m is None or line.y_m is None else (line.x_m, line.y_m), []
        if line.x_m is None and line.y_m is None and line.lat_deg is not None and line.lon_deg is not None:
            position = to_near_local_m(line.lat_deg, line.lon_deg, self._origin_deg) if self._origin_deg else None
            if position is None and self._placed:
                what, expected = "is too far from the plan's origin", "a position near it"
                if not self._origin_deg:
                    what, expected = "has no place: the plan has no origin", "x_m and y_m, or %: origin in the plan"
                faults = [self.fault(number, document, "lat_deg", f"lat_deg {what}; ignored", expected)]
            self._placed = position is not None
        if line.soc is None and line.current_consumed_ah is not None:
            # b = b0 − ∫ k_b I / Q_c dt
            drawn = self._battery.drain_per_as * 3600 * line.current_consumed_ah
            values["soc"] = max(self._battery.soc - drawn, 0.0)
        heading = None if line.heading_deg is None else heading_rad(line.heading_deg)
        parameters = {name: math.nan if value is None else value for name, value in (line.parameters or {}).items()}
        known = line.autopilot
        autopilot = None if known is None else Autopilot(known.kind, known.model_extra or {})
        mode = Mode(values.pop("flies_mission"), bool(values.pop("returns_home")), autopilot)
        return Sample(**values, position_m=position, heading_rad=heading, parameters=parameters, mode=mode), faults

    def _fault_of(self, number: int, document: JsonObject, key: str) -> Fault:
        """A warning about an invalid value."""
        shown = printable(json.dumps(document[key], default=str), 60)
        expected = " ".join((TelemetryLine.model_fields[key].description or "").split())
        return self.fault(number, document, key, f"{key} cannot be {shown}", expected)

    def _error(self, message: str, expected: str, column: int = 1) -> InputError:
        return InputError.at(self._name, 1, column, message, expected)


def numbered_lines(stream: BinaryIO, name: str) -> Iterator[tuple[int, bytes]]:
    """Lines of a stream with their numbers, as they arrive; a line that is too long is truncated.

    Raises
    ------
    InputError
        If the stream cannot be read.
    """
    number = 1
    while raw := _line(stream, name, number):
        rest = raw
        while len(rest) > LINE_LIMIT_BYTES and not rest.endswith(b"\n"):
            rest = _line(stream, name, number)
        yield number, raw
        number += 1


def _line(stream: BinaryIO, name: str, number: int) -> bytes:
    try:
        return stream.readline(LINE_LIMIT_BYTES + 1)
    except OSError as error:
        raise InputError.at(name, number, 1, f"cannot be read: {error.strerror}", "a readable stream") from None


@contextmanager
def open_telemetry(path: str) -> Iterator[BinaryIO]:
    """A file of telemetry, a pipe, or standard input for `-`, read as it arrives.

    Raises
    ------
    InputError
        At 1:1, if it cannot be read.
    """
    if path == "-":
        yield sys.stdin.buffer
        return
    try:
        stream = open(path, "rb")  # noqa: SIM115 - the caller reads within the block below
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        what = getattr(error, "strerror", None) or str(error)
        raise InputError.at(path, 1, 1, f"cannot be read: {what}", "a readable file") from None
    with stream:
        yield stream


class DecisionLine(BaseModel):
    """A line of decisions; null where unknown."""

    model_config = ConfigDict(strict=True, frozen=True)

    time_s: float = Field(description="of the telemetry line [s]")
    stage: int = Field(description="stage being flown, from 1")
    lap: int = Field(description="lap being flown, from 0")
    parameters: dict[str, float] = Field(description="decided, by name; path parameters wait for their stage")
    in_force: dict[str, float] = Field(description="in force now")
    soc_end_forecast: float | None = Field(
        description="state of charge at the end of the plan; negative by the shortfall of charge"
    )
    soc_end_std: float | None = Field(description="its standard deviation")
    completes_probability: float | None = Field(
        description="probability that the battery is not empty before the end, and the autopilot does not turn back"
    )
    reserve_probability: float | None = Field(
        description="probability that the reserve is kept; both with the least computations, or those that stay"
    )
    remaining_s: float | None = Field(description="time to the end of the plan [s]")
    energy_wh: float | None = Field(description="energy to the end of the plan [Wh]")
    energy_std_wh: float | None = Field(description="its standard deviation [Wh]")
    wind_mps: list[float] | None = Field(description="[x, y]: estimated wind, the vector that it blows towards [m/s]")
    reason: str = Field(description="the decision and its reason")
    warnings: list[str] = Field(description="codes of what is wrong with the telemetry")
    returns_home: bool = Field(description="whether to give the plan up and fly home, where the scenario allows it")
    home_reachable: bool | None = Field(description="whether home can be reached with the reserve kept")
    point_of_no_return_s: float | None = Field(
        description="up to when it can, as planned; or, if it cannot, when it could last: a time as time_s [s]"
    )
    home_by_s: float | None = Field(description="when home is reached at the latest: a time as time_s [s]")
    airspeed_mps: float | None = Field(description="true airspeed decided for this stage [m/s]")


def decision_line(advice: Advice) -> dict[str, Any]:
    """Advice as the object of a line."""
    fields = advice._asdict() | advice.ending._asdict() | advice.home._asdict()
    fields["soc_end_forecast"] = advice.ending.soc_end
    fields["wind_mps"] = None if advice.wind_mps is None else list(advice.wind_mps)
    fields["warnings"] = list(advice.warnings)
    return {key: fields[key] for key in DecisionLine.model_fields}


def json_line(line: dict[str, Any]) -> str:
    """An object as one line of JSON, its end included; NaN and infinities are refused, as JSON has none.

    It is ASCII, so that it can be written in any encoding of the terminal.
    """
    return json.dumps(line, allow_nan=False) + "\n"

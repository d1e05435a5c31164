"""Inner loop of the simulation: steps between two events that the outer loop has to handle.

Aircraft, guidance, gusts, charge, triggers and sums, until a planner, a row of the log, a fault or a new stage is due.
One function runs in plain Python on lists, or compiled on arrays (`eadp.core.compiled`), with identical results. It is
compiled for lines and circles; for a general curve it runs in plain Python on the same variables.
"""

from __future__ import annotations

import math
from collections.abc import MutableSequence
from typing import Any, NamedTuple

import numpy as np

from eadp.core import compiled
from eadp.core.arrays import FloatArray
from eadp.core.expressions.derivatives import Jet, PathFunction
from eadp.core.flight import level, replayed_soc
from eadp.core.geometry.curves import Point
from eadp.models.battery import Battery
from eadp.models.plan.executor import CurveProgress, PlanExecutor, watched
from eadp.models.weather import Wind
from eadp.simulation.aircraft import (
    AEROPLANE_MODEL,
    AIRCRAFT_CONSTANTS,
    AIRCRAFT_STATE,
    AIRSPEED,
    ALTITUDE,
    CRUISE_M,
    GUST_X,
    GUST_Y,
    GUSTS,
    HEADING,
    MODEL,
    NOISE_LEFT,
    SPEED_HELD,
    STEADY_X,
    STEADY_Y,
    STEP_S,
    VX,
    VY,
    Constants,
    State,
    X,
    Y,
    advance_gust,
    fly_step,
)

SOC, POWER, ENERGY, DISTANCE, MIN_POWER, MAX_POWER = range(AIRCRAFT_STATE, AIRCRAFT_STATE + 6)
RECORD_AT, READ_AT, READINGS, LOG_AT, ROWS = range(AIRCRAFT_STATE + 6, AIRCRAFT_STATE + 11)
STATE = AIRCRAFT_STATE + 11
"""State of charge, power [W]; sums of power and ground speed over the steps, minimum and maximum power [W]. Of the
records: the step of the next one of either kind; of readings, the step of the next and how many there are; of rows of
the log, the same."""

BATTERY_CONSTANTS = AIRCRAFT_CONSTANTS + 11
EMPTY_V, RISE_V, FOUR_R, MAX_A, CUTOFF_V, DRAIN, FAULT_AT, DROP, READ_EVERY, LATE, LOG_EVERY = range(
    AIRCRAFT_CONSTANTS, BATTERY_CONSTANTS
)
Q, X0, Y0, A, B, E, OFFSET_X, OFFSET_Y, GAIN, SENSE, COMPUTING = range(BATTERY_CONSTANTS, BATTERY_CONSTANTS + 11)
CONSTANTS = BATTERY_CONSTANTS + 11
"""Constants of the battery: open-circuit voltage empty, its rise to full, 4 R [V, V, Ω], the limits of current and
voltage, 2 k_b Δt / Q_c, the step of a sudden loss and its size. Of the records, in steps: time between readings, their
delay, time between rows. Of the stage: closed form of its path, offset [m], gain, sense, power of computations [W]."""

LOST, EMPTY, SAGS = 4, 8, 16
"""Events that end a flight, as bits beside `FIRED` and `ENDED`: the path has no value here, the battery is empty, or it
cannot deliver the power."""

SNAPSHOT = 7
"""Number of measured variables, which a sensor may delay, see `Measured`."""

READING, MAX_READINGS = 1 + SNAPSHOT, 5000
"""Length of a reading, its step and the measured variables; maximum number of readings in one run."""

ROW, MAX_ROWS = 9, 500
"""Length of a row of the log: step, x, y, altitude, heading, power, charge, airspeed, and that commanded; most rows of
one run."""

NOISE = 2000
"""Random numbers of gusts per draw."""

_NOTHING: Jet = (math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)


class Measured(NamedTuple):
    """The `SNAPSHOT` variables that sensors measure, without noise: of one step, or of each a column of several steps.

    They are in the order of `_copy_measured`.
    """

    x_m: Any
    y_m: Any
    power_w: Any
    soc: Any
    vx_mps: Any
    vy_mps: Any
    heading_rad: Any


class StepTables(NamedTuple):
    """What steps look up: normal random numbers for gusts, and the battery.

    Places of its voltage over the charge, see `level`, and a trace that is replayed, see `replayed_soc`, or none.
    """

    noise: Any
    curve: Any
    replay: Any


class StepRecords(NamedTuple):
    """What steps write: a ring buffer of what was measured in the last `LATE` + 1 steps; readings; rows of the log."""

    late: Any
    readings: Any
    rows: Any


class GeneralCurve(NamedTuple):
    """Of a stage with a general curve: its function, None where there is a closed form, and the progress along it."""

    path: PathFunction | None
    progress: CurveProgress | None


def run_steps(
    s: State,
    w: MutableSequence[float],
    c: Constants,
    tables: StepTables,
    records: StepRecords,
    curve: GeneralCurve | None,
    k: int,
    end: int,
) -> tuple[int, int]:
    """Fly from step `k` to step `end` or the next event; return the last step, and the events as bits, 0 for none.

    `s` is the state and `w` the variables of the stage's trigger, both changed in place, `c` the constants. Each step:
    the wind, the path at the position, the aircraft, the sums, the battery, the records, and last the trigger.
    """
    while k < end:
        k += 1
        wind_x, wind_y = c[STEADY_X], c[STEADY_Y]
        if c[GUSTS] != 0.0:
            advance_gust(s, c, tables.noise)
            wind_x += s[GUST_X]
            wind_y += s[GUST_Y]
        if curve is None or curve.path is None:
            # φ = q (u² + v²) + a u + b v + e
            u, v, h = s[X] - c[X0], s[Y] - c[Y0], 2 * c[Q]
            phi = c[Q] * (u * u + v * v) + c[A] * u + c[B] * v + c[E]
            jet = (phi, h * u + c[A], h * v + c[B], h, 0.0, h)
        else:
            jet = curve.path(s[X] - c[OFFSET_X], s[Y] - c[OFFSET_Y])
        if not math.isfinite(jet[0]):
            return k, LOST
        power_w = fly_step(s, c, jet, c[GAIN], c[SENSE], wind_x, wind_y) + c[COMPUTING]
        if not math.isfinite(s[HEADING]):
            return k, LOST
        s[POWER] = power_w
        s[ENERGY] += power_w
        s[DISTANCE] += math.sqrt(s[VX] * s[VX] + s[VY] * s[VY])
        if power_w < s[MIN_POWER]:
            s[MIN_POWER] = power_w
        if power_w > s[MAX_POWER]:
            s[MAX_POWER] = power_w
        failed = drain(s, c, power_w, k, tables)
        if failed:
            return k, failed
        if k >= s[RECORD_AT]:
            _record(s, c, records, k)
        events = watched(w, s[X], s[Y], None if curve is None else curve.progress)
        if events:
            return k, events
    return k, 0


def drain(s: State, c: Constants, power_w: float, k: int, tables: StepTables) -> int:
    """Drain the battery over step `k`, faults included; return `EMPTY`, `SAGS` or 0."""
    # at a power y: I = 2y / (V + √(V² − 4 R y)), ḃ = −k_b I / Q_c; at the terminals (V + √(V² − 4 R y)) / 2 = y / I
    # `battery.drain_per_s` is written out here: calling it, plain code flies 1.4 times as long, compiled code as long
    soc = s[SOC] if len(tables.curve) == 0 else level(s[SOC], tables.curve)
    volts = c[EMPTY_V] + c[RISE_V] * soc
    discriminant = volts * volts - c[FOUR_R] * power_w
    if discriminant < 0:
        return SAGS
    twice_v = volts + math.sqrt(discriminant)  # twice the voltage at the terminals
    if twice_v < 2 * c[CUTOFF_V] or 2 * power_w > c[MAX_A] * twice_v:
        return SAGS
    if len(tables.replay) > 0:
        s[SOC] = replayed_soc(tables.replay, k * c[STEP_S])
    else:
        # ḃ Δt = −(k_b Δt / Q_c) · 2y / (2 V at the terminals): DRAIN is 2 k_b Δt / Q_c
        s[SOC] -= c[DRAIN] * power_w / twice_v
        if k == c[FAULT_AT]:
            s[SOC] -= c[DROP]
    if s[SOC] <= 0:
        s[SOC] = 0.0
        return EMPTY
    return 0


def _record(s: State, c: Constants, records: StepRecords, k: int) -> None:
    """Append a reading and a row of the log where step `k` has them, and set when it is called next, `RECORD_AT`.

    With a delay the measured variables of every step go into `late`, a ring buffer of `LATE` + 1 places: step k into
    place (k − 1) mod (`LATE` + 1). The first step is read until the delay is over.
    """
    late, readings, rows = records
    late_by = int(c[LATE])
    if late_by > 0:
        _copy_measured(s, late, (k - 1) % (late_by + 1) * SNAPSHOT)
    if k == s[READ_AT]:
        n = int(s[READINGS]) * READING
        readings[n] = k
        if late_by > 0:
            place = max(k - 1 - late_by, 0) % (late_by + 1) * SNAPSHOT
            for i in range(SNAPSHOT):
                readings[n + 1 + i] = late[place + i]
        else:
            _copy_measured(s, readings, n + 1)
        s[READINGS] += 1
        s[READ_AT] += c[READ_EVERY]
    if k == s[LOG_AT]:
        n = int(s[ROWS]) * ROW
        rows[n], rows[n + 1], rows[n + 2], rows[n + 3] = k, s[X], s[Y], s[ALTITUDE]
        rows[n + 4], rows[n + 5], rows[n + 6] = s[HEADING], s[POWER], s[SOC]
        rows[n + 7], rows[n + 8] = s[AIRSPEED], c[SPEED_HELD]
        s[ROWS] += 1
        s[LOG_AT] += c[LOG_EVERY]
    if late_by == 0:  # else the buffer takes every step
        read_at, log_at = s[READ_AT], s[LOG_AT]
        s[RECORD_AT] = read_at if read_at < log_at else log_at


def _copy_measured(s: State, to: MutableSequence[float], at: int) -> None:
    """Copy the `SNAPSHOT` measured variables into `to`, from index `at` on."""
    to[at], to[at + 1], to[at + 2], to[at + 3] = s[X], s[Y], s[POWER], s[SOC]
    to[at + 4], to[at + 5], to[at + 6] = s[VX], s[VY], s[HEADING]


def drain_constants(battery: Battery, step_s: float) -> list[float]:
    """A battery's constants, from `EMPTY_V` to `DRAIN`."""
    empty_v = battery.voltage_at(0.0)
    rise_v = battery.voltage_v - empty_v
    limits = 4 * battery.resistance_ohm, battery.max_current_a, battery.cutoff_voltage_v or 0.0
    return [empty_v, rise_v, *limits, 2 * battery.k_b_per_s * step_s / battery.capacity_ah]


class InnerLoop:
    """State and constants of one flight, and the function that runs its steps.

    Numbers are lists in plain Python, and arrays where the function is compiled.
    """

    def __init__(self, state: list[float], constants: list[float], battery: Battery, wind: Wind, rng: Any) -> None:
        self._compiled = compiled.enabled()
        self._fly = compiled.jitted(run_steps, makes_arrays=False)
        curve, replay = self._numbers(list(battery.curve)), self._numbers(battery.replay)
        self._tables = StepTables(self._numbers([]), curve, replay)
        self._rng = rng
        first = rng.standard_normal(2)
        # the aircraft's constants, then room for battery, records and stage; the points of a power curve stay the last
        aircraft, points = constants[:AIRCRAFT_CONSTANTS], constants[AIRCRAFT_CONSTANTS:]
        c: Any = [*aircraft, *[0.0] * (CONSTANTS - AIRCRAFT_CONSTANTS), *points]
        s: Any = [*state, *[0.0] * (STATE - AIRCRAFT_STATE)]
        s[GUST_X], s[GUST_Y] = wind.gust_std_mps * float(first[0]), wind.gust_std_mps * float(first[1])
        s[MIN_POWER], s[MAX_POWER] = math.inf, -math.inf
        s[SOC] = replayed_soc(battery.replay, 0.0) if battery.prescribed else battery.soc
        c[EMPTY_V : DRAIN + 1] = drain_constants(battery, c[STEP_S])
        readings, rows = (self._numbers([0.0] * count) for count in (READING * MAX_READINGS, ROW * MAX_ROWS))
        self._records = StepRecords(self._numbers([]), readings, rows)
        self._curve: GeneralCurve | None = None
        self._watch: Any = []
        self._cruise = constants[CRUISE_M], constants[SPEED_HELD]
        self._s, self._c = self._numbers(s), self._numbers(c)

    def _numbers(self, values: list[float]) -> Any:
        """Numbers as the function takes them: an array where it is compiled."""
        return np.array(values) if self._compiled else values

    def set_records(self, every: int, late: int, log_every: int) -> None:
        """Set the steps between readings, from step 1 on, by which they are late, and between rows of the log."""
        self._s[READ_AT], self._s[LOG_AT] = 1, log_every
        self._c[READ_EVERY], self._c[LATE], self._c[LOG_EVERY] = every, late, log_every
        self._records = self._records._replace(late=self._numbers([0.0] * (SNAPSHOT * (late + 1))))

    def set_loss(self, step: int, drop: float) -> None:
        """Set the next sudden loss of charge: its step, and its size as a state of charge."""
        self._c[FAULT_AT], self._c[DROP] = step, drop

    def set_wind(self, wind_mps: Point) -> None:
        """Set the steady wind from now on [m/s]."""
        self._c[STEADY_X], self._c[STEADY_Y] = wind_mps

    def start_stage(self, executor: PlanExecutor, computing_w: float) -> None:
        """Start the stage that an executor is at, with the power of the computations on it [W]."""
        c, stage, (ox, oy) = self._c, executor.stage, executor.cursor.offset_m
        c[OFFSET_X], c[OFFSET_Y], c[GAIN], c[SENSE], c[COMPUTING] = ox, oy, stage.gain, stage.sense, computing_w
        if c[MODEL] == AEROPLANE_MODEL:
            altitude_m, airspeed_mps = self._cruise
            c[CRUISE_M] = altitude_m if stage.altitude_m is None else stage.altitude_m
            c[SPEED_HELD] = executor.cursor.airspeed_mps or airspeed_mps
        if executor.form is not None:
            q, x, y, a, b, e = executor.form  # of the path function about (x, y), see `run_steps`
            c[Q], c[X0], c[Y0], c[A], c[B], c[E] = q, x + ox, y + oy, a, b, e  # moved by the offset
        path = None if executor.form is not None else _guarded(executor.path)
        watch = executor.watch  # the trigger's variables, which the steps change, and progress along a general curve
        self._curve = None if path is None and watch.curve is None else GeneralCurve(path, watch.curve)
        watch.numbers = self._numbers(list(watch.numbers))
        self._watch = watch.numbers

    def run(self, k: int, end: int) -> tuple[int, int]:
        """Run from step `k` to step `end` or the next event, see `run_steps`; return the last step, and the events.

        It stops before `end` where random numbers or the room for records end. It flies a step at least, unless it is
        `full`.
        """
        if self._c[GUSTS]:
            if self._s[NOISE_LEFT] < 2:
                noise = self._rng.standard_normal(NOISE)
                self._tables = self._tables._replace(noise=noise if self._compiled else noise.tolist())
                self._s[NOISE_LEFT] = NOISE
            end = min(end, k + int(self._s[NOISE_LEFT]) // 2)  # a step takes two
        room = MAX_READINGS - int(self._s[READINGS])
        end = min(end, k + room * int(self._c[READ_EVERY]), k + MAX_ROWS * int(self._c[LOG_EVERY]))
        if self._compiled and self._curve is not None:
            return self._run_uncompiled(k, end)
        return self._fly(self._s, self._watch, self._c, self._tables, self._records, self._curve, k, end)

    def _run_uncompiled(self, k: int, end: int) -> tuple[int, int]:
        """Run along a general curve in plain Python, on the arrays of the compiled function."""
        state, watch = self._s.tolist(), self._watch.tolist()
        tables = StepTables(*(table.tolist() for table in self._tables))
        k, events = run_steps(state, watch, self._c.tolist(), tables, self._records, self._curve, k, end)
        self._s[:], self._watch[:] = state, watch
        return k, events

    def measured(self, k: int) -> Measured:
        """The measured variables after step `k`, with the sensors' delay."""
        places = int(self._c[LATE]) + 1  # of the ring buffer, see `_record`
        if places == 1:
            s = self._s
            return Measured._make(map(float, (s[X], s[Y], s[POWER], s[SOC], s[VX], s[VY], s[HEADING])))
        at = max(k - places, 0) % places * SNAPSHOT
        return Measured._make(map(float, self._records.late[at : at + SNAPSHOT]))

    def take_readings(self, end: int) -> tuple[FloatArray, Measured]:
        """Take the readings since the last call out of the loop: their steps, and columns of what was measured.

        A reading of a step after `end` is dropped.
        """
        count, flat = int(self._s[READINGS]), self._records.readings
        self._s[READINGS] = 0
        if count and flat[READING * (count - 1)] > end:
            count -= 1
        steps, *measured = np.array(flat[: READING * count]).reshape(count, READING).T.copy()
        return steps, Measured(*measured)

    @property
    def airspeed_commanded_mps(self) -> float:
        """True airspeed that the throttle holds now [m/s]."""
        return float(self._c[SPEED_HELD])

    def take_rows(self) -> list[list[float]]:
        """Take the rows of the log since the last call out of the loop; to be called after each run."""
        count = int(self._s[ROWS])
        if not count:
            return []
        self._s[ROWS] = 0
        flat = self._records.rows[: ROW * count]
        values: list[float] = flat.tolist() if self._compiled else flat
        return [values[i : i + ROW] for i in range(0, len(values), ROW)]

    @property
    def full(self) -> bool:
        """Whether there is no room for another reading: no step is flown until `take_readings`."""
        return bool(self._s[READINGS] >= MAX_READINGS)

    def variable(self, index: int) -> float:
        """A variable of the state."""
        return float(self._s[index])


def _guarded(path: PathFunction) -> PathFunction:
    """The path function with NaN where it has no value."""

    def jet(x: float, y: float) -> Jet:
        try:
            return path(x, y)
        except (ArithmeticError, ValueError):
            return _NOTHING

    return jet

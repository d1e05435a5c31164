"""Metrics of a flight: parameters over time and the quality U."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eadp.core.geometry.curves import Point
from eadp.models.plan.cursor import PlanCursor, Vector
from eadp.models.plan.ground import GroundLog
from eadp.models.plan.plan import Plan
from eadp.models.plan.route import RouteArrays, RoutePredictor
from eadp.models.plan.stage import Box, left_m
from eadp.models.weather import Sensors


@dataclass
class ParameterRecord:
    """A parameter over a flight: its first value, and the time [s] and value of each change."""

    first: float
    history: list[tuple[float, float]] = field(default_factory=list)

    @property
    def last(self) -> float:
        """Its last value."""
        return self.history[-1][1] if self.history else self.first


class _Event(NamedTuple):
    """A stage or parameters in force from a time on [s]; `joined_m` is where the stage starts [m], None within it."""

    time_s: float
    cursor: PlanCursor
    joined_m: Point | None


class ParameterLog:
    """Parameters over time: means, changes, and the quality U by ground.

    Updated at new stages and changes only.

    Parameters
    ----------
    plan : Plan
    cursor : PlanCursor
        The first stage, and the parameters in force on it.
    joined_m : (float, float)
        Where it is joined [m].
    """

    def __init__(self, plan: Plan, cursor: PlanCursor, joined_m: Point) -> None:
        self._plan = plan
        self._since_s = 0.0  # the time up to which integrals are [s]; from there on these are in force:
        self._values, self._sets = cursor.parameters, plan.quality_sets[cursor.stage.index - 1]
        self.records = [ParameterRecord(value) for value in self._values]
        # of each parameter: time integral of c̃, its share of its set, and the time in which it had a choice [s]
        self._share_integral = [0.0] * len(self._values)
        self._share_time_s = [0.0] * len(self._values)
        self._events = [_Event(0.0, cursor, joined_m)]  # of which U is computed
        self._ended_s: float | None = None  # when the plan was completed or given up
        self._short_of: tuple[Point, float] | None = None  # as given to `close`

    def change(self, time_s: float, cursor: PlanCursor, joined_m: Point | None = None) -> None:
        """Record a new stage, joined at `joined_m` [m], or new parameters, from a time on [s]."""
        self._set(time_s, cursor.parameters, self._plan.quality_sets[cursor.stage.index - 1])
        self._events.append(_Event(time_s, cursor, joined_m))

    def give_up(self, time_s: float, parameters: Vector, sets: tuple[Box, ...]) -> None:
        """Record that the plan is given up at a time [s], for other parameters and sets; or that these change."""
        self._set(time_s, parameters, sets)
        self._ended_s = time_s if self._ended_s is None else self._ended_s

    def close(self, time_s: float, short_of: tuple[Point, float] | None = None) -> None:
        """End the flight. `short_of`: where it ends before its plan does, its position [m] and airspeed [m/s]."""
        self._advance(time_s)
        self._ended_s = time_s if self._ended_s is None else self._ended_s
        self._short_of = short_of

    def _set(self, time_s: float, parameters: Vector, sets: tuple[Box, ...]) -> None:
        """Integrate up to a time [s], and put parameters and sets in force from there on."""
        self._advance(time_s)
        for record, old, new in zip(self.records, self._values, parameters, strict=True):
            if new != old:
                record.history.append((round(time_s, 6), new))
        self._values, self._sets = parameters, sets

    def _advance(self, time_s: float) -> None:
        """Integrate what is in force up to a time [s]."""
        duration = time_s - self._since_s
        self._since_s = time_s
        for i, value in enumerate(self._values):
            share = self._sets[i].share(value) if self._sets else None
            if share is not None:
                self._share_integral[i] += share * duration
                self._share_time_s[i] += duration

    def mean(self, index: int, shown: Callable[[float], float] = float) -> float:
        """Time average of a parameter, or of what `shown` converts its values to."""
        record, end_s = self.records[index], self._since_s
        times_s, values = zip((0.0, record.first), *record.history, strict=True)
        spans_s = np.diff([*times_s, end_s])
        return float(spans_s @ [*map(shown, values)] / end_s) if end_s else shown(record.first)

    def mean_share(self, index: int) -> float | None:
        """Time average of c̃, the share of its set that a parameter has; None if that never had more than one value."""
        time_s = self._share_time_s[index]
        return self._share_integral[index] / time_s if time_s > 0 else None

    def quality(self, weights: Mapping[str, float]) -> float | None:
        """Quality U of the mission, 0 to 1, by its ground, flown and left to fly; None where no parameter has a choice.

        Source: `eadp.models.plan.ground`.
        """
        # the ground flown, by the events once more; `joined` and `since_s`: where and when the last stage was joined
        ground, predictor = GroundLog(self._plan, weights), RoutePredictor()
        for time_s, cursor, joined_m in self._events:
            if joined_m is not None:  # never None for the first
                joined, since_s = joined_m, time_s
                ground.start_leg(time_s, cursor, predictor.length_m(cursor, joined_m))
            ground.hold(time_s, cursor, cursor.parameters)
        ended_s = self._since_s if self._ended_s is None else self._ended_s
        flown = ground.until(ended_s)
        # the ground left, of the legs from the last stage on, by the times left on them: 0 where the plan is completed
        route = predictor.route(self._events[-1].cursor, joined)
        legs = RouteArrays.of([route])
        times_s = np.zeros(len(route.order))
        if self._short_of is not None:
            (position, airspeed_mps), leg = self._short_of, route.legs[0]
            times_s, _ = route.times_s(airspeed_mps, (0.0, 0.0))
            along_m = min(leg.distance_m, (ended_s - since_s) * airspeed_mps)
            # of the leg that the flight is on, the share left
            times_s[0] *= left_m(leg, position, along_m) / leg.distance_m if leg.distance_m > 0 else 0.0
        of_leg, flown_per_s = legs.ground(flown, times_s)
        counted = np.array([ground.shares.scaled(stage).any() for stage in legs.stages.tolist()])
        # the run being flown is not in `flown` yet: its ground a second, times the time with a choice (free_s), and
        # times the integral of the shares chosen (area_s); U = value over the ground seen / all ground
        total = flown.ground + flown_per_s[0] * flown.run.free_s + float(of_leg[counted].sum())
        seen = flown.value + flown_per_s[0] * flown.run.area_s
        return float(seen / total) if total > 0 else None

    def paper_metric(self, soc_final: float) -> float | None:
        """Σ_t ½(c̃1 + c̃2)/(|T| SoC(t_f)), for any number of parameters; None where SoC(t_f) is not above 0.

        Source: letter, Sec. V.
        """
        shares = [share for i in range(len(self.records)) if (share := self.mean_share(i)) is not None]
        if not shares or soc_final <= 0:
            return None
        return sum(shares) / len(shares) / soc_final


BATCH = 2000
"""Steps for which noise is drawn at once."""
OF_POWER, OF_X, OF_Y, OF_SOC = CHANNELS = range(4)
"""Channels of noise."""

NEVER_STEPS = 1 << 62
"""A duration that no flight reaches, in steps."""


class SensorSuite:
    """The sensors of one flight. The measurement of a step does not depend on which other steps are measured.

    Drop-outs are a Markov chain of two states. The durations of both are geometric: `drop_out_s` on average without a
    reading, and with one the duration that gives the share of drop-outs.

    Steps are measured in order, from 1 on; the last one may be measured again. `_noise` holds the batch of steps that
    ends with step `_noise_ends`; the present state, in a drop-out or not, ends with step `_state_ends`.
    """

    def __init__(self, sensors: Sensors, step_s: float, rng: np.random.Generator) -> None:
        self._sensors, self.ideal = sensors, sensors.ideal
        self._rng, self._durations = rng.spawn(2)
        self.late = round(sensors.delay_s / step_s)
        """The delay in steps."""
        self._noise: list[list[float]] = []
        self._noise_ends = 0
        share = sensors.drop_out_share
        # the chance that a drop-out ends at a step, and, of `_fail`, that one starts
        self._recover = min(1.0, step_s / sensors.drop_out_s) if share < 1 else 0.0
        # in balance: share · recover = (1 − share) · fail
        self._fail = min(1.0, self._recover * share / (1 - share)) if share < 1 else 1.0
        self._out = float(self._durations.random()) < share  # whether it starts in a drop-out
        self._state_ends = self._duration()

    def measured(
        self, step: int, x_m: float, y_m: float, power_w: float, soc: float
    ) -> tuple[tuple[float, float], float | None, float]:
        """Position [m], power [W], None in a drop-out, and state of charge, as measured at a step."""
        if self.ideal:  # no noise is drawn for it
            return (x_m, y_m), power_w, min(1.0, max(0.0, soc))
        sensors, noise = self._sensors, self._row(step)
        position_m = x_m + sensors.position_noise_m * noise[OF_X], y_m + sensors.position_noise_m * noise[OF_Y]
        measured_w = None if self._drops_out(step) else power_w + sensors.power_noise_w * noise[OF_POWER]
        return position_m, measured_w, min(1.0, max(0.0, soc + sensors.soc_noise * noise[OF_SOC]))

    def _drops_out(self, step: int) -> bool:
        """Whether a step has no reading of the power."""
        while step > self._state_ends:
            self._out = not self._out
            self._state_ends += self._duration()
        return self._out

    def _row(self, step: int) -> list[float]:
        """Standard normal numbers of a step, one for each channel."""
        while step > self._noise_ends:
            self._noise = self._rng.standard_normal((BATCH, len(CHANNELS))).tolist()
            self._noise_ends += BATCH
        return self._noise[step - self._noise_ends - 1]  # from the end: the last row is that of step `_noise_ends`

    def _duration(self) -> int:
        """Draw the duration of the present state, in steps."""
        chance = self._recover if self._out else self._fail
        return int(self._durations.geometric(chance)) if chance > 0 else NEVER_STEPS

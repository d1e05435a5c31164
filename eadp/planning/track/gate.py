"""Samples of telemetry as received, and a gate: clocks that jump, positions that are wrong or do not move."""

from __future__ import annotations

import math
from typing import NamedTuple

from eadp.core.geometry.curves import Point
from eadp.planning.base import Sample

GAP_S, GAP_STEPS = 5.0, 3.0
"""A gap: minimum length [s], and in multiples of the step before."""

MAX_GAP_S = 3600.0
SPEED_FACTOR, SLACK_M = 3.0, 50.0
"""Maximum distance of a sample from the last one: multiple of the cruise speed, and a constant [m]."""
MIN_AGREEING, MIN_BACK = 3, 10
"""Number of consecutive samples in agreement that are accepted however far they are from the last one; and however
early, if the position does not go on."""

FROZEN_S, MOVING_SHARE = 2.0, 0.1
"""Time after which an unchanged position is frozen [s], if the aircraft moves: by this share of the cruise speed."""

ON_SHARE, ON_M = 0.5, 20.0
"""Distance from a straight line on at which a position goes on: a share of that at cruise speed, and a constant [m]."""

DRAINED_SHARE = 0.5
"""Share of the charge drained at the mean rate so far above which a time has passed."""

CLOCK = "clock"


class Notice(NamedTuple):
    """A warning about a sample: its key, what is wrong, and what was expected."""

    key: str
    message: str
    expected: str = ""


class OutlierGate:
    """Accepts samples in order of time, on a time without jumps of the clock, and rejects positions that cannot be.

    Parameters
    ----------
    cruise_mps : float
        Airspeed of the aircraft [m/s].
    """

    def __init__(self, cruise_mps: float) -> None:
        self._cruise_mps, self._max_mps = cruise_mps, SPEED_FACTOR * cruise_mps
        self._last: Sample | None = None
        # the step between the last two accepted samples, and what is added to the time of each sample [s]
        self._step_s = self._clock_offset_s = 0.0
        # time [s] and position [m] of the last position accepted, and the velocity to it from the one before [m/s]
        self._located: tuple[float, Point] | None = None
        self._velocity: Point | None = None
        # time [s] and state of charge of the first sample with a charge
        self._first_charge: tuple[float, float] | None = None
        # the last sample that may be on a clock that jumped, and how many consecutive ones agree on that clock
        self._off_clock: Sample | None = None
        self._off_clock_count = 0
        # time [s] and position [m] of the last position too far off, and how many consecutive ones agree with it
        self._far: tuple[float, Point] | None = None
        self._far_count = 0
        self._frozen = False

    def accept(self, sample: Sample) -> tuple[Sample | None, Notice | None]:
        """Judge a sample; return it on a clock without jumps, and a notice of what is wrong with it, if anything is.

        Its position is None where that cannot be. None instead of the sample where its time cannot be, or is yet to be
        confirmed by the samples that follow.
        """
        sample, notice = sample._replace(time_s=sample.time_s + self._clock_offset_s), None
        last = self._last
        if last is not None:
            step_s = sample.time_s - last.time_s
            gap = step_s > GAP_S and step_s > GAP_STEPS * self._step_s
            # a step back, or far on, may be a clock that jumped: the samples that follow confirm it
            jump = self._jump(last, sample) if step_s <= 0 or gap else None
            if jump is not None:
                if not self._confirm(sample, step_s):
                    return None, jump
                sample, notice = self._reset_clock(last, sample, step_s)
            elif gap:
                notice = Notice("time_s", f"a gap of {step_s:.6g} s", "lines more often")
            self._step_s = sample.time_s - last.time_s
        self._last, self._off_clock, self._off_clock_count = sample, None, 0
        if self._first_charge is None and sample.soc is not None:
            self._first_charge = sample.time_s, sample.soc
        wrong = self._take_position(sample)
        if wrong is not None or self._frozen:
            return sample._replace(position_m=None), wrong or notice
        return sample, notice

    # --- the clock

    def _jump(self, last: Sample, sample: Sample) -> Notice | None:
        """A notice where the clock may have jumped, so that the time has to be confirmed; None where it has not.

        A time before the last sample's has to be confirmed, and a later one if it is far ahead, or if position and
        charge go on as if less time had passed.
        """
        step_s = sample.time_s - last.time_s
        if step_s <= 0:
            what = f"late: {sample.time_s:.15g} s is not after {last.time_s:.15g} s"
            return Notice("time_s", what, "a time after the last line's")
        goes_on = self._goes_on(sample, (self._off_clock_count + 1) * self._step_s)
        if step_s > MAX_GAP_S or (goes_on and not self._drained(last, sample)):
            expected = f"{MAX_GAP_S:g} s or less, or {MIN_AGREEING} lines in a row that agree"
            if step_s <= MAX_GAP_S:
                expected = f"a position as far on, or {MIN_AGREEING} lines in a row that agree"
            return Notice("time_s", f"{step_s:.6g} s after the last line", expected)
        return None

    def _drained(self, last: Sample, sample: Sample) -> bool:
        """Whether the charge has fallen by what the time between two samples, if true, has used at the mean rate."""
        if self._first_charge is None or last.soc is None or sample.soc is None or last.time_s <= self._first_charge[0]:
            return False
        # at the mean rate since the first sample
        (first_s, first_soc), step_s = self._first_charge, sample.time_s - last.time_s
        expected = (first_soc - last.soc) / (last.time_s - first_s) * step_s
        return last.soc - sample.soc > DRAINED_SHARE * expected > 0

    def _goes_on(self, sample: Sample, step_s: float) -> bool:
        """Whether the aircraft moves, and is near where a straight flight gets from the last position in `step_s`."""
        position, velocity = sample.position_m, self._velocity
        if self._located is None or position is None or velocity is None or not self._moving(sample):
            return False
        (x, y), (vx, vy) = self._located[1], velocity
        distance_m = math.dist(position, (x + step_s * vx, y + step_s * vy))
        return distance_m <= ON_SHARE * self._cruise_mps * step_s + ON_M

    def _confirm(self, sample: Sample, step_s: float) -> bool:
        """Count a sample that may be on a clock that jumped; return whether enough in a row agree that it has.

        `step_s` is its time after the last sample accepted, negative for one before it [s].
        """
        before, self._off_clock = self._off_clock, sample
        agrees = before is not None and 0 < sample.time_s - before.time_s <= max(GAP_S, GAP_STEPS * self._step_s)
        self._off_clock_count = self._off_clock_count + 1 if agrees else 1
        if step_s > 0:
            return self._off_clock_count >= MIN_AGREEING
        if -step_s <= GAP_S:  # a sample that was delayed
            return False
        # far back: sooner where the position goes on, as if usual steps had passed
        goes_on = self._goes_on(sample, self._off_clock_count * self._step_s)
        return self._off_clock_count >= (MIN_AGREEING if goes_on else MIN_BACK)

    def _reset_clock(self, last: Sample, sample: Sample, step_s: float) -> tuple[Sample, Notice]:
        """Set the clock's offset after a jump of `step_s`; return the sample on the corrected clock, and a notice.

        The time that has passed is that of as many usual steps as there were samples, or of the distance at cruise
        speed, if that is longer and the position does not go on straight.
        """
        usual_s = self._off_clock_count * max(self._step_s, 1e-3)
        way_s = 0.0
        if self._located is not None and sample.position_m is not None and not self._goes_on(sample, usual_s):
            way_s = math.dist(self._located[1], sample.position_m) / self._cruise_mps
        passed_s = max(usual_s, way_s)
        self._clock_offset_s += passed_s - step_s
        what = f"the clock has jumped by {step_s - passed_s:.6g} s"
        sample = sample._replace(time_s=last.time_s + passed_s, warnings=(*sample.warnings, CLOCK))
        return sample, Notice("time_s", what, "a clock that rises steadily")

    # --- the position

    def _take_position(self, sample: Sample) -> Notice | None:
        """Take a position as the reference of the next ones; return a notice if it cannot be, or is frozen from now on.

        While `_frozen` is set, which this updates, positions are not used, and there is no other notice.
        """
        position, time_s = sample.position_m, sample.time_s
        if position is None:
            return None
        if self._located is None:
            self._located = time_s, position
            return None
        since_s, (x, y) = self._located
        # the same as before, though the aircraft moves: frozen, once that has lasted
        if position == (x, y) and (self._frozen or self._moving(sample)):
            if time_s - since_s <= FROZEN_S or self._frozen:
                return None
            self._frozen = True
            return Notice("x_m", f"the position has not changed for {time_s - since_s:.6g} s", "a position that moves")
        self._frozen = False
        # too far off, unless enough in a row agree that the aircraft is there
        outlier = self._outlier(self._located, (time_s, position))
        if outlier is not None and not self._confirm_position((time_s, position)):
            return outlier
        if time_s > since_s:
            self._velocity = (position[0] - x) / (time_s - since_s), (position[1] - y) / (time_s - since_s)
        self._located, self._far, self._far_count = (time_s, position), None, 0
        return None

    def _moving(self, sample: Sample) -> bool:
        """Whether the aircraft moves, by the velocity measured or else that of the positions."""
        velocity = sample.velocity_mps or self._velocity
        return velocity is not None and math.hypot(*velocity) > MOVING_SHARE * self._cruise_mps

    def _confirm_position(self, now: tuple[float, Point]) -> bool:
        """Count a position too far off, with its time; return whether enough consecutive ones agree on where it is."""
        before, self._far = self._far, now
        agrees = before is not None and self._outlier(before, now) is None
        self._far_count = self._far_count + 1 if agrees else 1
        return self._far_count >= MIN_AGREEING

    def _outlier(self, before: tuple[float, Point], now: tuple[float, Point]) -> Notice | None:
        """A notice if a position, with its time, cannot be reached from the one before."""
        step_s, distance_m = now[0] - before[0], math.dist(before[1], now[1])
        if distance_m <= self._max_mps * step_s + SLACK_M:
            return None
        expected = f"a position that can be reached, or {MIN_AGREEING} lines in a row that agree"
        return Notice("x_m", f"{distance_m:.6g} m from the last line's position, {step_s:.6g} s before", expected)

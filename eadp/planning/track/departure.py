"""Whether an aircraft has left its plan: a pilot flies it, or it holds or returns."""

from __future__ import annotations

import math

from eadp.planning.base import Sample

FAR, NEAR, STAYS_S = 9.0, 4.0, 5.0
"""Square of the mismatch of position and course with the path, in standard deviations (`path_mismatch`), from which on
the plan is not flown: 45 m, or 86°; and that below which it has to stay for some time [s] to be flown again: circles
cross the path. In flights of the plant it is below 2."""

OTHER_SPEED, AIRSPEED_S, USUAL_S, LASTING_S = 0.2, 5.0, 60.0, 300.0
"""Difference of the airspeed from the usual one, as a share of that of the plan, from which on the plan is not flown;
and the time constants of both [s]: gusts are shorter, and an aircraft may always fly slower than its plan. Where that
is not known to be flown, another airspeed becomes usual later: it is a pilot's before it is the mission's."""

BY_HAND_S = 5.0
"""Time off the plan from which on a leg counts as flown by hand [s]: turns may be flown wide for a moment."""


class Departure:
    """Follows whether the plan is flown: by the autopilot's mode, else by the distance from the path; by the airspeed.

    Attributes
    ----------
    away : bool
        Whether the plan is not flown.
    away_s : float
        For how long [s].
    """

    def __init__(self) -> None:
        self.away, self.away_s = False, 0.0
        self._far, self._near_s = False, 0.0  # whether the path was left, and for how long it has been near again [s]
        # mean airspeeds as shares of the plan's: of the last seconds, and the usual one
        self._airspeed, self._usual = 1.0, 1.0
        self._last_s: float | None = None

    def update(self, sample: Sample, airspeed_mps: float, mismatch: float) -> None:
        """Update `away` with a sample.

        Parameters
        ----------
        sample : Sample
        airspeed_mps : float
            The plan's airspeed [m/s].
        mismatch : float
            Of position and course with the path, as `path_mismatch`; 0 where it is not known.
        """
        step_s = 0.0 if self._last_s is None else max(sample.time_s - self._last_s, 0.0)
        self._last_s = sample.time_s
        if sample.airspeed_mps is not None:
            share = sample.airspeed_mps / airspeed_mps
            self._airspeed -= math.expm1(-step_s / AIRSPEED_S) * (share - self._airspeed)
        self._near_s = self._near_s + step_s if mismatch <= NEAR else 0.0
        self._far = mismatch > FAR or (self._far and self._near_s < STAYS_S)
        far = self._far if sample.flies_mission is None else not sample.flies_mission
        self.away = far or abs(self._airspeed - self._usual) > OTHER_SPEED
        self.away_s = self.away_s + step_s if self.away else 0.0
        usual_s = LASTING_S if self.away and not sample.flies_mission else USUAL_S
        self._usual -= math.expm1(-step_s / usual_s) * (self._airspeed - self._usual)

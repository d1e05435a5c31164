"""Whether an aircraft has left its plan: a pilot flies it, or it holds or returns."""

from __future__ import annotations

import math

from eadp.planning.base import Sample

FAR = 9.0
"""Square of the mismatch of position and course with the path, in standard deviations, from which on the plan is not
flown: 45 m, or 86° (`path_mismatch`). In flights of the plant it is below 2."""

OTHER_SPEED, AIRSPEED_S, USUAL_S = 0.2, 5.0, 60.0
"""Difference of the airspeed from the usual one, as a share of that of the plan, from which on the plan is not flown;
and the time constants of both [s]: gusts are shorter, and an aircraft may always fly slower than its plan."""

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
        # mean airspeeds as shares of the plan's: of the last seconds, and while the plan is flown
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
        far = mismatch > FAR if sample.flies_mission is None else not sample.flies_mission
        self.away = far or abs(self._airspeed - self._usual) > OTHER_SPEED
        self.away_s = self.away_s + step_s if self.away else 0.0
        if not self.away:
            self._usual -= math.expm1(-step_s / USUAL_S) * (self._airspeed - self._usual)

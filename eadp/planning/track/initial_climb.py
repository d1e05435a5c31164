"""Whether a flight has reached its plan: a take-off has its own power and airspeed, and no plan holds for it."""

from __future__ import annotations

from eadp.planning.base import Sample

ON_GROUND = 0.5
"""Share of the airspeed of cruise below which no aeroplane flies."""

NEAR_M, NEAR_SHARE, STAYS_S = 10.0, 0.1, 5.0
"""How near altitude [m] and airspeed, as a share, are to the plan's once it is reached, and for how long [s]."""

SLOWEST_MPS, MAX_S = 1.0, 120.0
"""The slowest climb [m/s]: what changes its altitude by less flies level; and the longest take-off [s]: what holds
another airspeed by then goes on doing so."""


class InitialClimb:
    """Follows a take-off by the altitude and the airspeed, as far as they are measured.

    Parameters
    ----------
    first : Sample
        The first of the flight.
    cruise_mps : float
        Airspeed of cruise [m/s].
    altitude_m : float
        The plan's at its start [m].

    Attributes
    ----------
    from_ground : bool
        Whether the flight started on the ground.
    on_plan : bool
        Whether the plan is reached; it stays reached.
    """

    def __init__(self, first: Sample, cruise_mps: float, altitude_m: float) -> None:
        self._cruise_mps, self._start_s = cruise_mps, first.time_s
        airspeed_mps = cruise_mps if first.airspeed_mps is None else first.airspeed_mps
        self.from_ground = airspeed_mps < ON_GROUND * cruise_mps
        # the altitude of level flight [m], and since when it is held [s]; since when the flight is near its plan [s]
        self._level_m, self._level_s = first.altitude_m or 0.0, first.time_s
        self._near_s: float | None = None
        self.on_plan = not self.from_ground and self._update_near(first, altitude_m)

    def update(self, sample: Sample, altitude_m: float) -> None:
        """Update `on_plan` with a sample, beside the plan's altitude at it [m]."""
        if self.on_plan:
            return
        if not self._update_near(sample, altitude_m):
            self._near_s = None
        elif self._near_s is None:
            self._near_s = sample.time_s
        stays = self._near_s is not None and sample.time_s - self._near_s >= STAYS_S
        self.on_plan = stays or sample.time_s - self._start_s > MAX_S

    def _update_near(self, sample: Sample, altitude_m: float) -> bool:
        """Note the altitude of a sample; return whether the flight is near its plan, as far as this is measured.

        That is at cruise airspeed, and at the plan's altitude [m] or at another one that it holds. Where no altitude is
        measured, it is at the plan's once the slowest climb has got there.
        """
        near = sample.airspeed_mps is None or abs(sample.airspeed_mps / self._cruise_mps - 1) <= NEAR_SHARE
        if sample.altitude_m is None:
            return near and (not self.from_ground or (sample.time_s - self._start_s) * SLOWEST_MPS >= altitude_m)
        if abs(sample.altitude_m - self._level_m) > SLOWEST_MPS * STAYS_S:
            self._level_m, self._level_s = sample.altitude_m, sample.time_s
        held = sample.altitude_m > NEAR_M and sample.time_s - self._level_s >= STAYS_S
        return near and (held or abs(sample.altitude_m - altitude_m) <= NEAR_M)

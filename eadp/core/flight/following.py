"""Altitudes that an aircraft is commanded along a path, so that it stays above a floor and below a ceiling.

A commanded altitude holds for a part of the path. A model follows it at once, as fast as it can; autopilots spread the
change over the part. Both keep to the floor.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from eadp.core.arrays import BoolArray, FloatArray
from eadp.core.flight.aerodynamics import RATE_SHARE
from eadp.errors import Unreachable

LEVEL_M = 0.25
"""Commanded altitudes are multiples of this [m]: errors of barometers and maps are larger."""

RECOVERY_S = 30.0
"""Time within which one command leads back below the ceiling [s]: a descent at the greatest rate gains 10 m or so."""

ROUNDING_M = 1e-6

REACHED_SHARE = 0.98
"""Share of a height at which a climb to it is over: pixels there are 2 % smaller."""


class Climbing(NamedTuple):
    """How an aircraft takes another altitude: greatest rates [m/s], and that for an error of altitude [1/s]."""

    up_mps: float
    down_mps: float
    gain_per_s: float

    def reached_s(self, height_m: float) -> float:
        """Time in which a climb by a height is over, with `RATE_SHARE` of the greatest rate [s]."""
        up_mps, left_m = RATE_SHARE * self.up_mps, (1 - REACHED_SHARE) * height_m
        # at the rate down to an error of ḣ/k, from where on the error falls as e^(−k t)
        near_m = min(max(up_mps / self.gain_per_s, left_m), height_m)
        return (height_m - near_m) / up_mps + math.log(near_m / left_m) / self.gain_per_s

    def followed_m(self, altitude_m: FloatArray, commanded_m: FloatArray, seconds: float) -> FloatArray:
        """Altitudes after a time with commanded ones [m]."""
        # ḣ = k (h_c − h) within the rates
        closed = -np.expm1(-self.gain_per_s * seconds) * (commanded_m - altitude_m)
        return np.asarray(altitude_m + np.clip(closed, -self.down_mps * seconds, self.up_mps * seconds))


class Band(NamedTuple):
    """Where a flight along samples of a path may be, shape (n,); times of the ways between them, shape (n − 1,).

    `may_end` says where another altitude may be commanded.
    """

    places_m: FloatArray
    seconds: FloatArray
    floor_m: FloatArray
    ceiling_m: FloatArray
    may_end: BoolArray


def min_profile_m(floor_m: FloatArray, up_m: FloatArray, down_m: FloatArray) -> FloatArray:
    """The lowest profile at or above a floor that climbs and descends no more than it can.

    Parameters
    ----------
    floor_m : array, shape (n,)
    up_m, down_m : array, shape (n − 1,)
        Greatest climb and descent from each sample to the next [m].

    Returns
    -------
    array, shape (n,)
        Of all such profiles the lowest at every sample.
    """
    up, down = (np.concatenate([[0.0], np.cumsum(each)]) for each in (up_m, down_m))
    # z_i = max over j ≥ i of f_j − (U_j − U_i), then over j ≤ i of z_j − (D_i − D_j)
    climbed = np.maximum.accumulate((floor_m - up)[::-1])[::-1] + up
    return np.asarray(np.maximum.accumulate(climbed + down) - down)


def banded(band: Band, climbing: Climbing, room_m: float) -> Band:
    """A band that an aircraft can stay within: floor and ceiling change no faster than it can, `room_m` apart [m]."""
    up_m, down_m = (RATE_SHARE * rate * band.seconds for rate in (climbing.up_mps, climbing.down_mps))
    floor_m = min_profile_m(band.floor_m, up_m, down_m)
    ceiling_m = np.maximum(band.ceiling_m, floor_m + room_m)
    down = np.concatenate([[0.0], np.cumsum(down_m)])
    # a descent to a lower ceiling starts in time: c_i = min over j ≥ i of c_j + (D_j − D_i)
    ceiling_m = np.minimum.accumulate((ceiling_m + down)[::-1])[::-1] - down
    return band._replace(floor_m=floor_m, ceiling_m=ceiling_m)


def commanded(
    band: Band, climbing: Climbing, hard_floor_m: FloatArray, start_m: float | None = None
) -> list[tuple[int, float]]:
    """Altitudes to command along a band, each as far as it can hold.

    Parameters
    ----------
    band : Band
        As `banded` makes it.
    climbing : Climbing
    hard_floor_m : array, shape (n,)
        What a straight climb or descent from one command's end to the next one's stays above, too [m].
    start_m : float, optional
        Altitude at the first sample [m]; by default the first one commanded.

    Returns
    -------
    list of (int, float)
        The sample at which each command ends, and the altitude [m].

    Raises
    ------
    Unreachable
        Of the sample from which on the floor rises faster than the aircraft.
    """
    last, found = len(band.places_m) - 1, list[tuple[int, float]]()
    top_m = float(np.max(band.ceiling_m, initial=float(band.floor_m.max()), where=np.isfinite(band.ceiling_m)))
    levels_m = LEVEL_M * np.arange(np.floor(band.floor_m.min() / LEVEL_M), np.ceil(top_m / LEVEL_M) + 1)
    # at its greatest rate an aircraft climbs where it is commanded so much more
    levels_m = np.concatenate(
        [levels_m, levels_m[-1] + np.arange(LEVEL_M, climbing.up_mps / climbing.gain_per_s, LEVEL_M)]
    )
    i, here_m, before_m = 0, start_m, start_m
    while i < last:
        # where it cannot stay in the band, it is above the ceiling for a while, but not below the floor
        given = band, climbing, hard_floor_m, levels_m, i, here_m, before_m
        best = _farthest(*given) or _farthest(*given, above=True)
        if best is None:
            raise Unreachable(i, f"no climb from {band.places_m[i]:.0f} m of the way on stays above the ground")
        i, before_m, here_m = best
        found.append((i, before_m))
    return found


def _farthest(
    band: Band,
    climbing: Climbing,
    hard_floor_m: FloatArray,
    levels_m: FloatArray,
    start: int,
    here_m: float | None,
    before_m: float | None,
    *,
    above: bool = False,
) -> tuple[int, float, float] | None:
    """Where the command that holds farthest from a sample ends, its altitude, and that of the aircraft there [m].

    From `above` the ceiling it is the one that is first below it, or else the shortest.
    """
    levels_m = levels_m if before_m is not None else levels_m[levels_m >= band.floor_m[start] - ROUNDING_M]
    flown_m = levels_m if here_m is None else np.full(len(levels_m), here_m)
    best, steepest = None, -np.inf
    for end in range(start + 1, len(band.places_m)):
        flown_m = climbing.followed_m(flown_m, levels_m, float(band.seconds[end - 1]))
        below = flown_m <= band.ceiling_m[end] + ROUNDING_M
        kept = (flown_m >= band.floor_m[end] - ROUNDING_M) & (below | above)
        levels_m, flown_m, below = levels_m[kept], flown_m[kept], below[kept]
        if not len(levels_m):
            break
        way_m = band.places_m[end] - band.places_m[start]
        min_m = hard_floor_m[end]
        if before_m is not None:
            steepest = max(steepest, (hard_floor_m[end] - before_m) / way_m)
            min_m = before_m + steepest * way_m
        # no command is so far from the flight that its greatest rate alone keeps it in the band
        beyond = climbing.gain_per_s * (levels_m - flown_m)
        fit = (levels_m >= min_m - ROUNDING_M) & (beyond <= climbing.up_mps) & (beyond >= -climbing.down_mps)
        if above and float(band.seconds[start:end].sum()) > RECOVERY_S and best is not None:
            break
        back = fit & below if above else fit
        if band.may_end[end] and (back.any() or (fit.any() and best is None)):
            k = int(np.argmax(back if back.any() else fit))  # the lowest
            best = end, float(levels_m[k]), float(flown_m[k])
            if above and back[k]:
                break
    return best

"""A flight as it was flown over the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple


class FlownTrack(NamedTuple):
    """Where a recorded flight was, and where it took pictures.

    Attributes
    ----------
    rows : sequence of (float, float, float)
        Times [s] and positions x, y [m].
    camera_on : sequence of bool
        Whether the camera was on at each; on throughout where the recording does not say.
    pictures : sequence of int
        Rows at which pictures were taken; empty where the recording has none.
    """

    rows: Sequence[tuple[float, float, float]]
    camera_on: Sequence[bool]
    pictures: Sequence[int] = ()

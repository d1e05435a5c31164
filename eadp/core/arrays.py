"""Array types, and readings as columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import NDArray

from eadp.core.compiled import enabled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

Column = Sequence[float] | FloatArray


def columns(*readings: Column) -> list[Any]:
    """Readings for a function that may be compiled: arrays where it is compiled, else lists or what they are.

    Parameters
    ----------
    *readings : sequence of float or array, shape (n,)
    """
    if enabled():
        return [np.asarray(each, dtype=float) for each in readings]
    # Python calculates with its own floats faster than with numpy's
    return [each.tolist() if isinstance(each, np.ndarray) else each for each in readings]


def upper_envelope(x: FloatArray, y: FloatArray, tolerance: float = 1e-15) -> list[int]:
    """Indices of the vertices of the upper concave envelope, from the first point on while y rises.

    Parameters
    ----------
    x, y : array, shape (n,)
        Points in ascending order of x; of equal x, in descending order of y.
    tolerance : float
        A rise of y up to this counts as none.
    """
    xs, ys = x.tolist(), y.tolist()
    kept: list[int] = []
    for i in range(len(xs)):
        if kept and ys[i] <= ys[kept[-1]] + tolerance:
            continue
        # a vertex below the chord from the one before it to this one is not on the envelope
        while len(kept) > 1:
            a, b = kept[-2], kept[-1]
            if (ys[b] - ys[a]) * (xs[i] - xs[a]) > (ys[i] - ys[a]) * (xs[b] - xs[a]) * (1 + 1e-12):
                break
            kept.pop()
        kept.append(i)
    return kept


Positive = Annotated[float, Gt(0)]
NotNegative = Annotated[float, Ge(0)]
Finite = Annotated[float, Ge(-1e9), Le(1e9)]
Share = Annotated[float, Ge(0), Le(1)]
Efficiency = Annotated[float, Gt(0), Le(1)]
Degrees = Annotated[float, Ge(-360), Le(360)]
Latitude = Annotated[float, Ge(-90), Le(90)]
Longitude = Annotated[float, Ge(-180), Le(180)]
Coordinate = Annotated[float, Ge(-1e7), Le(1e7)]
Seconds = Annotated[float, Ge(0), Le(1e9)]
Duration = Annotated[float, Gt(0), Le(1e9)]
Watts = Annotated[float, Ge(0), Le(1e6)]
MetresPerSecond = Annotated[float, Ge(0), Le(100)]
"""Wind: the fastest gust measured near the ground is 113 m/s, of a cyclone."""
Altitude = Annotated[float, Ge(-1e3), Le(3e4)]
"""From below the lowest land to above the highest flights on propellers."""
Reserve = Annotated[float, Ge(0), Lt(1)]

"""Array types, and readings as columns."""

from collections.abc import Sequence
from typing import Any

import numpy as np
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

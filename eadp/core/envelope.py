"""Upper concave envelope of points."""

from __future__ import annotations

from eadp.core.arrays import FloatArray


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

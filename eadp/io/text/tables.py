"""Tables for people."""

from __future__ import annotations

from collections.abc import Sequence


def aligned(rows: Sequence[Sequence[str]], first: str = ">", others: str = ">") -> list[str]:
    """Lines of a table; `first` is the alignment of the first column, `others` that of the rest: < or >."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = [first, *others * (len(widths) - 1)]
    return [
        "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths, strict=True)).rstrip()
        for row in rows
    ]

"""What several tests need: plans, a planner that is watched."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[3]
"""The repository's root."""


def few(values: Iterable[Any], count: int) -> list[Any]:
    """Cases of one kind, as seeds are, for `parametrize`: `count`, spread evenly, and the others marked slow."""
    cases = list(values)
    kept = {round(i * (len(cases) - 1) / max(count - 1, 1)) for i in range(count)}
    return [case if i in kept else pytest.param(case, marks=pytest.mark.slow) for i, case in enumerate(cases)]

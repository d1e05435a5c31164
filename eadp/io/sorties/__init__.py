"""Sorties: a field divided among flights, their folder, their flights, and what is left of it."""

from pathlib import Path

SORTIES, SORTIES_SCENARIO = "sorties.json", "scenario.yaml"
"""Files of a folder of sorties: what was planned, and the scenario that flies it."""


def is_sorties(path: str) -> bool:
    """Whether a path is a folder of sorties."""
    return "\0" not in path and (Path(path) / SORTIES).is_file()

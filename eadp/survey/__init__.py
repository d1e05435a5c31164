"""Sorties: a field divided among flights, their folder, their flights, and what is left of it."""

import os

SORTIES, SORTIES_SCENARIO = "sorties.json", "scenario.yaml"
"""Files of a folder of sorties: what was planned, and the scenario that flies it."""


def is_sorties(path: str) -> bool:
    """Whether a path is a folder of sorties."""
    return os.path.isfile(os.path.join(path, SORTIES)) if "\0" not in path else False

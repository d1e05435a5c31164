"""Options that several commands share."""

from __future__ import annotations


def names_in(raw: str) -> list[str]:
    """The names of an option that lists them, separated by commas."""
    return [name.strip() for name in raw.split(",")] if raw else []

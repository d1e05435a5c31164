"""Columns as a table of the library for tables that is installed: a notebook's manners."""

from __future__ import annotations

import html
import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

LIBRARIES = (("pandas", "DataFrame"), ("polars", "DataFrame"), ("pyarrow", "table"))
"""Libraries for tables, the first that is installed is used, and what makes a table of a mapping of columns."""


class AnyTable(Protocol):
    """A table of pandas, polars or Arrow, or a dict of lists: a column by its name."""

    def __getitem__(self, name: str, /) -> Any: ...


def frame(columns: Mapping[str, Any]) -> AnyTable:
    """A table of columns: of pandas, else polars, else Arrow; without any of these a dict of lists."""
    for library, name in LIBRARIES:
        try:
            make: Callable[[Any], AnyTable] = getattr(importlib.import_module(library), name)
        except ImportError:
            continue
        return make(dict(columns))
    return {name: list(values) for name, values in columns.items()}


def html_table(rows: Sequence[Sequence[str]]) -> str:
    """Names and texts as a table of HTML."""
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in rows)
    return f"<table>{cells}</table>"

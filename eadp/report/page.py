"""One self-contained HTML page: the data as JSON that is never executed, style, scripts, the chart library."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from eadp import __version__
from eadp.api.flight import REPORT
from eadp.errors import InputError

SCHEMA = "eadp.report/1"
GENERATOR = b'<meta name="generator" content="eadp'
HEAD_BYTES = 1000
"""The mark of a page of eadp is within its first bytes."""

_ESCAPES = {ord("<"): "\\u003c", ord(">"): "\\u003e", ord("&"): "\\u0026"}


def page_html(kind: str, data: Mapping[str, Any]) -> str:
    """The page of a `kind`, flight or sweep, with its data.

    The page's policy for contents names its own scripts by their hashes, so that a browser runs no other.
    """
    scripts = [_asset("uPlot.iife.min.js"), _asset("common.js"), _asset(f"{kind}.js")]
    styles = [_asset("uPlot.min.css"), _asset("page.css")]
    policy = f"default-src 'none'; script-src {_hashes(scripts)}; style-src {_hashes(styles)}; img-src data: blob:"
    return _filled(
        _asset("page.html"),
        version=__version__,
        policy=policy,
        styles="".join(f"<style>{style}</style>\n" for style in styles),
        licence=_asset("uPlot.LICENSE"),
        body=_asset(f"{kind}.html"),
        data=data_json({"schema": SCHEMA, "kind": kind, "version": __version__, **data}),
        scripts="".join(f"<script>{script}</script>\n" for script in scripts),
    )


def data_json(data: Mapping[str, Any]) -> str:
    """JSON in ASCII without <, > and &, which means the same and ends no block of HTML."""
    return json.dumps(data, allow_nan=False, separators=(",", ":")).translate(_ESCAPES)


def check_page(path: Path) -> None:
    """Refuse a name that a file has which is no page of eadp.

    Raises
    ------
    InputError
        At 1:1.
    """
    try:
        with path.open("rb") as stream:
            ours = GENERATOR in stream.read(HEAD_BYTES)
    except (OSError, ValueError):  # no file, or one whose writing will fail
        return
    if not ours:
        raise InputError.at(str(path), 1, 1, "exists already, and is no page of eadp", "another name")


@cache
def _asset(name: str) -> str:
    return (files("eadp.report") / "assets" / name).read_text(encoding="utf-8")


def _hashes(blocks: Sequence[str]) -> str:
    digests = (base64.b64encode(hashlib.sha256(block.encode()).digest()).decode() for block in blocks)
    return " ".join(f"'sha256-{digest}'" for digest in digests)


def _filled(template: str, **parts: str) -> str:
    """A template with its `{{parts}}`, which are not searched for more."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def page_of(result: str) -> Path:
    """Where the page of a result goes by default."""
    path = Path(result)
    if os.path.isdir(path):
        return path / REPORT
    return path.with_name(f"{path.name}.html") if path.suffix == ".html" else path.with_suffix(".html")

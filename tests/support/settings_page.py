"""docs/scenario.md from the schemas and the cameras: python tests/support/settings_page.py > docs/scenario.md"""

import json
import sys
from collections.abc import Iterator
from typing import Any

from eadp.io import scenario as scenario_file
from eadp.io.text.yaml import properties, schema_of
from eadp.io.vehicle import VehicleFile
from eadp.survey.camera import CAMERAS, read_camera

HEAD = """\
# Scenario and vehicle files

Every key of a scenario (`eadp simulate --scenario`) and of a vehicle file (`vehicle:` in a scenario), with its default,
its values and its meaning. The page is generated from the schemas that `eadp schema scenario` and `eadp schema vehicle`
print; editors can check and complete files with those.

- Every key has a default that flies. A key that is null is an absent key. Unknown keys are errors.
- `--set key=value` overrides a key, as in `--set wind.speed_mps=8` or `--set battery.capacity_ah=1.2`; `c1=-500` is
  short for `parameters.c1=-500`. A sweep varies the same keys.
- `vehicle:` is the path of a vehicle file, relative to the scenario, or its content. The scenario's `battery:`,
  `--set vehicle.airframe.…` and `--set battery.…` override it key by key; null restores a default. Without `vehicle:`
  the aircraft is that of [vehicles/survey-wing.yaml](../vehicles/survey-wing.yaml).
- Headings are compass bearings: 0 north, 90 east. `wind.from_deg` is where the wind comes from: a west wind is from 270
  and drifts the aircraft east. `wind.towards_deg`, the papers' angle (0 east, counter-clockwise), may be given instead;
  `--set` or a sweep that sets one removes the other.
- `airframe` takes the keys of its `model` alone.
"""
OF_THE_VEHICLE = ("vehicle", "battery")


def pages() -> Iterator[str]:
    """The lines of docs/scenario.md."""
    yield HEAD
    scenario, vehicle = scenario_file.json_schema(), schema_of(VehicleFile)
    yield from section("Scenario", scenario, scenario, (), OF_THE_VEHICLE)
    yield from section("Vehicle", vehicle, vehicle, (), ())
    yield from cameras()


def cameras() -> Iterator[str]:
    """A table of the cameras that have a name."""
    yield "\n## Cameras\n\nWhat `eadp cover --camera NAME` knows; each file in `eadp/presets/cameras` has its source.\n"
    yield "| camera | sensor [mm] | picture [pixels] | lens [mm] | interval [s] |\n|---|---|---|---|---|"
    for name in CAMERAS:
        known = read_camera(name)
        interval = "" if known.picture_interval_s is None else f"{known.picture_interval_s:g}"
        size = f"{known.sensor_width_mm:g} × {known.sensor_height_mm:g}"
        pixels = f"{known.image_width_px} × {known.image_height_px}"
        yield f"| `{name}` | {size} | {pixels} | {known.focal_length_mm:g} | {interval} |"


def section(
    title: str, schema: dict[str, Any], node: dict[str, Any], path: tuple[str, ...], elsewhere: tuple[str, ...]
) -> Iterator[str]:
    """A table of a node's keys, then one of each of its sections."""
    yield f"\n{'#' * min(2 + len(path), 4)} {title}\n"
    yield "| key | default | values | meaning |\n|---|---|---|---|"
    inner = []
    for name, child in properties(schema, node):
        rows = list(properties(schema, items_of(child)))
        if rows:
            inner.append((name, child))
        yield f"| `{name}` | {default(child, rows)} | {values(child, rows)} | {cell(child['description'])} |"
    for name, child in inner:
        if name in elsewhere:
            continue
        below = (*path, name)
        for member in child.get("oneOf", [items_of(child)]):
            keys = dict(properties(schema, member))
            model = keys.get("model", {}).get("const")
            each = ", each of a list" if child.get("type") == "array" else ""
            each = ", by name" if "patternProperties" in child else each
            shown = f"`{'.'.join(below)}`{each}"
            yield from section(f"{shown} of model {model}" if model else shown, schema, member, below, ())


def items_of(node: dict[str, Any]) -> dict[str, Any]:
    """What a list holds, else the node itself."""
    items = node.get("items")
    return items if isinstance(items, dict) and "$ref" in items else node


def default(node: dict[str, Any], rows: list[Any]) -> str:
    """A key's default."""
    value = node.get("default")
    if value is None or rows or value in ("", []):
        return "–"
    return f"`{value:.6g}`" if isinstance(value, float) else f"`{json.dumps(value)}`".replace('"', "")


def values(node: dict[str, Any], rows: list[Any]) -> str:
    """The values a key may take."""
    if rows:
        one = "by name: a section" if "patternProperties" in node else "a section"
        return "a list" if node.get("type") == "array" else one
    return one_of(node)


def one_of(node: dict[str, Any]) -> str:
    """The values that a key or a part of it may take."""
    if "anyOf" in node:
        return " or ".join(one_of(member) for member in node["anyOf"] if member.get("type") != "null")
    if "const" in node or "enum" in node:
        return ", ".join(f"`{value}`" for value in node.get("enum", [node.get("const")]))
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    bounds = ", ".join(f"{sign} {node[key]:g}" for key, sign in signs.items() if key in node)
    if node["type"] == "object":
        inner = node.get("additionalProperties") or next(iter(node["patternProperties"].values()))
        return "a section" if inner is True else f"by name: {one_of(inner)}"
    if node["type"] == "array":
        parts = node.get("prefixItems") or [node["items"]]
        more = "" if "prefixItems" in node else "; …"
        return "[" + "; ".join(one_of(part) for part in parts) + more + "]"
    kinds = {"boolean": "true or false", "string": "text", "integer": "whole number", "number": "number"}
    return f"{kinds[node['type']]} {bounds}".strip()


def cell(text: str) -> str:
    """Text as it may stand in a table."""
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    sys.stdout.write("\n".join(pages()) + "\n")

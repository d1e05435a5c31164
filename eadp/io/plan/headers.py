"""The headers of a plan, `%: key text`: one table by which they are read and written.

Source: draft 002, Appendix II, in whose readers a header is a comment.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

from eadp.core.expressions.reader import read_expression, read_expressions
from eadp.core.expressions.tree import number_text
from eadp.core.geometry.curves import Point
from eadp.errors import ExpressionError, PathUndefined, printable
from eadp.models.airspace import CLEARANCE_M, Obstacle
from eadp.models.plan.plan import TRIGGER_RADIUS_M, MadeFor, Plan, SurveyCamera
from eadp.models.plan.stage import Box, Title

_HEADER_SET = re.compile(r"\s*(c[1-9][0-9]{0,2})\s*(\[[^\]]*\])\s*(,|\Z)")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z")
_CORNER = re.compile(r"{0},{0}\Z".format(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"))
_HEIGHT = re.compile(r"(?:^|\s)height\s+(\S+)\Z")
NO_HEIGHT = "none"
_CORNERS = "0,0 100,0 100,50"
_MADE_FOR = re.compile(r"(.*?) ?airspeed (\S+) wind (\S+?),? (\S+)\Z")
_CAMERA = re.compile(r"(.*?) ?\baltitude (\S+)(?: gsd (\S+))?\Z")

LARGEST = 1e9
RADIUS: tuple[str, Callable[[float], bool]] = ("a radius above 0 m", lambda value: value > 0)
_HEIGHT_M: tuple[str, Callable[[float], bool]] = ("metres, like 120", lambda value: abs(value) <= LARGEST)
_ABOVE_SEA = "metres above the sea, like 120", _HEIGHT_M[1]


class Header(NamedTuple):
    """A header, or several lines of it.

    Attributes
    ----------
    read : function or None
        Its text as a value; raises ExpressionError. None where the plan's reader does it.
    lines : function
        The lines of a plan: key and text; none where those of another header have it.
    attribute : str
        Of the plan, or of its `site.`; '' where the value becomes one with others.
    """

    read: Callable[[str], Any] | None
    lines: Callable[[Plan], Iterable[str]] = lambda _plan: ()
    attribute: str = ""


# --- reading, which raises ExpressionError at an offset


def read_number(text: str, expected: str, valid: Callable[[float], bool]) -> float:
    """A number that is valid, which may be written as an expression."""
    try:
        expression = read_expression(text)
    except ExpressionError as error:
        raise _expecting(error, expected) from None
    offset = len(text) - len(text.lstrip())
    if expression.names:
        raise ExpressionError(offset, f"{printable(text.strip(), 40)} is not a number", expected)
    value = expression.value({})
    if not valid(value):
        raise ExpressionError(offset, f"{number_text(value)} cannot stand here", expected)
    return value


def _expecting(error: ExpressionError, expected: str, start: int = 0) -> ExpressionError:
    """The same error, of a text that starts at an offset, with more of what is expected."""
    what = f"{error.expected} ({expected})" if error.expected else expected
    return ExpressionError(start + error.offset, error.message, what)


def numbers(text: str, count: int, expected: str) -> tuple[float, ...]:
    """Numbers, separated by blanks or commas."""
    values = _floats(text)
    if len(values) != count or not all(abs(value) <= LARGEST for value in values):
        raise ExpressionError(0, f"{len(text.replace(',', ' ').split())} words here, or no numbers", expected)
    return values


def _floats(text: str) -> tuple[float, ...]:
    """Numbers, separated by blanks or commas; none where one cannot be read."""
    try:
        return tuple(map(float, text.replace(",", " ").split()))
    except ValueError:
        return ()


def read_box(text: str, which: str = "", start: int = 0) -> Box:
    """A set; `start` is the offset of its text in the line."""
    expected = f"a set like [2, 10]{which}"
    stripped = text.strip()
    offset = start + len(text) - len(text.lstrip())
    if not (stripped.startswith("[") and stripped.endswith("]")):
        raise ExpressionError(offset, "a set without its closing bracket", expected)
    try:
        values = [part.value({}) for part in read_expressions(stripped[1:-1], count=2)]
    except ExpressionError as error:
        raise _expecting(error, expected, offset + 1) from None
    except PathUndefined:
        raise ExpressionError(offset + 1, "a set whose bounds are not numbers", expected) from None
    if values[0] > values[1]:
        low, high = map(number_text, values)
        what = f"a set whose lower bound {low} is above its upper bound {high}"
        raise ExpressionError(offset, what, "lower bound first")
    return Box(*values)


def named_unit(text: str) -> tuple[str, str]:
    """The name and the unit of `keysize [bit]`; no name where it is none, or a bracket is open."""
    # no pattern for the whole: one with several runs of spaces backtracks for minutes over a long line
    name, bracket, unit = text.strip().partition("[")
    known = _NAME.match(name.rstrip()) and (not bracket or unit.endswith("]"))
    return (name.rstrip() if known else "", unit.removesuffix("]").strip())


def _computations(text: str) -> tuple[tuple[str, str], ...]:
    """Names and units."""
    result: dict[str, str] = {}
    offset = 0
    for part in text.split(","):
        name, unit = named_unit(part)
        if not name or name in result:
            raise ExpressionError(offset, "a computation without a name of its own", "names like fps, keysize [bit]")
        result[name] = unit
        offset += len(part) + 1
    return tuple(result.items())


def _sets(text: str) -> dict[int, Box]:
    """Sets by the index of their parameter."""
    result: dict[int, Box] = {}
    position = 0
    while text[position:].strip():
        match = _HEADER_SET.match(text, position)
        if not match:
            raise ExpressionError(position, "no set", "sets like c1 [-1000, 0], c2 [2, 10]")
        index = int(match[1][1:])
        if index in result:
            raise ExpressionError(match.start(1), f"{match[1]} stands twice", "it once")
        result[index] = read_box(match[2], start=match.start(2))
        position = match.end()
    return result


def _origin(text: str) -> tuple[float, float]:
    values = _floats(text)
    latitude, longitude = values if len(values) == 2 else (math.nan, math.nan)
    if not (-90 <= latitude <= 90 and -180 <= longitude <= 180):
        swapped = 90 < abs(latitude) <= 180 and abs(longitude) <= 90
        what = "no origin: latitude and longitude seem to be swapped" if swapped else "no origin"
        raise ExpressionError(0, what, "a latitude and a longitude in degrees, like 55.37 10.43")
    return latitude, longitude


def _named_numbers(pattern: re.Pattern[str], largest: float, message: str, expected: str, text: str) -> list[Any]:
    """A name, then numbers."""
    found = pattern.match(" ".join(text.split()))  # of runs of blanks each would be tried from everywhere
    name, *words = found.groups() if found else ("",)
    values = _floats(" ".join(word for word in words if word is not None))
    if not values or not all(abs(value) <= largest for value in values):
        raise ExpressionError(0, message, expected)
    return [name, *values]


def _made_for(text: str) -> MadeFor:
    expected = "like survey wing airspeed 15 wind 6 270"
    return MadeFor(*_named_numbers(_MADE_FOR, 1e4, "no aircraft, airspeed and wind", expected, text))


def _camera(text: str) -> SurveyCamera:
    message, expected = "no camera, altitude and pixel size", "like Sony a6000 20 mm altitude 102.1 gsd 2"
    name, altitude_m, *rest = _named_numbers(_CAMERA, 1e5, message, expected, text)
    if min(altitude_m, *rest, 1.0) <= 0:
        raise ExpressionError(0, message, expected)
    return SurveyCamera(name, altitude_m, rest[0] if rest else None)


def _ring(text: str) -> tuple[Point, ...]:
    """The corners of a part of the field, or of a hole in it: `x y, x y, …`."""
    return _polygon(text.split(","), "0 0, 100 0, 100 50")


def _polygon(texts: Sequence[str], form: str) -> tuple[Point, ...]:
    corners = [_floats(text) for text in texts]
    if len(corners) < 3 or not all(len(each) == 2 and max(map(abs, each)) <= LARGEST for each in corners):
        raise ExpressionError(0, "no corners of an area", f"three or more in metres, like {form}")
    return tuple((x, y) for x, y in corners)


def _obstacle(text: str) -> Obstacle:
    """`NAME height H x,y x,y …`, name and height left out or not."""
    words = text.split()
    # the corners are behind the last word that is none: a name may have commas, too
    first = next((i for i in range(len(words), 0, -1) if not _CORNER.match(words[i - 1])), 0)
    label, ring = " ".join(words[:first]), _polygon(words[first:], _CORNERS)
    height = _HEIGHT.search(label)
    expected = "a height above the origin, from 0 to 1e5 m"
    height_m = None
    if height and height[1] != NO_HEIGHT:
        height_m = read_number(height[1], expected, lambda value: 0 <= value <= 1e5)
    return Obstacle(ring, label[: height.start()] if height else label, height_m)


# --- writing


def _texts(values: Sequence[float], mark: str = " ") -> str:
    return mark.join(map(number_text, values))


def _corners(points: Sequence[Point]) -> str:
    return " ".join(_texts(point, ",") for point in points)


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _computations_text(computations: Sequence[tuple[str, str]]) -> str:
    return ", ".join(_with_unit(*each) for each in computations)


def _title_text(title: Title) -> str:
    return _with_unit(title.name, title.unit) + (f" = {title.stands_for.text}" if title.stands_for else "")


def _made_for_text(made: MadeFor) -> str:
    name = f"{made.vehicle} " if made.vehicle else ""
    return f"{name}airspeed {number_text(made[1])} wind {_texts(made[2:])}"


def _camera_text(camera: SurveyCamera) -> str:
    name = f"{camera.name} " if camera.name else ""
    size = "" if camera.gsd_cm is None else f" gsd {number_text(camera.gsd_cm)}"
    return f"{name}altitude {number_text(camera.altitude_m)}{size}"


def _field_lines(plan: Plan) -> Iterator[str]:
    for outline, *holes in plan.site.field.parts if plan.site.field else ():
        for key, ring in (("field", outline), *(("hole", hole) for hole in holes)):
            yield f"{key} {', '.join(_texts(corner) for corner in ring)}"


def _obstacle_lines(plan: Plan) -> Iterator[str]:
    for obstacle in plan.site.airspace.obstacles:
        height = "" if obstacle.height_m is None else f" height {number_text(obstacle.height_m)}"
        if not height and _HEIGHT.search(obstacle.name):  # a name that ends as a height does
            height = f" height {NO_HEIGHT}"
        yield f"avoid {obstacle.name}{height} {_corners(obstacle.outline)}"


def _boundary_lines(plan: Plan) -> Iterator[str]:
    return (f"inside {_corners(ring)}" for ring in plan.site.airspace.boundary)


# --- the table


def _one(
    key: str, attribute: str, read: Callable[[str], Any] | None, write: Callable[[Any], str], default: Any = None
) -> tuple[str, Header]:
    """A header of one value, which is written where it is not the default."""

    def lines(plan: Plan) -> Iterator[str]:
        value = reduce(lambda owner, name: owner and getattr(owner, name), attribute.split("."), plan)
        if value not in (None, (), default):
            yield f"{key} {write(value)}"

    return key, Header(read, lines, attribute)


def _metres(key: str, attribute: str, check: tuple[str, Callable[[float], bool]], default: Any = None) -> Any:
    return _one(key, attribute, lambda text: read_number(text, *check), number_text, default)


_XY = partial(numbers, count=2, expected="x and y in metres, like -100 220")

HEADERS: dict[str, Header] = dict(
    [
        _one("computations", "computations", _computations, _computations_text),
        _one("paths", "titles", None, lambda titles: ", ".join(map(_title_text, titles))),
        ("sets", Header(_sets)),
        _metres("trigger-radius", "trigger_radius_m", RADIUS, TRIGGER_RADIUS_M),
        _metres("min-radius", "min_radius_m", RADIUS),
        _one("origin", "site.origin_deg", _origin, lambda origin: " ".join(map(repr, origin))),
        _one("start", "site.start_m", _XY, _texts),
        ("field", Header(_ring, _field_lines)),
        ("hole", Header(_ring)),
        _one("field-name", "site.field.name", lambda text: " ".join(text.split()), str, ""),
        _metres("swath", "site.swath_m", RADIUS),
        _one("home", "site.home_m", _XY, lambda home: _corners([home])),
        _metres("home-altitude", "site.home_altitude_m", _HEIGHT_M),
        _metres("clearance", "site.clearance_m", ("metres from 0 to 1e5", lambda v: 0 <= v <= 1e5), CLEARANCE_M),
        ("avoid", Header(_obstacle, _obstacle_lines)),
        ("inside", Header(lambda text: _polygon(text.split(), _CORNERS), _boundary_lines)),
        _one("made-for", "site.made_for", _made_for, _made_for_text),
        _one("camera", "site.camera", _camera, _camera_text),
        _metres("ground", "site.ground_m", _ABOVE_SEA),
        _metres("height", "site.height_m", _ABOVE_SEA),
    ]
)
"""By key, in the order in which they are written."""

REPEATED = ("field", "hole", "avoid", "inside")
"""Those that may stand more than once: parts of the field, holes in each, obstacles, outlines of the boundary."""

DEFAULT = "default"
"""The value of a held header from which on it is the aircraft's own again."""


def _held(text: str, expected: str, valid: Callable[[float], bool]) -> float | None:
    return None if text.strip() == DEFAULT else read_number(text, f"{expected}, or {DEFAULT}", valid)


HELD = {"altitude": "altitude_m", "airspeed": "airspeed_mps"}
"""Headers before a stage that hold from there on, and the attribute of a stage."""

STAGE_HEADERS: dict[str, Callable[[str], Any]] = {
    "altitude": partial(_held, expected="an altitude within ±1e5 m", valid=lambda v: abs(v) <= 1e5),
    "airspeed": partial(_held, expected="an airspeed from 0.1 to 1000 m/s", valid=lambda v: 0.1 <= v <= 1000),
    "command": partial(numbers, count=8, expected="a command and its seven parameters"),
}
"""Headers before a stage: `HELD`, and a command for that stage."""


def header_lines(plan: Plan) -> list[str]:
    """The headers of a plan."""
    return [f"%: {line}" for header in HEADERS.values() for line in header.lines(plan)]

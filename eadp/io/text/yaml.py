"""Strict YAML with the location of every value, and what a schema finds wrong with it, in this project's words.

YAML 1.2's core scalars, no aliases, no duplicate keys. A schema is a dataclass or a pydantic model. Fields of
dataclasses carry `annotated_types` bounds and docstrings.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar, get_origin

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from eadp.errors import Fault, InputError, one_of, printable, refuse
from eadp.io.text.csv import DECIMAL_COMMA
from eadp.io.text.options import attribute_docstrings
from eadp.io.text.streams import Location, Text

Path = tuple[str | int, ...]
NESTING_LIMIT = 50
DIGITS_LIMIT = 50
"""Length of a whole number that is kept as one; a longer one is a float."""
LIMIT_CHARACTERS = 1_000_000

_INT = re.compile(r"[-+]?[0-9]+\Z|0o[0-7]+\Z|0x[0-9a-fA-F]+\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_SPECIAL = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)\Z|\.(nan|NaN|NAN)\Z")


@dataclass
class Document:
    """A YAML document: its value, and the line and column (from 1) of every value by its path of keys."""

    source: Text
    value: Any = None
    places: dict[Path, Location] = field(default_factory=dict)
    overrides: dict[Path, str] = field(default_factory=dict)
    """Values from another source, such as an option: its name in messages."""

    @property
    def name(self) -> str:
        """The name of the file in messages."""
        return self.source.name

    def fault(self, path: Path, message: str, expected: str = "") -> Fault:
        """A fault at the value of `path`, at an override of a key in it, or at its nearest parent in the document."""
        inner = next((key for key in self.overrides if path and key[: len(path)] == path), path)
        path = path if path in self.places else inner
        while path and path not in self.places:
            if path in self.overrides:
                return Fault(self.overrides[path], 1, 1, message, expected)
            path = path[:-1]
        return self.source.fault(self.places.get(path, (1, 1)), message, expected)


def read_yaml(text: Text) -> Document:
    """Parse one YAML document.

    Raises
    ------
    InputError
        On anything YAML's core schema does not allow, and on aliases, anchors, tags, duplicate keys, keys that are
        not strings, NaN and infinities, more than 50 levels, and more than `LIMIT_CHARACTERS`.
    """
    document = Document(text)
    if len(text.body) > LIMIT_CHARACTERS:
        raise text.error((1, 1), "is too large for YAML", f"at most {LIMIT_CHARACTERS} characters")
    try:
        node = _Loader(text).get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        message = f"is not YAML: {printable(error.problem or 'cannot be read')}"
        raise text.error(_location(mark), message) from None
    except yaml.YAMLError as error:
        raise text.error((1, 1), f"is not YAML: {printable(str(error).splitlines()[0])}") from None
    faults: list[Fault] = []
    if node is not None:
        document.value = _build(node, (), document, faults)
    refuse(faults)
    return document


class _Loader(yaml.SafeLoader):
    """Refuses references and tags, and leaves every plain scalar a string: the core schema is applied in `_scalar`."""

    def __init__(self, source: Text) -> None:
        super().__init__(source.body)
        self._source, self._depth = source, 0

    def get_event(self) -> Any:
        event = super().get_event()  # type: ignore[no-untyped-call]
        at = _location(event.start_mark)
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise self._source.error(at, "a YAML alias or anchor", "the value written out")
        tag = getattr(event, "tag", None)
        if tag:
            raise self._source.error(at, f"a YAML tag {printable(str(tag))}", "a plain value")
        self._depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if self._depth > NESTING_LIMIT:
            raise self._source.error(at, f"nested deeper than {NESTING_LIMIT} levels")
        return event


_Loader.yaml_implicit_resolvers = {}


def _location(mark: Any) -> Location:
    return (mark.line + 1, mark.column + 1) if mark else (1, 1)


def _build(node: Node, path: Path, document: Document, faults: list[Fault]) -> Any:
    document.places.setdefault(path, _location(node.start_mark))
    if isinstance(node, MappingNode):
        return _mapping(node, path, document, faults)
    if isinstance(node, SequenceNode):
        return [_build(item, (*path, i), document, faults) for i, item in enumerate(node.value)]
    assert isinstance(node, ScalarNode)
    return _scalar(node, path, document, faults)


def _mapping(node: MappingNode, path: Path, document: Document, faults: list[Fault]) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key_node, value_node in node.value:
        location = _location(key_node.start_mark)
        key = key_node.value if isinstance(key_node, ScalarNode) else None
        if key is None or key in result:
            wrong = ("a key that is not a name", "a name")
            wrong = wrong if key is None else (f"the key {printable(key)} stands twice", "it once")
            faults.append(document.source.fault(location, *wrong))
            continue
        result[key] = _build(value_node, (*path, key), document, faults)
        # the location is the key's: an empty value has none, and a block starts a line later
        document.places[(*path, key)] = location
    return result


def _scalar(node: ScalarNode, path: Path, document: Document, faults: list[Fault]) -> Any:
    raw = node.value
    if node.style is not None:  # quoted or block: a string, in which JSON may write a character as two escapes
        return raw.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    if raw in _SPECIAL:
        return _SPECIAL[raw]
    number: float
    if _INT.match(raw) and len(raw) <= DIGITS_LIMIT:
        number = int(raw, {"0x": 16, "0o": 8}.get(raw[:2], 10))
    elif _FLOAT.match(raw):
        number = float(raw)
    elif _INT.match(raw) or _NOT_FINITE.match(raw):
        number = math.inf
    else:
        return raw
    if math.isinf(number):
        faults.append(document.fault(path, f"{printable(raw, 60)} is not a finite number", "a finite number"))
        return 0.0
    return number


PLAIN = ("schema", "interpolation")
"""Keys whose texts are words of ours, which need no quotes."""


def yaml_text(document: Mapping[str, Any]) -> str:
    """A document as YAML, a key on each line; in a list of mappings each is a line."""
    lines = []
    for key, value in document.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            lines += [f"{key}:", *(f"  - {_flow(item)}" for item in value)]
        else:
            lines.append(f"{key}: {value if key in PLAIN else _flow(value)}")
    return "\n".join([*lines, ""])


def _flow(value: Any) -> str:
    """A value on one line; a number has as many digits as it takes, and characters that do not print are escaped."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    return json.dumps(value, ensure_ascii=not (isinstance(value, str) and value.isprintable()))


STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)
"""Configuration of a schema; it holds for the dataclasses in it, too."""

Model = TypeVar("Model")
_EXPECTED = {
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "a text",
    **dict.fromkeys(("int_type", "int_from_float"), "a whole number"),
    **dict.fromkeys(("list_type", "tuple_type"), "a list"),
    **dict.fromkeys(("model_type", "dict_type", "mapping_type", "dataclass_type"), "a mapping of keys"),
}
_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
SUGGESTIONS = 100
"""Most unknown keys for which known ones are searched."""


@cache
def _adapter(model: Any) -> TypeAdapter[Any]:
    return TypeAdapter(model, config=STRICT if get_origin(model) is dict else None)


class _Described(GenerateJsonSchema):
    """JSON Schema with the docstrings of a dataclass's attributes as descriptions."""

    def dataclass_schema(self, schema: Any) -> dict[str, Any]:
        """The schema of a dataclass."""
        found = super().dataclass_schema(schema)
        texts = attribute_docstrings(schema["cls"])
        for name, node in found["properties"].items():
            if name in texts:
                node.setdefault("description", texts[name])
        return found


@cache
def schema_of(model: Any) -> dict[str, Any]:
    """JSON Schema of a dataclass or model."""
    return _adapter(model).json_schema(by_alias=True, schema_generator=_Described)


def keys_document(text: Text, schema: str) -> Document:
    """A document that is a mapping with a key `schema` of this value; its other keys are not yet checked.

    Raises
    ------
    InputError
        If it is no YAML or no mapping, or has no such key `schema`.
    """
    document = read_yaml(text)
    if document.value is None:
        document.value = {}
    if not isinstance(document.value, dict):
        raise InputError(document.fault((), "is no mapping of keys", f"keys such as schema: {schema}"))
    if "schema" not in document.value:
        raise InputError(document.fault((), "has no key schema", f"schema: {schema}"))
    if (given := document.value["schema"]) != schema:
        raise InputError(document.fault(("schema",), f"is a file of {printable(str(given), 60)}", f"schema: {schema}"))
    return document


def without_nulls(value: Any) -> Any:
    """A copy of a value without the keys that are null: they are absent keys."""
    if isinstance(value, dict):
        return {key: without_nulls(inner) for key, inner in value.items() if inner is not None}
    return [without_nulls(inner) for inner in value] if isinstance(value, list) else value


def validated(
    model: type[Model], document: Document, value: Any, check: Callable[[Model], list[Fault]] | None = None
) -> Model:
    """A value of a document as a schema's dataclass or model.

    Parameters
    ----------
    model, document
    value
        What is validated, made of mappings, lists, strings and numbers. A known key that is null is an absent one.
    check : function, optional
        Finds what the schema alone cannot express.

    Raises
    ------
    InputError
        With every fault of the schema, or of `check`.
    """
    content: Model
    content, problems = _content(model, value)
    if problems:
        problems = [each for each in problems if each["input"] is not None or each["type"] in _UNKNOWN]
        if not problems:  # but of known keys that are null
            value = without_nulls(value)
            content, problems = _content(model, value)
    if problems:
        found = [_schema_fault(document, each, model, value, i < SUGGESTIONS) for i, each in enumerate(problems)]
        raise InputError(*found)
    faults = check(content) if check is not None else []
    refuse(faults)
    return content


def validated_at(path: tuple[str, ...], kind: type[Model], document: Document, value: Any) -> Model:
    """`validated` of what stands at a path of a document, as a dataclass that no schema of eadp has."""
    model: Any = kind
    for key in reversed(path):
        model, value = dict[str, model], {key: value}
    content: Any = validated(model, document, value)
    for key in path:
        content = content[key]
    return content  # type: ignore[no-any-return]


def _content(model: Any, value: Any) -> tuple[Any, list[Any]]:
    """A value as a schema's dataclass or model; else None, and pydantic's complaints."""
    try:
        # in JSON, a list may be a tuple and a mapping a dataclass, where pydantic is strict about everything else
        return _adapter(model).validate_json(json.dumps(value)), []
    except ValidationError as error:
        return None, error.errors()


def _schema_fault(document: Document, problem: Any, model: Any, value: Any, suggests: bool) -> Fault:
    """One of pydantic's complaints about a value, with a suggestion for an unknown key if wanted."""
    kind, wrong = problem["type"], problem["input"]
    path = _path_in(value, problem["loc"])
    key = ".".join(printable(str(part), 80) for part in path)
    if kind in ("missing", "missing_argument"):
        return document.fault(path, f"the key {key} is missing")
    if kind in _UNKNOWN:
        return document.fault(path, f"unknown key {key}", _instead(model, path) if suggests else "")
    message = printable(str(problem["msg"]).removeprefix("Value error, "))
    if kind == "value_error":
        return document.fault(path, f"{key}: {message}" if key else message)
    reworded = re.sub(r"^\w+ should (be|have|match) ", "", message).partition(" after validation")[0]
    expected = _EXPECTED.get(kind, reworded)
    if kind == "float_type" and isinstance(wrong, str) and DECIMAL_COMMA.match(wrong.strip()):
        expected = f"a number with a decimal point, as in {wrong.strip().replace(',', '.')}"
    shown = printable(repr(wrong), 60)
    if isinstance(wrong, dict | list | tuple):
        shown = "a mapping" if isinstance(wrong, dict) else f"a list of {len(wrong)}"
    return document.fault(path, f"{key} cannot be {shown}", expected)


def _path_in(value: Any, location: tuple[str | int, ...]) -> Path:
    """The part of pydantic's path that stands in the value, or is missing at its end: no names of a union's members."""
    path: Path = ()
    for i, part in enumerate(location):
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            missing = isinstance(value, dict) or isinstance(part, int)
            if part == "[key]" or not missing or i < len(location) - 1:
                continue
        path = (*path, part)
    return path


def _instead(model: Any, path: Path) -> str:
    """What to write for an unknown key: the paths of the key of its name, else the known keys."""
    schema, wanted = schema_of(model), str(path[-1])
    parent = tuple(part for part in path[:-1] if isinstance(part, str))
    inside = [known[len(parent) :] for known in _key_paths(schema, schema) if known[: len(parent)] == parent]
    found = [".".join(map(str, (*path[:-1], *deeper))) for deeper in inside if deeper and deeper[-1] == wanted]
    return " or ".join(dict.fromkeys(found)) or one_of((deeper[0] for deeper in inside if len(deeper) == 1), wanted)


def _key_paths(schema: Mapping[str, Any], node: Mapping[str, Any]) -> Iterator[tuple[str, ...]]:
    """The paths of all keys below a node of a schema."""
    for name, inner in properties(schema, node):
        yield (name,)
        yield from ((name, *deeper) for deeper in _key_paths(schema, inner))


def properties(schema: Mapping[str, Any], node: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The keys of a node of a JSON Schema with their own nodes, of each member of a union or of a mapping by name."""
    if "$ref" in node:
        yield from properties(schema, schema["$defs"][node["$ref"].rpartition("/")[2]])
    others = node.get("additionalProperties")
    named = (*node.get("patternProperties", {}).values(), *([others] if isinstance(others, dict) else ()))
    for member in (*node.get("oneOf", ()), *node.get("anyOf", ()), *named):
        yield from properties(schema, member)
    yield from node.get("properties", {}).items()

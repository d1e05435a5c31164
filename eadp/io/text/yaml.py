"""Strict YAML: YAML 1.2's core scalars, no aliases, no duplicate keys, and the location of every value."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import Any

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from eadp.errors import Fault, printable, refuse
from eadp.io.text.streams import Location, SourceText, Text

Path = tuple[str | int, ...]
NESTING_LIMIT = 50
DIGITS_LIMIT = 50
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

    source: SourceText
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
        not strings, NaN and infinities, more than 50 levels, numbers of more than 50 digits, and more than
        `LIMIT_CHARACTERS`.
    """
    source = SourceText(text)
    document = Document(source)
    if len(text.body) > LIMIT_CHARACTERS:
        raise source.error((1, 1), "is too large for YAML", f"at most {LIMIT_CHARACTERS} characters")
    try:
        node = _Loader(source).get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        message = f"is not YAML: {printable(error.problem or 'cannot be read')}"
        raise source.error(_location(mark), message) from None
    except yaml.YAMLError as error:
        raise source.error((1, 1), f"is not YAML: {printable(str(error).splitlines()[0])}") from None
    faults: list[Fault] = []
    if node is not None:
        document.value = _build(node, (), document, faults)
    refuse(faults)
    return document


class _Loader(yaml.SafeLoader):
    """Refuses references and tags, and leaves every plain scalar a string: the core schema is applied in `_scalar`."""

    def __init__(self, source: SourceText) -> None:
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
    for before, (key_node, value_node) in zip([None, *node.value], node.value, strict=False):
        location = _location(key_node.start_mark)
        if not isinstance(key_node, ScalarNode):
            document.places[(*path, "?")] = location
            faults.append(document.fault((*path, "?"), "a key that is not a name", "a name"))
            continue
        key = key_node.value
        if before is not None and _is_decimals(before[1], key_node, value_node):
            whole = before[1].value
            document.places[(*path, "?")] = _location(before[1].start_mark)
            message = f"{printable(whole)},{printable(key)} has a decimal comma"
            faults.append(document.fault((*path, "?"), message, f"a decimal point, as in {whole}.{key}"))
            continue
        if key in result:
            document.places[(*path, "?")] = location
            faults.append(document.fault((*path, "?"), f"the key {printable(key)} stands twice", "it once"))
            continue
        result[key] = _build(value_node, (*path, key), document, faults)
        # the location is the key's: an empty value has none, and a block starts a line later
        document.places[(*path, key)] = location
    return result


def _is_decimals(number: Node, key: ScalarNode, value: Node) -> bool:
    """Whether a key is the digits after the comma of the number before it, as the 5 of `{a: 6,5, b: 1}`."""
    numbers = isinstance(number, ScalarNode) and number.style is None and _INT.match(number.value)
    return bool(numbers) and key.style is None and key.value.isdigit() and value.start_mark == value.end_mark


def _without_surrogates(raw: str, path: Path, document: Document, faults: list[Fault]) -> str:
    """A string whose escapes may encode a character as a pair of surrogates, as in JSON."""
    try:
        return raw.encode("utf-16", "surrogatepass").decode("utf-16")
    except UnicodeDecodeError:
        faults.append(document.fault(path, "half of a pair of surrogates", "a whole character"))
        return ""


def _scalar(node: ScalarNode, path: Path, document: Document, faults: list[Fault]) -> Any:
    raw = node.value
    if node.style is not None:  # quoted or block: a string
        return _without_surrogates(raw, path, document, faults)
    if raw in _SPECIAL:
        return _SPECIAL[raw]
    if _NOT_FINITE.match(raw):
        faults.append(document.fault(path, f"{raw} is not a finite number", "a finite number"))
        return 0.0
    number = _FLOAT.match(raw) or _INT.match(raw)
    if not number:
        return raw
    if sum(c.isdigit() for c in raw) > DIGITS_LIMIT or (raw[:2] == "0x" and len(raw) - 2 > DIGITS_LIMIT):
        faults.append(document.fault(path, f"a number of more than {DIGITS_LIMIT} digits"))
        return 0.0
    if _INT.match(raw):
        return int(raw, {"0x": 16, "0o": 8}.get(raw[:2], 10))
    value = float(raw)
    if math.isinf(value):
        faults.append(document.fault(path, f"{raw} is too large for a number", "a finite number"))
        return 0.0
    return value

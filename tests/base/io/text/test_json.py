"""JSON with places, beside what the standard library reads."""

import json

from hypothesis import assume, given
from hypothesis import strategies as st

from eadp.errors import InputError
from eadp.io.text.json import JsonList, JsonObject, JsonReader
from eadp.io.text.streams import Text

scalars = st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False, allow_infinity=False)
documents = st.recursive(
    scalars | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=4),
    max_leaves=12,
)


def bare(value):
    if isinstance(value, dict):
        return {key: bare(item) for key, item in value.items()}
    return [bare(item) for item in value] if isinstance(value, (list, tuple)) else value


@given(documents, st.sampled_from([None, 1]), st.booleans())
def test_json_is_what_the_standard_library_reads(value, indent, ascii_only):
    text = json.dumps(value, indent=indent, ensure_ascii=ascii_only)
    assert bare(JsonReader(Text("f", text)).document()) == value


@given(documents, st.data())
def test_what_is_no_json_is_none_for_either(value, data):
    text = json.dumps(value)
    at = data.draw(st.integers(0, len(text)))
    odd = data.draw(st.sampled_from(list('[]{},:"0-.e+ \nt\\')))
    text = text[:at] + odd + text[data.draw(st.integers(at, len(text))) :]
    twice = []

    def pairs(items):
        twice.extend([1] if len(dict(items)) < len(items) else [])
        return dict(items)

    try:
        expected = json.loads(text, object_pairs_hook=pairs)
        assume("Infinity" not in json.dumps(expected))  # a number too large for a float
    except json.JSONDecodeError:
        expected = json  # which no text is
    assume(not twice)
    try:
        found = bare(JsonReader(Text("f", text)).document())
    except InputError:
        found = json
    assert found == expected or (found is expected is json)


@given(documents)
def test_every_value_of_json_has_its_place(value):
    text = json.dumps(value, indent=1)
    source = Text("f", text)
    lines = text.split("\n")

    def check(node):
        items = node.items() if isinstance(node, JsonObject) else enumerate(node)
        for key, item in items:
            offset = node.offsets[key]
            line, column = source.location(offset)
            assert lines[line - 1][column - 1] == text[offset]
            if isinstance(item, (JsonObject, JsonList)):
                check(item)
            else:
                read_there, _ = json.JSONDecoder().raw_decode(text, offset)
                assert read_there == bare(item)

    root = JsonReader(source).document()
    if isinstance(root, (JsonObject, JsonList)):
        check(root)

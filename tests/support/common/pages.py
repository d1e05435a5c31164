"""What is in an HTML page of eadp, read as a browser would."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser


class Page(HTMLParser):
    """A page: its tags with their attributes, the content of its scripts and styles, and its data."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.open: list[str] = []
        self._in: tuple[str, dict[str, str | None]] = ("", {})
        self.feed(text)
        self.close()
        self.data = json.loads(self._data)

    def handle_starttag(self, tag, attrs):
        self._in = (tag, dict(attrs))
        self.tags.append(self._in)
        if tag not in ("meta", "input", "br", "link", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        self._in = ("", {})

    def handle_data(self, data):
        tag, attributes = self._in
        if tag == "script" and attributes.get("type") == "application/json":
            self._data = data
        elif tag == "script":
            self.scripts.append(data)
        elif tag == "style":
            self.styles.append(data)

    @property
    def policy(self) -> str:
        """The policy for contents."""
        return next(a["content"] or "" for tag, a in self.tags if a.get("http-equiv") == "Content-Security-Policy")

    def check(self) -> None:
        """It is whole, loads nothing, and its policy allows its own scripts and styles alone."""
        assert self.open == []
        for tag, attributes in self.tags:
            assert not {"src", "href", "srcset", "style"} & attributes.keys(), tag
            assert not [name for name in attributes if name.startswith("on")], tag
        for kind, blocks in (("script", self.scripts), ("style", self.styles)):
            digests = [base64.b64encode(hashlib.sha256(block.encode()).digest()).decode() for block in blocks]
            allowed = re.search(rf"{kind}-src ([^;]*)", self.policy)
            assert allowed
            assert allowed[1].split() == [f"'sha256-{digest}'" for digest in digests]
        assert self.policy.startswith("default-src 'none'; ")
        ids = [attributes["id"] for _, attributes in self.tags if "id" in attributes]
        assert len(ids) == len(set(ids))
        used = re.findall(r'\$\("([\w-]+)"\)', "".join(self.scripts))
        assert set(used) <= set(ids)

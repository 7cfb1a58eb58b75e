"""What a page of a result holds, read back without a browser."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np


class _Elements(HTMLParser):
    def __init__(self):
        super().__init__()
        self.data, self.words, self.links, self.ids, self._name = {}, [], [], [], None

    def handle_starttag(self, tag, attributes):
        known = dict(attributes)
        self._name = None
        if tag == "a":
            self.links.append(known["href"])
        if "id" in known:
            self.ids.append(known["id"])
        if tag == "script":
            self._name = known.get("id", "script")
            self.data[self._name] = known

    def handle_data(self, text):
        if self._name is None:
            self.words.append(text)
        else:
            self.data[self._name]["text"] = text

    def handle_endtag(self, tag):
        self._name = None


class Page:
    """The words, links and ids of a page, and its data by name: arrays, and `facts`."""

    def __init__(self, text):
        elements = _Elements()
        elements.feed(text)
        self.text = text
        self.words = " ".join(" ".join(elements.words).split())
        self.links, self.ids = elements.links, elements.ids
        self.data = {
            name.removeprefix("data-"): _decoded(one)
            for name, one in elements.data.items()
            if name.startswith("data-")
        }

    @classmethod
    def of(cls, path: Path):
        return cls(path.read_text(encoding="utf-8"))

    @property
    def places(self):
        """The points' coordinates in the map frame [m]."""
        known = self.data["facts"]["points"]
        return np.array(known["corner"]) + self.data["points"] * np.array(known["step"])

    def addresses(self):
        """Whatever would be fetched from elsewhere; links wait for a click."""
        markup = re.sub(r'<script type="text/plain".*?</script>', "", self.text, flags=re.DOTALL)
        names = r"""(?:src|<link[^>]*href)\s*=\s*["'][^"']*|url\([^)]*|@import|\bfetch\(|XMLHttpRequest"""
        return re.findall(names, markup)


def _decoded(element):
    content = zlib.decompress(base64.b64decode(element["text"]))
    if element["data-type"] == "json":
        return json.loads(content)
    shape = tuple(int(size) for size in element["data-shape"].split(","))
    return np.frombuffer(content, element["data-type"]).reshape(shape)

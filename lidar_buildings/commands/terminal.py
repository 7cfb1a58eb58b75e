"""Colours, on terminals only."""

from __future__ import annotations

import os
from typing import TextIO

#: Name → its code (ECMA-48).
_CODES = {"red": 31, "green": 32, "yellow": 33, "bold": 1}
#: Grades of buildings → colours.
GRADES = {"good": "green", "check": "yellow", "poor": "red"}


def coloured(text: str, colour: str, stream: TextIO | None) -> str:
    """Return a text in a colour if a stream is a terminal that shows any (no-color.org)."""
    if (
        stream is None
        or not stream.isatty()
        or os.environ.get("NO_COLOR")
        or os.environ.get("TERM") == "dumb"
    ):
        return text
    return f"\x1b[{_CODES[colour]}m{text}\x1b[0m"

"""
Buildings' models on their way to a tile: lines of CityJSONSeq, which carry no stamp.

A feature without city objects withdraws what had its id before. One that is named after a tile closes the
tile: all its features have been sent.
"""

from __future__ import annotations

import json
import re
from collections import OrderedDict
from collections.abc import Iterable

from std_msgs.msg import String

#: How many features are kept; wide margin: a tile has hundreds. The oldest are of tiles that were sent again.
_MAX_FEATURES = 100_000
#: Characters that they may have; wide margin: a building takes 10,000.
_MAX_CHARACTERS = 500_000_000
#: Stands before the stamp in the name of the feature that closes a tile.
_TILE = "tile-"
#: How a feature without city objects ends, and how one that closes a tile reads.
_END = ',"CityObjects":{},"vertices":[]}'
_CLOSING = re.compile(rf'{{"type":"CityJSONFeature","id":"{_TILE}(\d{{1,19}})"{re.escape(_END)}', re.ASCII)


def withdrawal_message(readable_id: str) -> String:
    """Return the message that there is no building of this name any more."""
    return String(data=f'{{"type":"CityJSONFeature","id":{json.dumps(readable_id)}{_END}')


def is_withdrawal(line: str) -> bool:
    """Whether a feature is one without city objects, as `withdrawal_message` writes it."""
    return line.endswith(_END)


def tile_closing_message(stamp: int) -> String:
    """Return the message that a tile has no more features."""
    return withdrawal_message(f"{_TILE}{stamp}")


def closed_tile(line: str) -> int | None:
    """Return the stamp of the tile that a feature closes, None if it closes none."""
    found = _CLOSING.fullmatch(line)
    return int(found[1]) if found else None


class FeaturePool:
    """Holds features until their tile takes them."""

    def __init__(self) -> None:
        self._lines: OrderedDict[int, str] = OrderedDict()
        self._n_characters = 0

    def add(self, building_id: int, line: str) -> None:
        """Take a feature; it replaces an earlier one of its building."""
        self._n_characters += len(line) - len(self._lines.pop(building_id, ""))
        self._lines[building_id] = line
        while len(self._lines) > _MAX_FEATURES or self._n_characters > _MAX_CHARACTERS:
            self._n_characters -= len(self._lines.popitem(last=False)[1])

    def has(self, building_ids: Iterable[int]) -> bool:
        """Whether the features of some buildings are there."""
        return all(number in self._lines for number in building_ids)

    def take(self, building_ids: Iterable[int]) -> tuple[str, ...]:
        """Remove and return a tile's features, in the order of the ids."""
        lines = tuple(self._lines.pop(number) for number in building_ids)
        self._n_characters -= sum(map(len, lines))
        return lines

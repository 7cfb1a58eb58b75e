"""Buildings' models on their way to a tile: messages without a stamp, found by the building's id."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable

#: How many features are kept; wide margin: a tile has hundreds. The oldest are of tiles that were sent again.
_MAX_FEATURES = 100_000


class FeaturePool:
    """Holds features until their tile takes them."""

    def __init__(self) -> None:
        self._lines: OrderedDict[int, str] = OrderedDict()
        self._missing: dict[int, set[int]] = {}

    def add(self, building_id: int, line: str) -> bool:
        """Take a feature; return whether it was the last one that a tile has waited for."""
        self._lines[building_id] = line
        self._lines.move_to_end(building_id)
        if len(self._lines) > _MAX_FEATURES:
            self._lines.popitem(last=False)
        for stamp, missing in self._missing.items():
            missing.discard(building_id)
            if not missing:
                del self._missing[stamp]
                return True
        return False

    def expect(self, stamp: int, building_ids: Iterable[int]) -> bool:
        """Say which features a tile needs; return whether it has to wait for any."""
        missing = {number for number in building_ids if number not in self._lines}
        if missing:
            self._missing[stamp] = missing
        else:
            self._missing.pop(stamp, None)
        return bool(missing)

    def take(self, building_ids: Iterable[int]) -> tuple[str, ...]:
        """Remove and return a tile's features, in the order of the ids."""
        return tuple(self._lines.pop(number) for number in building_ids)

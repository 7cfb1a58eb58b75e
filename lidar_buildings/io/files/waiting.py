"""Things that wait on disk, by what they are asked for with."""

from __future__ import annotations

import pickle
from collections.abc import Hashable, Iterator
from typing import BinaryIO, Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Item = TypeVar("Item")


class Waiting(Generic[Key, Item]):
    """Keeps things in a binary file, open for writing and reading, and in memory the place of each."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.places: dict[Key, list[int]] = {}

    def add(self, key: Key, item: Item) -> None:
        """Keep something."""
        self.places.setdefault(key, []).append(self._file.tell())
        pickle.dump(item, self._file, protocol=pickle.HIGHEST_PROTOCOL)

    def of(self, key: Key) -> Iterator[Item]:
        """Yield what was kept under a key, in the order in which it came."""
        for place in self.places.get(key, ()):
            self._file.seek(place)
            yield pickle.load(self._file)

"""The four sides of a tile."""

from __future__ import annotations

from typing import NamedTuple


class Sides(NamedTuple):
    """On which sides of a tile something holds; true if on any."""

    west: bool = False
    south: bool = False
    east: bool = False
    north: bool = False

    def __bool__(self) -> bool:
        """Whether it holds on any side."""
        return any(tuple(self))

    def __or__(self, other: Sides) -> Sides:
        """Return on which sides either holds."""
        return Sides(*(one or another for one, another in zip(self, other, strict=True)))


NONE, ALL = Sides(), Sides(True, True, True, True)

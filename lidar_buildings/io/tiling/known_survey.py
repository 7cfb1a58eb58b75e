"""What a source has learnt of its survey: given to a later one of the same place, its tiles are the same."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class KnownSurvey:
    """What all tiles of a survey share."""

    #: Side of the tiles, and where they begin [m].
    tile_size: float
    start: float
    buffer: float | None = None  #: width of their buffer in the east [m], if it was noted
    spacing: float | None = None  #: the point spacing that they are expected to have [m]
    dark_limit: float | None = None  #: normalised intensity up to which ground is dark
    #: Flight strip → the two intensities that become 0 and the high anchor; −1 stands for all others.
    scales: dict[int, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def from_json(cls, found: dict[str, Any]) -> KnownSurvey:
        """Make it from what JSON held."""
        scales = {int(strip): (float(low), float(high)) for strip, (low, high) in found["scales"].items()}
        return cls(**{**found, "scales": scales})

"""What a run has made."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class RunSummary:
    """
    What a run has made, as ``run.json`` tells it.

    Attributes
    ----------
    files : tuple of str
        Relative to the output folder.
    n_tiles, n_points : int
        Finished tiles; points of all inputs.
    n_unclassified : int
        Points in none of the finished tiles; they keep their class.
    classes : dict
        Class number → points.
    buildings : dict
        Status → buildings.
    n_seam_pieces : int
        Buildings left out because a neighbouring tile has them as part of a larger one.
    rasters : dict
        File name → its columns, rows, side of a cell in the source's unit, and known cells.
    problems : tuple of str
        One line per input that could not be read to its end.
    footprints : dict
        What became of the footprints that were given: how many were read, used, repaired, left out for which
        reason, and outside the data. Empty where outlines were traced.
    """

    files: tuple[str, ...]
    n_tiles: int
    n_points: int
    n_unclassified: int
    classes: dict[int, int]
    buildings: dict[str, int]
    n_seam_pieces: int
    rasters: dict[str, dict[str, Any]]
    problems: tuple[str, ...]
    footprints: dict[str, Any] = field(default_factory=dict)

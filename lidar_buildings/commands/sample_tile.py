"""A tile that has been through the chain: what `warm-up` calls the stages with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.core.model.tile import PointTile

#: Written by ``python -m bench.common.sample_tile``.
SAMPLE = Path(__file__).with_name("sample_tile.npz")


class SampleTile(NamedTuple):
    """A tile with the columns of all stages, and its outlines before and after regularisation."""

    tile: PointTile
    traced: tuple[BuildingOutline, ...]
    outlines: tuple[BuildingOutline, ...]


def sample_tile() -> SampleTile:
    """Read the tile."""
    with np.load(SAMPLE) as stored:
        columns = {name: stored[name] for name in stored.files}
    traced, outlines = (_outlines(columns.pop(f"{name}_rings")) for name in ("traced", "outlines"))
    n = len(columns["points"])
    spacing = float(columns.pop("point_spacing"))
    tile = PointTile(**columns, point_spacing=spacing, source=np.zeros(n), index=np.arange(n))
    return SampleTile(tile, traced, outlines)


def stored_rings(outlines: Sequence[BuildingOutline]) -> NDArray[np.float64]:
    """Return all vertices as rows of building, ring (0: the outer one), x and y."""
    return np.array(
        [
            (one.building_id, number, *vertex)
            for one in outlines
            for number, ring in enumerate(one.outline.rings)
            for vertex in ring
        ]
    )


def _outlines(rows: NDArray[np.float64]) -> tuple[BuildingOutline, ...]:
    outlines = []
    for building in np.unique(rows[:, 0]):
        own = rows[rows[:, 0] == building]
        outer, *holes = (own[own[:, 1] == number, 2:] for number in np.unique(own[:, 1]))
        outlines.append(BuildingOutline(int(building), Outline(outer, tuple(holes))))
    return tuple(outlines)

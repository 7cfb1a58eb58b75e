"""The roofs of a tile that matter to what it gives: those that hang together with its core's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.surfaces.surface_patches import connected_parts

#: What is farther apart than this is never of one block, and no neighbourhood reaches across: half of a
#: window of the segmentation across lines as far apart as lines can be [spacings].
APART_SPACINGS = 15.0


def own_roofs(tile: PointTile) -> NDArray[np.bool_]:
    """
    Tell which points are roof and hang together with roof points of the tile's core.

    All that a tile says of its core points and of its own buildings, whose westernmost points are core
    points, depends on these alone.

    Parameters
    ----------
    tile : PointTile
        With classes. All its roofs are its own if it has no buffer or its spacing is not known.
    """
    is_own = tile.is_roof
    if tile.buffer is None or tile.point_spacing is None:
        return is_own
    rows = np.flatnonzero(is_own)
    part = connected_parts(tile.points[rows], APART_SPACINGS * tile.point_spacing, in_plan=True)
    has_core = np.bincount(part, tile.is_core[rows]) > 0
    is_own[rows] = has_core[part]
    return is_own

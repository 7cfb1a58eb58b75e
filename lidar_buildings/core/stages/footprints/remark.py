"""What to remark about a building whose points were not recognised as a roof."""

from __future__ import annotations

import numpy as np

from lidar_buildings.core.model.tile import PointTile


def remark_on_points(building: PointTile) -> str:
    """Say how many of a building's points are no roof points; nothing if all are."""
    n_others = int(np.count_nonzero(~building.is_roof))
    if not n_others:
        return ""
    return f"{n_others} of {len(building)} points are what stands in the footprint where no roof points are"

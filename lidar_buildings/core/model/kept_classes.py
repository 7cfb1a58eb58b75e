"""Classes that a file brings along and that this package cannot find better itself."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from lidar_buildings.core.model.point_classes import PointClass

#: What a parameter calls them → ASPRS classes. All others (0 to 6, 8) are decided anew.
CLASS_GROUPS: dict[str, tuple[int, ...]] = {
    "noise": (PointClass.LOW_NOISE, PointClass.HIGH_NOISE),
    "water": (PointClass.WATER,),
    "rail": (PointClass.RAIL,),
    "road": (PointClass.ROAD_SURFACE,),
    "overlap": (PointClass.OVERLAP,),
    "wires": (13, 14, 15, 16),
    "bridge": (PointClass.BRIDGE_DECK,),
    "other": tuple(range(19, 256)),
}
#: Those that lie on the terrain and carry it; the others have no part in it.
ON_TERRAIN = ("water", "rail", "road", "overlap")


def is_of_groups(classification: NDArray[np.uint8], groups: Iterable[str]) -> NDArray[np.bool_]:
    """
    Tell which points have a class of one of these groups.

    Parameters
    ----------
    classification : ndarray of uint8, shape (n_points,)
        ASPRS classes.
    groups : iterable of str
        Names in `CLASS_GROUPS`.
    """
    table = np.zeros(256, dtype=bool)
    for group in groups:
        table[list(CLASS_GROUPS[group])] = True
    return table[classification]

"""The point classes of ASPRS LAS 1.4, and those that a source's points keep."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class PointClass(IntEnum):
    """Standard lidar point classes (ASPRS LAS Specification 1.4-R15, table 17)."""

    NEVER_CLASSIFIED = 0
    UNCLASSIFIED = 1
    GROUND = 2
    LOW_VEGETATION = 3
    MEDIUM_VEGETATION = 4
    HIGH_VEGETATION = 5
    BUILDING = 6
    LOW_NOISE = 7
    MODEL_KEY_POINT = 8
    WATER = 9
    RAIL = 10
    ROAD_SURFACE = 11
    OVERLAP = 12
    BRIDGE_DECK = 17
    HIGH_NOISE = 18


class FacadeClass(IntEnum):
    """What a point of a building is beside its roof."""

    NONE = 0  #: roof, or no building
    BELOW_ROOF = 1  #: walls, windows, what is under the eaves
    BARE = 2  #: of a wall over which no roof was seen


class View(IntEnum):
    """From where a point was seen; without it, from above."""

    UNKNOWN = 0  #: nothing tells: as from above
    ABOVE = 1
    STREET = 2  #: at a place that nothing has seen from above
    COVERED = 3  #: from the street, at a place that was seen from above, too: tells no roof


class Rejection(IntEnum):
    """Why roof selection took a point for no roof; of several reasons the first that it met."""

    NONE = 0  #: a roof, wall or façade; ground, or of a class that stays
    LOW = 1  #: below `min_height`
    FOLIAGE = 2  #: on no smooth surface, or below one
    ROUGH = 3  #: rougher than `max_roughness`, up to twice as rough
    STEEP = 4  #: on a smooth surface steeper than a roof
    DECK = 5  #: of a bridge or viaduct
    NARROW_PART = 6  #: where a roof is narrower than `min_roof_width`
    NARROW_BUILDING = 7  #: of a building or vehicle narrower than `min_building_width`
    SMALL = 8  #: of a building smaller than `min_building_area`
    ENDLESS = 9  #: more of the like stands around, as around a smooth spot of a crown


#: Class → what it is called in texts.
CLASS_NAMES = {int(one): one.name.lower().replace("_", " ") for one in PointClass}

#: Classes that a source's points keep, by what a parameter calls them; others (0 to 6, 8) are decided anew.
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
    """Tell which points have a class of one of these groups, named as in `CLASS_GROUPS`."""
    table = np.zeros(256, dtype=bool)
    for group in groups:
        table[list(CLASS_GROUPS[group])] = True
    return table[classification]

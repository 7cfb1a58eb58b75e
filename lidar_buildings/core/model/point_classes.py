"""The point classes of ASPRS LAS 1.4 that this package reads and writes."""

from enum import IntEnum


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

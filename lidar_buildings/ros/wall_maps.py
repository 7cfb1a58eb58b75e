"""Plans of walls as nav_msgs/OccupancyGrid."""

from __future__ import annotations

import array

from geometry_msgs.msg import Point, Pose
from nav_msgs.msg import MapMetaData, OccupancyGrid

from lidar_buildings.core.stages.facades.wall_map import WallMap
from lidar_buildings.ros.stamps import header_of


def wall_map_message(stamp: int, shown: WallMap) -> OccupancyGrid:
    """Return the grid of a tile; that of a later revision replaces it, and those of other tiles adjoin."""
    header = header_of(stamp)
    height, width = shown.cells.shape
    info = MapMetaData(
        map_load_time=header.stamp,
        resolution=shown.resolution,
        width=width,
        height=height,
        origin=Pose(position=Point(x=shown.west, y=shown.south, z=shown.elevation)),
    )
    return OccupancyGrid(header=header, info=info, data=array.array("b", shown.cells.tobytes()))

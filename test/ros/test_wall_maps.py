"""A plan of walls is a grid in the map frame, row by row from its south-western corner."""

import numpy as np

from lidar_buildings.core.stages.facades.wall_map import WallMap
from lidar_buildings.ros.stamps import to_stamp
from lidar_buildings.ros.wall_maps import wall_map_message


def test_a_grid_has_its_corner_its_rows_from_the_south_and_the_stamp_of_its_tile():
    cells = np.array([[0, 0, -1], [100, 100, -1]], dtype=np.int8)
    message = wall_map_message(5_000_000_001, WallMap(0.2, 12.4, -3.0, 7.5, cells))
    assert (message.header.frame_id, to_stamp(message.header.stamp)) == ("map", 5_000_000_001)
    assert (message.info.width, message.info.height) == (3, 2)
    corner = message.info.origin
    assert (corner.position.x, corner.position.y, corner.position.z, corner.orientation.w) == (
        12.4,
        -3,
        7.5,
        1,
    )
    assert message.data.tolist() == [0, 0, -1, 100, 100, -1]

import numpy as np
import pytest
from support.report_cases import Case

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.model.tile import PointTile


def case(folder, house):
    pytest.importorskip("rclpy")
    from lidar_buildings.ros.point_cloud import from_message, to_message

    points = np.vstack([np.zeros((9, 3)), [[0.0, 1.88e30, 0.0]]])

    def check():
        reading = from_message(to_message(PointTile(points)))
        assert (len(reading.tile), reading.n_beyond) == (9, 1)
        with pytest.raises(MessageError, match="no point can be held"):
            from_message(to_message(PointTile(points[9:])))

    return Case(check=check)

import pytest

pytest.importorskip("rclpy")

import rclpy
from support.ros_domain import use_own_domain

from lidar_buildings.ros.middleware import prepare_middleware


@pytest.fixture
def context():
    use_own_domain()
    prepare_middleware()
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)

"""A driver that knows nothing of this package: publishes a cloud for each line that it reads, and says so."""

import sys

import numpy as np
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2


def drive(n_bytes):
    rclpy.init()
    node = rclpy.create_node("driver")
    publisher = node.create_publisher(PointCloud2, "scan", qos_profile_sensor_data)
    cloud = PointCloud2()
    cloud._data = np.zeros(n_bytes, dtype=np.uint8)
    for number, _ in enumerate(sys.stdin):
        cloud.width = number
        publisher.publish(cloud)
        print("published", flush=True)
    rclpy.shutdown()


if __name__ == "__main__":
    drive(int(sys.argv[1]))

"""The algorithms: arrays in, arrays out; no ROS, no files, no printing."""

from lidar_buildings.core.kernel_cache import use_kernel_folder

use_kernel_folder()

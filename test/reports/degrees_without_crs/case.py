import numpy as np
from support.cloud_files import random_cloud, saved
from support.report_cases import Case


def case(folder, house):
    cloud = random_cloud(500, point_format=6)
    cloud.header.scales, cloud.header.offsets = np.array([1e-7, 1e-7, 1e-3]), np.zeros(3)
    cloud.xyz = np.random.default_rng(0).uniform([4.36, 52.01, 0.0], [4.361, 52.011, 30.0], (500, 3))
    path = saved(cloud, folder / "degrees.laz")
    return Case(["inspect", path], status=2, says=["transform degrees to a reference system in metres first"])

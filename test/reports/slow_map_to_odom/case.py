import numpy as np
from support.bags import placed, write_chain
from support.report_cases import Case

from lidar_buildings.core.scans.config import ScanConfig


def case(folder, house):
    links = {("map", "odom"): (np.arange(12.0), 0.3), ("odom", "lidar"): (np.arange(0.0, 12.0, 0.02), 8.0)}
    drive = write_chain(folder / "bag", links)

    def check():
        las, count = placed(folder, drive.path, ScanConfig())
        assert (count.n_points, count.left_out) == (len(drive.points), {})
        assert np.abs(las.xyz - drive.points).max() < 0.02

    return Case(check=check)

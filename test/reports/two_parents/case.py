import numpy as np
from support.bags import placed, write_chain
from support.report_cases import Case

from lidar_buildings.core.scans.config import ScanConfig


def case(folder, house):
    poses = np.arange(0.0, 12.0, 0.02)
    links = {
        ("map", "odom"): (poses, 0.3),
        ("odom", "lidar"): (poses, 8.0),
        ("other", "lidar"): (poses, -3.0),
    }
    drive = write_chain(folder / "bag", links)

    def check():
        las, count = placed(folder, drive.path, ScanConfig())
        assert np.abs(las.xyz - drive.points).max() < 0.02
        assert (
            "frame 'lidar' has two parents, 'odom' and 'other': poses in 'odom' are taken"
            in count.warnings[0]
        )

    return Case(check=check)

import numpy as np
from support.bags import placed, write_chain
from support.report_cases import Case

from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.scan import OFF_TIME


def case(folder, house):
    wrong = []

    def change(offsets, number):
        if number % 3 == 0 and len(offsets):
            offsets[0] = 3_000_000_000
            wrong.append(number)
        return offsets

    poses = np.arange(0.0, 12.0, 0.02)
    drive = write_chain(
        folder / "bag", {("map", "odom"): (poses, 0.0), ("odom", "lidar"): (poses, 8.0)}, change=change
    )

    def check():
        las, count = placed(folder, drive.path, ScanConfig())
        assert count.left_out == {OFF_TIME: len(wrong)}
        lower = np.searchsorted(np.sort(drive.points[:, 2]), las.z - 0.002)
        upper = np.searchsorted(np.sort(drive.points[:, 2]), las.z + 0.002)
        assert (upper > lower).all()
        x = np.sort(drive.points[:, 0])
        near = x[np.clip(np.searchsorted(x, las.x), 1, len(x) - 1)]
        assert np.median(np.abs(near - las.x)) < 0.02

    return Case(check=check)

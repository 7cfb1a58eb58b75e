from support.bags import SCAN_TYPE, T0, BagWriter, placed
from support.report_cases import Case

from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.placing import UNREADABLE


def case(folder, house):
    bag = BagWriter(folder / "bag")
    for number in range(20):
        bag.write("/points", SCAN_TYPE, T0 + number, bag.cloud(T0 + number, "map", [[1.0, 2.0, number]]))
        if number == 10:
            bag.writer.write(bag.connections["/points"], T0 + number, b"")
    bag.close()

    def check():
        _, count = placed(folder, bag.path, ScanConfig())
        assert (count.n_points, count.messages) == (20, {UNREADABLE: 1})

    return Case(check=check)

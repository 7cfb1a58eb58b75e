import numpy as np
from support.bags import write_chain
from support.report_cases import Case, run_of


def case(folder, house):
    slow = [second for second in range(12) if not 3 < second < 9]
    links = {("map", "odom"): (slow, 0.3), ("odom", "lidar"): (np.arange(0.0, 12.0, 0.02), 8.0)}
    bag = write_chain(folder / "bag", links).path
    says = ["'odom' in 'map' (one every 1 s) have gaps of up to 6 s", "max_pose_gap"]
    return Case([*run_of(folder, bag), "--until", "ground_filter"], status=4, says=says)

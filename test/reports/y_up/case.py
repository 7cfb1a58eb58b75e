import numpy as np
from support.report_cases import Case, rewritten


def case(folder, house):
    def turned(cloud):
        x, y, z = np.array(cloud.xyz).T
        cloud.xyz = np.column_stack([x, z + y.min(), 4.0 * (y - y.min())])

    path = rewritten(house / "strip_01.laz", folder / "y_up.laz", turned)
    return Case(["plan", path], says=["heights seem to be in y, not in z"])

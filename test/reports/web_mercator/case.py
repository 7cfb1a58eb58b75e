import laspy
import numpy as np
import pyproj
from support.report_cases import Case, areas_of, rewritten, run_of, true_area

CORNER = np.array([1_113_000.0, 8_399_000.0, 0.0])


def case(folder, house):
    def stretched(cloud):
        places = np.asarray(cloud.xyz)
        header = laspy.LasHeader(point_format=6, version="1.4")
        header.scales, header.offsets = np.full(3, 0.001), CORNER
        header.add_crs(pyproj.CRS("EPSG:3857"))
        new = laspy.LasData(header)
        new.points = laspy.ScaleAwarePointRecord.zeros(len(places), header=header)
        new.xyz = CORNER + (places - [*places.min(axis=0)[:2], 0.0]) * [2.0, 2.0, 1.0]
        for name in ("return_number", "number_of_returns", "gps_time", "scan_angle", "intensity"):
            new[name] = cloud[name]
        return new

    def check():
        (area,) = areas_of(folder / "out")
        assert abs(area / true_area(house) - 1.0) < 0.05

    path = rewritten(house / "strip_01.laz", folder / "web.laz", stretched)
    says = ["EPSG:3857 is not true to scale here: 1 of x and y is 0.50"]
    return Case(run_of(folder, path), says=says, check=check)

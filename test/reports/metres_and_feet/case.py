import json

import numpy as np
import pyproj
from support.report_cases import Case, rewritten, run_of

from lidar_buildings.io.files.reference_systems import US_SURVEY_FOOT

SYSTEM = pyproj.crs.CompoundCRS("UTM 18N + NAVD88 (ftUS)", ["EPSG:26918", "EPSG:6360"])


def case(folder, house):
    def in_feet(cloud):
        places = np.asarray(cloud.xyz)
        cloud.header.offsets = cloud.header.offsets * [1.0, 1.0, 0.0]
        cloud.header.vlrs[:] = [one for one in cloud.header.vlrs if one.user_id != "LASF_Projection"]
        cloud.header.add_crs(SYSTEM)
        cloud.points.offsets = cloud.header.offsets
        cloud.xyz = places / [1.0, 1.0, US_SURVEY_FOOT]

    def check():
        lines = (folder / "out" / "city_model.city.jsonl").read_text().splitlines()
        header, first = json.loads(lines[0]), json.loads(lines[1])
        (building,) = first["CityObjects"].values()
        known = building["attributes"]
        assert header["transform"]["scale"] == [0.001] * 3
        assert header["metadata"]["title"].endswith("; x, y and z in metre")
        assert 3.0 < known["height"] < 12.0, "metres"
        assert known["volume"] < known["area"] * known["height"]
        assert "# Unit of x, y and z: metre" in (folder / "out" / "city_model.obj").read_text()

    path = rewritten(house / "strip_01.laz", folder / "mixed.laz", in_feet)
    says = [
        "x and y are in units of 1 metre, z of 1 US survey foot: models and attributes have 1 metre for all"
    ]
    return Case(run_of(folder, path), says=says, check=check)

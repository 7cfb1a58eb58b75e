import json

import numpy as np
from support.report_cases import CRS, Case, areas_of, run_of, true_middle


def case(folder, house):
    angle = np.linspace(0.0, 2.0 * np.pi, 1_000_000)
    radius = 6.0 + 0.1 * np.sin(9.0 * angle)
    ring = true_middle(house) + np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    path = folder / "round.geojson"
    shape = {"type": "Polygon", "coordinates": [ring.tolist()]}
    feature = {"type": "Feature", "properties": {}, "geometry": shape}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": CRS, "features": [feature]}))

    def check():
        (area,) = areas_of(folder / "out")
        assert abs(area - np.pi * 36.0) < 1.0

    arguments = [*run_of(folder, house / "strip_01.laz"), "--footprints", path]
    return Case(arguments, says=["footprints: 1 read, 1 simplified"], check=check)

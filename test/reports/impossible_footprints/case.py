import json

from support.report_cases import CRS, Case, run_of, true_middle


def case(folder, house):
    x, y = true_middle(house).tolist()
    rings = [
        [[x - 6, y - 6], [x + 6, y - 6], [x + 6, y + 6], [x - 6, y + 6], [x - 6, y - 6]],
        [[1e300, 0.0], [1e300, 1.0], [0.0, 1.0], [1e300, 0.0]],
        [[x, y], [float("nan"), y], [x, y + 1.0], [x, y]],
    ]
    shapes = [{"type": "Polygon", "coordinates": [ring]} for ring in rings]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    path = folder / "footprints.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": CRS, "features": features}))
    arguments = [*run_of(folder, house / "strip_01.laz"), "--footprints", path]
    return Case(arguments, says=["with coordinates that cannot be left out"])

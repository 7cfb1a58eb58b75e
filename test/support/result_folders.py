"""Result folders made by hand: models, a record, and a classified cloud of one house."""

import json

import laspy
import numpy as np
from support import model_survey
from support.model_survey import EAVE, GROUND, RIDGE

from lidar_buildings.io.models.survey_building import ModelHeading
from lidar_buildings.io.results.building_files import write_buildings

#: Points of the house's roof and of the ground a square metre.
DENSITY = 16.0


def written_models(folder, frame, formats=("gpkg", "cityjson"), **more):
    """Write models made by hand as a run does, with a record that names the files."""
    folder.mkdir(exist_ok=True)
    with model_survey.survey(folder, model_survey.shapes(frame), frame=frame) as survey:
        files, counts = write_buildings(folder, survey, formats, ModelHeading())
    place = {"crs": frame.crs, "origin": frame.origin, "horizontal_unit": frame.horizontal_unit}
    record = {
        "frame": {**place, "vertical_unit": frame.vertical_unit},
        "files": [*files, "run.json"],
        "until": "building_model",
        "buildings": counts.statuses,
        **more,
    }
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def with_points(folder, frame, seed=0, height=0.0, *, has_lawn=True):
    """
    Add a cloud to a result: the gable house's roof, a dormer without plane on it, a shed and a tree beside.

    The shed of 2 by 3 m is class 5 as the tree is; only the roof and the dormer are of the house. `height` is
    added to the heights above ground: NaN is that of points in no finished tile. Without a lawn all is alone.
    """
    random = np.random.default_rng(seed)
    slope = (RIDGE - EAVE) / 4.0
    xy = _scattered(random, 0, 0, 10, 8)
    south = xy[:, 1] < 4.0
    roof = np.column_stack([xy, RIDGE - slope * np.abs(xy[:, 1] - 4.0)])
    dormer = _scattered(random, 4.0, 1.0, 5.0, 2.0)
    lifted = np.column_stack([dormer, RIDGE - slope * np.abs(dormer[:, 1] - 4.0) + 1.0])
    shed = _scattered(random, 14, 2, 16, 5)
    tree = random.uniform((24.0, 20.0, 3.0), (27.0, 23.0, 8.0), (200, 3))
    lawn = _scattered(random, -8, -8, 30, 30)
    parts = [
        (roof, 6, 5, np.where(south, 1, 2)),
        (lifted, 6, 5, 0),
        (np.column_stack([shed, np.full(len(shed), GROUND + 2.5)]), 5, 0, 0),
        (tree, 5, 0, 0),
        (np.column_stack([lawn, np.full(len(lawn), GROUND)]), 2, 0, 0),
    ][: 5 if has_lawn else 4]
    points = np.concatenate([xyz for xyz, *_ in parts])
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 0.001), np.asarray(frame.origin)
    cloud = laspy.LasData(header)
    cloud.xyz = frame.to_source(points)
    cloud.classification = _column(parts, 1, np.uint8)
    for name, values in (
        ("HeightAboveGround", (points[:, 2] - GROUND + height).astype(np.float32)),
        ("Facade", np.zeros(len(points), dtype=np.uint8)),
        ("BuildingId", _column(parts, 2, np.uint32)),
        ("PlaneId", _column(parts, 3, np.uint16)),
    ):
        cloud.add_extra_dim(laspy.ExtraBytesParams(name, values.dtype))
        cloud[name] = values
    (folder / "classified").mkdir()
    cloud.write(folder / "classified" / "house.laz")
    record = json.loads((folder / "run.json").read_text())
    record["inputs"] = [{"path": "house.laz", "point_count": len(points), "output": "classified/house.laz"}]
    record["n_points"] = len(points)
    (folder / "run.json").write_text(json.dumps(record))
    return folder


def _scattered(random, west, south, east, north):
    n = round((east - west) * (north - south) * DENSITY)
    return random.uniform((west, south), (east, north), (n, 2))


def _column(parts, member, kind):
    return np.concatenate([np.broadcast_to(one[member], len(one[0])) for one in parts]).astype(kind)

"""``lidar-buildings score control``: a run's terrain and models against a cloud of the same place."""

import json

import numpy as np
import pytest
import rasterio
from support.score_files import write_cloud

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.evaluation.command.score import run_score
from lidar_buildings.simulation import make_scene
from lidar_buildings.simulation.survey import write_truth_city_model


@pytest.fixture(scope="module")
def sides(tmp_path_factory):
    """A result whose terrain is 0.07 m too high, and a cloud of ground and of roofs 0.05 m too high."""
    result, cloud = (tmp_path_factory.mktemp(name) for name in ("result", "cloud"))
    scene = make_scene("single_house")
    write_truth_city_model(result / "city_model.city.jsonl", scene)
    west, south, _ = scene.frame.origin
    width, depth = (int(2 * one) for one in scene.size)
    frame = {"horizontal_unit": 1.0, "vertical_unit": 1.0}
    (result / "run.json").write_text(json.dumps({"frame": frame}))
    x, y = np.meshgrid(np.arange(width) / 2 + 0.25, (depth - np.arange(depth)) / 2 - 0.25)
    dtm = scene.terrain.at(np.column_stack([x.ravel(), y.ravel()])).reshape(depth, width) + 0.07
    place = rasterio.Affine(0.5, 0.0, west, 0.0, -0.5, south + depth / 2)
    with rasterio.open(
        result / "dtm.tif",
        "w",
        driver="GTiff",
        width=width,
        height=depth,
        count=1,
        dtype="float64",
        transform=place,
    ) as file:
        file.write(dtm, 1)
    random = np.random.default_rng(0)
    xy = random.uniform(0, scene.size, (20_000, 2))
    ground = np.column_stack([xy, scene.terrain.at(xy)])
    write_cloud(cloud / "ground.laz", ground, 2, origin=scene.frame.origin)
    roofs = [
        np.column_stack([xy[plane > 0], elevation[plane > 0] + 0.05])
        for plane, elevation in (building.roof_at(xy) for building in scene.buildings)
    ]
    write_cloud(cloud / "roofs.laz", np.concatenate(roofs), 6, origin=scene.frame.origin)
    return result, cloud


def test_terrain_and_roofs_are_compared_with_a_cloud_of_other_points(sides):
    figures = run_score("control", *sides).figures
    assert figures["terrain_bias"] == pytest.approx(0.07, abs=0.005)
    assert figures["terrain_percentile_90"] == pytest.approx(0.07, abs=0.01)
    assert figures["roof_bias"] == pytest.approx(-0.05, abs=0.005)
    assert figures["roof_rmse"] == pytest.approx(0.05, abs=0.01)
    assert (figures["wall_n_cells"], figures["wall_median"], figures["wall_seen"]) == (0, None, 0.0)


def test_a_result_without_terrain_is_refused(sides, tmp_path):
    (tmp_path / "city_model.city.jsonl").write_bytes((sides[0] / "city_model.city.jsonl").read_bytes())
    with pytest.raises(InputError, match="control needs the output folder of a run"):
        run_score("control", tmp_path, sides[1])

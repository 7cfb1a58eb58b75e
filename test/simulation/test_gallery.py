"""The gallery of test scenes keeps its own promises."""

import numpy as np
import pytest
import shapely

from bench.scenes import buildings as scenes

HOUSES = sorted(set(scenes.GALLERY) - {"single_point", "collinear", "with_nan"})


@pytest.mark.parametrize("name", sorted(scenes.GALLERY))
def test_every_scene_has_one_truth_per_point_and_comes_out_the_same_twice(name):
    scene, again = scenes.GALLERY[name](seed=3), scenes.GALLERY[name](seed=3)
    assert scene.points.shape == (len(scene.is_ground), 3)
    assert len(scene.is_roof) == len(scene.roof_plane) == len(scene.building) == len(scene.points)
    assert np.array_equal(scene.points, again.points, equal_nan=True)
    assert not np.any(scene.is_ground & scene.is_roof)


@pytest.mark.parametrize("name", HOUSES)
@pytest.mark.parametrize("rotation_deg", [0.0, 33.0])
def test_roof_points_lie_on_their_plane_and_inside_their_outline(name, rotation_deg):
    scene = scenes.GALLERY[name](rotation_deg=rotation_deg, noise=0.02)
    for building in scene.buildings:
        rows = scene.building == building.number
        assert rows.sum() > 50
        a, b, c = building.planes[scene.roof_plane[rows] - 1].T
        x, y, z = scene.points[rows].T
        assert np.abs(z - (a * x + b * y + c)).max() < 5 * 0.02
        assert shapely.intersects_xy(building.polygon.buffer(1e-6), x, y).all()

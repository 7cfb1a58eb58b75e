"""The scenes of building models keep their own promises."""

import numpy as np
import pytest
import shapely

from bench.scenes.models import BAD_SCENES, GROUND, SHAPES, model_scene, roof_words
from lidar_buildings.core.solids.validity import check_solid


@pytest.mark.parametrize("name", SHAPES)
def test_points_lie_on_their_plane_inside_the_outline_and_the_solid_is_valid(name):
    scene = model_scene(name, rotation_deg=33.0, noise=0.01)
    a, b, c = scene.building.planes[scene.plane_id - 1].T
    x, y, z = scene.points.T
    assert np.abs(z - (a * x + b * y + c)).max() < 0.06
    assert shapely.intersects_xy(scene.building.polygon.buffer(1e-6), x, y).all()
    assert len(scene.points) / scene.building.polygon.area == pytest.approx(8.0, rel=0.1)
    assert roof_words(name)
    assert check_solid(scene.solid) == ()
    faces = scene.building.faces
    heights = [face.elevation(np.array(face.polygon.centroid.coords))[0] - GROUND for face in faces]
    volume = np.dot([face.polygon.area for face in faces], heights)
    assert scene.volume == pytest.approx(volume, rel=5e-5)


def test_ridges_are_as_high_as_the_roof():
    scene = model_scene("l_shape", rotation_deg=10.0)
    assert sorted(scene.ridges[:, :, 2].mean(axis=1)) == pytest.approx(
        [GROUND + 5 + h * np.tan(np.deg2rad(35)) for h in (3.5, 4.5)], abs=1e-3
    )


@pytest.mark.parametrize("name", BAD_SCENES)
def test_bad_scenes_come_out_the_same_twice(name):
    scene, again = (BAD_SCENES[name](rotation_deg=40.0, seed=3) for _ in range(2))
    assert np.array_equal(scene.points, again.points)
    assert len(scene.points) == len(scene.plane_id) > 100


def test_bad_scenes_are_bad_in_the_way_that_they_say():
    yard = BAD_SCENES["touching_courtyard"](rotation_deg=25.0).outline
    ring = shapely.LinearRing(yard.exterior)
    assert shapely.distance(ring, shapely.points(yard.holes[0])).min() < 1e-9
    assert len(np.unique(BAD_SCENES["coincident_planes"]().given_planes)) == 10
    assert np.bincount(BAD_SCENES["small_plane"]().plane_id)[2] < 8
    assert (BAD_SCENES["tree_grown_in"]().plane_id == 0).sum() > 50
    assert BAD_SCENES["no_ground"]().ground_elevation is None
    assert set(BAD_SCENES["one_face_missing"]().plane_id) == {1}

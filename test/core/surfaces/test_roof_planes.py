"""The joint adjustment of a roof's planes."""

import numpy as np
import pytest

from bench.scenes.models import model_scene
from lidar_buildings.core.surfaces.plane_adjustment import CommonVertex, adjust, common_point, multipliers
from lidar_buildings.core.surfaces.roof_planes import POINTS_SHARED, fitted_planes, plane_moments


def adjusted(points, plane_id):
    return adjust(points, np.asarray(plane_id, np.uint16)).planes


@pytest.mark.parametrize("name", ["gable", "hip", "l_shape", "mansard", "pitched_courtyard"])
@pytest.mark.parametrize("rotation_deg", [0, 27])
def test_adjusted_planes_are_those_of_the_building(name, rotation_deg):
    scene = model_scene(name, rotation_deg=rotation_deg)
    for plane, face in zip(adjusted(scene.points, scene.plane_id), scene.building.faces, strict=True):
        assert np.degrees(np.arccos(np.clip(plane.normal @ face.normal, -1.0, 1.0))) < 0.2
        middle = face.polygon.representative_point().coords[0]
        assert plane.elevation(np.array([middle]))[0] == pytest.approx(
            face.elevation(np.array([middle]))[0], abs=0.02
        )
        assert plane.rms == pytest.approx(0.03 * plane.normal[2], rel=0.3)


def test_the_covariance_of_a_plane_is_the_scatter_of_planes_of_other_noise():
    scene, random = model_scene("shed", density=1.0, noise=0.0), np.random.default_rng(1)
    corners = scene.building.exterior
    heights, sigmas = [], []
    for _ in range(300):
        noisy = scene.points + np.outer(random.normal(0.0, 0.05, len(scene.points)), [0, 0, 1])
        (plane,) = fitted_planes(noisy, scene.plane_id)
        heights.append(plane.elevation(corners))
        sigmas.append(plane.elevation_sigma(corners))
    independent = np.sqrt(np.mean(np.square(sigmas), axis=0) / POINTS_SHARED)
    assert independent == pytest.approx(np.std(heights, axis=0), rel=0.15)


def test_the_covariance_of_a_plane_of_points_on_a_line_is_finite_and_large():
    line = np.column_stack([np.arange(9.0), np.zeros(9), np.ones(9)])
    (plane,) = fitted_planes(line, np.ones(9, np.uint16))
    on, beside = plane.elevation_sigma(np.array([[4.0, 0.0], [4.0, 2.0]]))
    assert on < 0.02
    assert 1.0 < beside < np.inf


def test_planes_are_as_unsure_as_the_corner_is_that_they_were_made_to_meet_at():
    """Both faces of a gable are drawn 5 cm aside, as by an outline that is off."""
    scene = model_scene("gable", density=16.0, noise=0.02)
    (end, _) = scene.ridges[0]
    aside = end[:2] + 0.05 * scene.normals[0, :2] / np.hypot(*scene.normals[0, :2])
    found = adjust(scene.points, scene.plane_id)
    moved = found.with_common_vertices([CommonVertex((1, 2), tuple(aside), True)])
    assert len(moved.vertices) == 1
    for before, plane in zip(found.planes, moved.planes, strict=True):
        off = abs(plane.elevation(end[None, :2])[0] - end[2])
        assert off > 3.0 * before.elevation_sigma(end[None, :2])[0]
        assert off < 2.0 * plane.elevation_sigma(end[None, :2])[0]


def test_a_slope_that_is_none_becomes_level_and_a_drained_roof_stays_as_it_is():
    flat = model_scene("flat")
    (plane,) = adjusted(flat.points, flat.plane_id)
    assert plane.normal.tolist() == [0.0, 0.0, 1.0]
    drained = flat.points + np.outer(flat.points[:, 0] * 0.03, [0, 0, 1])
    (plane,) = adjusted(drained, flat.plane_id)
    assert plane.gradient[0] == pytest.approx(0.03, abs=0.002)


def test_faces_whose_slopes_differ_beyond_noise_keep_them():
    scene = model_scene("gable")
    points = scene.points.copy()
    south = scene.plane_id == 1
    points[south, 2] += 0.1 * (points[south, 1] - points[south, 1].max())
    first, second = adjusted(points, scene.plane_id)
    steepness = [float(np.hypot(*plane.gradient)) for plane in (first, second)]
    assert abs(steepness[0] - steepness[1]) == pytest.approx(0.1, abs=0.01)


def test_pieces_of_one_plane_become_one():
    scene = model_scene("flat")
    halves = np.where(scene.points[:, 0] < 40, 1, 2)
    first, second = adjusted(scene.points, halves)
    assert first.centroid[2] == second.centroid[2]


def test_planes_meet_in_a_point_to_rounding():
    scene = model_scene("pyramid", rotation_deg=10, seed=3)
    adjustment = adjust(scene.points, scene.plane_id)
    vertex = CommonVertex((1, 2, 3, 4), (40.1, 29.9), False)
    _, before = common_point(adjustment.coefficients)
    _, after = common_point(adjustment.with_common_vertices([vertex]).coefficients)
    assert before > 1e-4
    assert after < 1e-8


def test_planes_meet_over_a_corner_if_it_is_near_enough_and_not_if_it_is_not():
    scene = model_scene("hip")
    corner = scene.outline.exterior[np.argmax(scene.outline.exterior.sum(axis=1))]
    touching = [
        k + 1
        for k, face in enumerate(scene.building.faces)
        if np.hypot(*(face.rings[0] - corner).T).min() < 1e-6
    ]
    for shift, met in ((0.03, True), (0.8, False)):
        xy = corner + np.array([shift, 0.0])
        vertex = CommonVertex(tuple(touching), tuple(xy), True)
        planes = adjust(scene.points, scene.plane_id).with_common_vertices([vertex]).planes
        one, other = (planes[k - 1].elevation(xy[None])[0] for k in touching)
        assert (abs(one - other) < 1e-9) == met
        assert max(plane.rms for plane in planes) < 0.05


def test_the_order_of_points_does_not_matter():
    scene = model_scene("hip", rotation_deg=5)
    order = np.random.default_rng(1).permutation(len(scene.points))
    one = adjusted(scene.points, scene.plane_id)
    other = adjusted(scene.points[order], scene.plane_id[order])
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.normal, b.normal)
        assert np.array_equal(a.centroid, b.centroid)


@pytest.mark.parametrize(
    ("points", "plane_id"),
    [
        (np.zeros((0, 3)), []),
        (np.zeros((1, 3)), [1]),
        (np.zeros((5, 3)), [0, 0, 0, 0, 0]),
        (np.ones((6, 3)), [1, 1, 2, 2, 3, 3]),
        (np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)]), [1, 1, 1, 2, 2, 2]),
        (np.column_stack([np.zeros(6), np.arange(6.0) % 3, np.arange(6.0)]), [2] * 6),
        (np.random.default_rng(0).normal(size=(40, 3)) * 1e4, np.arange(40) % 9),
    ],
)
def test_degenerate_points_give_planes(points, plane_id):
    planes = adjusted(points, plane_id)
    assert len(planes) == max([*plane_id, 0])
    for plane in planes:
        assert np.linalg.norm(plane.normal) == pytest.approx(1.0)
        assert np.all(np.isfinite(plane.centroid))


def test_moments_are_those_of_numpy():
    random = np.random.default_rng(2)
    points = random.normal(size=(500, 3)) * (20, 10, 3)
    plane_id = random.integers(0, 3, 500).astype(np.uint16)
    moments = plane_moments(points, plane_id, 2)
    about = points[plane_id == 2] - moments.centre
    assert moments.sums[1, 0] == len(about)
    assert moments.sums[1, 1:4] == pytest.approx(about.sum(axis=0), abs=0.02)
    assert moments.sums[1, 6] == pytest.approx((about[:, 0] * about[:, 2]).sum(), rel=1e-3)


def test_multipliers_are_those_of_the_bordered_system():
    random = np.random.default_rng(0)
    root = random.normal(size=(8, 8)) + 2 * np.eye(8)
    normal, target, rows = root @ root.T, random.normal(size=8), random.normal(size=(3, 8))
    system = np.block([[normal, rows.T], [rows, np.zeros((3, 3))]])
    expected = np.linalg.solve(system, np.append(target, np.zeros(3)))
    doubled = np.vstack([rows, rows[0] - rows[1]])
    nearest = np.linalg.solve(normal, target)
    found = multipliers(doubled, doubled @ np.linalg.inv(normal), nearest)
    assert found == pytest.approx(np.append(expected[8:], 0.0))

"""The joint adjustment of a roof's planes."""

import numpy as np
import pytest

from bench.scenes.models import model_scene
from lidar_buildings.core.surfaces.plane_adjustment import (
    CORNER,
    POINT,
    SLOPE,
    STRIKE,
    Condition,
    adjust,
    common_point,
    inverted,
)
from lidar_buildings.core.surfaces.roof_planes import POINTS_SHARED, PlaneSums, fitted_planes, plane_moments


def adjusted(points, plane_id):
    return adjust(points, np.asarray(plane_id, np.uint16)).planes


def corner(found, planes, xy, sigma=0.02):
    """Two planes are as high at a place in the map frame."""
    place = np.append(np.array(xy) - found.centre[:2], 1.0)
    return Condition(CORNER, planes, sigma, np.array([[place, -place]]))


def touching(scene, corner):
    """Return the numbers of the planes of faces that have a corner."""
    away = [np.hypot(*(face.rings[0] - corner).T).min() for face in scene.building.faces]
    return tuple((np.flatnonzero(np.array(away) < 1e-6) + 1).tolist())


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
    moved = found.under([corner(found, (1, 2), aside, sigma=0.05)])
    assert [one.kind for one in moved.held] == [CORNER]
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
    free = adjust(scene.points, scene.plane_id)
    misses = []
    for found in (free, free.under([Condition(POINT, (1, 2, 3, 4), 0.02)])):
        x, y, z = common_point(found.coefficients)
        misses.append(np.abs(found.coefficients @ (x, y, 1.0) - z).max())
    assert misses[0] > 1e-4
    assert misses[1] < 1e-8


def test_planes_meet_over_a_corner_if_it_is_near_enough_and_not_if_it_is_not():
    scene = model_scene("hip")
    at = scene.outline.exterior[np.argmax(scene.outline.exterior.sum(axis=1))]
    pair = touching(scene, at)
    for shift, met in ((0.03, True), (0.8, False)):
        xy = at + np.array([shift, 0.0])
        free = adjust(scene.points, scene.plane_id)
        planes = free.under([corner(free, pair, xy)]).planes
        one, other = (planes[k - 1].elevation(xy[None])[0] for k in pair)
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


def test_the_inverse_is_numpy_s_and_leaves_out_rows_that_follow_from_others():
    root = np.random.default_rng(0).normal(size=(6, 6))
    matrix = root @ root.T
    assert inverted(matrix) == pytest.approx(np.linalg.inv(matrix))
    rows = np.vstack([np.eye(6), np.eye(6)[0] - np.eye(6)[1]])
    expected = np.zeros((7, 7))
    expected[:6, :6] = np.linalg.inv(matrix)
    assert inverted(rows @ matrix @ rows.T) == pytest.approx(expected, abs=1e-9)


def hip_with_conditions():
    """A hip roof whose four planes meet at a corner, are as steep and fall along the axes."""
    scene = model_scene("hip", density=2.0, seed=1)
    found = adjust(scene.points, scene.plane_id)
    gradients = found.coefficients[:, :2]
    unit = gradients / np.hypot(*gradients.T)[:, None]
    at = scene.outline.exterior[0]
    conditions = [corner(found, touching(scene, at), at, sigma=0.03)]
    for k in (1, 2, 3):
        factors = np.zeros((1, 2, 3))
        factors[0, :, :2] = unit[0], -unit[k]
        conditions.append(Condition(SLOPE, (1, k + 1), 0.01, factors))
    for k, own in enumerate(unit):
        along = np.rint([-own[1], own[0]])
        conditions.append(Condition(STRIKE, (k + 1,), 0.005, np.array([[[*along, 0.0]]])))
    return found, conditions


def dense(found, conditions):
    """Return R, σ² and the free planes' covariance of all unknown together."""
    n = len(found.coefficients)
    rows = np.zeros((len(conditions), n, 3))
    for row, one in zip(rows, conditions, strict=True):
        row[np.array(one.planes) - 1] = one.factors[0]
    covariance = np.zeros((n, 3, n, 3))
    covariance[np.arange(n), :, np.arange(n)] = found.covariances
    return (
        rows.reshape(-1, 3 * n),
        np.array([one.sigma**2 for one in conditions]),
        covariance.reshape(3 * n, -1),
    )


def test_the_adjustment_is_the_least_squares_solution_and_its_covariance_the_propagated_one():
    found, conditions = hip_with_conditions()
    rows, variance, covariance = dense(found, conditions)
    adjusted = found.under(conditions)
    assert len(adjusted.held) == len(conditions)
    # The corner is met exactly, the others are observations: normal equations, bordered by the corner.
    soft, normal = rows[1:], np.linalg.inv(covariance)
    normal = normal + soft.T @ (soft / variance[1:, None])
    bordered = np.linalg.inv(np.block([[normal, rows[:1].T], [rows[:1], np.zeros((1, 1))]]))
    # What the planes and the conditions are wrong by goes through this into the result.
    gain = np.hstack([np.linalg.inv(covariance), soft.T / variance[1:]])
    of_all = bordered[:-1] @ np.vstack(
        [np.hstack([gain, np.zeros((len(gain), 1))]), np.eye(1, gain.shape[1] + 1, gain.shape[1])]
    )
    expected = of_all[:, : len(normal)] @ found.coefficients.ravel()
    assert adjusted.coefficients.ravel() == pytest.approx(expected, abs=1e-9)
    errors = np.zeros((of_all.shape[1],) * 2)
    errors[: len(normal), : len(normal)] = covariance
    errors[len(normal) :, len(normal) :] = np.diag(np.append(variance[1:], variance[0]))
    propagated = of_all @ errors @ of_all.T
    for k, own in enumerate(adjusted.covariances):
        block = propagated[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        assert own == pytest.approx(block, rel=1e-6, abs=1e-12)


def test_the_condition_that_does_not_hold_is_the_one_that_is_refused():
    found, conditions = hip_with_conditions()
    turned = Condition(STRIKE, (2,), 0.005, np.array([[[np.cos(0.2), np.sin(0.2), 0.0]]]))
    adjusted = found.under([*conditions, turned])
    assert adjusted.refused == (turned,)
    assert np.array_equal(adjusted.coefficients, found.under(conditions).coefficients)


def test_slopes_too_unsure_to_tell_are_not_said_to_be_equal():
    scene = model_scene("gable")
    few = np.flatnonzero(scene.plane_id == 1)[:5]
    rows = np.concatenate([few, np.flatnonzero(scene.plane_id == 2)])
    found = adjust(scene.points[rows], scene.plane_id[rows])
    factors = np.array([[[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]])
    adjusted = found.under([Condition(SLOPE, (1, 2), 0.01, factors)])
    assert adjusted.held == adjusted.refused == ()


def test_sums_of_portions_in_any_order_are_those_of_all_points():
    scene = model_scene("hip", density=2.0)
    all_at_once = plane_moments(scene.points, scene.plane_id, 4)
    sums = PlaneSums(all_at_once.centre, 4)
    order = np.random.default_rng(0).permutation(len(scene.points))
    for rows in np.array_split(order, 5):
        sums.add(scene.points[rows], scene.plane_id[rows])
    assert np.array_equal(sums.moments.sums, all_at_once.sums)

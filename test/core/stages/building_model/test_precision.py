"""How sure corners are, against the scatter of what chance does to them."""

import numpy as np
import pytest

from bench.scenes.models import model_scene
from lidar_buildings.core.stages.building_model.model import build_model
from lidar_buildings.core.stages.building_model.precision import Conditions, corner_covariances


def conditions(*planes):
    """Return planes (normal, sigma) through one corner; those without z are walls."""
    normals = np.array([normal for normal, _ in planes], dtype=float)
    sigmas = np.array([sigma for _, sigma in planes])
    return Conditions(np.zeros(len(planes), dtype=np.int64), normals, sigmas, normals[:, 2] == 0.0)


@pytest.mark.parametrize(
    "planes",
    [
        pytest.param([((0, 0.6, 1), 0.02), ((0, -0.6, 1), 0.03), ((0.8, 0.6, 0), 0.1)], id="ridge at a wall"),
        pytest.param([((0, 0.6, 1), 0.02), ((1, 0, 0), 0.1), ((0.28, 0.96, 0), 0.2)], id="eave"),
        pytest.param([((0, 0.6, 1), 0.02), ((0, -0.6, 1), 0.02), ((0.5, 0, 1), 0.05)], id="hip"),
    ],
)
def test_a_covariance_is_the_scatter_of_corners_on_planes_that_chance_moves(planes):
    own = conditions(*planes)
    moved = np.random.default_rng(0).normal(0.0, own.sigma, (20000, 3))
    corners = np.linalg.solve(own.normal, moved.T)
    expected = corner_covariances(own, 1, loose=1e3)[0]
    assert np.cov(corners) == pytest.approx(expected, rel=0.05, abs=0.02 * expected.max())


def test_what_nothing_fixes_is_as_sure_as_that():
    ridge = conditions(((0, 0.6, 1), 0.02), ((0, -0.6, 1), 0.02))
    x, y, z = np.sqrt(np.diagonal(corner_covariances(ridge, 1, loose=0.5)[0]))
    assert x == pytest.approx(0.5)
    assert max(y, z) < 0.03


def sigmas_of(scene, **options):
    """Return the standard deviations of a model's roof corners, shape (n, 3), and its attributes."""
    model = build_model(
        scene.points,
        scene.outline,
        plane_id=scene.plane_id,
        ground_elevation=scene.ground_elevation,
        **options,
    )
    told = [one["corner_sigmas"][0] for one in model.of_faces["2.2"] if "corner_sigmas" in one]
    return np.concatenate([np.array(ring, dtype=float) for ring in told]), model


def test_a_model_is_surer_the_more_points_it_is_made_of():
    dense, _ = sigmas_of(model_scene("gable", density=20.0), is_traced=True)
    sparse, _ = sigmas_of(model_scene("gable", density=1.0), is_traced=True)
    biased, _ = sigmas_of(model_scene("gable", density=20.0), is_traced=True, wall_bias=0.1)
    assert (2.0 * dense < sparse).all()
    assert (dense <= biased).all()
    assert biased[:, :2].max() > 2.0 * dense[:, :2].max()


def test_a_given_outline_is_taken_as_right_and_its_corners_have_a_height_alone():
    sigmas, model = sigmas_of(model_scene("hip"))
    on_outline = np.isnan(sigmas[:, 0])
    assert 0 < on_outline.sum() < len(sigmas)
    assert np.isfinite(sigmas[:, 2]).all()
    assert not any("position_sigma" in one for one in model.of_faces["2.2"])
    assert 0.0 < model.attributes["corner_sigma_xy"] < 0.1
    assert 0.0 < model.attributes["corner_sigma_z"] < 0.05

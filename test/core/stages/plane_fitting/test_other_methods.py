"""Planes as clusters of normals, and planes by Open3D."""

import sys

import numpy as np
import pytest
from scipy.optimize import minimize

from bench.scenes import buildings as scenes
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.stages.plane_fitting import fuzzy_clusters
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.core.stages.plane_fitting.fitting import fit_roof_planes
from lidar_buildings.evaluation.scores.planes import score_planes

FUZZY = PlaneFittingConfig(method="fuzzy_k_means")


def unit(angles):
    """Normals of so much slope in an aspect."""
    slope, aspect = np.reshape(angles, (-1, 2)).T
    return np.column_stack([np.sin(slope) * np.cos(aspect), np.sin(slope) * np.sin(aspect), np.cos(slope)])


def roof_of(name):
    scene = scenes.GALLERY[name](density=8.0, rotation_deg=20)
    truth = scene.roof_plane.astype(int) + 100 * scene.building
    return scene.points[scene.is_roof], truth[scene.is_roof]


def scattered_normals():
    random = np.random.default_rng(3)
    about = np.array([[0.5, 0.3], [0.5, 2.1], [0.1, 4.0]])
    return unit(np.repeat(about, (300, 120, 60), axis=0) + random.normal(0, 0.05, (480, 2))), about


@pytest.mark.parametrize("name", ["flat", "gable", "hip", "l_shape", "t_shape", "step_roof", "courtyard"])
def test_each_plane_of_a_roof_is_a_cluster_of_normals(name):
    points, truth = roof_of(name)
    score = score_planes(fit_roof_planes(points, FUZZY).plane_id, truth)
    assert (score.f1, score.n_planes_result) == (1.0, len(np.unique(truth)))
    assert score.weighted_coverage > 0.9


def test_potentials_tell_how_many_clusters_of_normals_there_are():
    normals, about = scattered_normals()
    starts = fuzzy_clusters.starts_by_potential(normals, np.ones(len(normals)), 10)
    nearest = np.arccos(np.clip(starts @ unit(about).T, -1, 1))
    assert nearest.argmin(axis=1).tolist() == [0, 1, 2]
    assert nearest.min(axis=1).max() < 0.05


def test_centres_are_where_bezdeks_objective_is_least():
    normals, about = scattered_normals()
    centres = fuzzy_clusters.fuzzy_k_means(normals, np.ones(len(normals)), unit(about + 0.1))

    def objective(angles):
        squares = ((normals[:, None] - unit(angles)[None]) ** 2).sum(axis=2)
        return (1.0 / (1.0 / squares).sum(axis=1)).sum()  # memberships at their best

    best = minimize(objective, about.ravel(), method="Nelder-Mead", options={"xatol": 1e-6, "maxiter": 2000})
    assert np.abs(centres - unit(best.x)).max() < 1e-3


@pytest.mark.parametrize(
    "xyz",
    [
        [(0.5 * k, 1.0, 0.3 * i) for k in range(20) for i in range(9)],  # a wall: no Voronoi cells in plan
        [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)],
        np.random.default_rng(0).uniform(0, 10, (60, 3)),
    ],
)
def test_what_has_no_roof_plane_has_no_cluster(xyz):
    assert fit_roof_planes(np.array(xyz), FUZZY).planes == ()


def test_clusters_do_not_depend_on_the_order_of_points():
    points, _ = roof_of("hip")
    order = np.random.default_rng(1).permutation(len(points))
    straight, shuffled = (fit_roof_planes(p, FUZZY).plane_id for p in (points, points[order]))
    assert np.array_equal(shuffled, straight[order])


@pytest.mark.parametrize("name", ["gable", "step_roof"])
def test_open3d_finds_the_planes_of_a_roof(name):
    pytest.importorskip("open3d", reason="Open3D is not installed", exc_type=ImportError)
    points, truth = roof_of(name)
    found = fit_roof_planes(points, PlaneFittingConfig(method="open3d"))
    assert score_planes(found.plane_id, truth).f1 == 1.0


def test_without_open3d_the_method_is_refused_with_the_remedy(monkeypatch):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(ParameterError, match=r"plane_fitting.method = 'open3d': .*pip install"):
        PlaneFittingConfig(method="open3d")

"""Alpha shapes: against the definition, with densities that change, and where they fall apart."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.distance import cdist
from support.traced_rings import assert_sound, overlap, polygon

from bench.scenes.buildings import GALLERY
from lidar_buildings.core.stages.boundary_tracing import alpha_shape
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary

CONFIG = BoundaryTracingConfig(method="alpha_shape", min_courtyard_area=0.0)


def with_heights(xy):
    return np.column_stack([xy, np.zeros(len(xy))])


def edges_by_discs(xy, alpha):
    """Pairs of points of which one disc of radius alpha through both is empty and the other is not."""
    one, other = np.nonzero(np.triu(cdist(xy, xy) < 2 * alpha, 1))
    half, middle = (xy[other] - xy[one]) / 2, (xy[one] + xy[other]) / 2
    length = np.hypot(*half.T)
    off = (half[:, ::-1] * [-1, 1]) * (np.sqrt(alpha**2 - length**2) / length)[:, None]
    is_empty = []
    for centre in (middle + off, middle - off):
        away = cdist(centre, xy)
        away[np.arange(len(one)), one] = away[np.arange(len(one)), other] = np.inf
        is_empty.append(away.min(axis=1) >= alpha)
    regular = is_empty[0] != is_empty[1]
    return set(zip(one[regular].tolist(), other[regular].tolist(), strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_of_one_radius_the_boundary_is_where_one_disc_is_empty(seed):
    xy = np.random.default_rng(seed).uniform(0, 10, (300, 2))
    xy = xy[np.abs(xy - 5).max(axis=1) > 1.5]
    mesh = Delaunay(xy)
    kept = alpha_shape.circumradii(xy[mesh.simplices]) <= 0.9
    found = np.sort(np.column_stack(alpha_shape._boundary(mesh, kept)), axis=1)
    assert {tuple(edge) for edge in found.tolist()} == edges_by_discs(xy, 0.9)


@pytest.mark.parametrize("name", ["flat", "l_shape", "courtyard", "round_tower"])
def test_the_ring_of_a_virtual_house_follows_its_truth(name):
    scene = GALLERY[name](rotation_deg=20.0)
    points = scene.roof_points()
    traced = trace_boundary(points, BoundaryTracingConfig(method="alpha_shape"))
    assert_sound(traced, points)
    truth = scene.buildings[0].polygon
    assert len(traced.outline.holes) == len(truth.interiors)
    assert overlap(polygon(traced.outline), truth) > 0.93


def test_the_radius_follows_the_spacing_about_a_place():
    """A notch of 1.5 m stays in the dense half; the sparse half, points 1 m apart, is one with it."""
    step = np.arange(0, 12, 0.25)
    dense = np.array([(x, y) for x in step for y in step if not (4 < x < 5.5 and y < 6)])
    sparse = np.array([(x, y) for x in np.arange(12, 24.0) for y in np.arange(0, 12.0)])
    points = with_heights(np.concatenate([dense, sparse]) + 1e-4 * np.random.default_rng(0).normal(size=2))
    traced = trace_boundary(points, BoundaryTracingConfig(method="alpha_shape"))
    assert_sound(traced, points)
    assert traced.outline.holes == ()
    assert polygon(traced.outline).area == pytest.approx(11.75 * 11.75 + 11.25 * 11 - 1.75 * 6, rel=0.03)


def test_neither_order_nor_repetition_of_points_matters():
    points = GALLERY["courtyard"](rotation_deg=10.0).roof_points()
    order = np.random.default_rng(1).permutation(len(points))
    again = trace_boundary(np.vstack([points[order], points[:50]]), CONFIG)
    assert again.outline.same_as(trace_boundary(points, CONFIG).outline)


@pytest.mark.parametrize("seed", range(20))
def test_scattered_points_and_parts_that_hang_apart_get_one_sound_ring(seed):
    random = np.random.default_rng(seed)
    xy = random.uniform(0, 5, (random.integers(4, 60), 2))
    points = with_heights(np.concatenate([xy, xy + np.array([random.uniform(0, 15), 0.0])]))
    assert_sound(trace_boundary(points, CONFIG), points)


def test_a_lattice_has_the_corners_of_its_square():
    points = with_heights(np.array([(x, y) for x in range(8) for y in range(8)], dtype=float))
    traced = trace_boundary(points, CONFIG)
    assert_sound(traced, points)
    assert polygon(traced.outline).area == 49.0

import laspy
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support.traced_rings import assert_sound, overlap, polygon

from bench.scenes.buildings import GALLERY
from lidar_buildings.core.model.outline import signed_area
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.neighbours.point_spacing import measure_spacing
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing.config import BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.point_grid import build_point_grid
from lidar_buildings.core.stages.boundary_tracing.rings import RingTracer, characteristic_ring
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary
from lidar_buildings.core.stages.segmentation.segmentation import segment_buildings

HOUSES = ("flat", "gable", "hip", "l_shape", "t_shape", "courtyard", "round_tower")


@pytest.mark.parametrize("rotation_deg", [0.0, 20.0, 45.0])
@pytest.mark.parametrize("name", HOUSES)
def test_the_ring_of_a_virtual_house_follows_its_truth(name, rotation_deg):
    scene = GALLERY[name](rotation_deg=rotation_deg)
    points = scene.roof_points()
    traced = trace_boundary(points)
    assert_sound(traced, points)
    assert (traced.status, traced.reason) == (BuildingStatus.OK, "")
    truth = scene.buildings[0]
    assert len(traced.outline.holes) == len(truth.polygon.interiors)
    # The ring lies inside the roof's edge by about half a spacing, and may cut across concave corners.
    assert overlap(polygon(traced.outline), truth.polygon) > 0.93
    assert truth.polygon.buffer(traced.point_spacing).contains(polygon(traced.outline))


def test_vertices_are_points_of_the_building():
    points = GALLERY["courtyard"]().roof_points()
    given_positions = {tuple(position) for position in points[:, :2].tolist()}
    for ring in trace_boundary(points).outline.rings:
        assert {tuple(vertex) for vertex in ring.tolist()} <= given_positions


def test_neither_order_nor_repetition_nor_height_of_points_matters():
    points = GALLERY["courtyard"](rotation_deg=10.0).roof_points()
    traced = trace_boundary(points)
    order = np.random.default_rng(1).permutation(len(points))
    shuffled = np.vstack([points[order], points[:50]])
    shuffled[:, 2] = 0.0
    assert trace_boundary(shuffled).outline.same_as(traced.outline)


def test_small_gaps_are_no_courtyards_and_large_ones_are():
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 20, (4000, 2))
    small = np.abs(xy - (5, 5)).max(axis=1) < 0.6
    large = np.abs(xy - (13, 13)).max(axis=1) < 3.0
    points = np.column_stack([xy, np.zeros(len(xy))])[~small & ~large]
    holes = trace_boundary(points).outline.holes
    assert len(holes) == 1
    assert 36.0 < -signed_area(holes[0]) < 46.0
    config = BoundaryTracingConfig(min_courtyard_area=60.0)
    assert trace_boundary(points, config).outline.holes == ()


@pytest.mark.parametrize(
    "xy",
    [
        [(1.0, 2.0)],
        [(1.0, 2.0)] * 30,
        [(0.0, 0.0), (3.0, 1.0)],
        [(0.0, 0.0), (3.0, 1.0), (1.0, 2.0)],
        [(0.5 * k, 0.25 * k) for k in range(40)],
        [(2.0, 0.1 * k) for k in range(40)],
        [(1e6 + 0.5 * k, 1e6) for k in range(4)],
    ],
)
def test_points_without_a_shape_are_degenerate_and_get_a_ring_all_the_same(xy):
    points = np.column_stack([np.array(xy), np.zeros(len(xy))])
    traced = trace_boundary(points)
    assert traced.status is BuildingStatus.DEGENERATE
    assert traced.reason
    assert len(traced.outline.exterior) >= 3
    assert_sound(traced, points)


def test_no_points_give_an_empty_ring():
    traced = trace_boundary(np.zeros((0, 3)))
    assert traced.status is BuildingStatus.DEGENERATE
    assert traced.outline.exterior.shape == (0, 2)


@settings(max_examples=120)
@given(arrays(np.float32, st.tuples(st.integers(1, 80), st.just(2)), elements=st.floats(-50, 50, width=16)))
def test_any_cloud_has_a_valid_ring_that_holds_all_its_points(xy):
    points = np.column_stack([xy.astype(np.float64), np.zeros(len(xy))])
    assert_sound(trace_boundary(points), points)


@settings(max_examples=60)
@given(arrays(np.int64, st.tuples(st.integers(1, 120), st.just(2)), elements=st.integers(0, 9)))
def test_points_of_a_lattice_have_a_valid_ring(cells):
    points = np.column_stack([cells * 0.5, np.zeros(len(cells))])
    assert_sound(trace_boundary(points), points)


def test_where_no_walk_succeeds_the_ring_comes_from_a_triangulation():
    # Two clouds farther apart than the reach may grow: no walk can hold both.
    rng = np.random.default_rng(0)
    positions = np.vstack([rng.uniform(0, 5, (60, 2)), rng.uniform(0, 5, (60, 2)) + np.array([100.0, 0.0])])
    tracer = RingTracer(build_point_grid(positions, ScanPattern.isotropic(1.0), window=4.0), max_reach=2.0)
    tracer.trace_exterior()
    assert any("triangulation" in reason for reason in tracer.reasons)
    ring = shapely.Polygon(tracer.outline().exterior)
    assert ring.is_valid
    assert shapely.distance(ring, shapely.points(positions)).max() < 1e-9


def test_the_characteristic_shape_is_the_hull_or_follows_concave_sides():
    rng = np.random.default_rng(0)
    xy = rng.uniform(0, 10, (800, 2))
    xy = xy[(xy < 5).any(axis=1)]
    hull = shapely.convex_hull(shapely.multipoints(xy))
    assert shapely.Polygon(xy[characteristic_ring(xy, np.inf)]).equals(hull)
    followed = shapely.Polygon(xy[characteristic_ring(xy, 1.0)])
    assert followed.is_valid
    assert 68 < followed.area < 77


def test_wrong_points_are_named():
    with pytest.raises(ValueError, match="points"):
        trace_boundary(np.zeros((4, 2)))
    with pytest.raises(ValueError, match="finite"):
        trace_boundary([[np.inf, 0.0, 0.0]])


@pytest.mark.real_data
@pytest.mark.parametrize("name", ["fusa/fusa.laz", "lowdensity/lidarhd_792000_6272000_left.laz"])
def test_every_real_building_has_a_sound_ring_from_a_walk(data_folder, name):
    cloud = laspy.read(data_folder / name)
    points = np.column_stack([cloud.x, cloud.y, cloud.z])[np.asarray(cloud.classification) == 6]
    points = (points - points.min(axis=0)).astype(np.float32).astype(np.float64)
    found = segment_buildings(points).building_id
    for number in np.unique(found[found > 0]):
        traced = trace_boundary(points[found == number])
        assert_sound(traced, points[found == number])
        assert traced.reason == ""


@pytest.mark.parametrize("density", [0.5, 8.0, 40.0])
def test_the_spacing_measured_from_a_sample_is_that_of_all_points_and_copies_do_not_count(density):
    points = GALLERY["l_shape"](density=density).roof_points()
    spacing = trace_boundary(points).point_spacing
    assert spacing == pytest.approx(measure_spacing(points), rel=0.05)
    assert trace_boundary(np.concatenate((points, points))).point_spacing == pytest.approx(spacing, rel=0.05)

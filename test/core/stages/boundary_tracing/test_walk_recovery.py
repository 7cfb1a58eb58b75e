"""What walks stumble over, courtyards that are none, windows along the scan, and the second method."""

import time

import numpy as np
import pytest
import shapely
from support.traced_rings import assert_sound, polygon

from bench.scenes.buildings import GALLERY
from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.status import BuildingStatus
from lidar_buildings.core.neighbours.scan_pattern import ScanPattern
from lidar_buildings.core.stages.boundary_tracing import tracing
from lidar_buildings.core.stages.boundary_tracing.config import AS_PUBLISHED, BoundaryTracingConfig
from lidar_buildings.core.stages.boundary_tracing.point_grid import build_point_grid
from lidar_buildings.core.stages.boundary_tracing.tracing import trace_boundary
from lidar_buildings.core.stages.boundary_tracing.walk import STUCK, add_edge, empty_edge_cells, walk_round


def cloud(*parts):
    xy = np.vstack(parts)
    return np.column_stack([xy, np.zeros(len(xy))])


def scattered(width, height, density=8.0, seed=0, at=(0.0, 0.0)):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1, (int(width * height * density), 2)) * (width, height) + at


def without(xy, *boxes):
    """Leave out the points in boxes (west, south, east, north)."""
    inside = [((xy >= box[:2]) & (xy <= box[2:])).all(axis=1) for box in boxes]
    return xy[~np.any(inside, axis=0)]


def scan(width, height, along, across, direction, seed=0):
    """Scan lines with jitter over a rectangle at the origin, which is turned with them."""
    u, v = np.meshgrid(np.arange(0, width, along), np.arange(0, height, across))
    xy = np.column_stack([u.ravel(), v.ravel()])
    xy += np.random.default_rng(seed).uniform(-0.2, 0.2, xy.shape) * (along, across)
    cosine, sine = np.cos(direction), np.sin(direction)
    return xy @ np.array([[cosine, sine], [-sine, cosine]])


def rotation(angle):
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def same_ring(one, other, tolerance=1e-9):
    """Whether two rings have the same vertices in the same cyclic order, either way round."""
    if len(one) != len(other):
        return False
    first = int(np.argmin(np.hypot(*(other - one[0]).T)))
    rolled = np.roll(other, -first, axis=0)
    backwards = np.roll(rolled[::-1], 1, axis=0)
    return min(np.abs(one - each).max() for each in (rolled, backwards)) < tolerance


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(cloud(scattered(20, 10), scattered(20, 10, at=(20.35, 10.35), seed=1)), id="corner"),
        pytest.param(
            cloud(scattered(8, 8), [[9.0, 4.0]], scattered(8, 8, at=(10.0, 0.0), seed=1)),
            id="joined by one point",
        ),
        pytest.param(cloud(scattered(30, 0.9)), id="one window wide"),
        pytest.param(
            cloud(scattered(20, 20)[::3], scattered(6, 6, 60.0, at=(20.0, 5.0))), id="uneven strips"
        ),
        pytest.param(cloud(without(scattered(20, 20), (5, 9.4, 21, 10.4))), id="narrow slit"),
        pytest.param(
            cloud(scattered(5, 5), np.column_stack([np.arange(5, 25, 0.4), np.full(50, 2.5)])), id="mast"
        ),
        pytest.param(cloud(np.indices((30, 30)).reshape(2, -1).T * 0.5), id="lattice"),
    ],
)
def test_whatever_walks_stumble_over_the_ring_is_sound(points):
    traced = trace_boundary(points, point_spacing=0.4)
    assert_sound(traced, points)
    assert traced.status is BuildingStatus.OK
    hull = shapely.convex_hull(shapely.multipoints(points[:, :2]))
    assert polygon(traced.outline).area <= hull.area * (1 + 1e-9)


def test_two_blocks_joined_by_one_point_keep_the_gap_between_them():
    points = cloud(scattered(8, 8), [[9.0, 4.0]], scattered(8, 8, at=(10.0, 0.0), seed=1))
    shape = polygon(trace_boundary(points, point_spacing=0.3536).outline)
    assert shape.area < 8 * 8 * 2 + 5.0


def test_a_courtyard_with_a_band_of_roof_of_five_metres_is_one_at_two_to_thirty_points_a_metre():
    for density in (2.0, 8.0, 30.0):
        points = cloud(without(scattered(26, 26, density), (5, 5, 21, 21)))
        traced = trace_boundary(points, point_spacing=density**-0.5)
        assert len(traced.outline.holes) == 1
        assert traced.reason == ""


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_a_roof_with_points_along_its_rim_only_is_filled_with_a_reason(rows, monkeypatch):
    step = 0.25
    u, v = np.meshgrid(np.arange(0, 5 + step, step), np.arange(0, 7 + step, step))
    xy = np.column_stack([u.ravel(), v.ravel()])
    rim = np.minimum(np.minimum(xy[:, 0], 5 - xy[:, 0]), np.minimum(xy[:, 1], 7 - xy[:, 1]))
    xy = (
        xy[rim < (rows - 0.5) * step]
        + np.random.default_rng(0).uniform(-0.05, 0.05, (2000, 2))[: (rim < (rows - 0.5) * step).sum()]
    )
    traced = trace_boundary(cloud(xy), point_spacing=step)
    assert traced.outline.holes == ()
    assert "taken for roof" in traced.reason
    assert polygon(traced.outline).area == pytest.approx(35.0, rel=0.06)
    monkeypatch.setattr(tracing, "_MIN_COURTYARD_BAND", 0.0)
    kept = trace_boundary(cloud(xy), point_spacing=step)
    assert rows == 1 or len(kept.outline.holes) == 1


def test_an_island_near_the_rim_is_joined_to_it_and_one_far_off_fills_the_courtyard():
    roof = without(scattered(40, 40), (10, 10, 30, 30))
    near, far = scattered(4, 4, at=(12.0, 18.0), seed=2), scattered(4, 4, at=(18.0, 18.0), seed=2)
    joined = trace_boundary(cloud(roof, near), point_spacing=0.3536)
    assert len(joined.outline.holes) == 1
    assert_sound(joined, cloud(roof, near))
    filled = trace_boundary(cloud(roof, far), point_spacing=0.3536)
    assert_sound(filled, cloud(roof, far))
    assert filled.reason


def test_as_published_has_the_papers_window_and_no_courtyards():
    assert AS_PUBLISHED.window == 2.2
    points = cloud(without(np.round(scan(20, 20, 0.5, 0.5, 0.0), 3), (6, 6, 14, 14)))
    traced = trace_boundary(points, AS_PUBLISHED, point_spacing=0.6)
    assert traced.outline.holes == ()
    assert_sound(traced, points)


@pytest.mark.parametrize("direction", [0.0, 0.5, 2.0])
def test_a_window_along_the_scan_follows_a_notch_that_a_disc_closes(direction):
    along, across = 0.4, 0.8
    xy = scan(24, 24, along, across, 0.0)
    xy = without(xy, (10, 12, 10.9, 25)) @ rotation(direction)
    spacing = float(np.sqrt(along * across))
    pattern = ScanPattern(direction, along, across)
    config = BoundaryTracingConfig(window=4.2)
    by_pattern = trace_boundary(cloud(xy), config, pattern=pattern)
    assert_sound(by_pattern, cloud(xy))
    assert by_pattern.reason == ""
    assert by_pattern.point_spacing == pytest.approx(spacing)
    closed = trace_boundary(cloud(xy), config, point_spacing=spacing)
    assert polygon(closed.outline).area - polygon(by_pattern.outline).area > 6.0


def test_lines_much_closer_than_the_points_along_them_do_not_show_in_the_ring():
    points = cloud(scattered(20, 12))
    spacing = 8**-0.5
    plain = trace_boundary(points, pattern=ScanPattern(0.3, spacing, 2.0 * spacing))
    narrow = trace_boundary(points, pattern=ScanPattern(0.3, 2.0 * spacing / 8.0, 2.0 * spacing))
    np.testing.assert_array_equal(narrow.outline.exterior, plain.outline.exterior)


@pytest.mark.parametrize("pattern", [None, ScanPattern(0.4, 0.3, 0.5)])
def test_the_ring_of_turned_and_mirrored_points_is_the_ring_turned_and_mirrored(pattern):
    xy = GALLERY["t_shape"]().roof_points()[:, :2]
    spacing = 0.4
    ring = trace_boundary(cloud(xy), pattern=pattern, point_spacing=spacing).outline.exterior
    for angle in (0.3, 1.4, 3.0):
        turned_pattern = pattern and ScanPattern(
            (pattern.direction + angle) % np.pi, pattern.along, pattern.across
        )
        turned = trace_boundary(cloud(xy @ rotation(angle)), pattern=turned_pattern, point_spacing=spacing)
        assert same_ring(ring @ rotation(angle), turned.outline.exterior)
    mirrored_pattern = pattern and ScanPattern(np.pi - pattern.direction, pattern.along, pattern.across)
    mirrored = trace_boundary(cloud(xy * (-1, 1)), pattern=mirrored_pattern, point_spacing=spacing)
    assert same_ring(ring * (-1, 1), mirrored.outline.exterior)


def test_a_spacing_far_from_the_points_own_ends_with_a_sound_ring():
    points = cloud(scattered(30, 30, 4.0))
    for spacing in (0.01, 0.05, 0.2, 1.5, 8.0):
        assert_sound(trace_boundary(points, point_spacing=spacing), points)


def test_a_stray_a_hundred_kilometres_off_does_not_stop_the_tracing():
    points = cloud(scattered(40, 40, 4.0), [[1e5, 1e5]])
    traced = trace_boundary(points, point_spacing=0.5)
    assert_sound(traced, points)


def test_a_large_ring_of_points_takes_about_a_second_at_most():
    angle = np.linspace(0, 2 * np.pi, 100_000, endpoint=False)
    points = cloud(5000 * np.column_stack([np.cos(angle), np.sin(angle)]))
    trace_boundary(points[:200], point_spacing=0.3)
    seconds = []
    for _ in range(3):
        start = time.process_time()
        traced = trace_boundary(points, point_spacing=0.3)
        seconds.append(time.process_time() - start)
    assert len(traced.outline.exterior) == 100_000
    assert min(seconds) < 2.0  # 0.3 on a machine at rest; what grew with the square took minutes


def test_a_walk_that_is_stuck_in_a_crowd_has_tried_all_of_it_at_once():
    fence = 0.1 * np.column_stack([np.cos([0.0, 2.1, 4.2]), np.sin([0.0, 2.1, 4.2])])
    crowd = np.random.default_rng(0).uniform(-0.6, 0.6, (100_000, 2))
    points = cloud([[0.0, 0.0]], fence, crowd[np.hypot(*crowd.T) > 0.1])
    grid = build_point_grid(points, ScanPattern.isotropic(1.0), 2.0)
    edges, follower = empty_edge_cells(grid), np.full(len(grid.x), -1, dtype=np.int64)
    rows = [int(np.hypot(grid.x - x, grid.y - y).argmin()) for x, y in (*fence, (0.0, 0.0))]
    follower[rows[:3]] = np.roll(rows[:3], -1)
    for row in rows[:3]:
        assert add_edge(grid, edges, row, follower[row])
    start = time.process_time()
    ring, end = walk_round(grid, edges, follower, np.ones(len(grid.x)), 1.0, rows[3], (1.0, 0.0), 100)
    seconds = time.process_time() - start
    assert (ring.tolist(), end) == (rows[3:], STUCK)
    assert seconds < 5.0  # 0.05 at rest, 2 of compiling; what grew with the square took half a minute


def test_unknown_sources_and_spacings_are_refused():
    with pytest.raises(ParameterError, match="source"):
        BoundaryTracingConfig(source="guess")
    with pytest.raises(ValueError, match="point_spacing"):
        trace_boundary(cloud(scattered(3, 3)), point_spacing=0.0)

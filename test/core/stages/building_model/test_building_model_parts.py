"""The steps by which a roof is divided into faces, each against brute force or exact geometry."""

import numpy as np
import pytest
import shapely
from scipy.spatial import cKDTree

from lidar_buildings.core.model.outline import Outline, ring_walls
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.stages.building_model import partition
from lidar_buildings.core.stages.building_model.cell_costs import point_weights
from lidar_buildings.core.stages.building_model.cells import (
    cells_of_points,
    cut_into_cells,
    extend_segments,
    face_rings,
)
from lidar_buildings.core.stages.building_model.config import BuildingModelConfig
from lidar_buildings.core.stages.building_model.quality import (
    BESIDE,
    EMPTY,
    SEEN,
    distance_to_surface,
    outline_support,
)
from lidar_buildings.core.stages.building_model.simplification import simplified

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
COURT = np.array([[4.0, 4.0], [4.0, 6.0], [6.0, 6.0], [6.0, 4.0]])


def inner_edges(cells):
    """Return the two cells beside each edge between cells, and the edge's ends."""
    inner = (cells.sides.min(axis=1) >= 0) & (cells.sides[:, 0] != cells.sides[:, 1])
    return cells.sides[inner], cells.vertices[cells.borders[inner]]


def length_of_borders(cells):
    _, ends = inner_edges(cells)
    return np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum()


def polygons_of(cells):
    return shapely.transform(cells.polygons, lambda steps: steps / 1000.0)


@pytest.mark.parametrize("n_segments", [0, 1, 12, 60])
@pytest.mark.parametrize("holes", [(), (COURT,)])
def test_cells_cover_the_outline_exactly_and_share_whole_edges(n_segments, holes):
    outline = Outline(SQUARE, holes)
    segments = np.round(np.random.default_rng(n_segments).uniform(-1, 11, (n_segments, 2, 2)), 3)
    segments = extend_segments(segments, ring_walls(outline.rings))
    cells = cut_into_cells(outline, segments)
    polygons = polygons_of(cells)
    assert len(polygons) > 0.8 * n_segments
    assert shapely.coverage_is_valid(cells.polygons)
    assert cells.areas == pytest.approx(shapely.area(polygons))
    assert cells.areas.sum() == pytest.approx(outline.area, abs=0.05)
    inner = shapely.length(polygons).sum() - outline.polygon.length
    assert length_of_borders(cells) == pytest.approx(inner / 2, rel=1e-3, abs=1e-9)
    for (one, other), end in zip(*inner_edges(cells), strict=True):
        line = shapely.LineString(np.rint(1000.0 * end))
        assert cells.polygons[one].boundary.covers(line)
        assert cells.polygons[other].boundary.covers(line)


def test_lines_that_lie_on_one_another_cut_once_and_a_courtyard_keeps_its_cells_apart():
    lines = np.array([[[5.0, 0.0], [5.0, 10.0]], [[5.0, 2.0], [5.0, 8.0]], [[0.0, 0.0], [0.0, 4.0]]])
    cells = cut_into_cells(Outline(SQUARE), lines)
    assert cells.areas == pytest.approx([50.0, 50.0])
    assert length_of_borders(cells) == pytest.approx(10.0)
    island = np.array([[4.5, 4.5], [5.5, 4.5], [5.5, 5.5], [4.5, 5.5]])
    sides = np.stack([island, np.roll(island, -1, axis=0)], axis=1)
    assert cut_into_cells(Outline(SQUARE, (COURT,)), sides).areas == pytest.approx([96.0])
    assert cut_into_cells(Outline(SQUARE), sides).areas == pytest.approx([99.0, 1.0])


@pytest.mark.parametrize(("end", "extended"), [(6.0, [0.0, 8.0]), (4.0, [4.0, 4.0])])
def test_a_segment_runs_on_to_the_next_one_at_both_ends_unless_it_has_no_length(end, extended):
    first, other = extend_segments(
        np.array([[[4.0, 5.0], [end, 5.0]], [[8.0, 2.0], [8.0, 8.0]]]), ring_walls([SQUARE])
    )
    assert first == pytest.approx(np.array([[x, 5.0] for x in extended]))
    assert other == pytest.approx(np.array([[8.0, 0.0], [8.0, 10.0]]))


def test_a_step_runs_past_the_next_segment_but_not_past_a_wall():
    segments = np.array([[[4.0, 5.0], [6.0, 5.0]], [[7.0, 2.0], [7.0, 8.0]], [[8.0, 2.0], [8.0, 8.0]]])
    extended = extend_segments(segments, ring_walls([SQUARE]), 1)
    assert extended[0] == pytest.approx(np.array([[0.0, 5.0], [8.0, 5.0]]))


def test_places_are_found_in_their_cells_and_courtyards_are_beside_all():
    outline = Outline(SQUARE, (COURT,))
    # The second line ends inside a cell: it cuts nothing.
    cells = cut_into_cells(outline, np.array([[[-1.0, 5.0], [11.0, 5.2]], [[1.0, 2.0], [8.0, 3.0]]]))
    places = np.random.default_rng(3).uniform(-1, 11, (2000, 2))
    places = places[np.argsort(places[:, 1])]
    found = cells_of_points(cells, places)
    points = shapely.points(places)
    for number, polygon in enumerate(polygons_of(cells)):
        assert np.array_equal(found == number, shapely.contains(polygon, points))


def test_a_place_above_a_vertex_lies_where_the_next_one_east_does():
    ends = np.random.default_rng(4).uniform(-1.0, 11.0, (20, 2))
    lines = np.stack([ends, ends[::-1]], axis=1)
    cells = cut_into_cells(Outline(SQUARE), extend_segments(lines, ring_walls([SQUARE])))
    inner = cells.vertices[(cells.vertices > 0.0).all(axis=1) & (cells.vertices < 10.0).all(axis=1)]
    above = np.concatenate([inner + np.array([0.0, 0.001 * k]) for k in range(1, 1000, 50)])
    above = above[np.argsort(above[:, 1])]
    beside = above + np.array([1e-9, 0.0])
    assert np.array_equal(cells_of_points(cells, above), cells_of_points(cells, beside))


def strips(xs):
    cells = cut_into_cells(Outline(SQUARE), np.array([[[x, -1.0], [x, 11.0]] for x in xs]))
    return cells, np.argsort(np.argsort(shapely.bounds(polygons_of(cells))[:, 0]))


def test_cells_of_one_plane_make_one_face_without_the_vertices_between_them():
    cells, order = strips([2.0, 4.0, 6.0])
    labels = np.array([0, 0, 1, 1])[order]
    face = partition.join_equal_cells(cells, labels)
    rings = face_rings(cells, face, Outline(SQUARE))
    assert sorted(len(group[0]) for group in rings) == [4, 4]
    assert sorted(shapely.Polygon(group[0]).area for group in rings) == pytest.approx([40.0, 60.0])


@pytest.mark.parametrize(
    ("misfit", "min_area", "stays"), [(1.0, 0.0, True), (0.3, 0.0, False), (1.0, 3.0, False)]
)
def test_a_face_stays_that_is_large_and_worth_its_corners(misfit, min_area, stays):
    cells, order = strips([4.0, 4.2])
    labels = np.array([0, 1, 2])[order]
    costs = (labels[:, None] != np.arange(3)) * misfit * 10.0
    costs[labels == 1] /= 10.0
    # Two corners of each of two faces along either long side; away goes one of these sides.
    levels = np.column_stack([np.zeros((3, 2)), np.arange(3)])
    found = simplified(cells, labels, costs, levels, (0.01, 0.1), min_area)
    assert (set(found) == {0, 1, 2}) == stays
    assert {0, 2} <= set(found)


def test_a_tooth_of_a_seam_goes_to_the_plane_beyond():
    lines = np.array([[[5.0, -1.0], [5.0, 11.0]], [[5.0, 4.0], [11.0, 4.0]], [[5.0, 5.0], [11.0, 5.0]],
                      [[6.0, -1.0], [6.0, 11.0]]])  # fmt: skip
    cells = cut_into_cells(Outline(SQUARE), lines)
    middles = np.array([polygon.centroid.coords[0] for polygon in polygons_of(cells)])
    truth = (middles[:, 0] > 5.0).astype(np.int64)
    tooth = (abs(middles - [5.5, 4.5]) < 0.1).all(axis=1)
    costs = (truth[:, None] != np.arange(2)) * cells.areas[:, None]
    costs[tooth] = [[0.0, 0.1]]
    labels, levels = np.where(tooth, 0, truth), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert np.array_equal(simplified(cells, labels, costs, levels, (0.01, 0.1), 0.0), truth)
    assert np.array_equal(simplified(cells, labels, costs, levels, (0.0, 0.01), 0.0), labels)


def test_a_plane_gets_back_a_roof_that_it_lost_in_small_cells():
    at = np.arange(0.5, 10.0, 0.5)
    low, high = np.full(at.shape, -1.0), np.full(at.shape, 11.0)
    lines = [np.column_stack([at, low, at, high]), np.column_stack([low, at, high, at])]
    cells = cut_into_cells(Outline(SQUARE), np.concatenate(lines).reshape(-1, 2, 2))
    middles = np.array([polygon.centroid.coords[0] for polygon in polygons_of(cells)])
    truth = (middles[:, 0] > 5.0).astype(np.int64)
    levels = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.4]])
    costs = 0.4 * (truth[:, None] != np.arange(2)) * cells.areas[:, None]
    nothing_seen = (abs(middles - [7.5, 5.0]) < 1.0).all(axis=1)
    costs[nothing_seen] = 0.0
    assert np.array_equal(simplified(cells, np.zeros_like(truth), costs, levels, (0.05, 0.15), 0.0), truth)


def test_faces_that_meet_are_one_part_and_a_step_that_is_high_in_the_mean_makes_two():
    cells, order = strips([3.0, 6.0])
    planes = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 6.0], [0.0, 0.0, 5.0]])
    assert partition.parts_of_one_height(cells, order, planes, 1.0).tolist() == [0, 0, 1]
    assert partition.parts_of_one_height(cells, order, planes, 6.0).tolist() == [0, 0, 0]
    cells, order = strips([5.0])
    # Along their border the second is 2 m below at one end and 2 m above at the other: 1 m in the mean.
    planes = np.array([[0.0, 0.0, 2.0], [0.0, 0.4, 0.0]])
    assert partition.parts_of_one_height(cells, order, planes, 0.99).tolist() == [0, 1]
    assert partition.parts_of_one_height(cells, order, planes, 1.01).tolist() == [0, 0]


def divided(points, plane):
    no_lines = np.empty((0, 2, 2))
    planes = np.array([plane])
    config = BuildingModelConfig()
    return partition.partition_outline(Outline(SQUARE), points, planes, (no_lines, no_lines), 0.5, config)


def test_a_plane_ends_where_all_points_near_lie_below_it():
    x, y = np.meshgrid(np.arange(0.25, 10.0, 0.5), np.arange(0.25, 10.0, 0.5))
    points = np.column_stack([x.ravel(), y.ravel(), np.where(x < 6.0, x, 1.0).ravel()])
    sloping, level = sorted(divided(points, [1.0, 0.0, 0.0]), key=lambda face: -abs(face.plane[0]))
    assert sloping.plane.tolist() == [1.0, 0.0, 0.0]
    assert shapely.Polygon(sloping.rings[0]).bounds[2] == pytest.approx(6.0, abs=1.5)
    assert level.plane == pytest.approx([0.0, 0.0, 1.0])
    assert len(sloping.rows) + len(level.rows) == len(points)


def test_a_steep_plane_through_one_row_goes_little_beyond_its_points():
    points = np.column_stack([np.full(9, 5.0), np.arange(9.0) + 0.5, np.full(9, 3.0)])
    points[:, 2] += np.arange(9) % 2 * 0.2
    for face in divided(points, [20.0, 0.0, -97.0]):
        z = face.rings[0] @ face.plane[:2] + face.plane[2]
        assert z.max() <= 3.2 + 0.5 + 1.8 * 0.5


def test_points_share_the_squares_of_a_spacing_and_those_beside_the_outline_stand_for_none():
    points = np.array([[0.1, 0.1], [0.4, 0.4], [0.6, 0.1], [10.2, 5.0], [10.6, 5.0], [-0.1, 5.0]])
    weights = point_weights(points, SQUARE, 0.5)
    assert weights == pytest.approx([0.125, 0.125, 0.25, 0.25, 0.0, 0.0])


def test_a_cell_without_points_takes_the_plane_beside_it():
    lines = np.array([[[5.0, -1.0], [5.0, 11.0]]])
    points = np.column_stack([np.random.default_rng(5).uniform(0, 5, (200, 2)) * [1, 2], np.full(200, 6.0)])
    planes = np.array([[0.0, 0.0, 9.0], [0.0, 0.0, 6.0]])
    (face,) = partition.partition_outline(
        Outline(SQUARE), points, planes, (lines, lines[:0]), 0.5, BuildingModelConfig()
    )
    assert (face.plane.tolist(), len(face.rings[0])) == ([0.0, 0.0, 6.0], 4)


def test_distances_to_a_box_are_those_of_geometry_and_one_that_is_known_is_never_raised():
    box = extrude(Outline(SQUARE), 0.0, 5.0)
    points = np.random.default_rng(2).uniform(-5, 15, (500, 3))
    outside = np.maximum(np.maximum(-points, points - [10.0, 10.0, 5.0]), 0.0)
    inside = np.minimum(points, [10.0, 10.0, 5.0] - points).min(axis=1)
    expected = np.where(inside > 0, inside, np.linalg.norm(outside, axis=1))
    found = distance_to_surface(points, box, np.full(500, np.inf))
    assert found == pytest.approx(expected, abs=1e-9)
    box = extrude(Outline(SQUARE, (COURT,)), 0.0, 5.0)
    points = np.array([[5.0, 5.0, 5.0], [1.0, 1.0, 9.0]])
    assert distance_to_surface(points, box, np.array([0.3, np.inf])) == pytest.approx([0.3, 4.0])


@pytest.mark.parametrize("seed", range(6))
def test_coverage_is_what_trees_and_polygons_say(seed):
    random = np.random.default_rng(seed)
    court = COURT + random.uniform(-1, 1, 2)
    outline = Outline(SQUARE * random.uniform(0.5, 2.0, 2) + 1e4, (court + 1e4,) if seed % 2 else ())
    xy = random.uniform(-2, 14, (random.integers(1, 200), 2)) + 1e4
    xy = xy[np.argsort(xy[:, 1])]
    agrees = random.random(len(xy)) < 0.7
    spacing = random.uniform(0.2, 1.0)
    low, high = outline.exterior.min(axis=0), outline.exterior.max(axis=0)
    x, y = (np.arange(a + 0.5 * spacing, b, spacing) for a, b in zip(low, high, strict=True))
    spots = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    spots = spots[shapely.contains_xy(outline.polygon, spots)]
    expected = [
        np.mean(cKDTree(each).query(spots)[0] < 2.0 * spacing) if len(each) else 0.0
        for each in (xy[agrees], xy)
    ]
    support = outline_support(outline, xy, agrees, np.full(len(xy), np.nan), spacing)
    found = support.share(support.is_covered), 1.0 - support.share(support.state == EMPTY)
    assert found == pytest.approx(expected)


def test_spots_on_the_edge_of_an_outline_do_not_count():
    points = np.array([[1.0, 1.0]])
    square = Outline(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [1.0, 2.0], [1.0, 4.0], [0.0, 4.0]]))
    # of the spots at 1 and 3 along x and y, three lie on the edges or outside
    state = outline_support(square, points, np.ones(1, dtype=bool), np.zeros(1), 2.0).state
    assert state.tolist() == [[SEEN, SEEN], [BESIDE, BESIDE]]

import numpy as np
import pytest
import startinpy
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from lidar_buildings.core.surfaces.incremental_delaunay import insert_vertex, with_room
from lidar_buildings.core.surfaces.tin import walk
from lidar_buildings.core.surfaces.triangulation import build_tin


@pytest.fixture
def scattered():
    random = np.random.default_rng(0)
    xy = random.uniform((500, -300), (620, -220), (3000, 2))
    return np.column_stack((xy, np.sin(xy[:, 0] / 9) * 4 + 0.3 * xy[:, 1]))


@pytest.fixture
def inside():
    return np.random.default_rng(1).uniform((510, -290), (610, -230), (5000, 2))


def test_elevations_are_those_of_scipys_linear_interpolation_and_of_startin(scattered, inside):
    expected = LinearNDInterpolator(scattered[:, :2], scattered[:, 2])(inside)
    np.testing.assert_allclose(build_tin(scattered).elevation(inside), expected, atol=1e-9)
    peer = startinpy.DT()
    peer.insert(scattered)
    expected = peer.interpolate({"method": "TIN"}, inside[:500])
    np.testing.assert_allclose(build_tin(scattered).elevation(inside[:500]), expected, atol=1e-9)


def test_every_point_lies_in_the_triangle_it_is_located_in(scattered, inside):
    tin = build_tin(scattered)
    corners = tin.vertices[tin.triangles[tin.locate(inside)], :2] + tin.origin
    for k in range(3):
        side = corners[:, (k + 1) % 3] - corners[:, k]
        away = inside - corners[:, k]
        assert (side[:, 0] * away[:, 1] - side[:, 1] * away[:, 0] >= -1e-9).all()


def test_order_and_repetition_of_vertices_and_order_of_queries_do_not_matter(scattered, inside):
    again = np.random.default_rng(2).permutation(np.vstack((scattered, scattered[::3])))
    np.testing.assert_array_equal(build_tin(again).elevation(inside), build_tin(scattered).elevation(inside))
    shuffled = np.random.default_rng(3).permutation(len(inside))
    tin = build_tin(scattered)
    np.testing.assert_allclose(tin.elevation(inside[shuffled]), tin.elevation(inside)[shuffled], atol=1e-12)


def test_triangles_of_a_lattice_do_not_depend_on_where_it_is_cut():
    """Every square's corners lie on one circle; which diagonal is drawn must not tell the cut."""
    random = np.random.default_rng(2)
    x, y = np.meshgrid(np.arange(40) * 0.5, np.arange(40) * 0.5)
    lattice = np.column_stack((x.ravel(), y.ravel(), random.normal(size=x.size)))
    queries = random.uniform(4.0, 12.0, (2000, 2))
    expected = build_tin(lattice).elevation(queries)
    for part in (lattice[lattice[:, 0] < 15.0], lattice[lattice[:, 1] > 1.0], random.permutation(lattice)):
        np.testing.assert_allclose(build_tin(part).elevation(queries), expected, atol=1e-12)


def test_terrain_goes_on_level_beyond_the_vertices(scattered):
    outside = np.array([[400.0, -260.0], [700.0, 0.0], [560.0, -1000.0], [1e6, 1e6]])
    elevation = build_tin(scattered).elevation(outside)
    assert (elevation >= scattered[:, 2].min()).all()
    assert (elevation <= scattered[:, 2].max()).all()


def test_slope_is_that_of_the_plane():
    random = np.random.default_rng(4)
    xy = random.uniform(0, 50, (400, 2))
    tin = build_tin(np.column_stack((xy, xy @ [0.3, -0.4])))
    _, slope = tin.elevation_and_slope(random.uniform(10, 40, (200, 2)))
    np.testing.assert_allclose(slope, 0.5, atol=1e-9)


@pytest.mark.parametrize(
    "vertices",
    [
        [[3, 4, 5]],
        [[3, 4, 5], [3, 4, 5], [3, 4, 5]],
        [[0, 0, 5], [10, 10, 5]],
        np.column_stack((np.arange(50), 2 * np.arange(50), np.full(50, 5))),
        np.column_stack((np.indices((9, 9)).reshape(2, -1).T, np.full(81, 5))),
    ],
    ids=["one", "identical", "two", "collinear", "lattice"],
)
def test_degenerate_vertices_give_their_elevation_everywhere(vertices):
    tin = build_tin(np.asarray(vertices, dtype=float))
    np.testing.assert_allclose(tin.elevation(np.random.default_rng(5).uniform(-20, 120, (100, 2))), 5.0)


def test_the_lowest_of_points_at_one_place_counts_and_no_vertices_and_nan_are_refused():
    tin = build_tin(np.array([[1.0, 2.0, 7.0], [1.0, 2.0, 3.0], [1.0, 2.0, 5.0]]))
    assert tin.elevation(np.array([[1.0, 2.0]]))[0] == 3.0
    with pytest.raises(ValueError, match="vertices"):
        build_tin(np.zeros((0, 3)))
    with pytest.raises(ValueError, match="finite"):
        build_tin(np.array([[0.0, np.nan, 0.0]]))


def grown_mesh(points):
    """Insert points one by one into the mesh of the first one."""
    tin = build_tin(points[:1], np.array([points.min(axis=0)[:2], points.max(axis=0)[:2]]))
    n_start = len(tin.vertices)
    vertices = np.vstack((tin.vertices, points[1:] - [*tin.origin, 0.0]))
    n_triangles = len(tin.triangles)
    triangles = with_room(tin.triangles, n_triangles + 2 * len(points))
    neighbours = with_room(tin.neighbours, n_triangles + 2 * len(points))
    for p in range(n_start, len(vertices)):
        here = walk(vertices[p, 0], vertices[p, 1], 0, vertices, triangles, neighbours)
        n_triangles = insert_vertex(p, here, n_triangles, vertices, triangles, neighbours)
    return vertices, triangles[:n_triangles], neighbours[:n_triangles]


def test_inserting_one_by_one_gives_the_delaunay_triangles(scattered):
    vertices, triangles, _ = grown_mesh(scattered[:800])
    expected = Delaunay(vertices[:, :2]).simplices
    # The frame's points lie on its sides: only triangles with a real vertex are unique.
    frame = np.arange(1, 65)

    def real(corners):
        return {tuple(sorted(row)) for row in corners.tolist() if not np.isin(row, frame).any()}

    assert real(triangles) == real(expected)


@pytest.mark.parametrize("order", ["rows", "shuffled"])
def test_a_lattice_with_points_on_sides_and_circles_keeps_a_valid_mesh(order):
    points = np.column_stack((np.indices((20, 20)).reshape(2, -1).T, np.zeros(400))).astype(float)
    if order == "shuffled":
        points = np.random.default_rng(6).permutation(points)
    vertices, triangles, neighbours = grown_mesh(points)
    a, b, c = (vertices[triangles[:, k], :2] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert (area > 0).all()
    width, height = np.ptp(vertices[:, :2], axis=0)
    assert area.sum() == pytest.approx(width * height)
    for t, beyond in enumerate(neighbours):
        for k in np.flatnonzero(beyond >= 0):
            assert t in neighbours[beyond[k]]
            assert {triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]} <= set(triangles[beyond[k]])

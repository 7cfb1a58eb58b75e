"""What the checks stand on: triangulations of faces and exact tests of triangles."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise, product

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.intersections import triangles_meet
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.triangulation import face_arrays, fitted_planes, triangulate
from lidar_buildings.core.solids.validity import weld


def triangulated(*rings, tilt=(0.0, 0.0)):
    """The triangles of a face in a tilted plane, and its vertices."""
    plan = np.concatenate(rings)
    vertices = np.column_stack([plan, plan @ np.asarray(tilt)])
    starts = np.cumsum([0, *map(len, rings)])
    face = tuple(tuple(range(a, b)) for a, b in pairwise(starts))
    arrays = face_arrays(Solid(vertices, (face,), ("RoofSurface",)))
    arrays = replace(arrays, corners=weld(vertices, 0.001)[arrays.corners])
    return triangulate(arrays, fitted_planes(arrays)[1])[0], vertices


def star(n, seed, holes=0):
    """The rings of a random star-shaped face with square holes."""
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0, 2 * np.pi, n))
    exterior = np.column_stack([np.cos(angles), np.sin(angles)]) * random.uniform(12, 20, n)[:, None]
    square = np.array([[0, 0], [0, 1], [1, 1], [1, 0]])
    return (exterior, *(np.add(square, [2.0 * k - 3, random.uniform(-3, 3)]) for k in range(holes)))


@pytest.mark.parametrize(("n", "holes"), [(5, 0), (12, 1), (40, 3), (120, 0)])
def test_triangles_fill_the_face_and_are_those_of_delaunay(n, holes):
    for seed in range(5):
        rings = star(n, seed, holes)
        face = shapely.Polygon(rings[0], rings[1:])
        if not face.is_valid:
            continue
        triangles, vertices = triangulated(*rings)
        parts = shapely.polygons(vertices[triangles][:, :, :2])
        assert shapely.area(parts).sum() == pytest.approx(face.area, rel=1e-9)
        assert shapely.union_all(parts).symmetric_difference(face).area < 1e-6
        expected = shapely.get_parts(shapely.constrained_delaunay_triangles(face))
        assert {part.normalize().wkt for part in shapely.set_precision(parts, 1e-6)} == {
            part.normalize().wkt for part in shapely.set_precision(expected, 1e-6)
        }


def test_triangles_use_every_vertex_of_straight_edges():
    rings = (np.array([[0, 0], [1, 0], [2, 0], [5, 0], [5, 5], [5, 9], [0, 9], [0, 4.0]]),)
    triangles, vertices = triangulated(*rings, tilt=(0.4, -1.3))
    assert len(triangles) == 6
    assert set(triangles.ravel()) == set(range(8))
    assert shapely.area(shapely.polygons(vertices[triangles][:, :, :2])).min() > 1e-6


def test_a_hole_may_touch_the_exterior_at_a_vertex():
    exterior = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [0, 5.0]])
    touching = np.array([[0, 5], [3, 7], [3, 3.0]])
    triangles, vertices = triangulated(exterior, touching)
    areas = shapely.area(shapely.polygons(vertices[triangles][:, :, :2]))
    assert areas.sum() == pytest.approx(Outline(exterior, (touching,)).area)
    assert areas.min() > 0.0


def meets_exactly(first, second):
    """
    Whether two triangles without common vertices meet, in rational numbers; None if edges lie in planes.
    """
    for one, other in ((first, second), (second, first)):
        a, b, c = (np.array([Fraction(int(v)) for v in p], dtype=object) for p in other)
        normal = np.cross(b - a, c - a)
        sides = [sum(normal * (np.array([Fraction(int(v)) for v in p], dtype=object) - a)) for p in one]
        if any(side == 0 for side in sides) or not any(normal):
            return None
        for k in range(3):
            p, q = (np.array([Fraction(int(v)) for v in one[i]], dtype=object) for i in (k, (k + 1) % 3))
            if sides[k] * sides[(k + 1) % 3] < 0:
                share = sides[k] / (sides[k] - sides[(k + 1) % 3])
                hit = p + share * (q - p)
                turns = [sum(np.cross(e, hit - o) * normal) for e, o in ((b - a, a), (c - b, b), (a - c, c))]
                if all(turn >= 0 for turn in turns):
                    return True
    return False


def test_triangles_meet_as_in_rational_numbers():
    random = np.random.default_rng(0)
    seen = {True: 0, False: 0}
    for _ in range(300):
        points = random.integers(0, 8, (6, 3))
        expected = meets_exactly(points[:3], points[3:])
        if expected is not None:
            found = triangles_meet(points, np.array([0, 1, 2]), np.array([3, 4, 5]))
            assert found == expected
            seen[expected] += 1
    assert min(seen.values()) > 20


#: Two triangles as rows of points on a plane grid (x, y, 0) but for those that say otherwise.
POINTS = np.array(
    [
        [0, 0, 0],
        [8, 0, 0],
        [0, 8, 0],
        [8, 8, 0],
        [2, 2, 0],
        [4, 2, 0],
        [2, 4, 0],
        [20, 0, 0],
        [2, 2, 5],
        [4, 4, -5],
    ]
)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ((0, 1, 2), (4, 5, 6), True),  # one inside the other
        ((0, 1, 2), (1, 3, 2), False),  # neighbours in one plane
        ((0, 1, 2), (0, 1, 3), True),  # folded upon each other
        ((0, 1, 2), (0, 1, 8), False),  # at an angle
        ((0, 1, 2), (0, 4, 8), True),  # with a common vertex, and along the face
        ((0, 1, 2), (1, 7, 8), False),  # with a common vertex, beside each other
        ((0, 1, 2), (1, 7, 4), True),  # with a common vertex, one side within
        ((0, 1, 2), (3, 8, 9), True),  # pierced, and touched at an edge
        ((0, 1, 2), (3, 7, 8), False),  # apart
        ((0, 4, 1), (2, 3, 6), False),  # in one plane, apart
    ],
)
def test_triangles_meet_or_not(first, second, expected):
    for turn, back in product(range(3), range(3)):
        s, t = np.roll(first, turn), np.roll(second, back)
        assert triangles_meet(POINTS, s, t) == expected
        assert triangles_meet(POINTS, t[::-1].copy(), s) == expected


def test_vertices_join_the_earliest_one_that_is_near():
    vertices = np.array([[0.0, 0, 0], [0.0008, 0, 0], [0.0016, 0, 0], [5, 5, 5], [0, 0, 0.0005]])
    assert weld(vertices, 0.001).tolist() == [0, 0, 2, 3, 0]

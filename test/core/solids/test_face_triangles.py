"""Faces divided into pieces: closed shells stay closed, areas and volumes stay what they are."""

from collections import Counter

import numpy as np
import pytest
from support import model_survey

from lidar_buildings.core.solids.shell import area_vector, face_plane, face_shape
from lidar_buildings.core.solids.triangulation import face_pieces, triangles_of

PLAN = np.array([(0, 0), (4, 0), (8, 0), (8, 4), (8, 8), (0, 8), (2, 2), (6, 2), (6, 6), (2, 6)], dtype=float)
PLAN = np.column_stack([PLAN, np.zeros(len(PLAN))])
#: Rows of PLAN: with vertices amid edges, a reflex corner, a hole.
FACES = {
    "triangle": ((0, 2, 4),),
    "square": ((0, 2, 4, 5),),
    "arrow": ((0, 2, 8, 5),),
    "vertices amid edges": ((0, 1, 2, 3, 4, 5),),
    "hole": ((0, 2, 4, 5), (6, 9, 8, 7)),
    "hole and vertices amid edges": ((0, 1, 2, 3, 4, 5), (6, 9, 8, 7)),
}


def edges_of(rings):
    return [edge for ring in rings for edge in zip(ring, (*ring[1:], ring[0]), strict=True)]


def area_of(vertices, rings):
    return float(np.linalg.norm(area_vector([vertices[list(ring)] for ring in rings])))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", FACES)
def test_pieces_have_the_rings_edges_and_the_faces_area(name, axis):
    vertices, face = np.roll(PLAN, axis, axis=1), FACES[name]
    for rings in (face, tuple(ring[::-1] for ring in face)):
        triangles = triangles_of(*face_pieces(vertices, [rings]))
        edges = Counter(edges_of(triangles))
        assert set(edges.values()) == {1}
        open_edges = {edge for edge in edges if edge[::-1] not in edges}
        assert open_edges == set(edges_of(rings))
        assert sum(area_of(vertices, [one]) for one in triangles) == pytest.approx(area_of(vertices, rings))
        assert min(area_of(vertices, [one]) for one in triangles) > 0.0


def test_a_square_stays_whole_and_an_arrow_does_not():
    assert face_pieces(PLAN, [FACES["square"]]) == [[(0, 2, 4, 5)]]
    assert [len(piece) for piece in face_pieces(PLAN, [((0, 2, 7, 4),)])[0]] == [3, 3]


@pytest.mark.parametrize("build", [b for b in model_survey.BUILDINGS.values() if b is not model_survey.ruin])
def test_a_closed_shell_stays_closed_and_keeps_its_volume(build):
    _, model = build()
    for solid in model.solids.values():
        triangles = [t for pieces in face_pieces(solid.vertices, solid.faces) for t in triangles_of(pieces)]
        edges = Counter(edges_of(triangles))
        assert all(n == 1 and edges[edge[::-1]] == 1 for edge, n in edges.items())
        corners = solid.vertices[np.array(triangles)]
        volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
        assert volume == pytest.approx(solid.volume, rel=1e-9)


def test_random_walls_with_many_vertices_amid_edges_stay_closed():
    random = np.random.default_rng(0)
    for _ in range(100):
        low, high = (np.unique(random.integers(0, 20, 6)) for _ in range(2))
        ring = np.array([*((x, 0.0, 0.0) for x in low), *((x, 0.0, 9.0) for x in high[::-1])])
        ring = np.vstack([ring, [[ring[0, 0] - 1.0, 0.0, z] for z in (7.0, 3.0, 1.0)]])
        face = (tuple(range(len(ring))),)
        edges = Counter(edges_of(triangles_of(*face_pieces(ring, [face]))))
        assert {edge for edge in edges if edge[::-1] not in edges} == set(edges_of(face))


@pytest.mark.parametrize(
    ("direction", "azimuth"),
    [((0, 1), 0.0), ((1, 0), 90.0), ((0, -1), 180.0), ((-1, 0), 270.0), ((1, 1), 45.0)],
)
def test_a_face_looks_down_its_slope(direction, azimuth):
    down = np.divide(direction, np.hypot(*direction))
    plan = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 3.0], [0.0, 3.0]])
    ring = np.column_stack([plan, -plan @ down * np.tan(np.radians(30.0))])
    shape = face_shape([ring])
    assert shape.slope_deg == pytest.approx(30.0)
    assert shape.azimuth_deg == pytest.approx(azimuth, abs=1e-6)
    assert shape.area == pytest.approx(6.0 / np.cos(np.radians(30.0)))
    a, b, c = face_plane([ring])
    assert plan @ (a, b) + c == pytest.approx(ring[:, 2])


def test_a_level_face_has_no_azimuth_and_holes_count():
    shape = face_shape([PLAN[[0, 2, 4, 5]], PLAN[[6, 9, 8, 7]]])
    assert shape == (0.0, None, pytest.approx(64.0 - 16.0))

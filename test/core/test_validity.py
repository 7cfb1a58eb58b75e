"""
One tiny case per code of val3dity.

"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lidar_buildings.core.outline import Outline
from lidar_buildings.core.solid import Solid, extrude
from lidar_buildings.core.validity import CODES, check_solid

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
#: Clockwise, as holes are.
SMALL = np.array([[0.0, 0.0], [0.0, 2.0], [2.0, 2.0], [2.0, 0.0]])


def box(holes=(), exterior=SQUARE):
    return extrude(
        Outline(np.asarray(exterior, dtype=float), tuple(np.asarray(h, float) for h in holes)), 0.0, 3.0
    )


def merged(first, second):
    shift = len(first.vertices)
    moved = tuple(tuple(tuple(i + shift for i in ring) for ring in face) for face in second.faces)
    return Solid(
        np.vstack([first.vertices, second.vertices]), first.faces + moved, first.semantics + second.semantics
    )


def without_last_face(solid):
    return replace(solid, faces=solid.faces[:-1], semantics=solid.semantics[:-1])


def with_face(solid, number, face):
    return replace(solid, faces=(*solid.faces[:number], face, *solid.faces[number + 1 :]))


def moved_vertex(solid, row, shift):
    vertices = solid.vertices.copy()
    vertices[row] += shift
    return replace(solid, vertices=vertices)


def same_way_round():
    solid = box([SMALL + 2])
    bottom, hole = solid.faces[0]
    return with_face(solid, 0, (bottom, hole[::-1]))


def pyramids_tip_to_tip():
    base = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1, 1, 2]], dtype=float)
    faces = (((3, 2, 1, 0),), ((0, 1, 4),), ((1, 2, 4),), ((2, 3, 4),), ((3, 0, 4),))
    upright = Solid(base, faces, ("WallSurface",) * 5)
    turned = Solid(base * [-1, 1, -1] + [2, 0, 4], faces, upright.semantics)
    return merged(upright, turned)


CASES = {
    101: box(exterior=[[0, 0], [1, 0]]),
    102: with_face(box(), 1, ((4, 5, 5, 6, 7),)),
    104: box(exterior=[[0, 0], [4, 4], [4, 0], [0, 4]]),
    201: box([np.add(SMALL, [9.0, 4.0])]),
    202: box([SMALL + 2, SMALL + 2]),
    203: moved_vertex(box(), 6, [0.0, 0.0, 0.1]),
    205: box([np.array([[0.0, 5.0], [5.0, 10.0], [10.0, 5.0], [5.0, 0.0]])]),
    206: box([SMALL + 20]),
    207: box([SMALL + 2, 0.5 * SMALL + 2.5]),
    208: same_way_round(),
    301: Solid(np.eye(3), (((0, 1, 2),), ((2, 1, 0),)), ("RoofSurface", "GroundSurface")),
    302: without_last_face(box()),
    303: box([np.array([[5.0, 0.0], [4.0, 4.0], [6.0, 4.0]])], [[0, 0], [5, 0], [10, 0], [10, 10], [0, 10]]),
    305: merged(box(), box(exterior=SQUARE + 50)),
    307: with_face(box(), 3, (box().faces[3][0][::-1],)),
    309: replace(box(), vertices=np.vstack([box().vertices, [[5.0, 5.0, 1.0]]])),
}


def test_every_case_has_a_name():
    assert set(CASES) <= set(CODES)


@pytest.mark.parametrize("code", CASES)
def test_a_broken_solid_gets_its_code(code):
    assert check_solid(CASES[code]) == (code,)


@pytest.mark.parametrize("holes", [(), (SMALL + 2,), (SMALL + 2, SMALL + 6)])
def test_a_sound_solid_gets_none(holes):
    assert check_solid(box(holes)) == ()


def test_a_shell_that_looks_inwards_is_a_wrongly_oriented_shell():
    solid = box()
    inside_out = replace(solid, faces=tuple(tuple(ring[::-1] for ring in face) for face in solid.faces))
    assert check_solid(inside_out) == (405,)


def test_a_solid_without_height_is_refused():
    assert check_solid(extrude(Outline(SQUARE), 3.0, 3.0)) != ()


def test_two_parts_that_meet_in_one_vertex_are_not_manifold():
    assert 303 in check_solid(pyramids_tip_to_tip())


def test_a_ring_that_touches_itself_intersects():
    bow = [[0, 0], [4, 0], [2, 2], [4, 4], [0, 4], [2, 2]]
    assert check_solid(box(exterior=bow)) == (104,)


def test_an_empty_solid_is_an_empty_primitive():
    assert check_solid(Solid(np.empty((0, 3)), (), ())) == (902,)


def test_vertices_with_equal_coordinates_count_as_one():
    solid = box()
    corners = solid.vertices[[i for face in solid.faces for i in face[0]]]
    starts = np.cumsum([0, *(len(face[0]) for face in solid.faces)])
    soup = tuple((tuple(range(a, b)),) for a, b in pairwise(starts))
    assert check_solid(Solid(corners, soup, solid.semantics)) == ()

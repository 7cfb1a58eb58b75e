"""One tiny case per code of val3dity."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.solids.shell import Solid
from lidar_buildings.core.solids.validity import CODES, check_solid

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


def polyhedron(vertices, *rings):
    return Solid(
        np.asarray(vertices, dtype=float), tuple((ring,) for ring in rings), ("WallSurface",) * len(rings)
    )


def folded_roof():
    """A box whose roof has a fold of 50°, six millimetres high."""
    profile = [(0, 3), (5, 3), (5.005, 3.006), (10, 3.006)]
    front = [(0, 0, 0), (10, 0, 0), *((x, 0, z) for x, z in profile[::-1])]
    back = [(x, 10, z) for x, _, z in front]
    walls = [(1, 7, 8, 2), (5, 11, 6, 0)]
    return polyhedron(
        front + back, range(6), range(11, 5, -1), (0, 6, 7, 1), (5, 4, 3, 2, 8, 9, 10, 11), *walls
    )


def dent_through_the_floor(depth=1.0):
    """A box whose roof is drawn down to a tip below its floor: closed, manifold and planar everywhere."""
    solid = box()
    tip = len(solid.vertices)
    sides = tuple(((4 + k, 4 + (k + 1) % 4, tip),) for k in range(4))
    faces = (solid.faces[0], *solid.faces[2:], *sides)
    return Solid(np.vstack([solid.vertices, [[5, 5, -depth]]]), faces, ("WallSurface",) * len(faces))


def inside_out():
    solid = box()
    return replace(solid, faces=tuple(tuple(ring[::-1] for ring in face) for face in solid.faces))


CASES = {
    101: box(exterior=[[0, 0], [1, 0]]),
    102: with_face(box(), 1, ((4, 5, 5, 6, 7),)),
    104: box(exterior=[[0, 0], [4, 4], [4, 0], [0, 4]]),
    201: box([np.add(SMALL, [9.0, 4.0])]),
    202: box([SMALL + 2, SMALL + 2]),
    203: moved_vertex(box(), 6, [0.0, 0.0, 0.1]),
    204: folded_roof(),
    205: box([np.array([[0.0, 5.0], [5.0, 10.0], [10.0, 5.0], [5.0, 0.0]])]),
    206: box([SMALL + 20]),
    207: box([SMALL + 2, 0.5 * SMALL + 2.5]),
    208: same_way_round(),
    301: Solid(np.eye(3), (((0, 1, 2),), ((2, 1, 0),)), ("RoofSurface", "GroundSurface")),
    302: replace(box(), faces=box().faces[:-1], semantics=box().semantics[:-1]),
    303: box([np.array([[5.0, 0.0], [4.0, 4.0], [6.0, 4.0]])], [[0, 0], [5, 0], [10, 0], [10, 10], [0, 10]]),
    305: merged(box(), box(exterior=SQUARE + 50)),
    306: dent_through_the_floor(),
    307: with_face(box(), 3, (box().faces[3][0][::-1],)),
    309: replace(box(), vertices=np.vstack([box().vertices, [[5.0, 5.0, 1.0]]])),
    405: inside_out(),
    902: Solid(np.empty((0, 3)), (), ()),
}


def test_every_code_that_is_looked_for_has_a_case():
    assert set(CASES) == set(CODES)


@pytest.mark.parametrize("code", CASES)
def test_a_broken_solid_gets_its_code(code):
    assert check_solid(CASES[code]) == (code,)


@pytest.mark.parametrize("holes", [(), (SMALL + 2,), (SMALL + 2, SMALL + 6)])
def test_a_sound_solid_gets_none(holes):
    assert check_solid(box(holes)) == ()


def test_a_solid_without_height_is_refused_and_one_of_a_millimetre_may_be_taken_for_it():
    assert check_solid(extrude(Outline(SQUARE), 3.0, 3.0)) != ()
    assert check_solid(extrude(Outline(SQUARE), 0.0, 0.001)) == (101,)


def test_parts_that_meet_in_a_vertex_are_not_manifold_and_a_ring_that_touches_itself_intersects():
    assert 303 in check_solid(pyramids_tip_to_tip())
    bow = [[0, 0], [4, 0], [2, 2], [4, 4], [0, 4], [2, 2]]
    assert check_solid(box(exterior=bow)) == (104,)


def test_vertices_with_equal_coordinates_count_as_one():
    solid = box()
    corners = solid.vertices[[i for face in solid.faces for i in face[0]]]
    starts = np.cumsum([0, *(len(face[0]) for face in solid.faces)])
    soup = tuple((tuple(range(a, b)),) for a, b in pairwise(starts))
    assert check_solid(Solid(corners, soup, solid.semantics)) == ()


def test_a_dent_that_stays_inside_is_sound():
    assert check_solid(dent_through_the_floor(-0.001)) == ()
    assert check_solid(dent_through_the_floor(0.0)) == (306,)


def test_a_sound_solid_stays_sound_wherever_it_is():
    for shift in ([1e5, -2e5, 300.0], [0.001, 0.0, 0.0]):
        solid = box([SMALL + 2])
        assert check_solid(replace(solid, vertices=solid.vertices + shift)) == ()


#: Thin, but legal.
THIN = {
    "a wall of 2 mm": box(exterior=[[0, 0], [10, 0], [10, 0.002], [0, 0.002]]),
    "a slab of 2 mm": extrude(Outline(SQUARE), 0.0, 0.002),
    "a straight corner": box(exterior=[[0, 0], [5, 0], [10, 0], [10, 10], [0, 10]]),
    "a notch of 2 mm": box(exterior=[[0, 0], [5, 0], [5.001, 3], [5.002, 0], [10, 0], [10, 10], [0, 10]]),
    "a hole 2 mm beside the exterior": box([np.array([[4.0, 4.0], [5.0, 9.998], [6.0, 4.0]])]),
    "holes 2 mm apart": box([SMALL + 2, np.add(SMALL, [4.002, 2.0])]),
}


@pytest.mark.parametrize("name", THIN)
def test_what_is_thin_but_legal_is_sound(name):
    assert check_solid(THIN[name]) == ()


def test_holes_may_touch_at_a_vertex_but_not_along_an_edge():
    beside = np.array([[4.0, 4.0], [4.0, 6.0], [6.0, 6.0], [6.0, 4.0]])
    corner_to_corner = extrude(Outline(SQUARE, (SMALL + 2, beside)), 0.0, 3.0)
    assert check_solid(corner_to_corner) == (303,)
    assert check_solid(box([SMALL + 2, np.add(SMALL, [4.0, 3.0])])) == (201,)


def mutations(solid):
    """Every way to spoil one face or vertex of a solid."""
    for number, face in enumerate(solid.faces):
        yield with_face(solid, number, tuple(ring[::-1] for ring in face))
        kept = [k for k in range(len(solid.faces)) if k != number]
        yield Solid(
            solid.vertices, tuple(solid.faces[k] for k in kept), tuple(solid.semantics[k] for k in kept)
        )
        yield Solid(solid.vertices, (*solid.faces, face), (*solid.semantics, solid.semantics[number]))
        yield with_face(solid, number, (face[0][1:], *face[1:]))
    for row in range(len(solid.vertices)):
        for shift in np.vstack([np.eye(3), -np.eye(3)]) * 0.2:
            yield moved_vertex(solid, row, shift)


@pytest.mark.parametrize("holes", [(), (SMALL + 2,)])
def test_whatever_is_spoilt_is_found(holes):
    spoilt = list(mutations(box(holes)))
    assert len(spoilt) > 50
    assert [check_solid(solid) for solid in spoilt if not check_solid(solid)] == []

"""Solids with voids: one tiny case per code."""

from dataclasses import replace

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import Solid, extrude
from lidar_buildings.core.solids.validity import check_solid_with_voids


def cube(corner, size):
    ring = np.array([[0, 0], [size, 0], [size, size], [0, size]], dtype=float) + corner[:2]
    return extrude(Outline(ring), corner[2], corner[2] + size)


def void(corner, size):
    return turned(cube(corner, size))


def turned(solid):
    return replace(solid, faces=tuple(tuple(ring[::-1] for ring in face) for face in solid.faces))


def frame():
    """A cube of 10 m with a square drawn upon its top."""
    outer = cube((0, 0, 0), 10.0)
    square = np.array([[3, 3, 10], [7, 3, 10], [7, 7, 10], [3, 7, 10]], dtype=float)
    top = outer.faces[1][0]
    faces = (outer.faces[0], (top, (11, 10, 9, 8)), ((8, 9, 10, 11),), *outer.faces[2:])
    return Solid(np.vstack([outer.vertices, square]), faces, ("RoofSurface",) * len(faces))


def bowl():
    """A void between two pyramids that stand on their tips and have the frame's square in common."""
    vertices = np.array([[3, 3, 10], [7, 3, 10], [7, 7, 10], [3, 7, 10], [5, 5, 9], [5, 5, 5]], dtype=float)
    upper = tuple(((k, (k + 1) % 4, 4),) for k in range(4))
    lower = tuple((((k + 1) % 4, k, 5),) for k in range(4))
    return turned(Solid(vertices, upper + lower, ("WallSurface",) * 8))


OUTER = cube((0, 0, 0), 10.0)
CASES = {
    401: (OUTER, [void((8, 2, 2), 3.0)]),
    402: (OUTER, [void((2, 2, 2), 3.0), void((2, 2, 2), 3.0)]),
    403: (OUTER, [void((12, 2, 2), 3.0)]),
    404: (frame(), [bowl()]),
    405: (OUTER, [cube((2, 2, 2), 3.0)]),
}


@pytest.mark.parametrize("code", CASES)
def test_broken_voids_get_their_code(code):
    assert check_solid_with_voids(*CASES[code]) == (code,)


def test_voids_inside_and_apart_are_sound():
    assert check_solid_with_voids(OUTER, []) == ()
    assert check_solid_with_voids(OUTER, [void((1, 1, 1), 3.0), void((5, 5, 5), 3.0)]) == ()


def test_voids_may_touch_at_a_vertex():
    assert check_solid_with_voids(OUTER, [void((1, 1, 1), 3.0), void((4, 4, 4), 3.0)]) == ()


def test_a_void_must_not_share_a_face_or_lie_in_another_one():
    assert check_solid_with_voids(OUTER, [void((7, 2, 2), 3.0)]) == (401,)
    assert check_solid_with_voids(OUTER, [void((2, 2, 2), 5.0), void((3, 3, 3), 1.0)]) == (401,)


def test_a_broken_shell_is_told_before_how_shells_lie():
    hollow = void((8, 2, 2), 3.0)
    opened = replace(hollow, faces=hollow.faces[1:], semantics=hollow.semantics[1:])
    assert check_solid_with_voids(OUTER, [opened]) == (302,)

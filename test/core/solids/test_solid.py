"""Extruded solids: volume, orientation."""

import numpy as np
import pytest

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import extrude, extrusion_codes
from lidar_buildings.core.solids.shell import GROUND_SURFACE, ROOF_SURFACE, WALL_SURFACE, Solid
from lidar_buildings.core.solids.validity import check_solid

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
COURTYARD = np.array([[4.0, 4.0], [4.0, 7.0], [6.0, 7.0], [6.0, 4.0]])


def normal(ring):
    offsets = ring - ring[0]
    return np.cross(offsets[1:-1], offsets[2:]).sum(axis=0)


def test_a_box_has_six_faces_and_its_volume():
    box = extrude(Outline(SQUARE), 1.0, 4.0)
    assert len(box.faces) == 6
    assert box.volume == pytest.approx(300.0)
    assert check_solid(box) == ()


def test_a_courtyard_is_left_open():
    house = extrude(Outline(SQUARE, (COURTYARD,)), 0.0, 5.0)
    assert house.volume == pytest.approx((100.0 - 6.0) * 5.0)
    assert check_solid(house) == ()
    assert [len(face) for face in house.faces[:2]] == [2, 2]
    assert house.semantics.count(WALL_SURFACE) == 8


def test_faces_look_outwards_and_know_what_they_are():
    house = extrude(Outline(SQUARE, (COURTYARD,)), 0.0, 5.0)
    for face, kind in zip(house.faces, house.semantics, strict=True):
        ring = house.vertices[list(face[0])]
        up = np.sign(normal(ring)[2])
        assert up == {GROUND_SURFACE: -1, ROOF_SURFACE: 1, WALL_SURFACE: 0}[kind]
        if kind == WALL_SURFACE:
            ahead = ring.mean(axis=0)[:2] + 0.1 * normal(ring)[:2] / np.linalg.norm(normal(ring))
            in_square = np.all((ahead > 0) & (ahead < 10))
            in_courtyard = np.all((ahead > [4, 4]) & (ahead < [6, 7]))
            assert in_courtyard or not in_square


def test_the_direction_of_the_given_rings_does_not_matter():
    given = Outline(SQUARE[::-1], (COURTYARD[::-1],))
    assert extrude(given, 0.0, 5.0).volume == pytest.approx(470.0)


def test_volume_is_exact_far_from_the_origin():
    far = Outline(SQUARE + 1e6)
    assert extrude(far, 1000.0, 1003.0).volume == pytest.approx(300.0, abs=1e-6)


def test_nothing_is_no_solid():
    nothing = Solid(np.empty((0, 3)), (), ())
    assert nothing.volume == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_what_is_told_from_an_outline_is_what_all_checks_of_its_extrusion_say(seed):
    random = np.random.default_rng(seed)
    told = set()
    for _ in range(60):
        # Corners on a coarse grid, so that rings touch, cross and coincide.
        rings = [
            random.integers(0, 9, (random.integers(3, 7), 2)) * 1.0 for _ in range(random.integers(1, 4))
        ]
        outline = Outline(rings[0] * random.choice([0.0015, 1.0]), tuple(rings[1:])).oriented()
        solid = extrude(outline, 0.0, 3.0)
        codes = extrusion_codes(outline, solid, 3.0)
        assert codes == check_solid(solid)
        told.add(not codes)
    assert told == {True, False}

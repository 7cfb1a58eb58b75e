"""A marker per building, which the next one of the building replaces or deletes."""

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.core.stages.facades.facade import Facade
from lidar_buildings.ros.markers import facade_markers, model_markers

STAMP = 5_000_000_001
TETRAHEDRON = Solid(
    np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    (((0, 2, 1),), ((0, 1, 3),), ((1, 2, 3),), ((2, 0, 3),)),
    (ROOF_SURFACE,) * 4,
)


def test_every_building_has_one_list_of_lines_of_its_own():
    markers = model_markers(STAMP, {7: [TETRAHEDRON], 8: [TETRAHEDRON, TETRAHEDRON]}).markers
    assert [(one.ns, one.id, one.action, one.type) for one in markers] == [
        ("buildings", 7, Marker.ADD, Marker.LINE_LIST),
        ("buildings", 8, Marker.ADD, Marker.LINE_LIST),
    ]
    assert [len(one.points) for one in markers] == [2 * 6, 2 * 2 * 6]
    assert all(one.header.frame_id == "map" and one.pose.orientation.w == 1.0 for one in markers)


def test_what_is_gone_or_has_no_solid_is_deleted():
    markers = model_markers(STAMP, {7: [], 8: [TETRAHEDRON]}, withdrawn=[9]).markers
    assert {one.id: one.action for one in markers} == {7: Marker.DELETE, 8: Marker.ADD, 9: Marker.DELETE}
    assert [len(one.points) for one in markers if one.action == Marker.DELETE] == [0, 0]


def test_a_building_is_the_fainter_the_less_sure_its_corners_are():
    solids = {number: [TETRAHEDRON] for number in (1, 2, 3, 4)}
    shown = model_markers(STAMP, solids, (), {1: 0.02, 2: 0.1, 3: 2.0})
    assert [one.color.a for one in shown.markers] == pytest.approx([1.0, 0.5, 0.3, 1.0])


@pytest.mark.parametrize("number", [1, 2**31 - 1, 2**31, 2**32 - 1])
def test_every_id_of_a_building_fits_a_marker(number):
    (marker,) = model_markers(STAMP, {number: []}).markers
    assert marker.id % 2**32 == number


FACADE = Facade(
    np.array([[0.0, 0.0], [4.0, 0.0]]),
    1.0,
    3.0,
    np.ones(16, dtype=bool),
    0.9,
    0.02,
    100,
    0.5,
    "straight",
    7,
    9,
)


def test_a_facade_is_a_rectangle_the_surer_the_more_opaque_and_deleted_when_it_is_gone():
    shown = facade_markers(STAMP, [FACADE], withdrawn=[8]).markers
    assert {one.id: one.action for one in shown} == {8: Marker.DELETE, 9: Marker.ADD}
    (drawn,) = (one for one in shown if one.action == Marker.ADD)
    assert drawn.ns == "facades"
    assert drawn.color.a == 0.5
    assert [(p.x, p.y, p.z) for p in drawn.points[::2]] == [(0, 0, 1), (4, 0, 1), (4, 0, 3), (0, 0, 3)]

"""Roof shapes: exact partitions of their outlines, and closed solids."""

from collections import Counter

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.outline import signed_area
from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation.building import shell_of

#: Shape → number of roof planes.
SHAPES = {
    "flat": (shapes.flat(), 1),
    "shed": (shapes.shed(), 1),
    "gable": (shapes.gable(), 2),
    "hip": (shapes.hip(), 4),
    "pyramid": (shapes.hip(length=10), 4),
    "l_shape": (shapes.l_shape(), 4),
    "flat_l_shape": (shapes.l_shape(pitch_deg=0), 1),
    "t_shape": (shapes.t_shape(), 4),
    "step": (shapes.step(), 2),
    "dormer": (shapes.dormer(), 3),
    "dormer_at_the_eave": (shapes.dormer(setback=0), 3),
    "courtyard": (shapes.courtyard(), 1),
    "pitched_courtyard": (shapes.courtyard(pitch_deg=30), 8),
    "round_tower": (shapes.round_tower(), 1),
    "pointed_tower": (shapes.round_tower(pitch_deg=40, n_sides=24), 24),
    "half_hip": (shapes.half_hip(), 4),
    "square": (shapes.pyramid(), 4),
    "gambrel": (shapes.gambrel(), 4),
    "mansard": (shapes.mansard(), 5),
    "cross_gable": (shapes.cross_gable(), 8),
    "hipped_l": (shapes.hipped_l(), 6),
    "double_gable": (shapes.double_gable(), 4),
    "gable_dormer": (shapes.gable_dormer(), 4),
    "sawtooth": (shapes.sawtooth(), 4),
    "barrel": (shapes.barrel(), 12),
    "church": (shapes.church(), 6),
    "parapet": (shapes.parapet(), 2),
}


@pytest.fixture(params=SHAPES)
def placed(request):
    shape, n_planes = SHAPES[request.param]
    return shape.placed(31.7, -12.3, 27.0, 105.0), n_planes


def test_faces_share_the_outline_out_between_them(placed):
    building, n_planes = placed
    polygons = [face.polygon for face in building.faces]
    assert len(building.faces) == n_planes
    assert building.polygon.is_valid
    assert all(polygon.is_valid for polygon in polygons)
    assert sum(polygon.area for polygon in polygons) == pytest.approx(building.polygon.area, abs=1e-6)
    # Corners rounded to 0.1 mm leave slivers of that width along the edges.
    assert shapely.union_all(polygons).symmetric_difference(building.polygon).area < 1e-2


def test_rings_turn_the_right_way_and_shells_are_closed_with_a_volume_of_area_times_height(placed):
    building, _ = placed
    assert signed_area(building.exterior) > 0
    assert all(signed_area(hole) < 0 for hole in building.outline.holes)
    assert len(building.outline.holes) == (1 if building.roof_type == "courtyard" else 0)
    edges = Counter()
    for surface in shell_of(building).surfaces:
        for ring in surface:
            corners = [tuple(corner) for corner in np.round(ring * 1000).astype(int)]
            edges.update(zip(corners, corners[1:] + corners[:1], strict=True))
    assert set(edges.values()) == {1}
    assert all(edge[::-1] in edges for edge in edges)
    foot = np.array([31.7, -12.3, 105.0])
    volume = 0.0
    for surface in shell_of(building).surfaces:
        for ring in surface:
            corners = ring - foot
            crosses = np.cross(corners[1:-1], corners[2:])
            volume += (crosses @ corners[0]).sum() / 6
    heights = [face.elevation(np.array(face.polygon.centroid.coords))[0] - 105.0 for face in building.faces]
    areas = [face.polygon.area for face in building.faces]
    assert volume == pytest.approx(np.dot(areas, heights), rel=1e-6)


def test_heights_of_eaves_ridges_arcs_and_spires_are_those_of_their_measures():
    low, high = shapes.gable(14, 9, 5.0, 45.0).roof_elevation_range
    assert low == pytest.approx(5.0)
    assert high == pytest.approx(5.0 + 4.5)
    assert shapes.hipped_l().height == pytest.approx(5.0 + 4.0 * np.tan(np.deg2rad(35)))
    assert shapes.cross_gable().height == pytest.approx(shapes.hipped_l().height)
    assert shapes.barrel().height == pytest.approx(9.0)
    assert shapes.church().height == pytest.approx(34.0)


def test_turned_by_a_right_angle_a_roof_has_the_same_heights():
    plain = shapes.l_shape()
    turned = plain.placed(3.0, 4.0, 90.0)
    xy = np.random.default_rng(0).uniform(-12, 12, (500, 2))
    plane_id, elevation = plain.roof_at(xy)
    turned_id, turned_elevation = turned.roof_at(np.column_stack([3 - xy[:, 1], 4 + xy[:, 0]]))
    assert np.array_equal(plane_id, turned_id)
    assert np.allclose(elevation, turned_elevation, equal_nan=True)


def test_a_dormer_above_the_ridge_is_refused():
    with pytest.raises(ValueError, match="dormer_height = 9 m"):
        shapes.dormer(dormer_height=9)

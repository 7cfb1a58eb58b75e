"""Boundaries of unions and numbers of vertices, worked out by hand."""

import pytest
import shapely
from shapely import box

from lidar_buildings.evaluation.scores.outlines import score_outlines


def test_the_boundary_of_the_unions_does_not_see_how_a_block_is_parted():
    parts = [box(0, 0, 4, 10), box(4, 0, 10, 10)]
    score = score_outlines(parts, [box(0, 0, 10, 10)])
    assert score["boundary_of_unions_hausdorff"] == pytest.approx(0.0, abs=1e-9)
    # The larger part is the partner: its inner wall lies up to 4 m off.
    assert score["boundary_hausdorff"] == pytest.approx(4.0)


def test_the_boundary_of_the_unions_sees_what_has_no_partner():
    score = score_outlines([box(0, 0, 10, 10)], [box(0, 0, 10, 10), box(20, 0, 30, 10)])
    assert score["boundary_hausdorff"] == pytest.approx(0.0, abs=1e-9)
    # Of the 40 m of the second square, 10 m lie 10 m off, 10 m lie 20 m off, and 20 m from 10 to 20 m off.
    assert score["boundary_of_unions_mean"] == pytest.approx((10 * 10 + 10 * 20 + 20 * 15) / 120, rel=0.01)
    assert score["boundary_of_unions_hausdorff"] == pytest.approx(20.0)


def test_along_the_edge_of_the_area_unions_are_not_compared():
    score = score_outlines([box(0, 0, 40, 10)], [box(0, 0, 30, 10)], area=[box(-5, -5, 20, 15)])
    assert score["boundary_of_unions_hausdorff"] == pytest.approx(0.0, abs=1e-9)


def test_vertices_are_counted_as_drawn_and_in_the_reference_as_needed():
    dense = shapely.segmentize(box(0, 0, 10, 10), 1.0)
    holed = shapely.Polygon(box(20, 0, 40, 20).exterior, [box(25, 5, 35, 15).exterior])
    score = score_outlines([box(0, 0, 10, 10), holed, box(90, 0, 99, 9)], [dense, holed])
    assert (score["n_vertices_result"], score["n_vertices_reference"]) == (16, 12)

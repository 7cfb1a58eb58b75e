"""Precision and recall of corners, worked out by hand."""

import math

import pytest
import shapely
from shapely import box
from shapely.affinity import translate

from lidar_buildings.evaluation.scores.outlines import corners_of, score_corners, valid_polygons


def found_corners(*polygons):
    return corners_of(valid_polygons(polygons))


def test_a_square_has_four_corners_however_densely_it_is_drawn():
    square = box(0, 0, 10, 10)
    for drawn in (
        square,
        shapely.segmentize(square, 0.5),
        shapely.Polygon([(5, 0), *square.exterior.coords]),
    ):
        found = {tuple(corner) for corner in found_corners(drawn).round(6).tolist()}
        assert found == {(0, 0), (10, 0), (10, 10), (0, 10)}


def test_a_vertex_that_turns_by_less_than_ten_degrees_is_no_corner():
    # Half a metre out of line on 10 m to either side: the wall turns by 2 · 2.9°; two metres: by 2 · 11.3°.
    assert len(found_corners(shapely.Polygon([(0, 0), (10, -0.5), (20, 0), (20, 9), (0, 9)]))) == 4
    assert len(found_corners(shapely.Polygon([(0, 0), (10, -2.0), (20, 0), (20, 9), (0, 9)]))) == 5


@pytest.mark.parametrize(("tolerance", "n_matched"), [(0.4, 0), (0.6, 4)])
def test_corners_match_within_the_tolerance(tolerance, n_matched):
    # Moved by (0.3, 0.4): all corners 0.5 m off.
    score = score_corners([translate(box(0, 0, 9, 9), 0.3, 0.4)], [box(0, 0, 9, 9)], tolerance=tolerance)
    assert score["n_matched"] == n_matched
    if n_matched:
        assert score["mean_distance"] == pytest.approx(0.5)


def test_a_missed_bay_costs_recall_and_an_invented_one_precision():
    plain, bay = box(0, 0, 20, 10), shapely.union_all([box(0, 0, 20, 10), box(8, 10, 12, 13)])
    missed, invented = score_corners([plain], [bay]), score_corners([bay], [plain])
    assert (missed["precision"], missed["recall"]) == (1.0, 0.5)
    assert (invented["precision"], invented["recall"]) == (0.5, 1.0)


def test_a_corner_is_used_once():
    # A corner cut off by 0.6 m has two corners near the reference's one.
    cut = shapely.Polygon([(0, 0), (10, 0), (10, 9.4), (9.4, 10), (0, 10)])
    score = score_corners([cut], [box(0, 0, 10, 10)])
    assert (score["n_result"], score["n_reference"], score["n_matched"]) == (5, 4, 4)
    assert score["mean_distance"] == pytest.approx(0.6 / 4)


def test_only_corners_inside_the_area_count_and_none_where_it_cuts():
    score = score_corners([box(0, 0, 40, 10)], [box(0, 0, 30, 10)], area=[box(-5, -5, 20, 15)])
    assert (score["n_result"], score["n_reference"], score["n_matched"]) == (2, 2, 2)


def test_nothing_has_no_corners():
    score = score_corners([], [box(0, 0, 1, 1)])
    assert (score["n_matched"], score["recall"]) == (0, 0.0)
    assert math.isnan(score["precision"])
    assert math.isnan(score["mean_distance"])

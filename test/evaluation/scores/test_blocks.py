"""Blocks of touching buildings, and how many buildings a result covers, on cases worked out by hand."""

import math

import numpy as np
import pytest
import shapely
from shapely import box

from lidar_buildings.evaluation.scores.outlines import covered_share, merge_touching


def row_of_houses(count, gap=0.0):
    """Houses of 6 by 10 m side by side."""
    return [box(west, 0, west + 6, 10) for west in np.arange(count) * (6 + gap)]


def test_a_row_of_houses_is_one_block():
    (block,) = merge_touching(row_of_houses(4))
    assert block.equals(box(0, 0, 24, 10))


@pytest.mark.parametrize(("gap", "n_blocks"), [(0.0, 1), (0.04, 1), (0.06, 3), (1.0, 3)])
def test_walls_closer_than_the_tolerance_are_one_wall_and_the_gap_is_closed(gap, n_blocks):
    polygons = merge_touching(row_of_houses(3, gap))
    assert len(polygons) == n_blocks
    closed = 2 * gap * 10 if n_blocks == 1 else 0.0
    assert shapely.area(polygons).sum() == pytest.approx(180 + closed)
    assert all(polygon.geom_type == "Polygon" for polygon in polygons)


def test_houses_that_meet_at_a_corner_stay_apart():
    assert len(merge_touching([box(0, 0, 10, 10), box(10, 10, 20, 20)])) == 2


@pytest.mark.parametrize(("shared", "n_blocks"), [(0.3, 2), (0.8, 1)])
def test_a_wall_is_shared_from_half_a_metre_on(shared, n_blocks):
    polygons = merge_touching([box(0, 0, 10, 10), box(10, 10 - shared, 20, 20)])
    assert len(polygons) == n_blocks


def test_houses_round_a_courtyard_are_a_block_with_a_hole():
    wings = [box(0, 0, 30, 10), box(0, 20, 30, 30), box(0, 10, 10, 20), box(20, 10, 30, 20)]
    (block,) = merge_touching(wings)
    assert block.area == pytest.approx(800)
    assert [shapely.Polygon(ring).area for ring in block.interiors] == [pytest.approx(100)]


def test_blocks_have_the_area_of_the_union_of_chance_buildings():
    random = np.random.default_rng(1)
    corners, sizes = random.integers(0, 60, (60, 2)), random.integers(2, 12, (60, 2))
    buildings = [box(*corner, *(corner + size)) for corner, size in zip(corners, sizes, strict=True)]
    blocks = merge_touching(buildings)
    union = shapely.union_all(buildings)
    assert shapely.area(blocks).sum() == pytest.approx(union.area)
    assert len(blocks) == len(shapely.get_parts(union))


@pytest.mark.parametrize("nothing", [[], [None], [shapely.Polygon()], [shapely.LineString([(0, 0), (1, 1)])]])
def test_nothing_is_no_block_or_an_empty_one(nothing):
    blocks = merge_touching(nothing)
    assert len(blocks) == len(nothing)
    assert shapely.area(blocks).sum() == 0


def test_each_building_of_a_row_is_covered_or_not_by_whatever_outline():
    result = [box(0, 0, 14, 10), box(40, 0, 45, 10)]
    reference = [*row_of_houses(3), box(40, 0, 50, 10), box(60, 0, 70, 10)]
    # covered: all, all, a third, half, nothing
    assert covered_share(result, reference) == pytest.approx(3 / 5)
    assert covered_share([*result, *result], reference) == pytest.approx(3 / 5)


def test_only_buildings_mostly_inside_the_area_of_interest_must_be_covered():
    reference = [box(0, 0, 10, 10), box(16, 0, 26, 10), box(12, 20, 22, 30)]
    # of the second one 4 of 10 m lie inside, of the third 8
    assert covered_share([box(0, 0, 30, 10)], reference, area=[box(0, 0, 20, 40)]) == 0.5


def test_a_share_of_no_building_is_no_number():
    assert math.isnan(covered_share([box(0, 0, 1, 1)], []))
    assert covered_share([], [box(0, 0, 1, 1)]) == 0.0

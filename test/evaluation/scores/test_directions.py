"""Angle errors, worked out by hand."""

import math

import numpy as np
import pytest
import shapely
from shapely import box
from shapely.affinity import rotate

from lidar_buildings.evaluation.scores.outlines import score_directions


def angles(result, reference, **options):
    return score_directions(np.array([result]), np.array([reference]), **options)


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.0])
def test_a_turned_house_has_the_angle_it_was_turned_by(turn):
    house = box(0, 0, 20, 10)
    score = angles(rotate(house, turn), house)
    assert score["median_deg"] == pytest.approx(turn, abs=1e-9)
    assert score["percentile_95_deg"] == pytest.approx(turn, abs=1e-9)
    assert score["matched_share"] == 1.0


def test_angles_are_weighted_by_the_length_of_walls():
    # The southern wall of 20 m falls by 1 m: 2.86°. The others, 9, 20 and 10 m long, are right.
    bent = shapely.Polygon([(0, 0), (20, 1), (20, 10), (0, 10)])
    score = angles(bent, box(0, 0, 20, 10))
    assert score["median_deg"] == pytest.approx(0.0, abs=1e-9)
    assert score["percentile_95_deg"] == pytest.approx(math.degrees(math.atan(1 / 20)))


def test_a_wall_away_from_all_of_the_reference_has_no_angle():
    wing = shapely.Polygon([(0, 0), (30, 0), (30, 5), (20, 5), (20, 10), (0, 10)])
    score = angles(wing, box(0, 0, 20, 10))
    # Of 80 m: the wing's end of 5 m and its northern wall of 10 m; the southern one is near on 20 of 30 m.
    assert score["matched_share"] == pytest.approx(1 - 15 / 80)
    assert score["percentile_95_deg"] == 0.0


def test_only_walls_with_their_middle_inside_the_limits_count():
    bent = shapely.Polygon([(0, 0), (20, 1), (20, 10), (0, 10)])
    limits = box(-1, 4, 30, 30)
    assert angles(bent, box(0, 0, 20, 10), limits=limits)["percentile_95_deg"] == 0.0


def test_a_densified_reference_has_the_walls_of_its_map():
    house = box(0, 0, 20, 10)
    jagged = shapely.transform(shapely.segmentize(house, 0.5), lambda xy: xy.round(1))
    assert angles(rotate(house, 1.0), jagged)["median_deg"] == pytest.approx(1.0, abs=0.01)


def test_nothing_has_no_angle():
    nothing = np.array([], dtype=object)
    score = score_directions(nothing, nothing)
    assert math.isnan(score["median_deg"])
    assert math.isnan(score["matched_share"])
    empty = angles(shapely.Polygon(), shapely.Polygon())
    assert math.isnan(empty["median_deg"])

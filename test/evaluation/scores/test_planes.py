"""The score of planes on labels whose figures are worked out by hand."""

import numpy as np
import pytest

from lidar_buildings.evaluation.scores.planes import planes_of_colours, score_planes


def test_equal_divisions_score_one_whatever_the_numbers():
    reference = np.repeat([1, 2, 3], [10, 20, 30])
    score = score_planes(np.array([0, 7, 3, 9])[reference], reference)
    assert (score.precision, score.recall, score.f1) == (1.0, 1.0, 1.0)
    assert score.weighted_coverage == score.coverage == 1.0
    assert (score.n_points, score.n_planes_result, score.n_planes_reference, score.n_planes_found) == (
        60,
        3,
        3,
        3,
    )


def test_figures_are_those_worked_out_by_hand():
    # Plane 1 has 6 of its 10 points in one plane and 4 in another; plane 2 is found but for 5 points of none.
    reference = np.repeat([1, 2], [10, 20])
    result = np.repeat([1, 2, 3, 0], [6, 4, 15, 5])
    score = score_planes(result, reference)
    assert score.iou == pytest.approx([0.6, 0.75])
    assert score.precision == pytest.approx(2 / 3)
    assert score.recall == 1.0
    assert score.f1 == pytest.approx(0.8)
    assert score.coverage == pytest.approx((0.6 + 0.75) / 2)
    assert score.weighted_coverage == pytest.approx((10 * 0.6 + 20 * 0.75) / 30)


def test_an_overlap_of_one_half_counts_and_only_once():
    score = score_planes(np.repeat([1, 2], [5, 5]), np.ones(10, dtype=int))
    assert (score.n_planes_found, score.n_planes_result, score.n_planes_reference) == (1, 2, 1)


def test_points_of_no_plane_count_against_the_result_but_unknown_ones_do_not():
    result = np.ones(20, dtype=int)
    assert score_planes(result, np.repeat([1, 0], [15, 5])).iou == pytest.approx([0.75])
    unknown = score_planes(result, np.repeat([1, -1], [15, 5]))
    assert unknown.iou == pytest.approx([1.0])
    assert unknown.n_points == 15


@pytest.mark.parametrize(("result", "reference"), [([], []), ([0, 0], [0, 0]), ([1], [-1])])
def test_a_share_of_nothing_is_not_a_number(result, reference):
    score = score_planes(np.array(result, dtype=int), np.array(reference, dtype=int))
    assert np.isnan([score.recall, score.f1, score.weighted_coverage, score.coverage]).all()


def test_labels_of_other_points_are_refused():
    with pytest.raises(ValueError, match="result"):
        score_planes([1, 2], [1, 2, 3])


def test_a_colour_on_both_sides_of_a_roof_is_two_planes_and_slips_are_none():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 12, 0.3), np.arange(0, 6, 0.3)))
    points = np.column_stack([x, y, np.zeros_like(x)])
    colour = np.where((x > 4) & (x < 8), 1, 0)
    colour[:3] = 2
    colour[-1] = -1
    planes = planes_of_colours(points, colour)
    assert set(planes) == {-1, 1, 2, 3}
    assert (planes[:3] == -1).all()
    assert planes[-1] == -1
    assert len(np.unique(planes[(colour == 0)])) == 2
    assert len(np.unique(planes[colour == 1])) == 1


def test_no_points_have_no_colours():
    assert planes_of_colours(np.empty((0, 3)), []).size == 0

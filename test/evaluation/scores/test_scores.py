"""Scores against figures worked out by hand, and against slow and plain counting."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from lidar_buildings.evaluation.scores.cells import (
    Confusion,
    cells_inside,
    cells_of_points,
    cells_of_polygons,
    confusion_of,
    score_buildings,
    score_ground,
)
from lidar_buildings.evaluation.scores.outlines import score_outlines

#: Coordinates of a real national grid: what is right near (0, 0) must be right there.
FAR = (851_000.0, 6_272_000.0)


def box(x, y, width, depth):
    return shapely.box(x, y, x + width, y + depth)


def lattice(x_range, y_range, spacing):
    """Points on a square lattice whose first ones lie half a spacing from the corner."""
    x, y = np.meshgrid(*(np.arange(start + spacing / 2, stop, spacing) for start, stop in (x_range, y_range)))
    return np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))


def labelled(*groups):
    """Rows (count, result class, reference class) → result and reference."""
    counts, mine, theirs = zip(*groups, strict=True)
    return np.repeat(mine, counts), np.repeat(theirs, counts)


def test_kappa_of_a_textbook_table():
    # 20 and 15 agreements of 50: p_o = 0.7, p_e = 0.5 · 0.6 + 0.5 · 0.4 = 0.5
    table = Confusion(hits=20, false_alarms=5, misses=10, rejections=15)
    assert table.kappa == pytest.approx(0.4)
    assert table.total == 50
    assert (table.recall, table.precision) == pytest.approx((20 / 30, 20 / 25))
    assert table.iou == pytest.approx(20 / 35)
    assert table.f1 == pytest.approx(2 * (2 / 3) * 0.8 / (2 / 3 + 0.8))


def test_figures_without_a_base_are_nan_not_zero_and_not_an_error():
    nothing = Confusion(0, 0, 0, 0)
    figures = nothing.recall, nothing.precision, nothing.iou, nothing.f1, nothing.kappa
    assert all(math.isnan(figure) for figure in figures)
    assert math.isnan(Confusion(7, 0, 0, 0).kappa)


def test_masks_of_different_length_are_refused():
    with pytest.raises(ValueError, match="reference has shape"):
        confusion_of([True, False], [True])


def test_ground_errors_of_a_hand_made_case():
    result, reference = labelled((80, 2, 2), (20, 1, 2), (90, 1, 1), (10, 2, 6))
    score = score_ground(result, reference)
    assert (score.total, score.hits, score.misses, score.false_alarms) == (200, 80, 20, 10)
    assert score.type_1_error == pytest.approx(0.20)
    assert score.type_2_error == pytest.approx(0.10)
    assert score.total_error == pytest.approx(0.15)
    assert score.kappa == pytest.approx(0.70)


def test_a_road_in_the_result_is_ground_and_water_of_the_reference_on_request():
    result, reference = labelled((5, 11, 2), (5, 6, 6))
    assert score_ground(result, reference).total_error == 0.0
    result, reference = labelled((6, 2, 2), (2, 2, 9), (2, 6, 6))
    assert score_ground(result, reference).false_alarms == 2
    assert score_ground(result, reference, reference_ground=(2, 9)).total_error == 0.0


def test_a_square_has_its_cells_wherever_it_stands_and_overlapping_and_touching_ones_count_once():
    for x, y in ((0.0, 0.0), (-15.0, -3.0), FAR):
        assert len(cells_of_polygons([box(x, y, 10, 10)], 0.5)) == 400
    assert len(cells_of_polygons([box(0, 0, 10, 10), box(5, 0, 10, 10)], 0.5)) == 600
    # The shared wall runs through centres of cells: no gap opens along it.
    assert len(cells_of_polygons([box(0, 0, 5.25, 10), box(5.25, 0, 4.75, 10)], 0.5)) == 400


def test_a_shifted_square_has_the_iou_of_its_overlap():
    cells = [cells_of_polygons([box(FAR[0] + shift, FAR[1], 10, 10)], 0.5) for shift in (0.0, 2.0)]
    score = score_buildings(*cells)
    assert (score.hits, score.false_alarms, score.misses) == (320, 80, 80)
    assert score.recall == score.precision == pytest.approx(0.8)
    assert score.iou == pytest.approx(80 / 120)


def test_only_cells_inside_the_area_of_interest_count():
    result = cells_of_polygons([box(0, 0, 10, 10), box(50, 0, 10, 10)], 0.5)
    reference = cells_of_polygons([box(0, 0, 10, 10)], 0.5)
    assert score_buildings(result, reference).precision == pytest.approx(0.5)
    assert score_buildings(result, reference, area=[box(-5, -5, 20, 20)]).precision == 1.0
    assert len(cells_inside(result, [box(0, 0, 5, 5), box(50, 0, 5, 5)], 0.5)) == 200


def test_cells_agree_with_testing_every_centre_of_a_window(monkeypatch):
    monkeypatch.setattr("lidar_buildings.evaluation.scores.cells.WINDOW", 50)
    star = shapely.Polygon([(0, 0), (9, -4), (7, 3), (12, 9), (4, 6), (-5, 8.3), (-2, 3)])
    expected = sum(
        star.intersects(shapely.Point(0.3 * (i + 0.5), 0.3 * (j + 0.5)))
        for i in range(-30, 60)
        for j in range(-30, 60)
    )
    assert len(cells_of_polygons([star], 0.3)) == expected


@pytest.mark.parametrize("polygons", [[], [None], [shapely.Polygon()]])
def test_nothing_has_no_cells(polygons):
    assert len(cells_of_polygons(polygons, 0.5)) == 0


@pytest.mark.parametrize("spacing", [0.25, 0.5, 1.0, 2.5])
def test_a_roof_has_its_true_area_in_cells_at_any_density(spacing):
    points = lattice((0, 60), (0, 60), spacing) + np.array([*FAR, 0.0])
    x, y = (points[:, :2] - FAR).T
    on_roof = (x > 20) & (x < 40) & (y > 10) & (y < 50)
    reference = cells_of_polygons([box(FAR[0] + 20, FAR[1] + 10, 20, 40)], 0.5)
    score = score_buildings(cells_of_points(points, on_roof, 0.5), reference)
    # A tie between roof and ground goes to the roof: at most one row of cells all round.
    assert score.recall == 1.0
    assert score.iou > 0.92


def test_filled_cells_agree_with_asking_every_cell_for_its_nearest_point():
    random = np.random.default_rng(3)
    points = np.column_stack((random.uniform(0, 30, (400, 2)), np.zeros(400)))
    is_building = np.hypot(points[:, 0] - 12, points[:, 1] - 14) < 9
    from lidar_buildings.core.neighbours.point_spacing import measure_spacing

    reach = 1.5 * measure_spacing(points)
    expected = set()
    for i in range(-10, 80):
        for j in range(-10, 80):
            inside = (np.floor(points[:, :2] / 0.5) == (i, j)).all(axis=1)
            distance = np.hypot(points[:, 0] - 0.5 * i - 0.25, points[:, 1] - 0.5 * j - 0.25)
            nearest = distance.argmin()
            if is_building[inside].any() or (
                not inside.any() and distance[nearest] <= reach and is_building[nearest]
            ):
                expected.add((i << 32) + j)
    assert set(cells_of_points(points, is_building, 0.5).tolist()) == expected


def test_clouds_without_building_points_have_no_cells():
    assert len(cells_of_points(np.empty((0, 3)), np.empty(0, bool), 0.5)) == 0
    assert len(cells_of_points([[3.2, 4.1, 0.0]], [False], 0.5)) == 0


@pytest.mark.parametrize("cell", [0.0, -1.0, math.nan, 1e-9])
def test_an_impossible_cell_size_is_refused_by_name(cell):
    with pytest.raises(ValueError, match="cell = "):
        cells_of_polygons([box(*FAR, 1, 1)], cell)
    with pytest.raises(ValueError, match="cell = "):
        cells_of_points([(*FAR, 0.0)], [True], cell)


def test_a_shifted_outline_has_iou_and_distances_that_can_be_worked_out():
    # 10 × 10 shifted by 1: the common area is 90, the union 110.
    score = score_outlines([box(1, 0, 10, 10)], [box(0, 0, 10, 10)])
    assert score["mean_iou"] == score["area_iou"] == pytest.approx(90 / 110)
    assert score["area_completeness"] == score["area_correctness"] == pytest.approx(0.9)
    # Of each ring of 40 m, the edge outside the other square lies 1 m off (10 m); that inside, too, but for
    # its ends, which come as near as 0 (8 m and twice ½ m); and the overhangs run from 0 to 1 m off.
    assert score["boundary_mean"] == pytest.approx((10 + 8 + 2 * 0.5 + 2 * 0.5) / 40, rel=0.01)
    assert score["boundary_percentile_95"] == pytest.approx(1.0)
    assert score["boundary_hausdorff"] == pytest.approx(1.0)


def test_found_missed_and_extra_objects_are_counted_and_each_is_used_once_the_better_pair_first():
    reference = [box(0, 0, 10, 10), box(20, 0, 10, 10), box(40, 0, 10, 10)]
    result = [box(0, 0, 10, 10), box(26, 0, 10, 10), box(60, 0, 10, 10)]
    score = score_outlines(result, reference)
    assert (score["n_found"], score["n_reference"], score["n_result"]) == (1, 3, 3)
    assert score["completeness"] == score["correctness"] == score["f1"] == pytest.approx(1 / 3)
    assert score["iou_per_reference"] == pytest.approx([1.0, 40 / 160, 0.0])
    assert score["mean_iou"] == pytest.approx((1.0 + 0.25 + 0.0) / 3)
    assert score["mean_iou_found"] == 1.0
    reference = [box(0, 0, 10, 10), box(10, 0, 10, 10)]
    merged, exact = box(0, 0, 20, 10), box(10, 0, 10, 10)
    score = score_outlines([merged, exact], reference)
    assert score["partner_per_reference"].tolist() == [0, 1]
    assert score["iou_per_reference"] == pytest.approx([0.5, 1.0])


def test_outlines_are_cut_to_the_area_of_interest():
    reference = [box(0, 0, 10, 10)]
    result = [box(0, 0, 20, 10), box(9.9, 20, 50, 10), box(30, 0, 5, 5)]
    score = score_outlines(result, reference, area=[box(-5, -5, 15, 50)])
    # The first agrees once cut; of the second a strip is left, its building lies outside, as does the third.
    assert (score["n_result"], score["n_found"]) == (1, 1)
    assert score["mean_iou"] == pytest.approx(1.0)
    assert score["area_correctness"] == pytest.approx(100 / 101)
    # Along the cut itself nothing is compared.
    assert score["boundary_hausdorff"] == pytest.approx(0.0, abs=1e-9)


def test_a_missed_courtyard_counts_in_area_and_distance_and_self_crossing_outlines_are_repaired():
    courtyard = shapely.Polygon(box(0, 0, 20, 20).exterior, [box(5, 5, 10, 10).exterior])
    score = score_outlines([box(0, 0, 20, 20)], [courtyard])
    assert score["mean_iou"] == pytest.approx(300 / 400)
    assert score["boundary_hausdorff"] == pytest.approx(5.0)
    bow_tie = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
    assert score_outlines([bow_tie], [bow_tie])["mean_iou"] == pytest.approx(1.0)


@pytest.mark.parametrize("broken", [None, shapely.Polygon(), shapely.Polygon([(0, 0), (5, 5), (9, 9)])])
def test_outlines_without_area_are_left_out(broken):
    score = score_outlines([broken, box(0, 0, 10, 10)], [box(0, 0, 10, 10), broken])
    assert (score["n_result"], score["n_reference"], score["n_found"]) == (1, 1, 1)


def test_nothing_against_something_and_nothing_against_nothing():
    house = [box(0, 0, 10, 10)]
    missed, extra, nothing = (score_outlines(*pair) for pair in (([], house), (house, []), ([], [])))
    assert missed["n_reference"] == 1
    assert missed["completeness"] == missed["mean_iou"] == missed["area_iou"] == 0.0
    assert (extra["n_result"], extra["correctness"]) == (1, 0.0)
    assert math.isnan(extra["mean_iou"])
    assert math.isnan(nothing["completeness"])
    assert math.isnan(nothing["boundary_hausdorff"])
    assert (missed["f1"], extra["f1"]) == (0.0, 0.0)
    for score in (missed, extra, nothing):
        assert math.isnan(score["boundary_of_unions_mean"])


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_matching_agrees_with_picking_the_best_pair_again_and_again(seed):
    random = np.random.default_rng(seed)
    mine, theirs = (
        np.array([box(*random.uniform(0, 20, 2), *random.uniform(2, 9, 2)) for _ in range(6)])
        for _ in range(2)
    )
    iou = np.array([[a.intersection(b).area / a.union(b).area for b in mine] for a in theirs])
    expected = np.full(6, -1)
    while iou.max() > 0:
        row, column = np.unravel_index(iou.argmax(), iou.shape)
        expected[row] = column
        iou[row], iou[:, column] = 0, 0
    assert score_outlines(mine, theirs)["partner_per_reference"].tolist() == expected.tolist()

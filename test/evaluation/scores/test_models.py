"""The scores of building models: heights, ridges, wireframes, volumes, and distances of points."""

import numpy as np
import pytest
import shapely

from lidar_buildings.core.model.outline import Outline
from lidar_buildings.core.solids.raising import extrude
from lidar_buildings.core.solids.shell import ROOF_SURFACE, Solid
from lidar_buildings.evaluation.scores import models
from lidar_buildings.evaluation.scores.outlines import match_corners
from lidar_buildings.simulation import roof_shapes as shapes
from lidar_buildings.simulation.building import shell_of

#: Where the buildings stand: far from the origin, as in national reference systems.
PLACE = (84_000.0, 447_000.0)


def solid_of(building, shift=(0.0, 0.0, 0.0)):
    """The exact solid of a virtual building."""
    shell = shell_of(building)
    rows = {}
    faces = tuple(
        tuple(tuple(rows.setdefault(tuple(np.round(v, 4)), len(rows)) for v in ring) for ring in surface)
        for surface in shell.surfaces
    )
    kinds = ("RoofSurface",) * len(shell.roofs) + ("WallSurface",) * len(shell.walls) + ("GroundSurface",)
    return Solid(np.array(list(rows)) + shift, faces, kinds)


def placed(shape, rotation_deg=27.0):
    return solid_of(shape.placed(*PLACE, rotation_deg))


@pytest.mark.parametrize(
    ("shape", "corners", "edges", "ridges"),
    [
        (shapes.flat(), 4, 4, 0),
        (shapes.shed(), 4, 4, 0),
        (shapes.gable(), 6, 7, 1),
        (shapes.hip(), 6, 9, 1),
        (shapes.pyramid(), 5, 8, 0),
        (shapes.l_shape(), 11, 14, 2),
        (shapes.half_hip(), 10, 13, 1),
        (shapes.double_gable(), 10, 13, 2),
        (shapes.courtyard(), 8, 8, 0),
    ],
)
def test_a_wireframe_has_the_corners_and_lines_that_are_seen(shape, corners, edges, ridges):
    frame = models.roof_wireframe([placed(shape)])
    assert (len(frame.corners), len(frame.edges), int(frame.is_ridge.sum())) == (corners, edges, ridges)


def test_faces_that_one_plane_is_cut_into_make_no_lines():
    whole = extrude(Outline(np.array([(0.0, 0), (8, 0), (8, 6), (0, 6)])), 0, 5)
    # Both the roof and two walls are cut in the middle.
    plan = np.array([(0, 0), (4, 0), (8, 0), (8, 6), (4, 6), (0, 6)], dtype=float)
    cut = extrude(Outline(plan), 0, 5)
    left, right = (6, 7, 10, 11), (7, 8, 9, 10)
    faces = tuple(
        new
        for face, kind in zip(cut.faces, cut.semantics, strict=True)
        for new in (((left,), (right,)) if kind == ROOF_SURFACE else (face,))
    )
    kinds = (cut.semantics[0], ROOF_SURFACE, *cut.semantics[1:])
    pieces = Solid(cut.vertices, faces, kinds)
    assert len(models.roof_wireframe([pieces]).edges) == len(models.roof_wireframe([whole]).edges) == 4
    assert models.n_corners(pieces) == models.n_corners(whole) == 8


def test_corners_are_matched_so_that_most_find_a_partner():
    # The nearest pair first would leave one without.
    mine, theirs = np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.array([[0.9, 0, 0], [1.8, 0, 0]])
    rows, partners, distance = match_corners(mine, theirs, 1.0)
    assert dict(zip(rows.tolist(), partners.tolist(), strict=True)) == {0: 0, 1: 1}
    assert distance.sum() == pytest.approx(1.7)


def test_a_model_agrees_with_itself():
    sides = [[placed(shapes.hip())], [solid_of(shapes.church().placed(84_060, 447_000))]]
    score = models.score_models(sides, sides)
    assert (score["n_matched"], score["height_rmse"], score["height_covered"]) == (2, 0.0, 1.0)
    assert (score["roof_corner_f1"], score["roof_edge_f1"], score["roof_corner_offset"]) == (1, 1, 0)
    assert (score["roof_edge_length_precision"], score["roof_edge_length_recall"]) == (1.0, 1.0)
    assert (score["ridge_recall"], score["ridge_largest"]) == (1.0, 0.0)
    assert np.allclose(score["volume_ratio"], 1.0)


def test_a_roof_that_is_too_high_and_moved_is_told_by_how_much():
    truth = shapes.gable(14, 9, 5.0, 40.0)
    mine = [[solid_of(truth.placed(*PLACE, 27.0), shift=(0.0, 0.0, 0.2))]]
    score = models.score_models(mine, [[placed(truth)]])
    assert score["height_bias"] == pytest.approx(0.2, abs=1e-3)
    assert score["height_rmse"] == pytest.approx(0.2, abs=1e-3)
    assert (score["ridge_recall"], score["ridge_largest"]) == (1.0, pytest.approx(0.2, abs=1e-3))
    assert score["roof_corner_offset"] == pytest.approx(0.2, abs=1e-3)
    assert models.score_models(mine, [[placed(truth)]], tolerance=0.1)["roof_n_corners_matched"] == 0


def test_a_box_in_place_of_a_gable_lacks_its_ridge():
    truth = shapes.gable(14, 9, 5.0, 40.0)
    box = shapes.flat(14, 9, 7.0)
    score = models.score_models([[placed(box)]], [[placed(truth)]])
    assert score["ridge_recall"] == 0.0
    # Eaves and verges lie elsewhere, too: the box is 2 m higher at the eaves.
    assert score["roof_n_corners_matched"] == 0
    mean_height = 5.0 + 4.5 * np.tan(np.deg2rad(40)) / 2
    assert score["volume_ratio"] == pytest.approx(7.0 / mean_height, rel=1e-3)


def test_blocks_may_be_divided_otherwise_than_in_the_reference():
    row = [[solid_of(shapes.gable(8, 10).placed(x, 0))] for x in (0.0, 8.0)]
    block = [[solid_of(shapes.gable(16, 10).placed(4.0, 0))]]
    score = models.score_models(block, row)
    assert (score["height_covered"], score["height_rmse"]) == (1.0, pytest.approx(0.0, abs=1e-6))
    assert score["roof_corner_precision"] == 1.0


def test_only_what_lies_in_the_area_counts():
    sides = [[solid_of(shapes.flat().placed(x, 0))] for x in (0.0, 50.0)]
    score = models.score_models(sides[:1], sides, area=[shapely.box(-20, -20, 20, 20)])
    assert (score["n_models_result"], score["n_models_reference"], score["height_covered"]) == (1, 1, 1.0)
    assert score["roof_corner_recall"] == 1.0


def test_ridges_are_compared_with_those_beside_them_of_their_direction():
    ridge = np.array([[[0.0, 0, 8], [10, 0, 8]]])
    crossing, beside = np.array([[[5.0, -5, 8], [5, 5, 8]]]), np.array([[[1.0, 0.3, 8.5], [9, 0.3, 8.5]]])
    assert np.isnan(models.ridge_errors(crossing, ridge, 1.0)).all()
    assert models.ridge_errors(np.vstack([crossing, beside]), ridge, 1.0) == pytest.approx([0.5])
    assert np.isnan(models.ridge_errors(beside, ridge, 0.2)).all()


def test_points_are_measured_against_the_roof_at_their_place():
    houses = [[placed(shapes.gable())], [solid_of(shapes.flat(10, 10, 6.0).placed(84_050, 447_000))]]
    random = np.random.default_rng(0)
    xy = PLACE + random.uniform(-3, 3, (500, 2))
    on = np.column_stack(
        [xy, models.roof_elevations([solid for parts in houses for solid in parts], xy) + 0.15]
    )
    over = np.column_stack([84_050 + random.uniform(-4, 4, (300, 2)) * (1, 0), np.full(300, 6.0)])
    over[:, 1] = 447_000
    beside = np.array([[84_000.0, 447_100.0, 5.0]] * 200)
    score = models.score_model_points(houses, np.vstack([on, over, beside]))
    assert (score["n_points"], score["uncovered"]) == (1000, 0.2)
    assert score["rmse"] == pytest.approx(0.15 * np.sqrt(5 / 8), abs=1e-4)
    assert (score["within_10_cm"], score["within_20_cm"]) == pytest.approx((300 / 800, 1.0))
    assert score["median"] == pytest.approx(0.15, abs=1e-4)


def test_nothing_is_a_legal_side():
    house = [[placed(shapes.flat())]]
    for sides in (([], house), (house, []), ([], []), ([[]], [[]])):
        score = models.score_models(*sides)
        assert score["n_matched"] == 0
        assert np.isnan(score["height_rmse"])
        assert score["roof_n_corners_matched"] == 0
    assert models.score_model_points([], np.zeros((5, 3)))["uncovered"] == 1.0
    assert np.isnan(models.score_model_points(house, np.zeros((0, 3)))["median"])
    assert models.footprints([[]])[0].is_empty


def test_words_of_roofs_are_understood_across_vocabularies():
    assert models.same_roof_type("half-hip", {"roof_type": "half_hip"})
    assert models.same_roof_type("L", {"roof_type": "l_shape", "n_planes": 4})
    assert models.same_roof_type("flat", {"roof_type": "l_shape", "n_planes": 1})
    assert models.same_roof_type("complex", {"roof_type": "church"})
    assert models.same_roof_type("gable", {"roof_type": "dormer", "n_planes": 3})
    assert not models.same_roof_type("gable", {"roof_type": "hip"})
    assert not models.same_roof_type("flat", {"roof_type": "shed", "n_planes": 1})

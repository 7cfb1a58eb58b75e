"""Lines of roofs, told from solids."""

from collections import Counter

import numpy as np
import pytest
from support import model_survey

from lidar_buildings.core.solids.plan_graph import RoofPiece
from lidar_buildings.core.solids.raising import roof_solid
from lidar_buildings.core.solids.roof_lines import corner_kinds, roof_lines


def finest(made):
    return made()[1].solids["2.2"]


def lengths(solid):
    """Kind → length of its lines [m]."""
    found = Counter()
    for line in roof_lines(solid):
        found[line.kind] += np.linalg.norm(line.ends[1] - line.ends[0])
    return dict(found)


def test_a_gable_has_a_ridge_two_eaves_and_four_verges():
    found = Counter(line.kind for line in roof_lines(finest(model_survey.gable)))
    assert found == {"ridge": 1, "eave": 2, "verge": 4}
    assert lengths(finest(model_survey.gable)) == pytest.approx({"ridge": 10, "eave": 20, "verge": 20})


def test_corners_are_named_after_the_line_that_ends_there():
    solid = finest(model_survey.gable)
    kinds = corner_kinds(solid, roof_lines(solid))
    assert Counter(kinds.values()) == {"ridge": 2, "eave": 4}
    assert {solid.vertices[row, 2] for row, kind in kinds.items() if kind == "ridge"} == {model_survey.RIDGE}
    solid = finest(model_survey.step)
    assert Counter(corner_kinds(solid, roof_lines(solid)).values()) == {"step": 2, "eave": 8}


def test_a_wall_that_ends_on_a_roof_and_beside_it_is_parted():
    found = lengths(finest(model_survey.step))
    assert found == pytest.approx({"eave": 40.0, "step": 4.0})
    low = RoofPiece((model_survey.rectangle(0, 0, 4, 5),), (0.0, 0.0, 4.0))
    high = RoofPiece((model_survey.rectangle(4, 0, 9, 12),), (0.0, 0.0, 9.0))
    found = lengths(roof_solid([low, high], 0.0))
    assert found == pytest.approx({"eave": 4 + 5 + 4 + 5 + 12 + 5 + 7, "step": 5})


def test_a_hipped_roof_and_one_turned_inside_out():
    square = model_survey.rectangle(-4, -4, 4, 4)
    for slope, kind in ((0.5, "hip"), (-0.5, "valley")):
        pieces = [
            RoofPiece(
                (np.array([square[k], square[(k + 1) % 4], (0.0, 0.0)]),), (-slope * x, -slope * y, 9.0)
            )
            for k, (x, y) in enumerate([(0, -1), (1, 0), (0, 1), (-1, 0)])
        ]
        found = lengths(roof_solid(pieces, 0.0))
        assert found == pytest.approx({kind: 4 * np.sqrt(16 + 16 + 4), "eave": 32})


def test_faces_of_one_plane_have_no_line_between_them_and_pieces_are_one():
    plane = (0.5, 0.0, 4.0)
    parts = [(0, 0, 4, 6), (0, 6, 4, 9), (4, 0, 8, 9)]
    solid = roof_solid([RoofPiece((model_survey.rectangle(*part),), plane) for part in parts], 0.0)
    assert lengths(solid) == pytest.approx({"eave": 18, "verge": 2 * 8 * np.sqrt(1.25)})

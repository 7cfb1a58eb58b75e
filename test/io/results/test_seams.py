import numpy as np

from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.core.model.outline import BuildingOutline, Outline
from lidar_buildings.io.results.survey_buildings import SurveyBuildings, seam_pieces
from lidar_buildings.io.results.tile_products import Shapes


def building(number: int, x: float, y: float, width: float, height: float) -> BuildingOutline:
    corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]]
    return BuildingOutline(number, Outline(np.array(corners)))


WHOLE = building(1, 0, 0, 20, 10)


def test_a_piece_within_a_building_and_an_equal_one_are_found_whichever_tile_came_first():
    piece = building(2, 15, 2, 5, 5)
    assert seam_pieces([[WHOLE], [piece]]) == seam_pieces([[piece], [WHOLE]]) == {2}
    twin = BuildingOutline(7, WHOLE.outline)
    assert seam_pieces([[WHOLE], [twin]]) == seam_pieces([[twin], [WHOLE]]) == {7}


def test_neighbours_that_overlap_little_or_are_of_one_tile_or_in_a_courtyard_are_no_pieces():
    assert seam_pieces([[WHOLE], [building(2, 18, 0, 10, 10)]]) == set()
    assert seam_pieces([[WHOLE, building(2, 5, 2, 5, 5)]]) == set()
    hole = np.array([[5.0, 2.0], [5.0, 8.0], [15.0, 8.0], [15.0, 2.0]])
    around = BuildingOutline(1, Outline(WHOLE.outline.exterior, (hole,)))
    assert seam_pieces([[around], [building(2, 6, 3, 4, 4)]]) == set()
    assert seam_pieces([]) == seam_pieces([[], []]) == set()


def test_a_building_that_has_gone_over_to_another_tile_is_no_piece_of_itself():
    grown = building(1, 0, 0, 25, 10)
    piece = building(2, 15, 2, 5, 5)
    assert seam_pieces([[WHOLE], [grown, piece]]) == {2}


def test_of_an_id_a_second_building_nearby_is_the_same_one_and_one_far_away_another(tmp_path):
    tiles = [building(7, x, 0, 20, 10) for x in (20_000.0, 20_001.0, -20_000.0)]
    with SurveyBuildings(tmp_path / "lines", MapFrame()) as survey:
        for one in tiles:
            survey.add(Shapes((), (one,), ()))
        kept = sorted(one.outline.exterior[0, 0] for one in survey)
    assert kept == [-20_000.0, 20_000.0]

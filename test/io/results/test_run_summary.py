"""A run without buildings says what its points are."""

import pytest

from lidar_buildings.io.results.run_summary import RunSummary


def summary(classes, n_facade, buildings=None, files=("buildings.gpkg",)):
    n_points = sum(classes.values())
    return RunSummary(files, 1, n_points, 0, classes, buildings or {}, 0, {}, (), n_facade=n_facade)


@pytest.mark.parametrize(
    ("classes", "n_facade", "told"),
    [
        ({2: 60, 5: 40}, 0, "60 % ground, 40 % vegetation or low walls, no roof seen: "),
        ({2: 60, 5: 10, 6: 30}, 30, "60 % ground, 10 % vegetation or low walls, 30 % walls, no roof seen: "),
        ({2: 60, 6: 40}, 30, "60 % ground, 30 % walls, 10 % roof, too little of it: "),
        ({2: 60, 1: 40}, 0, "60 % ground, 40 % other, no roof seen: "),
    ],
)
def test_without_buildings_the_kinds_of_points_are_told(classes, n_facade, told):
    assert told in summary(classes, n_facade).why_no_building


def test_nothing_is_told_where_there_are_buildings_or_none_were_wanted():
    assert not summary({6: 9}, 0, {"ok": 1}).why_no_building
    assert not summary({6: 9}, 0, files=()).why_no_building

"""A run without buildings says what its points are."""

from lidar_buildings.io.results.run_summary import RunSummary


def summary(classes, n_facade, buildings=None, files=("buildings.gpkg",)):
    n_points = sum(classes.values())
    return RunSummary(files, 1, n_points, 0, classes, buildings or {}, 0, {}, (), n_facade=n_facade)


def test_without_buildings_points_of_roofs_and_walls_are_counted():
    assert "of 100 points 10 are roof, too few for one, and 30 are walls" in (
        summary({2: 60, 6: 40}, 30).why_no_building
    )


def test_nothing_is_told_where_there_are_buildings_or_none_were_wanted():
    assert not summary({6: 9}, 0, {"ok": 1}).why_no_building
    assert not summary({6: 9}, 0, files=()).why_no_building

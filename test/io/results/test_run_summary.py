"""A run without buildings says what its points are."""

from dataclasses import replace

from lidar_buildings.io.results.run_summary import (
    BuildingCounts,
    RunSummary,
    unlikely_building,
    unlikely_shares,
)


def summary(classes, n_facade, buildings=None, files=("buildings.gpkg",)):
    n_points = sum(classes.values())
    return RunSummary(files, 1, n_points, 0, classes, buildings or {}, 0, {}, (), n_facade=n_facade)


def test_without_buildings_points_of_roofs_and_walls_are_counted():
    assert "of 100 points 10 are roof, too few for one, and 30 are walls" in (
        summary({2: 60, 6: 40}, 30).why_no_building
    )


def test_walls_seen_from_the_street_are_counted_and_where_they_alone_are_said():
    told = replace(summary({2: 60, 6: 40}, 30), facade_count=62, facade_length=1258.6)
    assert "layers facades and street_lines hold them" in told.why_no_building
    assert told.building_words[-1] == "facades: 62 (1,259 m of walls seen from the street)"


def test_nothing_is_told_where_there_are_buildings_or_none_were_wanted():
    assert not summary({6: 9}, 0, {"ok": 1}).why_no_building
    assert not summary({6: 9}, 0, files=()).why_no_building


def test_buildings_are_counted_by_quality_and_reason_and_failures_named():
    counts = BuildingCounts()
    for status, quality, reasons in (
        ("ok", "good", ""),
        ("ok", "check", "no_points: 8 %; off_points: 9 %"),
        ("no_solid", "poor", "no_model: none"),
        ("ok", "check", "no_points: 7 %"),
    ):
        counts.count({"status": status, "quality": quality, "quality_reasons": reasons})
    told = replace(summary({6: 9}, 0, counts.statuses), quality=counts.grades, quality_reasons=counts.causes)
    assert told.n_doubtful == 3
    assert told.building_words == [
        "buildings: 4 (1 good, 2 check, 1 poor)",
        "quality_reasons: 2 no_points, 1 no_model, 1 off_points",
        "status: 1 no_solid",
    ]


def test_shares_that_no_survey_has_are_told():
    assert unlikely_shares({2: 600, 5: 100, 6: 300}) == []
    assert unlikely_shares({2: 1, 6: 99}) == []
    codes = [one.code for one in unlikely_shares({1: 10, 2: 20, 6: 970, 7: 5000})]
    assert codes == ["much_building", "little_ground"]
    assert [one.code for one in unlikely_shares({1: 400, 11: 600})] == ["much_unexplained"]


def test_a_building_of_half_the_survey_is_told():
    assert unlikely_building("a", 499, 1000) == []
    (remark,) = unlikely_building("b-1-2", 970, 1000)
    assert remark.text.startswith("building b-1-2 has 97% of all points")

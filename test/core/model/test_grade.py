"""A grade is that of the worst doubt; the attribute's text gives the codes back."""

import pytest

from lidar_buildings.core.model.grade import Cause, Doubt, Grade, causes_in, grade_attributes

LOOK, WRONG = Doubt(Cause.NO_POINTS, "12 % of it: none"), Doubt(Cause.NO_MODEL, "no roof points", Grade.POOR)


@pytest.mark.parametrize(
    ("doubts", "grade"), [([], "good"), ([LOOK], "check"), ([LOOK, WRONG], "poor"), ([WRONG], "poor")]
)
def test_the_worst_doubt_grades_a_building_and_all_are_told(doubts, grade):
    attributes = grade_attributes(doubts)
    assert attributes["quality"] == grade
    assert causes_in(attributes["quality_reasons"]) == [doubt.cause.value for doubt in doubts]

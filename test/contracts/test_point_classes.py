"""The classes that a run writes, from file to file."""

import laspy
import numpy as np
import pytest

from lidar_buildings.cli import main
from lidar_buildings.simulation import make_scene, simulate_survey

ROAD, GROUND = 11, 2
RUN = ("--no-ros", "--until", "roof_selection")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey")
    simulate_survey(folder, "village", density=2.0)
    return folder


def classified(survey, output, *settings):
    """Run to the classes and return (input, output) of every strip."""
    assert main(["run", str(survey), "--output", str(output), *RUN, *settings]) == 0
    paths = sorted(survey.glob("*.laz"))
    return [(laspy.read(path), laspy.read(output / "classified" / path.name)) for path in paths]


def roads_of(las):
    """Tell which points lie on the village's roads in plan, and which within 2 m of their sides."""
    scene = make_scene("village", 0)
    place = np.column_stack([las.x, las.y]) - np.asarray(scene.frame.origin[:2])
    inside, near = (np.zeros(len(place), dtype=bool) for _ in range(2))
    for road in scene.roads:
        along = np.subtract(road.end, road.start) / np.hypot(*np.subtract(road.end, road.start))
        aside = np.abs((place - road.start) @ [along[1], -along[0]])
        inside |= aside <= road.width / 2
        near |= np.abs(aside - road.width / 2) < 2
    return inside, near


def test_the_villages_roads_are_found_without_any_number(survey, tmp_path):
    for before, after in classified(survey, tmp_path / "out"):
        on_road, at_side = roads_of(before)
        ground = np.isin(after.classification, (GROUND, ROAD)) & ~at_side
        found = np.asarray(after.classification == ROAD)
        assert found[ground & on_road].mean() > 0.95
        assert found[ground & ~on_road].mean() < 0.01


@pytest.fixture(scope="module")
def survey_with_classes(survey, tmp_path_factory):
    """The same survey with a lake, a bridge, a class of the user's own, and withheld points."""
    folder = tmp_path_factory.mktemp("classes")
    for path in survey.glob("*.laz"):
        las = laspy.read(path)
        x, y = las.x - las.header.mins[0], las.y - las.header.mins[1]
        classes = np.asarray(las.classification).copy()
        classes[(x < 60) & (y < 60) & (np.asarray(las.TrueClass) == GROUND)] = 9
        classes[(x > 200) & (y < 60)] = 17
        classes[(x > 200) & (y > 200)] = 70
        las.classification = classes
        las.withheld = np.arange(len(las)) % 50 == 0
        las.overlap = np.arange(len(las)) % 3 == 0
        las.write(folder / path.name)
    return folder


@pytest.fixture(scope="module")
def kept_classes(survey_with_classes, tmp_path_factory):
    return classified(survey_with_classes, tmp_path_factory.mktemp("kept") / "out")


def test_water_and_bridges_come_out_as_they_went_in_and_vendors_classes_are_found_anew(kept_classes):
    n_kept = 0
    for before, after in kept_classes:
        withheld = np.asarray(before.withheld) == 1
        kept = np.isin(before.classification, (9, 17)) | (withheld & (before.classification == 70))
        np.testing.assert_array_equal(after.classification[kept], before.classification[kept])
        assert not np.isin(after.classification[~kept], (9, 17, 70)).any()
        n_kept += kept.sum()
        lake = np.asarray(before.classification == 9) & (np.asarray(before.withheld) == 0)
        assert np.abs(np.asarray(after.HeightAboveGround)[lake]).mean() < 0.2
    assert n_kept > 1000


def test_withheld_points_keep_their_class_and_flags_are_kept(kept_classes):
    for before, after in kept_classes:
        withheld = np.asarray(before.withheld) == 1
        np.testing.assert_array_equal(after.classification[withheld], before.classification[withheld])
        np.testing.assert_array_equal(after.withheld, before.withheld)
        np.testing.assert_array_equal(after.overlap, before.overlap)
        # The flag of overlap is no class: these points are classified as any other.
        overlap = (np.asarray(before.overlap) == 1) & (np.asarray(before.classification) == 1) & ~withheld
        assert (after.classification[overlap] != 1).mean() > 0.8


def test_classes_that_are_not_to_be_kept_are_found_anew_and_roads_can_be_left_out(
    survey_with_classes, tmp_path
):
    settings = ("--set", "ground_filter.kept_classes=[noise]", "--set", "roof_selection.road_method=none")
    for before, after in classified(survey_with_classes, tmp_path / "out", *settings):
        used = np.asarray(before.withheld) == 0
        assert not np.isin(after.classification[used], (9, 11, 17, 70)).any()
        lake = used & np.asarray(before.classification == 9)
        assert (after.classification[lake] == GROUND).mean() > 0.95

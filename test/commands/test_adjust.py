"""What `lidar-buildings adjust` prints, and the copies that it writes."""

import json

import laspy
import numpy as np
import pytest
from support import cloud_files

LIFT = 0.13


@pytest.fixture
def strips(tmp_path):
    """Two strips over the same level ground, the second one lifted; every fiftieth point is weak."""
    folder = tmp_path / "strips"
    folder.mkdir()
    for number in (4, 5):
        cloud = cloud_files.random_cloud(3000, point_format=6, size=(40.0, 40.0, 0.0), seed=number)
        cloud.z = cloud.z + LIFT * (number == 5)
        cloud.point_source_id, cloud.withheld = np.full(3000, number), np.zeros(3000, np.uint8)
        cloud.classification = np.ones(3000, np.uint8)
        cloud.return_number, cloud.number_of_returns = np.ones((2, 3000), np.uint8)
        cloud.intensity = np.where(np.arange(3000) % 50 == 0, 10, np.arange(3000) + 20_000)
        cloud_files.saved(cloud, folder / f"strip_{number}.laz")
    return folder


def test_residuals_are_printed_and_nothing_is_written(strips, command):
    spoken = command("adjust", strips)
    assert (spoken.status, spoken.err) == (0, [])
    assert spoken.out[0] == "strips: 2, pairs that overlap: 1"
    assert spoken.out[1].startswith("pair 4 5: height 0.130 → 0.000 m; ")
    assert spoken.out[2].startswith("strip 4: +0.000 +0.000 +0.065 m (plan not told, ± ")
    assert [one.name for one in strips.parent.iterdir()] == ["strips"]


def test_overlaps_that_contradict_one_another_are_named(command, tmp_path):
    for place, pair in enumerate([(4, 5), (5, 6), (4, 6)]):  # 5 stands above 4, but both are level with 6
        for number in pair:
            cloud = cloud_files.random_cloud(3000, point_format=6, size=(40.0, 40.0, 0.0), seed=number)
            cloud.x, cloud.z = cloud.x + 60.0 * place, cloud.z + LIFT * ((place, number) == (0, 5))
            cloud.point_source_id, cloud.withheld = np.full(3000, number), np.zeros(3000, np.uint8)
            cloud.classification = np.ones(3000, np.uint8)
            cloud_files.saved(cloud, tmp_path / f"{place}_{number}.laz")
    (line,) = [line for line in command("adjust", tmp_path).out if line.startswith("farther apart")]
    assert line.startswith("farther apart than before: 4 6, 5 6: overlaps contradict one another")


def test_copies_are_shifted_and_keep_all_else(strips, command, tmp_path):
    spoken = command("adjust", strips, "--output", tmp_path / "out", "--min-intensity", 1)
    assert (spoken.status, spoken.err) == (0, [])
    for number, shift in ((4, LIFT / 2), (5, -LIFT / 2)):
        given, written = (laspy.read(one / f"strip_{number}.laz") for one in (strips, tmp_path / "out"))
        np.testing.assert_allclose(written.z - given.z, shift, atol=0.01)
        np.testing.assert_array_equal(np.asarray(written.withheld) == 1, np.arange(3000) % 50 == 0)
        for name in ("X", "Y", "intensity", "gps_time", "scan_angle", "user_data", "classification"):
            np.testing.assert_array_equal(written[name], given[name])
    told = json.loads((tmp_path / "out" / "adjustment.json").read_text())
    assert told["weak_points"] == 120
    assert told["pairs"][0]["before"]["height"] == pytest.approx(LIFT, abs=0.001)
    assert told["pairs"][0]["after"]["height"] == pytest.approx(0.0, abs=0.001)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--min-intensity", 5), "needs --output"),
        (("--output", "strips"), "exists: give another folder"),
        (("--min-intensity", 300, "--output", "new"), "must be within 0 to 255"),
    ],
)
def test_wrong_use_is_one_line(strips, command, tmp_path, options, why):
    given = [tmp_path / one if one in ("strips", "new") else one for one in options]
    spoken = command("adjust", strips, *given)
    assert spoken.status == 2
    assert len(spoken.err) == 1
    assert why in spoken.err[0]


def test_one_strip_has_nothing_to_be_adjusted_to(strips, command):
    spoken = command("adjust", strips / "strip_4.laz")
    assert spoken.status == 2
    assert "all points are of one strip" in spoken.err[0]

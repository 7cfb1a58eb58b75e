"""What the points of a cloud say that can hardly be so, one remark each."""

import laspy
import numpy as np
import pytest

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.model.map_frame import MapFrame
from lidar_buildings.io.clouds.doubts import CloudDoubts, sampled_remarks
from lidar_buildings.io.clouds.las import open_cloud


def survey(n=4000, height=20.0):
    """Points of rolling ground, metres."""
    random = np.random.default_rng(0)
    x, y = random.uniform(0.0, 200.0, (2, n))
    z = height * np.sin(x / 60.0) * np.cos(y / 50.0) + random.normal(0.0, 0.02, n)
    return np.column_stack([x, y, z])


def written(path, xyz, scale=0.001, offset=0.0, **columns):
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, scale), np.full(3, offset)
    cloud = laspy.LasData(header)
    cloud.xyz = xyz
    n = len(xyz)
    told = {
        "gps_time": np.arange(n) * 1e-4,
        "return_number": np.arange(n) % 2 + 1,
        "number_of_returns": np.full(n, 2),
        "point_source_id": np.full(n, 7),
    }
    for name, values in (told | columns).items():
        cloud[name] = values
    cloud.write(path)
    return path


def told(path):
    return [one.code for one in sampled_remarks(open_cloud(path), 10_000)]


def test_of_a_plain_survey_nothing_is_told(tmp_path):
    assert told(written(tmp_path / "a.las", survey())) == []


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda p: np.round(p), "coarse_steps"),
        (lambda p: p[:, :1] * [1.0, 2.0, 0.5], "flat"),
        (lambda p: p * [1.0, 0.0, 1.0], "flat"),
        (lambda p: np.column_stack([p[:, :2], p[:, 0] * 0.25 + 3.0]), "flat"),
        (lambda p: p[:, [0, 2, 1]], "axis_up"),
        (lambda p: np.add(p, [0, 0, 11_000]), "odd_elevations"),
        (lambda p: np.vstack([p, [[50.0, 50.0, 900.0]] * 9]), "aloft"),
        (lambda p: p + np.where(p[:, :1] > 150.0, 800.0, 0.0) * [0, 0, 1], "aloft"),
        (
            lambda p: np.where((np.arange(len(p)) % 9 == 0)[:, None], p * [1, 1, 0] - [0, 0, 9999], p),
            "far_below",
        ),
        (lambda p: np.vstack([p[:-1], [[2147483.647, 0, 0]]]), "integer_limit"),
        (lambda p: np.vstack([p[:-1], [[-2147483.647, 0, 0]]]), "integer_limit"),
        (lambda p: np.maximum(p, [60.0, 0.0, -99.0]), "cut_off"),
        (lambda p: np.vstack([np.round(p, 0), p[:9]]), "coarse_steps"),
    ],
)
def test_coordinates_that_cannot_be_are_told(tmp_path, change, code):
    assert code in told(written(tmp_path / "a.las", change(survey())))


def test_times_returns_and_strips_that_the_places_contradict_are_told(tmp_path):
    p = survey()
    p = p[np.argsort(np.floor(p[:, 0]) * 1000.0 + p[:, 1])]  # line by line
    n, times = len(p), np.arange(len(p)) * 1e-4
    first = np.arange(n) % 2 == 0
    below = p - first[:, None] * [0, 0, 5.0]
    mixed = np.random.default_rng(1).permutation(times)
    cases = [
        (p, {"gps_time": times}, []),
        (p, {"gps_time": mixed}, ["times_say_nothing"]),
        (p, {"gps_time": np.where(first, np.nan, times)}, ["times_say_nothing"]),
        (p, {"gps_time": times + 300.0 * (np.arange(n) > n // 2)}, ["strips_say_nothing"]),
        (below, {}, ["returns_contradict"]),
        (
            p,
            {"return_number": np.where(first, 2, 3), "number_of_returns": np.full(n, 3)},
            ["returns_say_nothing"],
        ),
    ]
    for k, (points, columns, codes) in enumerate(cases):
        assert told(written(tmp_path / f"{k}.las", points, **columns)) == codes, columns


@pytest.mark.parametrize(
    ("column", "value", "code"),
    [
        ("gps_time", 0, "times_say_nothing"),
        ("gps_time", 5, "times_say_nothing"),
        ("return_number", 0, "returns_say_nothing"),
        ("return_number", 1, "returns_say_nothing"),
        ("return_number", 3, "returns_contradict"),
        ("point_source_id", 0, "strips_say_nothing"),
        ("intensity", 77, "intensities_say_nothing"),
    ],
)
def test_columns_that_say_nothing_are_told(tmp_path, column, value, code):
    points = survey()
    assert told(written(tmp_path / "a.las", points, **{column: np.full(len(points), value)})) == [code]


def test_a_coordinate_at_the_limit_of_the_integers_at_all_points_is_refused_in_one_line(tmp_path):
    path = written(tmp_path / "a.las", survey() * [1, 0, 1] + [0, -2147483.648, 0])
    with open(path, "r+b") as file:  # bounds as they were meant
        file.seek(195)
        file.write(np.array([5.5e6, 5.4e6]).tobytes())
    with pytest.raises(InputError, match="y is the same at all points, the limit of the file's integers: "):
        open_cloud(path)


def test_points_that_the_frame_cannot_hold_are_told_apart(tmp_path):
    cloud = open_cloud(written(tmp_path / "a.las", np.vstack([survey(), [[1.5e6, 0, 0]]])))
    doubts = CloudDoubts(cloud, MapFrame())
    (beyond,) = [doubts.add(chunk) for chunk in cloud.chunks()]
    assert np.flatnonzero(beyond).tolist() == [4000]
    assert "beyond_limits" in [one.code for one in doubts.remarks()]

"""The benchmarks, on clouds small enough for a test; nothing here looks at how fast anything was."""

import re

import numpy as np
import pytest
from support.cli_runs import lines_of
from support.lawn import write_las
from support.source_tree import ROOT

from bench.common import arguments, clouds
from bench.ground import isprs, providers
from bench.ground import scenes as terrain_bench
from bench.ground import scores as agreement
from bench.ground.methods import METHODS, ground_mask
from bench.papers import cube
from bench.scenes.terrain_site import TerrainSite

METHOD = METHODS[0]


def small_scene(seed=0):
    """A house of 10 × 8 m on level ground of 40 × 30 m."""
    site = TerrainSite(40, 30, 2.0, seed)
    site.house(20, 15, 10, 8, 5, 7)
    scene = site.scanned(0.02, 0.0)
    time = {"gps_time": np.linspace(1000.0, 1005.0, len(scene.points))}
    return clouds.Cloud(scene.points, time, scene.is_ground)


def write_scene(path, cloud, corner=(500.0, 700.0)):
    """Write a scene with its truth as classes 2 and 1."""
    write_las(path, cloud.points, np.where(cloud.is_ground, 2, 1), corner, gps_time=cloud.scan["gps_time"])


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A data folder with two samples, and fusa's folder in two files."""
    folder = tmp_path_factory.mktemp("data")
    write_scene(folder / "isprs" / "samp01.laz", small_scene(1))
    write_scene(folder / "isprs" / "samp02.laz", small_scene(2))
    write_scene(folder / "isprs" / "CSite.laz", small_scene(3))
    write_scene(folder / "fusa" / "west.laz", small_scene(4))
    write_scene(folder / "fusa" / "east.laz", small_scene(5), (540.0, 700.0))
    write_scene(folder / "delft" / "one.laz", small_scene(6))
    return folder


def test_files_are_read_as_one_cloud_near_the_map_s_origin_with_time_and_truth(data):
    cloud = clouds.read_cloud(sorted((data / "fusa").glob("*.laz")))
    parts = [small_scene(seed) for seed in (5, 4)]
    assert len(cloud.points) == sum(len(part.points) for part in parts)
    np.testing.assert_array_equal(cloud.is_ground, np.concatenate([part.is_ground for part in parts]))
    assert cloud.points[:, :2].min() >= 0
    assert np.ptp(cloud.points[:, 0]) == pytest.approx(80, abs=1)
    times = np.concatenate([part.scan["gps_time"] for part in parts])
    np.testing.assert_array_equal(cloud.scan["gps_time"], times)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_of_the_package_is_scored(method):
    score = agreement.score_of(small_scene(), method)
    assert score.total_error < 0.1
    assert score.total == len(small_scene().points)


def test_a_folder_without_samples_is_refused_in_one_line(tmp_path):
    with pytest.raises(SystemExit, match=re.escape("holds no sampNN.laz")):
        isprs.main(["--data", str(tmp_path), "--methods", METHOD])


def test_every_sample_there_is_is_scored_and_the_mean(data, capsys):
    isprs.main(["--data", str(data), "--methods", METHOD, "--offsets", "1"])
    default, places = capsys.readouterr().out.split("Total error at 1 places")
    assert [words[1] for words in lines_of(default, METHOD)] == ["samp01", "samp02", "mean", "worst:"]
    totals = [float(words[2]) for words in lines_of(default, METHOD)[:3]]
    assert totals[2] == pytest.approx((totals[0] + totals[1]) / 2, abs=0.01)
    for words in lines_of(places, METHOD):
        least, mean, worst = map(float, words[2:])
        assert least <= mean <= worst


def test_providers_are_compared_in_three_tables_and_drawn_outside_the_repository(data, tmp_path, capsys):
    folder = tmp_path / "pictures"
    providers.main(["--data", str(data), "--methods", METHOD, "--pictures", str(folder)])
    rows = lines_of(capsys.readouterr().out, METHOD)
    assert [words[1] for words in rows] == ["delft", "fusa"] * 3
    assert all(float(words[2]) > 90 for words in rows)
    drawn = sorted(folder.glob("*.png"))
    assert [path.name for path in drawn] == [f"delft_{METHOD}.png", f"fusa_{METHOD}.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)
    with pytest.raises(SystemExit, match="inside the repository"):
        arguments.picture_folder(ROOT / "bench" / "pictures")


def test_cells_where_the_provider_thinned_its_ground_do_not_count():
    cloud = small_scene()
    thinned = cloud.is_ground & ((cloud.points[:, 0] < 20) | (np.arange(len(cloud.points)) % 3 == 0))
    sparse = cloud._replace(is_ground=thinned)
    near = providers.near_reference(sparse)
    assert near[cloud.is_ground].mean() > 0.99
    assert near[~cloud.is_ground].mean() < 0.05
    rows = providers.dense_rows(sparse, near)
    bare = abs(cloud.points[:, 1] - 15) > 10
    assert rows[bare & (cloud.points[:, 0] < 20)].all()
    assert not rows[bare & (cloud.points[:, 0] > 20)].any()


def test_scenes_are_those_of_the_tests_and_their_worst_is_named(capsys):
    names = ["large_hall", "lake_gap"]
    terrain_bench.main(["--methods", METHOD, "--density", "0.1", "--scenes", *names])
    rows = lines_of(capsys.readouterr().out, METHOD)
    assert [words[1] for words in rows] == [*names, "mean", "worst:"]
    assert rows[3][2] in names


def test_parameters_given_are_used_and_unknown_ones_refused():
    assert arguments.settings_of(["ground_distance=0.5"]) == {"ground_distance": 0.5}
    assert arguments.settings_of(["seed_cell=30", "kept_classes=[water, noise]"]) == {
        "seed_cell": 30.0,
        "kept_classes": ("water", "noise"),
    }
    with pytest.raises(SystemExit, match="ground_distance"):
        arguments.settings_of(["ground_distance=wide"])
    with pytest.raises(SystemExit, match="there is no parameter"):
        arguments.settings_of(["distance=0.5"])
    tolerant = {"ground_distance": 5.0, "iteration_distance": 20.0}
    masks = [ground_mask(small_scene(), METHOD, settings) for settings in (None, tolerant)]
    assert masks[1].sum() > masks[0].sum()


def test_a_cube_has_the_measures_of_table_1():
    points = cube.cube_points()
    ours = cube.rows_of(points, cube.cube_features(points))
    paper = np.array([measures for _, measures in cube.PUBLISHED.values()])
    assert np.abs(ours - paper)[:, :3].max() < 0.045  # two digits, and points that the paper does not place
    assert np.abs(ours - paper)[:, 3:].max() < 0.12
    assert (ours[:3, 3] > 0.45).all()
    assert (ours[3:, 3] < 0.06).all()

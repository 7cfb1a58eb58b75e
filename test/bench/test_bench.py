"""The benchmarks, on clouds small enough for a test; nothing here looks at how fast anything was."""

import json
import math
import os
import re
import subprocess
import sys

import laspy
import numpy as np
import pytest
from support.source_tree import ROOT

from bench.common import arguments, clouds, pictures, tables
from bench.ground import isprs, optimisation, providers
from bench.ground import peers as filters
from bench.ground import scenes as terrain_bench
from bench.ground import scores as agreement
from bench.ground import speed as ground
from bench.scenes.terrain_site import GROUND, TerrainSite
from lidar_buildings.core.stages.ground_filter import GroundFilterConfig

METHOD = filters.own_methods()[0]


def small_scene(seed=0):
    """A house of 10 × 8 m on level ground of 40 × 30 m."""
    site = TerrainSite(40, 30, 2.0, seed)
    site.house(20, 15, 10, 8, 5, 7)
    scene = site.scanned(0.02, 0.0)
    time = {"gps_time": np.linspace(1000.0, 1005.0, len(scene.points))}
    return clouds.Cloud(scene.points, time, scene.is_ground)


def write_las(path, cloud, offset=(500.0, 700.0)):
    """Write a scene with its truth as classes 2 and 1."""
    path.parent.mkdir(parents=True, exist_ok=True)
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.xyz = cloud.points + np.array([*offset, 0.0])
    las.classification = np.where(cloud.is_ground, 2, 1).astype(np.uint8)
    las.return_number[:] = las.number_of_returns[:] = 1
    las.gps_time = cloud.scan["gps_time"]
    las.write(path)


@pytest.fixture
def data(tmp_path):
    """A data folder with two samples, and fusa's folder in two files."""
    write_las(tmp_path / "isprs" / "samp01.laz", small_scene(1))
    write_las(tmp_path / "isprs" / "samp02.laz", small_scene(2))
    write_las(tmp_path / "isprs" / "CSite.laz", small_scene(3))
    write_las(tmp_path / "fusa" / "west.laz", small_scene(4))
    write_las(tmp_path / "fusa" / "east.laz", small_scene(5), (540.0, 700.0))
    write_las(tmp_path / "delft" / "one.laz", small_scene(6))
    return tmp_path


def lines_of(text, first):
    """The words of the lines that begin with a word."""
    return [line.split() for line in text.splitlines() if line.split()[:1] == [first]]


def test_files_are_read_as_one_cloud_near_the_map_s_origin_with_time_and_truth(data):
    cloud = clouds.read_cloud(sorted((data / "fusa").glob("*.laz")))
    parts = [small_scene(seed) for seed in (5, 4)]
    assert len(cloud.points) == sum(len(part.points) for part in parts)
    np.testing.assert_array_equal(cloud.is_ground, np.concatenate([part.is_ground for part in parts]))
    assert cloud.points[:, :2].min() >= 0
    assert np.ptp(cloud.points[:, 0]) == pytest.approx(80, abs=1)
    times = np.concatenate([part.scan["gps_time"] for part in parts])
    np.testing.assert_array_equal(cloud.scan["gps_time"], times)


def test_copies_lie_side_by_side_and_follow_one_another_in_time():
    cloud = small_scene()
    copies = clouds.replicated(cloud, 2)
    n_points = len(cloud.points)
    assert len(copies.points) == len(copies.is_ground) == 4 * n_points
    shifts = [copies.points[k * n_points] - cloud.points[0] for k in range(4)]
    width, depth, _ = np.ptp(cloud.points, axis=0)
    np.testing.assert_allclose(
        shifts, [(0, 0, 0), (width, 0, 0), (0, depth, 0), (width, depth, 0)], atol=1e-9
    )
    assert (np.diff(copies.scan["gps_time"]) > 0).all()
    np.testing.assert_array_equal(copies.is_ground[n_points : 2 * n_points], cloud.is_ground)


def test_the_middle_of_a_cloud_keeps_its_rows_together():
    cloud = small_scene()
    middle = clouds.middle_of(cloud, 12.0)
    rows = np.flatnonzero((cloud.points[:, None] == middle.points[None, ::40]).all(axis=2).any(axis=1))
    np.testing.assert_array_equal(cloud.is_ground[rows], middle.is_ground[::40])
    assert np.ptp(middle.points[:, :2], axis=0).max() <= 12
    assert len(middle.scan["gps_time"]) == len(middle.points)


@pytest.mark.parametrize("method", filters.own_methods())
def test_every_method_of_the_package_is_scored(method):
    score = agreement.score_of(filters.own_filter(method), small_scene())
    assert score.total_error < 0.1
    assert score.n_points == len(small_scene().points)


@pytest.mark.parametrize("name", filters.PEERS)
def test_a_peer_finds_the_ground_of_a_simple_scene(name):
    cloud = small_scene()
    with filters.filters([name]) as chosen:
        if not chosen[name].installed:
            pytest.skip(f"{name} is not installed")
        mask = filters.ground_mask(chosen[name], cloud)
    assert mask.dtype == bool
    assert agreement.score_of_mask(mask, cloud.is_ground).total_error < 0.2


def test_a_peer_that_is_absent_is_left_out_and_named(monkeypatch, capsys):
    monkeypatch.setattr(filters.importlib.util, "find_spec", lambda package: None)
    assert filters.installed([METHOD, "csf"]) == [METHOD]
    assert "csf: not installed" in capsys.readouterr().err


def test_what_libraries_print_is_kept_off_the_output(capfd):
    with filters.quiet():
        os.write(1, b"noise")
    os.write(1, b"figures")
    assert capfd.readouterr().out == "figures"


#: Measures a run that needs 80 MB, in a process of its own: what another test has freed would be used again.
HUNGRY = """
import json
import sys
import numpy as np
from bench.ground import peers as filters
from bench.ground import measuring
from bench.common.clouds import Cloud
points = np.random.default_rng(0).uniform(0.0, 20.0, (2000, 3))
run = lambda cloud: np.ones(80_000_000, dtype=np.uint8)[: len(cloud.points)]
hungry = filters.GroundFilter(lambda cloud: cloud, run, lambda output, n: output.astype(bool), "numpy")
print(json.dumps(measuring.measure(hungry, Cloud(points, {}, np.ones(2000, dtype=bool)))))
"""


def test_peak_memory_above_the_input_is_that_of_the_run():
    done = subprocess.run(
        [sys.executable, "-c", HUNGRY], cwd=ROOT, capture_output=True, text=True, check=True, timeout=120
    )
    figures = json.loads(done.stdout)
    assert figures["bytes_above_input"] == pytest.approx(80_000_000, rel=0.15)
    assert figures["ground"] == figures["points"] == 2000
    assert figures["seconds"] > 0


def test_speed_is_measured_in_processes_of_their_own(capsys):
    cloud = small_scene()
    runs = ground.run_all(cloud, [METHOD], [1, 2], repeats=1)
    assert [len(records) for records in runs.values()] == [1, 1]
    assert runs[METHOD, 2][0]["points"] == 4 * len(cloud.points)
    text = tables.table(ground.HEADINGS, ground.rows_of(runs, [METHOD], [2, 1]))
    assert [words[1] for words in lines_of(text, METHOD)] == [str(k * len(cloud.points)) for k in (1, 4)]
    assert "round 1" in capsys.readouterr().err


def test_a_run_that_fails_says_why_in_the_table(tmp_path):
    record = ground.run_one(tmp_path / "absent.npz", METHOD, 1)
    assert "absent.npz" in record["failed"]
    assert "absent.npz" in ground.row_of({(METHOD, 1): [record]}, METHOD, 1, None)[2]


def test_ratio_and_growth_are_medians_over_rounds():
    def records(points, *seconds):
        return [{"points": points, "seconds": s, "cpu_seconds": s, "bytes_above_input": 5} for s in seconds]

    runs = {
        ("csf", 1): records(100, 1.0, 1.0, 4.0),
        ("mine", 1): records(100, 2.0, 2.0, 2.0),
        ("mine", 2): records(400, 16.0, 8.0, 16.0),
    }
    assert ground.speed_ratio(runs, "mine", 1) == 0.5
    assert math.isnan(ground.speed_ratio(runs, "mine", 2))
    assert ground.growth(runs, "mine", 2, 1) == pytest.approx(1.5)
    assert math.isnan(ground.growth(runs, "mine", 1, None))


def test_the_speed_of_delft_is_printed_with_absent_peers(data, monkeypatch, capsys):
    monkeypatch.setattr(ground, "installed", lambda names: [METHOD])
    ground.main(["--data", str(data), "--methods", METHOD, "csf", "--copies", "1", "--repeats", "1"])
    output = capsys.readouterr().out
    assert len(lines_of(output, METHOD)) == 1
    assert lines_of(output, "csf") == [["csf", "not", "installed"]]


def test_every_sample_there_is_is_scored_and_the_mean(data, capsys):
    isprs.main(["--data", str(data), "--methods", METHOD, "--offsets", "2"])
    default, places = capsys.readouterr().out.split("Total error at 2 places")
    assert [words[1] for words in lines_of(default, METHOD)] == ["samp01", "samp02", "mean", "worst:"]
    totals = [float(words[2]) for words in lines_of(default, METHOD)[:3]]
    assert totals[2] == pytest.approx((totals[0] + totals[1]) / 2, abs=0.01)
    for words in lines_of(places, METHOD):
        least, mean, worst = map(float, words[2:])
        assert least <= mean <= worst


def test_a_folder_without_samples_is_refused_in_one_line(tmp_path):
    with pytest.raises(SystemExit, match=re.escape("holds no sampNN.laz")):
        isprs.main(["--data", str(tmp_path), "--methods", METHOD])


def test_optimised_figures_are_those_of_the_best_settings(data, monkeypatch, capsys):
    monkeypatch.setattr(optimisation, "GRIDS", {METHOD: {"ground_distance": (0.1, 1.0)}})
    monkeypatch.setattr(isprs, "GRIDS", {METHOD: {}})
    isprs.main(["--data", str(data), "--methods", METHOD, "--optimise"])
    last = lines_of(capsys.readouterr().out.split("2 tried:")[1], METHOD)
    for words in last:
        default, optimised, single = map(float, words[2:5])
        assert optimised <= single <= default or words[1] != "mean"


def test_settings_are_chosen_per_cloud_for_all_and_on_the_others():
    errors = np.array([[1.0, 5.0, 5.0], [4.0, 2.0, 3.0], [9.0, 1.0, 1.0]])
    best = optimisation.optimum_of(errors)
    assert best.per_cloud.tolist() == [0, 2, 2]
    assert best.single == 1
    assert best.left_out.tolist() == [2, 0, 0]


@pytest.mark.parametrize("method", optimisation.GRIDS)
def test_the_settings_tried_are_allowed_and_begin_with_the_defaults(method):
    settings = optimisation.settings_grid(method)
    assert GroundFilterConfig(**settings[0]) == GroundFilterConfig()
    assert len({GroundFilterConfig(method=method, **chosen) for chosen in settings}) == len(settings)


def test_providers_are_compared_in_three_tables(data, capsys):
    providers.main(["--data", str(data), "--methods", METHOD])
    rows = lines_of(capsys.readouterr().out, METHOD)
    assert [words[1] for words in rows] == ["delft", "fusa"] * 3
    assert all(float(words[2]) > 90 for words in rows)


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


def test_disagreements_are_drawn_outside_the_repository(data, tmp_path):
    folder = tmp_path / "pictures"
    providers.main(["--data", str(data), "--methods", METHOD, "--pictures", str(folder)])
    drawn = sorted(folder.glob("*.png"))
    assert [path.name for path in drawn] == [f"delft_{METHOD}.png", f"fusa_{METHOD}.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in drawn)
    with pytest.raises(SystemExit, match="inside the repository"):
        arguments.picture_folder(ROOT / "bench" / "pictures")


def test_relief_is_bright_where_it_is_high_and_empty_where_nothing_is_near():
    cloud = small_scene()
    gap = cloud.points[:, 0] < 30
    points = np.vstack([cloud.points[gap], [[60.0, 15.0, GROUND]]])
    relief = pictures.shaded_relief(points, 1.0)
    assert relief[14:17, 18:22].mean() > relief[2:6, 2:20].mean() + 0.2
    assert np.isnan(relief[:, 40:50]).all()
    assert ((relief[:, :28] >= 0) & (relief[:, :28] <= 1)).all()


def test_parameters_given_are_used_and_unknown_ones_refused():
    assert arguments.settings_of(["ground_distance=0.5"]) == {"ground_distance": 0.5}
    assert arguments.settings_of(["profile_rounds=3", "kept_classes=water,noise"]) == {
        "profile_rounds": 3,
        "kept_classes": ("water", "noise"),
    }
    with pytest.raises(SystemExit, match="ground_distance=wide"):
        arguments.settings_of(["ground_distance=wide"])
    with pytest.raises(SystemExit, match="no such parameter"):
        arguments.settings_of(["distance=0.5"])
    tolerant = filters.own_filter(METHOD, {"ground_distance": 5.0, "iteration_distance": 20.0})
    masks = [filters.ground_mask(f, small_scene()) for f in (filters.own_filter(METHOD), tolerant)]
    assert masks[1].sum() > masks[0].sum()


def test_tables_are_aligned():
    text = tables.table(("name", "a"), [["long name", "1.00"], ["b", "10.00"]])
    assert text.splitlines() == [
        "name           a",
        "---------  -----",
        "long name   1.00",
        "b          10.00",
    ]

"""The benchmarks of roof selection, on clouds small enough for a test."""

import numpy as np
import pytest
import shapely
from support.cli_runs import lines_of
from support.lawn import write_las
from support.score_files import write_polygons

from bench.roofs import run as roofs
from bench.roofs import scenes as roof_scenes
from bench.scenes.roof_site import GROUND, RoofSite


def houses(seed=0):
    """Two houses and a tree on level ground of 50 × 34 m."""
    site = RoofSite(50, 34, 6.0, seed)
    site.house(14, 17, 12, 8, 5)
    site.house(36, 17, 10, 8, 4, roof="flat")
    site.tree(25, 8, 2.5, 9)
    return site.scanned(0.02, 0.0)


def write_scene(path, scene):
    """Write a scene, its truth as classes 6 and 1."""
    n = len(scene.points)
    columns = {name: scene.columns[name] for name in ("return_number", "number_of_returns", "intensity")}
    columns |= {"gps_time": np.arange(n) / 1e4, "scan_angle_rank": np.full(n, 3)}
    columns["point_source_id"] = np.ones(n, np.uint16)
    write_las(path, scene.points, np.where(scene.is_building, 6, 1), **columns)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A data folder with a mapped area and one that a provider classed."""
    folder = tmp_path_factory.mktemp("data")
    write_scene(folder / "delft" / "one.laz", houses())
    write_scene(folder / "fusa" / "one.laz", houses(1))
    blocks = [shapely.box(8, 13, 20, 21), shapely.box(31, 13, 41, 21)]
    write_polygons(folder / "delft" / "blocks_nw.gpkg", blocks)
    # The eastern house lies outside the area in which the map is complete.
    write_polygons(folder / "delft" / "aoi_nw.gpkg", [shapely.box(2, 2, 26, 32)])
    return folder


def figures(text, first):
    """The figures of the line that begins with a word."""
    return lines_of(text, first)[0][1:]


def test_real_clouds_are_judged_by_the_map_or_by_the_provider_s_class(data, capsys, tmp_path):
    pictures = ["--pictures", str(tmp_path)]
    roofs.main(["--data", str(data), "--methods", "smooth_patches", "single_returns", *pictures])
    assert {"delft_smooth_patches.png", "fusa_smooth_patches.png"} < {one.name for one in tmp_path.iterdir()}
    text = capsys.readouterr().out
    assert "montpellier" not in text
    delft, fusa = figures(text, "delft"), figures(text, "fusa")
    assert delft[:2] == ["BGT", "cells"]
    assert fusa[:2] == ["class", "6"]
    for line in (delft, fusa):
        # Recall, precision, IoU or F1 and seconds, twice.
        assert len(line) == 3 + 2 * 4
        assert min(float(value) for value in line[3:6]) > 80
    # Without the pulses that are split at the eaves.
    assert float(fusa[7]) < float(fusa[3])


def test_the_classes_of_the_file_are_not_looked_at(data):
    tile, reference = roofs.read_area(data / "fusa")
    assert set(np.unique(tile.classification)) <= {1, 2, 7, 18}
    assert reference.is_building.sum() == houses(1).is_building.sum()
    assert tile.height_above_ground[reference.is_building].min() > 3


def test_scenes_are_listed_and_drawn_with_means_and_the_worst(tmp_path, capsys):
    bench = roof_scenes
    options = ["--density", "0.3", "--methods", "lasclassify", "--pictures", str(tmp_path)]
    bench.main(["--scenes", "glass", "step_roofs", *options])
    assert len(list(tmp_path.glob("*_lasclassify.png"))) == 2
    text = capsys.readouterr().out
    assert "l = lasclassify" in text
    glass, steps, mean = (figures(text, name) for name in ("glass", "step_roofs", "mean"))
    assert float(mean[0]) == pytest.approx((float(glass[1]) + float(steps[1])) / 2, abs=0.011)
    worst, least = figures(text, "worst")
    assert worst in ("glass", "step_roofs")
    assert float(least) == min(float(glass[3]), float(steps[3]))


def test_scenes_have_their_own_noise_unless_another_is_asked_for():
    bench = roof_scenes
    own, smooth = bench.made("dense_block", 0.05), bench.made("dense_block", 0.05, noise=0.0)
    flat = smooth.is_building & (abs(smooth.points[:, 2] - GROUND - 9) < 1e-9)
    assert flat.sum() > 50
    assert not (abs(own.points[:, 2] - GROUND - 9) < 1e-9).any()

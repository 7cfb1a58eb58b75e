"""Rasters from the command line: where they lie, how near they are to the scene, and their parameters."""

import json
import shutil

import laspy
import numpy as np
import pytest
import rasterio
from support.cli_runs import RASTERS, Command, files_in

from lidar_buildings.cli import main
from lidar_buildings.simulation import simulate_survey
from lidar_buildings.simulation.named_scenes import make_scene

#: A small part of a run that has classes.
QUICK = ["--no-ros", "--until", "ground_filter"]


@pytest.fixture
def command(capfd):
    return Command(capfd, *QUICK)


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey")
    simulate_survey(folder, "courtyards", 0, density=5.0)
    return folder


@pytest.fixture(scope="module")
def result(survey, tmp_path_factory):
    output = tmp_path_factory.mktemp("result") / "out"
    assert main(["run", str(survey), "--output", str(output), "--tile-size", "60", *QUICK]) == 0
    return output


def terrain_at(file, scene):
    """True elevation of the ground at the middles of a raster's cells."""
    rows, columns = np.indices(file.shape)
    x, y = file.transform.c + 0.5 * (columns + 0.5), file.transform.f - 0.5 * (rows + 0.5)
    local = np.column_stack((x.ravel() - scene.frame.origin[0], y.ravel() - scene.frame.origin[1]))
    return scene.terrain.at(local).reshape(file.shape)


def test_the_dtm_is_the_scene_s_terrain_under_its_buildings_too(result):
    scene = make_scene("courtyards", 0)
    with rasterio.open(result / "dtm.tif") as file:
        assert file.crs.to_epsg() == 25832
        assert file.res == (0.5, 0.5)
        assert (file.transform.c % 0.5, file.transform.f % 0.5) == (0.0, 0.0)
        found = file.read(1, masked=True)
        error = (found - terrain_at(file, scene)).compressed()
    assert found.count() > 0.98 * found.size
    assert abs(error.mean()) < 0.02
    # three centimetres of noise, and courts and halls up to 36 m wide to bridge
    assert np.sqrt(np.mean(error**2)) < 0.06


def test_the_ndsm_is_as_high_as_points_above_the_ground(survey, result):
    cloud = laspy.read(result / "classified" / "strip_01.laz")
    with rasterio.open(result / "ndsm.tif") as file:
        height = file.read(1, masked=True)
        rows, columns = rasterio.transform.rowcol(file.transform, np.asarray(cloud.x), np.asarray(cloud.y))
    of_points = np.asarray(cloud["HeightAboveGround"])
    first = (np.asarray(cloud.return_number) <= 1) & ~np.isin(cloud.classification, (7, 18))
    above = of_points[first] - height[np.asarray(rows)[first], np.asarray(columns)[first]]
    # what is within 0.3 m of the terrain is ground and carries the raster, but need not be a vertex of it
    assert (above <= 0.3).mean() > 0.999, "the surface is the highest first return of a cell"
    assert np.ma.max(height) == pytest.approx(of_points[first].max(), abs=0.3)


def test_the_resolution_is_a_parameter(command, house, tmp_path):
    given = ["--set", "model_writer.raster_resolution=0.7"]
    assert command("run", house, "--output", tmp_path / "out", *given).status == 0
    with rasterio.open(tmp_path / "out" / "dsm.tif") as file:
        assert file.res == pytest.approx((0.7, 0.7))
        cells = file.transform.c / 0.7
        assert cells == pytest.approx(round(cells), abs=1e-6)


def test_a_resolution_of_0_removes_rasters_and_other_ones_are_refused(command, house, result, tmp_path):
    out, off = shutil.copytree(result, tmp_path / "out"), ["--set", "model_writer.raster_resolution=0"]
    assert command("run", house, "--output", out, "--overwrite", *off).status == 0
    assert not set(RASTERS) & set(files_in(out))
    assert json.loads((out / "run.json").read_text())["rasters"] == {}
    for value in ("-1", "1e9", "fine"):
        line = command.refused(
            "run", house, "--output", tmp_path / "no", "--set", f"model_writer.raster_resolution={value}"
        )
        assert "raster_resolution" in line


def test_tiles_of_any_size_give_the_same_rasters(command, survey, result, tmp_path):
    assert command("run", survey, "--output", tmp_path / "whole", "--tile-size", "1000").status == 0
    for name in RASTERS:
        with rasterio.open(result / name) as one, rasterio.open(tmp_path / "whole" / name) as other:
            assert (one.transform, one.shape) == (other.transform, other.shape)
            small, whole = one.read(1, masked=True), other.read(1, masked=True)
        assert (small.mask == whole.mask).all()
        assert (np.abs(small - whole).compressed() > 0.01).mean() < 0.01

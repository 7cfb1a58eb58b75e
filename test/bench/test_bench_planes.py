"""The benchmark of planes: tables with known figures, on roofs small enough for a test."""

import numpy as np
from support.score_files import write_cloud

from bench.planes import run as planes
from bench.planes import truth as plane_roofs


def write_roof(folder):
    """A gable roof coloured by its slopes."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 8, 0.3), np.arange(0, 6, 0.3)))
    points = np.column_stack((x, y, 5 - 0.7 * abs(x - 4)))
    colour = np.column_stack((65535 * (x < 4), 65535 * (x >= 4), 0 * x))
    write_cloud(folder / "roof.laz", points, colour=colour, origin=np.zeros(3))


def test_the_benchmark_of_planes_prints_methods_and_shapes(capsys, tmp_path, monkeypatch):
    write_roof(tmp_path / "trondheim")
    shape = {"gable": plane_roofs.shapes()["gable"]}
    monkeypatch.setattr(plane_roofs, "shapes", lambda: shape)
    options = ["--repeats", "1", "--roofs", "--densities", "8", "--noises", "0.02", "--seeds", "1"]
    planes.main(["--data", str(tmp_path), "--methods", "lidar_buildings", "as published", *options])
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["roof", "540", "2", "2", "100.00", "100.00", "100.00"] in [line[:-1] for line in lines]
    assert ["gable", "1", "1", "0", "100.00"] in [line[:5] for line in lines]
    own = next(line for line in lines if line and line[0] == "lidar_buildings" and len(line) > 5)
    assert own[1:6] == ["2", "100.00", "100.00", "100.00", "100.00"]


def test_faces_of_one_plane_that_touch_at_a_corner_are_one_plane():
    number_of, normals = plane_roofs.planes_of_faces(plane_roofs.shapes()["cross_gable"])
    assert len(normals) == 4
    assert np.bincount(number_of[1:]).tolist() == [0, 2, 2, 2, 2]


def test_peers_that_are_not_installed_are_named(capsys, monkeypatch, tmp_path):
    missing = planes.Method(lambda points: points, "no_such_package")
    monkeypatch.setitem(planes.METHODS, "open3d patches", missing)
    planes.main(["--data", str(tmp_path), "--methods", "open3d patches", "--densities"])
    assert "no_such_package is not installed" in capsys.readouterr().err

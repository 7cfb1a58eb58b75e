"""PLY and PCD files become clouds like any other."""

import laspy
import numpy as np
import pytest

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.core.scans.config import ScanConfig
from lidar_buildings.core.scans.scan import NOT_FINITE
from lidar_buildings.io.bags.bag_inputs import BagConfig, is_bag, place_bags, with_clouds
from lidar_buildings.io.bags.point_files import write_points

TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar"}
POINTS = np.random.default_rng(0).uniform([656_000, 5_340_000, 500], [656_050, 5_340_050, 520], (300, 3))


def rows_of(points):
    rows = np.zeros(len(points), [*((name, "<f8") for name in "xyz"), ("intensity", "<f4"), ("ring", "u1")])
    rows["x"], rows["y"], rows["z"] = points.T
    rows["intensity"] = np.arange(len(points)) % 200
    return rows


def write_ply(path, rows, kind, faces=""):
    head = [f"format {kind} 1.0", f"element vertex {len(rows)}"]
    head += [f"property {TYPES[rows.dtype[name].str]} {name}" for name in rows.dtype.names]
    head += ["element face 1", "property list uchar int vertex_indices"] if faces else []
    content = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()
    content = rows.tobytes() if "binary" in kind else content
    path.write_bytes("\n".join(["ply", *head, "end_header", ""]).encode() + content + faces.encode())
    return path


def write_pcd(path, rows, kind):
    names = rows.dtype.names
    head = [
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(str(rows.dtype[name].itemsize) for name in names)}",
        f"TYPE {' '.join(rows.dtype[name].kind.upper() for name in names)}",
        f"COUNT {' '.join('1' for _ in names)}",
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(rows)}",
        f"DATA {kind}",
        "",
    ]
    content = "".join(" ".join(map(repr, row)) + "\n" for row in rows.tolist()).encode()
    path.write_bytes("\n".join(head).encode() + (rows.tobytes() if kind == "binary" else content))
    return path


@pytest.mark.parametrize("kind", ["ascii", "binary_little_endian", "pcd ascii", "pcd binary"])
def test_points_are_those_of_the_file_and_what_is_none_is_left_out(tmp_path, kind):
    rows = rows_of(np.vstack([POINTS, [np.inf, 0.0, 0.0]]))
    if kind.startswith("pcd"):
        path = write_pcd(tmp_path / "cloud.pcd", rows, kind.split()[1])
    else:
        path = write_ply(tmp_path / "cloud.PLY", rows, kind)
    assert is_bag(path)
    records = place_bags([str(path)], tmp_path / "placed", BagConfig(), ScanConfig(), lambda line: None)
    (cloud,) = with_clouds([str(path)], tmp_path / "placed")
    las = laspy.read(cloud)
    np.testing.assert_allclose(las.xyz, POINTS, atol=0.001)
    assert records[0]["left_out"] == {NOT_FINITE: 1}
    if kind.startswith("pcd"):
        assert las.intensity.tolist() == (np.arange(300) % 200).tolist()


def test_a_mesh_and_what_cannot_be_read_are_named(tmp_path):
    mesh = write_ply(tmp_path / "mesh.ply", rows_of(POINTS[:3]), "ascii", "3 0 1 2\n")
    with pytest.raises(InputError, match=r"mesh\.ply: is a mesh of 1 faces"):
        write_points(mesh, tmp_path / "out.laz")
    for name in ("none.ply", "none.pcd"):
        (tmp_path / name).write_text("none")
        with pytest.raises(InputError, match=f"{name}: cannot be read as {name[-3:].upper()}"):
            write_points(tmp_path / name, tmp_path / "out.laz")

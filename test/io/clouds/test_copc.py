"""COPC files: every point once with all dimensions, levels of detail, boxes, formats, nothing, waveforms."""

import laspy
import numpy as np
import pytest
from laspy.copc import Bounds, CopcReader
from support import cloud_files

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds.copc import BITS, SAMPLE_BITS, Cube, Node, nodes_of, write_copc
from lidar_buildings.io.clouds.las import open_cloud

#: Dimensions that older formats do not have, or have in other steps.
OTHER = {"scan_angle", "scan_angle_rank", "overlap", "scanner_channel"}


def written(folder, cloud, name="a"):
    """Write a cloud as LAZ and as COPC, and return the path of this."""
    path = cloud_files.saved(cloud, folder / f"{name}.laz")
    write_copc(open_cloud(path), folder / f"{name}.copc.laz")
    assert sorted(p.name for p in folder.glob(".*")) == [], "no temporary file is left"
    return folder / f"{name}.copc.laz"


def rows_of(points, names):
    """Return points as sorted rows of numbers."""
    return np.sort(np.rec.fromarrays([np.asarray(points[name]) for name in names], names=names))


def within(points, low, high):
    x, y = np.asarray(points.x), np.asarray(points.y)
    return (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])


@pytest.fixture(params=[None, 600], ids=["one cell", "many cells"])
def held(request, monkeypatch):
    """The tree, whether memory holds all points or a few."""
    monkeypatch.setattr("lidar_buildings.io.clouds.copc._LEAF", 200)
    if request.param:
        monkeypatch.setattr("lidar_buildings.io.clouds.copc._LARGEST", request.param)


@pytest.mark.parametrize("point_format", [0, 1, 2, 3, 6, 7, 8])
def test_every_point_is_there_once_with_all_its_dimensions(tmp_path, held, point_format):
    cloud = cloud_files.random_cloud(5000, point_format=point_format)
    cloud.add_extra_dim(laspy.ExtraBytesParams("BuildingId", "u4"))
    cloud["BuildingId"] = np.arange(5000)
    path = written(tmp_path, cloud)
    names = [name for name in cloud.point_format.dimension_names if name not in OTHER]
    expected = rows_of(cloud, names)
    with CopcReader.open(path) as reader:
        assert (rows_of(reader.query(), names) == expected).all()
    after = laspy.read(path)
    assert (rows_of(after, names) == expected).all()
    assert after.header.point_count == 5000
    np.testing.assert_array_equal(after.header.mins, [after.x.min(), after.y.min(), after.z.min()])
    if point_format < 6:
        angles = np.asarray(after.scan_angle)[np.argsort(after["BuildingId"])] * 0.006
        assert angles == pytest.approx(np.asarray(cloud.scan_angle_rank, float), abs=0.003)


def test_a_box_has_the_points_within_it_and_coarse_levels_are_spread_evenly(tmp_path, held):
    cloud = cloud_files.random_cloud(20_000, point_format=6, size=(100.0, 100.0, 1.0))
    low, high = (85020.0, 447030.0), (85050.0, 447045.0)
    with CopcReader.open(written(tmp_path, cloud)) as reader:
        box = reader.query(bounds=Bounds(np.array(low), np.array(high)))
        levels = [reader.query(level=level) for level in range(8)]
    assert len(box) == np.count_nonzero(within(cloud, low, high))
    assert sum(map(len, levels)) == 20_000
    coarse = levels[0]
    per_cell, *_ = np.histogram2d(coarse.x - 85000.0, coarse.y - 447000.0, 10, [[0, 100], [0, 100]])
    assert per_cell.min() > 0.5 * per_cell.mean() > 0


def test_equal_clouds_give_equal_bytes(tmp_path, held):
    one, other = (written(tmp_path, cloud_files.random_cloud(3000), name) for name in "ab")
    assert one.read_bytes() == other.read_bytes()


def test_the_reference_system_becomes_wkt(tmp_path):
    cloud = cloud_files.with_geo_keys(cloud_files.random_cloud(10), {1024: 1, 3072: 28992})
    header = laspy.read(written(tmp_path, cloud)).header
    assert header.global_encoding.wkt
    assert header.parse_crs().to_epsg() == 28992


def test_a_cloud_without_points_is_sound(tmp_path):
    assert len(laspy.read(written(tmp_path, cloud_files.random_cloud(0)))) == 0


def test_waveforms_are_refused(tmp_path):
    cloud_files.saved(cloud_files.random_cloud(10, point_format=4), tmp_path / "a.las")
    with pytest.raises(InputError, match="waveforms"):
        write_copc(open_cloud(tmp_path / "a.las"), tmp_path / "a.copc.laz")


def test_nodes_have_a_point_of_each_of_their_cells_and_leaves_the_rest():
    places = np.random.default_rng(0).uniform(0.0, 1.0, (60_000, 3)) * [1.0, 1.0, 0.01]
    cube = Cube.around(places.min(axis=0), places.max(axis=0))
    codes = cube.codes(places)
    nodes = dict(nodes_of(codes, 0))
    assert sorted(np.concatenate(list(nodes.values())).tolist()) == list(range(60_000))
    for node, rows in nodes.items():
        assert {node.code} == set(codes[rows] >> 3 * (BITS - node.level))
        lower = cube.corner + np.array(node.place) * cube.side / 2**node.level
        assert (places[rows] >= lower - 1e-9).all()
        assert (places[rows] <= lower + cube.side / 2**node.level + 1e-9).all()
    root = codes[nodes[Node(0, 0)]] >> 3 * (BITS - SAMPLE_BITS)
    assert len(np.unique(root)) == len(root)
    assert set(root) == set(codes >> 3 * (BITS - SAMPLE_BITS))

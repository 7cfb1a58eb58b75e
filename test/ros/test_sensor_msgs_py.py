"""Our clouds and those of sensor_msgs_py are the same, byte for byte; skipped where it is not installed."""

import numpy as np
import pytest

from lidar_buildings.core.model.tile import COLUMNS, PointTile
from lidar_buildings.ros.point_cloud import from_message, to_message

point_cloud2 = pytest.importorskip("sensor_msgs_py.point_cloud2")


def full_tile(n=9):
    random = np.random.default_rng(1)
    columns = {name: random.integers(0, 200, n).astype(dtype) for name, dtype in COLUMNS.items()}
    return PointTile(random.normal(scale=50, size=(n, 3)), stamp=12_000_000_034, **columns)


def test_its_read_points_reads_our_clouds():
    tile = full_tile()
    read = point_cloud2.read_points(to_message(tile))
    for axis, name in enumerate("xyz"):
        assert np.array_equal(read[name], tile.points[:, axis].astype(np.float32))
    for name, column in tile.columns.items():
        assert np.array_equal(read[name], column)


def test_its_create_cloud_makes_the_same_bytes_and_we_read_them():
    tile = full_tile()
    ours = to_message(tile)
    rows = np.frombuffer(ours.data, dtype=point_cloud2.dtype_from_fields(ours.fields, ours.point_step))
    theirs = point_cloud2.create_cloud(ours.header, ours.fields, rows)
    assert bytes(theirs.data) == bytes(ours.data)
    assert (theirs.point_step, theirs.row_step) == (ours.point_step, ours.row_step)
    again = from_message(theirs).tile
    assert np.array_equal(again.points, tile.points)
    assert np.array_equal(again.building_id, tile.building_id)


def test_we_read_a_plain_xyz_cloud_of_its_making():
    points = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], dtype=np.float32)
    message = point_cloud2.create_cloud_xyz32(to_message(full_tile(0)).header, points)
    assert np.array_equal(from_message(message).tile.points, points)

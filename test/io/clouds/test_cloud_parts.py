"""Parts of clouds: the points in bounds, of COPC read chunk by chunk, here and in a store."""

import struct

import laspy
import numpy as np
import pytest
from support import cloud_files, counted_store

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.clouds import cloud as clouds_of
from lidar_buildings.io.clouds import copc
from lidar_buildings.io.clouds.fetch import write_part
from lidar_buildings.io.clouds.las import open_cloud, read_tile

#: West, south, east, north of a corner of the cloud, about 5 % of it.
CORNER = (85080.0, 447060.0, 85100.0, 447080.0)
N_POINTS = 20_000


@pytest.fixture(scope="module")
def paths(tmp_path_factory):
    """One cloud as LAS, LAZ and COPC."""
    folder = tmp_path_factory.mktemp("parts")
    cloud = cloud_files.random_cloud(N_POINTS, point_format=6, size=(100.0, 80.0, 1.0))
    found = [
        cloud_files.saved(cloud_files.with_wkt(cloud, "EPSG:28992"), folder / f"a{ending}")
        for ending in (".las", ".laz")
    ]
    return [*found, cloud_files.saved_copc(cloud, folder / "a.copc.laz", level=4)]


def within(tile, bounds):
    xy = tile.points[:, :2] + tile.frame.origin[:2]
    return ((xy >= np.array(bounds[:2]) - 1e-6) & (xy <= np.array(bounds[2:]) + 1e-6)).all(axis=1)


def assert_rows(part, whole, rows):
    assert np.array_equal(part.points, whole.points[rows])
    for name, column in part.columns.items():
        assert np.array_equal(column, whole.columns[name][rows]), name


@pytest.mark.parametrize(
    "runs", [[(7, 9)], [(19_999, 20_000)], [(0, 20_000)], [(3, 4), (5000, 9000), (9001, 9002)]]
)
@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("backend", [laspy.LazBackend.Lazrs, laspy.LazBackend.LazrsParallel])
def test_points_read_from_any_place_on_are_those_that_stand_there(paths, number, runs, backend, monkeypatch):
    monkeypatch.setattr(clouds_of, "laz_backend", lambda: backend)
    whole = laspy.read(paths[number]).points.array
    found = list(open_cloud(paths[number]).runs(runs, 1500))
    assert sum(len(points) for _, points in found) == sum(end - first for first, end in runs)
    for first, points in found:
        assert np.array_equal(points.array, whole[first : first + len(points)])


@pytest.mark.parametrize("number", range(3))
def test_a_tile_of_bounds_has_the_points_of_the_whole_that_lie_in_them(paths, number):
    whole, part = read_tile(paths[number]), read_tile(paths[number], CORNER)
    rows = within(whole, CORNER)
    assert 0 < np.count_nonzero(rows) < 0.1 * len(whole)
    assert_rows(part.with_columns(point_spacing=None), whole, rows)
    assert part.frame == whole.frame
    assert len(read_tile(paths[number], (0.0, 0.0, 1.0, 1.0))) == 0


@pytest.mark.filterwarnings("ignore:UPath")
def test_little_more_is_read_of_copc_than_the_chunks_that_touch_the_bounds(paths):
    counted_store.register()
    store = counted_store.CountedStore
    for path in paths:
        store.held[path.name] = path.read_bytes()
    bounds = (85050.0, 447050.0, 85052.0, 447052.0)
    n_read = {}
    for path in paths:
        store.n_bytes = 0
        part = read_tile(f"counted://{path.name}", bounds)
        n_read[path.name] = store.n_bytes / path.stat().st_size
        assert_rows(part, read_tile(path, bounds), np.arange(len(part)))
    assert n_read["a.copc.laz"] < 0.5 * n_read["a.laz"]


@pytest.mark.parametrize("number", range(3))
def test_a_part_keeps_dimensions_order_and_reference_system(paths, tmp_path, number):
    n_points = write_part(open_cloud(paths[number]), CORNER, tmp_path / "part.laz")
    part, whole = laspy.read(tmp_path / "part.laz"), laspy.read(paths[number])
    rows = within(read_tile(paths[number]), CORNER)
    assert n_points == np.count_nonzero(rows) == part.header.point_count
    assert np.array_equal(part.points.array, whole.points.array[rows])
    assert open_cloud(tmp_path / "part.laz").crs.name == "EPSG:28992"
    assert not [one for one in part.header.vlrs if one.user_id == "copc"]


def test_a_part_has_the_same_bytes_without_the_hierarchy(paths, tmp_path, monkeypatch):
    write_part(open_cloud(paths[2]), CORNER, tmp_path / "by_nodes.laz")
    monkeypatch.setattr(copc, "read_nodes", lambda cloud: None)
    write_part(open_cloud(paths[2]), CORNER, tmp_path / "by_all.laz")
    assert (tmp_path / "by_nodes.laz").read_bytes() == (tmp_path / "by_all.laz").read_bytes()


def test_waveforms_cannot_be_cut(tmp_path):
    path = cloud_files.saved(cloud_files.random_cloud(point_format=4), tmp_path / "a.las")
    with pytest.raises(InputError, match="has waveforms"):
        write_part(open_cloud(path), CORNER, tmp_path / "part.laz")


def test_squares_of_the_hierarchy_have_all_points_where_they_are(paths, monkeypatch):
    monkeypatch.setattr(copc, "_SQUARE", 10.0)
    cloud = open_cloud(paths[2])
    bounds, counts = copc.read_nodes(cloud).squares(1.0)
    assert counts.sum() == N_POINTS
    east = counts[bounds[:, 0, 0] > 85049.9].sum() / counts[bounds[:, 1, 0] < 85050.1].sum()
    assert east == pytest.approx(1.0, abs=0.1), "points lie evenly; the cube ends at the eastern edge"
    assert (bounds[:, 1] - bounds[:, 0]).min() >= 10.0


@pytest.mark.parametrize("page", ["none", "of itself", "beyond the end"])
def test_a_hierarchy_that_cannot_be_true_is_not_used(paths, tmp_path, page):
    content = bytearray(paths[2].read_bytes())
    (start,) = struct.unpack_from("<Q", content, 375 + 54 + 40)
    begin, length = {"none": (start, 0), "of itself": (start, 32), "beyond the end": (len(content), 32)}[page]
    struct.pack_into("<2Q", content, 375 + 54 + 40, begin, length)
    struct.pack_into("<4iQ2i", content, start, 0, 0, 0, 0, start, 32, -1)
    (tmp_path / "a.copc.laz").write_bytes(content)
    cloud = open_cloud(tmp_path / "a.copc.laz")
    assert copc.read_nodes(cloud) is None
    assert copc.runs_touching(cloud, CORNER) == [(0, N_POINTS)]

"""Inputs elsewhere: what a URL stands for, what is said where it cannot be read."""

import sys
from pathlib import Path

import pytest
from support import cloud_files

from lidar_buildings.core.model.errors import InputError
from lidar_buildings.io.bags.bag_inputs import is_bag
from lidar_buildings.io.clouds.find_inputs import check_unchanged, find_inputs
from lidar_buildings.io.clouds.las import open_cloud, open_inputs
from lidar_buildings.io.files.locations import located


@pytest.fixture
def store(tmp_path):
    """A folder of two clouds in memory."""
    folder = located("memory://survey")
    folder.mkdir(exist_ok=True)
    for name in ("b.laz", "a.copc.laz"):
        path = cloud_files.saved(cloud_files.random_cloud(seed=len(name)), tmp_path / "one.laz")
        (folder / name).write_bytes(path.read_bytes())
    return folder


def test_files_folders_and_globs_of_a_store_are_found(store):
    names = [str(store / name) for name in ("a.copc.laz", "b.laz")]
    assert [str(one) for one in find_inputs("memory://survey")] == names
    assert [str(one) for one in find_inputs("memory://survey/*.laz")] == names
    assert [str(one) for one in find_inputs([names[1], "memory://survey"])] == names[::-1]
    clouds, problems = open_inputs(["memory://survey", "memory://survey/c.laz"])
    assert [cloud.point_count for cloud in clouds] == [500, 500]
    assert problems == ["memory://survey/c.laz: no such file: check the path"]
    assert not is_bag("memory://survey/a.bag")


def test_a_file_that_was_replaced_in_the_store_is_refused(store):
    cloud = open_cloud("memory://survey/b.laz")
    check_unchanged(cloud.input_file)
    content = (store / "b.laz").read_bytes()
    (store / "b.laz").write_bytes(content)
    with pytest.raises(InputError, match="changed during the run"):
        list(cloud.chunks())


def test_a_url_of_a_file_here_is_its_path(tmp_path):
    assert located(f"file://{tmp_path}/a.laz") == tmp_path / "a.laz"
    assert located("a.laz") == Path("a.laz")


def test_what_cannot_be_read_is_said_in_one_line(monkeypatch):
    with pytest.raises(InputError, match=r"^foo://a\.laz: .*: give a URL that fsspec knows"):
        find_inputs("foo://a.laz")
    monkeypatch.setitem(sys.modules, "upath", None)
    with pytest.raises(InputError, match=r"^s3://b/a\.laz: URLs need the extra \[cloud\]: pip install"):
        find_inputs("s3://b/a.laz")

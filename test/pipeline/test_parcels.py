"""What travels between processes arrives as it was, and is copied once."""

import gc
import multiprocessing
import os
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from lidar_buildings.pipeline.building_pool import BuildingPool
from lidar_buildings.pipeline.parcels import packed, receive, send, unpacked

#: Larger than what goes within the pickle.
N = 100_000


@pytest.fixture
def link():
    near, far = multiprocessing.Pipe()
    yield near, far
    near.close()
    far.close()


def sent(link, content):
    """Send something and return what comes."""
    near, far = link
    sender = threading.Thread(target=send, args=(near, packed(content)))
    sender.start()
    come = unpacked(receive(far))
    sender.join()
    return come


def same(*content):
    return content


def with_one_changed(unchanged, changed):
    changed += 1.0
    return unchanged, changed


@pytest.mark.parametrize(
    "content",
    [
        "no array",
        np.arange(3),
        np.arange(N),
        np.arange(N * 3.0).reshape(N, 3),
        np.arange(N * 3.0).reshape(N, 3).T,
        np.arange(N)[::2],
        np.arange(N)[:0],
        np.zeros((N, 2), [("x", "<f4"), ("n", "u1")]),
    ],
    ids=["none", "small", "large", "matrix", "transposed", "every other", "empty", "records"],
)
def test_whatever_is_sent_arrives_as_it_was(link, content):
    first, second = sent(link, (content, content))
    for come in (first, second):
        np.testing.assert_array_equal(come, content)
        assert np.asarray(come).dtype == np.asarray(content).dtype
    assert np.asarray(first).flags.writeable


def test_parts_of_what_has_come_are_sent_as_they_are(link):
    (come,) = sent(link, (np.arange(N),))
    part = come[10:-10]
    (again,) = sent(link, (part,))
    np.testing.assert_array_equal(again, np.arange(10, N - 10))
    assert np.shares_memory(again, come)


def test_more_arrays_than_descriptors_go_at_once(link):
    arrays = [sent(link, np.full(N // 10, k)) for k in range(260)]
    come = sent(link, arrays)
    assert all((one == k).all() for k, one in enumerate(come))
    assert all(np.shares_memory(*pair) for pair in zip(come, arrays, strict=True))


def test_what_another_process_returns_unchanged_is_what_was_sent():
    with BuildingPool(2) as pool:
        (first,) = pool.call(same, np.arange(N))
        second, third = pool.call(same, first, first[5:])
        assert np.shares_memory(first, second)
        assert np.shares_memory(second, third)
        np.testing.assert_array_equal(third, np.arange(5, N))


def test_who_writes_to_what_came_changes_nothing_of_the_senders():
    mine = np.ones(N), np.ones(N)
    with BuildingPool(2) as pool:
        come = pool.call(same, *mine)
        pool.call(with_one_changed, *come)
        come[1][:] = 5.0
        assert pool.call(np.sum, come[0]) == N
    assert (mine[1] == 1.0).all()


@pytest.mark.skipif(sys.platform != "linux", reason="counts what Linux tells of open files")
def test_memory_is_given_back_with_the_last_array(link):
    open_files = Path("/proc/self/fd")
    gc.collect()
    before = len(list(open_files.iterdir()))
    come = sent(link, (np.arange(N), np.arange(N)))
    assert len(list(open_files.iterdir())) > before
    part = come[0][:5]
    del come
    assert len(list(open_files.iterdir())) > before
    assert part[-1] == 4
    del part
    assert len(list(open_files.iterdir())) == before


def test_a_link_that_ends_before_the_arrays_have_come_is_an_error(link):
    near, far = link
    near.send((b"", ["1.1"], [(0, 0, 8)]))
    near.close()
    with pytest.raises(EOFError):
        receive(far)


def test_without_memory_of_the_systems_a_file_does(link, monkeypatch):
    monkeypatch.delattr(os, "memfd_create", raising=False)
    np.testing.assert_array_equal(sent(link, np.arange(N)), np.arange(N))

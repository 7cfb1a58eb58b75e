import numpy as np
import pytest

from lidar_buildings.core.model.errors import MessageError
from lidar_buildings.core.scans.seen_points import SeenPoints


def test_a_point_is_new_once_whatever_its_source_and_however_far_its_row():
    random = np.random.default_rng(0)
    seen, known = SeenPoints(), set()
    for _ in range(20):
        rows = np.unique(random.integers(0, [3, 3_000_000], (500, 2)), axis=0)
        expected = [tuple(row) not in known for row in rows.tolist()]
        found = seen.are_new(rows[:, 0].astype(np.uint16), rows[:, 1].astype(np.uint32))
        assert found.tolist() == expected
        known |= set(map(tuple, rows.tolist()))
    assert not seen.are_new(rows[:, 0], rows[:, 1]).any()
    assert seen.are_new(rows[:0, 0], rows[:0, 1]).tolist() == []


def test_numbers_of_more_points_than_there_can_be_are_refused_before_memory_is_taken():
    sources, last = np.arange(3, dtype=np.uint16), np.full(3, 2**32 - 1, dtype=np.uint32)
    with pytest.raises(MessageError, match="no survey has so many points"):
        SeenPoints().are_new(sources, last)

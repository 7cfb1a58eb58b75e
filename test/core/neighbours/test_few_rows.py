import numpy as np

from lidar_buildings.core.neighbours.few_rows import rows_by_group


def test_rows_come_group_by_group_rising_within_each():
    group = np.random.default_rng(0).integers(0, 7, 200)
    rows, first = rows_by_group(group, 9)
    assert np.array_equal(rows, np.argsort(group, kind="stable"))
    assert np.array_equal(np.diff(first), np.bincount(group, minlength=9))
    assert rows_by_group(group[:0], 2)[1].tolist() == [0, 0, 0]

"""Of points in one voxel the first is new, whatever came in between."""

import numpy as np

from lidar_buildings.core.neighbours.seen_voxels import SeenVoxels


def test_the_first_point_of_each_voxel_is_new_and_no_other_one():
    seen, points = SeenVoxels(), np.random.default_rng(0).uniform(-3.0, 3.0, (2000, 3))
    voxels = np.floor(points / 0.5)
    first = np.zeros(2000, dtype=bool)
    first[np.unique(voxels, axis=0, return_index=True)[1]] = True
    np.testing.assert_array_equal(
        np.append(seen.are_new(points[:900], 0.5), seen.are_new(points[900:], 0.5)), first
    )
    assert not seen.are_new(points, 0.5).any()

"""Nodes of one kind share their tiles evenly, and each has all revisions of its own."""

import numpy as np
import pytest

from lidar_buildings.core.model.errors import ParameterError
from lidar_buildings.core.model.replicas import ReplicaConfig, replica_of


@pytest.mark.parametrize("step", [1_000, 10**6, 10**9, 2**20 * 1000, 123_457_000])
@pytest.mark.parametrize("n", [2, 3, 8])
def test_tiles_are_shared_evenly_however_their_stamps_are_spaced(step, n):
    found = [replica_of(1_700_000_000 * 10**9 + number * step, n) for number in range(600)]
    counts = np.bincount(found, minlength=n)
    assert (np.abs(counts - 600 / n) < 0.35 * 600 / n).all(), counts


def test_all_revisions_of_a_tile_are_of_one_node():
    assert len({replica_of(stamp, 7) for stamp in range(5_000, 6_000)}) == 1
    assert {replica_of(stamp, 1) for stamp in range(0, 10**6, 999)} == {0}


def test_each_tile_has_exactly_one_node():
    nodes = [ReplicaConfig(replica=number, replicas=3) for number in range(3)]
    assert all(sum(node.takes(stamp) for node in nodes) == 1 for stamp in range(-(10**6), 10**6, 1_777))


def test_a_number_beyond_the_replicas_is_refused():
    with pytest.raises(ParameterError, match="replica = 2: must be below replicas = 2"):
        ReplicaConfig(replica=2, replicas=2)

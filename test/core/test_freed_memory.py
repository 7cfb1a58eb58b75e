"""What is free goes back to the system, not more often than wanted."""

import sys
from pathlib import Path

import numpy as np
import pytest

from lidar_buildings.core import freed_memory
from lidar_buildings.core.freed_memory import give_memory_back


def resident():
    """Memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


@pytest.mark.skipif(sys.platform != "linux", reason="of glibc")
def test_memory_between_what_is_in_use_goes_back_once_a_period(monkeypatch):
    monkeypatch.setattr(freed_memory, "_last", -float("inf"))
    size = 100_000  # bytes, below what malloc takes from the system piece by piece
    kept = [np.ones(size, np.uint8) for _ in range(2000)]
    del kept[::2], kept[1::2]  # holes
    before = resident()
    give_memory_back(1000.0)
    after = resident()
    assert before - after > 100.0
    del kept[::2]
    give_memory_back(1000.0)
    assert resident() > after - 1.0, "not again so soon"
    give_memory_back()
    assert resident() < after - 20.0

"""What is free goes back to the system, not more often than wanted."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lidar_buildings.core import freed_memory
from lidar_buildings.core.freed_memory import give_memory_back


def resident():
    """Memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


@pytest.mark.skipif(sys.platform != "linux", reason="of glibc")
def test_memory_between_what_is_in_use_goes_back():
    size = 100_000  # bytes, below what malloc takes from the system piece by piece
    kept = [np.ones(size, np.uint8) for _ in range(2000)]
    del kept[::2], kept[1::2]  # holes
    before = resident()
    give_memory_back()
    assert before - resident() > 100.0


def test_it_goes_back_once_a_period(monkeypatch):
    trims = []
    monkeypatch.setattr(freed_memory, "_last", -float("inf"))
    monkeypatch.setattr(freed_memory.ctypes, "CDLL", lambda _: SimpleNamespace(malloc_trim=trims.append))
    for period, n_trims in ((1000.0, 1), (1000.0, 1), (0.0, 2)):
        give_memory_back(period)
        assert len(trims) == n_trims

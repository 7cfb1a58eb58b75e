"""
Points of classified clouds that a page shows: kept as they are written, so that they need not be decoded.

Of large surveys every so many stretches one, each as long as a chunk that LAZ files are cut into.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import laspy
import numpy as np
from numpy.typing import NDArray

from lidar_buildings.io.clouds.cloud import Cloud
from lidar_buildings.io.files.atomic_files import atomic_file
from lidar_buildings.io.results.run_folder import PARTIAL

#: About so many points at most are read for a page, as that takes longest.
MOST_READ = 3_000_000
_STRETCH = 50_000


def every_stretch(n_points: int) -> int:
    """Return of how many stretches of clouds with so many points one is read."""
    return max(1, -(-n_points // MOST_READ))


def stretches(cloud: Cloud, every: int) -> Iterator[laspy.ScaleAwarePointRecord]:
    """Read a cloud's points; of every so many stretches one."""
    if every == 1:
        yield from cloud.chunks()
        return
    firsts = range(0, cloud.point_count, every * _STRETCH)
    runs = [(first, min(first + _STRETCH, cloud.point_count)) for first in firsts]
    yield from (points for _, points in cloud.runs(runs))


@contextmanager
def cloud_sample(cloud: Path, every: int) -> Iterator[Callable[[int, NDArray[Any]], None]]:
    """
    Give a function that is told a cloud's points as they are written, and keeps one of so `every` stretches.

    They are where `kept_points` finds them as long as the run is not finished. OutputError if they cannot be
    written.
    """
    with atomic_file(_place(cloud)) as temporary, open(temporary, "wb") as file:

        def add(first: int, points: NDArray[Any]) -> None:
            row = np.arange(first, first + len(points))
            points[row // _STRETCH % every == 0].tofile(file)

        yield add


def kept_points(cloud: Cloud) -> laspy.ScaleAwarePointRecord | None:
    """Return the points of a cloud's stretches if they were kept while it was written."""
    path = _place(cloud.path)
    if not path.is_file():
        return None
    header = cloud.header
    records = np.fromfile(path, header.point_format.dtype())
    return laspy.ScaleAwarePointRecord(records, header.point_format, header.scales, header.offsets)


def forget_points(folder: Path) -> None:
    """Delete what was kept of a result's clouds."""
    for path in (folder / PARTIAL).glob("*.shown"):
        path.unlink()


def _place(cloud: Path) -> Path:
    return cloud.parents[1] / PARTIAL / f"{cloud.name}.shown"

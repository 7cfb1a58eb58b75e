"""Delft laid out several times side by side, as files of their own: an input as large as one likes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np

#: Between copies, so that no building reaches from one into the next: each is as much work as the first [m].
GAP = 10.0
#: Between the flights over two copies, so that their scan lines are told apart [s].
PAUSE = 10.0


def input_files(files: Sequence[Path], n_copies: int, folder: Path) -> list[Path]:
    """
    Return the files themselves for one copy, else `n_copies` of each on a square grid.

    Copies are made once: those that stand in `folder` are taken. One file is in memory at a time.
    """
    if n_copies == 1:
        return list(files)
    folder = folder / f"copies_{n_copies}"
    side = math.isqrt(n_copies - 1) + 1
    paths = [folder / f"{number:03d}_{file.name}" for number in range(n_copies) for file in files]
    if not all(path.is_file() for path in paths):
        folder.mkdir(parents=True, exist_ok=True)
        steps = _steps(files)
        for file in files:
            las = laspy.read(file)
            for number in range(n_copies):
                row, column = divmod(number, side)
                write_moved(las, folder / f"{number:03d}_{file.name}", (column, row, number) * steps)
    return paths


def write_moved(las: laspy.LasData, path: Path, shift: Sequence[float]) -> None:
    """
    Write a cloud, which comes back as it was, at another place and time; never a part of it under this name.

    The shift is to the east and to the north, by multiples of the file's scale [m], and in time [s].
    """
    stored = las.points.array
    before = stored.copy()
    for name, distance, scale in zip("XY", shift[:2], las.header.scales[:2], strict=True):
        stored[name] += round(distance / scale)
    if "gps_time" in stored.dtype.names:
        stored["gps_time"] += shift[2]
    unfinished = path.with_suffix(f".part{path.suffix}")
    las.write(unfinished)
    unfinished.replace(path)
    stored[:] = before


def _steps(files: Sequence[Path]) -> np.ndarray:
    """Return the distance from copy to copy, eastwards and northwards in whole metres, and in time."""
    headers = []
    times = []
    for file in files:
        with laspy.open(file) as reader:
            headers.append(reader.header)
            times += [
                value
                for points in reader.chunk_iterator(1_000_000)
                if "gps_time" in points.array.dtype.names
                for value in (points["gps_time"].min(), points["gps_time"].max())
            ]
    extent = np.max([h.maxs for h in headers], axis=0) - np.min([h.mins for h in headers], axis=0)
    duration = np.ptp(times) if times else 0.0
    return np.array([*np.ceil(extent[:2] + GAP), math.ceil(duration + PAUSE)])

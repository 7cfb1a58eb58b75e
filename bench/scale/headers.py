"""
A survey that is there by its headers alone: LAS files, each a hole on disk behind its header.

    python -m bench.scale.headers [--side 316] [--points 10000] [--tile-size 35] [--folder DIR]

Makes side x side files, plans a run of them, and prints what planning took: 316 and 10,000 are 10^9 points in
99,856 files, and as many tiles of 35 m.
"""

from __future__ import annotations

import argparse
import io
import resource
import struct
import sys
import tempfile
import time
from pathlib import Path

import laspy
import numpy as np

from lidar_buildings.cli import main as lidar_buildings

#: Points a square metre.
DENSITY = 8.0
#: Where a header has its bounds, and counts in 64 bits (LAS 1.4).
_BOUNDS, _COUNTS = 179, 247


def make_survey(folder: Path, side: int, n_points: int) -> float:
    """Write the files, each `n_points` on a square; return the side of such a square [m]."""
    width = float(np.sqrt(n_points / DENSITY))
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.zeros(3)
    buffer = io.BytesIO()
    laspy.LasData(header).write(buffer)
    template = bytearray(buffer.getvalue())
    struct.pack_into("<16Q", template, _COUNTS, n_points, n_points, *[0] * 14)
    size = len(template) + n_points * header.point_format.size
    for number in range(side * side):
        west, south = (place * width + 1000.0 for place in divmod(number, side))
        struct.pack_into(
            "<6d", template, _BOUNDS, west + width, west, south + width, south, 30.0 + number % 7, 0.0
        )
        with open(folder / f"{number:06d}.las", "wb") as file:
            file.write(template)
            file.truncate(size)
    return width


def main() -> int:
    """Make the survey, plan it, and print time and memory."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--side", type=int, default=316)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--tile-size", type=float, default=0.0)
    parser.add_argument("--folder", type=Path, help="where the files are, or are made")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="headers_") as passing:
        folder = options.folder or Path(passing)
        folder.mkdir(exist_ok=True)
        if not any(folder.iterdir()):
            make_survey(folder, options.side, options.points)
        before, began = time.process_time(), time.perf_counter()
        tiles = ["--tile-size", str(options.tile_size)] if options.tile_size else []
        status = lidar_buildings(["plan", str(folder), "--workers", "100", *tiles])
    wall, processor = time.perf_counter() - began, time.process_time() - before
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(f"planned in {wall:.1f} s ({processor:.1f} processor s), with up to {memory / 1e6:.0f} MB")
    return status


if __name__ == "__main__":
    sys.exit(main())

"""
The anchor: the points of files decoded and put aside, nothing else.

    python -m bench.chain.decoding FILE ...

prints points, seconds and processor seconds as a line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence

import laspy

#: Points held at a time.
CHUNK = 1_000_000


def decode(files: Sequence[str]) -> int:
    """Decode all points of all files, in chunks; return how many there are."""
    n_points = 0
    for file in files:
        with laspy.open(file) as reader:
            n_points += sum(len(points) for points in reader.chunk_iterator(CHUNK))
    return n_points


def main(files: Sequence[str]) -> None:
    """Decode files once, and print how long it took."""
    wall, cpu = time.perf_counter(), time.process_time()
    n_points = decode(files)
    figures = {"points": n_points, "wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    print(json.dumps(figures))


if __name__ == "__main__":
    main(sys.argv[1:])

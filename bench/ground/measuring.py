"""
One measurement in a process of its own: seconds, processor seconds, and peak memory above the input.

    python -m bench.ground.measuring CLOUD.npz METHOD COPIES

prints one line of JSON. What is not measured: reading and laying out the input, a first run on a small piece
of it (so that everything is loaded and compiled), and turning the result into a mask.
"""

from __future__ import annotations

import gc
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.clouds import Cloud, middle_of, replicated
from bench.ground.peers import GroundFilter, filters, ground_mask, quiet

#: Side of the piece for the first run [m].
WARM_UP_SIDE = 60.0
PROCESS = Path("/proc/self")


def save_cloud(path: Path, cloud: Cloud) -> None:
    """Write a cloud for `load_cloud`."""
    np.savez(path, points=cloud.points, is_ground=cloud.is_ground, **cloud.scan)


def load_cloud(path: Path) -> Cloud:
    """Read what `save_cloud` wrote."""
    with np.load(path) as arrays:
        columns = {name: arrays[name] for name in arrays.files}
    return Cloud(columns.pop("points"), is_ground=columns.pop("is_ground"), scan=columns)


def memory(entry: str) -> int:
    """A figure of the kernel's account of this process, VmRSS or VmHWM [bytes]."""
    lines = (PROCESS / "status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(f"{entry}:"))


def forget_peak() -> None:
    """Let the kernel's record of the largest resident size start anew from the present size."""
    (PROCESS / "clear_refs").write_text("5")


def measure(ground_filter: GroundFilter, cloud: Cloud) -> dict[str, Any]:
    """Time one run and take its peak memory above the input."""
    small = middle_of(cloud, WARM_UP_SIDE)
    ground_mask(ground_filter, small)
    job = ground_filter.prepare(cloud)
    gc.collect()
    forget_peak()
    before = memory("VmRSS")
    wall, cpu = time.perf_counter(), time.process_time()
    output = ground_filter.run(job)
    seconds, cpu_seconds = time.perf_counter() - wall, time.process_time() - cpu
    above = memory("VmHWM") - before
    mask = ground_filter.mask(output, len(cloud.points))
    return {
        "points": len(cloud.points),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "bytes_above_input": above,
        "ground": int(mask.sum()),
    }


def main(path: str, method: str, copies: str) -> None:
    """Measure one method on copies of a saved cloud."""
    cloud = load_cloud(Path(path))
    if int(copies) > 1:
        cloud = replicated(cloud, int(copies))
    with quiet(), filters([method]) as chosen:
        figures = measure(chosen[method], cloud)
    print(json.dumps(figures))


if __name__ == "__main__":
    main(*sys.argv[1:])

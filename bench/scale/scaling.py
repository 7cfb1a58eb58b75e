"""
How a run gets faster with workers, and how a survey that grows with them is done in the same time.

    python -m bench.scale.scaling [--data DIR] [--folder DIR] [--copies 4] [--workers 1 2] [--tile-size 200]

Strong: Delft laid out so many times, with each number of workers. Weak: as many times for each worker. Each
is `run --workers N`, with as many cores as workers. Where the machine does other work too, its seconds are
told: then processor seconds say more than the time.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.chain.child import Usage, run_child
from bench.chain.copies import input_files
from bench.common.clouds import data_folder


def main() -> None:
    """Print a line for each run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--data", help="folder of the real clouds (default: LIDAR_BUILDINGS_DATA)")
    parser.add_argument("--folder", type=Path, help="keep inputs here")
    parser.add_argument("--copies", type=int, default=4)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--tile-size", type=float, default=200.0)
    options = parser.parse_args()
    files = sorted((data_folder(options.data) / "delft").glob("*.laz"))
    with tempfile.TemporaryDirectory(prefix="scaling_") as passing:
        folder = options.folder or Path(passing)
        least: dict[str, Usage] = {}
        for n_workers in options.workers:
            for kind, n_copies in (("strong", options.copies), ("weak", options.copies * n_workers)):
                inputs = input_files(files, n_copies, folder)
                usage = _run(inputs, n_workers, options.tile_size, Path(passing, f"{kind}_{n_workers}"))
                first = least.setdefault(kind, usage)
                print(_line(kind, n_copies, n_workers, usage, first), flush=True)


def _run(inputs: Sequence[Path], n_workers: int, tile_size: float, output: Path) -> Usage:
    command = [sys.executable, "-m", "lidar_buildings.cli", "run", *map(str, inputs)]
    how = ["--output", str(output), "--workers", str(n_workers), "--tile-size", str(tile_size)]
    return run_child([*command, *how], cores=n_workers, output=output)


def _line(kind: str, n_copies: int, n_workers: int, usage: Usage, first: Usage) -> str:
    faster = first.wall / usage.wall
    return (
        f"{kind}: Delft x {n_copies}, {n_workers} workers: {usage.wall:.1f} s ({faster:.2f} times the "
        f"first speed), {usage.cpu:.1f} processor s, others {usage.others:.0f} s, {usage.memory / 1e6:.0f} MB"
    )


if __name__ == "__main__":
    main()

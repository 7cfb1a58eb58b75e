"""
A run on a cluster whose scheduler and workers are killed at random: its files must be those of a quiet run.

    python -m bench.scale.kills INPUT... [--tile-size 18] [--buffer 20] [--kills 10] [--workers 2] [--seed 0]
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.scale.cluster import Cluster

#: Files that tell of the run itself.
_OF_THE_RUN = {"run.json", "report.html"}


def main() -> int:
    """Print when what was killed, and whether the files are the same."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input", nargs="+")
    parser.add_argument("--tile-size", type=float, default=0.0)
    parser.add_argument("--buffer", type=float)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--pause", type=float, default=8.0, help="about so long between two kills [s]")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    tiles = ["--tile-size", str(options.tile_size)] if options.tile_size else []
    tiles += [] if options.buffer is None else ["--set", f"tile_player.buffer={options.buffer}"]
    with tempfile.TemporaryDirectory(prefix="kills_") as name:
        quiet, killed = Path(name, "quiet"), Path(name, "killed")
        begin = time.perf_counter()
        subprocess.run(_command(options.input, quiet, *tiles, "--no-ros"), check=True, capture_output=True)
        print(f"one process tree, no cluster: {time.perf_counter() - begin:.1f} s", flush=True)
        chance = random.Random(options.seed)
        with Cluster(options.workers) as cluster:
            begin = time.perf_counter()
            run = subprocess.Popen(
                _command(options.input, killed, *tiles, "--scheduler", cluster.address),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            for _ in range(options.kills):
                try:
                    run.wait(chance.uniform(0.5, 1.5) * options.pause)
                    break
                except subprocess.TimeoutExpired:
                    print(
                        f"{time.perf_counter() - begin:6.1f} s: killed {cluster.kill(chance, 0.3)}",
                        flush=True,
                    )
            _, said = run.communicate()
            wall = time.perf_counter() - begin
        n_scheduler, n_workers = cluster.n_kills
        print(
            f"on a cluster, {n_scheduler} kills of the scheduler and {n_workers} of workers: {wall:.1f} s, "
            f"exit status {run.returncode}"
        )
        if run.returncode:
            print(said[-2000:])
            return 1
        different = differing(quiet, killed)
        n_tiles = json.loads((killed / "run.json").read_text())["n_tiles"]
        print(f"{n_tiles} tiles; files that differ: {', '.join(different) or 'none'}")
        return int(bool(different))


def differing(one: Path, other: Path) -> list[str]:
    """Name the files of two results that are not the same, byte for byte."""
    contents = [
        {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for folder in (one, other)
    ]
    names = (contents[0].keys() | contents[1].keys()) - _OF_THE_RUN
    return sorted(name for name in names if contents[0].get(name) != contents[1].get(name))


def _command(inputs: list[str], output: Path, *options: str) -> list[str]:
    return [
        *(sys.executable, "-m", "lidar_buildings.cli", "run", *inputs),
        *("--output", str(output), *options),
    ]


if __name__ == "__main__":
    sys.exit(main())

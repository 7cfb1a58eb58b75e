"""
What the scheduler and the command take for each tile, with stub tiles on workers that only wait.

    python -m bench.scale.scheduling [--workers 100] [--tasks 1000] [--seconds 1] [--bytes 8000]

The scheduler is a process of its own; all workers share one, each with a thread that sleeps for as long as a
tile takes. Tiles are as large as those that a run sends. Printed are processor seconds a tile of scheduler,
workers and command, how busy the workers were, and how many workers would keep the scheduler's core busy.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from concurrent.futures import wait

from bench.chain.child import adopt_orphans
from bench.common.process_tree import cpu_of, tree_of
from bench.scale.cluster import Cluster
from bench.scale.stub_workers import stub
from lidar_buildings.pipeline.tile_cluster import TileCluster

#: Workers that share a process would look at the stacks of all others each 10 ms.
_ENVIRONMENT = {**os.environ, "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
#: As many as a run has under way at a time.
_AHEAD = 1000


def main() -> None:
    """Run stub tiles and print what they took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument("--workers", type=int, default=100)
    parser.add_argument("--tasks", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--bytes", type=int, default=8000)
    options = parser.parse_args()
    adopt_orphans()
    with Cluster(0) as services:
        command = [sys.executable, "-m", "bench.scale.stub_workers", services.address, str(options.workers)]
        workers = subprocess.Popen(command, env=_ENVIRONMENT, stderr=subprocess.DEVNULL)
        try:
            with TileCluster(scheduler=services.address) as cluster:
                while cluster.n_workers < options.workers:
                    time.sleep(0.1)
                pids = {"scheduler": services.pids[0], "workers": workers.pid}
                before = {name: cpu_of(tree_of(pid)) for name, pid in pids.items()}
                own, began = time.process_time(), time.perf_counter()
                _run(cluster, options.tasks, (options.seconds, bytes(options.bytes)))
                wall = time.perf_counter() - began
                spent = {name: cpu_of(tree_of(pid)) - before[name] for name, pid in pids.items()}
                spent["command"] = time.process_time() - own
        finally:
            workers.kill()
            workers.wait()
    each = {name: 1000 * seconds / options.tasks for name, seconds in spent.items()}
    busy = options.tasks * options.seconds / (options.workers * wall)
    share = spent["scheduler"] / (options.tasks * options.seconds)
    told = ", ".join(f"{name} {milliseconds:.2f}" for name, milliseconds in each.items())
    most = 1000 * options.seconds / each["scheduler"]
    print(f"{options.tasks} tiles of {options.seconds} s on {options.workers} workers: {wall:.1f} s,")
    print(f"in {busy:.0%} of which workers were busy; processor ms a tile: {told};")
    print(f"the scheduler takes {share:.2%} of what tiles take: {most:.0f} workers would keep a core busy")


def _run(cluster: TileCluster, n_tasks: int, job: tuple[float, bytes]) -> None:
    """Submit tasks as a run does, some ahead."""
    waiting = set()
    for _ in range(n_tasks):
        waiting.add(cluster.submit(stub, job))
        if len(waiting) >= _AHEAD:
            waiting = wait(waiting, return_when="FIRST_COMPLETED").not_done
    wait(waiting)


if __name__ == "__main__":
    main()

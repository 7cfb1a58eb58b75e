"""
Many workers of dask in one process, for tasks that only take time.

    python -m bench.scale.stub_workers SCHEDULER N
"""

from __future__ import annotations

import asyncio
import sys
import time

from distributed import Worker


def stub(job: tuple[float, bytes]) -> bytes:
    """Take as long as a tile does, and answer as little."""
    time.sleep(job[0])
    return job[1][:200]


async def _serve(scheduler: str, n_workers: int) -> None:
    workers = [await Worker(scheduler, nthreads=1, memory_limit=0) for _ in range(n_workers)]
    await asyncio.gather(*(one.finished() for one in workers))


if __name__ == "__main__":
    asyncio.run(_serve(sys.argv[1], int(sys.argv[2])))

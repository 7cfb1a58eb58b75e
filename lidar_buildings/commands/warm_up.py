"""The command ``lidar-buildings warm-up``: compile all loops, of processes started together in one."""

from __future__ import annotations

import argparse
import fcntl
import gc
import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed

from lidar_buildings.core import kernel_cache
from lidar_buildings.core.kernel_cache import TEXT


def warm_up_command(options: argparse.Namespace) -> int:
    """Compile what is not compiled yet; say how far it is, where it is kept and how long it took."""
    started = time.perf_counter()
    compile_loops()
    if not options.quiet:
        print(f"compiled loops: {kernel_cache.kernel_folder()} ({time.perf_counter() - started:.1f} s)")
    return 0


def compile_loops() -> None:
    """Compile every loop that is not compiled yet, and say how far it is."""
    complete = kernel_cache.marker()
    if complete is not None and not complete.exists():
        complete.parent.mkdir(parents=True, exist_ok=True)
        with complete.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not complete.exists():
                _call_all()
                complete.touch()
                kernel_cache.remove_earlier_folders()


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _call_all() -> None:
    from lidar_buildings.commands.stage_calls import CALLS
    from lidar_buildings.core.neighbours.parallel import n_cores

    _say(f"{TEXT}: 0 of {len(CALLS)}")
    # forked: what is imported once need not be imported again
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(n_cores(), mp_context=context, initializer=_compile_alone) as pool:
        calls = [pool.submit(call) for call in CALLS]
        for done, call in enumerate(as_completed(calls), start=1):
            call.result()
            _say(f"{TEXT}: {done} of {len(CALLS)}")


def _compile_alone() -> None:
    from lidar_buildings.core.freed_memory import keep_freed_memory
    from lidar_buildings.core.neighbours.parallel import work_alone

    gc.disable()  # a tenth of the compiler's time goes into it
    keep_freed_memory()
    work_alone()

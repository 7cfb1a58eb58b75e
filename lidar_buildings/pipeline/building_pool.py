"""
Tiles and their buildings shared out over processes: most steps hold the interpreter's lock.

Each process is a `concurrent.futures.ProcessPoolExecutor` of its own, so that one that ends takes no other
work with it. Load compiled code first (`lidar_buildings.commands.stage_calls.load_stages`), open the pool
next, and start threads last: processes are forked while this one has a single thread, and have all that it
has loaded. One that takes the place of another is spawned, which loads everything anew.

`BuildingPool.submit` takes a whole tile's work, `map_buildings` shares a tile's buildings out in batches.
Both may be called from any thread of the process that opened the pool, and from no worker.
"""

from __future__ import annotations

import logging
import mmap
import multiprocessing
import os
import pickle
import queue
import shutil
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from logging.handlers import QueueHandler
from multiprocessing.shared_memory import SharedMemory
from typing import Any, NamedTuple, TypeVar

from lidar_buildings.core.freed_memory import give_memory_back
from lidar_buildings.core.neighbours.parallel import is_single_thread, n_cores, share_cores

_log = logging.getLogger(__name__)

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

#: So many processes may end at a task until it is given up.
_MOST_ENDS = 2
#: Free memory of a process goes back to the system so often: what the largest tile left would stay else [s].
_MEMORY_PERIOD = 10.0
#: Arrays that together are larger go through shared memory, not through the executor's pipe, which takes
#: twenty times as long [bytes]; and where that lies on Linux, which containers often keep small.
_LARGE = 262_144
_SHARED_MEMORY = "/dev/shm"
#: What a building costs beside its points, in points.
_LEAST_SIZE = 400
#: Work that is not worth the way to a process and back, in points.
_LITTLE = 4000
#: Batches for each process: small enough to end together, large enough to cost little to send.
_BATCHES_A_WORKER = 6


class WorkerLostError(RuntimeError):
    """Processes ended at a task, or its pool was closed."""


class BuildingPool:
    """
    Processes that wait for tiles and buildings; a context manager.

    One for each core that this process may use if no number is given; with fewer than two there are no
    processes, and everything is done here, as after `close`.
    """

    def __init__(self, n_workers: int | None = None) -> None:
        n_workers = n_cores() if n_workers is None else n_workers
        self.n_workers = n_workers if n_workers > 1 else 0
        self._idle: queue.LifoQueue[_Worker] = queue.LifoQueue()
        self._workers: list[_Worker] = []
        self._threads: ThreadPoolExecutor | None = None
        if not self.n_workers:
            return
        SharedMemory(create=True, size=1).unlink()  # its tracker is one process for all that are forked now
        busy = memoryview(mmap.mmap(-1, n_workers))
        is_alone = is_single_thread()
        for number in range(n_workers):
            self._workers.append(_Worker(busy[number : number + 1], busy))
            self._workers[-1].start("fork" if is_alone else "spawn")
            self._idle.put(self._workers[-1])
        self._threads = ThreadPoolExecutor(n_workers, "buildings")

    def __enter__(self) -> BuildingPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the processes, also those that are at work; `submit` and `map_buildings` go on without them."""
        threads, self._threads, self.n_workers = self._threads, None, 0
        if threads is not None:
            threads.shutdown(wait=False, cancel_futures=True)
            for worker in self._workers:
                worker.end()
            threads.shutdown()

    def submit(self, function: Callable[..., _Result], *arguments: object) -> Future[_Result]:
        """
        Call a function, as for a tile, in the next free process; here and at once without any.

        The function stands at the top of a module. The future raises `WorkerLostError` if two processes ended
        at it.
        """
        return self._submit(function, arguments, _MOST_ENDS)

    def map(self, function: Callable[[_Job], _Result], jobs: Iterable[_Job]) -> Iterator[_Result]:
        """Call a function for each of some jobs, several at a time, and yield the results in their order."""
        if not self.n_workers:
            return map(function, jobs)
        answers = [self.submit(function, job) for job in jobs]
        return (answer.result() for answer in answers)

    def _submit(
        self, function: Callable[..., _Result], arguments: Sequence[object], n_tries: int
    ) -> Future[_Result]:
        if self._threads is not None:
            return self._threads.submit(self._call, function, arguments, n_tries)
        answer: Future[_Result] = Future()
        try:
            answer.set_result(function(*arguments))
        except Exception as error:
            answer.set_exception(error)
        return answer

    def _call(self, function: Callable[..., _Result], arguments: Sequence[object], n_tries: int) -> _Result:
        """Let a free process call a function; one that ends is replaced, and the next one tries again."""
        for _ in range(n_tries):
            worker = self._idle.get()
            try:
                return worker.call(function, arguments)
            except BrokenProcessPool:
                if self._threads is None:
                    raise WorkerLostError("the pool was closed") from None
                _log.warning("a process ended in the middle of its work")
                worker.start("spawn")
            finally:
                self._idle.put(worker)
        raise WorkerLostError(f"{'two processes' if n_tries > 1 else 'a process'} ended at it")


class _Worker:
    """A process, and whether it is at work: that is a byte which all processes see."""

    def __init__(self, is_busy: memoryview, all_busy: memoryview) -> None:
        self._is_busy, self._all_busy = is_busy, all_busy
        self._executor: ProcessPoolExecutor | None = None
        self._pid: Future[int] | None = None

    def start(self, method: str) -> None:
        """Start the process, in the place of an earlier one."""
        if self._executor is not None:
            self._executor.shutdown()
        busy = self._all_busy if method == "fork" else None
        context = multiprocessing.get_context(method)
        self._executor = ProcessPoolExecutor(1, context, initializer=_begin, initargs=(busy,))
        with warnings.catch_warnings():
            # Python 3.12 counts the threads of executors that were started before, which only wait
            warnings.simplefilter("ignore", DeprecationWarning)
            self._pid = self._executor.submit(os.getpid)

    def call(self, function: Callable[..., _Result], arguments: Sequence[object]) -> _Result:
        """Call a function; BrokenProcessPool if the process ends."""
        self._is_busy[0] = 1
        sent = _packed((function, arguments))
        try:
            result, records = _unpacked(self._executor.submit(_work, sent).result())
        finally:
            self._is_busy[0] = 0
            _discard(sent)
        for record in records:
            logging.getLogger(record.name).handle(record)
        return result  # type: ignore[no-any-return]

    def end(self) -> None:
        """End the process at once."""
        with suppress(BrokenProcessPool, ProcessLookupError):
            os.kill(self._pid.result(), signal.SIGKILL)
        self._executor.shutdown()


def _begin(busy: memoryview | None) -> None:
    """Prepare a process, which ends with the one that started it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    share_cores(lambda: busy is not None and 2 * sum(busy) <= n_cores())
    threading.Thread(target=_watch, daemon=True).start()


def _watch() -> None:
    """Give free memory back now and then, and end this process when its parent has ended."""
    parent = multiprocessing.parent_process()
    while parent is not None and parent.is_alive():
        parent.join(_MEMORY_PERIOD)
        give_memory_back()
    os._exit(1)


def _work(sent: _Packed) -> _Packed:
    """Call a function in a process; return its result, and what was logged, as text."""
    records: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    logging.getLogger().handlers = [QueueHandler(records)]
    function, arguments = _unpacked(sent)
    result = function(*arguments)
    return _packed((result, [records.get() for _ in range(records.qsize())]))


class _Packed(NamedTuple):
    """Something that is pickled, its arrays beside it in shared memory if they are large."""

    pickled: bytes
    memory: str = ""  #: name of the memory, empty without any
    sizes: tuple[int, ...] = ()  #: of the arrays, one after the other [bytes]


def _packed(content: object) -> _Packed:
    arrays: list[memoryview] = []
    pickled = pickle.dumps(content, 5, buffer_callback=lambda one: arrays.append(one.raw()))
    sizes = tuple(one.nbytes for one in arrays)
    if sum(sizes) < _LARGE or not _has_room(sum(sizes)):
        return _Packed(pickle.dumps(content, 5) if arrays else pickled)
    memory, begin = SharedMemory(create=True, size=sum(sizes)), 0
    for one in arrays:
        memory.buf[begin : begin + one.nbytes] = one
        begin += one.nbytes
    memory.close()
    return _Packed(pickled, memory.name, sizes)


def _has_room(size: int) -> bool:
    """Whether so much fits into shared memory: a process that writes beyond is ended by the system."""
    return not os.path.isdir(_SHARED_MEMORY) or shutil.disk_usage(_SHARED_MEMORY).free > 2 * size


def _unpacked(packed: _Packed) -> Any:
    if not packed.memory:
        return pickle.loads(packed.pickled)
    memory, begin, arrays = SharedMemory(packed.memory), 0, []
    for size in packed.sizes:
        arrays.append(bytearray(memory.buf[begin : begin + size]))
        begin += size
    memory.close()
    memory.unlink()
    return pickle.loads(packed.pickled, buffers=arrays)


def _discard(packed: _Packed) -> None:
    """Free the shared memory of something that may not have been unpacked."""
    if packed.memory:
        with suppress(FileNotFoundError):
            memory = SharedMemory(packed.memory)
            memory.close()
            memory.unlink()


def map_buildings(
    pool: BuildingPool | None,
    jobs: Sequence[tuple[int, Callable[[], _Result]]],
    sizes: Sequence[int],
    failed: Callable[[int, str], _Result],
    problem: str,
) -> list[_Result]:
    """
    Make the calls of many buildings, pairs of building id and call, and return the results in their order.

    With a pool they are shared out in batches, the largest first; `sizes` are the buildings' numbers of
    points. A call is a `functools.partial` of a function at the top of a module. ``failed(k, reason)`` stands
    in for result `k` where the call raises an exception, whose `problem`, in a few words, is logged, or where
    two processes ended; a building that was merely in a batch with it is done again.
    """
    weights = [size + _LEAST_SIZE for size in sizes]
    results: dict[int, _Result | _Failure] = {}
    if pool is None or not pool.n_workers or len(jobs) < 2 or sum(weights) < _LITTLE:
        batches = []
        results.update(enumerate(_attempted(jobs, problem)))
    else:
        batches = _batches(weights, pool.n_workers)
    answers = [pool._submit(_attempted, ([jobs[k] for k in batch], problem), 1) for batch in batches]
    again: list[int] = []
    for batch, answer in zip(batches, answers, strict=True):
        try:
            results.update(zip(batch, answer.result(), strict=True))
        except WorkerLostError:
            again += batch
    for k in again:
        try:
            results[k] = pool._submit(_attempted, (jobs[k : k + 1], problem), 1).result()[0]
        except WorkerLostError:
            results[k] = _Failure("two processes ended at it")
    found = [results[k] for k in range(len(jobs))]
    return [failed(k, str(one)) if isinstance(one, _Failure) else one for k, one in enumerate(found)]


class _Failure(str):
    """Why a building has no result."""


def _attempted(jobs: Sequence[tuple[int, Callable[[], Any]]], problem: str) -> list[Any]:
    results: list[Any] = []
    for building_id, call in jobs:
        try:
            results.append(call())
        except Exception as error:
            _log.exception("building %d: %s", building_id, problem)
            results.append(_Failure(f"unexpected error: {error!r}"))
    return results


def _batches(weights: Sequence[int], n_workers: int) -> list[list[int]]:
    enough = sum(weights) / (n_workers * _BATCHES_A_WORKER)
    batches: list[list[int]] = []
    filled = enough
    for k in sorted(range(len(weights)), key=lambda k: -weights[k]):
        if filled >= enough:
            batches.append([])
            filled = 0.0
        batches[-1].append(k)
        filled += weights[k]
    return batches

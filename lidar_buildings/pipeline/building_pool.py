"""
Buildings shared out over processes: their steps hold the interpreter's lock, so that threads bring little.

Open a `BuildingPool` once a run, before any thread is started, and hand it to `build_models` and the like;
these call `BuildingPool.map`. Not `concurrent.futures`: there one worker that dies takes all work with it.
"""

from __future__ import annotations

import logging
import pickle
import queue
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, TypeVar

from lidar_buildings.core.neighbours.parallel import n_cores
from lidar_buildings.pipeline.pool_workers import end, start_workers

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

_log = logging.getLogger(__name__)

#: What a building costs beside its points, in points.
_LEAST_SIZE = 400
#: Work that is not worth the way to a process and back, in points.
_LITTLE = 4000
#: Batches for each process: small enough to end together, large enough to cost little to send.
_BATCHES_A_WORKER = 6


class WorkerLostError(RuntimeError):
    """A process ended in the middle of its work."""


class BuildingPool:
    """
    Processes that wait for buildings; a context manager.

    Parameters
    ----------
    n_workers : int, optional
        One for each core that this process may use if not given. With fewer than two there are no processes,
        and `map` does everything itself.
    prepare : callable, optional
        Called in the first process before there are others, as for compiled code to be loaded.

    Notes
    -----
    Where the platform is Linux and this process has a single thread of Python's, one process is forked,
    which costs some milliseconds. It prepares and forks the others, so that compiled code is loaded once,
    while this process goes on. Else processes are spawned, and each imports its modules anew. So: import
    first, open the pool next, start threads last. Several threads may call `map` at the same time.
    """

    def __init__(self, n_workers: int | None = None, prepare: Callable[[], object] | None = None) -> None:
        n_workers = n_cores() if n_workers is None else n_workers
        self._processes, self._links = start_workers(n_workers, prepare) if n_workers > 1 else ([], [])
        self._tasks: queue.SimpleQueue[tuple[bytes, Future[bytes]] | None] = queue.SimpleQueue()
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._n_alive = len(self._links)

    def __enter__(self) -> BuildingPool:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the processes; `map` goes on without them."""
        with self._lock:
            links, self._links, self._n_alive = self._links, [], 0
        for process in self._processes:
            end(process)
        for link in links if not self._threads else ():
            link.close()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads:
            thread.join()

    def map(
        self,
        function: Callable[[_Job], _Result],
        jobs: Sequence[_Job],
        sizes: Sequence[int],
        lost: Callable[[_Job], _Result],
    ) -> list[_Result]:
        """
        Call a function for each of many buildings, the largest first, and return the results in their order.

        Parameters
        ----------
        function : callable
            At the top of a module; its result depends on the job alone.
        jobs : sequence
            What it is called with, one per building.
        sizes : sequence of int
            Number of points of each building.
        lost : callable
            ``lost(job)`` stands in for the result of a building during which two processes ended. One that
            was merely in a batch with it is done again.

        Raises
        ------
        RuntimeError
            If the function raises an exception.
        """
        weights = [size + _LEAST_SIZE for size in sizes]
        if not self._n_alive or len(jobs) < 2 or sum(weights) < _LITTLE:
            return [function(job) for job in jobs]
        batches = _batches(weights, self._n_alive)
        answers = [self._send(function, [(k, jobs[k]) for k in batch]) for batch in batches]
        results: dict[int, _Result] = {}
        again: list[int] = []
        for batch, answer in zip(batches, answers, strict=True):
            try:
                results |= _received(answer)
            except WorkerLostError:
                again += batch
        for k in again:
            results[k] = self._done_alone(function, k, jobs[k], lost)
        return [results[k] for k in range(len(jobs))]

    def share(self, function: Callable[[_Job], _Result], jobs: Sequence[_Job]) -> list[_Result]:
        """
        Call a function for each of a few large jobs, as `map` does in its own process.

        Raises
        ------
        RuntimeError
            If the function raises an exception, or two processes ended while they did the same job.
        """

        def lost(_: _Job) -> _Result:
            raise WorkerLostError("two processes ended while they did the same job")

        return self.map(function, jobs, [_LITTLE] * len(jobs), lost)

    def _done_alone(
        self, function: Callable[[_Job], _Result], number: int, job: _Job, lost: Callable[[_Job], _Result]
    ) -> _Result:
        """Do a building again whose process ended, in another one as long as there is one."""
        if not self._n_alive:
            return function(job)
        try:
            result: _Result = _received(self._send(function, [(number, job)]))[number]
        except WorkerLostError:
            return lost(job)
        return result

    def _send(self, function: Callable[..., Any], batch: list[tuple[int, Any]]) -> Future[bytes]:
        """Queue a batch for the next free process."""
        answer: Future[bytes] = Future()
        message = pickle.dumps((function, batch), protocol=5)
        with self._lock:
            if not self._n_alive:
                answer.set_exception(WorkerLostError("no process is left"))
                return answer
            if not self._threads:
                self._threads = [
                    threading.Thread(target=self._serve, args=(link,), daemon=True) for link in self._links
                ]
                for thread in self._threads:
                    thread.start()
            self._tasks.put((message, answer))
        return answer

    def _serve(self, link: Connection) -> None:
        """Hand one process its work as long as it lives."""
        while (task := self._tasks.get()) is not None:
            message, answer = task
            try:
                link.send_bytes(message)
                answer.set_result(link.recv_bytes())
            except (OSError, EOFError):
                self._lose(answer)
                break
        link.close()

    def _lose(self, answer: Future[bytes]) -> None:
        """Note that a process has ended; without any nobody must wait for work."""
        error = WorkerLostError("a process ended in the middle of its work")
        with self._lock:
            if self._links:  # not closed
                _log.warning("%s", error)
                self._n_alive -= 1
            answer.set_exception(error)
            while not self._n_alive and not self._tasks.empty():
                task = self._tasks.get()
                if task is not None:
                    task[1].set_exception(error)


def map_buildings(
    pool: BuildingPool | None,
    function: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    sizes: Sequence[int],
    lost: Callable[[_Job], _Result],
) -> list[_Result]:
    """Do as `BuildingPool.map`, or without a pool everything here."""
    return [function(job) for job in jobs] if pool is None else pool.map(function, jobs, sizes, lost)


def _received(answer: Future[bytes]) -> dict[int, Any]:
    """Return a batch's results by number, and log what the process had to say."""
    results, error, records = pickle.loads(answer.result())
    for record in records:
        logging.getLogger(record.name).handle(record)
    if error:
        raise RuntimeError(f"in a process of buildings:\n{error}")
    return dict(results)


def _batches(weights: Sequence[int], n_workers: int) -> list[list[int]]:
    """Divide buildings into batches by their weights, the heaviest first."""
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

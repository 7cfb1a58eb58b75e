"""
Tiles and their buildings shared out over processes: most steps hold the interpreter's lock.

Open a `BuildingPool` once a run, before any thread is started. Whole tiles are handed to `submit`; what works
on a tile, in a process or here, shares its buildings by `map`, so that no process waits while another one has
much to do. Not `concurrent.futures`: there one worker that dies takes all work with it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from lidar_buildings.core.neighbours.parallel import n_cores
from lidar_buildings.pipeline.agenda import Agenda, Task
from lidar_buildings.pipeline.parcels import Parcel, packed, receive, send, unpacked
from lidar_buildings.pipeline.pool_workers import DO, SHARE, SHARED, end, start_workers
from lidar_buildings.pipeline.sharing import Sharing, Work, called

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

_log = logging.getLogger(__name__)


class BuildingPool(Sharing):
    """
    Processes that wait for tiles and buildings; a context manager.

    One for each core that this process may use if no number is given; with fewer than two there are no
    processes, and everything is done here. `prepare` is called in the first process before there are others,
    as for compiled code to be loaded.

    Where this process has a single thread of Python's, one process is forked, which costs some milliseconds.
    It prepares and forks the others, so that compiled code is loaded once, while this process goes on. Else
    processes are spawned, and each imports its modules anew. So: import first, open the pool next, start
    threads last. Several threads may call `map` at the same time.
    """

    def __init__(self, n_workers: int | None = None, prepare: Callable[[], object] | None = None) -> None:
        n_workers = n_cores() if n_workers is None else n_workers
        self._processes, self._links = start_workers(n_workers, prepare) if n_workers > 1 else ([], [])
        self._agenda = Agenda()
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self.n_alive = len(self._links)

    def __enter__(self) -> BuildingPool:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the processes; `map` and `submit` go on without them."""
        with self._lock:
            links, self._links, self.n_alive = self._links, [], 0
        for task in self._agenda.close():
            task.lose()
        for process in self._processes:
            end(process)
        for link in links if not self._threads else ():
            link.close()
        for thread in self._threads:
            thread.join()

    def submit(
        self, function: Callable[..., _Result], *arguments: object, shares: bool = False
    ) -> Future[_Result]:
        """
        Call a function, as for a tile, in the next free process; here and at once without any.

        The function stands at the top of a module; if it `shares` it takes a `pool`, over which it shares a
        tile's buildings. What waits when the last process has ended is done here. The future raises
        `WorkerLostError` if two processes ended at it, or the last one did.
        """
        work = function, arguments, shares
        if self.n_alive:
            task = Task(packed(work), is_tile=True)
            if self._put([task]):
                return task.answer
        answer: Future[_Result] = Future()
        _do_here(work, answer)
        return answer

    def call(self, function: Callable[..., _Result], *arguments: object, shares: bool = False) -> _Result:
        """
        Do as `submit`, and wait for the result.

        For threads that share an interpreter's lock: the others go on meanwhile.
        """
        return self.submit(function, *arguments, shares=shares).result()

    def call_each(self, function: Callable[[_Job], _Result], jobs: Sequence[_Job]) -> Iterator[_Result]:
        """Do as `call` for each of some jobs, several at a time, and yield the results in their order."""
        if not self.n_alive:
            yield from map(function, jobs)
        else:
            for answer in [self.submit(function, job) for job in jobs]:
                yield answer.result()

    def _exchange(self, messages: Sequence[Parcel]) -> list[Parcel | None]:
        tasks = [Task(message) for message in messages]
        return _answers(tasks) if self._put(tasks) else [None] * len(tasks)

    def _put(self, tasks: Sequence[Task]) -> bool:
        """Queue tasks for the processes; False if there is none."""
        with self._lock:
            if not self.n_alive:
                return False
            if not self._threads:
                self._threads = [
                    threading.Thread(target=self._serve, args=(link,), daemon=True) for link in self._links
                ]
                for thread in self._threads:
                    thread.start()
            self._agenda.put(tasks)
        return True

    def _serve(self, link: Connection) -> None:
        """Hand one process its work as long as it lives."""
        held: list[Task] = []
        with suppress(OSError, EOFError):
            while self._do_next(link, held):
                pass
        if held:
            self._lose(held)
        link.close()

    def _do_next(self, link: Connection, held: list[Task]) -> bool:
        """Let a process do what comes next, of which nothing is kept while the one after it is waited for."""
        if (task := self._agenda.take()) is None:
            return False
        self._do(link, task, held)
        return True

    def _do(self, link: Connection, task: Task, held: list[Task]) -> None:
        """Let a process do a task, and while it waits for its share of others what there is."""
        held.append(task)
        link.send((DO,))
        send(link, task.message)
        while (reply := link.recv())[0] == SHARE:
            shared = [Task(message) for message in reply[1]]
            self._agenda.put(shared)
            while (batch := self._agenda.take_batch(shared)) is not None:
                self._do(link, batch, held)
            answers = _answers(shared)
            link.send((SHARED, [answer is not None for answer in answers]))
            for answer in filter(None, answers):
                send(link, answer)
        answer = receive(link)
        held.pop()
        self._agenda.finish(task, answer)

    def _lose(self, held: Sequence[Task]) -> None:
        """Note that a process has ended at its tasks; without any nobody must wait for work."""
        with self._lock:
            if self._links:  # not closed
                _log.warning("a process ended in the middle of its work")
                self.n_alive -= 1
        for task in held:
            self._agenda.lose(task)
        if not self.n_alive:
            for task in self._agenda.close():
                if task.is_tile and not task.n_tries and self._links:
                    _do_here(unpacked(task.message), task.answer)
                else:
                    task.lose()


def _do_here(work: Work, answer: Future[Any]) -> None:
    """Answer a call without a process."""
    try:
        answer.set_result(called(work, None))
    except Exception as error:
        answer.set_exception(error)


def _answers(tasks: Sequence[Task]) -> list[Parcel | None]:
    """Wait for tasks; return their answers, None for those whose process ended."""
    return [None if task.answer.exception() else task.answer.result() for task in tasks]

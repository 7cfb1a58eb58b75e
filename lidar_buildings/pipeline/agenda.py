"""What waits for a free process: batches of buildings first, then whole tiles."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Collection, Iterable
from concurrent.futures import Future
from typing import Any

from lidar_buildings.pipeline.parcels import Parcel
from lidar_buildings.pipeline.sharing import received


class WorkerLostError(RuntimeError):
    """A process ended in the middle of its work, or before another one could begin it."""


class Task:
    """
    Work for one process.

    `is_tile`: a whole tile, one whose process ends, is done once more by another one. Its answer is read
    here, that of a batch by the one that shares it.
    """

    def __init__(self, message: Parcel, *, is_tile: bool = False) -> None:
        self.message = message
        self.is_tile = is_tile
        self.answer: Future[Any] = Future()
        self.n_tries = 0

    def lose(self) -> None:
        """Let it have no result."""
        self.answer.set_exception(WorkerLostError("a process ended in the middle of its work"))


class Agenda:
    """Tasks that wait; any number of threads put, take and finish them."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._batches: deque[Task] = deque()
        self._tiles: deque[Task] = deque()
        self._is_closed = False

    def put(self, tasks: Iterable[Task]) -> None:
        """Add tasks."""
        with self._changed:
            for task in tasks:
                if self._is_closed:
                    task.lose()
                else:
                    (self._tiles if task.is_tile else self._batches).append(task)
            self._changed.notify_all()

    def take(self) -> Task | None:
        """Wait for a task and return it; None when the agenda is closed."""
        with self._changed:
            while not self._is_closed:
                if self._batches or self._tiles:
                    return (self._batches or self._tiles).popleft()
                self._changed.wait()
        return None

    def take_batch(self, until: Collection[Task]) -> Task | None:
        """Wait for a batch of buildings and return it; None as soon as some tasks are done."""
        with self._changed:
            while not self._is_closed and not all(task.answer.done() for task in until):
                if self._batches:
                    return self._batches.popleft()
                self._changed.wait()
        return None

    def finish(self, task: Task, reply: Parcel) -> None:
        """Take a process's answer to a task."""
        try:
            task.answer.set_result(received(reply) if task.is_tile else reply)
        except Exception as error:
            task.answer.set_exception(error)
        with self._changed:
            self._changed.notify_all()

    def lose(self, task: Task) -> None:
        """Note that a process ended at a task."""
        task.n_tries += 1
        with self._changed:
            if task.is_tile and task.n_tries == 1 and not self._is_closed:
                self._tiles.appendleft(task)
            else:
                task.lose()
            self._changed.notify_all()

    def close(self) -> list[Task]:
        """Give out nothing any more; return what waits."""
        with self._changed:
            self._is_closed = True
            left = [*self._batches, *self._tiles]
            self._batches.clear()
            self._tiles.clear()
            self._changed.notify_all()
        return left

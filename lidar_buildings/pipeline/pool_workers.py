"""The processes of a `BuildingPool`: how they start, what they do, how they end."""

from __future__ import annotations

import contextlib
import gc
import logging
import mmap
import multiprocessing
import os
import signal
import threading
import traceback
import warnings
from collections.abc import Callable, Sequence
from logging.handlers import QueueHandler
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import SimpleQueue

from lidar_buildings.core.freed_memory import give_memory_back, rare_collection
from lidar_buildings.core.neighbours.parallel import n_cores, n_waiting_threads, share_cores
from lidar_buildings.pipeline.parcels import Parcel, packed, receive, send, unpacked
from lidar_buildings.pipeline.sharing import Sharing, called

_log = logging.getLogger(__name__)

#: What a process is told: do this, or here is what became of what you shared;
#: and what it answers: share this out, or here is the result.
DO, SHARED = "do", "shared"
SHARE, DONE = "share", "done"
#: Free memory goes back to the system so often, and when nothing has come for so long [s]: what the largest
#: tile left would stay else.
_MEMORY_PERIOD, _IDLE = 10.0, 0.5


def start_workers(n: int, prepare: Callable[[], object] | None) -> tuple[list[BaseProcess], list[Connection]]:
    """Start processes, and return those that are this one's own, and the near ends of the pipes to all."""
    is_forked = threading.active_count() - n_waiting_threads() == 1
    context = multiprocessing.get_context("fork" if is_forked else "spawn")
    pipes = [multiprocessing.Pipe() for _ in range(n)]
    near, far = [list(ends) for ends in zip(*pipes, strict=True)]
    # A forked process has the near ends as well: held open, they would let all outlive this process.
    calls = [(_work_first, (far, near, prepare))] if is_forked else [(_work, (link, n)) for link in far]
    processes: list[BaseProcess] = []
    for target, arguments in calls:
        process = context.Process(target=target, args=arguments, daemon=True, name="buildings")  # type: ignore[attr-defined]
        with warnings.catch_warnings():
            # Python 3.12 counts the threads of numpy's BLAS, which know of forks.
            warnings.simplefilter("ignore", DeprecationWarning)
            process.start()
        processes.append(process)
    for link in far:
        link.close()
    return processes, near


def end(process: BaseProcess) -> None:
    """End a process and those that it has forked, which are of its group."""
    if process.pid:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
    process.terminate()
    process.join()


def _work_first(
    links: list[Connection], inherited: list[Connection], prepare: Callable[[], object] | None
) -> None:
    """Prepare, fork the other processes, and work as the first."""
    os.setpgid(0, 0)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for other in inherited:
        other.close()
    busy = memoryview(mmap.mmap(-1, len(links)))  # of each process: 1 while it works
    if prepare is not None:
        gc.disable()
        try:
            prepare()
        except Exception:
            _log.exception("processes of buildings were not prepared")
        gc.enable()
    gc.freeze()
    number = 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for other in range(1, len(links)):
            if not os.fork():
                number = other
                break
    mine = links.pop(number)
    for link in links:
        link.close()
    share_cores(lambda: 2 * sum(busy) <= n_cores())
    _work(mine, len(busy), busy[number:])
    os._exit(0)


def _work(link: Connection, n_workers: int, busy: memoryview | None = None) -> None:
    """Do what there is until the other end is closed, and say in the first of some bytes when."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if busy is None:  # nothing tells what the others do
        share_cores(lambda: False)
        busy = memoryview(bytearray(1))
    worker = _Worker(link, n_workers)
    with contextlib.suppress(EOFError, OSError), rare_collection():
        while True:
            if not link.poll(_IDLE):
                give_memory_back()
            link.recv()
            busy[0] = 1
            answer = worker.done(receive(link))
            busy[0] = 0  # before anybody may ask
            worker.tell(answer)
            give_memory_back(_MEMORY_PERIOD)


class _Worker(Sharing):
    """Answers what a process is told, and lets others share what it has to do."""

    def __init__(self, link: Connection, n_workers: int) -> None:
        self._link = link
        self.n_alive = n_workers  # at the start
        self._records: SimpleQueue[logging.LogRecord] = SimpleQueue()
        logging.getLogger().handlers = [QueueHandler(self._records)]

    def done(self, message: Parcel) -> Parcel:
        """Do a tile or a batch of buildings, and return the result, or what went wrong."""
        try:
            return packed((called(unpacked(message), self), None, "", self._logged()))
        except Exception as error:
            there, records = traceback.format_exc(), self._logged()
            try:
                return packed((None, error, there, records))
            except Exception:  # of something that cannot be sent
                return packed((None, RuntimeError(str(error)), there, records))

    def tell(self, answer: Parcel) -> None:
        """Send what was done."""
        self._link.send((DONE,))
        send(self._link, answer)

    def _logged(self) -> list[logging.LogRecord]:
        """Return what was logged since the last time, as text."""
        return [self._records.get() for _ in range(self._records.qsize())]

    def _exchange(self, messages: Sequence[Parcel]) -> list[Parcel | None]:
        """Hand messages to all processes; answer those that come back to this one."""
        self._link.send((SHARE, messages))
        while (told := self._link.recv())[0] == DO:
            self.tell(self.done(receive(self._link)))
        return [receive(self._link) if is_there else None for is_there in told[1]]

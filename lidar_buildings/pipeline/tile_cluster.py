"""
Tiles done by workers of dask.distributed, of this machine or of many, in the place of a `BuildingPool`.

Nothing but names and counts goes through the scheduler: workers read and write files that all of them see.
Dask does again what a worker had that ended, and gives up what ends too many of them (`KilledWorker`). A
scheduler that ends is waited for, and gets again what was not done. Whatever else dies, the same command
goes on: results are files of one name, which appear when they are complete.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from threading import Lock
from typing import Any, TypeVar

from distributed import Client, LocalCluster, WorkerPlugin
from distributed import Future as Sent

from lidar_buildings import __version__
from lidar_buildings.core.freed_memory import keep_freed_memory
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.neighbours.parallel import share_cores

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

#: How long a scheduler and its workers are waited for at the start [s].
_AT_START = 30.0
#: How often a scheduler that was lost is looked for, for so long each time: ten minutes in all.
_MOST_TRIES = 20
_LOGGERS = ("distributed", *(f"distributed.{name}" for name in ("client", "scheduler", "nanny", "worker")))


class ClusterError(LidarBuildingsError):
    """A cluster that cannot be used: one line saying why and what to do."""


class TileCluster:
    """
    Workers that wait for tiles; a context manager.

    So many are started on this machine, each with a thread, or there are some already at a scheduler's
    address. `dashboard` is where dask shows what they do. ClusterError if the scheduler cannot be reached, or
    a worker has another version of this package.
    """

    def __init__(self, n_workers: int = 0, scheduler: str = "") -> None:
        for name in _LOGGERS:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what it means for a run is said here
        self._local: LocalCluster | None = None
        if n_workers:
            self._local = LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=n_workers,
                threads_per_worker=1,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
            )
        self._address: str = self._local.scheduler_address if self._local else scheduler
        self._is_closed, self._lock = False, Lock()
        try:
            self._client = _client_of(self._address)
        except BaseException:
            if self._local is not None:
                self._local.close()
            raise
        self.dashboard: str = self._client.dashboard_link

    def __enter__(self) -> TileCluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give up what is not done, and end the workers that were started here."""
        self._is_closed = True
        self._client.close()
        if self._local is not None:
            self._local.close()

    def submit(self, function: Callable[..., _Result], *arguments: object) -> Future[_Result]:
        """
        Call a function on a worker.

        The function stands at the top of a module; it may be called more than once, and at the same time. The
        answer is a ClusterError if the scheduler is lost and does not return.
        """
        answer: Future[_Result] = Future()
        self._send(answer, partial(function, *arguments))
        return answer

    def _send(self, answer: Future[_Result], work: Callable[[], _Result]) -> None:
        client = self._client
        try:
            sent = client.submit(work, pure=False)
        except Exception as error:
            self._fail(error, answer, work, client)
        else:
            sent.add_done_callback(lambda done: self._take(done, answer, work, client))

    def _take(self, sent: Sent, answer: Future[_Result], work: Callable[[], _Result], client: Client) -> None:
        """Pass an answer on, or send the work again if it was with a scheduler that is gone."""
        if sent.cancelled():  # its client may be closed already, and give no result
            self._send_again(answer, work, client)
            return
        try:
            result = sent.result()
        except BaseException as error:
            self._fail(error, answer, work, client)
        else:
            answer.set_result(result)

    def _fail(
        self, error: BaseException, answer: Future[_Result], work: Callable[[], _Result], client: Client
    ) -> None:
        """Pass an error on, unless it comes from a client that has lost its scheduler."""
        if client.status == "running":
            answer.set_exception(error)
        else:
            self._send_again(answer, work, client)

    def _send_again(self, answer: Future[_Result], work: Callable[[], _Result], lost: Client) -> None:
        if self._is_closed:
            answer.cancel()
            return
        try:
            self._find_again(lost)
        except ClusterError as error:
            answer.set_exception(error)
        else:
            self._send(answer, work)

    def _find_again(self, lost: Client) -> None:
        """Connect to the scheduler that takes the place of one that is gone, unless that is done already."""
        with self._lock:
            if self._client is not lost:
                return
            with suppress(TimeoutError):
                lost.close(timeout=1.0)
            for number in range(_MOST_TRIES):
                try:
                    self._client = _client_of(self._address)
                except ClusterError:
                    if self._is_closed or number + 1 == _MOST_TRIES:
                        raise
                else:
                    return

    def map(self, function: Callable[[_Job], _Result], jobs: Iterable[_Job]) -> Iterator[_Result]:
        """Call a function for each of some jobs on the workers, and yield the results in their order."""
        answers = [self.submit(function, job) for job in jobs]
        return (answer.result() for answer in answers)


class _Prepared(WorkerPlugin):
    """Prepares each worker, also those that come later, and refuses one of another version."""

    def __init__(self, version: str) -> None:
        self._version = version

    def setup(self, worker: Any) -> None:
        """Check the worker's version, and compile the loops on its machine unless that is done."""
        if self._version != __version__:
            raise ClusterError(
                f"{worker.address} has lidar_buildings {__version__}, and this is {self._version}: install "
                "the same version everywhere"
            )
        keep_freed_memory()  # dask has workers give all of it back at once, and take it fresh for each array
        share_cores(lambda: False)
        if (compiling := start_compiling()) is not None:
            compiling.wait()


def _client_of(address: str) -> Client:
    client = None
    try:
        client = Client(address, timeout=_AT_START, set_as_default=False)
        client.wait_for_workers(1, timeout=_AT_START)
    except (OSError, ValueError, TimeoutError) as error:
        if client is not None:
            client.close()
        raise ClusterError(
            f"{address}: no scheduler with workers can be reached there ({' '.join(str(error).split())}): "
            "check the address, and that 'dask scheduler' and 'dask worker' run"
        ) from error
    try:
        client.register_plugin(_Prepared(__version__))
    except BaseException:
        client.close()
        raise
    return client

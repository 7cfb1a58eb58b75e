"""
Tiles done by workers of dask.distributed, of this machine or of many, in the place of a `BuildingPool`.

Nothing but names and counts goes through the scheduler: workers read and write files that all of them see.
Dask does again what a worker had that ended, and gives up what ends too many of them (`KilledWorker`).
Whatever else dies, the same command goes on: results are files of one name, which appear when they are
complete.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future
from typing import Any, TypeVar

from distributed import Client, LocalCluster, WorkerPlugin

from lidar_buildings import __version__
from lidar_buildings.core.freed_memory import keep_freed_memory
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.neighbours.parallel import share_cores

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

#: How long a scheduler and its workers are waited for at the start [s].
_AT_START = 30.0
_LOGGERS = ("distributed", "distributed.scheduler", "distributed.nanny", "distributed.worker")


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
        address = self._local.scheduler_address if self._local else scheduler
        try:
            self._client = _client_of(address)
        except BaseException:
            if self._local is not None:
                self._local.close()
            raise
        self._executor: Executor = self._client.get_executor(pure=False)
        self.dashboard: str = self._client.dashboard_link

    def __enter__(self) -> TileCluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give up what is not done, and end the workers that were started here."""
        self._client.close()
        if self._local is not None:
            self._local.close()

    def submit(self, function: Callable[..., _Result], *arguments: object) -> Future[_Result]:
        """
        Call a function on a worker.

        The function stands at the top of a module; it may be called more than once, and at the same time.
        """
        return self._executor.submit(function, *arguments)

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

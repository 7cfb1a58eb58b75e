"""
Tiles done by workers of dask.distributed, of this machine or of many, in the place of a `BuildingPool`.

Nothing but names and counts goes through the scheduler: workers read and write files that all of them see.
Whatever dies, the work that it had is done again, and gives the same: results are files of one name, which
appear when they are complete.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Future
from functools import partial
from typing import Any, TypeVar

import dask
from distributed import Client, KilledWorker, LocalCluster

from lidar_buildings import __version__
from lidar_buildings.core.freed_memory import keep_freed_memory
from lidar_buildings.core.kernel_cache import start_compiling
from lidar_buildings.core.model.errors import LidarBuildingsError
from lidar_buildings.core.neighbours.parallel import share_cores
from lidar_buildings.pipeline.agenda import WorkerLostError

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

_log = logging.getLogger(__name__)

#: How long a scheduler that cannot be reached, or its workers, are waited for: at the start, and later [s].
_AT_START, _LATER = 30.0, 600.0
#: How often it is looked whether any are left [s].
_PERIOD = 5.0
#: What is begun first: reading lets tiles become ready, tiles free what waits.
_LATE, _SOON = 0, 1


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
        for name in ("distributed", "distributed.scheduler", "distributed.nanny", "distributed.worker"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what it means for a run is said here
        self._local = _local_cluster(n_workers) if n_workers else None
        address = self._local.scheduler_address if self._local else scheduler
        try:
            _check_workers(address)
            self._client = Client(address, timeout=_LATER, set_as_default=False)
        except BaseException:
            if self._local is not None:
                self._local.close()
            raise
        self.dashboard: str = self._client.dashboard_link
        self._lock = threading.RLock()
        self._open: set[_Call] = set()
        self._suspects: list[_Call] = []
        self._closed = threading.Event()
        self._watch = threading.Thread(target=self._look_after, daemon=True)
        self._watch.start()

    def __enter__(self) -> TileCluster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give up what is not done, and end the workers that were started here."""
        self._closed.set()
        self._watch.join()
        self._give_up("the cluster was closed")
        self._client.close()
        if self._local is not None:
            self._local.close()

    @property
    def n_alive(self) -> int:
        """Number of workers."""
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    def submit(
        self,
        function: Callable[[_Job], _Result],
        job: _Job,
        *,
        is_late: bool = False,
        shares: bool = False,
    ) -> Future[_Result]:
        """
        Call a function on a worker; if `is_late` after what was submitted without this.

        The function stands at the top of a module; it may be called more than once, and at the same time. It
        shares nothing with other workers. The future raises `WorkerLostError` if workers end at it even when
        nothing else is done.
        """
        call = _Call(function, job, _LATE if is_late else _SOON)
        with self._lock:
            self._open.add(call)
        self._send(call)
        return call.answer

    def call_each(self, function: Callable[[_Job], _Result], jobs: Sequence[_Job]) -> list[_Result]:
        """Call a function for each of some jobs on the workers, and return the results in their order."""
        answers = [self.submit(function, job) for job in jobs]
        return [answer.result() for answer in answers]

    def _send(self, call: _Call) -> None:
        with self._lock:
            sent = call.sent = self._client.submit(
                _done, __version__, call.function, call.job, pure=False, priority=call.priority
            )
        sent.add_done_callback(partial(self._take, call))

    def _take(self, call: _Call, sent: Any) -> None:
        """Take what became of a call: a result, an exception, or nothing, as the scheduler is gone."""
        try:
            if self._closed.is_set() or sent is not call.sent:
                return
            if sent.status == "finished":
                self._finish(call, sent.result())
            elif sent.status == "error" and isinstance(error := sent.exception(), KilledWorker):
                self._suspect(call, error)
            elif sent.status == "error":
                self._finish(call, error=sent.exception())
            else:
                self._send(call)
        except (OSError, CancelledError):  # the scheduler went while it was asked for the result
            self._send(call)
        except Exception as error:
            self._finish(call, error=error)

    def _finish(self, call: _Call, result: Any = None, error: BaseException | None = None) -> None:
        with self._lock:
            if call not in self._open:
                return
            self._open.discard(call)
        call.sent = None
        if error is None:
            call.answer.set_result(result)
        else:
            call.answer.set_exception(error)
        self._try_suspect()

    def _suspect(self, call: _Call, error: KilledWorker) -> None:
        """Keep a call at which workers ended until it can be done alone; it may be as innocent as others."""
        if call.is_alone:
            why = "workers ended at it, also with nothing beside it: give them more memory"
            self._finish(call, error=WorkerLostError(why))
            return
        _log.warning("workers ended at a task (%s): it is done alone later", error)
        with self._lock:
            self._suspects.append(call)
        self._try_suspect()

    def _try_suspect(self) -> None:
        """Send one of the suspects if nothing else is under way."""
        with self._lock:
            if not self._suspects or len(self._open) > len(self._suspects):
                return
            call = self._suspects.pop()
            call.is_alone = True
        self._send(call)

    def _look_after(self) -> None:
        """Send again what got lost with a scheduler; give up where nobody is left for long."""
        alone_since = None
        while not self._closed.wait(_PERIOD):
            with self._lock:
                lost = [one for one in self._open if one.sent and one.sent.key not in self._client.futures]
            for call in lost:
                self._send(call)
            if self._client.status == "closed":
                self._give_up("the scheduler is gone")
                return
            is_alone = self._client.status == "running" and not self.n_alive
            alone_since = (alone_since or time.monotonic()) if is_alone else None
            if alone_since and time.monotonic() - alone_since > _LATER:
                self._give_up("no worker is left")

    def _give_up(self, why: str) -> None:
        """End what is under way."""
        with self._lock:
            calls = list(self._open)
            self._suspects.clear()
        for call in calls:
            why_not = ClusterError(f"{why}: the same command goes on from the finished tiles")
            self._finish(call, error=why_not)


def _check_workers(address: str) -> None:
    """Let all workers compile what they have not, and refuse a cluster of other versions."""
    try:
        with Client(address, timeout=_AT_START, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=_AT_START)
            versions = client.run(_version, on_error="return")
            for worker, version in sorted(versions.items()):
                if version != __version__:
                    raise ClusterError(_other_version(worker, version, __version__))
            client.run(_compile)
    except (OSError, ValueError, TimeoutError) as error:
        raise ClusterError(
            f"{address}: no scheduler with workers can be reached there ({' '.join(str(error).split())}): "
            "check the address, and that 'dask scheduler' and 'dask worker' run"
        ) from error


class _Call:
    """Something that a worker is to do."""

    def __init__(self, function: Callable[..., Any], job: object, priority: int) -> None:
        self.function, self.job, self.priority = function, job, priority
        self.answer: Future[Any] = Future()
        self.is_alone = False
        #: Keeps the result on the worker until it has been taken.
        self.sent: Any = None


def _local_cluster(n_workers: int) -> LocalCluster:
    # What a worker's end was not due to is done alone later, so that little is lost by suspecting it soon.
    with dask.config.set({"distributed.scheduler.allowed-failures": 1}):
        return LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=n_workers, threads_per_worker=1, dashboard_address=":0", silence_logs=logging.CRITICAL
        )


def _done(version: str, function: Callable[..., Any], job: object) -> Any:
    """Do something on a worker; one that came later may have another version."""
    if version != __version__:
        raise ClusterError(_other_version("a worker", __version__, version))
    keep_freed_memory()  # dask has workers give all of it back at once, and take it fresh for each array
    share_cores(lambda: False)
    return function(job)


def _version() -> str:
    return __version__


def _compile() -> None:
    """Compile the loops on a worker's machine, unless that is done."""
    compiling = start_compiling()
    if compiling is not None:
        compiling.wait()


def _other_version(worker: str, version: object, wanted: str) -> str:
    has = f"has lidar_buildings {version}" if isinstance(version, str) else f"has none ({version!r})"
    return f"{worker} {has}, and this is {wanted}: install the same version everywhere"

"""Buildings shared out over processes."""

from __future__ import annotations

import logging
import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

from lidar_buildings.pipeline.parcels import Parcel, unpacked

_log = logging.getLogger(__name__)

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")

#: A function, what it is called with, and whether it takes a pool.
Work = tuple[Callable[..., Any], tuple[Any, ...], bool]

#: What a building costs beside its points, in points.
_LEAST_SIZE = 400
#: Work that is not worth the way to a process and back, in points.
_LITTLE = 4000
#: Batches for each process: small enough to end together, large enough to cost little to send.
_BATCHES_A_WORKER = 6


class Sharing(ABC):
    """Calls a function for many buildings in several processes."""

    n_alive: int  #: number of processes

    @abstractmethod
    def _exchange(self, messages: Sequence[Parcel]) -> Sequence[Parcel | None]:
        """Let processes answer messages; None for one whose process ended."""

    def map(
        self,
        function: Callable[[_Job], _Result],
        jobs: Sequence[_Job],
        sizes: Sequence[int],
        lost: Callable[[_Job], _Result],
    ) -> list[_Result]:
        """
        Call a function for each of many buildings, the largest first, and return the results in their order.

        The function stands at the top of a module, and its result depends on the job alone; `sizes` are the
        buildings' numbers of points. ``lost(job)`` stands in for the result of a building during which two
        processes ended; one that was merely in a batch with it is done again. Raises what the function
        raises.
        """
        weights = [size + _LEAST_SIZE for size in sizes]
        if not self.n_alive or len(jobs) < 2 or sum(weights) < _LITTLE:
            return [function(job) for job in jobs]
        results: dict[int, _Result] = {}

        def share(batches: list[list[int]]) -> list[int]:
            """Have batches done; return what was in those whose process ended."""
            messages = [_message_of(function, [(k, jobs[k]) for k in batch]) for batch in batches]
            answers = self._exchange(messages)
            for answer in filter(None, answers):
                results.update(received(answer))
            return [
                k for batch, answer in zip(batches, answers, strict=True) if answer is None for k in batch
            ]

        for k in share(_batches(weights, self.n_alive)):
            if not self.n_alive:
                results[k] = function(jobs[k])
            elif share([[k]]):
                results[k] = lost(jobs[k])
        return [results[k] for k in range(len(jobs))]


def map_buildings(
    pool: Sharing | None,
    function: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    sizes: Sequence[int],
    failed: Callable[..., _Result],
    problem: str,
) -> list[_Result]:
    """
    Do as `Sharing.map`, or without a pool everything here.

    ``failed(job, reason=…)`` stands in for the result of a building that two processes ended at, or at which
    the function raises an exception; its `problem`, in a few words, and the job's `building_id` are logged.
    """
    attempt = partial(_attempted, function, failed, problem)
    if pool is None:
        return [attempt(job) for job in jobs]
    return pool.map(attempt, jobs, sizes, partial(failed, reason="two processes ended at it"))


def _attempted(function: Callable[..., Any], failed: Callable[..., Any], problem: str, job: Any) -> Any:
    try:
        return function(job)
    except Exception as error:
        _log.exception("building %d: %s", job.building_id, problem)
        return failed(job, reason=f"unexpected error: {error!r}")


def _message_of(function: Callable[..., Any], batch: Any) -> Parcel:
    """Return what a process is told: a function for each of a batch of numbered jobs, in one piece."""
    return Parcel(pickle.dumps((_each, (function, batch), False), protocol=5))


def _each(function: Callable[[_Job], _Result], batch: Sequence[tuple[int, _Job]]) -> dict[int, _Result]:
    return {number: function(job) for number, job in batch}


def called(work: Work, pool: Sharing | None) -> Any:
    """Call a function as it is to be called."""
    function, arguments, shares = work
    return function(*arguments, pool=pool) if shares else function(*arguments)


def received(answer: Parcel) -> Any:
    """Return what a process answered, or raise what was raised there; log what it had to say."""
    result, error, there, records = unpacked(answer)
    for record in records:
        logging.getLogger(record.name).handle(record)
    if there:
        raise error from RuntimeError(f"in a process of buildings:\n{there}")
    return result


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

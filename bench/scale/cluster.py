"""A scheduler and workers of dask as processes of their own, started anew when they end."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import threading
from types import TracebackType


class Cluster:
    """
    A scheduler and its workers, processes with a thread each; a context manager.

    `memory` is the limit of each, as dask takes it; 0 for none.
    """

    def __init__(self, n_workers: int, memory: str = "0") -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        scheduler = ["scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        worker = ["worker", self.address, "--nthreads", "1", "--memory-limit", memory, "--no-dashboard"]
        self._commands = [scheduler, *[worker] * n_workers]
        self._processes: list[subprocess.Popen[bytes]] = []
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self.n_kills = [0, 0]

    def __enter__(self) -> Cluster:
        self._processes = [self._started(command) for command in self._commands]
        self._keeper = threading.Thread(target=self._keep, daemon=True)
        self._keeper.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """End all processes for good."""
        self._ended.set()
        self._keeper.join()
        for number in range(len(self._processes)):
            self._kill(number)

    @property
    def pids(self) -> list[int]:
        """The process of the scheduler, and those of the workers."""
        return [process.pid for process in self._processes]

    def kill(self, chance: random.Random, share_of_scheduler: float) -> str:
        """Kill the scheduler or a worker with all its processes; say which."""
        number = 0 if chance.random() < share_of_scheduler else chance.randrange(1, len(self._processes))
        self._kill(number)
        self.n_kills[number > 0] += 1
        return "scheduler" if number == 0 else f"worker {number}"

    def _kill(self, number: int) -> None:
        with self._lock, contextlib.suppress(ProcessLookupError):
            os.killpg(self._processes[number].pid, signal.SIGKILL)
            self._processes[number].wait()

    def _keep(self) -> None:
        """Start what has ended, as a service manager does."""
        while not self._ended.wait(0.5):
            with self._lock:
                for number, process in enumerate(self._processes):
                    if process.poll() is not None:
                        self._processes[number] = self._started(self._commands[number])

    @staticmethod
    def _started(arguments: list[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *arguments],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

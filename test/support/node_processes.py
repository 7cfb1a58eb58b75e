"""Nodes as processes of their own, to be slowed down, killed and started again by tests."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from lidar_buildings.nodes.run_settings import run_settings
from lidar_buildings.nodes.table import SOURCES, nodes_until

#: Runs a node with one of the functions of its module slowed down.
_SLOW = """
import importlib
import sys
import time
name, function, seconds = sys.argv.pop(1), sys.argv.pop(1), float(sys.argv.pop(1))
module = importlib.import_module("lidar_buildings.nodes." + name)
original = getattr(module, function)
def slow(*arguments, **named):
    time.sleep(seconds)
    return original(*arguments, **named)
setattr(module, function, slow)
raise SystemExit(module.main())
"""

LAST = "building_model"


class NodeProcesses:
    """The whole graph, each node in its own process."""

    def __init__(
        self,
        inputs: list[Path],
        output: Path,
        namespace: str,
        logs: Path,
        replicas: dict[str, int] | None = None,
        source: str = SOURCES[0],
        **of_source,
    ) -> None:
        self.output, self._namespace, self._logs = output, namespace, logs
        self._replicas = replicas or {}
        self._processes: dict[str, subprocess.Popen] = {}
        self._names = nodes_until(LAST, source)
        self._parameters = run_settings(source, [str(path) for path in inputs], str(output), LAST)
        self._parameters[source] |= of_source

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.kill()
        for process in self._processes.values():
            process.wait()

    def start_all(self, slow: dict[str, tuple[str, float]] | None = None) -> None:
        for name in reversed(self._names):
            for replica in range(self._replicas.get(name, 1)):
                self.start(name, (slow or {}).get(name), replica)

    def start(self, name: str, slow: tuple[str, float] | None = None, replica: int = 0) -> None:
        command = [sys.executable, "-m", f"lidar_buildings.nodes.{name}"]
        if slow is not None:
            command = [sys.executable, "-c", _SLOW, name, slow[0], str(slow[1])]
        command += ["--ros-args", "-r", f"__ns:=/{self._namespace}"]
        parameters = self._parameters.get(name, {})
        if (n_replicas := self._replicas.get(name, 1)) > 1:
            name = f"{name}_{replica}"
            command += ["-r", f"__node:={name}"]
            parameters = parameters | {"replica": replica, "replicas": n_replicas}
        for parameter, value in parameters.items():
            command += ["-p", f"{parameter}:={json.dumps(value)}"]
        with (self._logs / f"{name}.log").open("a") as log:
            self._processes[name] = subprocess.Popen(
                [*self.before(name), *command], stdout=log, stderr=log, env=os.environ
            )

    def before(self, _: str) -> list[str]:
        """What stands before a node's command."""
        return []

    def kill(self, name: str) -> None:
        self._processes[name].send_signal(signal.SIGKILL)
        self._processes[name].wait()

    def n_on_disk(self) -> int:
        return len(list((self.output / ".partial").glob("*.npz")))

    def wait_for_tiles(self, count: int, seconds: float) -> None:
        """Wait until so many tiles are on disk."""
        end = time.monotonic() + seconds
        while self.n_on_disk() < count and not (self.output / "run.json").exists():
            assert time.monotonic() < end, (
                f"{self.n_on_disk()} of {count} tiles after {seconds} s{self.tails()}"
            )
            assert self._processes["model_writer"].poll() in (None, 0), self.tails()
            time.sleep(0.05)

    def wait_until_written(self, seconds: float) -> int:
        """Wait until the writer has ended by itself; return its exit status."""
        try:
            return self._processes["model_writer"].wait(seconds)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"{self.n_on_disk()} tiles after {seconds} s{self.tails()}") from None

    def tails(self) -> str:
        """The last lines of every node's log, and which nodes have ended."""
        ended = {name: process.poll() for name, process in self._processes.items()}
        lines = [
            f"{log.stem}: {line}"
            for log in self._logs.glob("*.log")
            for line in log.read_text().splitlines()[-4:]
        ]
        lines += [f"{name} ended with {status}" for name, status in ended.items() if status is not None]
        return "\n" + "\n".join(lines)

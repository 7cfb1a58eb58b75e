"""Nodes as processes of their own, to be slowed down, killed and started again by tests."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from lidar_buildings.nodes.graph import run_settings
from lidar_buildings.nodes.table import SOURCES, nodes_until

LAST = "building_model"
#: Nodes are forked from a process that has imported them all: importing takes longer than most tests.
_FORKING = multiprocessing.get_context("forkserver")
_MODULES = (*SOURCES, "stage_nodes", "model_writer")
_FORKING.set_forkserver_preload([f"lidar_buildings.nodes.{name}" for name in _MODULES])


class _Forked(subprocess.Popen):
    """A node's process, to be handled as one of a command."""

    def __init__(self, *arguments) -> None:
        self._process = _FORKING.Process(target=_run_node, args=(*arguments, dict(os.environ)))
        self._process.start()
        self.pid, self.returncode, self.args = self._process.pid, None, arguments

    def __del__(self) -> None:
        """Nothing is to be said of one that still runs."""

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self.args, timeout)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.pid, number)


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
        arguments = ["--ros-args", "-r", f"__ns:=/{self._namespace}"]
        module, parameters = name, self._parameters.get(name, {})
        if (n_replicas := self._replicas.get(name, 1)) > 1:
            name = f"{name}_{replica}"
            arguments += ["-r", f"__node:={name}"]
            parameters = parameters | {"replica": replica, "replicas": n_replicas}
        for parameter, value in parameters.items():
            arguments += ["-p", f"{parameter}:={json.dumps(value)}"]
        self._processes[name] = self.started(name, module, arguments, slow, self._logs / f"{name}.log")

    def started(self, name: str, module: str, arguments: list[str], slow, log: Path) -> subprocess.Popen:
        """Start a node's process."""
        return _Forked(module, arguments, slow, log)

    def kill(self, name: str) -> None:
        self._processes[name].send_signal(signal.SIGKILL)
        self._processes[name].wait()

    def end(self, name: str) -> None:
        """End a node as a user does."""
        self._processes[name].send_signal(signal.SIGINT)
        self._processes[name].wait(240)

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


def fork_nodes() -> None:
    """Fork a node for each line of arguments that comes in; end them all with the last line."""
    for name in _MODULES:
        importlib.import_module(f"lidar_buildings.nodes.{name}")
    for line in sys.stdin:
        module, arguments, slow, log = json.loads(line)
        if os.fork() == 0:
            _run_node(module, arguments, slow, Path(log), {})
    os.killpg(0, signal.SIGKILL)


def _run_node(
    module: str, arguments: list[str], slow: tuple[str, float] | None, log: Path, environment: dict[str, str]
) -> None:
    """Be a node; one of its module's functions may be slowed down."""
    os.environ.update(environment)
    written = os.open(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.dup2(written, 1)
    os.dup2(written, 2)
    names = ("nodes.graph", "ros.runner")
    graph, runner = (importlib.import_module(f"lidar_buildings.{one}") for one in names)
    kind = graph.node_class(module)
    if slow is not None:
        name, seconds = slow
        node = sys.modules[kind.__module__]
        original = getattr(node, name)

        def slowed(*given, **named):
            time.sleep(seconds)
            return original(*given, **named)

        setattr(node, name, slowed)
    sys.argv[1:] = arguments
    raise SystemExit(runner.run_node(kind))

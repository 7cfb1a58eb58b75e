"""A command in a process of its own, on so many cores: its times, memory and temporary files."""

from __future__ import annotations

import ctypes
import os
import resource
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from bench.common.clouds import ROOT
from bench.common.process_tree import MemoryWatch, tree_of

#: Between two looks at the process: short against a run, long against a look of some milliseconds [s].
PERIOD = 0.25
#: Number of the option of `prctl` that makes a process the parent of its descendants' orphans (Linux).
_SUBREAPER = 36
#: What every command runs with: bytecode is kept, as in an installation.
_ENVIRONMENT = {"PYTHONDONTWRITEBYTECODE": ""}


class Usage(NamedTuple):
    """What a command took."""

    #: The latter of all its processes, user and system [s].
    wall: float
    cpu: float
    #: Processor time that the machine spent on others meanwhile; where it is not small, wall time tells of
    #: them, too [s].
    others: float
    #: Most that it had at a time: the kernel's own mark of its largest process, or the sum over its processes
    #: each `PERIOD`, if that was more [bytes].
    memory: int
    disk: int  #: most of its temporary files at a time, looked at each `PERIOD` [bytes]
    printed: str  #: its standard output


def machine_cpu() -> float:
    """Return the processor time that all processes of the machine have had since it was started [s]."""
    user, nice, system, _, _, *interrupts = map(
        int, Path("/proc/stat").read_text().split("\n")[0].split()[1:8]
    )
    return (user + nice + system + sum(interrupts)) / os.sysconf("SC_CLK_TCK")


def run_child(
    command: Sequence[str],
    *,
    cores: int | None = None,
    output: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> Usage:
    """
    Run a command on so many cores, and wait for its end; SystemExit if its exit status is not 0.

    What is in its `output` folder for a while only counts as temporary; `environment` is what differs from
    this process's.
    """
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, tempfile.TemporaryFile("w+") as printed:
        watched = Watch(Path(folder), output)
        environment = {**os.environ, "TMPDIR": folder, **_ENVIRONMENT, **(environment or {})}
        others = adopt_orphans()
        with _on_cores(cores):
            started, busy = time.perf_counter(), machine_cpu()
            process = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=printed, stderr=subprocess.STDOUT
            )
        with watched.watching(process.pid):
            _, status, used = os.wait4(process.pid, 0)
            wall, busy = time.perf_counter() - started, machine_cpu() - busy
        orphans = list(wait_for_orphans(others))
        process.returncode = os.waitstatus_to_exitcode(status)
        printed.seek(0)
        text = printed.read()
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: status {process.returncode}:\n{text[-2000:]}")
    memory = max(watched.memory, 1024 * used.ru_maxrss)
    cpu = sum(one.ru_utime + one.ru_stime for one in (used, *orphans))
    return Usage(wall, cpu, max(busy - cpu, 0.0), memory, watched.disk(), text)


def adopt_orphans() -> set[int]:
    """Become the parent of what descendants leave behind; return the children that there are now."""
    ctypes.CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)
    return _children()


def wait_for_orphans(others: set[int]) -> Iterator[resource.struct_rusage]:
    """Wait for the processes whose parent ended before them, as of a pool, and yield what they took."""
    while orphans := _children() - others:
        for pid in orphans:
            yield os.wait4(pid, 0)[2]


def _children() -> set[int]:
    """Return this process's own children."""
    lists = Path("/proc/self/task").glob("*/children")
    return {int(pid) for one in lists for pid in one.read_text().split()}


class Watch:
    """Looks at a process and its descendants time and again, and at its folders."""

    def __init__(self, temporary: Path, output: Path | None = None) -> None:
        #: Of several processes, None if there was never more than one.
        self._memory: MemoryWatch | None = None
        self._temporary, self._output = temporary, output
        self._looks: list[Counter[str]] = []

    @contextmanager
    def watching(self, pid: int) -> Iterator[None]:
        """Look each `PERIOD` as long as this lasts."""
        ended = threading.Event()

        def watch() -> None:
            while not ended.wait(PERIOD):
                self.look(pid)

        thread = threading.Thread(target=watch)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def look(self, pid: int) -> None:
        """Look once."""
        if len(tree_of(pid)) > 1:
            self._memory = self._memory or MemoryWatch(pid)
            self._memory.look()
        self._looks.append(_sizes(self._temporary, self._output))

    @property
    def memory(self) -> int:
        """The largest sum over several processes at a time, 0 if there was never more than one [bytes]."""
        return self._memory.most if self._memory else 0

    def disk(self) -> int:
        """Return the most of temporary files: all but what stands in the output folder now [bytes]."""
        last = {path.name for path in self._output.iterdir()} if self._output else set()
        return max(
            (sum(n for name, n in look.items() if name not in last) for look in self._looks), default=0
        )


@contextmanager
def _on_cores(number: int | None) -> Iterator[None]:
    """Let what is started meanwhile have so many of this process's cores only."""
    allowed = os.sched_getaffinity(0)
    if number is not None:
        os.sched_setaffinity(0, sorted(allowed)[:number])
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def _sizes(temporary: Path, output: Path | None) -> Counter[str]:
    """Return the bytes of all files by the output folder's member they are in; temporary ones have none."""
    sizes: Counter[str] = Counter()
    for folder in (temporary, *([output] if output else [])):
        for path, _, names in os.walk(folder):
            for name in names:
                member = (Path(path) / name).relative_to(folder).parts[0] if folder == output else ""
                try:
                    sizes[member] += (Path(path) / name).stat().st_size
                except OSError:
                    continue  # it was there a moment ago
    return sizes

"""How far a run is, and what it gave: what runs with and without ROS share."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from tqdm import tqdm

if TYPE_CHECKING:
    from lidar_buildings.io.bags.recording import Recording
    from lidar_buildings.io.results.run_summary import RunSummary


class Usage(NamedTuple):
    """
    What the processes of a run took together.

    Attributes
    ----------
    processor : float
        Processor time [s].
    memory : int
        The most at a time [bytes].
    """

    processor: float
    memory: int


@dataclass(frozen=True)
class RunOutcome:
    """
    What a run gave.

    Attributes
    ----------
    summary : RunSummary
        What the files hold.
    failed : mapping
        Stamp of each tile that was given up → why.
    recording : Recording or None
        The bag that was wanted beside the files.
    usage : Usage or None
        What it took, None where that is not known.
    """

    summary: RunSummary
    failed: Mapping[int, str]
    recording: Recording | None = None
    usage: Usage | None = None


class _Bar(tqdm):
    """A bar without tqdm's watching thread: with a second thread, processes are spawned and not forked."""

    monitor_interval = 0


@contextmanager
def progress_bar(tile_count: Callable[[], int], *, is_quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """Give a function that shows how many tiles are done: a bar on a terminal, plain lines elsewhere."""
    if is_quiet:
        yield lambda done: None
        return
    is_terminal = sys.stderr.isatty()
    bar = _Bar(total=tile_count(), unit="tile", disable=not is_terminal)

    def show(done: int) -> None:
        bar.total = max(tile_count(), done)
        bar.update(done - bar.n)
        if not is_terminal:
            bar.n = done
            # in one piece: print() writes the line and its end apart, and other threads run in between
            sys.stderr.write(f"{done} of {counted(bar.total, 'tile')} done\n")
            sys.stderr.flush()

    with bar:
        yield show


def counted(number: int, what: str) -> str:
    """Write how many there are of something."""
    return f"{number:,} {what}" if number == 1 else f"{number:,} {what}s"

"""How far a run is, what it takes and what it gave: what runs with and without ROS share."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from tqdm import tqdm

from lidar_buildings.io.results.run_summary import RunSummary, counted

if TYPE_CHECKING:
    from lidar_buildings.io.bags.bag_writer import Recording


@dataclass(frozen=True)
class RunOutcome:
    """What a run gave."""

    summary: RunSummary
    failed: Mapping[int, str]  #: stamp of each tile that was given up → why
    recording: Recording | None = None  #: the bag that was wanted beside the files


class TilesDone(NamedTuple):
    """What a run has done so far, without what an earlier one did: tiles, their points and buildings."""

    n_tiles: int = 0
    n_points: int = 0
    n_buildings: int = 0


class _Bar(tqdm):
    """A bar without tqdm's watching thread: with a second thread, processes are spawned and not forked."""

    monitor_interval = 0


@contextmanager
def progress_bar(
    tile_count: Callable[[], int], *, is_quiet: bool = False, clock: Callable[[], float] = time.perf_counter
) -> Iterator[Callable[..., None]]:
    """
    Give a function that shows how far a run is: a bar on a terminal, a plain line a tile elsewhere.

    `tile_count` says how many tiles there are, as far as is known. The function takes how many are finished,
    those of an earlier run too; the `TilesDone` of this one; and what is at work, which a terminal alone
    shows.
    """
    if is_quiet:
        yield lambda n_finished, done, at_work=(): None
        return
    began, is_terminal, told = clock(), sys.stderr.isatty(), 0
    colour = None if os.environ.get("NO_COLOR") else "green"
    style = {
        "bar_format": "{percentage:3.0f}%|{bar:20}| {desc}",
        "colour": colour,
        "disable": not is_terminal,
    }

    def show(n_finished: int, done: TilesDone, at_work: Sequence[str] = ()) -> None:
        nonlocal told
        n_tiles = max(tile_count(), n_finished)
        words = progress_words(n_finished, n_tiles, done, clock() - began)
        if is_terminal:
            bar.total, bar.n = n_tiles, n_finished
            bar.set_description_str("; ".join([words, *([", ".join(at_work)] if at_work else [])]))
        elif n_finished > told:
            told = n_finished
            # in one piece: print() writes the line and its end apart, and other threads run in between
            sys.stderr.write(f"{words}\n")
            sys.stderr.flush()

    with _Bar(total=tile_count(), **style) as bar:
        yield show


def progress_words(n_finished: int, n_tiles: int, done: TilesDone, seconds: float) -> str:
    """Say how far a run is: tiles, buildings so far, speed, and about how long the rest takes."""
    words = [f"{n_finished} of {counted(n_tiles, 'tile')} done"]
    if done.n_tiles and seconds > 0:
        words.append(counted(done.n_buildings, "building"))
        words.append(f"{done.n_points / seconds / 1e6:.2f} M points/s")
        if left := n_tiles - n_finished:
            words.append(f"{_rough(seconds / done.n_tiles * left)} left")
    return ", ".join(words)


def _rough(seconds: float) -> str:
    """Write a time in the unit that suits it."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.0f} h"

"""How far a run is, what it takes and what it gave: what runs with and without ROS share."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from tqdm import tqdm

from lidar_buildings.commands.terminal import GRADES, coloured
from lidar_buildings.core.model.errors import printable
from lidar_buildings.io.results.output_config import REPORT_FILE
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
    style = {"bar_format": "{percentage:3.0f}%|{bar:20}| {desc}", "colour": colour}

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

    with _Bar(total=tile_count(), disable=not is_terminal, **style) as bar:
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
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 100 * 60 else f"{seconds / 3600:.0f} h"


def tell_problems(outcome: RunOutcome, again: str) -> None:
    """Print one line on stderr for each file and each tile that was not done, and what does them again."""
    summary, bag = outcome.summary, outcome.recording
    lines = list(summary.problems)
    lines += [
        f"tile {stamp} failed ({reason}): the rest is complete" for stamp, reason in outcome.failed.items()
    ]
    if summary.n_unclassified and (outcome.failed or not summary.problems):
        lines.append(
            f"{counted(summary.n_unclassified, 'point')} kept their previous class: repeat the command{again}"
        )
    if summary.why_no_building and not outcome.failed:
        lines.append(summary.why_no_building)
    if bag is not None and bag.failure:
        lost = ", ".join(f"{n:,} of {name}" for name, n in sorted(bag.lost.items())) or "none"
        lines.append(f"{bag.failure}; messages not recorded: {lost}")
    for line in lines:
        print(f"{coloured('lidar-buildings:', 'red', sys.stderr)} {printable(line)}", file=sys.stderr)


def tell_outcome(output: Path, outcome: RunOutcome, wall: float) -> None:
    """Print what was found, what it took and where it is, last what to open first."""
    summary, bag = outcome.summary, outcome.recording
    print(f"{counted(summary.n_points, 'point')} in {counted(summary.n_tiles, 'tile')}, {wall:.1f} s")
    for line in filter(None, [summary.view_words, *summary.building_words]):
        print(_with_coloured_grades(line))
    if aside := ", ".join(f"{n:,} {name}" for name, n in summary.set_aside.items()):
        print(f"set aside by class: {aside}")
    if record := summary.footprints:
        counts = [f"{record['n_read']:,} read"]
        counts += [f"{record['n_repaired']:,} repaired"] * bool(record["n_repaired"])
        counts += [f"{record['n_simplified']:,} simplified"] * bool(record["n_simplified"])
        counts += [f"{number:,} {reason} left out" for reason, number in record["left_out"].items()]
        counts += [f"{record['n_outside']:,} outside the points"] * bool(record["n_outside"])
        print(f"footprints: {', '.join(counts)}")
    for remark in summary.remarks:
        print(remark.text)
    for name in summary.files:
        print(f"  {printable(str(output / name))}")
    if bag is not None and not bag.failure:
        print(f"  {bag.path}: {counted(bag.n_messages, 'message')}")
    if REPORT_FILE in summary.files:
        print(coloured(f"open first: {printable(str(output / REPORT_FILE))}", "bold", sys.stdout))


def _with_coloured_grades(line: str) -> str:
    if not line.startswith("buildings: "):
        return line
    words = "|".join(GRADES)
    return re.sub(
        rf"[\d,]+ ({words})\b", lambda found: coloured(found[0], GRADES[found[1]], sys.stdout), line
    )


def outcome_as_json(output: Path, outcome: RunOutcome, wall: float) -> dict[str, Any]:
    """Return what scripts want to know; all else is in ``run.json``."""
    summary = outcome.summary
    return {
        "output": str(output),
        "files": list(summary.files),
        "seconds": round(wall, 3),
        "n_points": summary.n_points,
        "n_tiles": summary.n_tiles,
        "n_unclassified": summary.n_unclassified,
        "buildings": summary.buildings,
        "quality": summary.quality,
        "quality_reasons": summary.quality_reasons,
        "failed_tiles": {str(stamp): reason for stamp, reason in outcome.failed.items()},
        "problems": list(summary.problems),
        "remarks": [asdict(remark) for remark in summary.remarks],
    }

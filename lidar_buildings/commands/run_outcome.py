"""What a run says at its end: what went wrong, what was found, where it is, and what to open first."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lidar_buildings.commands.progress import RunOutcome
from lidar_buildings.io.results.output_config import REPORT_FILE
from lidar_buildings.io.results.run_summary import counted


def tell_problems(outcome: RunOutcome, again: str) -> None:
    """Print one line on stderr for each file and each tile that was not done, and what does them again."""
    summary, bag = outcome.summary, outcome.recording
    lines = list(summary.problems)
    lines += [
        f"tile {stamp} failed ({reason}): the rest is complete" for stamp, reason in outcome.failed.items()
    ]
    if summary.n_unclassified and (outcome.failed or not summary.problems):
        lines.append(
            f"{counted(summary.n_unclassified, 'point')} kept their previous class: repeat the command with "
            f"{again}"
        )
    if summary.why_no_building and not outcome.failed:
        lines.append(summary.why_no_building)
    if bag is not None and bag.failure:
        lost = ", ".join(f"{n:,} of {name}" for name, n in sorted(bag.lost.items())) or "none"
        lines.append(f"{bag.failure}; messages not recorded: {lost}")
    for line in lines:
        print(f"lidar-buildings: {line}", file=sys.stderr)


def tell_outcome(output: Path, outcome: RunOutcome, wall: float) -> None:
    """Print what was found, what it took and where it is, last what to open first."""
    summary, bag = outcome.summary, outcome.recording
    counts = ", ".join(f"{n} {status}" for status, n in sorted(summary.buildings.items())) or "none"
    print(f"{counted(summary.n_points, 'point')} in {counted(summary.n_tiles, 'tile')}, {wall:.1f} s")
    print(f"buildings: {sum(summary.buildings.values())} ({counts})")
    if aside := ", ".join(f"{n:,} {name}" for name, n in summary.set_aside.items()):
        print(f"set aside by class: {aside}")
    if summary.footprints:
        print(_footprints_line(summary.footprints))
    for remark in summary.remarks:
        print(remark)
    for name in summary.files:
        print(f"  {output / name}")
    if bag is not None and not bag.failure:
        print(f"  {bag.path}: {counted(bag.n_messages, 'message')}")
    if REPORT_FILE in summary.files:
        print(f"open first: {output / REPORT_FILE}")


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
        "failed_tiles": {str(stamp): reason for stamp, reason in outcome.failed.items()},
        "problems": list(summary.problems),
    }


def _footprints_line(record: Mapping[str, Any]) -> str:
    counts = [f"{record['n_read']:,} read"]
    counts += [f"{record['n_repaired']:,} repaired"] * bool(record["n_repaired"])
    counts += [f"{number:,} {reason} left out" for reason, number in record["left_out"].items()]
    counts += [f"{record['n_outside']:,} outside the points"] * bool(record["n_outside"])
    return f"footprints: {', '.join(counts)}"

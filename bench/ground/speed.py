"""
Speed and memory of ground filters: ours and their peers, side by side in one run.

    python -m bench.ground.speed [--data DIR] [--methods METHOD ...] [--copies 1 2 4] [--repeats 3]

The cloud is Delft (two AHN3 tiles, 848 942 points), and Delft laid out 2 × 2 and 4 × 4 times (13.6 million
points), the copies shifted by its extent. Each figure is the median of several runs, each in a fresh process
with the input already in memory and after a first run on a small piece; methods take turns within each round,
so that what else the machine does meets all alike. See doc/benchmarks.md for the columns, and filters.py for
the peers and those left out.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.arguments import parser_of
from bench.common.clouds import ROOT, Cloud, data_folder, read_cloud
from bench.common.tables import table
from bench.ground.measuring import save_cloud
from bench.ground.peers import filter_names, installed

#: The peer whose time is the measure.
REFERENCE = "csf"
#: One run takes no longer [s].
TIMEOUT = 3600
HEADINGS = (
    "method",
    "points",
    "seconds",
    "min–max",
    "cpu s",
    "Mpts/s",
    f"× {REFERENCE}",
    "bytes/pt",
    "growth",
    "ground %",
)

#: (method, copies) → one record per round: what `measuring.measure` returns, or {"failed": reason}.
Runs = dict[tuple[str, int], list[dict[str, Any]]]


def run_one(path: Path, method: str, copies: int) -> dict[str, Any]:
    """Measure in a fresh process; a run that fails is a record of why."""
    command = [sys.executable, "-m", "bench.ground.measuring", str(path), method, str(copies)]
    try:
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        return {"failed": f"took longer than {TIMEOUT} s"}
    if done.returncode:
        return {"failed": (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]}
    return json.loads(done.stdout)


def run_all(cloud: Cloud, methods: Sequence[str], copies: Sequence[int], repeats: int) -> Runs:
    """Run every method on every size, `repeats` times, in turns."""
    runs: Runs = {(method, count): [] for method in methods for count in copies}
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        path = Path(folder) / "cloud.npz"
        save_cloud(path, cloud)
        for number in range(repeats):
            for count in copies:
                for method in methods:
                    record = run_one(path, method, count)
                    runs[method, count].append(record)
                    _report(number, method, count, record)
    return runs


def _report(number: int, method: str, copies: int, record: dict[str, Any]) -> None:
    """Say how far it is."""
    found = record.get("failed") or f"{record['seconds']:.2f} s"
    print(f"round {number + 1}: {method}, {copies} × {copies}: {found}", file=sys.stderr, flush=True)


def median(records: Iterable[dict[str, Any]], name: str) -> float:
    """Median of one figure."""
    return float(np.median([record[name] for record in records]))


def speed_ratio(runs: Runs, method: str, copies: int) -> float:
    """How many times as fast as the reference peer: the median over the rounds, NaN without the peer."""
    pairs = zip(runs.get((REFERENCE, copies), []), runs[method, copies], strict=False)
    ratios = [peer["seconds"] / mine["seconds"] for peer, mine in pairs if "failed" not in {**peer, **mine}]
    return float(np.median(ratios)) if ratios else math.nan


def growth(runs: Runs, method: str, copies: int, before: int | None) -> float:
    """Exponent p of seconds ∝ pointsᵖ between a size and the next smaller one; 1 is linear."""
    if before is None or any("failed" in record for record in runs[method, before]):
        return math.nan
    small, large = (
        (median(r, "points"), median(r, "seconds")) for r in (runs[method, n] for n in (before, copies))
    )
    return math.log(large[1] / small[1]) / math.log(large[0] / small[0])


def row_of(runs: Runs, method: str, copies: int, before: int | None) -> list[str]:
    """One line of the table."""
    records = runs[method, copies]
    failed = next((record["failed"] for record in records if "failed" in record), None)
    if failed is not None:
        return [method, f"{copies} × {copies}", f"failed: {failed}", *[""] * (len(HEADINGS) - 3)]
    points, seconds = median(records, "points"), median(records, "seconds")
    every = [record["seconds"] for record in records]
    return [
        method,
        f"{points:.0f}",
        f"{seconds:.2f}",
        f"{min(every):.2f}–{max(every):.2f}",
        f"{median(records, 'cpu_seconds'):.2f}",
        f"{points / seconds / 1e6:.3f}",
        _number(speed_ratio(runs, method, copies)),
        f"{max(record['bytes_above_input'] for record in records) / points:.0f}",
        _number(growth(runs, method, copies, before)),
        f"{100 * median(records, 'ground') / points:.1f}",
    ]


def _number(value: float) -> str:
    """Two decimals, or a dash."""
    return "–" if math.isnan(value) else f"{value:.2f}"


def rows_of(runs: Runs, methods: Sequence[str], copies: Sequence[int]) -> list[list[str]]:
    """Lines of all methods, sizes rising within each."""
    sizes = sorted(copies)
    smaller = dict(zip(sizes, [None, *sizes[:-1]], strict=True))
    return [row_of(runs, method, count, smaller[count]) for method in methods for count in sizes]


def main(arguments: Sequence[str] | None = None) -> None:
    """Read Delft, run everything, print the table."""
    parser = parser_of(__doc__, filter_names())
    parser.add_argument("--copies", nargs="+", type=int, default=[1, 2, 4], help="copies along each axis")
    parser.add_argument("--repeats", type=int, default=3, help="rounds")
    options = parser.parse_args(arguments)
    if options.set:
        parser.error("--set: speed is measured with the defaults")
    cloud = read_cloud(sorted((data_folder(options.data) / "delft").glob("*.laz")), (2, 9))
    methods = installed(options.methods)
    runs = run_all(cloud, methods, options.copies, options.repeats)
    rows = rows_of(runs, methods, options.copies)
    rows += [
        [name, "not installed", *[""] * (len(HEADINGS) - 2)]
        for name in options.methods
        if name not in methods
    ]
    print(table(HEADINGS, rows))


if __name__ == "__main__":
    main()

"""
The whole chain and each stage beside the decoding of the same files: times, memory, temporary disk.

    python -m bench.chain.run [--data DIR] [--only PART ...] [--copies 1 4 16] [--cores 1 2] [--repeats N]
                              [--folder DIR] [--record FILE] [--landing TITLE]

Parts (all by default):

stages    each stage alone on one core: Delft's first tile, all of Delft, the virtual village
peers     models of Delft with given footprints; roofer beside where its program is installed
runs      `run` on Delft laid out so many times: without ROS on 1 and on 2 cores, through the graph on 2
village   `run` on the virtual village in 25 tiles, with and without ROS
latency   one tile of 250,000 points through a graph that waits for it
start     the demo with nothing compiled, and once more

With --record, figures are kept in a file and joined by those of later calls, so that parts can be measured
one at a time; `--only` without a part measures nothing anew. --landing puts the tables in the place of the
last ones of doc/benchmarks.md, and a line into the table of all landings.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.chain.parts import PARTS, Job
from bench.chain.report import Records, landed, tables_of
from bench.common.arguments import data_parser
from bench.common.clouds import ROOT, data_folder

DOCUMENT = ROOT / "doc" / "benchmarks.md"


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure the parts asked for and print all tables."""
    options = _parser().parse_args(arguments)
    records: Records = {}
    if options.record is not None and options.record.is_file():
        records = json.loads(options.record.read_text())
    with tempfile.TemporaryDirectory(prefix="bench-") as passing:
        folder = options.folder or Path(passing)
        files = tuple(sorted((data_folder(options.data) / "delft").glob("*.laz")))
        if not files and options.only:
            raise SystemExit("--data: holds no delft/*.laz")
        job = Job(files, folder.resolve(), tuple(options.copies), tuple(options.cores), options.repeats)
        for part in options.only:
            for record in PARTS[part](job):
                print(f"{part}: {record}", file=sys.stderr, flush=True)
                keep(records, part, record)
                if options.record is not None:
                    options.record.write_text(json.dumps(records, indent=1))
    tables = tables_of(records)
    print("\n\n".join(one.plain() for one in tables))
    if options.landing:
        DOCUMENT.write_text(landed(DOCUMENT.read_text(), options.landing, records))


def keep(records: Records, part: str, record: dict) -> None:
    """Put a record in the place of an older one of the same thing, or at the end."""
    mine = records.setdefault(part, [])
    names = [one.get("key", one.get("name")) for one in mine]
    name = record.get("key", record.get("name"))
    if name in names:
        mine[names.index(name)] = record
    else:
        mine.append(record)


def _parser() -> argparse.ArgumentParser:
    parser = data_parser(__doc__)
    parser.add_argument("--only", nargs="*", choices=tuple(PARTS), default=tuple(PARTS), metavar="PART")
    parser.add_argument("--copies", type=int, nargs="+", default=(1, 4, 16), metavar="N", help="(1 4 16)")
    parser.add_argument("--cores", type=int, nargs="+", default=(1, 2), metavar="N", help="(1 2)")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="the least counts (3)")
    parser.add_argument("--folder", type=Path, metavar="DIR", help="keep inputs and results here")
    parser.add_argument("--record", type=Path, metavar="FILE", help="keep the figures in this file")
    parser.add_argument("--landing", metavar="TITLE", help="put the tables into doc/benchmarks.md")
    return parser


if __name__ == "__main__":
    main()

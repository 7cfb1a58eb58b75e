"""
The ISPRS filter test (Sithole & Vosselman 2003): errors of ground filters on every sample there is.

    python -m bench.ground.isprs [--data DIR] [--methods METHOD ...] [--offsets 5] [--pictures DIR]

Reads `isprs/sampNN.laz` (any of the fifteen; class 2 is ground) and prints, per method, a line per sample and
the mean, every sample weighing the same. Everything is measured with one set of parameters, the defaults.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.arguments import add_pictures, parser_of, picture_folder, settings_of
from bench.common.clouds import Cloud, data_folder, moved, read_cloud
from bench.common.tables import percent, table
from bench.ground.methods import METHODS
from bench.ground.scenes import rows_of
from bench.ground.scores import SCORE_HEADINGS, score_of

#: How far the samples are moved from one try to the next [m]: in no simple ratio to any grid's cells.
OFFSET_STEP = np.array([17.37, 29.83])

Samples = dict[str, Cloud]


def read_samples(folder: Path) -> Samples:
    """Read the samples that are there, by name."""
    samples = {path.stem: read_cloud([path]) for path in sorted(folder.glob("samp[0-9][0-9].laz"))}
    if not samples:
        raise SystemExit(f"{folder}: holds no sampNN.laz: give the data folder with --data")
    return samples


def offset_rows(
    samples: Samples, methods: Sequence[str], n_offsets: int, settings: Mapping[str, Any] | None = None
) -> list[list[str]]:
    """Total errors with the samples at several places of the map: least, mean and largest of each."""
    offsets = [number * OFFSET_STEP for number in range(n_offsets)]
    rows = []
    for method in methods:
        errors = np.array(
            [
                [score_of(moved(sample, offset), method, settings).total_error for offset in offsets]
                for sample in samples.values()
            ]
        )
        named = [*zip(samples, errors, strict=True), ("mean", errors.mean(axis=0))]
        rows += [
            [method, name, percent(line.min()), percent(line.mean()), percent(line.max())]
            for name, line in named
        ]
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables asked for."""
    parser = parser_of(__doc__, METHODS)
    parser.add_argument("--offsets", type=int, default=0, metavar="N", help="also at N places of the map")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    samples = read_samples(data_folder(options.data) / "isprs")
    settings = settings_of(options.set)
    rows = rows_of(samples, options.methods, settings, picture_folder(options.pictures))
    print(table(("method", "sample", *SCORE_HEADINGS), rows))
    if options.offsets:
        print(f"\nTotal error at {options.offsets} places of the map:")
        headings = ("method", "sample", "least %", "mean %", "worst %")
        print(table(headings, offset_rows(samples, options.methods, options.offsets, settings)))


if __name__ == "__main__":
    main()

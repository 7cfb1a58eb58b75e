"""
The ISPRS filter test (Sithole & Vosselman 2003): errors of ground filters on every sample there is.

    python -m bench.ground.isprs [--data DIR] [--methods METHOD ...] [--offsets 5] [--optimise]
                                [--pictures DIR]

Reads `isprs/sampNN.laz` (any of the fifteen; class 2 is ground) and prints, per method, a line per sample and
the mean, every sample weighing the same. Everything is measured with one set of parameters, the defaults,
except what --optimise adds, which stands in a table of its own. The tables of --offsets and --optimise have
this package's methods alone; peers lay their grids from the data's corner, so that moving changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.arguments import add_pictures, parser_of, picture_folder, settings_of
from bench.common.clouds import Cloud, data_folder, moved, read_cloud
from bench.common.tables import percent, table
from bench.ground.optimisation import GRIDS, errors_of, optimum_of, settings_grid
from bench.ground.peers import filter_names, filters, installed, own_methods
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
    with filters(methods, settings) as chosen:
        for method, ground_filter in chosen.items():
            errors = np.array(
                [
                    [score_of(ground_filter, moved(sample, offset)).total_error for offset in offsets]
                    for sample in samples.values()
                ]
            )
            named = [*zip(samples, errors, strict=True), ("mean", errors.mean(axis=0))]
            rows += [
                [method, name, percent(line.min()), percent(line.mean()), percent(line.max())]
                for name, line in named
            ]
    return rows


def optimised_rows(samples: Samples, method: str) -> list[list[str]]:
    """Total errors with the defaults, the best setting per sample, the best one for all, and left out."""
    settings = settings_grid(method)
    errors = errors_of(method, settings, list(samples.values()))
    best = optimum_of(errors)
    columns = np.arange(len(samples))
    chosen = [errors[0], errors[best.per_cloud, columns], errors[best.single], errors[best.left_out, columns]]
    rows = [
        [method, name, *map(percent, line), _in_words(settings[row])]
        for name, line, row in zip(samples, np.transpose(chosen), best.per_cloud, strict=True)
    ]
    means = [percent(line.mean()) for line in chosen]
    return [*rows, [method, "mean", *means, f"single: {_in_words(settings[best.single])}"]]


def _in_words(settings: Mapping[str, Any]) -> str:
    """Name=value of a setting."""
    return " ".join(f"{name}={value:.4g}" for name, value in settings.items())


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables asked for."""
    parser = parser_of(__doc__, filter_names())
    parser.add_argument("--offsets", type=int, default=0, metavar="N", help="also at N places of the map")
    parser.add_argument("--optimise", action="store_true", help="also with parameters chosen on the samples")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    samples = read_samples(data_folder(options.data) / "isprs")
    methods, settings = installed(options.methods), settings_of(options.set)
    rows = rows_of(samples, methods, settings, picture_folder(options.pictures))
    print(table(("method", "sample", *SCORE_HEADINGS), rows))
    if options.offsets:
        print(f"\nTotal error at {options.offsets} places of the map:")
        headings = ("method", "sample", "least %", "mean %", "worst %")
        own = [method for method in methods if method in own_methods()]
        print(table(headings, offset_rows(samples, own, options.offsets, settings)))
    for method in GRIDS if options.optimise else ():
        if method in methods:
            print(f"\nTotal error with parameters chosen on the samples, {len(settings_grid(method))} tried:")
            headings = ("method", "sample", "default %", "optimised %", "single %", "left out %", "optimised")
            print(table(headings, optimised_rows(samples, method)))


if __name__ == "__main__":
    main()

"""
What disturbances cost: every part of the chain on known clouds as if they had been recorded otherwise.

    python -m bench.generalise.run [--parts PART ...] [--quick] [--seed 0] [--clouds SET ...]
                                   [--methods METHOD ...] [--set NAME=VALUE ...] [--data DIR]

Prints per part and kind of disturbance (`disturbances`: random windows, strips and discs without points,
thinned, turned, moved, stretched, 3 cm noise, other scan patterns) the mean and the mean of the worst tenth.
These are the figures that constants and rules are chosen by; the plain clouds come first, for comparison.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from bench.common.arguments import data_parser
from bench.common.clouds import data_folder
from bench.generalise import buildings, corners, ground, raw

#: Part → what measures it: the data folder and the command line's options → a table.
PARTS: dict[str, Callable[[Path, argparse.Namespace], str]] = {
    "ground": ground.report,
    "buildings": buildings.report,
    "corners": corners.report,
    "raw": raw.report,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables of the parts asked for."""
    parser = data_parser(__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART")
    parser.add_argument("--quick", action="store_true", help="one disturbance of each kind")
    parser.add_argument("--seed", type=int, default=0, help="draws other disturbances")
    parser.add_argument(
        "--clouds", nargs="+", default=["isprs"], metavar="SET", help="ground: isprs, providers"
    )
    parser.add_argument("--methods", nargs="+", metavar="METHOD", help="default: the part's default")
    parser.add_argument(
        "--set",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="parameters of the part's stage; corners, raw: STAGE.NAME=VALUE",
    )
    options = parser.parse_args(arguments)
    for part in options.parts:
        print(f"{part}:\n{PARTS[part](data_folder(options.data), options)}\n")


if __name__ == "__main__":
    main()

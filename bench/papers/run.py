"""
The tables and figures of the three papers beside ours, by the presets of their names.

    python -m bench.papers.run [PAPER ...] [--data DIR] [--pictures DIR]

santos         Table 1 (measures on a cube); Figures 2 and 3 (that cube, its clusters); Figure 7 (quality)
villalba       Table II (combinations of RANSAC); its ground filter; points by class (section III, Figures
               3 to 6); grey values of roads
sampath_shan   Table 1 (σ and largest offset); Figure 4 (points, convex hull, traced, regularised)

Tables are printed; figures are drawn as PNG into the folder of --pictures. The papers' own clouds are not to
be had: what needs one is measured on ours.
"""

from __future__ import annotations

from collections.abc import Sequence

from bench.common.arguments import add_pictures, data_parser, picture_folder
from bench.common.clouds import data_folder
from bench.papers import sampath_shan, santos, villalba
from lidar_buildings.commands.settings import PRESETS

PAPERS = dict(zip(PRESETS, (santos.report, villalba.report, sampath_shan.report), strict=True))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables and draw the figures of the papers asked for."""
    parser = data_parser(__doc__)
    parser.add_argument("papers", nargs="*", metavar="PAPER", help=", ".join(PAPERS))
    add_pictures(parser)
    options = parser.parse_args(arguments)
    if unknown := set(options.papers) - set(PAPERS):
        parser.error(f"{unknown.pop()}: must be one of {', '.join(PAPERS)}")
    for name in options.papers or PAPERS:
        print(f"== {name}")
        PAPERS[name](data_folder(options.data), picture_folder(options.pictures))


if __name__ == "__main__":
    main()

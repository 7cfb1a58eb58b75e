"""
The tables and figures of the three papers beside ours, by the presets of their names and by the defaults.

    python -m bench.papers.run [PAPER ...] [--data DIR] [--pictures DIR] [--write] [--runs]

santos         Table 1 and Figures 2, 3 (a cube); Figures 4, 7, 8 (edges at the paper's protocol); close
               neighbours and walls seen from the street (its outlook)
villalba       Table II (combinations of RANSAC); points and grey values by class (section III, Figures 3 to
               6); the ground filter
sampath_shan   Table 1 (σ and largest offset at the paper's spacings); what jitter and missing time cost;
               Figures 4 to 7; the separation of ground

Tables are printed as Markdown; --write puts them into their places in doc/papers/. Figures are drawn as PNG
into the folder of --pictures. With --runs whole clouds are run by every preset instead, and by the defaults.
The papers' own clouds are not to be had: what needs one is measured on virtual surveys of their kind and on
ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from bench.common.arguments import add_pictures, data_parser, picture_folder
from bench.common.clouds import data_folder
from bench.papers import sampath_shan, santos, villalba
from bench.papers.pages import Section, write
from bench.papers.runs import sections_of_runs
from lidar_buildings.commands.settings import PRESETS

Report = Callable[[Path, Path | None], Iterator[Section]]
PAPERS: dict[str, Report] = dict(
    zip(PRESETS, (santos.sections, villalba.sections, sampath_shan.sections), strict=True)
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables and draw the figures of the papers asked for."""
    parser = data_parser(__doc__)
    parser.add_argument("papers", nargs="*", metavar="PAPER", help=", ".join(PAPERS))
    parser.add_argument("--write", action="store_true", help="write the tables into doc/papers/")
    parser.add_argument("--runs", action="store_true", help="run whole clouds by the presets")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    if unknown := set(options.papers) - set(PAPERS):
        parser.error(f"{unknown.pop()}: must be one of {', '.join(PAPERS)}")
    data, folder = data_folder(options.data), picture_folder(options.pictures)
    for name in options.papers or PAPERS:
        made = sections_of_runs(data, name) if options.runs else PAPERS[name](data, folder)
        for section in made:
            print(f"== {name}: {section.name}\n\n{section.text}\n", flush=True)
            if options.write:
                write(name, [section])


if __name__ == "__main__":
    main()

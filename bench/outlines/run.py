"""
Building outlines: against exact truth, against a map beside peers, and the paper's Table 1.

    python -m bench.outlines.run [--data DIR] [--parts PART ...] [--set STAGE.NAME=VALUE ...]
                             [--pictures DIR] [--methods METHOD ...] [--plans NAME ...]
                             [--density D] [--noise M] [--seeds N ...] [--strips N] [--anisotropy R]
                             [--drop-outs SHARE]
                             [--repeats N]

Parts (all by default; all but the first two need the real clouds):

scenes    virtual buildings, every plan in twelve orientations: found, IoU, corners, courtyards, angles
streets   drives through virtual scenes, in which walls are seen and parts of roofs
delft     class 6 of both halves against the blocks of the base map; peers on the same clusters, and times
table1    σ and largest offset of ten buildings each, beside the figures of Sampath & Shan (2007); blocks are
          split at step edges, as single buildings are meant
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from bench.common.arguments import add_pictures, config_of, data_parser, picture_folder
from bench.common.clouds import data_folder
from bench.outlines import table1
from bench.outlines.chain import variants
from bench.outlines.delft import delft_tables, read_delft, run_all
from bench.outlines.peers import PEERS, is_installed
from bench.outlines.pictures import draw_map, draw_scenes
from bench.outlines.streets import SCENES, draw_street, drive_through, streets_table
from bench.outlines.truth import judged, scenes_table, worst
from bench.scenes.outlines import PLANS, outline_scenes

OURS = "ours"


def run_scenes(options: argparse.Namespace) -> None:
    """Compare outlines of virtual buildings with their truth."""
    scenes = [
        scene
        for seed in options.seeds
        for scene in outline_scenes(
            options.density,
            options.noise,
            seed,
            names=options.plans,
            n_strips=options.strips,
            anisotropy=options.anisotropy,
            drop_outs=options.drop_outs,
        )
    ]
    runs = {f"ours, {name}": (OURS, configs) for name, configs in variants(options.configs).items()}
    if OURS not in options.methods:
        runs = {}
    runs.update({name: (name, None) for name in options.methods if name != OURS})
    for title, (method, configs) in runs.items():
        verdicts = judged(scenes, method, configs)
        print(f"{title}, {options.density:g} pts/m², noise {options.noise:g} m:\n{scenes_table(verdicts)}\n")
        if options.folder:
            draw_scenes(
                options.folder / f"scenes_{title.replace(', ', '_').replace(' ', '_')}.png", worst(verdicts)
            )


def run_streets(options: argparse.Namespace) -> None:
    """Compare outlines of what a vehicle sees of virtual buildings with their truth."""
    streets = [drive_through(name, seed, options.configs) for name in SCENES for seed in options.seeds]
    print(streets_table(streets), end="\n\n")
    if options.folder:
        for street in streets:
            draw_street(street).savefig(options.folder / f"street_{street.name}_{street.seed}.png")


def run_delft(options: argparse.Namespace) -> None:
    """Compare outlines of Delft with the map, ours and the peers'."""
    cloud, reference = read_delft(options.data_folder)
    configs = variants(options.configs) if OURS in options.methods else {}
    peers = [name for name in options.methods if name != OURS]
    peered = run_all(cloud, configs or {"as set": options.configs}, peers, options.repeats)
    print(f"Delft: {len(cloud.roofs)} roof points ({cloud.classes} classes), {peered.n_clusters} clusters")
    print(delft_tables(peered, reference), end="\n\n")
    if options.folder:
        for name, polygons in peered.polygons.items():
            path = options.folder / f"delft_{name.replace(', ', '_').replace(' ', '_')}.png"
            layers = {"map": (reference.blocks, "red"), name: (polygons, "black")}
            draw_map(path, cloud.roofs.points, layers, tuple(reference.area[0].bounds))


def run_table_1(options: argparse.Namespace) -> None:
    """Print the paper's Table 1 with ours."""
    configs = config_of(options.set, segmentation={"split_at_steps": True})
    table1.report(options.data_folder, configs, noise=options.noise, seed=options.seeds[0])


PARTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "scenes": run_scenes,
    "streets": run_streets,
    "delft": run_delft,
    "table1": run_table_1,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts asked for."""
    options = _parser().parse_args(arguments)
    options.folder = picture_folder(options.pictures)
    options.configs = config_of(options.set)
    options.data_folder = data_folder(options.data)
    for name in [name for name in options.methods if name != OURS and not is_installed(name)]:
        print(f"{name}: not installed (pip install '.[bench]')", file=sys.stderr)
        options.methods = [other for other in options.methods if other != name]
    for part in options.parts:
        if part not in ("scenes", "streets") and not options.data_folder.is_dir():
            print(
                f"{part}: {options.data_folder} is not there: give the real clouds with --data",
                file=sys.stderr,
            )
            continue
        print(f"{part}:")
        PARTS[part](options)


def _parser() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = data_parser(__doc__)
    names = (OURS, *PEERS)
    parser.add_argument("--parts", nargs="+", choices=tuple(PARTS), default=tuple(PARTS), metavar="PART")
    parser.add_argument(
        "--methods", nargs="+", choices=names, default=names, metavar="METHOD", help=", ".join(names)
    )
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="STAGE.NAME=VALUE", help="parameters of the stages"
    )
    parser.add_argument(
        "--plans", nargs="+", choices=tuple(PLANS), metavar="NAME", help="scenes: plans (all)"
    )
    parser.add_argument("--density", type=float, default=8.0, metavar="D", help="scenes: points per m² (8)")
    parser.add_argument(
        "--noise", type=float, default=0.03, metavar="M", help="scenes: σ of each axis [m] (0.03)"
    )
    parser.add_argument(
        "--seeds", type=int, nargs="+", default=[0], metavar="N", help="scenes, streets: one round each (0)"
    )
    parser.add_argument("--strips", type=int, default=1, metavar="N", help="scenes: strips that overlap (1)")
    parser.add_argument(
        "--anisotropy",
        type=float,
        metavar="R",
        help="scenes: so many times as far apart as points along them are scan lines (0.7 to 1.7, drawn)",
    )
    parser.add_argument(
        "--drop-outs", type=float, default=0.0, metavar="SHARE", help="scenes: points lost (0)"
    )
    parser.add_argument(
        "--repeats", type=int, default=3, metavar="N", help="delft: runs, the fastest counts (3)"
    )
    add_pictures(parser)
    return parser


if __name__ == "__main__":
    main()

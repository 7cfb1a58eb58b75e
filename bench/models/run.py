"""
Roof planes and building models: against exact truth, on bad input, and on every real cloud.

    python -m bench.models.run [--data DIR] [--parts PART ...] [--set STAGE.NAME=VALUE ...] [--roofs NAME ...]
                           [--rotations N] [--density D] [--noise M] [--seeds N ...]
                           [--clouds NAME ...]

Parts (all by default; the last needs the real clouds):

scenes    virtual roofs of every type in N orientations: type, planes, angles, ridges, volume, vertices
bad       input that is hard or bad: which levels come out, and why not more
clouds    every cloud of the data folder through the chain: levels of detail, reasons, validity, RMSE; Delft
          with given footprints, too
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from bench.common.arguments import config_of, data_parser
from bench.common.clouds import data_folder
from bench.models.clouds import clouds_in, clouds_table, models_of_cloud, reasons_table
from bench.models.truth import bad_table, judged, truth_table
from bench.scenes.models import BAD_SCENES, SHAPES, model_scene

FOOTPRINTS = "buildings_nw.gpkg"


def run_scenes(options: argparse.Namespace) -> None:
    """Compare models of virtual roofs with their truth."""
    scenes = [
        model_scene(name, density=options.density, noise=options.noise, rotation_deg=angle, seed=seed)
        for name in options.roofs
        for seed in options.seeds
        for angle in rotations(options.rotations)
    ]
    verdicts = judged(scenes, options.configs)
    print(f"{options.density:g} pts/m², noise {options.noise:g} m; errors are the largest of all scenes:")
    print(truth_table(verdicts), end="\n\n")


def run_bad(options: argparse.Namespace) -> None:
    """Say what comes of bad input."""
    scenes = [make(rotation_deg=20.0) for make in BAD_SCENES.values()]
    print(bad_table(judged(scenes, options.configs)), end="\n\n")


def run_clouds(options: argparse.Namespace) -> None:
    """Take every cloud through the chain."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name, files in clouds_in(options.data_folder):
            if options.clouds and name.split("/")[0] not in options.clouds:
                continue
            output = Path(folder) / name.replace("/", "_")
            found.append(models_of_cloud(name, files, output))
            footprints = files[0].parent / FOOTPRINTS
            if footprints.is_file():
                given = Path(f"{output}_footprints")
                found.append(models_of_cloud(name, files, given, footprints=footprints))
    print(clouds_table(found), end="\n\n")
    print(reasons_table(found), end="\n\n")
    invalid = [(cloud.name, *one) for cloud in found for one in cloud.invalid()]
    print(f"invalid solids: {invalid or 'none'}\n")


PARTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "scenes": run_scenes,
    "bad": run_bad,
    "clouds": run_clouds,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the parts asked for."""
    options = _parser().parse_args(arguments)
    options.configs = config_of(options.set)
    options.data_folder = data_folder(options.data)
    for part in options.parts:
        PARTS[part](options)


def rotations(n: int) -> list[float]:
    """Return so many orientations of the quadrant, along the axes first; shapes have two different sides."""
    return [90.0 * k / n for k in range(n)]


def _parser() -> argparse.ArgumentParser:
    parser = data_parser(__doc__)
    parser.add_argument("--parts", nargs="+", choices=tuple(PARTS), default=tuple(PARTS), metavar="PART")
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="STAGE.NAME=VALUE", help="scenes, bad: parameters"
    )
    parser.add_argument(
        "--roofs",
        nargs="+",
        choices=tuple(SHAPES),
        default=tuple(SHAPES),
        metavar="NAME",
        help="scenes: (all)",
    )
    parser.add_argument("--rotations", type=int, default=12, metavar="N", help="scenes: orientations (12)")
    parser.add_argument("--density", type=float, default=8.0, metavar="D", help="scenes: points per m² (8)")
    parser.add_argument("--noise", type=float, default=0.03, metavar="M", help="scenes: σ of z [m] (0.03)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], metavar="N", help="scenes: rounds (0)")
    parser.add_argument("--clouds", nargs="+", metavar="NAME", help="clouds: folders of the data (all)")
    return parser


if __name__ == "__main__":
    main()

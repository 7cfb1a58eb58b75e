"""
Planes of roofs as instances, beside other libraries: labelled by hand, and on virtual roofs.

    python -m bench.planes.run [--data DIR] [--methods METHOD ...] [--set NAME=VALUE ...] [--roofs]
                           [--densities D ...] [--noises M ...] [--seeds N] [--repeats N]

Precision, recall and F1 are of planes whose points have an intersection over union of at least one half; the
coverage is weighted by the planes' points, and is the mean over roofs. Seconds are the least of several runs
over all roofs, after one that compiles.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.common.arguments import parser_of, settings_of
from bench.common.clouds import data_folder
from bench.common.tables import percent, table
from bench.planes.peers import METHODS, Method, own_method
from bench.planes.truth import KnownRoof, labelled_roofs, virtual_roofs
from lidar_buildings.core.stages.plane_fitting.config import PlaneFittingConfig
from lidar_buildings.evaluation.scores.planes import PlaneScore, score_planes

OWN = "lidar_buildings"
HEADINGS = ("method", "planes", "precision", "recall", "F1", "mean F1", "mean coverage", "s", "Mpoints/s")
ROOF_HEADINGS = ("roof", "points", "reference", "found", "precision", "recall", "F1", "coverage")
VIRTUAL_HEADINGS = ("roof", "cases", "all planes", "too many", "F1", "coverage", "angle °, 95 %", "largest")


def run_over(
    method: Method, roofs: Sequence[KnownRoof], repeats: int
) -> tuple[list[NDArray[np.int64]], float]:
    """Return the planes of every roof, and the least seconds that a run over all took."""
    method.find(roofs[0].points)
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        found = [method.find(roof.points) for roof in roofs]
        seconds.append(time.perf_counter() - begin)
    return found, min(seconds)


def row_of(name: str, scores: Sequence[PlaneScore], seconds: float) -> list[str]:
    """Line of a method over all roofs."""
    names = ("found", "result", "reference")
    found, mine, theirs = (sum(getattr(s, f"n_planes_{n}") for s in scores) for n in names)
    shares = found / max(mine, 1), found / theirs, 2 * found / (mine + theirs)
    means = (float(np.nanmean([getattr(s, n) for s in scores])) for n in ("f1", "weighted_coverage"))
    n_points = sum(score.n_points for score in scores)
    shown = [percent(share) for share in (*shares, *means)]
    return [name, str(mine), *shown, f"{seconds:.3f}", f"{n_points / seconds / 1e6:.2f}"]


def roof_rows(roofs: Sequence[KnownRoof], scores: Sequence[PlaneScore]) -> list[list[str]]:
    """Lines of single roofs."""
    return [
        [roof.name, str(score.n_points), str(score.n_planes_reference), str(score.n_planes_result)]
        + [percent(v) for v in (score.precision, score.recall, score.f1, score.weighted_coverage)]
        for roof, score in zip(roofs, scores, strict=True)
    ]


def angles_of(roof: KnownRoof, found: NDArray[np.int64]) -> list[float]:
    """Return by how much the planes found lean from the true ones that they share most points with [deg]."""
    angles = []
    for number, normal in enumerate(roof.normals, start=1):
        labels = found[(roof.planes == number) & (found > 0)]
        if len(labels):
            own = roof.points[found == np.bincount(labels).argmax()]
            mine = np.linalg.svd(own - own.mean(axis=0), full_matrices=False)[2][2]
            angles.append(float(np.degrees(np.arccos(min(1.0, abs(mine @ normal))))))
    return angles


def virtual_rows(method: Method, roofs: Sequence[KnownRoof]) -> list[list[str]]:
    """Lines of shapes: cases with all planes found, cases with too many, F1, coverage, and angles."""
    by_name: dict[str, list[tuple[PlaneScore, list[float]]]] = defaultdict(list)
    for roof in roofs:
        found = method.find(roof.points)
        by_name[roof.name].append((score_planes(found, roof.planes), angles_of(roof, found)))
    return [_virtual_row(name, cases) for name, cases in by_name.items()]


def _virtual_row(name: str, cases: Sequence[tuple[PlaneScore, list[float]]]) -> list[str]:
    """Line of one shape."""
    scores = [score for score, _ in cases]
    angles = [angle for _, several in cases for angle in several] or [np.nan]
    counts = (
        len(scores),
        sum(score.n_planes_found == score.n_planes_reference for score in scores),
        sum(score.n_planes_result > score.n_planes_reference for score in scores),
    )
    means = (float(np.mean([getattr(s, n) for s in scores])) for n in ("f1", "weighted_coverage"))
    return [
        name,
        *map(str, counts),
        *(percent(mean) for mean in means),
        f"{np.percentile(angles, 95):.2f}",
        f"{max(angles):.2f}",
    ]


def print_labelled(
    methods: Mapping[str, Method], roofs: Sequence[KnownRoof], options: argparse.Namespace
) -> None:
    """Print the tables of the roofs that were labelled by hand."""
    n_planes = sum(int(roof.planes.max()) for roof in roofs)
    print(f"{len(roofs)} roofs labelled by hand, {n_planes} planes:")
    rows = []
    for name, method in methods.items():
        found, seconds = run_over(method, roofs, options.repeats)
        scores = [score_planes(f, roof.planes) for f, roof in zip(found, roofs, strict=True)]
        rows.append(row_of(name, scores, seconds))
        if options.roofs:
            print(f"\n{name}:\n{table(ROOF_HEADINGS, roof_rows(roofs, scores))}\n")
    print(table(HEADINGS, rows))


def parser_of_planes() -> argparse.ArgumentParser:
    """Describe the command line."""
    parser = parser_of(__doc__, tuple(METHODS))
    parser.add_argument("--roofs", action="store_true", help="print every roof, too")
    parser.add_argument("--densities", nargs="*", type=float, default=[1.0, 4.0, 8.0, 30.0], metavar="D")
    parser.add_argument("--noises", nargs="*", type=float, default=[0.02, 0.05, 0.1], metavar="M")
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="samples of each virtual roof")
    parser.add_argument("--repeats", type=int, default=3, metavar="N", help="runs, the best of which counts")
    return parser


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    options = parser_of_planes().parse_args(arguments)
    own = own_method(PlaneFittingConfig(**settings_of(options.set, "plane_fitting")))
    methods = {name: own if name == OWN else METHODS[name] for name in options.methods}
    for name in [name for name, method in methods.items() if not method.installed]:
        print(f"{name}: {methods.pop(name).package} is not installed", file=sys.stderr)
    labelled = labelled_roofs(data_folder(options.data))
    if labelled:
        print_labelled(methods, labelled, options)
    else:
        print(f"{data_folder(options.data)}: holds no labelled roofs", file=sys.stderr)
    roofs = virtual_roofs(options.densities, options.noises, options.seeds)
    if roofs and OWN in methods:
        print(f"\nVirtual roofs, {OWN}, at {options.densities} points/m², noise {options.noises} m:")
        print(table(VIRTUAL_HEADINGS, virtual_rows(own, roofs)))


if __name__ == "__main__":
    main()

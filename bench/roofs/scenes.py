"""
Roof selection on the roof scenes of the tests, whose truth is exact.

    python -m bench.roofs.scenes [--methods METHOD ...] [--scenes SCENE ...] [--set NAME=VALUE ...]
                                [--rotation 0] [--seed 0] [--density 1.0] [--noise M] [--pictures DIR]

Prints recall, precision and F1 of the roof points per scene, all methods side by side, then their means and
each method's worst scene. Heights above ground and ground points are the true ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.common.arguments import add_pictures, add_scenes, parser_of, settings_of
from bench.common.tables import percent, table
from bench.roofs.methods import (
    METHODS,
    POINT_HEADINGS,
    groups_of,
    method_headings,
    point_cells,
    point_score,
    roof_mask,
)
from bench.scenes.roofs import ROOF_SCENES
from lidar_buildings.evaluation.scores.cells import Confusion


def made(name: str, density_factor: float = 1.0, noise: float | None = None, **arguments: Any) -> Any:
    """Make a scene at a multiple of its own density, with its own noise unless another one is asked for."""
    scene = ROOF_SCENES[name]
    if noise is not None:
        arguments["noise"] = noise
    return scene(density=scene.__kwdefaults__["density"] * density_factor, **arguments)


def rows_of(
    found: Mapping[str, Any],
    methods: Sequence[str],
    settings: Mapping[str, Any] | None = None,
    pictures: Path | None = None,
) -> list[list[str]]:
    """Lines of the table: every scene, the means, and the worst scenes."""
    scores: dict[str, dict[str, Confusion]] = {method: {} for method in methods}
    rows = []
    for name, scene in found.items():
        cells = []
        for method in methods:
            mask = roof_mask(scene.points, scene.columns, method, settings, with_facades=False)
            scores[method][name] = point_score(mask, scene.is_building, scene.is_judged)
            cells += point_cells(scores[method][name])
            if pictures is not None:
                from bench.common.pictures import draw_over_relief

                groups = groups_of(scene.points, mask & scene.is_judged, scene.is_building & scene.is_judged)
                path = pictures / f"{name}_{method}.png"
                draw_over_relief(path, scene.points, groups, f"{name}, {method}")
        rows.append([name, str(len(scene.points)), *cells])
    return [*rows, _mean_row(scores), _worst_row(scores)]


def _mean_row(scores: Mapping[str, Mapping[str, Confusion]]) -> list[str]:
    """Return the means, each scene weighing the same."""
    means = [
        percent(float(np.nanmean([getattr(score, member) for score in of.values()])))
        for of in scores.values()
        for member in ("recall", "precision", "f1")
    ]
    return ["mean", "", *means]


def _worst_row(scores: Mapping[str, Mapping[str, Confusion]]) -> list[str]:
    """Return each method's least F1, and in which scene."""
    cells = []
    for of in scores.values():
        name = min(of, key=lambda name: np.nan_to_num(of[name].f1))
        cells += ["", name, percent(of[name].f1)]
    return ["worst", "", *cells]


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the scenes, run the methods, print the table."""
    parser = parser_of(__doc__, METHODS)
    add_scenes(parser, ROOF_SCENES)
    parser.add_argument(
        "--noise", type=float, metavar="M", help="standard deviation along each axis (default: the scene's)"
    )
    parser.add_argument("--facades", action="store_true", help="do not judge façades: they may be either")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    found = {
        name: made(name, options.density, options.noise, rotation_deg=options.rotation, seed=options.seed)
        for name in options.scenes
    }
    if options.facades:
        found = {name: s._replace(is_judged=s.is_judged & ~s.is_facade) for name, s in found.items()}
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    settings = settings_of(options.set, "roof_selection")
    print(", ".join(f"{short} = {method}" for short, method in method_headings(options.methods).items()))
    headings = [f"{short} {name}" for short in method_headings(options.methods) for name in POINT_HEADINGS]
    print(table(("scene", "points", *headings), rows_of(found, options.methods, settings, options.pictures)))


if __name__ == "__main__":
    main()

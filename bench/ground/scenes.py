"""
Ground filters on the terrain scenes of the tests, whose truth is exact.

    python -m bench.ground.scenes [--methods METHOD ...] [--scenes SCENE ...] [--rotation 0] [--seed 0]
                                   [--density 1.0] [--noise M] [--pictures DIR]

Prints total, type I and type II error and kappa per method and scene, the means and the worst scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.common.arguments import add_pictures, add_scenes, parser_of, settings_of
from bench.common.clouds import Cloud
from bench.common.tables import percent, table
from bench.ground.methods import METHODS, ground_mask
from bench.ground.scores import SCORE_HEADINGS, cells_of, draw_errors, mean_cells, score_of_mask
from bench.scenes.terrain import TERRAIN_SCENES


def made(name: str, density_factor: float = 1.0, **arguments: Any) -> Cloud:
    """Make a scene at a multiple of its own density."""
    scene = TERRAIN_SCENES[name]
    density = scene.__kwdefaults__["density"] * density_factor
    points, is_ground = scene(density=density, **arguments)
    return Cloud(points, {}, is_ground)


def rows_of(
    clouds: Mapping[str, Cloud],
    methods: Sequence[str],
    settings: Mapping[str, Any] | None = None,
    pictures: Path | None = None,
) -> list[list[str]]:
    """Lines of the table: every method on every scene, its mean and its worst."""
    rows = []
    for method in methods:
        scores = {}
        for name, cloud in clouds.items():
            mask = ground_mask(cloud, method, settings)
            scores[name] = score_of_mask(mask, cloud.is_ground)
            rows.append([method, name, *cells_of(scores[name])])
            draw_errors(pictures, method, name, cloud, mask)
        rows.append([method, "mean", *mean_cells(list(scores.values()))])
        worst = max(scores, key=lambda name: scores[name].total_error)
        rows.append([method, f"worst: {worst}", percent(scores[worst].total_error), "", "", ""])
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the scenes, run the filters, print the table."""
    parser = parser_of(__doc__, METHODS)
    add_scenes(parser, TERRAIN_SCENES)
    parser.add_argument("--noise", type=float, default=0.03, metavar="M", help="standard deviation along z")
    add_pictures(parser)
    options = parser.parse_args(arguments)
    clouds = {
        name: made(
            name, options.density, rotation_deg=options.rotation, seed=options.seed, noise=options.noise
        )
        for name in options.scenes
    }
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    rows = rows_of(clouds, options.methods, settings_of(options.set), options.pictures)
    print(table(("method", "scene", *SCORE_HEADINGS), rows))


if __name__ == "__main__":
    main()

"""
How corners of a town get better, and their σ with them, as it is flown over again.

    python -m bench.models.strips [--scene NAME] [--seeds N ...] [--density D] [--set STAGE.NAME=VALUE ...]

Each flight crosses the whole scene in a direction of its own; a live survey makes a tile again when more
points have come, of all its points, as here. A line per number of flights: the points, the buildings with a
model, corners of LoD2.2 matched with the truth within 1 m, the medians of their errors and of their standard
deviations in plan (along one axis) and in height, and the shares of errors within one and two of these.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.common.arguments import config_of
from bench.common.tables import table
from bench.models.precision import NEAR, SAME, told_corners
from bench.scenes.models import solid_of
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.evaluation.scores.models import roof_wireframe
from lidar_buildings.evaluation.scores.outlines import match_corners
from lidar_buildings.pipeline.config import PipelineConfig
from lidar_buildings.pipeline.reconstruct import reconstruct_tile
from lidar_buildings.simulation import make_scene, simulate_tile
from lidar_buildings.simulation.scene import VirtualScene

#: Directions of the flights, counter-clockwise from east [deg].
DIRECTIONS = (0.0, 90.0, 45.0, 135.0)
HEADINGS = (
    "seed", "flights", "points", "models", "corners", "xy error [m]", "xy σ [m]", "z error [m]", "z σ [m]",
    "x, y: 1σ %", "2σ %", "z: 1σ %", "2σ %",
)  # fmt: skip


class Matched(NamedTuple):
    """Corners of models beside the true ones."""

    n_models: int
    errors: NDArray[np.float64]  #: along x, y and z, shape (n, 3) [m]
    sigmas: NDArray[np.float64]  #: as the models say, shape (n, 3) [m]


def after_each_flight(scene: VirtualScene, seed: int, density: float) -> Iterator[PointTile]:
    """Yield all points measured so far."""
    flights: list[PointTile] = []
    for number, direction in enumerate(DIRECTIONS):
        own = seed * len(DIRECTIONS) + number
        flights.append(simulate_tile(scene, own, density=density, flight_direction_deg=direction)[0])
        points = np.concatenate([one.points for one in flights])
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in flights]) for name in flights[0].columns
        }
        columns["point_source_id"] = np.repeat(np.arange(len(flights)), [len(one) for one in flights])
        columns["index"] = np.arange(len(points))
        spacing = steady_spacing(points, None)
        yield PointTile(points, stamp=flights[0].stamp, point_spacing=spacing, frame=scene.frame, **columns)


def matched(tile: PointTile, scene: VirtualScene, config: PipelineConfig) -> Matched:
    """Model a tile, and match the corners of its roofs with the true ones."""
    models = [one.model for one in reconstruct_tile(tile, config).models]
    told = [corner for model in models for corner in told_corners(model)]
    true = np.concatenate([roof_wireframe([solid_of(one)]).corners for one in scene.buildings])
    away = np.linalg.norm(true[:, None, :2] - true[:, :2], axis=2)
    is_alone = ~((away > SAME) & (away < NEAR)).any(axis=1)
    rows, columns, _ = match_corners(np.array([place for _, place, _ in told]), true, NEAR)
    pairs = [(i, j) for i, j in zip(rows, columns, strict=True) if is_alone[j]]
    errors = np.array([told[i][1] - true[j] for i, j in pairs])
    return Matched(
        sum(bool(model.solids) for model in models), errors, np.array([told[i][2] for i, _ in pairs])
    )


def cells_of(found: Matched) -> list[str]:
    """Return the figures of corners in the order of the headings."""
    error, sigma = np.abs(found.errors), found.sigmas
    medians = [np.median(one[:, axes]) for axes in (slice(2), 2) for one in (error, sigma)]
    within = [
        np.mean(error[:, axes] <= k * sigma[:, axes]) for axes in (slice(2), slice(2, 3)) for k in (1, 2)
    ]
    return [
        str(found.n_models),
        str(len(error)),
        *(f"{one:.3f}" for one in medians),
        *(f"{100 * one:.0f}" for one in within),
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each seed and number of flights."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scene", default="village")
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12])
    parser.add_argument("--density", type=float, default=2.0, help="pulses of each flight [1/m²]")
    parser.add_argument(
        "--set", nargs="+", default=["regularisation.correct_bias=true"], metavar="STAGE.NAME=VALUE"
    )
    options = parser.parse_args(arguments)
    config, rows = config_of(options.set), []
    for seed in options.seeds:
        scene = make_scene(options.scene, seed)
        for number, tile in enumerate(after_each_flight(scene, seed, options.density), start=1):
            cells = cells_of(matched(tile, scene, config))
            rows.append([str(seed), str(number), f"{len(tile):,}", *cells])
    print(table(HEADINGS, rows))


if __name__ == "__main__":
    main()

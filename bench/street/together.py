"""
A village seen from above alone, and together with what a vehicle saw: its outlines must not get worse.

    python -m bench.street.together [--scene NAME] [--seeds N ...] [--density D] [--up DEG ...] [--rate N]
                                    [--pictures DIR]

`--up` are the elevations of the vehicle's highest beam. Each line has the points, how many of them are from
the street at places that were seen from above, the area IoU of all outlines together, and how many buildings
have an outline of IoU 0.9 or more.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from bench.common.arguments import add_pictures, picture_folder
from bench.common.plotting import plt
from bench.common.tables import table
from bench.outlines.pictures import draw_rings
from lidar_buildings.core.model.classes import PointClass, View
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.neighbours.point_spacing import steady_spacing
from lidar_buildings.core.neighbours.strip_views import strip_numbers, strip_views, with_covered
from lidar_buildings.pipeline.reconstruct import TileResult, reconstruct_tile
from lidar_buildings.simulation import make_scene, simulate_tile
from lidar_buildings.simulation.live import Scan, VehicleConfig, drive
from lidar_buildings.simulation.scanner import StripPoints, joined
from lidar_buildings.simulation.scene import VirtualScene

#: IoU from which a building counts as found.
FOUND = 0.9
HEADINGS = ("scene", "seed", "beams to", "points", "covered", "area IoU", "IoU 0.9", "outlines", "seconds")
#: What is drawn of the points: colour → which.
_COLOURS = {
    "0.8": lambda tile: tile.classification == PointClass.GROUND,
    "tab:green": lambda tile: np.isin(tile.classification, (3, 4, 5)),
    "tab:orange": lambda tile: tile.facade > 0,
    "tab:blue": lambda tile: tile.is_roof,
}


def seen_by_vehicle(scene: VirtualScene, seed: int, highest_deg: float, rate: float) -> StripPoints:
    """Return what a vehicle measures on all streets of a scene, placed exactly."""
    survey = drive(scene, seed, VehicleConfig(highest_deg=highest_deg, pulse_rate=rate))
    return joined([event.truth for event in survey.events() if isinstance(event, Scan)])


def with_street(above: PointTile, street: StripPoints) -> PointTile:
    """Return a tile with points from the street, each with its view, told by the strips as a run does."""
    n = len(street.points)
    columns = {
        name: np.concatenate([column, getattr(street, name, np.zeros(n))])
        for name, column in above.columns.items()
    }
    columns["source"] = np.repeat([0, 1], [len(above), n])
    columns["index"] = np.concatenate([np.arange(len(above)), np.arange(n)])
    points = np.concatenate([above.points, street.points])
    view = np.concatenate(
        [
            strip_views(own.points, strip_numbers(own.point_source_id, own.gps_time, len(own.points)))
            for own in (above, street)
        ]
    )
    spacing = above.point_spacing
    return PointTile(
        points, view=with_covered(points, view, spacing or 1.0), point_spacing=spacing, **columns
    )


def scores(outlines: Sequence[shapely.Polygon], truth: Sequence[shapely.Polygon]) -> tuple[float, int]:
    """Return the IoU of all outlines together, and how many buildings have one of IoU `FOUND`."""
    found, true = shapely.union_all(outlines), shapely.union_all(truth)
    pairs: NDArray[np.float64] = np.array(
        [[one.intersection(other).area / one.union(other).area for other in truth] for one in outlines]
    ).reshape(len(outlines), len(truth))
    best = pairs[linear_sum_assignment(-pairs)]
    return found.intersection(true).area / found.union(true).area, int(np.count_nonzero(best >= FOUND))


def draw(path: Path, result: TileResult, truth: Sequence[shapely.Polygon]) -> None:
    """Draw points by class, the truth (black) and the outlines (magenta)."""
    tile = result.classified
    figure, axes = plt.subplots(figsize=(12, 10), dpi=80, layout="constrained")
    for colour, of in _COLOURS.items():
        axes.plot(*tile.points[of(tile)][::7, :2].T, ",", color=colour)
    draw_rings(axes, truth, color="black", linewidth=0.8)
    draw_rings(axes, [one.outline.polygon for one in result.outlines], color="magenta", linewidth=1.3)
    axes.set_aspect("equal")
    axes.axis("off")
    figure.savefig(path)
    plt.close(figure)


def main() -> None:
    """Print a line for each scene, from above and with each vehicle."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--scene", default="village")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 11, 12, 13])
    parser.add_argument("--density", type=float, default=8.0, help="pulses from above [1/m²]")
    parser.add_argument("--up", type=float, nargs="*", default=[2.0, 20.0], help="highest beams [deg]")
    parser.add_argument("--rate", type=float, default=163_840.0, help="rays a second")
    add_pictures(parser)
    options = parser.parse_args()
    folder, rows = picture_folder(options.pictures), []
    for seed in options.seeds:
        scene = make_scene(options.scene, seed)
        truth = [one.polygon for one in scene.buildings]
        above, _ = simulate_tile(scene, seed, density=options.density)
        above = above.with_columns(point_spacing=steady_spacing(above.points, None))
        for up in (None, *options.up):
            tile = above
            if up is not None:
                tile = with_street(above, seen_by_vehicle(scene, seed, up, options.rate))
            began = time.process_time()
            result = reconstruct_tile(tile, until="regularisation")
            seconds = time.process_time() - began
            iou, n_found = scores([one.outline.polygon for one in result.outlines], truth)
            covered = 0 if tile.view is None else np.count_nonzero(tile.view == View.COVERED)
            name = "–" if up is None else f"{up:+g}°"
            counts = f"{n_found} of {len(truth)}", str(len(result.outlines)), f"{seconds:.0f}"
            rows.append(
                (options.scene, str(seed), name, f"{len(tile):,}", f"{covered:,}", f"{iou:.4f}", *counts)
            )
            if folder is not None:
                draw(
                    folder / f"{options.scene}_{seed}_{'air' if up is None else f'{up:g}'}.png", result, truth
                )
    print(table(HEADINGS, rows))


if __name__ == "__main__":
    main()

"""
Spires, turrets, A-frames and mansards from raw points to models; truth is exact.

    python -m bench.roofs.spires [--slopes 70 75 80 85] [--densities 8 25] [--plans PLAN ...]
                                 [--stands STAND ...] [--seeds 1] [--seed 0] [--given] [--each]

A tower is found if a model covers half of its plan and rises above half of its spire; its tip is right if the
highest vertex there is within 1 m and two spacings times the slope of the truth. With `--given`, the tower's
and the nave's true plans are given as footprints. Prints shares by slope and density, by plan and by stand.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from bench.common.tables import table
from bench.scenes.spires import PLANS, STANDS, SteepRoof, a_frame, mansard, spire
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.model.tile import PointTile
from lidar_buildings.core.stages.footprints.footprints import footprints_of
from lidar_buildings.pipeline.reconstruct import TileResult, reconstruct_tile

#: Steps along each side of a raster over the plan.
STEPS = 41


class Outcome(NamedTuple):
    """What became of one steep roof."""

    points: float  #: share of its points that are roof of a building
    is_found: bool
    tip: float  #: highest vertex above the true tip [m]; −inf without a model
    is_right: bool  #: whether the tip is as near as it should be
    error: float  #: median distance along z of the model's roof from the truth over the plan [m]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--slopes", type=float, nargs="+", default=[70.0, 75.0, 80.0, 85.0])
    parser.add_argument("--densities", type=float, nargs="+", default=[8.0, 25.0])
    parser.add_argument("--plans", nargs="+", choices=(*PLANS, "a_frame", "mansard"), default=PLANS)
    parser.add_argument("--stands", nargs="+", choices=STANDS, default=STANDS)
    parser.add_argument("--seeds", type=int, default=1, help="towers of each kind")
    parser.add_argument("--seed", type=int, default=0, help="the first of them")
    parser.add_argument("--given", action="store_true", help="with the true footprints")
    parser.add_argument("--each", action="store_true", help="print every tower, too")
    options = parser.parse_args(arguments)
    outcomes = {}
    for slope in options.slopes:
        for density in options.densities:
            for seed in range(options.seed, options.seed + options.seeds):
                for plan in options.plans:
                    for stand in options.stands if plan in PLANS else ("free",):
                        made = roof_of(plan, stand, slope, density, seed)
                        key = (f"{slope:g}°", f"{density:g}/m²", plan, stand)
                        outcomes[(*key, str(seed))] = outcome(made, slope, density, options.given)
                        if options.each:
                            print(*key, seed, *cells_of([outcomes[(*key, str(seed))]]), flush=True)
    for title, columns in (("slope", (0, 1)), ("plan", (2,)), ("stand", (3,)), ("all", ())):
        groups = defaultdict(list)
        for key, one in outcomes.items():
            groups[" ".join(key[column] for column in columns)].append(one)
        print(table((title, *HEADINGS), [[name, *cells_of(of)] for name, of in groups.items()]), end="\n\n")


#: Columns that `cells_of` fills.
HEADINGS = ("n", "points %", "found %", "tip right %", "median tip m", "median |dz| m")


def cells_of(outcomes: Sequence[Outcome]) -> list[str]:
    """Number, means and medians."""
    points, found, tip, right, error = np.array(outcomes, dtype=float).T
    return [
        str(len(outcomes)),
        *(f"{100.0 * values.mean():.1f}" for values in (points, found, right)),
        *(f"{np.median(values):.2f}" for values in (tip, error)),
    ]


def roof_of(plan: str, stand: str, slope: float, density: float, seed: int) -> SteepRoof:
    """Make a scene by the names of its parts."""
    if plan in PLANS:
        return spire(plan, stand, slope, density=density, seed=seed)
    return (a_frame if plan == "a_frame" else mansard)(slope, density=density, seed=seed)


def tile_of(made: SteepRoof) -> PointTile:
    """Take what a file would say of the scene."""
    columns = made.scene.columns
    names = ("return_number", "number_of_returns", "intensity")
    return PointTile(points=made.scene.points, **{name: columns[name] for name in names})


def outcome(made: SteepRoof, slope: float, density: float, is_given: bool = False) -> Outcome:
    """Reconstruct a scene, with its footprint or without, and look at its steep roof."""
    footprints = footprints_of([made.footprint]) if is_given else None
    return judged(made, reconstruct_tile(tile_of(made), footprints=footprints), slope, density)


def judged(made: SteepRoof, result: TileResult, slope: float, density: float) -> Outcome:
    """Compare a result with the truth."""
    x, y, reach = made.shape.extent()
    steps = np.linspace(-reach, reach, STEPS)
    places = np.stack(np.meshgrid(x + steps, y + steps), axis=-1).reshape(-1, 2)
    depth = made.shape.depth(*places.T)
    places = places[depth > 0.0]
    z = made.scene.points[:, 2]
    over = (made.shape.depth(*made.scene.points[:, :2].T) > 0.0) & made.scene.is_building
    over &= z > made.bottom
    classified = result.classified
    roof = (classified.classification == PointClass.BUILDING) & (classified.facade == 0)
    model = np.full(len(places), -np.inf)
    tip = -np.inf
    for one in result.models:
        for rings in one.model.roof_faces:
            face = shapely.Polygon(rings[0][:, :2], [ring[:, :2] for ring in rings[1:]])
            inside = shapely.intersects_xy(face, *places.T)
            if inside.any():
                tip = max(
                    tip, float(rings[0][made.shape.depth(*rings[0][:, :2].T) > -0.5, 2].max(initial=-np.inf))
                )
                model[inside] = np.maximum(model[inside], _elevation(rings[0], places[inside]))
    rise = float(np.tan(np.deg2rad(slope)))
    truth = np.minimum(made.bottom + rise * made.shape.depth(*places.T), made.top)
    covered = np.isfinite(model)
    is_found = bool(covered.mean() >= 0.5 and tip > 0.5 * (made.bottom + made.top))
    limit = 1.0 + 2.0 * rise / np.sqrt(density)
    error = float(np.median(np.abs(model - truth)[covered])) if covered.any() else np.inf
    return Outcome(float(roof[over].mean()), is_found, tip - made.top, abs(tip - made.top) <= limit, error)


def _elevation(ring: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Elevation of a plane ring at places, its largest corner's [m] where it is upright."""
    middle = ring.mean(axis=0)
    normal = np.linalg.svd(ring - middle)[2][2]
    if abs(normal[2]) < 1e-6:
        return np.full(len(places), ring[:, 2].max())
    return middle[2] - (places - middle[:2]) @ normal[:2] / normal[2]


if __name__ == "__main__":
    main()

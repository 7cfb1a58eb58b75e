"""
Gross errors set below synthetic terrain: how many are found, by depth and density; truth is exact.

    python -m bench.ground.noise [--seeds 4] [--densities 0.2 1 4 15 40]

Prints the share found of groups of 1 to 60 points on level, sloping, steep and rolling ground, and how many
points of the terrain were taken for errors.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from bench.common.tables import table
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.stages.ground_filter.classification import classify_ground

#: Rise over run of planes, and rolling ground.
TERRAINS = (
    lambda x, y: 0.0 * x,
    lambda x, y: 0.4 * x + 0.2 * y,
    lambda x, y: 0.8 * x,
    lambda x, y: 5.0 * np.sin(x / 25.0) + 4.0 * np.cos(y / 20.0),
)
DEPTHS = (1.5, 2.5, 5.0, 15.0, 40.0)
SIZES = (1, 3, 10, 30, 60)
#: Points of each terrain, and its least side [m].
N_POINTS, LEAST_SIDE = 8000, 60.0


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=4, help="terrains and groups of each kind")
    parser.add_argument("--densities", type=float, nargs="+", default=[0.2, 1.0, 4.0, 15.0, 40.0])
    options = parser.parse_args(arguments)
    headings = ["points/m²", *(f"{depth:g} m %" for depth in DEPTHS), "terrain taken ppm"]
    print(table(headings, [row(density, options.seeds) for density in options.densities]))


def row(density: float, n_seeds: int) -> list[str]:
    """
    Return the figures of one density: the shares found at each depth [%], and what was taken wrongly [ppm].
    """
    found, taken = [], []
    for depth in DEPTHS:
        outcomes = [
            outcome(density, depth, size, terrain, seed)
            for terrain in range(len(TERRAINS))
            for size in SIZES
            for seed in range(n_seeds)
        ]
        shares, wrong = zip(*outcomes, strict=True)
        found.append(f"{100.0 * np.mean(shares):.0f}")
        taken.append(np.mean(wrong))
    return [f"{density:g}", *found, f"{1e6 * np.mean(taken):.0f}"]


def outcome(density: float, depth: float, size: int, terrain: int, seed: int) -> tuple[float, float]:
    """Return the share of one group that was found, and of the terrain that was taken for errors."""
    random = np.random.default_rng([terrain, size, seed])
    side = max(LEAST_SIDE, np.sqrt(N_POINTS / density))
    xy = random.uniform(0.0, side, (int(density * side * side), 2))
    ground = np.column_stack((xy, TERRAINS[terrain](*xy.T) + random.normal(0.0, 0.03, len(xy))))
    spread = 0.3 * np.sqrt(size)
    at = random.uniform(0.25 * side, 0.75 * side, 2) + random.uniform(-spread, spread, (size, 2))
    below = TERRAINS[terrain](*at.T) - depth + random.uniform(-0.2, 0.2, size)
    classes = classify_ground(np.vstack((ground, np.column_stack((at, below))))).classification
    is_error = np.isin(classes, (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
    return float(is_error[len(ground) :].mean()), float(is_error[: len(ground)].mean())


if __name__ == "__main__":
    main()

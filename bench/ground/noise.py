"""
Gross errors in synthetic terrain: how many are found, and how much of the ground stays; truth is exact.

    python -m bench.ground.noise [--shares 0.25 1 3] [--patterns PATTERN ...] [--densities 1 4 15 40]
                                 [--scenes SCENE ...] [--depths 1 30] [--seeds 1] [--seed 0] [--groups]

Errors are a share of the cloud [%], and lie below the ground between two depths [m], or above it. Prints, by
scene, density, share and pattern, which share of the errors got class 7 or 18 and which share of the true
ground got class 2, the means and the worst, and before them what stays of the ground without any error.
With `--groups`: single groups of 1 to 60 points on level, sloping, steep and rolling ground, by depth.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bench.common.tables import table
from bench.scenes.gross_errors import DEPTHS, HIGH_PATTERNS, LOW_PATTERNS
from bench.scenes.terrain import TERRAIN_SCENES
from bench.scenes.terrain_site import TerrainScene, TerrainSite
from lidar_buildings.core.model.classes import PointClass
from lidar_buildings.core.stages.ground_filter.classification import classify_ground

#: Rise over run of planes, and rolling ground.
TERRAINS = {
    "level": lambda x, y: 0.0 * x,
    "slope": lambda x, y: 0.4 * x + 0.2 * y,
    "steep": lambda x, y: 0.8 * x,
    "rolling": lambda x, y: 5.0 * np.sin(x / 25.0) + 4.0 * np.cos(y / 20.0),
}
#: Scenes with real low ground and with cover, as dense as the table says.
SITES = ("city_block", "houses_on_hillside", "garage_ramp", "quarry", "bridge_over_cut", "river_bank")
FORESTS = ("steep_forest", "level_forest")
#: Depths and sizes of single groups.
GROUP_DEPTHS, GROUP_SIZES = (1.5, 2.5, 5.0, 15.0, 40.0), (1, 3, 10, 30, 60)
#: Points of each terrain, and its least side [m].
N_POINTS, LEAST_SIDE = 8000, 60.0
#: Densities of scenes go up to this, which is enough points.
MAX_SITE_DENSITY = 15.0


class Outcome(NamedTuple):
    """Which share of the errors was found, and of the ground kept; what stays of it without errors."""

    found: float
    kept: float
    usual: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    patterns = {**LOW_PATTERNS, **HIGH_PATTERNS}
    scenes = (*TERRAINS, *SITES, *FORESTS)
    parser.add_argument("--shares", type=float, nargs="+", default=[0.25, 1.0, 3.0], help="of the cloud [%%]")
    parser.add_argument("--patterns", nargs="+", choices=patterns, default=list(LOW_PATTERNS))
    parser.add_argument("--densities", type=float, nargs="+", default=[1.0, 4.0, 15.0, 40.0])
    parser.add_argument("--scenes", nargs="+", choices=scenes, default=scenes)
    parser.add_argument("--depths", type=float, nargs=2, default=DEPTHS, help="of low errors [m]")
    parser.add_argument("--seeds", type=int, default=1, help="terrains and errors of each kind")
    parser.add_argument("--seed", type=int, default=0, help="the first of them")
    parser.add_argument("--groups", action="store_true", help="single groups instead")
    options = parser.parse_args(arguments)
    seeds = range(options.seed, options.seed + options.seeds)
    if options.groups:
        headings = ["points/m²", *(f"{depth:g} m %" for depth in GROUP_DEPTHS), "terrain taken ppm"]
        print(table(headings, [group_row(density, seeds) for density in options.densities]))
        return
    outcomes = {}
    for name in options.scenes:
        for density in options.densities:
            for seed in seeds:
                scene = scene_of(name, density, seed)
                usual = kept_of(scene, classes_of(scene.points))
                for share in options.shares:
                    for pattern in options.patterns:
                        limits = {} if pattern in HIGH_PATTERNS else {"depths": tuple(options.depths)}
                        n = max(1, round(0.01 * share * len(scene.points)))
                        random = np.random.default_rng([seed, n, list(patterns).index(pattern)])
                        errors = patterns[pattern](scene, n, random, **limits)
                        outcomes[name, density, share, pattern, seed] = outcome(scene, errors, usual)
    print_range(outcomes)


def print_range(outcomes: dict[tuple[str, float, float, str, int], Outcome]) -> None:
    """Print the outcomes by scene and density, and by share and pattern."""
    for title, columns in (("by scene and density", (0, 1)), ("by share and pattern", (2, 3))):
        groups = defaultdict(list)
        for key, one in outcomes.items():
            groups[tuple(key[column] for column in columns)].append(one)
        rows = [[" ".join(f"{part}" for part in key), *cells_of(of)] for key, of in groups.items()]
        print(table((title, *RANGE_HEADINGS), rows), end="\n\n")
    print(table(("all", *RANGE_HEADINGS), [["", *cells_of(list(outcomes.values()))]]))


#: Columns that `cells_of` fills, in percent.
RANGE_HEADINGS = ("found %", "least", "cells ≥ 95", "ground %", "least", "without errors %")


def cells_of(outcomes: Sequence[Outcome]) -> list[str]:
    """Mean and least share found, of the ground kept, and what is kept without errors."""
    found, kept, usual = 100.0 * np.array(outcomes).T
    figures = (found.mean(), found.min(), 100.0 * (found >= 95.0).mean(), kept.mean(), kept.min())
    return [*(f"{value:.1f}" for value in (*figures, usual.mean()))]


def scene_of(name: str, density: float, seed: int) -> TerrainScene:
    """Make a terrain or a scene at a density."""
    if name in TERRAINS:
        random = np.random.default_rng([seed, 1])
        side = max(LEAST_SIDE, np.sqrt(N_POINTS / density))
        xy = random.uniform(0.0, side, (int(density * side * side), 2))
        z = TERRAINS[name](*xy.T) + random.normal(0.0, 0.03, len(xy))
        return TerrainScene(np.column_stack((xy, z)), np.ones(len(xy), dtype=bool))
    density = min(density, MAX_SITE_DENSITY)
    if name == "level_forest":
        return level_forest(density, seed)
    return TERRAIN_SCENES[name](density=density, seed=seed)


def level_forest(density: float, seed: int) -> TerrainScene:
    """Even, dense trees of 15 to 18 m on level ground, of which one pulse in ten reaches the ground."""
    site = TerrainSite(90, 90, density, seed)
    canopy = site.random.random(len(site.z)) < 0.9
    crown = 16.5 + np.sin(site.x / 2.3) * np.cos(site.y / 2.7) - 3.0 * site.random.random(len(canopy)) ** 2
    site.z[canopy], site.is_ground[canopy] = (site.terrain + crown)[canopy], False
    return site.scanned(0.03, 0.0)


def classes_of(points: np.ndarray) -> np.ndarray:
    return classify_ground(points).classification


def kept_of(scene: TerrainScene, classes: np.ndarray) -> float:
    """Return which share of the true ground is ground."""
    return float((classes[: len(scene.points)] == PointClass.GROUND)[scene.is_ground].mean())


def outcome(scene: TerrainScene, errors: np.ndarray, usual: float) -> Outcome:
    """Put errors into a scene and see what becomes of both."""
    classes = classes_of(np.vstack((scene.points, errors)))
    is_error = np.isin(classes[len(scene.points) :], (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
    return Outcome(float(is_error.mean()), kept_of(scene, classes), usual)


def group_row(density: float, seeds: Sequence[int]) -> list[str]:
    """Return the figures of single groups: shares found at each depth [%], and taken wrongly [ppm]."""
    found, taken = [], []
    for depth in GROUP_DEPTHS:
        outcomes = [
            group_outcome(density, depth, size, terrain, seed)
            for terrain in range(len(TERRAINS))
            for size in GROUP_SIZES
            for seed in seeds
        ]
        shares, wrong = zip(*outcomes, strict=True)
        found.append(f"{100.0 * np.mean(shares):.0f}")
        taken.append(np.mean(wrong))
    return [f"{density:g}", *found, f"{1e6 * np.mean(taken):.0f}"]


def group_outcome(density: float, depth: float, size: int, terrain: int, seed: int) -> tuple[float, float]:
    """Return the share of one group that was found, and of the terrain that was taken for errors."""
    elevation = list(TERRAINS.values())[terrain]
    random = np.random.default_rng([terrain, size, seed])
    side = max(LEAST_SIDE, np.sqrt(N_POINTS / density))
    xy = random.uniform(0.0, side, (int(density * side * side), 2))
    ground = np.column_stack((xy, elevation(*xy.T) + random.normal(0.0, 0.03, len(xy))))
    spread = 0.3 * np.sqrt(size)
    at = random.uniform(0.25 * side, 0.75 * side, 2) + random.uniform(-spread, spread, (size, 2))
    below = elevation(*at.T) - depth + random.uniform(-0.2, 0.2, size)
    classes = classes_of(np.vstack((ground, np.column_stack((at, below)))))
    is_error = np.isin(classes, (PointClass.LOW_NOISE, PointClass.HIGH_NOISE))
    return float(is_error[len(ground) :].mean()), float(is_error[: len(ground)].mean())


if __name__ == "__main__":
    main()
